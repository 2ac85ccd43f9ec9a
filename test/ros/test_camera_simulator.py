# Copyright 2026 p4pfr_ros maintainers
# SPDX-License-Identifier: Apache-2.0

"""camera_simulator: its messages belong together."""

from geometry_msgs.msg import PoseStamped
import numpy as np
from p4pfr_ros.rendering import Renderer
from p4pfr_ros.ros.camera_simulator import CameraSimulator
from p4pfr_ros.ros.conversions import image_from_msg
import pytest
from rclpy.parameter import Parameter
from sensor_msgs.msg import CameraInfo, Image

BOARD_YAML = 'boards: {board: {type: chessboard, columns: 9, rows: 6, square_mm: 25}}\n'


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
