# Copyright 2026 p4pfr_ros maintainers
# SPDX-License-Identifier: Apache-2.0

"""A bent board and a lens with all terms over DDS: pose, camera, file and diagnostics."""

from pathlib import Path
import re

from diagnostic_msgs.msg import DiagnosticArray
import moving
import numpy as np
from p4pfr_ros import BoardShape, CameraEstimate, DivisionCamera, estimate_pose
from p4pfr_ros.files.calibration import Calibration, load_calibration, save_calibration
from p4pfr_ros.ros.conversions import cloud_msg, division_camera_from_msg, pose_from_msg
from p4pfr_ros.ros.parameters.pose_options import PoseNodeOptions
from pose_node_client import assert_close, PoseNodeClient
import pytest
import scenes
from std_srvs.srv import Trigger

pytestmark = pytest.mark.dds

BOARD_FILE = Path(__file__).parents[2] / 'config/boards/chessboard_9x6_25mm.yaml'
NAME = 'board'
POINTS = moving.BOARD.points
# Bowed by 1.5 mm over its 200 mm.
SHAPE = BoardShape(
    np.zeros(2), np.array([0.1, 0.0625]), [0, 0, 0.01, 0, 0, 0, 0, 0], 1e-10 * np.eye(8)
)
CAMERA = DivisionCamera(520.0, (328.0, 232.0), -0.25, 0.01, 1e-3, 1e-4, 1.004, 5e-4, -3e-4)
ESTIMATE = CameraEstimate(
    CAMERA,
    np.diag(np.square([0.5, 0.5, 0.5, 1e-3, 1e-3, 1e-4, 1e-4, 1e-4, 1e-4, 1e-4])),
    0.2,
    20,
    seen_radius_px=390.0,
    board_shapes={NAME: SHAPE},
)


def bent_view(index, camera=CAMERA):
    """Return the corners (54, 2) of the bent board in one view of the moving one."""
    [view] = moving.views(index, index + 1)
    in_camera = view.camera_from_board.transform(SHAPE.points(POINTS))
    noise_px = np.random.default_rng(index).normal(0.0, 0.1, (len(POINTS), 2))
    return camera.project(in_camera) + noise_px


class BentBoard:
    """A pose_node with a calibration in which its board is bent."""

    def __init__(self, peer, folder):
        self.file = folder / 'camera.yaml'
        save_calibration(self.file, Calibration.from_estimate(ESTIMATE, moving.SIZE, 'camera'))
        parameters = {
            'board_file': BOARD_FILE,
            'calibration_file': self.file,
            'intrinsics.mode': 'fixed',
            'image.width_px': moving.SIZE[0],
            'image.height_px': moving.SIZE[1],
        }
        self.client = PoseNodeClient(peer, parameters)
        self.diagnostics = peer.subscribe(DiagnosticArray, '/diagnostics')
        self.client.peer.until(lambda: self.client.covariances, meanwhile=lambda: self.publish(0))

    def publish(self, second, image_points=None):
        """Publish the corners of a view."""
        points = bent_view(second) if image_points is None else image_points
        msg = cloud_msg(scenes.header(second), points, POINTS, np.arange(len(POINTS)))
        self.client.cloud.publish(msg)

    def pose(self, second):
        """Return the pose of a view with its covariance."""
        self.publish(second)
        received = self.client.covariances
        self.client.peer.until(lambda: received[-1].header.stamp.sec == second)
        return received[-1].pose

    def status(self, condition):
        """Return the first status of the node that meets a condition, as a message and a dict."""
        name = f'{self.client.peer.namespace[1:]}/pose_node: pose'

        def found():
            for array in reversed(self.diagnostics):
                for status in array.status:
                    values = {pair.key: pair.value for pair in status.values}
                    if status.name == name and condition(values):
                        return status.message, values
            return None

        self.client.peer.until(found)
        return found()


@pytest.fixture(scope='module')
def node(module_peer, tmp_path_factory):
    """One node for the whole module."""
    return BentBoard(module_peer, tmp_path_factory.mktemp('camera_info'))


def test_a_known_camera_gives_the_pose_of_the_bent_board(node):
    """That of estimate_pose with the shape; a flat board has another one."""
    for index in (3, 7):
        published = node.pose(index)
        expected, flat = (
            estimate_pose(
                bent_view(index),
                POINTS,
                image_size=moving.SIZE,
                camera=CAMERA,
                board_shape=shape,
                options=PoseNodeOptions().robust,
            )
            for shape in (SHAPE, None)
        )
        pose = pose_from_msg(published)
        assert_close(pose, expected.model.camera_from_board, 1e-6, 1e-6)
        covariance = published.covariance.reshape(6, 6)
        np.testing.assert_allclose(covariance, expected.covariance[:6, :6], rtol=1e-3, atol=1e-12)
        with pytest.raises(AssertionError):
            assert_close(pose, flat.model.camera_from_board, 1e-5, 1e-5)


def test_all_terms_of_the_camera_are_published(node):
    """In our own model they are exact."""
    node.client.peer.until(lambda: node.client.cameras)
    published = division_camera_from_msg(node.client.cameras[-1])
    assert published.terms == CAMERA.terms
    assert (published.p1, published.p2) == (CAMERA.p1, CAMERA.p2)
    assert published.focal_xy_px == pytest.approx(CAMERA.focal_xy_px, rel=1e-15)
    model = Calibration.from_estimate(ESTIMATE, moving.SIZE, 'camera').model
    _, values = node.status(lambda values: values['camera_info_residual_px'] != 'unknown')
    assert float(values['camera_info_residual_px']) == pytest.approx(model.residual_px, abs=1e-4)
    outside_px = float(values['camera_info_residual_outside_px'])
    assert outside_px == pytest.approx(model.residual_outside_px, abs=1e-4)


def test_the_parameters_give_a_camera_with_all_terms(node):
    """Mode fixed without a file."""
    names = ('focal_px', 'k', 'k2', 'k3', 'k4', 'aspect', 'p1', 'p2')
    for name in names[::-1]:
        node.client.set(f'intrinsics.{name}', 1.02 * getattr(CAMERA, name))
    x, y = CAMERA.center_px
    node.client.set('image.center_x_px', x)
    node.client.set('image.center_y_px', y)
    node.pose(20)
    given = [1.02 * getattr(CAMERA, name) for name in names]
    node.client.peer.until(
        lambda: node.client.cameras[-1].header.stamp.sec == 20, meanwhile=lambda: node.publish(20)
    )
    published = division_camera_from_msg(node.client.cameras[-1])
    assert [getattr(published, name) for name in names] == pytest.approx(given, rel=1e-14)
    node.client.set('intrinsics.focal_px', 0.0)


def test_self_calibration_says_what_is_missing_and_how_the_board_is_bent(node):
    """The shape is saved under the board's name."""
    node.client.set('intrinsics.mode', 'self_calibrate')
    assert node.client.peer.call(Trigger, 'pose_node/reset_calibration').success
    for index in range(100, 104):
        node.pose(index)
    message, values = node.status(lambda values: values['views'] == '4')
    assert '1 more different view' in values['missing']
    # A view that has two poses comes first.
    assert values['missing'] in message or message.startswith('ambiguous')
    assert 'converging' in values['calibration']
    for index in range(104, 140):
        node.pose(index)
    message, values = node.status(lambda values: values['missing'] == 'nothing')
    said_px = float(re.search(r'(\d+\.\d\d) px at most where seen', message).group(1))
    assert said_px == pytest.approx(float(values['projection_sigma_px']), abs=0.006)
    assert values[f'board.{NAME}'].startswith('bowed by 1.')
    assert float(values['calibration_scatter']) >= 1.0
    assert node.client.peer.call(Trigger, 'pose_node/save_calibration').success
    shape = load_calibration(node.file).estimate.board_shape(NAME)
    assert abs(shape.bow - SHAPE.bow) < 4.0 * shape.bow_sigma
    assert 'board board bowed by 1.' in node.client.node.output
