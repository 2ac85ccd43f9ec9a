# Copyright 2026 p4pfr_ros maintainers
# SPDX-License-Identifier: Apache-2.0

"""detector_node over DDS: images in, points of boards out."""

from array import array
import itertools

import cv2
from diagnostic_msgs.msg import DiagnosticArray
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
IMAGE = render(BOARD, scenes.CAMERA, scenes.CAMERA_FROM_BOARD, scenes.SIZE, noise_sigma=1.0)
# Two markers beside the chessboard, on another plane.
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
    BUNDLE, scenes.CAMERA, CAMERA_FROM_BUNDLE, scenes.SIZE, background=IMAGE.astype(float)
)
EMPTY = np.full_like(IMAGE, 90)


class DetectorClient:
    """A client of one detector_node."""

    def __init__(self, peer, folder, topic, message_type, boards, **parameters):
        board_file = folder / 'board.yaml'
        board_file.write_text(boards)
        self.peer = peer
        self.points = peer.subscribe(PointCloud2, 'correspondences')
        self.image = peer.publisher(message_type, topic)
        self.node = peer.start('detector_node', parameters={'board_file': board_file} | parameters)
        peer.until(lambda: self.image.get_subscription_count())

    def detect(self, make, second, frame_id='a_camera'):
        """Publish an image until its points arrive."""
        return self.detect_all(make, second, frame_id, boards=1)[-1]

    def detect_all(self, make, second, frame_id='a_camera', *, boards):
        """Publish an image until the points of this many boards have arrived."""
        stamp = scenes.header(second).stamp
        msg = make(scenes.header(second, frame_id))
        self.peer.until(
            lambda: [p.header.stamp for p in self.points[-boards:]] == boards * [stamp],
            meanwhile=lambda: self.image.publish(msg),
        )
        return self.points[-boards:]


@pytest.fixture(scope='module')
def client(module_peer, tmp_path_factory):
    """One detector_node with two boards for the whole module."""
    folder = tmp_path_factory.mktemp('raw')
    return DetectorClient(module_peer, folder, 'image', Image, boards=BOARD_YAML + BUNDLE_YAML)


def _raw(image):
    return lambda header: image_msg(header, image)


def _assert_all_corners(msg, atol_px=0.3):
    points = correspondences_from_cloud(msg)
    order = np.argsort(points.ids)
    np.testing.assert_array_equal(points.ids[order], np.arange(len(BOARD.points)))
    np.testing.assert_array_equal(points.board_points, BOARD.points[points.ids])
    np.testing.assert_allclose(
        points.image_points, scenes.project(points.board_points), atol=atol_px
    )


def test_all_corners_are_published_with_the_header_of_the_image(client):
    """Each corner is close to its true pixel."""
    msg = client.detect(_raw(IMAGE), 21, 'left_optical')
    assert msg.header == scenes.header(21, 'left_optical')
    _assert_all_corners(msg)


def test_each_board_of_an_image_is_a_message_with_its_index(client):
    """The bundle alone, then both boards in the order of the file."""
    alone = render(BUNDLE, scenes.CAMERA, CAMERA_FROM_BUNDLE, scenes.SIZE)
    assert correspondences_from_cloud(client.detect(_raw(alone), 29)).board == 1
    # An image is published until its points arrive, so messages may arrive twice.
    received = client.detect_all(_raw(BOTH), 30, 'left_optical', boards=2)
    assert all(msg.header == scenes.header(30, 'left_optical') for msg in received)
    points = {p.board: p for p in map(correspondences_from_cloud, received)}
    assert list(points) == [0, 1]
    _assert_all_corners(received[0])
    np.testing.assert_array_equal(points[1].board_points, BUNDLE.points)
    truth = scenes.project(BUNDLE.points, CAMERA_FROM_BUNDLE)
    np.testing.assert_allclose(points[1].image_points, truth, atol=0.3)


def test_a_board_that_jumps_is_found_in_the_next_image(client):
    """It is searched near its last place first."""
    for second, x in ((25, -0.25), (26, 0.25)):
        pose = Pose(scenes.CAMERA_FROM_BOARD.rotation, np.array([x, 0.1 * np.sign(x), 1.0]))
        image = render(BOARD, scenes.CAMERA, pose, scenes.SIZE, noise_sigma=1.0)
        points = correspondences_from_cloud(client.detect(_raw(image), second))
        assert len(points.ids) == len(BOARD.points)
        truth = scenes.project(points.board_points, pose)
        np.testing.assert_allclose(points.image_points, truth, atol=0.3)


def test_colour_images_are_detected_as_well(client):
    """The conversion itself has its own tests."""
    colour = cv2.cvtColor(IMAGE, cv2.COLOR_GRAY2BGR)
    _assert_all_corners(client.detect(_raw(colour), 22))


def test_an_image_without_a_board_is_counted_and_logged(client):
    """No points are published; the next image is detected."""
    before = len(client.points)
    client.image.publish(image_msg(scenes.header(23), EMPTY))
    client.peer.until(
        lambda: '[no_board: ' in client.node.output,
        meanwhile=lambda: client.image.publish(image_msg(scenes.header(23), EMPTY)),
    )
    assert '9x6 chessboard found; none of the 2 markers of bundle found' in client.node.output
    client.detect(_raw(IMAGE), 24)
    assert 23 not in [p.header.stamp.sec for p in client.points[before:]]


def test_an_invalid_image_is_counted(client):
    """An unknown encoding, truncated data."""
    unknown = image_msg(scenes.header(25), IMAGE)
    unknown.encoding = '64FC7'
    client.peer.until(
        lambda: "unknown encoding '64FC7'" in client.node.output,
        meanwhile=lambda: client.image.publish(unknown),
    )
    short = image_msg(scenes.header(26), IMAGE)
    short.data = short.data[:1000]
    client.peer.until(
        lambda: '[truncated: ' in client.node.output, meanwhile=lambda: client.image.publish(short)
    )
    _assert_all_corners(client.detect(_raw(IMAGE), 27))


def test_the_annotated_image_is_published_to_subscribers(client):
    """With the header and size of the image, and circles around the corners."""
    annotated = client.peer.subscribe(Image, 'detector_node/image_annotated')
    stamp = scenes.header(28).stamp
    msg = image_msg(scenes.header(28), IMAGE)
    client.peer.until(
        lambda: annotated and annotated[-1].header.stamp == stamp,
        meanwhile=lambda: client.image.publish(msg),
    )
    assert annotated[-1].header == msg.header
    drawn = image_from_msg(annotated[-1])
    assert drawn.shape == (*IMAGE.shape, 3)
    changed = (drawn != IMAGE[..., None]).any(axis=-1)
    column, row = np.rint(scenes.project(BOARD.points[:1])[0]).astype(int)
    assert changed[row - 6 : row + 7, column - 6 : column + 7].any()


def test_missing_images_are_reported_on_diagnostics(client):
    """Every fourth image of a stream at 20 per second is missing."""
    statuses = client.peer.subscribe(DiagnosticArray, '/diagnostics')
    numbers = itertools.count()

    def publish():
        number = next(numbers)
        if number < 12 or number % 4:
            header = scenes.header(100)
            header.stamp.sec += number // 20
            header.stamp.nanosec = number % 20 * 50_000_000
            client.image.publish(image_msg(header, EMPTY))

    def messages():
        ours = f'{client.peer.namespace[1:]}/detector_node: images'
        return [s.message for msg in statuses for s in msg.status if s.name == ours]

    client.peer.until(
        lambda: any('images are missing in the last 10 s' in text for text in messages()),
        meanwhile=publish,
        every_s=0.05,
    )


def test_without_a_subscriber_no_image_is_annotated(peer, tmp_path, monkeypatch):
    """While only the points have a subscriber."""
    drawn = []

    def counted(*args):
        drawn.append(args)
        return annotate(*args)

    monkeypatch.setattr(detector_node, 'annotate', counted)
    (tmp_path / 'board.yaml').write_text(BOARD_YAML)
    given = [Parameter('board_file', value=str(tmp_path / 'board.yaml'))]
    node = detector_node.DetectorNode(namespace=peer.namespace, parameter_overrides=given)
    msg = image_msg(scenes.header(40), IMAGE)
    points = peer.subscribe(PointCloud2, 'correspondences')
    peer.until(lambda: points, meanwhile=lambda: node._on_image(msg))
    assert not drawn
    annotated = peer.subscribe(Image, 'detector_node/image_annotated')
    peer.until(lambda: annotated, meanwhile=lambda: node._on_image(msg))
    node.destroy_node()
    assert drawn


@pytest.mark.parametrize('extension', ['.png', '.jpg'])
def test_compressed_images(peer, tmp_path, extension):
    """A parameter selects the topic image/compressed."""
    transport = {'image.transport': 'compressed'}
    client = DetectorClient(
        peer, tmp_path, 'image/compressed', CompressedImage, BOARD_YAML, **transport
    )
    data = array('B', cv2.imencode(extension, IMAGE)[1].tobytes())

    def make(header):
        return CompressedImage(header=header, format=extension[1:], data=data)

    msg = client.detect(make, 31, 'right_optical')
    assert msg.header == scenes.header(31, 'right_optical')
    assert 'board' not in [field.name for field in msg.fields]  # there is only one board
    _assert_all_corners(msg, atol_px=0.5)
