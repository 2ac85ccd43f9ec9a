# Copyright 2026 p4pfr_ros maintainers
# SPDX-License-Identifier: Apache-2.0

"""The report of a calibration shows the right points, residuals and histories."""

from dataclasses import replace
import xml.etree.ElementTree as ET

from matplotlib.figure import Figure
import numpy as np
from p4pfr_ros import CameraEstimate, DivisionCamera, EstimateOptions, Verdict
from p4pfr_ros.files.boards import load_board
from p4pfr_ros.files.images import read_image
from p4pfr_ros.files.yaml_fields import ConfigError
from p4pfr_ros.report.calibration_run import (
    CalibrationRun,
    COLUMNS,
    count_per_cell,
    NamedImage,
    ROWS,
    ViewRecord,
)
from p4pfr_ros.report.plots import draw_history, draw_report, write_report
import pytest
from rendered import CHESSBOARD, write_views

SIZE = (640, 480)
COUNT = 4


@pytest.fixture(scope='module')
def run(tmp_path_factory):
    """Return a calibration from a few views."""
    run = CalibrationRun(load_board(CHESSBOARD), EstimateOptions())
    for path in write_views(tmp_path_factory.mktemp('views'), COUNT):
        run.add(NamedImage(path.name, read_image(path)))
    return run


def record(number, focal_px, sigma_px, center_sigma_px=1.0, verdict=Verdict.USED):
    """Make the record of a view with the camera after it."""
    sigmas = np.array([sigma_px, center_sigma_px, center_sigma_px, 0.01, 0.0, 0.0])
    camera = DivisionCamera(focal_px, (320.0 + number, 240.0 - number), -0.2)
    fused = CameraEstimate(camera, np.diag(sigmas**2), 0.2, number)
    return ViewRecord(number, f'{number}.png', 54, 54, 0.2, verdict, fused)


def panels(records, comparisons=None):
    """Draw the history; return its axes."""
    figure = Figure()
    draw_history(figure, records, comparisons)
    return figure.axes


def band(axes):
    """Return the lower and upper edge of a panel's band, per view."""
    [outline] = axes.collections[0].get_paths()
    x = outline.vertices[:, 0]
    at = {n: outline.vertices[x == n, 1] for n in np.unique(x)}
    return {n: (y.min(), y.max()) for n, y in at.items()}


def test_cells_extend_to_the_image_edges():
    width, height = SIZE
    corners = [(-0.5, -0.5), (width - 0.5, height - 0.5), (width - 1.0, 0.0)]
    counts = count_per_cell(np.array(corners), SIZE)
    assert counts.shape == (ROWS, COLUMNS)
    assert counts[0, 0] == counts[-1, -1] == counts[0, -1] == 1
    assert counts.sum() == 3
    assert count_per_cell(np.empty((0, 2)), SIZE).sum() == 0


def test_history_shows_value_and_sigma_of_each_view():
    records = [record(1, 520.0, 9.0), record(3, 505.0, 3.0), record(4, 501.0, 2.0)]
    focal, x, y = panels(records, {'other': (500.0, 321.0, 238.0)})
    numbers, values = focal.lines[0].get_data()
    np.testing.assert_array_equal(numbers, [1, 3, 4])
    np.testing.assert_array_equal(values, [520.0, 505.0, 501.0])
    assert band(focal) == {1: (511.0, 529.0), 3: (502.0, 508.0), 4: (499.0, 503.0)}
    np.testing.assert_array_equal(x.lines[0].get_ydata(), [321.0, 323.0, 324.0])
    np.testing.assert_array_equal(y.lines[0].get_ydata(), [239.0, 237.0, 236.0])
    assert focal.get_title() == 'focal length, px: 501.0 ± 2.0'
    assert [axes.lines[-1].get_ydata()[0] for axes in (focal, x, y)] == [500.0, 321.0, 238.0]
    assert focal.get_legend().get_texts()[0].get_text() == 'other'


def test_history_is_legible_after_a_very_uncertain_first_view():
    records = [record(1, 900.0, 400.0), record(2, 510.0, 4.0), record(3, 500.0, 1.0)]
    low, high = panels(records)[0].get_ylim()
    assert low < 499.0
    assert 514.0 < high < 530.0


def test_history_marks_parameters_held_fixed():
    records = [record(1, 520.0, 9.0, 0.0), record(2, 505.0, 3.0), record(3, 501.0, 2.0)]
    _, x, _ = panels(records)
    assert set(band(x)) == {2, 3}
    dots, circles = (line.get_xdata().tolist() for line in x.lines[1:])
    assert (dots, circles) == ([2, 3], [1])
    assert panels(records[:1])[1].get_title() == 'centre x, px: 321 (held)'


def test_history_marks_restarts():
    records = [record(n, 500.0, 2.0) for n in (1, 2, 3)]
    records[1] = replace(records[1], verdict=Verdict.RESTARTED)
    for axes in panels(records):
        assert axes.lines[-1].get_xdata() == [2, 2]


def test_history_without_a_camera_is_empty():
    without = replace(record(1, 500.0, 1.0), fused=None)
    assert all(not axes.lines for axes in panels([without]))


@pytest.fixture(scope='module')
def views(run):
    """Return the keyframes, one of them with two outliers."""
    first, *others = run.keyframes
    outliers = np.isin(np.arange(54), (3, 40))
    return [replace(first, inliers=~outliers), *others]


def test_report_shows_every_point_and_residual(views):
    corners, residuals = draw_report(views, SIZE, []).axes[:2]
    used = np.concatenate([view.image_points[view.inliers] for view in views])
    np.testing.assert_array_equal(np.column_stack(corners.lines[0].get_data()), used)
    outliers = views[0].image_points[[3, 40]]
    np.testing.assert_array_equal(np.column_stack(corners.lines[1].get_data()), outliers)
    assert corners.get_title().startswith(
        f'{len(used)} points of {len(views)} views, 2 outliers (crosses); '
    )
    [arrows] = [c for c in residuals.collections if hasattr(c, 'U')]
    np.testing.assert_array_equal(arrows.XY, used)
    expected = np.concatenate([view.residuals_px[view.inliers] for view in views])
    np.testing.assert_array_equal(np.column_stack([arrows.U, arrows.V]), expected)


def test_scale_bar_has_the_scale_of_the_arrows(views):
    residuals = draw_report(views, SIZE, []).axes[1]
    [arrows] = [c for c in residuals.collections if hasattr(c, 'U')]
    [bar] = residuals.lines
    [label] = [text.get_text() for text in residuals.texts]
    ends = bar.get_xdata()
    assert (ends[1] - ends[0]) * arrows.scale == pytest.approx(float(label.removesuffix(' px')))


def test_residuals_point_from_the_corner_to_the_reprojection(run):
    """From where the point is on the real board."""
    view, fused = run.keyframes[0], run.fused
    points = fused.board_shape(view.board).points(view.board_points)
    reprojected = fused.camera.project(view.camera_from_board.transform(points))
    np.testing.assert_allclose(reprojected - view.image_points, view.residuals_px, atol=1e-6)


def test_report_is_written_in_the_format_of_the_file_extension(run, tmp_path):
    drawn = run.calibration, run.records
    write_report(tmp_path / 'report.png', *drawn)
    assert read_image(tmp_path / 'report.png').shape == (1512, 1440, 3)
    write_report(tmp_path / 'report.svg', *drawn)
    assert ET.parse(tmp_path / 'report.svg').getroot().tag.endswith('svg')
    with pytest.raises(ConfigError, match=r'report\.jpg: expected a file name ending in'):
        write_report(tmp_path / 'report.jpg', *drawn)
    with pytest.raises(ConfigError, match='expected a writable path'):
        write_report(tmp_path / 'no' / 'report.png', *drawn)
