# Copyright 2026 p4pfr_ros maintainers
# SPDX-License-Identifier: Apache-2.0

"""The camera calibrates itself over the wire: better poses, kept, passed on, started over."""

import signal

from geometry_msgs.msg import PoseWithCovarianceStamped
import moving
import numpy as np
from p4pfr_ros.files.calibration import load_calibration
from p4pfr_ros.ros.conversions import division_camera_from_msg, model_from_msg, pose_from_msg
import pytest
from rclpy.qos import DurabilityPolicy, QoSProfile
from sensor_msgs.msg import CameraInfo, PointCloud2
from sensor_msgs.srv import SetCameraInfo
from std_srvs.srv import SetBool, Trigger
from talk import set_parameters

pytestmark = pytest.mark.dds

LATCHED = QoSProfile(depth=1, durability=DurabilityPolicy.TRANSIENT_LOCAL)


class Robot:
    """A pose_node that calibrates its camera, and what the world hears of it."""

    def __init__(self, peer, folder):
        self.peer, self.file = peer, folder / 'left.yaml'
        self.answers = peer.listen(PoseWithCovarianceStamped, 'pose_node/pose_with_covariance')
        self.cloud = peer.publisher(PointCloud2, 'correspondences')
        self.driver_was_told = []
        peer.node.create_service(SetCameraInfo, 'set_camera_info', self._on_set_camera_info)
        self.start()

    def start(self):
        """Start the node, and wait until it hears us."""
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
        first = moving.moments(0, 1)[0]
        self.answers.clear()
        self.peer.until(lambda: self.answers, meanwhile=lambda: self.cloud.publish(first.cloud))

    def _on_set_camera_info(self, request, response):
        self.driver_was_told.append(request.camera_info)
        response.success, response.status_message = True, 'written to the camera'
        return response

    def show(self, moments):
        """Show moments one by one; return the answers."""
        answers = []
        for moment in moments:
            self.cloud.publish(moment.cloud)
            self.peer.until(lambda m=moment: self.answers[-1].header.stamp.sec == m.index)
            answers.append(self.answers[-1].pose)
        return answers

    def call(self, service_type, name, **request):
        """Ask one of the node's services."""
        return self.peer.call(service_type, f'pose_node/{name}', **request)

    def rms_m(self, moments):
        """Return the error of the positions."""
        poses = [pose_from_msg(answer) for answer in self.show(moments)]
        errors = [m.error_m(pose) for m, pose in zip(moments, poses, strict=True)]
        return float(np.sqrt(np.mean(np.square(errors))))

    def latched(self):
        """Return what who comes late hears on the two topics of the camera."""
        heard = {}
        for topic in ('camera_info', 'camera_info_division'):
            self.peer.node.create_subscription(
                CameraInfo,
                f'pose_node/{topic}',
                lambda msg, topic=topic: heard.update({topic: msg}),
                LATCHED,
            )
        self.peer.until(lambda: len(heard) == 2)
        return heard['camera_info'], heard['camera_info_division']


@pytest.fixture(scope='module')
def robot(module_peer, tmp_path_factory):
    """One node for the whole module."""
    return Robot(module_peer, tmp_path_factory.mktemp('camera_info'))


def test_the_camera_is_found_told_saved_and_known_after_a_crash(robot):
    """The life of a calibration, with nobody doing anything but to show boards."""
    robot.show(moving.moments(1, 200))
    robot.peer.until(lambda: robot.driver_was_told)
    robot.peer.until(lambda: 'took the calibration: written to the camera' in robot.node.output)
    assert len(robot.driver_was_told) == 1

    camera_info, division = robot.latched()
    found = division_camera_from_msg(division)
    assert found.focal_px == pytest.approx(moving.CAMERA.focal_px, rel=0.002)
    np.testing.assert_allclose(found.center_px, moving.CAMERA.center_px, atol=1.5)
    assert camera_info.header == division.header
    assert camera_info.header.frame_id == 'a_camera'
    points = np.random.default_rng(0).uniform((0, 0), moving.SIZE, (50, 2))
    rays = model_from_msg(camera_info).unproject(points)
    np.testing.assert_allclose(found.project(rays), points, atol=0.01)

    evaluated = moving.moments(1000, 1050)
    by_found = robot.rms_m(evaluated)
    saved = robot.call(Trigger, 'save_calibration')
    assert saved.success, saved.message
    robot.node.stop(signal.SIGKILL)
    before = load_calibration(robot.file)
    robot.start()
    assert 'loaded' in robot.node.output
    told = division_camera_from_msg(robot.latched()[1])
    away_px = abs(told.focal_px - before.estimate.camera.focal_px)
    assert away_px < before.estimate.focal_sigma_px
    assert robot.rms_m(evaluated) < 1.2 * by_found

    x, y = moving.CAMERA.center_px
    truth = {'focal_px': moving.CAMERA.focal_px, 'k': moving.CAMERA.k, 'mode': 'fixed'}
    truth = {f'intrinsics.{name}': value for name, value in truth.items()}
    set_parameters(robot.peer, truth | {'image.center_x_px': x, 'image.center_y_px': y})
    assert by_found < 1.5 * robot.rms_m(evaluated)


def test_a_zoom_starts_the_calibration_over(robot):
    """Within ten views; and once more when somebody asks for it."""
    set_parameters(robot.peer, {'intrinsics.mode': 'self_calibrate'})
    robot.call(Trigger, 'reset_calibration')
    robot.show(moving.moments(2000, 2040))
    assert 'the camera has changed' not in robot.node.output
    robot.show(moving.moments(2040, 2050, moving.ZOOMED))
    assert 'the camera has changed' in robot.node.output
    robot.show(moving.moments(2050, 2080, moving.ZOOMED))
    zoomed = division_camera_from_msg(robot.latched()[1])
    assert zoomed.focal_px == pytest.approx(moving.ZOOMED.focal_px, rel=0.01)
    assert robot.call(Trigger, 'reset_calibration').success
    assert [sum(info.k) for info in robot.latched()] == [0.0, 0.0]
    result = set_parameters(
        robot.peer, {'intrinsics.mode': 'fixed', 'intrinsics.focal_px': 0.0}, refused=True
    )
    assert 'intrinsics.focal_px: expected > 0 in the mode fixed' in result
    assert not robot.call(Trigger, 'save_calibration').success


def test_disabled_it_does_not_answer(robot):
    """By the service and by the parameter, which say the same."""
    set_parameters(robot.peer, {'intrinsics.mode': 'self_calibrate'})
    assert robot.call(SetBool, 'set_enabled', data=False).success
    before = len(robot.answers)
    for moment in moving.moments(3000, 3005):
        robot.cloud.publish(moment.cloud)
    robot.peer.quiet(0.3)
    assert len(robot.answers) == before
    set_parameters(robot.peer, {'enabled': True})
    robot.show(moving.moments(3005, 3006))
    assert robot.call(SetBool, 'set_enabled', data=True).message == 'enabled'
