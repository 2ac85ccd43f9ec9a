# Copyright 2026 p4pfr_ros maintainers
# SPDX-License-Identifier: Apache-2.0

"""
The report of a calibration as one HTML file, which loads nothing else.

This module stands alone: it writes the page; ``html_figures`` draws its figures.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from html import escape
import math
from pathlib import Path

import numpy as np
from p4pfr_ros import (
    __version__,
    CalibrationOptions,
    CalibrationState,
    CameraEstimate,
    Keyframe,
    SelfCalibration,
    Verdict,
)
from p4pfr_ros.files.calibration import Calibration
from p4pfr_ros.files.writing import write_atomically
from p4pfr_ros.files.yaml_fields import ConfigError
from p4pfr_ros.report.calibration_run import CalibrationRun, RejectedImage, ViewRecord
from p4pfr_ros.report.comparison import CameraDifference, compare_cameras
from p4pfr_ros.report.html_figures import (
    board_figure,
    comparison_figures,
    convergence_figures,
    coverage_figure,
    distortion_figure,
    Figure,
    MAP_CELLS,
    residuals_figure,
    uncertainty_figure,
)
from p4pfr_ros.report.maps import map_shape
from p4pfr_ros.report.number_format import lens_terms, plus_minus, shape_text
from p4pfr_ros.report.svg import embedded

_STYLE = Path(__file__).with_name('report.css')
# With more images than this, views that did not change the camera get no row.
_MAX_ROWS = 200
_NO_CHANGE = (Verdict.REDUNDANT, Verdict.NO_POSE)
# A report warns of less coverage, of a larger scatter, and of more outliers.
_SMALL_COVERAGE, _LARGE_SCATTER, _MANY_OUTLIERS = 0.6, 9.0, 0.1


@dataclass(frozen=True, slots=True, eq=False)
class OtherCamera:
    """A camera to compare with, and its name."""

    name: str
    calibration: Calibration


def write_html_report(
    path: Path, run: CalibrationRun, calibration: Calibration, other: OtherCamera | None = None
) -> None:
    """
    Write the report of a calibration.

    Parameters
    ----------
    path
        The file to write.
    run
        The images; its thumbnails are shown if there are any.
    calibration
        The camera, with its estimate.
    other
        A camera to compare with.

    Raises
    ------
    ConfigError
        The path is not writable, or the other camera has another image size.

    """
    assert run.calibration is not None
    assert calibration.estimate is not None
    difference = None if other is None else _difference(calibration, other)
    parts = [
        _summary(run, run.calibration, calibration.estimate),
        _camera_section(calibration, calibration.estimate, run.calibration.options),
        *_comparison_section(calibration, other, difference),
        _section('Over the image', _figures(_image_figures(run.calibration, calibration))),
        _section('Over the images', _figures(convergence_figures(run.records), 'three')),
        *_board_section(run.calibration.views, calibration.estimate),
        _views_section(run),
        *_rejected_section(run),
    ]
    write_atomically(path, _page(calibration.camera_name, ''.join(parts)))


def _page(name: str, body: str) -> str:
    # The policy holds even if a name of a file slipped through the escaping.
    policy = "default-src 'none'; img-src data:; style-src 'unsafe-inline'"
    return f"""<!DOCTYPE html>
<html lang="en">
<head>
<meta charset="utf-8">
<meta http-equiv="Content-Security-Policy" content="{policy}">
<meta name="viewport" content="width=device-width, initial-scale=1">
<meta name="color-scheme" content="light dark">
<meta name="generator" content="p4pfr_ros {__version__}">
<title>Calibration of {escape(name)}</title>
<link rel="icon" href="data:,">
<style>
{_STYLE.read_text()}</style>
</head>
<body>
<header><h1>Calibration of “{escape(name)}”</h1></header>
<main>
{body}</main>
<footer>p4pfr_ros {__version__}</footer>
</body>
</html>
"""


def _section(title: str, html: str, kind: str = '') -> str:
    name = title.lower().replace(' ', '-')
    return (
        f'<section id="{name}" class="{kind}" aria-labelledby="{name}-title">'
        f'<h2 id="{name}-title">{escape(title)}</h2>{html}</section>\n'
    )


def _figures(figures: Sequence[Figure], kind: str = 'two') -> str:
    cells = ''.join(
        f'<figure><h3>{escape(figure.title)}</h3>{figure.html}'
        f'<figcaption>{escape(figure.caption)}</figcaption></figure>'
        for figure in figures
    )
    return f'<div class="figures {kind}">{cells}</div>'


def _summary(run: CalibrationRun, calibration: SelfCalibration, estimate: CameraEstimate) -> str:
    is_calibrated = calibration.state is CalibrationState.CALIBRATED
    sentences = ''.join(f'<li>{escape(each)}</li>' for each in _sentences(run, estimate))
    warnings = ''.join(
        f'<li class="warning">{escape(each)}</li>'
        for each in _warnings(run, calibration, estimate)
    )
    state = f'<p class="state {"good" if is_calibrated else "bad"}">{calibration.state.value}</p>'
    return _section('Summary', f'{state}<ul>{sentences}{warnings}</ul>', 'summary')


def _sentences(run: CalibrationRun, estimate: CameraEstimate) -> Iterator[str]:
    """Say in words what matters."""
    images, camera = len(run.records) + len(run.rejected), estimate.camera
    share = 100.0 * estimate.focal_sigma_px / camera.focal_px
    yield (
        f'The camera was estimated from {estimate.views} views; {len(run.rejected)} of {images} '
        'images were rejected.'
    )
    yield (
        f'The focal length is {plus_minus(camera.focal_px, estimate.focal_sigma_px)} px: known to '
        f'{share:.2g} %.'
    )
    yield (
        f'Where points were seen, a projection is known to {estimate.projection_sigma_px:.2g} px '
        'at worst.'
    )
    yield (
        f'The views are reprojected with {estimate.rms_px:.3f} px rms. Points cover '
        f'{100.0 * run.coverage:.0f} % of the image.'
    )
    for name, shape in estimate.board_shapes.items():
        is_only = len(estimate.board_shapes) == 1
        yield f'{"The board" if is_only else f"Board {name}"} is {shape_text(shape)}.'


def _warnings(
    run: CalibrationRun, calibration: SelfCalibration, estimate: CameraEstimate
) -> Iterator[str]:
    """Say in words what a user should not overlook."""
    for advice in calibration.missing:
        yield f'Missing: {advice}.'
    if run.coverage < _SMALL_COVERAGE:
        yield (
            f'{100.0 * (1.0 - run.coverage):.0f} % of the image holds no points. There the lens '
            'is extrapolated: take views that reach the borders.'
        )
    if estimate.scatter > _LARGE_SCATTER:
        yield (
            'The camera differs between the views by more than noise explains (chi-square per '
            f'degree of freedom {estimate.scatter:.1f}): the board may bend, or the camera have '
            'a rolling shutter. All uncertainties include it.'
        )
    inliers = sum(int(view.inliers.sum()) for view in calibration.views)
    points = sum(len(view.inliers) for view in calibration.views)
    if points - inliers > _MANY_OUTLIERS * points:
        yield f'{100.0 * (points - inliers) / points:.0f} % of the points are outliers.'
    disagreeing = sum(record.verdict is Verdict.OUTLIER for record in run.records)
    if disagreeing:
        yield f'{disagreeing} views disagree with the camera and are not used.'
    if any(record.verdict is Verdict.RESTARTED for record in run.records):
        yield 'The camera changed (zoom, focus?); the images before are not used.'


def _camera_section(
    calibration: Calibration, estimate: CameraEstimate, options: CalibrationOptions
) -> str:
    rows = ''.join(
        f'<tr><th scope="row">{escape(name)}</th><td>{escape(value)}</td>'
        f'<td>{escape(tolerance)}</td></tr>'
        for name, value, tolerance in _camera_rows(calibration, estimate, options)
    )
    table = (
        '<table class="camera"><thead><tr><th scope="col">quantity</th>'
        '<th scope="col">value ± σ</th><th scope="col">tolerated σ</th></tr></thead>'
        f'<tbody>{rows}</tbody></table>'
    )
    model = calibration.model
    d = ', '.join(f'{each + 0.0:.6g}' for each in model.coefficients)
    (fx, fy), (cx, cy) = model.focal_px, model.center_px
    info = (
        '<h3>As CameraInfo</h3><dl>'
        f'<dt>distortion_model</dt><dd>{escape(model.distortion_model)}</dd>'
        f'<dt>K</dt><dd>fx {fx:.3f}, fy {fy:.3f}, cx {cx:.3f}, cy {cy:.3f}</dd>'
        f'<dt>D</dt><dd class="wide">[{d}]</dd>'
        f'<dt>differs by</dt><dd>{model.residual_px:.2g} px at most where seen, '
        f'{model.residual_outside_px:.2g} px outside</dd></dl>'
    )
    return _section('Camera', f'<div class="scroll">{table}</div>{info}')


def _camera_rows(
    calibration: Calibration, estimate: CameraEstimate, options: CalibrationOptions
) -> Iterator[tuple[str, str, str]]:
    camera, (width, height) = estimate.camera, calibration.image_size
    x, y = map(plus_minus, camera.center_px, estimate.center_sigma_px)
    center_px = options.center_tolerance * math.hypot(width, height)
    yield 'image size', f'{width} × {height} px', ''
    focal = f'{plus_minus(camera.focal_px, estimate.focal_sigma_px)} px'
    yield 'focal length', focal, f'{options.focal_tolerance * camera.focal_px:.2g} px'
    yield 'centre x', f'{x} px', f'{center_px:.2g} px'
    yield 'centre y', f'{y} px', f'{center_px:.2g} px'
    for name, value, sigma in lens_terms(estimate):
        yield name, plus_minus(value, sigma), ''
    projection = f'{estimate.projection_sigma_px:.2g} px at most where seen'
    yield 'projection', projection, f'{options.projection_tolerance_px:.2g} px'
    yield 'reprojection error', f'{estimate.rms_px:.3f} px rms', ''
    yield 'scatter', f'{estimate.scatter:.2f}', ''


def _difference(calibration: Calibration, other: OtherCamera) -> CameraDifference:
    """
    Return the difference of the cameras.

    Raises
    ------
    ConfigError
        Their image sizes differ.

    """
    assert calibration.estimate is not None
    if other.calibration.image_size != calibration.image_size:
        expected, got = (
            '{}x{}'.format(*each.image_size) for each in (calibration, other.calibration)
        )
        raise ConfigError(f'{other.name}: expected a camera of {expected} px, got {got}')
    camera = (
        other.calibration.model
        if other.calibration.estimate is None
        else other.calibration.estimate.camera
    )
    width, height = calibration.image_size
    shape = map_shape(height, width, MAP_CELLS)
    return compare_cameras(calibration.estimate, camera, calibration.image_size, shape)


def _comparison_section(
    calibration: Calibration, other: OtherCamera | None, difference: CameraDifference | None
) -> Iterator[str]:
    if other is None or difference is None:
        return
    estimate = calibration.estimate
    assert estimate is not None
    words = (
        f'Compared with {other.name}: where points were seen, the projections differ by '
        f'{difference.largest_px:.2g} px at most, and this camera is known to '
        f'{estimate.projection_sigma_px:.2g} px (standard deviation). A turn of '
        f'{difference.turn_deg:.2g}° between the cameras is taken out: no observation can tell it.'
    )
    figures = comparison_figures(difference, estimate, calibration.image_size)
    yield _section('Comparison', f'<p>{escape(words)}</p>{_figures(figures)}')


def _image_figures(calibration: SelfCalibration, saved: Calibration) -> list[Figure]:
    estimate, size = saved.estimate, saved.image_size
    assert estimate is not None
    return [
        uncertainty_figure(estimate, size, calibration.options.projection_tolerance_px),
        coverage_figure(calibration.views, size),
        residuals_figure(calibration.views, size),
        distortion_figure(estimate, size),
    ]


def _board_section(views: Sequence[Keyframe], estimate: CameraEstimate) -> Iterator[str]:
    figures = []
    for name, shape in estimate.board_shapes.items():
        points = [view.board_points for view in views if view.board == name]
        if points:
            figures.append(board_figure(name, shape, np.unique(np.concatenate(points), axis=0)))
    if figures:
        yield _section('Shape of the board' + 's' * (len(figures) > 1), _figures(figures))


def _views_section(run: CalibrationRun) -> str:
    shown, left_out = list(run.records), 0
    if len(shown) > _MAX_ROWS:
        shown = [record for record in shown if record.verdict not in _NO_CHANGE]
        left_out = len(run.records) - len(shown)
    keyframes = {view.stamp: view for view in run.keyframes}
    rows = ''.join(
        _view_row(record, keyframes.get(record.number), run.thumbnails.get(record.number))
        for record in shown
    )
    headings = ('image', 'points', 'rms, px', 'tilt', 'distance', 'focal length, px', 'verdict')
    head = ''.join(f'<th scope="col">{each}</th>' for each in headings)
    counts = Counter(record.verdict for record in run.records).most_common()
    words = ''.join(
        f'<li>{count} {verdict.name.lower()}: {verdict.value}</li>' for verdict, count in counts
    )
    note = f'<p>{left_out} views that did not change the camera have no row.</p>'
    return _section(
        'Views',
        f'<ul>{words}</ul>{note if left_out else ""}<div class="scroll"><table class="views">'
        f'<thead><tr><th scope="col"></th>{head}</tr></thead><tbody>{rows}</tbody></table></div>',
    )


def _view_row(record: ViewRecord, keyframe: Keyframe | None, small: bytes | None) -> str:
    """Return a row: of a keyframe with its residuals in the last fit, of others when they came."""
    rms_px, tilt, distance = record.rms_px, '', ''
    inliers = record.inliers
    if keyframe is not None:
        pose, rms_px = keyframe.camera_from_board, keyframe.rms_px
        inliers = int(keyframe.inliers.sum())
        tilt, distance = f'{pose.tilt_deg:.0f}°', f'{pose.distance:.3g} m'
    fused = record.fused
    focal = plus_minus(fused.camera.focal_px, fused.focal_sigma_px) if fused else ''
    word = record.verdict.name.lower()
    cells = (
        _name_cell(record.number, record.name),
        f'{inliers} of {record.points}' if inliers < record.points else str(record.points),
        f'{rms_px:.3f}',
        tilt,
        distance,
        focal,
        f'<span class="verdict {word}" title="{record.verdict.value}">{word}</span>',
    )
    return f'<tr><td>{_image(small)}</td>{"".join(f"<td>{cell}</td>" for cell in cells)}</tr>'


def _rejected_section(run: CalibrationRun) -> Iterator[str]:
    if not run.rejected:
        return
    rows = ''.join(_rejected_row(each, run) for each in run.rejected[:_MAX_ROWS])
    counts = Counter(each.reason for each in run.rejected).most_common()
    words = ''.join(f'<li>{count}: {escape(reason)}</li>' for reason, count in counts)
    table = (
        '<div class="scroll"><table class="views"><thead><tr><th scope="col"></th>'
        '<th scope="col">image</th><th scope="col">reason</th></tr></thead>'
        f'<tbody>{rows}</tbody></table></div>'
    )
    yield _section('Rejected images', f'<ul>{words}</ul>{table}')


def _rejected_row(rejected: RejectedImage, run: CalibrationRun) -> str:
    return (
        f'<tr><td>{_image(run.thumbnails.get(rejected.number))}</td>'
        f'<td>{_name_cell(rejected.number, rejected.name)}</td>'
        f'<td class="reason">{escape(rejected.reason)}</td></tr>'
    )


def _name_cell(number: int, name: str) -> str:
    return f'<span class="number">{number}</span> <span class="name">{escape(name)}</span>'


def _image(small: bytes | None) -> str:
    return '' if small is None else f'<img alt="" loading="lazy" src="{embedded(small, "jpeg")}">'
