# Copyright 2026 p4pfr_ros maintainers
# SPDX-License-Identifier: Apache-2.0

"""detector_node over DDS: pictures in, the board's points out."""

from array import array

import cv2
import numpy as np
from p4pfr_ros import Pose
from p4pfr_ros.boards import Bundle, Chessboard, PlacedMarker
from p4pfr_ros.rendering import render
from p4pfr_ros.report.drawing import annotate
from p4pfr_ros.ros import detector_node
from p4pfr_ros.ros.conversions import correspondences_from_cloud, image_from_msg, image_msg
import pytest
from rclpy.parameter import Parameter
import scenes
from sensor_msgs.msg import CompressedImage, Image, PointCloud2

pytestmark = pytest.mark.dds

BOARD = Chessboard(columns=9, rows=6, square_m=0.025)
BOARD_YAML = """
boards:
  board: {type: chessboard, columns: 9, rows: 6, square_mm: 25}
"""
PICTURE = render(BOARD, scenes.CAMERA, scenes.CAMERA_FROM_BOARD, scenes.SIZE, noise_sigma=1.0)
# Beside it, two markers on a plane of their own.
BUNDLE = Bundle(
    markers=(
        PlacedMarker(id=8, x_m=-0.04, y_m=0.0, size_m=0.05),
        PlacedMarker(id=3, x_m=0.04, y_m=0.01, size_m=0.05, angle_deg=20.0),
    ),
    dictionary='DICT_4X4_50',
)
BUNDLE_YAML = """
  bundle:
    type: bundle
    dictionary: DICT_4X4_50
    markers:
      - {id: 8, x_mm: -40, y_mm: 0, size_mm: 50}
      - {id: 3, x_mm: 40, y_mm: 10, size_mm: 50, angle_deg: 20}
"""
CAMERA_FROM_BUNDLE = Pose.from_rotation_vector([0.3, 0.2, 0.0], [-0.22, -0.14, 0.6]) @ Pose(
    np.diag([1.0, -1.0, -1.0]), np.zeros(3)
)
BOTH = render(
    BUNDLE, scenes.CAMERA, CAMERA_FROM_BUNDLE, scenes.SIZE, background=PICTURE.astype(float)
)
EMPTY = np.full_like(PICTURE, 90)


class Eye:
    """A conversation with one detector_node."""

    def __init__(self, peer, folder, topic, message_type, boards, **parameters):
        board_file = folder / 'board.yaml'
        board_file.write_text(boards)
        self.peer = peer
        self.points = peer.listen(PointCloud2, 'correspondences')
        self.image = peer.publisher(message_type, topic)
        self.node = peer.start('detector_node', parameters={'board_file': board_file} | parameters)
        peer.until(lambda: self.image.get_subscription_count())

    def show(self, make, second, frame_id='a_camera'):
        """Publish a picture until its points come."""
        return self.show_all(make, second, frame_id, boards=1)[-1]

    def show_all(self, make, second, frame_id='a_camera', *, boards):
        """Publish a picture until the points of so many boards have come."""
        stamp = scenes.header(second).stamp
        msg = make(scenes.header(second, frame_id))
        self.peer.until(
            lambda: [p.header.stamp for p in self.points[-boards:]] == boards * [stamp],
            meanwhile=lambda: self.image.publish(msg),
        )
        return self.points[-boards:]


@pytest.fixture(scope='module')
def eye(module_peer, tmp_path_factory):
    """One detector_node for raw pictures, which knows two boards, for the whole module."""
    folder = tmp_path_factory.mktemp('raw')
    return Eye(module_peer, folder, 'image', Image, boards=BOARD_YAML + BUNDLE_YAML)


def _raw(picture):
    return lambda header: image_msg(header, picture)


def _assert_all_corners(msg, atol_px=0.3):
    points = correspondences_from_cloud(msg)
    order = np.argsort(points.ids)
    np.testing.assert_array_equal(points.ids[order], np.arange(len(BOARD.points)))
    np.testing.assert_array_equal(points.board_points, BOARD.points[points.ids])
    np.testing.assert_allclose(points.image_points, scenes.seen(points.board_points), atol=atol_px)


def test_a_picture_is_answered_with_its_header_and_all_corners(eye):
    """Stamp and frame are the picture's; each corner lies where it was drawn."""
    msg = eye.show(_raw(PICTURE), 21, 'left_optical')
    assert msg.header == scenes.header(21, 'left_optical')
    _assert_all_corners(msg)


def test_each_board_of_a_picture_is_a_message_that_says_which(eye):
    """The bundle alone, then both: in the order of the file, with the header of the picture."""
    alone = render(BUNDLE, scenes.CAMERA, CAMERA_FROM_BUNDLE, scenes.SIZE)
    assert correspondences_from_cloud(eye.show(_raw(alone), 29)).board == 1
    # A message may come twice for one picture, as it is sent until it is heard.
    heard = eye.show_all(_raw(BOTH), 30, 'left_optical', boards=2)
    assert all(msg.header == scenes.header(30, 'left_optical') for msg in heard)
    points = {p.board: p for p in map(correspondences_from_cloud, heard)}
    assert list(points) == [0, 1]
    _assert_all_corners(heard[0])
    np.testing.assert_array_equal(points[1].board_points, BUNDLE.points)
    truth = scenes.seen(BUNDLE.points, CAMERA_FROM_BUNDLE)
    np.testing.assert_allclose(points[1].image_points, truth, atol=0.3)


def test_colour_is_as_good_as_grey(eye):
    """The conversion is tested by itself; this is that it is used."""
    colour = cv2.cvtColor(PICTURE, cv2.COLOR_GRAY2BGR)
    _assert_all_corners(eye.show(_raw(colour), 22))


def test_a_picture_without_the_board_is_counted_and_said(eye):
    """No points, no crash; the reason is in the log; the next picture is answered."""
    before = len(eye.points)
    eye.image.publish(image_msg(scenes.header(23), EMPTY))
    eye.peer.until(
        lambda: '[no_board: ' in eye.node.output,
        meanwhile=lambda: eye.image.publish(image_msg(scenes.header(23), EMPTY)),
    )
    assert '9x6 chessboard found; none of the 2 markers of bundle found' in eye.node.output
    eye.show(_raw(PICTURE), 24)
    assert 23 not in [p.header.stamp.sec for p in eye.points[before:]]


def test_a_picture_that_cannot_be_read_is_counted(eye):
    """An encoding that nobody knows, data that end too early."""
    unknown = image_msg(scenes.header(25), PICTURE)
    unknown.encoding = '64FC7'
    eye.peer.until(
        lambda: "unknown encoding '64FC7'" in eye.node.output,
        meanwhile=lambda: eye.image.publish(unknown),
    )
    short = image_msg(scenes.header(26), PICTURE)
    short.data = short.data[:1000]
    eye.peer.until(
        lambda: '[truncated: ' in eye.node.output, meanwhile=lambda: eye.image.publish(short)
    )
    _assert_all_corners(eye.show(_raw(PICTURE), 27))


def test_the_annotated_picture_comes_when_asked_for(eye):
    """It has the picture's header and size, and shows what was found."""
    annotated = eye.peer.listen(Image, 'detector_node/image_annotated')
    stamp = scenes.header(28).stamp
    msg = image_msg(scenes.header(28), PICTURE)
    eye.peer.until(
        lambda: annotated and annotated[-1].header.stamp == stamp,
        meanwhile=lambda: eye.image.publish(msg),
    )
    assert annotated[-1].header == msg.header
    drawn = image_from_msg(annotated[-1])
    assert drawn.shape == (*PICTURE.shape, 3)
    changed = (drawn != PICTURE[..., None]).any(axis=-1)
    column, row = np.rint(scenes.seen(BOARD.points[:1])[0]).astype(int)
    assert changed[row - 6 : row + 7, column - 6 : column + 7].any()


def test_nothing_is_annotated_for_nobody(peer, tmp_path, monkeypatch):
    """As long as somebody hears the points alone."""
    drawn = []

    def counted(*seen):
        drawn.append(seen)
        return annotate(*seen)

    monkeypatch.setattr(detector_node, 'annotate', counted)
    (tmp_path / 'board.yaml').write_text(BOARD_YAML)
    given = [Parameter('board_file', value=str(tmp_path / 'board.yaml'))]
    node = detector_node.DetectorNode(namespace=peer.namespace, parameter_overrides=given)
    msg = image_msg(scenes.header(40), PICTURE)
    points = peer.listen(PointCloud2, 'correspondences')
    peer.until(lambda: points, meanwhile=lambda: node._on_image(msg))
    assert not drawn
    annotated = peer.listen(Image, 'detector_node/image_annotated')
    peer.until(lambda: annotated, meanwhile=lambda: node._on_image(msg))
    node.destroy_node()
    assert drawn


@pytest.mark.parametrize('extension', ['.png', '.jpg'])
def test_compressed_pictures(peer, tmp_path, extension):
    """By parameter, the node listens to image/compressed instead."""
    transport = {'image.transport': 'compressed'}
    eye = Eye(peer, tmp_path, 'image/compressed', CompressedImage, BOARD_YAML, **transport)
    data = array('B', cv2.imencode(extension, PICTURE)[1].tobytes())

    def make(header):
        return CompressedImage(header=header, format=extension[1:], data=data)

    msg = eye.show(make, 31, 'right_optical')
    assert msg.header == scenes.header(31, 'right_optical')
    assert 'board' not in [field.name for field in msg.fields]  # there is but one
    _assert_all_corners(msg, atol_px=0.5)
