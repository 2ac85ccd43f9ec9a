# Copyright 2026 p4pfr_ros maintainers
# SPDX-License-Identifier: Apache-2.0

"""
Lengths that are likely in the wrong unit.

This module stands alone: what is unlikely is no error, and only people are told.
"""

from __future__ import annotations

from p4pfr_ros.boards import Board

# Sheets of boards that cameras are calibrated with, metres.
_SMALLEST_M, _LARGEST_M = 0.005, 5.0


def unit_note(board: Board) -> str:
    """Return a line for people if the size of a board is unlikely; empty if it is not."""
    width_m, height_m = board.sheet_size_m
    if max(width_m, height_m) > _LARGEST_M:
        size, advice = f'{width_m:g} x {height_m:g} m', 'keys that end in _m are metres'
    elif max(width_m, height_m) < _SMALLEST_M:
        size = f'{1e3 * width_m:g} x {1e3 * height_m:g} mm'
        advice = 'keys that end in _mm are millimetres'
    else:
        return ''
    return f'{board.name}: {size} is an unlikely size of a board: {advice}'
