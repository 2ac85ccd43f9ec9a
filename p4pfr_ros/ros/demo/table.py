# Copyright 2026 p4pfr_ros maintainers
# SPDX-License-Identifier: Apache-2.0

"""
The output of the demo: a live table on a terminal, otherwise a line every two seconds.

This module stands alone: it has the text and layout of the output.
"""

from __future__ import annotations

from contextlib import AbstractContextManager
import time

from p4pfr_ros import DivisionCamera
from p4pfr_ros.core.geometry import Array
from rich.console import Console
from rich.live import Live
from rich.table import Table

from .views import DemoView, Errors, median_errors

_LINE_PERIOD_S = 2.0


class Screen(AbstractContextManager['Screen']):
    """
    Shows the estimate and the truth of the latest view.

    Parameters
    ----------
    console
        The console to write to.
    camera
        The true camera.

    """

    def __init__(self, console: Console, camera: DivisionCamera) -> None:
        self._console = console
        self._camera = camera
        self._live = Live(console=console, refresh_per_second=8) if console.is_terminal else None
        self._printed_s = -_LINE_PERIOD_S

    def __enter__(self) -> Screen:
        if self._live is not None:
            self._live.start()
        return self

    def __exit__(self, *_: object) -> None:
        if self._live is not None:
            self._live.stop()

    def show(self, view: DemoView, errors: list[Errors]) -> None:
        """Show the latest view and the median of all errors."""
        if self._live is not None:
            self._live.update(_table(view, self._camera, errors))
        elif time.monotonic() - self._printed_s >= _LINE_PERIOD_S:
            self._printed_s = time.monotonic()
            self._console.print(_line(view, self._camera, errors), highlight=False, soft_wrap=True)


def _table(view: DemoView, camera: DivisionCamera, errors: list[Errors]) -> Table:
    table = Table(title=f'{len(errors)} views, each estimated from a single image')
    for heading in ('', 'estimate', 'truth', 'error', 'median error'):
        table.add_column(heading, justify='right')
    now, median = errors[-1], median_errors(errors)
    solution = view.estimate
    table.add_row(
        'position, mm',
        _millimetres(solution.camera_from_board.translation),
        _millimetres(view.true_pose.translation),
        f'{now.position:.2%}',
        f'{median.position:.2%}',
    )
    table.add_row(
        'tilt, degrees',
        f'{solution.camera_from_board.tilt_deg:.2f}',
        f'{view.true_pose.tilt_deg:.2f}',
    )
    table.add_row(
        'rotation, degrees', '', '', f'{now.rotation_deg:.2f}', f'{median.rotation_deg:.2f}'
    )
    table.add_row(
        'focal length, px',
        f'{solution.camera.focal_px:.1f}',
        f'{camera.focal_px:.1f}',
        f'{now.focal:.2%}',
        f'{median.focal:.2%}',
    )
    table.add_row(
        'distortion k',
        f'{solution.camera.k:.4f}',
        f'{camera.k:.4f}',
        f'{now.k:.4f}',
        f'{median.k:.4f}',
    )
    table.add_row('rms, px', f'{now.rms_px:.3f}', '', '', f'{median.rms_px:.3f}')
    milliseconds = (f'{1e3 * e.latency_s:.1f}' for e in (now, median))
    table.add_row('image to pose, ms', next(milliseconds), '', '', next(milliseconds))
    return table


def _line(view: DemoView, camera: DivisionCamera, errors: list[Errors]) -> str:
    now, camera_now = errors[-1], view.estimate.camera
    tilt, true_tilt = view.estimate.camera_from_board.tilt_deg, view.true_pose.tilt_deg
    return (
        f'view {len(errors):4d}: position error {now.position:.2%}, '
        f'tilt {tilt:.1f}° (true {true_tilt:.1f}°), rotation error {now.rotation_deg:.2f}°, '
        f'f {camera_now.focal_px:.1f} px ({camera.focal_px:.1f}), '
        f'k {camera_now.k:.3f} ({camera.k:.3f}), rms {now.rms_px:.2f} px, '
        f'{1e3 * now.latency_s:.0f} ms'
    )


def _millimetres(position_m: Array) -> str:
    return ' '.join(f'{1e3 * coordinate:.1f}' for coordinate in position_m)
