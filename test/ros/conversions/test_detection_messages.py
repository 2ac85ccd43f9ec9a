# Copyright 2026 p4pfr_ros maintainers
# SPDX-License-Identifier: Apache-2.0

"""AprilTagDetectionArray to correspondences; apriltag_msgs itself need not be installed."""

from dataclasses import dataclass, field
import sys
from types import ModuleType

import numpy as np
from p4pfr_ros import estimate_pose, Pose
from p4pfr_ros.boards import Bundle, Charuco, Marker, MarkerGrid, PlacedMarker
from p4pfr_ros.boards.conventions import CORNER_ORDERS
from p4pfr_ros.core.cameras.division import DivisionCamera
from p4pfr_ros.detection import detect
from p4pfr_ros.rendering import render
from p4pfr_ros.ros.conversions import correspondences_from_detections, detection_array_type
from p4pfr_ros.ros.runtime.rejections import Rejected
import pytest
import scenes
from std_msgs.msg import Header


@dataclass
class Point:
    """apriltag_msgs/Point, by its published fields."""

    x: float = 0.0
    y: float = 0.0


@dataclass
class AprilTagDetection:
    """apriltag_msgs/AprilTagDetection, by its published fields."""

    family: str = ''
    id: int = 0
    hamming: int = 0
    goodness: float = 0.0
    decision_margin: float = 0.0
    centre: Point = field(default_factory=Point)
    corners: list = field(default_factory=lambda: [Point() for _ in range(4)])
    homography: np.ndarray = field(default_factory=lambda: np.zeros(9))


@dataclass
class AprilTagDetectionArray:
    """apriltag_msgs/AprilTagDetectionArray, by its published fields."""

    header: Header = field(default_factory=Header)
    detections: list = field(default_factory=list)


FAMILY = 'DICT_APRILTAG_36h11'
DOCK = Bundle(
    markers=(
        PlacedMarker(id=7, x_m=-0.1, y_m=0.0, size_m=0.08),
        PlacedMarker(id=3, x_m=0.1, y_m=0.02, size_m=0.05, angle_deg=30.0),
    ),
    dictionary=FAMILY,
    name='dock',
)
DOOR = MarkerGrid(
    columns=2, rows=1, marker_m=0.1, separation_m=0.02, dictionary=FAMILY, first_id=20, name='door'
)
BOARDS = {'dock': DOCK, 'door': DOOR}
APRIL = CORNER_ORDERS['apriltag_ccw_from_bottom_left']
CLOCKWISE = CORNER_ORDERS['aruco_cw_from_top_left']


def tag(marker_id, corners, family='tag36h11'):
    """Make a detection with its corners as AprilTag gives them: from the bottom left, + 0.5."""
    corners = [Point(*corners[CLOCKWISE.index(corner)]) for corner in APRIL]
    corners = [Point(float(corner.x) + 0.5, float(corner.y) + 0.5) for corner in corners]
    return AprilTagDetection(family=family, id=marker_id, corners=corners)


def seen(board, *ids, family='tag36h11'):
    """Make the detections of a board's markers."""
    places = [board.marker_ids.index(marker_id) for marker_id in ids]
    return [tag(board.marker_ids[n], scenes.seen(board.marker_corners[n]), family) for n in places]


def ask(*detections, boards=BOARDS, **options):
    """Convert a message of these detections."""
    msg = AprilTagDetectionArray(header=scenes.header(1), detections=list(detections))
    return correspondences_from_detections(msg, boards, **options)


def test_markers_are_points_of_their_boards():
    """Whatever the order of the detections: that of the boards, and of the markers on them."""
    dock, door = ask(*seen(DOOR, 21), *seen(DOCK, 3, 7))
    assert (dock.board, door.board) == (0, 1)
    np.testing.assert_array_equal(dock.ids, np.arange(8))
    np.testing.assert_array_equal(dock.board_points, DOCK.points)
    np.testing.assert_allclose(dock.image_points, scenes.seen(DOCK.points), rtol=0, atol=1e-9)
    # One marker of the two is enough.
    np.testing.assert_array_equal(door.ids, [4, 5, 6, 7])
    np.testing.assert_array_equal(door.board_points, DOOR.points[4:])


@pytest.mark.parametrize('family', ['tag36h11', '36h11', 'Tag36H11'])
def test_families_by_all_their_names(family):
    """As AprilTag's library has them, and as apriltag_ros's parameter has."""
    (dock,) = ask(*seen(DOCK, 7, family=family))
    np.testing.assert_array_equal(dock.ids, np.arange(4))


def test_the_corners_of_apriltags_own_library():
    """
    What it found in this picture: pupil-apriltags 1.0.4, quad_decimate 1.

    Its corner order and its half pixel are the defaults.
    """
    marker = Marker(id=3, size_m=0.15, dictionary=FAMILY)
    camera = DivisionCamera(500.0, (319.5, 239.5))
    upright = Pose.from_rotation_vector((0.0, 0.0, 0.3), np.zeros(3)) @ Pose(
        np.diag([1.0, -1.0, -1.0]), np.zeros(3)
    )
    pose = Pose.from_rotation_vector((0.4, -0.25, 0.0), (0.02, -0.03, 0.5)) @ upright
    corners = [
        Point(246.11619568, 260.38803101),
        Point(377.82492065, 289.2460022),
        Point(432.5574646, 160.34640503),
        Point(294.13363647, 113.85242462),
    ]
    (points,) = ask(
        AprilTagDetection(family='tag36h11', id=3, corners=corners), boards={'tag': marker}
    )
    np.testing.assert_allclose(
        points.image_points, scenes.seen(marker.points, pose, camera), atol=0.05
    )
    ours = detect(render(marker, camera, pose, (640, 480), blur_sigma_px=0.5), marker)
    np.testing.assert_allclose(points.image_points, ours.image_points, atol=0.07)


def test_corner_order_and_pixel_centre_are_the_senders():
    """The same corners, as another detector has them."""
    corners = scenes.seen(DOCK.marker_corners[0])
    detection = AprilTagDetection(
        family='tag36h11', id=7, corners=[Point(*corner) for corner in corners.tolist()]
    )
    options = {'corner_order': 'aruco_cw_from_top_left', 'pixel_center_px': 0.0}
    (dock,) = ask(detection, **options)
    np.testing.assert_array_equal(dock.image_points, corners)
    np.testing.assert_array_equal(dock.board_points, DOCK.points[:4])


def test_a_bundle_gives_the_pose():
    """Two markers of different sizes, one of them turned: eight points, one pose."""
    (dock,) = ask(*seen(DOCK, 7, 3))
    estimate = estimate_pose(dock.image_points, dock.board_points, image_size=scenes.SIZE)
    pose = estimate.model.camera_from_board
    np.testing.assert_allclose(pose.translation, scenes.CAMERA_FROM_BOARD.translation, atol=1e-5)
    np.testing.assert_allclose(pose.rotation, scenes.CAMERA_FROM_BOARD.rotation, atol=1e-5)


def test_no_tag_is_no_answer_and_no_error():
    """Detectors send a message for each picture."""
    assert ask() == []


def test_other_tags_are_ignored():
    """Another id, another family, one that OpenCV lacks."""
    others = [
        tag(9, scenes.seen(DOCK.marker_corners[0])),
        *seen(DOCK, 7, family='tag25h9'),
        *seen(DOCK, 7, family='tagStandard41h12'),
        *seen(DOCK, 7, family=''),
    ]
    (dock,) = ask(*others, *seen(DOCK, 3))
    np.testing.assert_array_equal(dock.ids, [4, 5, 6, 7])
    (rejected,) = ask(*others)
    assert rejected.cause == 'unknown_tags'
    assert '(:7, tag25h9:7, tag36h11:9, ...) is on a board' in rejected.reason


def test_of_a_tag_seen_twice_neither_is_taken():
    """Nobody knows which of them is the board's."""
    (dock,) = ask(*seen(DOCK, 7, 3, 7))
    np.testing.assert_array_equal(dock.ids, [4, 5, 6, 7])
    (rejected,) = ask(*seen(DOCK, 7, 7))
    assert rejected.cause == 'unknown_tags'


def test_squares_between_markers_are_not_made_up():
    """Of a ChArUco board the points are corners of squares, which the message does not have."""
    board = Charuco(columns=3, rows=3, square_m=0.04, marker_m=0.03, dictionary=FAMILY)
    (rejected,) = ask(*seen(DOCK, 3), boards={'board': board})
    assert rejected.cause == 'unknown_tags'


WRONG = [
    ([Point(1.0, 1.0)] * 3, 'corner_count'),
    ([Point(1.0, 1.0)] * 5, 'corner_count'),
    ([], 'corner_count'),
    ([Point(1.0, np.nan), *[Point(1.0, 1.0)] * 3], 'not_finite'),
    ([Point(-np.inf, 2.0), *[Point(1.0, 1.0)] * 3], 'not_finite'),
    ([Point(1e9, 2.0), *[Point(1.0, 1.0)] * 3], 'out_of_range'),
]


@pytest.mark.parametrize(('corners', 'cause'), WRONG)
def test_a_tag_that_cannot_be_right_rejects_its_own_board(corners, cause):
    """It says why; the tags beside it on the board are not believed, those of others are."""
    wrong = AprilTagDetection(family='tag36h11', id=7, corners=corners)
    dock, door = ask(*seen(DOOR, 20, 21), wrong, *seen(DOCK, 3))
    assert isinstance(dock, Rejected)
    assert dock.cause == cause
    assert dock.reason.startswith('detections: ')
    assert 'tag 7' in dock.reason
    np.testing.assert_array_equal(door.ids, np.arange(8))
    # Seen twice, and once rightly: it is as doubtful.
    assert [answer.cause for answer in ask(wrong, *seen(DOCK, 7))] == [cause]
    assert [answer.cause for answer in ask(*seen(DOCK, 7), wrong)] == [cause]


@pytest.mark.parametrize(('corners', 'cause'), WRONG)
def test_a_tag_of_no_board_that_cannot_be_right_rejects_itself(corners, cause):
    """All boards are answered."""
    wrong = AprilTagDetection(family='tag36h11', id=9, corners=corners)
    dock, rejected = ask(wrong, *seen(DOCK, 3))
    np.testing.assert_array_equal(dock.ids, [4, 5, 6, 7])
    assert (rejected.cause, 'tag 9' in rejected.reason) == (cause, True)
    assert [answer.cause for answer in ask(wrong)] == [cause]


def test_the_message_is_known_where_its_package_is(monkeypatch):
    """And where it is not, that is no error."""
    monkeypatch.setitem(sys.modules, 'apriltag_msgs', None)
    assert detection_array_type() is None
    package, messages = ModuleType('apriltag_msgs'), ModuleType('apriltag_msgs.msg')
    messages.AprilTagDetectionArray = AprilTagDetectionArray
    monkeypatch.setitem(sys.modules, 'apriltag_msgs', package)
    monkeypatch.setitem(sys.modules, 'apriltag_msgs.msg', messages)
    assert detection_array_type() is AprilTagDetectionArray
