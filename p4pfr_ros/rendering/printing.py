# Copyright 2026 p4pfr_ros maintainers
# SPDX-License-Identifier: Apache-2.0

"""
Printable boards: PDF or PNG files that print to scale.

This module stands alone: of this package, only printing needs matplotlib.
"""

from __future__ import annotations

import math
import os
from pathlib import Path

from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.patches import PathPatch
from matplotlib.path import Path as Outline
import numpy as np
from p4pfr_ros.boards import (
    AprilGrid,
    Board,
    Bundle,
    Charuco,
    Chessboard,
    CircleGrid,
    Marker,
)
from p4pfr_ros.core.geometry import Array
from p4pfr_ros.files.yaml_fields import ConfigError
from p4pfr_ros.rendering.pattern import black_shapes

_MM_PER_INCH = 25.4
_MAX_SIDE_PX = 30_000
# Lower resolutions resolve neither the pattern nor the line of text.
_MIN_DPI = 20.0
# Height of the line of text at the lower edge: the smaller of this height and this fraction of
# the margin.
_TEXT_MM, _TEXT_IN_MARGINS = 2.5, 0.3
_POINTS_PER_MM = 72.0 / _MM_PER_INCH
_GREY = '0.45'
# Width and height of upright pages.
PAPERS_MM = {'A4': (210.0, 297.0), 'Letter': (215.9, 279.4), 'A3': (297.0, 420.0)}
# Printers leave so much of a page blank.
_BLANK_MM = 5.0
# A ruler with a mark every 10 mm: its length, its height with the numbers, and the space it needs
# between text and pattern.
_RULER_MM, _RULER_HEIGHT_MM, _LEAST_FOR_RULER_MM = 100.0, 4.0, 10.0


def print_board(
    board: Board, path: str | os.PathLike[str], *, dpi: float = 300.0, paper: str | None = None
) -> None:
    """
    Write a board to a file that prints to scale.

    Below the pattern are the board's name and, where there is space, a ruler that shows whether
    the print has the right scale.

    Parameters
    ----------
    board
        The board to print.
    path
        The file; its suffix selects the format: ``.pdf`` (vector graphics) or ``.png`` (with
        its resolution in the metadata).
    dpi
        Pixels per inch of the PNG.
    paper
        Size of the page, a key of `PAPERS_MM`; the pattern is in its middle, the page upright or
        lying. None: a page as large as the board's sheet.

    Raises
    ------
    ConfigError
        Another suffix, a path that cannot be written, a board that is larger than the paper, or a
        PNG with a resolution that is too low or a size that is too large.
    ValueError
        dpi is not positive, or OpenCV lacks the board's markers.

    """
    if not 0.0 < dpi < math.inf:
        raise ValueError(f'dpi must be > 0, got {dpi}')
    suffix = Path(path).suffix.lower()
    if suffix not in ('.pdf', '.png'):
        raise ConfigError(f'{path}: expected a name that ends in .pdf or .png')
    page_mm = _page_size_mm(board, paper)
    if suffix == '.png':
        if dpi < _MIN_DPI:
            raise ConfigError(f'{path}: expected at least {_MIN_DPI:g} dpi, got {dpi:g}')
        # Whole pixels: the pattern keeps its scale, and the margin absorbs the rounding.
        page_px = np.ceil(page_mm / _MM_PER_INCH * dpi)
        if page_px.max() > _MAX_SIDE_PX:
            raise ConfigError(
                f'{path}: expected at most {_MAX_SIDE_PX} px a side, got {page_px.max():.0f}: '
                f'use .pdf, or a lower resolution than {dpi:g} dpi'
            )
        page_mm = page_px / dpi * _MM_PER_INCH
    figure = _page(board, page_mm)
    # Without a date, the same board gives the same file.
    metadata = {'CreationDate': None} if suffix == '.pdf' else {'Software': None}
    try:
        figure.savefig(path, dpi=dpi, format=suffix[1:], metadata=metadata)
    except OSError as error:
        raise ConfigError(f'{path}: expected a place to write to: {error.strerror}') from None


def _page_size_mm(board: Board, paper: str | None) -> Array:
    sheet_mm = 1000.0 * np.array(board.sheet_size_m)
    if paper is None:
        return sheet_mm
    pattern_mm = 2000.0 * np.abs(black_shapes(board)).max(axis=(0, 1))
    upright_mm = np.array(PAPERS_MM[paper])
    # The margin may be smaller than that of the sheet, but not what printers leave blank.
    lacking_mm = {
        tuple(page_mm.tolist()): float((pattern_mm + 2.0 * _BLANK_MM - page_mm).max())
        for page_mm in (upright_mm, upright_mm[::-1])
    }
    page = min(lacking_mm, key=lambda each: lacking_mm[each])
    if lacking_mm[page] > 0.0:
        width_mm, height_mm = pattern_mm
        raise ConfigError(
            f'{board.name}: expected a board that fits on {paper} ({page[0]:g} x {page[1]:g} mm) '
            f'with margins of {_BLANK_MM:g} mm, got a pattern of {width_mm:g} x {height_mm:g} mm'
        )
    return np.array(page)


def describe(board: Board) -> str:
    """Return a one-line description of a board with its dimensions."""
    return f'{board.name}: {_kind_of(board)}{_variant_of(board)}'


def _kind_of(board: Board) -> str:
    if isinstance(board, Chessboard):
        return (
            f'chessboard {board.columns}x{board.rows} inner corners, squares {_mm(board.square_m)}'
        )
    if isinstance(board, CircleGrid):
        kind = 'asymmetric' if board.asymmetric else 'symmetric'
        return (
            f'{kind} grid of {board.columns}x{board.rows} circles, diameter '
            f'{_mm(board.diameter_m)}, spacing {_mm(board.spacing_m)}'
        )
    if isinstance(board, Charuco):
        first = f' from {board.first_id}' if board.first_id else ''
        legacy = ', legacy pattern' if board.legacy_pattern else ''
        return (
            f'charuco {board.columns}x{board.rows} squares of {_mm(board.square_m)}, '
            f'markers {_mm(board.marker_m)}, {board.dictionary}{first}{legacy}'
        )
    if isinstance(board, Marker):
        return f'marker {board.id} of {board.dictionary}, side {_mm(board.size_m)}'
    if isinstance(board, Bundle):
        return f'bundle of {len(board.markers)} markers of {board.dictionary}'
    if isinstance(board, AprilGrid):
        return (
            f'AprilGrid {board.columns}x{board.rows}, tags {_mm(board.tag_m)}, '
            f'gaps {_mm(board.spacing * board.tag_m)}, {board.dictionary} from {board.first_id}'
        )
    return (
        f'marker grid {board.columns}x{board.rows}, markers {_mm(board.marker_m)}, '
        f'gaps {_mm(board.separation_m)}, {board.dictionary} from {board.first_id}'
    )


def _variant_of(board: Board) -> str:
    """Return what is unusual about the print of a board, as text."""
    border = getattr(board, 'border_bits', 1)
    text = '' if border == 1 else f', borders of {border} cells'
    return text + (', white on black' if board.inverted is True else '')


def _mm(length_m: float) -> str:
    return f'{1000.0 * length_m:g} mm'


def _page(board: Board, page_mm: Array) -> Figure:
    """Return a page with the pattern at its centre."""
    width_mm, height_mm = (float(side) for side in page_mm)
    paper, ink = ('black', 'white') if board.inverted is True else ('white', 'black')
    figure = Figure(figsize=(width_mm / _MM_PER_INCH, height_mm / _MM_PER_INCH), facecolor=paper)
    axes = figure.add_axes((0.0, 0.0, 1.0, 1.0))
    axes.set_xlim(-0.5 * width_mm, 0.5 * width_mm)
    axes.set_ylim(-0.5 * height_mm, 0.5 * height_mm)
    axes.set_axis_off()
    shapes_mm = 1000.0 * black_shapes(board)
    # One compound path: separate cells would show hairlines where they touch.
    pattern = Outline.make_compound_path(*(_outline(shape) for shape in shapes_mm))
    axes.add_patch(PathPatch(pattern, facecolor=ink, linewidth=0.0, snap=False))
    margin_mm = 0.5 * height_mm + float(shapes_mm[..., 1].min())
    text = f'{describe(board)}. Print at 100 %.'
    # A letter is about half as wide as it is high.
    size_mm = min(_TEXT_MM, _TEXT_IN_MARGINS * margin_mm, 0.9 * width_mm / (0.55 * len(text)))
    has_ruler = margin_mm >= _LEAST_FOR_RULER_MM
    bottom_mm = -0.5 * height_mm + (_BLANK_MM if has_ruler else 0.5 * size_mm)
    length_mm = min(_RULER_MM, (width_mm - 2.0 * _BLANK_MM) // 10.0 * 10.0)
    if has_ruler and length_mm >= 10.0:
        _draw_ruler(axes, length_mm, bottom_mm)
        bottom_mm -= 1.2 * size_mm
    axes.text(
        0.0,
        bottom_mm,
        text.encode('ascii', 'replace').decode(),
        fontsize=size_mm * _POINTS_PER_MM,
        horizontalalignment='center',
        color=_GREY,
        parse_math=False,
    )
    return figure


def _draw_ruler(axes: Axes, length_mm: float, bottom_mm: float) -> None:
    """Draw a ruler in the middle of the page; its line is at the bottom, its marks point up."""
    marks_mm = np.arange(0.0, length_mm + 1.0, 10.0) - 0.5 * length_mm
    top_mm = bottom_mm + 0.4 * _RULER_HEIGHT_MM
    width = 0.15 * _POINTS_PER_MM
    axes.hlines(bottom_mm, marks_mm[0], marks_mm[-1], color=_GREY, linewidth=width)
    axes.vlines(marks_mm, bottom_mm, top_mm, color=_GREY, linewidth=width)
    for x_mm, label in ((marks_mm[0], '0'), (marks_mm[-1], f'{length_mm:g} mm')):
        axes.text(
            x_mm,
            top_mm + 0.3,
            label,
            fontsize=0.5 * _RULER_HEIGHT_MM * _POINTS_PER_MM,
            horizontalalignment='center',
            color=_GREY,
        )


def _outline(corners: Array) -> Outline:
    return Outline(np.concatenate([corners, corners[:1]]), closed=True)
