# Copyright 2026 p4pfr_ros maintainers
# SPDX-License-Identifier: Apache-2.0

"""Answers as a table for people and as JSON lines for programs."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
import json
import sys
from typing import Any

from p4pfr_ros import Observability, Solution
from p4pfr_ros.cli.answers import Answer, distance_m, NoAnswer, tilt_deg

_HEADINGS = (
    'x y z, m',
    'quaternion x y z w',
    'tilt, °',
    'distance, m',
    'f, px',
    'k',
    'rms, px',
    'inliers',
)
_UNKNOWN = '?'
_ALL = Observability(direction=True, distance=True, focal=True, distortion=True)
# Wide enough for every row, where no terminal says how wide it is.
_WIDTH_IN_A_FILE = 200


def print_json_line(answer: Answer | NoAnswer) -> None:
    """Print one line: a JSON object without NaN, null where the view cannot tell."""
    if isinstance(answer, NoAnswer):
        line: dict[str, Any] = {'image': str(answer.path), 'reason': answer.reason}
    else:
        line = _as_json(answer)
    print(json.dumps(line, allow_nan=False), flush=True)


def _as_json(answer: Answer) -> dict[str, Any]:
    estimate = answer.estimate
    seen = estimate.observable
    return {
        'image': str(answer.path),
        'image_size': list(answer.image_size),
        **_solution_as_json(answer.model, seen),
        'sigma': {
            'distance_m': answer.distance_sigma_m if seen.distance else None,
            'focal_px': answer.focal_sigma_px if seen.focal else None,
            'k': answer.k_sigma if seen.distortion else None,
        },
        'rms_px': estimate.rms_px,
        'points': len(estimate.inliers),
        'inliers': int(estimate.inliers.sum()),
        'not_observable': answer.not_observable,
        'candidates': [_solution_as_json(candidate, _ALL) for candidate in _candidates(answer)],
    }


def _candidates(answer: Answer) -> list[Solution]:
    """Return all the solutions that explain the view as well as the best one, if there are any."""
    alternatives = list(answer.estimate.alternatives)
    return [answer.model, *alternatives] if alternatives else []


def _solution_as_json(solution: Solution, seen: Observability) -> dict[str, Any]:
    pose, camera = solution.camera_from_board, solution.camera
    return {
        'position_m': pose.translation.tolist() if seen.distance else None,
        'quaternion_xyzw': pose.quaternion_xyzw().tolist() if seen.direction else None,
        'tilt_deg': tilt_deg(pose) if seen.direction else None,
        'distance_m': distance_m(pose) if seen.distance else None,
        'focal_px': camera.focal_px if seen.focal else None,
        'k': camera.k if seen.distortion else None,
        'center_px': list(camera.center_px),
    }


def print_table(answers: Sequence[Answer]) -> None:
    """Print a row for each answer, and below them what some views cannot tell."""
    if not answers:
        return
    from rich import box
    from rich.console import Console
    from rich.table import Table
    from rich.text import Text

    on_screen = sys.stdout.isatty()
    console = Console(width=None if on_screen else _WIDTH_IN_A_FILE, highlight=False)
    table = Table(box=box.SIMPLE_HEAD, pad_edge=False)
    table.add_column('picture', overflow='fold')
    for heading in _HEADINGS:
        table.add_column(heading, justify='right')
    for answer in answers:
        table.add_row(Text(str(answer.path)), *_cells(answer))
    console.print(table)
    for note in _notes(answers):
        console.print(note, markup=False, soft_wrap=True)


def _cells(answer: Answer) -> Iterable[str]:
    estimate, pose = answer.estimate, answer.model.camera_from_board
    seen, camera = estimate.observable, answer.model.camera
    yield _numbers(pose.translation, 3) if seen.distance else _UNKNOWN
    yield _numbers(pose.quaternion_xyzw(), 3) if seen.direction else _UNKNOWN
    yield f'{tilt_deg(pose):.1f}' if seen.direction else _UNKNOWN
    yield f'{distance_m(pose):.3f}' if seen.distance else _UNKNOWN
    yield f'{camera.focal_px:.1f} ± {answer.focal_sigma_px:.1f}' if seen.focal else _UNKNOWN
    yield f'{camera.k:.3f} ± {answer.k_sigma:.3f}' if seen.distortion else _UNKNOWN
    yield f'{estimate.rms_px:.2f}'
    yield f'{estimate.inliers.sum()}/{len(estimate.inliers)}'


def _numbers(values: Iterable[float], digits: int) -> str:
    return ' '.join(f'{value:.{digits}f}' for value in values)


def _notes(answers: Iterable[Answer]) -> Iterable[str]:
    for answer in answers:
        if answer.not_observable:
            yield f'{answer.path}: this view does not tell: ' + ', '.join(answer.not_observable)
        candidates = len(_candidates(answer))
        if candidates:
            yield f'{answer.path}: {candidates} solutions explain this view as well (see --json)'
