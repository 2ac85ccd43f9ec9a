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


def test_without_a_subscriber_no_image_is_rendered(peer, board_file, monkeypatch):
    """The board moves, and its true pose is published."""
    rendered, render = [], Renderer.render

    def counted(*args, **kwargs):
        rendered.append(args)
        return render(*args, **kwargs)

    monkeypatch.setattr(Renderer, 'render', counted)
    given = {'board_file': str(board_file), 'rate_hz': 0.01}
    overrides = [Parameter(name, value=value) for name, value in given.items()]
    node = CameraSimulator(namespace=peer.namespace, parameter_overrides=overrides)
    truths = peer.subscribe(PoseStamped, 'camera_simulator/pose_true')
    peer.until(lambda: truths, meanwhile=node._publish_image)
    assert not rendered
    images = peer.subscribe(Image, 'image')
    peer.until(lambda: images, meanwhile=node._publish_image)
    node.destroy_node()
    assert rendered
    assert images[0].header.stamp in [truth.header.stamp for truth in truths]
    assert len({truth.pose.position.x for truth in truths}) == len(truths)


@pytest.mark.dds
def test_image_camera_info_and_true_pose_share_a_header(peer, board_file):
    """K is 0, as for an uncalibrated camera."""
    images = peer.subscribe(Image, 'image')
    infos = peer.subscribe(CameraInfo, 'camera_info')
    truths = peer.subscribe(PoseStamped, 'camera_simulator/pose_true')
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
    stamps = [{_nanoseconds(m) for m in received[-8:]} for received in (images, infos, truths)]
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
