# Copyright 2026 p4pfr_ros maintainers
# SPDX-License-Identifier: Apache-2.0

"""Self-calibration over DDS: accuracy, saving, the camera driver, restarts."""

import signal

from geometry_msgs.msg import PoseWithCovarianceStamped
import moving
import numpy as np
from p4pfr_ros.files.calibration import load_calibration
from p4pfr_ros.ros.conversions import division_camera_from_msg, model_from_msg, pose_from_msg
from pose_node_client import set_parameters
import pytest
from rclpy.qos import DurabilityPolicy, QoSProfile
from sensor_msgs.msg import CameraInfo, PointCloud2
from sensor_msgs.srv import SetCameraInfo
from std_srvs.srv import SetBool, Trigger

pytestmark = pytest.mark.dds

LATCHED = QoSProfile(depth=1, durability=DurabilityPolicy.TRANSIENT_LOCAL)


class SelfCalibratingNode:
    """A pose_node that calibrates its camera, with a camera driver and a subscriber."""

    def __init__(self, peer, folder):
        self.peer, self.file = peer, folder / 'left.yaml'
        self.poses = peer.subscribe(PoseWithCovarianceStamped, 'pose_node/pose_with_covariance')
        self.cloud = peer.publisher(PointCloud2, 'correspondences')
        self.sent_to_driver = []
        peer.node.create_service(SetCameraInfo, 'set_camera_info', self._on_set_camera_info)
        self.start()

    def start(self):
        """Start the node, and wait until it publishes poses."""
        self.node = self.peer.start(
            'pose_node',
            parameters={
                'image.width_px': moving.SIZE[0],
                'image.height_px': moving.SIZE[1],
                'calibration_file': f'file://{self.file}',
                'camera_name': 'left',
                'set_camera_info_service': 'set_camera_info',
            },
        )
        first = moving.views(0, 1)[0]
        self.poses.clear()
        self.peer.until(lambda: self.poses, meanwhile=lambda: self.cloud.publish(first.cloud))

    def _on_set_camera_info(self, request, response):
        self.sent_to_driver.append(request.camera_info)
        response.success, response.status_message = True, 'written\x1b to the camera'
        return response

    def process(self, views):
        """Publish views one by one; return the poses with covariance."""
        poses = []
        for view in views:
            self.cloud.publish(view.cloud)
            self.peer.until(lambda v=view: self.poses[-1].header.stamp.sec == v.index)
            poses.append(self.poses[-1].pose)
        return poses

    def call(self, service_type, name, **request):
        """Call a service of the node."""
        return self.peer.call(service_type, f'pose_node/{name}', **request)

    def rms_m(self, views):
        """Return the RMS error of the positions."""
        poses = [pose_from_msg(pose) for pose in self.process(views)]
        errors = [view.error_m(pose) for view, pose in zip(views, poses, strict=True)]
        return float(np.sqrt(np.mean(np.square(errors))))

    def latched(self):
        """Return the latched messages of the two topics of the camera."""
        received = {}
        for topic in ('camera_info', 'camera_info_division'):
            self.peer.node.create_subscription(
                CameraInfo,
                f'pose_node/{topic}',
                lambda msg, topic=topic: received.update({topic: msg}),
                LATCHED,
            )
        self.peer.until(lambda: len(received) == 2)
        return received['camera_info'], received['camera_info_division']


@pytest.fixture(scope='module')
def robot(module_peer, tmp_path_factory):
    """One node for the whole module."""
    return SelfCalibratingNode(module_peer, tmp_path_factory.mktemp('camera_info'))


def test_the_camera_is_calibrated_published_saved_and_loaded(robot):
    """It is sent to the driver once, and used after a crash."""
    robot.process(moving.views(1, 200))
    robot.peer.until(lambda: robot.sent_to_driver)
    robot.peer.until(
        lambda: 'accepted the calibration: written\\x1b to the camera' in robot.node.output
    )
    assert len(robot.sent_to_driver) == 1

    camera_info, division = robot.latched()
    estimated = division_camera_from_msg(division)
    assert estimated.focal_px == pytest.approx(moving.CAMERA.focal_px, rel=0.002)
    np.testing.assert_allclose(estimated.center_px, moving.CAMERA.center_px, atol=1.5)
    assert camera_info.header == division.header
    assert camera_info.header.frame_id == 'a_camera'
    points = np.random.default_rng(0).uniform((0, 0), moving.SIZE, (50, 2))
    rays = model_from_msg(camera_info).unproject(points)
    np.testing.assert_allclose(estimated.project(rays), points, atol=0.01)

    evaluated = moving.views(1000, 1050)
    with_estimate = robot.rms_m(evaluated)
    saved = robot.call(Trigger, 'save_calibration')
    assert saved.success, saved.message
    robot.node.stop(signal.SIGKILL)
    before = load_calibration(robot.file)
    robot.start()
    assert 'loaded' in robot.node.output
    loaded = division_camera_from_msg(robot.latched()[1])
    change_px = abs(loaded.focal_px - before.estimate.camera.focal_px)
    assert change_px < before.estimate.focal_sigma_px
    assert robot.rms_m(evaluated) < 1.2 * with_estimate

    x, y = moving.CAMERA.center_px
    truth = {'focal_px': moving.CAMERA.focal_px, 'k': moving.CAMERA.k, 'mode': 'fixed'}
    truth = {f'intrinsics.{name}': value for name, value in truth.items()}
    set_parameters(robot.peer, truth | {'image.center_x_px': x, 'image.center_y_px': y})
    assert with_estimate < 1.5 * robot.rms_m(evaluated)


def test_a_zoom_restarts_the_calibration(robot):
    """Within ten views; a reset discards it."""
    set_parameters(robot.peer, {'intrinsics.mode': 'self_calibrate'})
    robot.call(Trigger, 'reset_calibration')
    robot.process(moving.views(2000, 2040))
    assert 'the camera has changed' not in robot.node.output
    for view in moving.views(2040, 2050, moving.ZOOMED):  # there may be no pose of them
        robot.cloud.publish(view.cloud)
        robot.peer.spin_for(0.05)
    robot.peer.until(lambda: 'the camera has changed' in robot.node.output)
    robot.process(moving.views(2050, 2080, moving.ZOOMED))
    zoomed = division_camera_from_msg(robot.latched()[1])
    assert zoomed.focal_px == pytest.approx(moving.ZOOMED.focal_px, rel=0.01)
    assert robot.call(Trigger, 'reset_calibration').success
    assert [sum(info.k) for info in robot.latched()] == [0.0, 0.0]
    result = set_parameters(
        robot.peer, {'intrinsics.mode': 'fixed', 'intrinsics.focal_px': 0.0}, rejected=True
    )
    assert 'intrinsics.focal_px: expected > 0 in mode fixed' in result
    assert not robot.call(Trigger, 'save_calibration').success


def test_a_disabled_node_publishes_no_pose(robot):
    """By the service or the parameter, which agree."""
    set_parameters(robot.peer, {'intrinsics.mode': 'self_calibrate'})
    assert robot.call(SetBool, 'set_enabled', data=False).success
    before = len(robot.poses)
    for view in moving.views(3000, 3005):
        robot.cloud.publish(view.cloud)
    robot.peer.spin_for(0.3)
    assert len(robot.poses) == before
    set_parameters(robot.peer, {'enabled': True})
    robot.process(moving.views(3005, 3006))
    assert robot.call(SetBool, 'set_enabled', data=True).message == 'enabled'


def test_the_last_views_are_saved_at_shutdown(robot):
    """With save_when_calibrated; the log says so."""
    set_parameters(robot.peer, {'save_when_calibrated': True})
    robot.call(Trigger, 'reset_calibration')
    robot.process(moving.views(4000, 4040))
    robot.peer.until(lambda: robot.node.output.count('saved to ') > 0)
    robot.process(moving.views(4040, 4045))
    before, lines = load_calibration(robot.file).estimate, robot.node.output.count('saved to ')
    assert robot.node.stop(signal.SIGTERM) == 0
    assert robot.node.output.count('saved to ') == lines + 1
    assert load_calibration(robot.file).estimate.views > before.views
