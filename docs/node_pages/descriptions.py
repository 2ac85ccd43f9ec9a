# Copyright 2026 p4pfr_ros maintainers
# SPDX-License-Identifier: Apache-2.0

"""
Descriptions of the topics and services of our nodes, in the order of the pages.

Names, types and QoS come from the nodes themselves; ``interface`` compares both.
"""

from __future__ import annotations

from .interfaces import Endpoint, Role

POSE_NODE = {
    'correspondences': (
        'The points of one board, one per row: fields `u`, `v` (px of the raw image), `board_x`, '
        '`board_y` (m), all float32 or float64. Optional integer fields: `id`, the index of the '
        'point, and `board`, the index of the board in `board_file`, required if the file has '
        'several boards. Outliers are rejected.'
    ),
    'corners': (
        'The four corners of one marker, x and y in px of the raw image. The parameters '
        '`marker.*` describe the marker.'
    ),
    'detections': (
        'The tags detected by apriltag_ros, assigned to the boards of `board_file`. Subscribed to '
        'if apriltag_msgs is installed and `board_file` is set.'
    ),
    'tag_detections': (
        'The tags detected by isaac_ros_apriltag, likewise. Subscribed to if '
        'isaac_ros_apriltag_interfaces is installed and `board_file` is set.'
    ),
    'camera_info': (
        'Size, binning and region of interest of the raw image. K may be 0: only the mode '
        '`camera_info` uses the intrinsics. If its publishers are latched (transient local), so '
        'is the subscription: a message from before the start is received.'
    ),
    '~/pose': (
        'The pose of the board in the frame of the image, in metres. If a view does not determine '
        'direction and distance, it is not published.'
    ),
    '~/pose_with_covariance': (
        'The pose with its covariance, for every estimate; large where the view has little '
        'information.'
    ),
    '~/alternatives': 'Other poses that fit the view equally well; empty if there are none.',
    '~/camera_info': (
        'The camera in use, in a model that image_proc supports: `rational_polynomial`, or '
        '`equidistant` for wide lenses. Published when the camera changes or improves; late '
        'subscribers receive the last one. K is 0 when the camera is no longer known, as after a '
        'reset.'
    ),
    '~/camera_info_synced': (
        'The same once for each image, with its header, for image_proc and other nodes that '
        'synchronise images and camera_info exactly: see [rectified images](#rectified-images).'
    ),
    '~/camera_info_division': (
        'The same camera in its own model: `distortion_model` is `division`, K holds fx, fy and '
        'the centre, D is [k], [k, k2, k3] or [k, k2, k3, k4, p1, p2], the shortest that holds '
        'all. K is 0 if the camera in use has another model.'
    ),
    '~/markers': (
        "The board's outline (amber if the pose is not determined), axes, points coloured by "
        "residual, and the camera's field of view, for RViz and Foxglove."
    ),
    '/tf': (
        'The pose as a transform, if tf2_ros is installed and `publish_tf` is set, under the same '
        'condition as `~/pose`.'
    ),
    '/diagnostics': 'The status of the node, once a second and after each change; see below.',
    '~/set_enabled': 'Whether messages are processed; sets the parameter `enabled`.',
    '~/save_calibration': (
        'Save the calibration to `calibration_file`, in the format of camera_calibration. A file '
        'of another program is kept with `.bak` appended. The response has the path, or the '
        'reason of a failure.'
    ),
    '~/reset_calibration': 'Discard the estimated and the loaded calibration, and restart.',
    'set_camera_info': (
        'Service of the camera driver, named by `set_camera_info_service`. Receives the '
        'calibration once, as soon as the camera is calibrated.'
    ),
}

LIFECYCLE_POSE_NODE = {
    '~/transition_event': 'Each change of state.',
    '~/change_state': 'Make a transition: configure, activate, deactivate, cleanup, shutdown.',
    '~/get_state': 'The current state.',
    '~/get_available_states': 'All states.',
    '~/get_available_transitions': 'The transitions of the current state.',
    '~/get_transition_graph': 'All transitions.',
}

_IMAGE_NODE = {
    'image': (
        'The raw image, if `image.transport` is `raw`: grey of 8 or 16 bits, signed or floating '
        'point too; RGB or BGR of 8 or 16 bits, with or without alpha; Bayer; YUV 4:2:2, '
        'NV12 or NV21. The QoS is that of its publishers: see `image.reliability`.'
    ),
    'image/compressed': (
        'The raw image as JPEG or PNG, if `image.transport` is `compressed`. The QoS is that of '
        'its publishers.'
    ),
    '/diagnostics': (
        'Once a second: the rate of the images, those that are missing in it, the time that one '
        'takes, and rejections.'
    ),
}

DETECTOR_NODE = {
    **_IMAGE_NODE,
    'correspondences': (
        'The points of one board: `u`, `v` (px), `board_x`, `board_y` (m), `id`, and `board` if '
        'the file has several boards. One message for each detected board, with the header of '
        'the image.'
    ),
    '~/image_annotated': (
        'The image with circles around the detected points, or with the reason why there are '
        'none; rejected candidates are outlined, some with their reasons.'
    ),
}

CAMERA_SIMULATOR = {
    'image': 'The image, 8 bits grey.',
    'camera_info': 'An uncalibrated camera: image size, and K = 0.',
    '~/pose_true': 'The true pose of the board in the frame of the image.',
}

DASHBOARD_NODE = {
    **_IMAGE_NODE,
    'image': (
        'The raw image, if `image.transport` is `raw`, in any encoding of detector_node. The QoS '
        'is that of its publishers: see `image.reliability`.'
    ),
    '~/save_calibration': (
        'As the button Save: save the calibration to `calibration_file`, in the format of '
        'camera_calibration. The response has the path, or the reason of a failure.'
    ),
    '~/reset_calibration': 'As the button Reset: drop the calibration, and restart.',
    'set_camera_info': (
        'Service of the camera driver, named by `set_camera_info_service`. Receives each '
        'calibration that is saved.'
    ),
}

# Present if their packages are installed; the tables list them always.
OPTIONAL_OF_POSE_NODE = frozenset(
    {
        Endpoint(
            Role.IN, 'detections', 'apriltag_msgs/AprilTagDetectionArray', 'best effort, depth 5'
        ),
        Endpoint(
            Role.IN,
            'tag_detections',
            'isaac_ros_apriltag_interfaces/AprilTagDetectionArray',
            'best effort, depth 5',
        ),
        Endpoint(Role.OUT, '/tf', 'tf2_msgs/TFMessage', 'reliable, depth 100'),
    }
)
