# Copyright 2026 p4pfr_ros maintainers
# SPDX-License-Identifier: Apache-2.0

"""Markers whose edges are sharp, far off, bent or not there at all."""

from board_views import CENTER, project, seen_from, SIZE
import cv2
import numpy as np
from p4pfr_ros.boards import Marker
from p4pfr_ros.core.cameras.division import DivisionCamera
from p4pfr_ros.detection import detect
from p4pfr_ros.detection.marker_edges import refine_markers
from p4pfr_ros.rendering import render
from p4pfr_ros.rendering.rasterizer import coverage
import pytest

CELLS = 6
MARKER = Marker(id=3, size_m=0.15, dictionary='DICT_4X4_50')
SQUARE = np.array([[0, 0], [1, 0], [1, 1], [0, 1]])


def black_square(side_px, left_top_px=(39.5, 39.5), blur_sigma_px=0.0):
    """Draw a black square, exact to the area of each pixel: the picture and its corners (4, 2)."""
    corners = side_px * SQUARE + left_top_px
    size_px = int(side_px) + 80
    sides = np.concatenate([corners, np.roll(corners, -1, axis=0)], axis=1)
    picture = 220.0 - 195.0 * coverage(sides, (size_px, size_px))
    if blur_sigma_px > 0.0:
        picture = cv2.GaussianBlur(picture, (0, 0), blur_sigma_px)
    return np.rint(picture).astype(np.uint8), corners


def near(corners, off_px, count):
    """Return corners (count, 4, 2), each off by up to so many pixels in x and y."""
    return corners + np.random.default_rng(8).uniform(-off_px, off_px, (count, 4, 2))


def largest_error_px(found, truth):
    """Return how far the worst corner is from the truth."""
    return np.linalg.norm(found - truth, axis=-1).max()


@pytest.mark.parametrize('left_top_px', [(39.5, 39.5), (39.1, 39.6)], ids=['whole', 'part'])
@pytest.mark.parametrize('side_px', [180, 236, 400])
def test_sharp_edges_are_found_from_anywhere_near(side_px, left_top_px):
    """A wide strip's samples are far apart: each row alone leaves open where the edge is."""
    picture, corners = black_square(side_px, left_top_px)
    found = refine_markers(picture, near(corners, 1.5, 25), CELLS)
    assert largest_error_px(found, corners) < 0.1


@pytest.mark.parametrize(('k', 'side_px'), [(0.0, 160), (-0.2, 180), (-0.2, 220), (-0.2, 250)])
def test_a_marker_seen_head_on_without_blur_is_found(k, side_px):
    camera = DivisionCamera(500.0, CENTER, k)
    for offset in ((0.0, 0.0), (0.003, 0.002), (0.002, -0.001)):
        pose = seen_from(500.0 * MARKER.size_m / side_px, offset=offset)
        found = detect(render(MARKER, camera, pose, SIZE), MARKER)
        assert largest_error_px(found.image_points, project(camera, pose, MARKER.points)) < 0.15


def test_sharp_edges_that_the_lens_bends_far_are_found():
    camera = DivisionCamera(250.0, CENTER, -0.4)
    for offset in ((0.2, 0.1), (0.3, -0.1), (-0.1, 0.25)):
        pose = seen_from(0.12, offset=offset)
        truth = project(camera, pose, MARKER.points)
        start = near(truth, 1.0, 10)
        found = refine_markers(render(MARKER, camera, pose, SIZE), start, CELLS)
        assert largest_error_px(found, truth) < 0.15


@pytest.mark.parametrize('side_px', [60, 80, 100])
def test_blur_does_not_draw_the_corners_in(side_px):
    """It rounds them, and the wider it is the more of each edge."""
    picture, corners = black_square(side_px, (39.8, 39.3), blur_sigma_px=1.5)
    found = refine_markers(picture, near(corners, 1.0, 5), CELLS)
    assert largest_error_px(found, corners) < 0.1


@pytest.mark.parametrize('side_px', [20, 24])
def test_a_small_markers_corners_may_be_off_by_more_than_two_pixels(side_px):
    """As those of a detector are, where blur has rounded them."""
    picture, corners = black_square(side_px, blur_sigma_px=0.7)
    for outwards_px in (-1.5, 1.5):
        start = corners + outwards_px * (2 * SQUARE - 1)
        assert largest_error_px(refine_markers(picture, start[None], CELLS), corners) < 0.25


def test_a_marker_keeps_its_corners_where_an_edge_is_none():
    picture, corners = black_square(100)
    start = near(corners, 1.0, 1)
    assert largest_error_px(refine_markers(picture, start, CELLS), corners) < 0.1
    touched, crossed = picture.copy(), picture.copy()
    touched[20:40] = 25  # black up to the marker's upper edge
    crossed[44:52] = 220  # white, within its black border
    for spoilt in (touched, crossed, 255 - picture):
        np.testing.assert_array_equal(refine_markers(spoilt, start, CELLS), start)
