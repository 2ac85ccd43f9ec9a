# Copyright 2026 p4pfr_ros maintainers
# SPDX-License-Identifier: Apache-2.0

"""
Drawings for the HTML report, as SVG: charts, and maps over the image.

Colours are classes of the page's style sheet, so that they follow its light or dark scheme. This
module stands alone: it knows shapes, not cameras.
"""

from __future__ import annotations

import base64
from collections.abc import Sequence
from dataclasses import dataclass, field
from html import escape
import math

import cv2
import numpy as np
from numpy.typing import NDArray
from p4pfr_ros.core.geometry import Array, Mask

# Width of drawings in their own units, and margins for the labels of charts.
_WIDTH = 460.0
_LEFT, _RIGHT, _TOP, _BOTTOM = 58.0, 14.0, 10.0, 40.0
_TICKS = 5
# Of maps, by OpenCV's number of a colour map or 256 colours (256, 1, 3), blue, green, red.
ColourMap = int | NDArray[np.uint8]


def _diverging() -> NDArray[np.uint8]:
    """Return colours from blue over white to red."""
    low, middle, high = (172.0, 102.0, 33.0), (247.0, 247.0, 247.0), (43.0, 24.0, 178.0)
    at = np.linspace(0.0, 1.0, 256)
    columns = [
        np.interp(at, (0.0, 0.5, 1.0), ends) for ends in zip(low, middle, high, strict=True)
    ]
    return np.stack(columns, axis=-1)[:, None].astype(np.uint8)


DIVERGING = _diverging()


@dataclass(eq=False)
class Chart:
    """
    A chart with linear axes.

    Parameters
    ----------
    x_range, y_range
        What the axes show.
    x_label, y_label
        Their labels, with units.
    title
        What people who do not see it hear.
    width, height
        Size of the drawing, in the units of its text: 12 high.

    """

    x_range: tuple[float, float]
    y_range: tuple[float, float]
    x_label: str
    y_label: str
    title: str
    width: float = _WIDTH
    height: float = 260.0
    _parts: list[str] = field(default_factory=list)

    def line(self, x: Array, y: Array, kind: str) -> None:
        """Draw a line of a class of the style sheet; NaN interrupts it."""
        points = self._place(x, y)
        finite = np.isfinite(points).all(axis=1)
        breaks = np.flatnonzero(np.diff(finite.astype(int))) + 1
        for part, is_drawn in zip(np.split(points, breaks), np.split(finite, breaks), strict=True):
            if len(part) > 1 and is_drawn[0]:
                self._parts.append(f'<polyline class="{kind}" points="{_numbers(part)}"/>')

    def band(self, x: Array, low: Array, high: Array) -> None:
        """Fill the area between two lines."""
        points = np.concatenate([self._place(x, low), self._place(x, high)[::-1]])
        if np.isfinite(points).all():
            self._parts.append(f'<polygon class="band" points="{_numbers(points)}"/>')

    def dots(self, x: Array, y: Array, kind: str, titles: Sequence[str] = ()) -> None:
        """Draw dots, with texts that appear beneath the mouse."""
        for i, (u, v) in enumerate(self._place(x, y).tolist()):
            if math.isfinite(u) and math.isfinite(v):
                words = f'<title>{escape(titles[i])}</title>' if titles else ''
                self._parts.append(
                    f'<circle class="{kind}" cx="{u:.1f}" cy="{v:.1f}" r="2.6">{words}</circle>'
                )

    def vertical(self, x: float, words: str) -> None:
        """Draw a vertical line with a text at its top."""
        u = float(self._place(np.array([x]), np.array([self.y_range[0]]))[0, 0])
        bottom = self.height - _BOTTOM
        anchor = 'end' if u > 0.6 * self.width else 'start'
        self._parts.append(
            f'<line class="mark" x1="{u:.1f}" y1="{_TOP}" x2="{u:.1f}" y2="{bottom}"/>'
            f'<text class="note" x="{u + (-4 if anchor == "end" else 4):.1f}" y="{_TOP + 10}" '
            f'text-anchor="{anchor}">{escape(words)}</text>'
        )

    def svg(self) -> str:
        """Return the drawing."""
        return _svg(self.width, self.height, self.title, [*self._axes(), self._clipped()])

    def _clipped(self) -> str:
        """Return what is drawn within the axes; a nested drawing clips at its border."""
        width, height = self.width - _LEFT - _RIGHT, self.height - _TOP - _BOTTOM
        box = f'x="{_LEFT}" y="{_TOP}" width="{width}" height="{height}"'
        view = f'viewBox="{_LEFT} {_TOP} {width} {height}"'
        return f'<svg {box} {view}>{"".join(self._parts)}</svg>'

    def _axes(self) -> list[str]:
        bottom, right = self.height - _BOTTOM, self.width - _RIGHT
        parts = []
        for value in ticks(*self.y_range):
            v = float(self._place(np.array([self.x_range[0]]), np.array([value]))[0, 1])
            parts.append(
                f'<line class="grid" x1="{_LEFT}" y1="{v:.1f}" x2="{right}" y2="{v:.1f}"/>'
                f'<text class="tick" x="{_LEFT - 6}" y="{v + 4:.1f}" text-anchor="end">'
                f'{_label(value)}</text>'
            )
        for value in ticks(*self.x_range):
            u = float(self._place(np.array([value]), np.array([self.y_range[0]]))[0, 0])
            parts.append(
                f'<line class="axis" x1="{u:.1f}" y1="{bottom}" x2="{u:.1f}" y2="{bottom + 4}"/>'
                f'<text class="tick" x="{u:.1f}" y="{bottom + 17}" text-anchor="middle">'
                f'{_label(value)}</text>'
            )
        middle = 0.5 * (_TOP + bottom)
        return [
            *parts,
            f'<line class="axis" x1="{_LEFT}" y1="{bottom}" x2="{right}" y2="{bottom}"/>',
            f'<text class="label" x="{0.5 * (_LEFT + right)}" y="{self.height - 5}" '
            f'text-anchor="middle">{escape(self.x_label)}</text>',
            f'<text class="label" transform="translate(13 {middle}) rotate(-90)" '
            f'text-anchor="middle">{escape(self.y_label)}</text>',
        ]

    def _place(self, x: Array, y: Array) -> Array:
        """Return the places (N, 2) of values in the drawing."""
        (left, right), (low, high) = self.x_range, self.y_range
        width, height = self.width - _LEFT - _RIGHT, self.height - _TOP - _BOTTOM
        u = _LEFT + width * (np.asarray(x, dtype=float) - left) / (right - left)
        v = _TOP + height * (high - np.asarray(y, dtype=float)) / (high - low)
        return np.stack([u, v], axis=-1)


@dataclass(eq=False)
class ImageMap:
    """
    A map over an image, or over a board: its coordinates are those of the drawing, y down.

    Parameters
    ----------
    size
        Width and height of what is mapped.
    title
        What people who do not see it hear.

    """

    size: tuple[float, float]
    title: str
    _parts: list[str] = field(default_factory=list)

    @property
    def _share(self) -> float:
        return _WIDTH / self.size[0]

    def heat(self, values: Array, low: float, high: float, colours: ColourMap) -> None:
        """Colour cells (rows, columns) from low to high by a map of OpenCV; NaN is clear."""
        levels = np.clip((values - low) / (high - low), 0.0, 1.0)
        grey = np.rint(255.0 * np.nan_to_num(levels)).astype(np.uint8)
        colour = cv2.cvtColor(cv2.applyColorMap(grey, colours), cv2.COLOR_BGR2BGRA)
        colour[..., 3] = np.where(np.isnan(values), 0, 255)
        self._parts.append(
            f'<image width="{_WIDTH}" height="{self._height:.1f}" preserveAspectRatio="none" '
            f'href="{data_uri(colour, ".png")}"/>'
        )

    def cells(self, is_filled: Mask, kind: str) -> None:
        """Fill cells (rows, columns) of the whole map."""
        rows, columns = is_filled.shape
        width, height = _WIDTH / columns, self._height / rows
        for i, j in np.argwhere(is_filled).tolist():
            self._parts.append(
                f'<rect class="{kind}" x="{j * width:.1f}" y="{i * height:.1f}" '
                f'width="{width + 0.3:.1f}" height="{height + 0.3:.1f}"/>'
            )

    def outline(self, is_inside: Mask, kind: str = 'outline') -> None:
        """Draw the border of cells (rows, columns)."""
        rows, columns = is_inside.shape
        width, height, padded = _WIDTH / columns, self._height / rows, np.pad(is_inside, 1)
        path = [
            f'M{j * width:.1f} {i * height:.1f}v{height:.1f}'
            for i, j in np.argwhere(padded[1:-1, :-1] != padded[1:-1, 1:]).tolist()
        ]
        path += [
            f'M{j * width:.1f} {i * height:.1f}h{width:.1f}'
            for i, j in np.argwhere(padded[:-1, 1:-1] != padded[1:, 1:-1]).tolist()
        ]
        self._parts.append(f'<path class="{kind}" d="{"".join(path)}"/>')

    def dots(self, points: Array, kind: str, radius: float = 1.4) -> None:
        """Draw dots at points (N, 2)."""
        for x, y in (points * self._share).tolist():
            self._parts.append(f'<circle class="{kind}" cx="{x:.1f}" cy="{y:.1f}" r="{radius}"/>')

    def arrows(self, points: Array, vectors: Array) -> None:
        """Draw arrows (N, 2) from points (N, 2), in the map's own units."""
        path = []
        for (x, y), (dx, dy) in zip(
            (points * self._share).tolist(), (vectors * self._share).tolist(), strict=True
        ):
            path.append(f'M{x:.1f} {y:.1f}l{dx:.1f} {dy:.1f}')
            # The head: two strokes, turned by 150 degrees.
            for turn in (2.6, -2.6):
                c, s = 0.3 * math.cos(turn), 0.3 * math.sin(turn)
                path.append(
                    f'M{x + dx:.1f} {y + dy:.1f}l{c * dx - s * dy:.1f} {s * dx + c * dy:.1f}'
                )
        self._parts.append(f'<path class="arrows" d="{"".join(path)}"/>')

    def svg(self) -> str:
        """Return the drawing."""
        frame = f'<rect class="frame" width="{_WIDTH}" height="{self._height:.1f}"/>'
        return _svg(_WIDTH, self._height, self.title, [frame, *self._parts])

    @property
    def _height(self) -> float:
        return self._share * self.size[1]


def ticks(low: float, high: float) -> list[float]:
    """Return round numbers from low to high, about five."""
    span = high - low
    if not span > 0.0 or not math.isfinite(span):
        return []
    power = 10.0 ** math.floor(math.log10(span / _TICKS))
    step = next(s * power for s in (1.0, 2.0, 5.0, 10.0) if s * power >= span / _TICKS)
    first = math.ceil(low / step - 1e-9)
    last = math.floor(high / step + 1e-9)
    return [step * i for i in range(first, last + 1)]


def data_uri(image: Array, suffix: str) -> str:
    """Return an image, uint8, as a data URI of the format of a suffix."""
    _, data = cv2.imencode(suffix, image)
    return embedded(data.tobytes(), 'png' if suffix == '.png' else 'jpeg')


def embedded(data: bytes, kind: str) -> str:
    """Return the bytes of an image file, png or jpeg, as a data URI."""
    return f'data:image/{kind};base64,{base64.b64encode(data).decode()}'


def colour_scale(colours: ColourMap, labels: Sequence[str]) -> str:
    """Return HTML of the colours of a map, with labels from its low end to its high end."""
    ramp = cv2.applyColorMap(np.arange(256, dtype=np.uint8)[None], colours)
    words = ''.join(f'<span>{escape(label)}</span>' for label in labels)
    return (
        f'<div class="scale"><img alt="" src="{data_uri(ramp, ".png")}">'
        f'<div class="labels">{words}</div></div>'
    )


def _svg(width: float, height: float, title: str, parts: Sequence[str]) -> str:
    return (
        f'<svg viewBox="0 0 {width:g} {height:.1f}" role="img" aria-label="{escape(title)}">'
        f'{"".join(parts)}</svg>'
    )


def _numbers(points: Array) -> str:
    return ' '.join(f'{u:.1f},{v:.1f}' for u, v in points.tolist())


def _label(value: float) -> str:
    return f'{value:.10g}'.replace('-', '−')
