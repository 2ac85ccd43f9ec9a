# Copyright 2026 p4pfr_ros maintainers
# SPDX-License-Identifier: Apache-2.0

"""
What the topics and services of our nodes are for, in the order in which a reader wants them.

Their names, types and QoS come from the nodes; ``interface`` holds both against each other.
"""

from __future__ import annotations

from .interfaces import Endpoint, Role

POSE_NODE = {
    'correspondences': (
        'The points of a board, one per row: fields `u`, `v` (px of the raw picture), `board_x`, '
        '`board_y` (m), all float32 or float64. The optional field `id` is the number of the '
        'point, and `board`, needed where the file has several boards, the place of the board '
        'there; both are integers. Wrong points among them are found out.'
    ),
    'corners': (
        'The four corners of one marker, x and y in px of the raw picture. What the message does '
        'not say comes from the parameters `marker.*`.'
    ),
    'detections': (
        'The tags that apriltag_ros has seen, sorted by the boards of `board_file`. The topic is '
        'there where apriltag_msgs is installed and `board_file` is set.'
    ),
    'camera_info': (
        'The size of the full raw picture, and its binning and region of interest. K may be 0: '
        'the intrinsics are read in the mode `camera_info` alone.'
    ),
    '~/pose': (
        'The pose of the board in the frame of the picture, in metres. It stays silent where the '
        'view does not tell direction and distance.'
    ),
    '~/pose_with_covariance': (
        'The same pose with its covariance, for every answer: where a view tells little, the '
        'covariance is large.'
    ),
    '~/alternatives': (
        'The other poses that explain the view as well; empty where there are none.'
    ),
    '~/camera_info': (
        'The camera that is in use, in a model that image_proc knows: `rational_polynomial`, or '
        '`equidistant` for wide lenses. It comes whenever the camera has become another or a '
        'better one, and is kept for whoever subscribes later; K is 0 once it is forgotten.'
    ),
    '~/camera_info_division': (
        'The same camera as it is: `distortion_model` is `division`, D is [k] or [k, k2, k3]. K '
        'is 0 where the camera in use is of another model.'
    ),
    '~/markers': (
        "The board's outline (amber where the pose is not sure), its axes, its points coloured by "
        "residual, and the camera's field of view, for RViz and Foxglove."
    ),
    '/tf': (
        'The pose as a transform, where tf2_ros is installed and `publish_tf` is set; silent when '
        '`~/pose` is.'
    ),
    '/diagnostics': 'How the node is and why, once a second and when that changes; see below.',
    '~/set_enabled': 'Whether messages are answered; the parameter `enabled` follows.',
    '~/save_calibration': (
        'Write the calibration to `calibration_file`, in the format of camera_calibration. The '
        'answer says where it went, or why it did not.'
    ),
    '~/reset_calibration': 'Forget what was found and what was loaded, and start over.',
    'set_camera_info': (
        "The camera driver's, under the name in `set_camera_info_service`: it is told of the "
        'calibration once, as soon as that is good.'
    ),
}

LIFECYCLE_POSE_NODE = {
    '~/transition_event': 'Each change of state.',
    '~/change_state': 'Make a transition: configure, activate, deactivate, clean up, shut down.',
    '~/get_state': 'The state that the node is in.',
    '~/get_available_states': 'All states that there are.',
    '~/get_available_transitions': 'The transitions that can be made now.',
    '~/get_transition_graph': 'All transitions that there are.',
}

DETECTOR_NODE = {
    'image': (
        'The raw picture, with `image.transport` at `raw`: 8 or 16 bits, grey, RGB, BGR, with or '
        'without alpha, Bayer or YUV 4:2:2.'
    ),
    'image/compressed': 'The raw picture as JPEG or PNG, with `image.transport` at `compressed`.',
    'correspondences': (
        "A board's points: `u`, `v` (px), `board_x`, `board_y` (m), `id`, and `board` where the "
        'file has several. One message for each board that is found, with the header of the '
        'picture.'
    ),
    '~/image_annotated': (
        'The picture with circles around the points that were found, or with the reason why there '
        'are none.'
    ),
}

CAMERA_SIMULATOR = {
    'image': 'The picture, 8 bits of grey.',
    'camera_info': "An uncalibrated camera's: the size of the picture, and K = 0.",
    '~/pose_true': 'Where the board really is, in the frame of the picture.',
}

# There where apriltag_msgs and tf2_ros are installed, which these tables must not depend on.
OPTIONAL_OF_POSE_NODE = frozenset(
    {
        Endpoint(
            Role.IN, 'detections', 'apriltag_msgs/AprilTagDetectionArray', 'best effort, depth 5'
        ),
        Endpoint(Role.OUT, '/tf', 'tf2_msgs/TFMessage', 'reliable, depth 100'),
    }
)
