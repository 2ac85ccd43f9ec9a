# Copyright 2026 p4pfr_ros maintainers
# SPDX-License-Identifier: Apache-2.0

"""Markers for RViz and Foxglove: their geometry projects to the observed points."""

from dataclasses import replace

import numpy as np
from p4pfr_ros import DivisionCamera, estimate_pose, Observability, Pose
from p4pfr_ros.ros.conversions import Correspondences
from p4pfr_ros.ros.conversions.markers import markers_msg, ramp_colors
import pytest
import scenes
from visualization_msgs.msg import Marker

OUTLIERS = [3, 17]
WIDE = DivisionCamera(300.0, (319.5, 239.5), -0.35)


def view(camera=scenes.CAMERA, sigma_px=0.3, outliers=OUTLIERS):
    """Return pixels of the board, and the estimate from them."""
    noise = np.random.default_rng(4).normal(0.0, sigma_px, scenes.GRID.shape)
    image = scenes.project(scenes.GRID, camera=camera) + noise
    image[outliers] += 25.0
    return image, estimate_pose(image, scenes.GRID, image_size=scenes.SIZE)


def message(image, estimate, frame='board', **options):
    """Make the markers of a view."""
    points = Correspondences(image, scenes.GRID, np.arange(len(image)))
    return markers_msg(scenes.header(5), frame, estimate, points, image, scenes.SIZE, **options)


def keys(msg):
    return {(m.ns, m.id) for m in msg.markers}


def one(msg, ns, number=0):
    """Return the marker with a namespace and id."""
    (marker,) = (m for m in msg.markers if (m.ns, m.id) == (ns, number))
    return marker


def in_camera(marker):
    """Return the points (N, 3) of a marker in the header's frame, as a viewer shows them."""
    q, p = marker.pose.orientation, marker.pose.position
    pose = Pose.from_quaternion_xyzw([q.x, q.y, q.z, q.w], [p.x, p.y, p.z])
    return pose.transform([(point.x, point.y, point.z) for point in marker.points])


def rgb(color):
    return (color.r, color.g, color.b)


def test_all_markers_are_complete():
    """They have the header of the view, a size, a visible colour and a lifetime."""
    image, estimate = view()
    msg = message(image, estimate)
    assert len(keys(msg)) == len(msg.markers) == 7
    for marker in msg.markers:
        assert marker.header == scenes.header(5)
        assert marker.action == Marker.ADD
        assert marker.scale.x > 0.0
        assert marker.colors or marker.color.a > 0.0
        assert marker.lifetime.sec > 0


def test_points_project_to_the_observed_pixels():
    """Inliers and outliers are separate lists."""
    image, estimate = view()
    msg = message(image, estimate)
    inliers, outliers = one(msg, 'board/points', 0), one(msg, 'board/points', 1)
    assert (inliers.type, outliers.type) == (Marker.SPHERE_LIST, Marker.CUBE_LIST)
    camera = estimate.model.camera
    residuals = camera.project(in_camera(inliers)) - np.delete(image, OUTLIERS, axis=0)
    assert np.linalg.norm(residuals, axis=1).max() < 1.5
    residuals = camera.project(in_camera(outliers)) - image[OUTLIERS]
    np.testing.assert_allclose(residuals, -25.0, atol=1.5)


def test_outline_and_axes_lie_on_the_board():
    """The outline encloses the points; the axes are red, green and blue from the origin."""
    image, estimate = view()
    msg = message(image, estimate)
    board_from_camera = estimate.model.camera_from_board.inverse()
    outline = board_from_camera.transform(in_camera(one(msg, 'board/outline')))
    np.testing.assert_allclose(outline[:, 2], 0.0, atol=1e-12)
    np.testing.assert_allclose(outline[0], outline[-1], atol=1e-12)
    np.testing.assert_allclose(outline.min(axis=0)[:2], scenes.GRID.min(axis=0), atol=1e-12)
    np.testing.assert_allclose(outline.max(axis=0)[:2], scenes.GRID.max(axis=0), atol=1e-12)
    for axis in range(3):
        arrow = one(msg, 'board/axes', axis)
        assert arrow.type == Marker.ARROW
        assert np.argmax(rgb(arrow.color)) == axis
        start, end = board_from_camera.transform(in_camera(arrow))
        np.testing.assert_allclose(start, 0.0, atol=1e-12)
        np.testing.assert_allclose(end, 0.1 * np.eye(3)[axis], atol=1e-12)


def test_the_outline_is_the_sheet_if_it_is_known():
    """So it does not depend on the detected points."""
    image, estimate = view()
    outline = one(message(image, estimate, sheet_size_m=(0.3, 0.2)), 'board/outline')
    corners = {(round(p.x, 12), round(p.y, 12)) for p in outline.points}
    assert corners == {(-0.15, 0.1), (0.15, 0.1), (0.15, -0.1), (-0.15, -0.1)}


def test_an_undetermined_pose_has_another_colour():
    image, estimate = view()
    undetermined = replace(estimate, observable=Observability(direction=True))
    colors = [one(message(image, e), 'board/outline').color for e in (estimate, undetermined)]
    assert colors[1].a < colors[0].a


def test_colours_show_residuals():
    """The end of the ramp is a parameter."""
    image, estimate = view(sigma_px=0.0, outliers=[])
    image[5] += (1.0, 0.0)
    fine, coarse = (
        one(message(image, estimate, full_scale_px=scale), 'board/points').colors
        for scale in (1.0, 100.0)
    )
    assert len(fine) == len(scenes.GRID)
    best, worst = ramp_colors(np.array([0.0, 1.0]))
    assert rgb(fine[5]) == rgb(worst)
    assert rgb(fine[6]) == rgb(coarse[5]) == rgb(best)


def test_the_ramp_goes_from_blue_over_yellow_to_red():
    """Beyond the end, and for what no camera sees, it stays red."""
    colors = ramp_colors(np.array([0.0, 0.5, 1.0, 7.0, np.nan, np.inf]))
    assert [int(np.argmax(rgb(c))) for c in colors] == [2, 0, 0, 0, 0, 0]
    assert colors[1].g > 0.8 > 0.4 > colors[2].g
    assert len({rgb(c) for c in colors[2:]}) == 1
    assert len({rgb(c) for c in ramp_colors(np.linspace(0.0, 1.0, 9))}) == 9


@pytest.mark.parametrize('camera', [scenes.CAMERA, WIDE], ids=['normal', 'wide'])
def test_the_field_of_view_is_the_image_border(camera):
    """Distorted by the lens, with four lines to the camera."""
    image, estimate = view(camera, outliers=[])
    marker = one(message(image, estimate), 'board/field_of_view')
    assert marker.type == Marker.LINE_LIST
    ends = in_camera(marker)
    at_camera = np.linalg.norm(ends, axis=1) < 1e-12
    assert at_camera.sum() == 4
    pixels = estimate.model.camera.project(ends[~at_camera])
    width, height = scenes.SIZE
    at_side = np.isclose(pixels, [-0.5, -0.5], atol=1e-6) | np.isclose(
        pixels, [width - 0.5, height - 0.5], atol=1e-6
    )
    assert at_side.any(axis=1).all()
    assert at_side.all(axis=1).sum() == 4 * 3  # two border segments and a line to the camera
    segments = ends[:-8].reshape(-1, 2, 3)
    np.testing.assert_array_equal(segments[:, 1], np.roll(segments[:, 0], -1, axis=0))


def test_a_message_replaces_the_previous_one():
    """The namespaces and ids are the same with or without outliers and model."""
    image, estimate = view()
    clean = message(*view(outliers=[]))
    deleted = message(
        image[:4], estimate_pose(np.zeros((4, 2)), scenes.GRID[:4], image_size=scenes.SIZE)
    )
    assert keys(message(image, estimate)) == keys(clean) == keys(deleted)
    assert one(clean, 'board/points', 1).action == Marker.DELETE
    assert {m.action for m in deleted.markers} == {Marker.DELETE}
    assert {m.header.frame_id for m in deleted.markers} == {'a_camera'}


def test_boards_do_not_replace_each_other():
    image, estimate = view()
    assert not keys(message(image, estimate, 'left')) & keys(message(image, estimate, 'right'))
