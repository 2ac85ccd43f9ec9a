# Copyright 2026 p4pfr_ros maintainers
# SPDX-License-Identifier: Apache-2.0

"""Views held against a given camera, without a node and in a node in this process."""

import time

from in_process import publish
import moving
import numpy as np
from p4pfr_ros import CameraInfoModel, DivisionCamera, estimate_pose, Status
from p4pfr_ros.ros.pose.camera_check import CameraCheck
from p4pfr_ros.ros.pose.health import Level
from p4pfr_ros.ros.pose.outputs import Outputs
from p4pfr_ros.ros.pose_node import PoseNode
import pytest
from rclpy.parameter import Parameter
import scenes
from sensor_msgs.msg import CameraInfo

SIZE = moving.SIZE
MIDDLE = (319.5, 239.5)
TRUE = DivisionCamera(520.0, MIDDLE)
MARKER = moving.BOARD.points[[0, 8, 53, 45]]
SENTENCE = 'the calibration does not fit this image'


def scaled(focal, center):
    """Return a camera with a multiple of the true focal length and principal point."""
    return DivisionCamera(520.0 * focal, (MIDDLE[0] * center, MIDDLE[1] * center))


HALF, QUARTER = scaled(0.5, 0.5), scaled(0.25, 0.25)


class Views:
    """Views of a board, judged one after another."""

    def __init__(self, camera, board=moving.BOARD.points, chosen=slice(None)):
        self.check, self.camera = CameraCheck(), camera
        self._board, self._chosen = board[chosen], chosen

    def judge(self, image_points, camera=None):
        """Return the estimate of a view after the check."""
        camera, image = camera or self.camera, image_points[self._chosen]
        estimate = estimate_pose(image, self._board, image_size=SIZE, camera=camera)
        return self.check.judged(camera, SIZE, '~', image, estimate)

    def judge_all(self, views):
        """Return the estimates of many views."""
        return [self.judge(view.image_points) for view in views]


def test_a_right_camera_is_never_doubted():
    views = Views(TRUE)
    estimates = views.judge_all(moving.views(0, 300, TRUE))
    assert all(estimate.model is not None for estimate in estimates)
    assert views.check.reason == ''


@pytest.mark.parametrize('focal', [0.25, 0.5, 2.0, 4.0])
def test_three_tilted_boards_decide_that_a_focal_length_does_not_fit(focal):
    tilted = [v for v in moving.views(0, 60, TRUE) if 25.0 < v.camera_from_board.tilt_deg < 60.0]
    views = Views(scaled(focal, 1.0))
    views.judge_all(tilted[:3])
    assert views.check.reason.startswith(SENTENCE)
    for view in moving.views(60, 160, TRUE):
        assert views.judge(view.image_points).status is Status.MISFIT


def test_views_of_a_single_marker_add_up():
    """Each alone has too few points to tell a wrong camera from a wrong corner."""
    corners = [0, 8, 53, 45]
    views, decided = Views(scaled(0.5, 1.0), chosen=corners), []
    for view in moving.views(0, 100, TRUE):
        estimate = views.judge(view.image_points)
        decided.append(bool(views.check.reason))
        assert decided[-1] == (estimate.status is Status.MISFIT) or estimate.model is None
    assert 3 < decided.index(True) < 40
    assert all(decided[decided.index(True) :])
    right = Views(TRUE, chosen=corners)
    assert all(e.model is not None for e in right.judge_all(moving.views(0, 300, TRUE)))


def test_a_board_that_does_not_move_is_one_view():
    """Errors of its corners that last do not add up."""
    views = Views(scaled(0.5, 1.0), chosen=[0, 8, 53, 45])
    view = max(
        moving.views(0, 40, TRUE),
        key=lambda v: (
            Views(scaled(0.5, 1.0), chosen=[0, 8, 53, 45])
            .judge(v.image_points)
            .camera_fit.evidence
        ),
    )
    rng = np.random.default_rng(0)
    for _ in range(50):
        image = view.image_points + rng.normal(0.0, 0.1, view.image_points.shape)
        assert views.judge(image).camera_fit.evidence > 4.0
    assert views.check.reason == ''


@pytest.mark.parametrize('camera', [HALF, QUARTER], ids=['half', 'quarter'])
def test_a_principal_point_near_the_edge_withholds_poses_at_once(camera):
    """The principal point of a binned image's calibration: (160, 120) of 640x480 px."""
    views = Views(camera)
    first = views.judge(moving.views(0, 1, TRUE)[0].image_points)
    assert first.status is Status.MISFIT
    x, y = camera.center_px
    assert views.check.reason == (
        f'principal point ({x:.0f}, {y:.0f}) of an image of 640x480 px: {SENTENCE}'
    )
    for view in moving.views(1, 200, TRUE):
        assert views.judge(view.image_points).model is None


def test_views_prove_a_principal_point_near_the_edge():
    """As of a cropped image whose camera_info does not have its region of interest."""
    cropped = DivisionCamera(520.0, (150.0, 239.5))
    views = Views(cropped)
    published = [
        estimate.model is not None for estimate in views.judge_all(moving.views(0, 60, cropped))
    ]
    first = published.index(True)
    assert 2 <= first < 30
    assert all(published[first:])
    assert views.check.reason == ''


def test_another_camera_starts_anew():
    """A corrected camera_info is used at once."""
    views = Views(HALF)
    [view] = moving.views(0, 1, TRUE)
    assert views.judge(view.image_points).model is None
    assert views.judge(view.image_points, TRUE).model is not None
    assert views.check.reason == ''
    model = CameraInfoModel('plumb_bob', (0.0,) * 5, (520.0, 520.0), MIDDLE, 0.0, SIZE)
    assert views.judge(view.image_points, model).model is not None
    assert views.judge(view.image_points, HALF).model is None


@pytest.fixture
def make(dds, monkeypatch):
    """Make a node whose poses have a subscriber, and the estimates that it publishes."""
    nodes, published = [], []
    monkeypatch.setattr(Outputs, 'is_awaited', lambda *_: True)
    publish_pose = Outputs.publish_pose

    def recorded(self, observation, estimate, options):
        published.append(estimate)
        publish_pose(self, observation, estimate, options)

    monkeypatch.setattr(Outputs, 'publish_pose', recorded)

    def make(**parameters):
        overrides = [
            Parameter(name.replace('__', '.'), value=value) for name, value in parameters.items()
        ]
        nodes.append(PoseNode(parameter_overrides=overrides))
        return nodes[-1], published

    yield make
    for node in nodes:
        node.destroy_node()


def camera_info(camera):
    """Make the camera_info of a calibrated camera."""
    (x, y), f = camera.center_px, camera.focal_px
    return CameraInfo(
        header=scenes.header(0),
        width=SIZE[0],
        height=SIZE[1],
        distortion_model='plumb_bob',
        d=[0.0] * 5,
        k=[f, 0.0, x, 0.0, f, y, 0.0, 0.0, 1.0],
    )


def status(node):
    """Return the status that the node publishes on /diagnostics."""
    return node._pipeline._reporter._health.status(time.monotonic())


@pytest.mark.parametrize('camera', [HALF, QUARTER, scaled(0.5, 1.0)], ids=['1/2', '1/4', 'f/2'])
def test_a_camera_info_of_another_binning_gives_no_pose_and_an_error(make, camera):
    node, published = make(intrinsics__mode='camera_info')
    publish(node, 'camera_info', camera_info(camera))
    tilted = [v for v in moving.views(0, 60, TRUE) if 25.0 < v.camera_from_board.tilt_deg < 60.0]
    for view in tilted[:10]:
        publish(node, 'correspondences', view.cloud)
    assert len(published) == 10
    assert all(estimate.model is None for estimate in published[2:])
    if camera.center_px != MIDDLE:
        assert all(estimate.model is None for estimate in published)
    health = status(node)
    assert health.level is Level.ERROR
    assert SENTENCE in health.message
    assert int(health.values['rejected.misfit']) >= 8
    # The right one is used at once.
    published.clear()
    publish(node, 'camera_info', camera_info(TRUE))
    publish(node, 'correspondences', tilted[10].cloud)
    assert tilted[10].error_m(published[0].model.camera_from_board) < 0.005


def test_a_fixed_camera_that_does_not_fit_gives_no_pose_and_an_error(make):
    node, published = make(
        intrinsics__mode='fixed',
        intrinsics__focal_px=260.0,
        image__width_px=640,
        image__height_px=480,
    )
    for view in moving.views(0, 40, TRUE):
        publish(node, 'correspondences', view.cloud)
    assert all(estimate.model is None for estimate in published[-20:])
    assert status(node).level is Level.ERROR
    assert SENTENCE in status(node).message
