# Copyright 2026 p4pfr_ros maintainers
# SPDX-License-Identifier: Apache-2.0

"""
Text on images: wrapped into lines, on dark bars, and labels that do not overlap.

This module stands alone: `drawing` decides what is written and where, this one how.
"""

from __future__ import annotations

import math

import cv2
from p4pfr_ros.files.images import ImageArray

Colour = tuple[int, int, int]
# Left, top, right and bottom of a bar, pixels; right and bottom are the first outside.
Box = tuple[int, int, int, int]

INK: Colour = (255, 255, 255)
_FONT = cv2.FONT_HERSHEY_SIMPLEX
# Sizes of fonts at scale 1: of the text at the top, smaller if it is long, and of labels.
_SIZES, _LABEL_SIZE = (0.5, 0.42), 0.4
# For a size of 1: the distance of lines, and the margin around them.
_LINE_PX, _MARGIN_PX = 40.0, 16.0
# The text at the top takes at most this share of the image's height, a label of its width.
_MAX_HEIGHT, _MAX_LABEL_WIDTH = 1 / 3, 0.5
_MAX_LABEL_LINES = 4
# A bar is so many times darker than the image.
_DARKER = 4
# Reasons of several boards are joined by it, and begin a line each.
_BETWEEN_REASONS = '; '
_CUT = '...'


def write_at_top(canvas: ImageArray, text: str, scale: float) -> Box:
    """Write a text into the upper part of an image, on a dark bar; return the bar."""
    height, width = canvas.shape[:2]
    lines: list[str] = []
    for size in (scale * each for each in _SIZES):
        at_most = max(1, int((_MAX_HEIGHT * height - _MARGIN_PX * size) / (_LINE_PX * size)))
        width_px = width - 2.0 * _MARGIN_PX * size
        parts = text.split(_BETWEEN_REASONS)
        parts = [part + ';' for part in parts[:-1]] + parts[-1:]
        lines = [line for part in parts for line in wrapped(part, size, width_px)]
        if len(lines) <= at_most:
            break
    lines = _cut(lines, at_most, size, width_px)
    # As high as one line of the larger size, at least.
    least_px = (_LINE_PX + 1.25 * _MARGIN_PX) * scale * _SIZES[0]
    bar = 0, 0, width, round(max(least_px, _height_px(len(lines), size)))
    _write_lines(canvas, lines, bar, INK, size)
    return bar


def write_label(
    canvas: ImageArray,
    text: str,
    at: tuple[float, float],
    colour: Colour,
    scale: float,
    taken: list[Box],
) -> bool:
    """
    Write a label on a dark bar, whose lower edge has its middle at ``at``, pixels.

    Return whether it was written: it does not leave the image, nor overlap the bars ``taken``, to
    which its own is added.
    """
    height, width = canvas.shape[:2]
    size = _LABEL_SIZE * scale
    lines = _balanced(text, size, _MAX_LABEL_WIDTH * width - 2.0 * _MARGIN_PX * size)
    longest_px = max(_width_px(line, size) for line in lines)
    label_width = math.ceil(longest_px + 2.0 * _MARGIN_PX * size)
    label_height = round(_height_px(len(lines), size))
    if len(lines) > _MAX_LABEL_LINES or label_width > width or label_height > height:
        return False
    left = max(0, min(round(at[0] - 0.5 * label_width), width - label_width))
    top = max(0, min(round(at[1]) - label_height, height - label_height))
    bar = left, top, left + label_width, top + label_height
    if any(_overlap(bar, other) for other in taken):
        return False
    taken.append(bar)
    _write_lines(canvas, lines, bar, colour, size)
    return True


def _balanced(text: str, size: float, width_px: float) -> list[str]:
    """Break a text into as many lines as its width requires, of about equal length."""
    lines = wrapped(text, size, width_px)
    narrower = lines
    while len(lines) > 1 and len(narrower) == len(lines):
        lines, width_px = narrower, 0.9 * width_px
        narrower = wrapped(text, size, width_px)
    return lines


def wrapped(text: str, size: float, width_px: float) -> list[str]:
    """Break a text into lines of a width, between words; a longer word within."""
    lines: list[str] = []
    for word in text.split():
        if lines and _width_px(f'{lines[-1]} {word}', size) <= width_px:
            lines[-1] += f' {word}'
            continue
        lines.append('')
        for letter in word:
            if lines[-1] and _width_px(lines[-1] + letter, size) > width_px:
                lines.append('')
            lines[-1] += letter
    return lines or ['']


def write_at(
    canvas: ImageArray, text: str, at: tuple[float, float], colour: Colour, size: float
) -> None:
    """Write a line of text whose baseline begins at ``at``, pixels."""
    at_px = round(at[0]), round(at[1])
    cv2.putText(canvas, text, at_px, _FONT, size, colour, _thickness(size), cv2.LINE_AA)


def _write_lines(
    canvas: ImageArray, lines: list[str], bar: Box, colour: Colour, size: float
) -> None:
    """Darken a bar, and write lines into it."""
    left, top, right, bottom = bar
    canvas[top:bottom, left:right] //= _DARKER
    first_px = top + 0.5 * (bottom - top - _LINE_PX * size * (len(lines) - 1))
    for number, line in enumerate(lines):
        # Letters are centred on their line: their baseline is below its middle.
        baseline_px = first_px + (number * _LINE_PX + 10.0) * size
        write_at(canvas, line, (left + _MARGIN_PX * size, baseline_px), colour, size)


def _cut(lines: list[str], at_most: int, size: float, width_px: float) -> list[str]:
    """Return at most so many lines; the last one says if there are more."""
    if len(lines) <= at_most:
        return lines
    last = lines[at_most - 1]
    while last and _width_px(last + _CUT, size) > width_px:
        last = last[:-1]
    return [*lines[: at_most - 1], last.rstrip() + _CUT]


def _height_px(lines: int, size: float) -> float:
    return (_LINE_PX * lines + _MARGIN_PX) * size


def _width_px(text: str, size: float) -> int:
    (width, _), _ = cv2.getTextSize(text, _FONT, size, _thickness(size))
    return int(width)


def _thickness(size: float) -> int:
    return max(1, round(2.0 * size))


def _overlap(one: Box, other: Box) -> bool:
    return one[0] < other[2] and other[0] < one[2] and one[1] < other[3] and other[1] < one[3]
