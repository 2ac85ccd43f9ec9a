# Copyright 2026 p4pfr_ros maintainers
# SPDX-License-Identifier: Apache-2.0

"""Thirteen real photographs through detector_node and pose_node."""

import os
from pathlib import Path

import cv2
from geometry_msgs.msg import PoseStamped
import numpy as np
from p4pfr_ros.ros.conversions import image_frame_from_msg, image_msg, pose_from_msg
import pytest
import scenes
from sensor_msgs.msg import CameraInfo, Image

FOLDER = os.environ.get('P4PFR_DATA', '')

pytestmark = [
    pytest.mark.dds,
    pytest.mark.skipif(not FOLDER, reason='P4PFR_DATA does not name the folder of photographs'),
]

BOARD_YAML = 'boards: {board: {type: chessboard, columns: 9, rows: 6, square_mm: 25}}\n'


@pytest.fixture(scope='module')
def photos():
    """Read the photographs, in the order of their names."""
    paths = sorted(Path(FOLDER).glob('left*.jpg'))
    assert len(paths) == 13
    return [cv2.imread(str(path), cv2.IMREAD_GRAYSCALE) for path in paths]


def _distances_by_opencv(photos):
    """Calibrate with OpenCV on all photographs; return the distance of each board's centre."""
    x, y = np.meshgrid(np.arange(9) - 4.0, np.arange(6) - 2.5)
    board = 0.025 * np.stack([x, y, 0.0 * x], axis=-1).reshape(-1, 3).astype(np.float32)
    stop = (cv2.TERM_CRITERIA_EPS + cv2.TERM_CRITERIA_MAX_ITER, 50, 1e-4)
    views = []
    for photo in photos:
        found, corners = cv2.findChessboardCorners(photo, (9, 6))
        assert found
        views.append(cv2.cornerSubPix(photo, corners, (5, 5), (-1, -1), stop))
    size = photos[0].shape[::-1]
    rms, matrix, lens, *_ = cv2.calibrateCamera([board] * len(views), views, size, None, None)
    assert rms < 0.5
    poses = [cv2.solvePnP(board, view, matrix, lens) for view in views]
    return [float(np.linalg.norm(translation)) for _, _, translation in poses]


def test_thirteen_photographs_give_thirteen_poses(peer, tmp_path, photos):
    """With their stamps and frames, and the distances of OpenCV's full calibration."""
    board_file = tmp_path / 'board.yaml'
    board_file.write_text(BOARD_YAML)
    poses = peer.subscribe(PoseStamped, 'pose_node/pose')
    image = peer.publisher(Image, 'image')
    camera_info = peer.publisher(CameraInfo, 'camera_info')
    # No message may be lost, so the subscriptions are made reliable.
    reliable = {
        f'qos_overrides.{peer.namespace}/{topic}.subscription.reliability': 'reliable'
        for topic in ('image', 'correspondences', 'camera_info')
    }
    peer.start('pose_node', parameters={k: v for k, v in reliable.items() if '/image.' not in k})
    detector = {k: v for k, v in reliable.items() if '/image.' in k}
    peer.start('detector_node', parameters=detector | {'board_file': board_file})
    peer.until(lambda: image.get_subscription_count() and camera_info.get_subscription_count())
    info = scenes.camera_info(photos[0].shape[::-1])
    assert image_frame_from_msg(info).size == (640, 480)
    camera_info.publish(info)
    # The first image is published until its pose arrives: all nodes have discovered each other.
    first = image_msg(scenes.header(1, 'warm_up'), photos[0])
    peer.until(lambda: poses, meanwhile=lambda: image.publish(first), every_s=0.5)
    for index, photo in enumerate(photos):
        image.publish(image_msg(scenes.header(100 + index, f'camera_{index}'), photo))
        peer.until(lambda count=index + 1: len(_measured(poses)) >= count)
    peer.spin_for(0.2)
    poses = _measured(poses)
    assert [(p.header.stamp.sec, p.header.frame_id) for p in poses] == [
        (100 + index, f'camera_{index}') for index in range(13)
    ]
    distances = [float(np.linalg.norm(pose_from_msg(p).translation)) for p in poses]
    ratios = np.array(distances) / _distances_by_opencv(photos)
    np.testing.assert_allclose(ratios, 1.0, atol=0.06)


def _measured(poses):
    return [p for p in poses if p.header.frame_id != 'warm_up']
