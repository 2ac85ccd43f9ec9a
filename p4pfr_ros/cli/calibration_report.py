# Copyright 2026 p4pfr_ros maintainers
# SPDX-License-Identifier: Apache-2.0

"""A calibration's views as a table, its result as a summary, and both as JSON lines."""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterable, Sequence
import json
import math
import sys
from typing import Any

import numpy as np
from p4pfr_ros import CameraEstimate, Verdict
from p4pfr_ros.files.calibration import Calibration
from p4pfr_ros.report.calibration_run import coverage, Miss, PictureCalibration, Sighting
from p4pfr_ros.report.numbers import plus_minus

_HEADINGS = ('points', 'inliers', 'rms, px', 'f, px', 'verdict')
_UNKNOWN = '?'
# Wide enough for every row, where no terminal says how wide it is.
_WIDTH_IN_A_FILE = 200
# Of more views than this, those that changed nothing are counted only.
_MOST_ROWS = 100
_CHANGED_NOTHING = (Verdict.REDUNDANT, Verdict.NO_POSE)


def print_view_json(seen: Sighting | Miss) -> None:
    """Print one line about a picture: a JSON object without NaN."""
    line: dict[str, Any] = {'picture': seen.number, 'name': seen.name}
    if isinstance(seen, Miss):
        line |= {'reason': seen.reason}
    else:
        line |= {
            'points': seen.points,
            'inliers': seen.inliers,
            'rms_px': seen.rms_px,
            'verdict': _word(seen.verdict),
            'camera': _camera_as_json(seen.fused) if seen.fused else None,
        }
    print(json.dumps(line, allow_nan=False), flush=True)


def print_calibration_json(pictures: PictureCalibration, calibration: Calibration | None) -> None:
    """Print one line about the result."""
    line: dict[str, Any] = {'calibration': None}
    if calibration is not None and pictures.calibration is not None and pictures.fused is not None:
        model = calibration.model
        line['calibration'] = {
            'state': pictures.calibration.state.name.lower(),
            'image_size': list(calibration.image_size),
            **_camera_as_json(pictures.fused),
            'coverage': _coverage(pictures),
            'camera_info': {
                'distortion_model': model.distortion_model,
                'd': list(model.coefficients),
                'focal_px': list(model.focal_px),
                'center_px': list(model.center_px),
                'residual_px': model.residual_px,
            },
        }
    print(json.dumps(line, allow_nan=False), flush=True)


def _camera_as_json(estimate: CameraEstimate) -> dict[str, Any]:
    camera = estimate.camera
    sigmas = [sigma or None for sigma in _sigmas(estimate)]
    return {
        'focal_px': camera.focal_px,
        'center_px': list(camera.center_px),
        'k': [camera.k, camera.k2, camera.k3],
        'sigma': {'focal_px': sigmas[0], 'center_px': sigmas[1:3], 'k': sigmas[3:]},
        'rms_px': estimate.rms_px,
        'views': estimate.views,
    }


def print_views(pictures: PictureCalibration) -> None:
    """Print a row for each view; of very many, only for those that changed something."""
    sightings = pictures.sightings
    if not sightings:
        return
    from rich import box
    from rich.console import Console
    from rich.table import Table
    from rich.text import Text

    console = Console(width=None if sys.stdout.isatty() else _WIDTH_IN_A_FILE, highlight=False)
    table = Table(box=box.SIMPLE_HEAD, pad_edge=False)
    table.add_column('', justify='right')
    table.add_column('picture', overflow='fold')
    for heading in _HEADINGS:
        table.add_column(heading, justify='left' if heading == 'verdict' else 'right')
    for seen in _worth_a_row(sightings):
        table.add_row(str(seen.number), Text(seen.name), *_cells(seen))
    console.print(table)
    for verdict, count in Counter(seen.verdict for seen in sightings).most_common():
        print(f'{count} {_word(verdict)}: {verdict.value}')
    print()


def _worth_a_row(sightings: Sequence[Sighting]) -> Sequence[Sighting]:
    if len(sightings) <= _MOST_ROWS:
        return sightings
    return [seen for seen in sightings if seen.verdict not in _CHANGED_NOTHING]


def _cells(seen: Sighting) -> Iterable[str]:
    yield str(seen.points)
    yield str(seen.inliers)
    yield f'{seen.rms_px:.3f}'
    fused = seen.fused
    yield plus_minus(fused.camera.focal_px, fused.focal_sigma_px) if fused else _UNKNOWN
    yield _word(seen.verdict)


def print_misses(misses: Sequence[Miss], bag: str | None) -> None:
    """Say on stderr why pictures could not be used: those of a bag by how many there are."""
    if bag is None:
        for miss in misses:
            print(f'p4pfr: {miss.name}: {miss.reason}', file=sys.stderr)
        return
    for reason, count in Counter(miss.reason for miss in misses).most_common():
        pictures = 'picture' if count == 1 else 'pictures'
        print(f'p4pfr: {bag}: {count} {pictures}: {reason}', file=sys.stderr)


def print_summary(pictures: PictureCalibration, calibration: Calibration | None) -> None:
    """Print the camera with its standard deviations, and how it will go into a CameraInfo."""
    if calibration is None or pictures.calibration is None or pictures.fused is None:
        return
    fused, model = pictures.fused, calibration.model
    f_sigma, x_sigma, y_sigma, *k_sigmas = _sigmas(fused)
    x, y = fused.camera.center_px
    width, height = calibration.image_size
    print(f'{pictures.calibration.state.value}')
    print(f'  views        {fused.views} of {width}x{height} px, rms {fused.rms_px:.3f} px')
    print(f'  focal length {plus_minus(fused.camera.focal_px, f_sigma)} px')
    print(f'  centre       {plus_minus(x, x_sigma)}, {plus_minus(y, y_sigma)} px')
    ks = (fused.camera.k, fused.camera.k2, fused.camera.k3)
    for name, k, sigma in zip(('k', 'k2', 'k3'), ks, k_sigmas, strict=True):
        if name == 'k' or k != 0.0:
            print(f'  {name:<12} {plus_minus(k, sigma)}')
    print(f'  coverage     {100.0 * _coverage(pictures):.0f} % of the picture')
    print(f'  CameraInfo   {model.distortion_model}, {model.residual_px:.2g} px from the above')


def _coverage(pictures: PictureCalibration) -> float:
    """Return the share of the picture's cells that hold a point."""
    if pictures.calibration is None or not pictures.views:
        return 0.0
    points = np.concatenate([view.image_points[view.inliers] for view in pictures.views])
    return float((coverage(points, pictures.calibration.image_size) > 0).mean())


def _sigmas(estimate: CameraEstimate) -> list[float]:
    """Return the standard deviations of f, centre x and y, k, k2 and k3; 0 where held."""
    return [math.sqrt(max(0.0, float(v))) for v in np.diag(estimate.covariance)]


def _word(verdict: Verdict) -> str:
    return verdict.name.lower()
