# Copyright 2026 p4pfr_ros maintainers
# SPDX-License-Identifier: Apache-2.0

"""camera_simulator: its path keeps the board in sight, and its messages belong together."""

import itertools

from geometry_msgs.msg import PoseStamped
import numpy as np
from p4pfr_ros import DivisionCamera
from p4pfr_ros.boards import Chessboard, Marker
from p4pfr_ros.rendering import Renderer
from p4pfr_ros.ros.camera_simulator import CameraSimulator
from p4pfr_ros.ros.conversions import image_from_msg
from p4pfr_ros.ros.demo.views import tilt_deg
from p4pfr_ros.scenes.board_path import FILL, SimulatedPath, TILT_DEG
import pytest
from rclpy.parameter import Parameter
from sensor_msgs.msg import CameraInfo, Image

BOARD = Chessboard(columns=9, rows=6, square_m=0.025)
BOARD_YAML = 'boards: {board: {type: chessboard, columns: 9, rows: 6, square_mm: 25}}\n'
TAG = Marker(id=3, size_m=0.1, dictionary='DICT_4X4_50')
CAMERAS = [
    (DivisionCamera(520.0, (319.5, 239.5), -0.25), (640, 480)),
    (DivisionCamera(300.0, (319.5, 239.5), -0.3), (640, 480)),
    (DivisionCamera(2000.0, (639.5, 359.5), 0.1), (1280, 720)),
    (DivisionCamera(520.0, (319.5, 239.5), 0.1), (640, 480)),
]


@pytest.mark.parametrize('board', [BOARD, TAG], ids=['board', 'tag'])
@pytest.mark.parametrize(('camera', 'size'), CAMERAS, ids=['normal', 'wide', 'tele', 'pincushion'])
def test_the_board_is_always_whole_tilted_and_of_a_good_size(camera, size, board):
    """At any time, on any path, through any camera."""
    width_m, height_m = board.sheet_size_m
    corners = 0.5 * np.array([[-1, -1, 0], [1, -1, 0], [1, 1, 0], [-1, 1, 0]], dtype=float)
    share = np.linspace(0.0, 1.0, 20)[:, None, None]
    edges = (share * corners + (1.0 - share) * np.roll(corners, 1, axis=0)).reshape(-1, 3)
    sheet = edges * [width_m, height_m, 1.0]
    tilts = []
    for seed in range(3):
        path = SimulatedPath(board, size, seed)
        for time_s in np.arange(0.0, 60.0, 0.7):
            pose = path.at(time_s, camera)
            pixels = camera.project(pose.transform(sheet))
            assert (pixels >= 0.0).all()
            assert (pixels <= np.array(size) - 1.0).all()
            fill = (np.ptp(pixels, axis=0) / size).max()
            assert FILL[0] - 0.02 <= fill <= FILL[1] + 0.02
            tilts.append(tilt_deg(pose))
            # The camera looks at the printed side.
            assert pose.rotation[:, 2] @ pose.translation < 0.0
    assert TILT_DEG[0] <= min(tilts) < max(tilts) <= TILT_DEG[1]
    assert max(tilts) - min(tilts) > 25.0


def test_the_path_is_smooth_and_its_own():
    """A thirtieth of a second is a small step; another seed is another path."""
    camera, size = CAMERAS[0]
    path = SimulatedPath(BOARD, size, 0)
    poses = [path.at(time_s, camera) for time_s in np.arange(0.0, 20.0, 1 / 30)]
    steps = [np.linalg.norm(b.translation - a.translation) for a, b in itertools.pairwise(poses)]
    assert 0.0 < max(steps) < 0.02
    np.testing.assert_array_equal(
        SimulatedPath(BOARD, size, 0).at(3.0, camera).translation, path.at(3.0, camera).translation
    )
    other = SimulatedPath(BOARD, size, 1).at(3.0, camera)
    assert np.linalg.norm(other.translation - path.at(3.0, camera).translation) > 0.01


@pytest.fixture
def board_file(tmp_path):
    """Write a board file."""
    path = tmp_path / 'board.yaml'
    path.write_text(BOARD_YAML)
    return path


def test_nothing_is_drawn_for_nobody(peer, board_file, monkeypatch):
    """The board moves on, and its true pose comes all the same."""
    drawn, render = [], Renderer.render

    def counted(*args, **kwargs):
        drawn.append(args)
        return render(*args, **kwargs)

    monkeypatch.setattr(Renderer, 'render', counted)
    given = {'board_file': str(board_file), 'rate_hz': 0.01}
    overrides = [Parameter(name, value=value) for name, value in given.items()]
    node = CameraSimulator(namespace=peer.namespace, parameter_overrides=overrides)
    truths = peer.listen(PoseStamped, 'camera_simulator/pose_true')
    peer.until(lambda: truths, meanwhile=node._take_picture)
    assert not drawn
    images = peer.listen(Image, 'image')
    peer.until(lambda: images, meanwhile=node._take_picture)
    node.destroy_node()
    assert drawn
    assert images[0].header.stamp in [truth.header.stamp for truth in truths]
    assert len({truth.pose.position.x for truth in truths}) == len(truths)


@pytest.mark.dds
def test_picture_camera_info_and_truth_belong_together(peer, board_file):
    """One stamp, one frame; K is 0, as of a camera that nobody has calibrated."""
    images = peer.listen(Image, 'image')
    infos = peer.listen(CameraInfo, 'camera_info')
    truths = peer.listen(PoseStamped, 'camera_simulator/pose_true')
    peer.start(
        'camera_simulator',
        parameters={
            'board_file': board_file,
            'rate_hz': 20.0,
            'camera.width_px': 320,
            'camera.height_px': 240,
            'camera.focal_px': 260.0,
            'camera.frame_id': 'simulated_optical',
        },
    )
    peer.until(lambda: min(len(images), len(infos), len(truths)) >= 10)
    stamps = [{_nanoseconds(m) for m in heard[-8:]} for heard in (images, infos, truths)]
    assert len(stamps[0] & stamps[1] & stamps[2]) >= 6
    assert {m.header.frame_id for m in images + infos + truths} == {'simulated_optical'}
    assert images[-1].encoding == 'mono8'
    assert image_from_msg(images[-1]).shape == (240, 320)
    assert (infos[-1].width, infos[-1].height) == (320, 240)
    np.testing.assert_array_equal(infos[-1].k, 0.0)
    assert len({m.pose.position.x for m in truths}) == len(truths)


def _nanoseconds(msg):
    stamp = msg.header.stamp
    return 1_000_000_000 * stamp.sec + stamp.nanosec
