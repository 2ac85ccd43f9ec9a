# Copyright 2026 p4pfr_ros maintainers
# SPDX-License-Identifier: Apache-2.0

"""AprilTagDetectionArray to correspondences."""

from apriltag import AprilTagDetection, AprilTagDetectionArray, install, Point, uninstall
import numpy as np
from p4pfr_ros import estimate_pose, EstimateOptions, Pose
from p4pfr_ros.boards import Bundle, Charuco, Marker, MarkerGrid, PlacedMarker
from p4pfr_ros.boards.conventions import CORNER_ORDERS
from p4pfr_ros.core.cameras.division import DivisionCamera
from p4pfr_ros.detection import detect
from p4pfr_ros.rendering import render
from p4pfr_ros.ros.conversions import (
    correspondences_from_detections,
    detection_array_type,
    isaac_detection_array_type,
)
from p4pfr_ros.ros.runtime.rejections import Rejected
import pytest
import scenes

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
    """Make a detection with corners as in AprilTag: from the bottom left, offset 0.5 px."""
    corners = [Point(*corners[CLOCKWISE.index(corner)]) for corner in APRIL]
    corners = [Point(float(corner.x) + 0.5, float(corner.y) + 0.5) for corner in corners]
    return AprilTagDetection(family=family, id=marker_id, corners=corners)


def detections_of(board, *ids, family='tag36h11'):
    """Make the detections of some markers of a board."""
    indices = [board.marker_ids.index(marker_id) for marker_id in ids]
    return [
        tag(board.marker_ids[i], scenes.project(board.marker_corners[i]), family) for i in indices
    ]


def convert(*detections, boards=BOARDS, **options):
    """Convert a message of these detections."""
    msg = AprilTagDetectionArray(header=scenes.header(1), detections=list(detections))
    return correspondences_from_detections(msg, boards, **options)


def test_markers_are_points_of_their_boards():
    """In the order of the boards and of the markers on them, not in that of the tags."""
    dock, door = convert(*detections_of(DOOR, 21), *detections_of(DOCK, 3, 7))
    assert (dock.board, door.board) == (0, 1)
    np.testing.assert_array_equal(dock.ids, np.arange(8))
    np.testing.assert_array_equal(dock.board_points, DOCK.points)
    np.testing.assert_allclose(dock.image_points, scenes.project(DOCK.points), rtol=0, atol=1e-9)
    # One of two markers is sufficient.
    np.testing.assert_array_equal(door.ids, [4, 5, 6, 7])
    np.testing.assert_array_equal(door.board_points, DOOR.points[4:])


@pytest.mark.parametrize('family', ['tag36h11', '36h11', 'Tag36H11'])
def test_all_names_of_a_family_are_known(family):
    """Those of AprilTag's library and of apriltag_ros's parameter."""
    (dock,) = convert(*detections_of(DOCK, 7, family=family))
    np.testing.assert_array_equal(dock.ids, np.arange(4))


def test_the_corners_of_apriltags_own_library():
    """
    Detected in this image by pupil-apriltags 1.0.4 with quad_decimate 1.

    Its corner order and pixel offset are the defaults.
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
    (points,) = convert(
        AprilTagDetection(family='tag36h11', id=3, corners=corners), boards={'tag': marker}
    )
    np.testing.assert_allclose(
        points.image_points, scenes.project(marker.points, pose, camera), atol=0.05
    )
    ours = detect(render(marker, camera, pose, (640, 480), blur_sigma_px=0.5), marker)
    np.testing.assert_allclose(points.image_points, ours.image_points, atol=0.07)


def test_corner_order_and_pixel_centre_are_options():
    """The same corners with the conventions of another detector."""
    corners = scenes.project(DOCK.marker_corners[0])
    detection = AprilTagDetection(
        family='tag36h11', id=7, corners=[Point(*corner) for corner in corners.tolist()]
    )
    options = {'corner_order': 'aruco_cw_from_top_left', 'pixel_center_px': 0.0}
    (dock,) = convert(detection, **options)
    np.testing.assert_array_equal(dock.image_points, corners)
    np.testing.assert_array_equal(dock.board_points, DOCK.points[:4])


def test_a_bundle_gives_the_pose():
    """Two markers of different sizes, one of them rotated: eight points, one pose."""
    (dock,) = convert(*detections_of(DOCK, 7, 3))
    estimate = estimate_pose(
        dock.image_points,
        dock.board_points,
        image_size=scenes.SIZE,
        options=EstimateOptions.ideal(),
    )
    pose = estimate.model.camera_from_board
    np.testing.assert_allclose(pose.translation, scenes.CAMERA_FROM_BOARD.translation, atol=1e-5)
    np.testing.assert_allclose(pose.rotation, scenes.CAMERA_FROM_BOARD.rotation, atol=1e-5)


def test_an_empty_array_is_valid():
    """Detectors publish a message for each image."""
    assert convert() == []


def test_other_tags_are_ignored():
    """Another id, another family, a family that OpenCV does not have."""
    others = [
        tag(9, scenes.project(DOCK.marker_corners[0])),
        *detections_of(DOCK, 7, family='tag25h9'),
        *detections_of(DOCK, 7, family='tagStandard41h12'),
        *detections_of(DOCK, 7, family=''),
    ]
    (dock,) = convert(*others, *detections_of(DOCK, 3))
    np.testing.assert_array_equal(dock.ids, [4, 5, 6, 7])
    (rejected,) = convert(*others)
    assert rejected.cause == 'unknown_tags'
    assert '(:7, tag25h9:7, tag36h11:9, ...) belongs to a board' in rejected.reason


def test_a_tag_detected_twice_is_left_out():
    """It is ambiguous which one is on the board."""
    (dock,) = convert(*detections_of(DOCK, 7, 3, 7))
    np.testing.assert_array_equal(dock.ids, [4, 5, 6, 7])
    (rejected,) = convert(*detections_of(DOCK, 7, 7))
    assert rejected.cause == 'unknown_tags'


def test_a_charuco_board_is_not_detected():
    """Its points are corners of squares, which the message does not contain."""
    board = Charuco(columns=3, rows=3, square_m=0.04, marker_m=0.03, dictionary=FAMILY)
    (rejected,) = convert(*detections_of(DOCK, 3), boards={'board': board})
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
def test_an_invalid_tag_rejects_its_own_board(corners, cause):
    """With all tags of the board, but not other boards."""
    wrong = AprilTagDetection(family='tag36h11', id=7, corners=corners)
    dock, door = convert(*detections_of(DOOR, 20, 21), wrong, *detections_of(DOCK, 3))
    assert isinstance(dock, Rejected)
    assert dock.cause == cause
    assert dock.reason.startswith('detections: ')
    assert 'tag 7' in dock.reason
    np.testing.assert_array_equal(door.ids, np.arange(8))
    # Also if the tag is detected twice, and one detection is valid.
    assert [rejected.cause for rejected in convert(wrong, *detections_of(DOCK, 7))] == [cause]
    assert [rejected.cause for rejected in convert(*detections_of(DOCK, 7), wrong)] == [cause]


@pytest.mark.parametrize(('corners', 'cause'), WRONG)
def test_an_invalid_tag_without_a_board_is_rejected_alone(corners, cause):
    """No board is rejected."""
    wrong = AprilTagDetection(family='tag36h11', id=9, corners=corners)
    dock, rejected = convert(wrong, *detections_of(DOCK, 3))
    np.testing.assert_array_equal(dock.ids, [4, 5, 6, 7])
    assert (rejected.cause, 'tag 9' in rejected.reason) == (cause, True)
    assert [rejected.cause for rejected in convert(wrong)] == [cause]


@pytest.mark.parametrize(
    ('package', 'type_of'),
    [
        ('apriltag_msgs', detection_array_type),
        ('isaac_ros_apriltag_interfaces', isaac_detection_array_type),
    ],
)
def test_the_message_type_is_optional(monkeypatch, package, type_of):
    """Without its package there is none."""
    uninstall(monkeypatch, package)
    assert type_of() is None
    install(monkeypatch, package)
    assert type_of() is AprilTagDetectionArray
