# Copyright 2026 p4pfr_ros maintainers
# SPDX-License-Identifier: Apache-2.0

"""The maps of projection uncertainty and of the shapes of boards show the right numbers."""

from matplotlib.figure import Figure
import numpy as np
from p4pfr_ros import BoardShape, CameraEstimate, DivisionCamera, Keyframe, Pose
from p4pfr_ros.core.many_views.progress import projection_sigmas_px
from p4pfr_ros.report.maps import uncertainty_px
from p4pfr_ros.report.shape_plots import draw_uncertainty_and_boards
import pytest

SIZE = (640, 480)
SIGMAS = [0.5, 0.4, 0.3, 2e-3, 2e-3, 1e-3, 1e-4, 1e-4, 1e-4, 1e-4]
CAMERA = DivisionCamera(300.0, (330.0, 232.0), -0.3, -0.02, -2e-3, -1e-4, 1.01, 1e-3, -5e-4)
SEEN = np.zeros((12, 16), dtype=bool)
SEEN[3:9, 4:12] = True
# Bowed along x alone: P2 from -1/2 to 1.
SHAPE = BoardShape(
    np.array([0.01, 0.0]), np.array([0.1, 0.06]), [0, 0, 0.02, 0, 0, 0, 0, 0], 1e-8 * np.eye(8)
)
GRID = np.stack(np.meshgrid([-0.09, 0.01, 0.11], [-0.06, 0.06]), axis=-1).reshape(-1, 2)


def estimate(**changes):
    """Make an estimate with correlated parameters."""
    factor = np.array(SIGMAS)[:, None] * np.random.default_rng(0).normal(size=(10, 10))
    values = {'projection_sigma_px': 0.5, 'coverage': SEEN, 'board_shapes': {'wall': SHAPE}}
    return CameraEstimate(CAMERA, factor @ factor.T, 0.2, 9, **(values | changes))


def drawn(estimated):
    """Draw the maps; return their axes."""
    points = np.zeros((6, 2))
    view = Keyframe(
        points, GRID, Pose(np.eye(3), np.ones(3)), np.ones(6, bool), points, 0.1, 0, 'wall'
    )
    figure = Figure()
    draw_uncertainty_and_boards(figure, estimated, SIZE, [view])
    return figure.axes


def test_the_uncertainty_is_that_of_the_core():
    """Where points were seen; elsewhere the same turn of the camera is taken out."""
    pixels = np.random.default_rng(1).uniform((100, 80), (540, 400), (40, 2))
    expected = projection_sigmas_px(CAMERA, estimate().covariance, pixels)
    np.testing.assert_allclose(uncertainty_px(estimate(), pixels, pixels), expected, rtol=1e-5)
    some = uncertainty_px(estimate(), pixels[:7], pixels)
    np.testing.assert_allclose(some, expected[:7], rtol=1e-5)


def test_the_map_grows_where_nothing_was_seen():
    map_axes = drawn(estimate())[0]
    [image] = map_axes.images
    sigmas = image.get_array()
    assert sigmas.shape == (48, 64)
    seen = np.kron(SEEN, np.ones((4, 4), dtype=bool))
    assert sigmas[~seen].mean() > 2.0 * sigmas[seen].mean()
    assert image.get_extent() == [-0.5, 639.5, 479.5, -0.5]
    assert map_axes.get_title() == 'projection uncertainty: 0.5 px at most where seen (white)'


def test_the_part_that_was_seen_is_outlined():
    [outline] = drawn(estimate())[0].collections
    ends = np.concatenate(outline.get_segments())
    np.testing.assert_allclose(ends.min(axis=0), (159.5, 119.5))
    np.testing.assert_allclose(ends.max(axis=0), (479.5, 359.5))
    assert len(outline.get_segments()) == 2 * (8 + 6)


def test_pixels_that_see_nothing_are_left_out():
    """Beyond the fold of the lens."""
    folded = DivisionCamera(300.0, (319.5, 239.5), 1.5)
    estimated = CameraEstimate(folded, 1e-6 * np.eye(10), 0.2, 9)
    sigmas = drawn(estimated)[0].images[0].get_array()
    assert np.ma.getmaskarray(sigmas)[0, 0]
    assert not np.ma.getmaskarray(sigmas)[24, 32]


def test_the_heights_of_a_board_are_in_millimetres():
    axes = drawn(estimate())
    [board] = [panel for panel in axes if panel.get_xlabel() == 'x, mm']
    [heights] = [image.get_array() for image in board.images]
    assert np.ptp(heights) == pytest.approx(1e3 * SHAPE.bow, rel=0.02)
    assert np.ptp(heights) == pytest.approx(1e3 * 0.1 * 0.02 * 1.5, rel=0.02)
    # Towards the viewer at the left and the right, away in the middle.
    rows, columns = heights.shape
    assert heights[rows // 2, 0] > 0.0 > heights[rows // 2, columns // 2]
    np.testing.assert_allclose(board.images[0].get_extent(), [-90.0, 110.0, -60.0, 60.0])
    dots = np.column_stack(board.lines[0].get_data())
    np.testing.assert_allclose(np.unique(dots, axis=0), np.unique(1e3 * GRID, axis=0))
    assert board.get_title().startswith('shape of the board wall, points as dots:\nbowed by 3.0')


def test_without_shapes_only_the_uncertainty_is_drawn():
    axes = drawn(estimate(board_shapes={}))
    assert [len(panel.images) for panel in axes] == [1, 0]
