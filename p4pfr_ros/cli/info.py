# Copyright 2026 p4pfr_ros maintainers
# SPDX-License-Identifier: Apache-2.0

"""``p4pfr info``: what is in a calibration file."""

from __future__ import annotations

import argparse
from collections.abc import Iterator
import json
import math
from pathlib import Path
from typing import Any

import numpy as np
from p4pfr_ros import CameraEstimate, CameraInfoModel
from p4pfr_ros.core.geometry import Array
from p4pfr_ros.files.calibration import Calibration, load_calibration
from p4pfr_ros.report.camera_json import camera_info_as_json, estimate_as_json
from p4pfr_ros.report.number_format import lens_terms, plus_minus, shape_text

_EPILOG = """\
Reads the files of p4pfr calibrate, pose_node, camera_calibration and
camera_info_manager. Fields of view are between the outermost pixels. The
picture of the coverage shows where in the image (#) points were seen.
"""
_WIDTH = 13


def add_parser(commands: argparse._SubParsersAction[argparse.ArgumentParser]) -> None:
    """Add the command to the parser."""
    text = 'print what is in a calibration file'
    parser = commands.add_parser(
        'info',
        help=text,
        description=f'{text[0].upper()}{text[1:]}.',
        epilog=_EPILOG,
        formatter_class=argparse.RawDescriptionHelpFormatter,
    )
    parser.set_defaults(run=run)
    parser.add_argument('camera', type=Path, metavar='CAMERA', help='calibration file (YAML)')
    parser.add_argument('--json', action='store_true', help='print a JSON object')


def run(arguments: argparse.Namespace) -> int:
    """Print the calibration."""
    calibration = load_calibration(arguments.camera)
    if arguments.json:
        print(json.dumps(_as_json(calibration), allow_nan=False))
        return 0
    for name, text in _lines(calibration):
        print(f'{name:<{_WIDTH}}{text}')
    return 0


def _lines(calibration: Calibration) -> Iterator[tuple[str, str]]:
    """Yield the names and texts of the lines."""
    width, height = calibration.image_size
    model, estimate = calibration.model, calibration.estimate
    yield 'camera', f'{calibration.camera_name}, {width}x{height} px'
    fields = _fields_of_view_deg(calibration)
    yield 'view', ', '.join(f'{name} {angle:.1f}°' for name, angle in fields.items())
    yield from _model_lines(model)
    if estimate is not None:
        yield from _estimate_lines(estimate, model)


def _model_lines(model: CameraInfoModel) -> Iterator[tuple[str, str]]:
    yield 'CameraInfo', model.distortion_model
    (fx, fy), (cx, cy) = model.focal_px, model.center_px
    yield '  K', f'fx {fx:.3f}, fy {fy:.3f}, cx {cx:.3f}, cy {cy:.3f} px'
    yield '  D', ', '.join(f'{number:.6g}' for number in model.coefficients)


def _estimate_lines(estimate: CameraEstimate, model: CameraInfoModel) -> Iterator[tuple[str, str]]:
    """Yield the lines of what only this package writes."""
    camera = estimate.camera
    x, y = map(plus_minus, camera.center_px, estimate.center_sigma_px)
    where = f'{model.residual_px:.2g} px where seen, {model.residual_outside_px:.2g} px outside'
    yield '  residual', f'{where}, to the division model'
    yield 'division', f'{estimate.views} views, rms {estimate.rms_px:.3f} px'
    yield '  focal', f'{plus_minus(camera.focal_px, estimate.focal_sigma_px)} px'
    yield '  centre', f'{x}, {y} px'
    for name, value, sigma in lens_terms(estimate):
        yield f'  {name}', plus_minus(value, sigma)
    yield '  scatter', f'{estimate.scatter:.2f}'
    if not math.isnan(estimate.projection_sigma_px):
        yield 'projection', f'{estimate.projection_sigma_px:.2g} px at most where seen'
    for name, shape in estimate.board_shapes.items():
        yield 'board', f'{name}: {shape_text(shape)}'
    if estimate.coverage is not None:
        rows = (''.join('#' if seen else '.' for seen in row) for row in estimate.coverage)
        for i, row in enumerate(rows):
            yield '' if i else 'coverage', row


def _fields_of_view_deg(calibration: Calibration) -> dict[str, float]:
    """Return the angles between rays of opposite pixels at the edges of the image."""
    width, height = calibration.image_size
    camera = calibration.estimate.camera if calibration.estimate else calibration.model
    right, bottom = width - 1.0, height - 1.0
    pairs = {
        'horizontal': ((0.0, 0.5 * bottom), (right, 0.5 * bottom)),
        'vertical': ((0.5 * right, 0.0), (0.5 * right, bottom)),
        'diagonal': ((0.0, 0.0), (right, bottom)),
    }
    rays = {name: camera.unproject(np.array(pair)) for name, pair in pairs.items()}
    # Pixels beyond the image circle of a fisheye see nothing.
    seen = {name: pair for name, pair in rays.items() if np.isfinite(pair).all()}
    return {name: _angle_deg(*pair) for name, pair in seen.items()}


def _angle_deg(one: Array, other: Array) -> float:
    """Return the angle between two rays, measured through the optical axis."""
    axis = np.array([0.0, 0.0, 1.0])
    angles = [np.arctan2(np.linalg.norm(np.cross(ray, axis)), ray @ axis) for ray in (one, other)]
    return math.degrees(float(sum(angles)))


def _as_json(calibration: Calibration) -> dict[str, Any]:
    model, estimate = calibration.model, calibration.estimate
    tree: dict[str, Any] = {
        'camera_name': calibration.camera_name,
        'image_size': list(calibration.image_size),
        'field_of_view_deg': _fields_of_view_deg(calibration),
        'camera_info': camera_info_as_json(model),
    }
    return tree | {'division': estimate_as_json(estimate) if estimate else None}
