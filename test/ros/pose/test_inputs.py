# Copyright 2026 p4pfr_ros maintainers
# SPDX-License-Identifier: Apache-2.0

"""Messages to observations; the DDS tests cover the estimates."""

from apriltag import AprilTagDetection, AprilTagDetectionArray, isaac_detection, Point
import numpy as np
from p4pfr_ros.ros.conversions import cloud_msg
from p4pfr_ros.ros.parameters.declare import replaced
from p4pfr_ros.ros.parameters.pose_options import PoseNodeOptions
from p4pfr_ros.ros.pose.inputs import Inputs, MARKER
from p4pfr_ros.ros.runtime.rejections import Rejected
import pytest
import scenes

BOARDS = """
boards:
  gate: {type: marker, id: 3, size_m: 0.12, dictionary: DICT_APRILTAG_36h11}
  door: {type: marker, id: 4, size_m: 0.06, dictionary: DICT_APRILTAG_36h11}
"""
GRID = """
boards:
  grid: {type: marker_grid, columns: 3, rows: 1, marker_m: 0.1, separation_m: 0.02, first_id: 20,
         dictionary: DICT_APRILTAG_36h11}
  door: {type: marker, id: 4, size_m: 0.06, dictionary: DICT_APRILTAG_36h11}
"""
OPTIONS = replaced(PoseNodeOptions(), {'marker.size_m': scenes.MARKER_M})


@pytest.fixture
def inputs(tmp_path):
    """Give inputs with two boards and an image size."""
    (tmp_path / 'boards.yaml').write_text(BOARDS)
    inputs = Inputs(str(tmp_path / 'boards.yaml'))
    assert inputs.use_camera_info(scenes.camera_info()) is None
    return inputs


def _detection(tag, corners):
    """Make a detection as apriltag_ros does: from the bottom left, with an offset of 0.5 px."""
    points = [Point(x, y) for x, y in (corners[[3, 2, 1, 0]] + 0.5).tolist()]
    return AprilTagDetection(family='tag36h11', id=tag, corners=points)


def test_detections_are_assigned_to_their_boards(inputs):
    """One message with two boards: each has its corners in our order, and its own size."""
    corners = scenes.project(scenes.ARUCO)
    msg = AprilTagDetectionArray(
        scenes.header(5), [_detection(4, corners), _detection(3, corners), _detection(9, corners)]
    )
    observations = inputs.from_detections(msg, OPTIONS)
    assert [o.target.prefix for o in observations] == ['~/gate', '~/door']
    for observation, size_m in zip(observations, (0.12, 0.06), strict=True):
        assert observation.header == msg.header
        assert observation.frame.size == scenes.SIZE
        np.testing.assert_allclose(observation.image_points, corners)
        np.testing.assert_allclose(np.ptp(observation.points.board_points, axis=0), size_m)


def test_tags_of_isaac_ros_have_their_own_conventions(inputs):
    """Clockwise from the top left, without an offset."""
    corners = scenes.project(scenes.ARUCO)
    msg = AprilTagDetectionArray(scenes.header(5), [isaac_detection(3, corners)])
    [observation] = inputs.from_tag_detections(msg, OPTIONS)
    assert (observation.target.prefix, observation.header) == ('~/gate', msg.header)
    np.testing.assert_allclose(observation.image_points, corners)
    np.testing.assert_allclose(observation.points.board_points, observation.target.board.points)
    changed = replaced(OPTIONS, {'tag_detections.pixel_center_px': 0.5})
    [observation] = inputs.from_tag_detections(msg, changed)
    np.testing.assert_allclose(observation.image_points, corners - 0.5)
    msg.detections[0].corners.pop()
    [rejected] = inputs.from_tag_detections(msg, OPTIONS)
    assert rejected.reason == 'tag_detections: expected 4 corners of tag 3, got 3'


def test_an_invalid_message_is_rejected_with_its_cause(inputs):
    """On any topic."""
    detections = AprilTagDetectionArray(
        scenes.header(1), [_detection(9, scenes.project(scenes.ARUCO))]
    )
    cloud = scenes.board_cloud(3)
    cloud.data = cloud.data[:-1]
    rejected = [
        *inputs.from_detections(detections, OPTIONS),
        *inputs.from_corners(scenes.polygon(2, []), OPTIONS),
        *inputs.from_cloud(cloud, OPTIONS),
    ]
    assert all(isinstance(one, Rejected) for one in rejected)
    assert [one.cause for one in rejected] == ['unknown_tags', 'point_count', 'truncated']


def test_an_invalid_tag_does_not_reject_other_boards(inputs):
    """Its own board is rejected."""
    good, bad = (_detection(tag, scenes.project(scenes.ARUCO)) for tag in (4, 3))
    bad.corners[0] = Point(float('nan'), 1.0)
    msg = AprilTagDetectionArray(scenes.header(1), [bad, good])
    rejected, observation = inputs.from_detections(msg, OPTIONS)
    assert (rejected.cause, observation.target.prefix) == ('not_finite', '~/door')


def test_a_cloud_of_an_unknown_board_is_rejected(inputs):
    """The first board is not a default."""
    [rejected] = inputs.from_cloud(scenes.board_cloud(3), OPTIONS)
    assert rejected.cause == 'unknown_board'


def test_an_empty_detection_array_has_no_observation(inputs):
    """It is valid."""
    assert inputs.from_detections(AprilTagDetectionArray(scenes.header(1), []), OPTIONS) == []


def test_corners_belong_to_the_marker_of_the_parameters(inputs):
    """Even with boards in a file."""
    [observation] = inputs.from_corners(scenes.polygon(2, scenes.project(scenes.ARUCO)), OPTIONS)
    assert observation.target is MARKER


def test_the_image_size_comes_from_camera_info_or_the_parameters():
    """The parameters apply until the first camera_info; without either, points are rejected."""
    inputs, cloud = Inputs(''), scenes.board_cloud(1)
    [rejected] = inputs.from_cloud(cloud, OPTIONS)
    assert rejected.cause == 'no_image_size'
    sized = replaced(OPTIONS, {'image.width_px': 800, 'image.height_px': 600})
    [observation] = inputs.from_cloud(cloud, sized)
    assert observation.frame.size == (800, 600)
    assert inputs.use_camera_info(scenes.camera_info()) is None
    [observation] = inputs.from_cloud(cloud, sized)
    assert observation.frame.size == scenes.SIZE


def test_a_cloud_with_points_outside_the_image_is_rejected():
    """A fitted point may lie slightly outside."""
    inputs = Inputs('')
    assert inputs.use_camera_info(scenes.camera_info()) is None
    points = scenes.project(scenes.GRID)
    for offset_px, is_rejected in ((0.0, False), (2.0, False), (2.1, True)):
        moved = points - [points[:, 0].min() + 0.5 + offset_px, 0.0]
        msg = cloud_msg(scenes.header(1), moved, scenes.GRID, np.arange(len(moved)))
        [one] = inputs.from_cloud(msg, OPTIONS)
        assert isinstance(one, Rejected) == is_rejected, offset_px
        assert not is_rejected or (one.cause, 'camera_info' in one.reason) == (
            'outside_image',
            True,
        )


def _cut_by_the_left_rim(corners, outside_px):
    """Return corners (4, 2) px, moved so that the leftmost is this far outside."""
    return corners - [corners[:, 0].min() + 0.5 + outside_px, 0.0]


@pytest.mark.parametrize('topic', ['corners', 'detections', 'tag_detections'])
def test_a_tag_that_the_rim_cuts_is_used_up_to_half_its_side(inputs, topic):
    """The library of AprilTag extrapolates corners outside; farther out they are wrong."""
    corners = scenes.project(scenes.ARUCO)
    half_px = np.linalg.norm(corners - np.roll(corners, 1, axis=0), axis=1).mean() / 2.0
    for share, is_rejected in ((0.0, False), (0.3, False), (0.99, False), (1.01, True)):
        cut = _cut_by_the_left_rim(corners, share * half_px)
        msg = {
            'corners': scenes.polygon(1, cut),
            'detections': AprilTagDetectionArray(scenes.header(1), [_detection(3, cut)]),
            'tag_detections': AprilTagDetectionArray(scenes.header(1), [isaac_detection(3, cut)]),
        }[topic]
        [one] = getattr(inputs, f'from_{topic}')(msg, OPTIONS)
        assert isinstance(one, Rejected) == is_rejected, share
        if is_rejected:
            assert one.cause == 'outside_image'
            name = 'the marker' if topic == 'corners' else 'tag 3'
            assert one.reason.startswith(f'{topic}: {name} is left out, because its corner (-')
            assert 'px outside the image of 640x480 px, more than half a side' in one.reason
        else:
            np.testing.assert_allclose(one.image_points, cut, atol=1e-4)


def test_a_tag_too_far_outside_costs_nothing_but_itself(inputs, tmp_path):
    """Not the other tags of its board, and not other boards."""
    (tmp_path / 'grid.yaml').write_text(GRID)
    inputs = Inputs(str(tmp_path / 'grid.yaml'))
    assert inputs.use_camera_info(scenes.camera_info()) is None
    grid, corners = inputs.boards['grid'], scenes.project(scenes.ARUCO)
    far, near = (_cut_by_the_left_rim(corners, outside_px) for outside_px in (300.0, 5.0))
    detections = [
        _detection(20, far),
        _detection(21, near),
        _detection(22, corners),
        _detection(4, corners),
    ]
    rejected, observation, other = inputs.from_detections(
        AprilTagDetectionArray(scenes.header(1), detections), OPTIONS
    )
    assert (rejected.cause, 'tag 20 ' in rejected.reason) == ('outside_image', True)
    assert (observation.target.name, other.target.name) == ('grid', 'door')
    np.testing.assert_array_equal(observation.points.ids, np.arange(4, 12))
    np.testing.assert_array_equal(observation.points.board_points, grid.points[4:12])
    np.testing.assert_allclose(observation.image_points, np.concatenate([near, corners]))
    np.testing.assert_allclose(observation.points.image_points, observation.image_points)
