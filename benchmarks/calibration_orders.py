# Copyright 2026 p4pfr_ros maintainers
# SPDX-License-Identifier: Apache-2.0

"""
Self-calibration of real cameras in random orders of their views, and from disjoint halves.

    P4PFR_DATA=FOLDER python -m benchmarks.calibration_orders [--orders N] [--sets NAME ...]

Orders: whether a camera that was found, or CALIBRATED, is lost; how far the last camera of an
order is from that of the file order. Halves: the difference of two cameras from different views,
in its stated standard deviation.
"""

from __future__ import annotations

import argparse
from collections.abc import Sequence
import contextlib
from dataclasses import dataclass
import itertools
import math
import time

import numpy as np
from numpy.typing import NDArray
from p4pfr_ros import CalibrationState, CameraEstimate, PoseEstimate, SelfCalibration, Verdict
from p4pfr_ros.core.geometry import Array
from rich.console import Console
from rich.progress import track

from .corner_sets import CornerSet, NAMES, NO_CORNERS, read_corner_sets
from .tables import Measured, Row, table_of

# Under this name the shape of the board is estimated.
BOARD = 'board'

ORDERS = 10
ORDERS_NOTE = (
    'Orders: views of each set in random orders. Lost: a camera (CALIBRATED) before a view and '
    'none (another state) after it. Halves: two cameras from different views; z is their '
    'difference in units of the standard deviation that they state for it. Random halves are not '
    'independent of each other.'
)

_SEED = 0
_SIGMAS = 3.0
_WIDTH = 190


@dataclass(frozen=True, slots=True)
class Run:
    """
    One calibration, view by view: after each the state, verdict, camera (or None) and CPU time.

    estimates: of the pose of each view, as update returned it; None if it raised an exception.
    calibration: as it is after the last view.
    """

    calibration: SelfCalibration
    states: list[CalibrationState]
    verdicts: list[Verdict]
    cameras: list[CameraEstimate | None]
    seconds: list[float]
    estimates: list[PoseEstimate | None]

    @property
    def lost_cameras(self) -> int:
        """How often a camera was there before a view and none after it."""
        pairs = itertools.pairwise(self.cameras)
        return sum(before is not None and after is None for before, after in pairs)

    @property
    def lost_calibrated(self) -> int:
        """How often the state was CALIBRATED before a view and was not after it."""
        done = [state is CalibrationState.CALIBRATED for state in self.states]
        return sum(before and not after for before, after in itertools.pairwise(done))

    @property
    def first_calibrated(self) -> int | None:
        """The index of the first view after which the state is CALIBRATED."""
        calibrated = CalibrationState.CALIBRATED
        return self.states.index(calibrated) if calibrated in self.states else None

    def errors_while_calibrated(self) -> Array:
        """Return |f - last| / sigma, and of the centre, (V, 3), after views while CALIBRATED."""
        last = self.cameras[-1]
        return np.array(
            [
                _difference(camera, last, _sigmas(camera))
                for state, camera in zip(self.states, self.cameras, strict=True)
                if state is CalibrationState.CALIBRATED and camera and last
            ]
        ).reshape(-1, 3)


def main(arguments: list[str] | None = None) -> int:
    """Run the benchmark and print the tables."""
    parser = argparse.ArgumentParser(
        prog='python -m benchmarks.calibration_orders', description=__doc__.split('\n\n')[0]
    )
    parser.add_argument(
        '--orders', type=int, default=ORDERS, help='random orders and splits; default: %(default)s'
    )
    parser.add_argument(
        '--sets', nargs='+', choices=NAMES, default=NAMES, metavar='NAME', help='default: all'
    )
    given = parser.parse_args(arguments)
    sets = [corners for corners in read_corner_sets() if corners.name in given.sets]
    if not sets:
        parser.error(NO_CORNERS)
    console = Console()
    console.width = max(console.width, _WIDTH)  # do not truncate cells
    for table in (orders_table(sets, given.orders), halves_table(sets, given.orders)):
        console.print(table_of(*table))
    return 0


def calibrate(corners: CornerSet) -> Run:
    """Run self-calibration over the views of a set, in their order."""
    calibration = SelfCalibration(corners.image_size)
    run = Run(calibration, [], [], [], [], [])
    for i, view in enumerate(corners.views):
        board_points = corners.board_points[view.ids]
        estimate: PoseEstimate | None = None
        begin = time.process_time()
        with contextlib.suppress(ValueError):  # a defect, which the table counts
            estimate = calibration.update(view.image_points, board_points, i, board=BOARD)
        run.seconds.append(time.process_time() - begin)
        run.states.append(calibration.state)
        run.verdicts.append(calibration.verdict)
        run.cameras.append(calibration.fused)
        run.estimates.append(estimate)
    return run


def orders_table(sets: Sequence[CornerSet], orders: int) -> Measured:
    """Calibrate each set in random orders, and compare with the file order."""
    rows = [_orders_row(corners, orders) for corners in track(sets, 'orders', transient=True)]
    header = (
        'set',
        'state in\nfile order',
        'orders\nCALIBRATED',
        'times camera /\nCALIBRATED lost',
        'restarts',
        'exceptions',
        'OUTLIER,\nof views',
        'from file order,\nf / centre, max σ',
        'f - last at first\nCALIBRATED, max σ',
        'f / centre - last while\nCALIBRATED, max σ',
        'CALIBRATED\nat view',
    )
    return f'{orders} random orders and the file order', header, rows


def _orders_row(corners: CornerSet, orders: int) -> Row:
    rng = np.random.default_rng(_SEED)
    in_file_order = calibrate(corners)
    shuffled = [
        calibrate(corners.select(rng.permutation(len(corners.views)))) for _ in range(orders)
    ]
    runs = [in_file_order, *shuffled]
    verdicts = [verdict for run in runs for verdict in run.verdicts]
    reference = in_file_order.cameras[-1]
    spread = _matrix([_difference(run.cameras[-1], reference) for run in shuffled])
    errors = [run.errors_while_calibrated() for run in runs]
    at_first = [each[0, 0] for each in errors if len(each)]
    while_calibrated = np.concatenate(errors)
    first = [run.first_calibrated for run in runs]
    at_view = [i + 1 for i in first if i is not None]
    return (
        corners.name,
        in_file_order.states[-1].name,
        f'{sum(run.states[-1] is CalibrationState.CALIBRATED for run in runs)} of {len(runs)}',
        f'{sum(run.lost_cameras for run in runs)} / {sum(run.lost_calibrated for run in runs)}',
        str(verdicts.count(Verdict.RESTARTED)),
        str(sum(run.estimates.count(None) for run in runs)),
        f'{verdicts.count(Verdict.OUTLIER)} of {len(verdicts)}',
        f'{_largest(spread[:, 0])} / {_largest(spread[:, 1:])}',
        _largest(np.array(at_first)),
        f'{_largest(while_calibrated[:, 0])} / {_largest(while_calibrated[:, 1:])}',
        f'{min(at_view)} to {max(at_view)}' if at_view else '-',
    )


def halves_table(sets: Sequence[CornerSet], splits: int) -> Measured:
    """Calibrate from disjoint halves of each set: even and odd views, and random splits."""
    z = {
        corners.name: _matrix(
            [
                _difference_of_halves(corners, *halves)
                for halves in _splits(len(corners.views), splits)
            ]
        )
        for corners in track(sets, 'halves', transient=True)
    }
    rows = [_halves_row(name, each) for name, each in z.items()]
    rows.append(_halves_row('all', np.concatenate(list(z.values()))))
    header = (
        'set',
        'pairs\nof cameras',
        'z of f,\nrms',
        f'beyond\n{_SIGMAS:g} σ',
        'largest',
        'even - odd',
        'z of centre,\nrms',
        f'beyond\n{_SIGMAS:g} σ',
        'largest',
        'even - odd',
    )
    return f'Disjoint halves: even and odd views, {splits} random splits', header, rows


def _splits(views: int, count: int) -> list[tuple[NDArray[np.intp], NDArray[np.intp]]]:
    """Return even and odd views, and random halves, each in file order."""
    rng = np.random.default_rng(_SEED)
    everything = np.arange(views)
    splits = [(everything[::2], everything[1::2])]
    for _ in range(count):
        shuffled = rng.permutation(views)
        splits.append((np.sort(shuffled[: views // 2]), np.sort(shuffled[views // 2 :])))
    return splits


def _difference_of_halves(
    corners: CornerSet, one: NDArray[np.intp], other: NDArray[np.intp]
) -> Array:
    a, b = (calibrate(corners.select(half)).cameras[-1] for half in (one, other))
    return _difference(a, b, np.hypot(_sigmas(a), _sigmas(b)))


def _halves_row(name: str, z: Array) -> Row:
    known = z[np.isfinite(z[:, 0])]
    cells = [name, f'{len(known)} of {len(z)}']
    for each, first in ((known[:, :1], z[0, :1]), (known[:, 1:], z[0, 1:])):
        beyond = int(np.count_nonzero(each > _SIGMAS))
        rms = math.sqrt(np.mean(each**2)) if each.size else math.nan
        even_odd = ', '.join(f'{value:.2f}' for value in first) if name != 'all' else ''
        cells += [
            f'{rms:.2f}',
            f'{beyond} of {each.size}',
            _largest(each),
            even_odd,
        ]
    return tuple(cells)


def _difference(
    a: CameraEstimate | None, b: CameraEstimate | None, sigmas: Array | None = None
) -> Array:
    """Return |a - b| / sigma (3,) of f and centre; NaN without a camera. sigmas: default, of b."""
    if a is None or b is None:
        return np.full(3, np.nan)
    difference: Array = np.abs(_numbers(a) - _numbers(b))
    return difference / (_sigmas(b) if sigmas is None else sigmas)


def _numbers(estimate: CameraEstimate) -> Array:
    return np.array([estimate.camera.focal_px, *estimate.camera.center_px])


def _sigmas(estimate: CameraEstimate | None) -> Array:
    if estimate is None:
        return np.full(3, np.nan)
    return np.array([estimate.focal_sigma_px, *estimate.center_sigma_px])


def _matrix(rows: Sequence[Array]) -> Array:
    return np.array(rows).reshape(-1, 3)


def _largest(values: Array) -> str:
    """Print the largest finite value, and how many are missing."""
    finite = values[np.isfinite(values)]
    missing = values.size - finite.size
    none = f' ({missing} none)' if missing else ''
    return (f'{finite.max():.2f}' if finite.size else '-') + none


if __name__ == '__main__':
    raise SystemExit(main())
