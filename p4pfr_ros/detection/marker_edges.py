# Copyright 2026 p4pfr_ros maintainers
# SPDX-License-Identifier: Apache-2.0

"""
Refinement of marker corners from the four edges, each fitted along its whole length.

A marker's corner itself carries little information: a few pixels, rounded by blur. Its edges are
long. In a strip along an edge the image is modelled as  a + b tanh(s e),  where e is the distance
to a parabola (a cubic for long edges), because a lens bends the edge; a marker's corner is the
intersection of two such curves.

This module stands alone: it is numerics, without OpenCV and boards, and has tests of its own.
"""

from __future__ import annotations

from functools import cache
import math
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray
from p4pfr_ros.core.geometry import Array, Ints
from p4pfr_ros.core.jit import kernel
from p4pfr_ros.detection.fitting import (
    accept_trial,
    add_up,
    damped_step,
    DAMPING_AFTER_FAILURE,
    DAMPING_AFTER_SUCCESS,
    Room,
    room,
    sharpness,
    tanh,
)
from p4pfr_ros.detection.marker_code import perspective, point_in_square, reads

# Outcomes of a refinement.
NO_EDGES, OTHER_CODE, DOUBTFUL, FOUND = 0, 1, 2, 3

# Number of sample rows along an edge, and of samples per row. Each row is shifted against the one
# before by this fraction of the sample spacing, the golden ratio, so that all rows together
# resolve the edge's position finely.
_ROWS, _SAMPLES_PER_ROW = 24, 11
_SHIFT = 0.618034
# The ends of an edge are excluded, because blur bends them towards the next edges: a number of
# pixels, or a number of blur widths within these fractions of the edge's length.
_EXCLUDED_PX, _EXCLUDED_WIDTHS = 2.5, 2.0
_LEAST_EXCLUDED, _MOST_EXCLUDED = 0.03, 0.08
# Half the width of the strip stays within the marker's black border. The first strip is wide, to
# contain an edge that the lens bends far off the straight line; later strips follow the curve of
# the previous fit.
_STRIP_IN_CELLS = 0.75
_MIN_STRIP_PX = 1.5
_MAX_STRIP_PX = (30.0, 5.0, 5.0, 5.0, 5.0)
_ITERATIONS = (10, 4, 4, 4, 4)
# Strong damping keeps the first steps short: long ones lose a strongly bent edge.
_FIRST_DAMPING = 1e-2
# A fit ends early after a step as short as this, pixels. The earlier passes only place the strip
# of the last one.
_CONVERGED_PX = (1e-4, 1e-5, 1e-7, 1e-7, 1e-7)
# On shorter edges, the noise outweighs the gain of a cubic over a parabola, pixels.
_MIN_CUBIC_PX = 80.0
_INTERSECTION_STEPS = 4
# Acceptance: a minimum contrast (outside minus inside), in grey levels, and a maximum rms
# residual, relative to the contrast.
_MIN_CONTRAST = 4.0
_MAX_RESIDUAL = 0.5
# Cells may be smaller than the errors of the initial corners, pixels.
_LEAST_SHIFT_PX = 2.0
# After a larger shift, the edges are fitted again, from there.
_RESTART_PX, _MAX_RESTARTS = 2.0, 3

# Dark inside and bright outside: the least difference of the means of both sides, in each of so
# many parts of an edge, in contrasts (half differences), of which 2 is a sharp edge. A part in
# shadow has less.
_PARTS, _MIN_STEP = 6, 0.4
# Largest distance of a part's own edge from the curve.
_MAX_OFF_PX, _MAX_OFF_IN_STRIPS = 0.2, 0.15
# Where the image outside of an edge is darker than so much of the contrast, the margin ends.
_MIN_BRIGHTNESS = 0.6
# In a narrower margin blur leaves no white, and the fit is biased.
_MIN_MARGIN_PX = 2.0
# Widths of the margin, in cells, of which the outer edge may have been taken for the marker's.
_MARGINS_IN_CELLS = (0.0, 0.12, 0.2, 0.3, 0.45, 0.65, 0.85, 1.1)
# By how many cells the outline may lie within a border of several cells: where squares touch the
# corners of a marker, as in Kalibr's grids, only the inner outline of its blurred edge is closed.
_INSETS_IN_CELLS = (0.4, 0.8)

# Columns of an edge's frame: midpoint, unit directions along and across (out of the marker), and
# half the length, pixels.
_MIDDLE, _ALONG, _ACROSS, _HALF = 0, 2, 4, 6


def refine_markers(
    grey: NDArray[np.uint8], corners: Array, cells: NDArray[np.bool_]
) -> tuple[Array, Ints]:
    """
    Refine the corners of black markers on white, and check that the markers are there.

    A quadrilateral with a readable code is evidence of a marker, not of its place: it may be the
    edge of the paper around the marker. At the place of the fitted edges, the image must be dark
    inside and bright outside along each of them, and the code must be the marker's.

    Parameters
    ----------
    grey : (h, w) array
        The image.
    corners : (M, 4, 2) array
        Initial corners, accurate to a pixel or two, clockwise from the top left of the code.
    cells : (M, n, n) array
        The cells of each marker, border included; True where black.

    Returns
    -------
    The refined corners (M, 4, 2), NaN where not found, and whether each was found (M,): `FOUND`,
    `DOUBTFUL` (found, but the cells are neither black nor white), `NO_EDGES` or `OTHER_CODE`.

    """
    start = np.ascontiguousarray(corners, dtype=np.float64)
    refined, status = np.full_like(start, np.nan), np.empty(len(start), np.int64)
    if not len(start):
        return refined, status
    pixels = _ROWS * _SAMPLES_PER_ROW
    scratch = _Scratch(
        np.empty((4, 2)), np.empty((4, pixels)), np.empty((4, 7)), np.empty((4, 7)), room(pixels)
    )
    black, margins = np.ascontiguousarray(cells), _margins(cells[0])
    _refine(grey, start, black, margins, _unit_samples(), scratch, refined, status)
    return refined, status


def _margins(cells: NDArray[np.bool_]) -> Array:
    """Return, most likely first, by how many cells a marker's outline may be too wide."""
    within = cells[1:-1, 1:-1]
    is_border_wide = within[[0, -1]].all() and within[:, [0, -1]].all()
    first, *others = _MARGINS_IN_CELLS
    insets = [-inset for inset in _INSETS_IN_CELLS if is_border_wide]
    return np.array([first, *insets, *others])


class _Scratch(NamedTuple):
    """
    Workspace for one marker.

    ``start`` (4, 2) are the initial corners, ``samples`` (4, m) those of one strip, ``frames``
    (4, 7) those of the edges, and ``edges`` (4, 7) their fitted parameters.
    """

    start: Array
    samples: Array
    frames: Array
    edges: Array
    room: Room


@cache
def _unit_samples() -> Array:
    """
    Return the sample positions (2, m) in a strip, along and across, from -1 to 1.

    With identical rows, a sharp edge would lie between the same two samples in every row, and its
    position between them would be undetermined.
    """
    u = np.repeat(np.linspace(-1.0, 1.0, _ROWS), _SAMPLES_PER_ROW)
    shift = _SHIFT * np.arange(_ROWS) % 1.0
    v = 2.0 / _SAMPLES_PER_ROW * (np.arange(_SAMPLES_PER_ROW) + shift[:, None]) - 1.0
    return np.stack([u, v.ravel()])


@kernel
def _refine(
    grey: NDArray[np.uint8],
    corners: Array,
    cells: NDArray[np.bool_],
    margins: Array,
    unit: Array,
    scratch: _Scratch,
    refined: Array,
    status: Ints,
) -> None:
    """Refine M markers; those that are not found keep NaN in ``refined``."""
    for n in range(len(corners)):
        status[n] = NO_EDGES
        for margin in margins:
            count = cells.shape[1]
            _shrink(corners[n], count / (count + 2.0 * margin), scratch.start)
            # The strip must not be wider than the margin that is assumed.
            widest = margin if margin > 0.0 else _STRIP_IN_CELLS
            outcome = _refine_one(grey, cells[n], widest, unit, scratch, refined[n])
            status[n] = max(status[n], outcome)
            if outcome >= DOUBTFUL:
                break
        for i in range(4):
            for j in range(2):
                refined[n, i, j] = refined[n, i, j] if status[n] >= DOUBTFUL else math.nan


@kernel
def _shrink(corners: Array, scale: float, shrunk: Array) -> None:
    """Write the corners of a square of so much of the side within the square in the image."""
    g, h = perspective(corners)
    inset = 0.5 * (1.0 - scale)
    for i in range(4):
        across = inset if i == 0 or i == 3 else 1.0 - inset
        down = inset if i < 2 else 1.0 - inset
        shrunk[i, 0], shrunk[i, 1] = point_in_square(corners, g, h, across, down)


@kernel
def _refine_one(
    grey: NDArray[np.uint8],
    cells: NDArray[np.bool_],
    widest: float,
    unit: Array,
    scratch: _Scratch,
    refined: Array,
) -> int:
    """Refine one marker from ``scratch.start`` and check it."""
    start, frames = scratch.start, scratch.frames
    for _ in range(_MAX_RESTARTS):
        cell_px = _write_frames(start, frames) / len(cells)
        if not _fit_edges(grey, len(cells), widest, unit, scratch):
            return NO_EDGES
        _intersect(frames, scratch.edges, refined)
        shift_px = 0.0
        for i in range(4):
            dx, dy = refined[i, 0] - start[i, 0], refined[i, 1] - start[i, 1]
            shift_px = max(shift_px, math.hypot(dx, dy))
        # A corner that moved by more than a cell belongs to a fit of some other edge.
        if not shift_px < max(cell_px, _LEAST_SHIFT_PX):
            return NO_EDGES
        if shift_px < _RESTART_PX:
            break
        # The strips began and ended beyond the marker's corners.
        for i in range(4):
            start[i, 0], start[i, 1] = refined[i, 0], refined[i, 1]
    return OTHER_CODE + reads(grey, refined, frames, scratch.edges, cells)


@kernel
def _write_frames(corners: Array, frames: Array) -> float:
    """Write the frames of a marker's four edges; return the length of the shortest, pixels."""
    shortest_px = math.inf
    for i in range(4):
        x0, y0, x1, y1 = (
            corners[i, 0],
            corners[i, 1],
            corners[(i + 1) % 4, 0],
            corners[(i + 1) % 4, 1],
        )
        half_px = max(0.5 * math.hypot(x1 - x0, y1 - y0), 1e-6)
        ax, ay = 0.5 * (x1 - x0) / half_px, 0.5 * (y1 - y0) / half_px
        frames[i, 0], frames[i, 1] = 0.5 * (x0 + x1), 0.5 * (y0 + y1)
        frames[i, 2], frames[i, 3] = ax, ay
        # Corners are clockwise in the image, y down: outwards is to the left of the direction.
        frames[i, 4], frames[i, 5] = ay, -ax
        frames[i, 6] = half_px
        shortest_px = min(shortest_px, 2.0 * half_px)
    return shortest_px


@kernel
def _fit_edges(
    grey: NDArray[np.uint8], count: int, widest: float, unit: Array, scratch: _Scratch
) -> bool:
    """Write the parameters of the four edges; return whether all fits are accepted."""
    samples, p = scratch.samples, scratch.room.parameters[0]
    for i in range(4):
        frame, edge = scratch.frames[i], scratch.edges[i]
        for j in range(len(edge)):
            edge[j] = 0.0
        blur_px, good, outside_px = 0.0, False, math.inf
        length_px = 2.0 * frame[_HALF]
        cell_px = _depth_px(scratch.start, frame, i) / count
        for turn in range(len(_ITERATIONS)):
            if turn > 2 and outside_px == math.inf:
                break
            widest_px = min(widest * cell_px, _MAX_STRIP_PX[turn], outside_px)
            strip_px = max(widest_px, _MIN_STRIP_PX)
            by_blur = min(
                max(_EXCLUDED_WIDTHS * blur_px / length_px, _LEAST_EXCLUDED), _MOST_EXCLUDED
            )
            extent = max(1.0 - 2.0 * max(_EXCLUDED_PX / length_px, by_blur), 0.5)
            _sample(grey, frame, edge, extent, strip_px, unit, samples)
            _start(edge, samples, unit, strip_px, p)
            cubic = 1.0 if length_px > _MIN_CUBIC_PX else 0.0
            rms = _fit(samples, cubic, _ITERATIONS[turn], _CONVERGED_PX[turn], scratch.room)
            has_contrast = p[6] > _MIN_CONTRAST
            good = has_contrast and rms < _MAX_RESIDUAL * p[6]
            blur_px = 1.0 / sharpness(p[4])[0] if has_contrast else 0.0
            if has_contrast:
                for j in range(7):
                    edge[j] = p[j]
                outside_px = _bright_px(samples, edge, strip_px)
            if turn > 1 and outside_px < _MIN_MARGIN_PX:
                return False
        # In a strip that reaches beyond the margin, the fit is biased.
        if not good or outside_px < math.inf or not _is_edge_everywhere(samples, edge, strip_px):
            return False
    return True


@kernel
def _bright_px(samples: Array, edge: Array, strip_px: float) -> float:
    """Return how far outside of an edge the image is bright, pixels; inf if in the whole strip."""
    least = edge[5] + _MIN_BRIGHTNESS * edge[6]
    bins = 6
    bright_before = False
    for n in range(1, bins):
        total, count = 0.0, 0
        low, high = n * strip_px / bins, (n + 1) * strip_px / bins
        for k in range(samples.shape[1]):
            u = samples[0, k]
            e = samples[1, k] - (edge[0] + u * (edge[1] + u * (edge[2] + u * edge[3])))
            if low <= e < high and samples[3, k] > 0.0:
                total += samples[2, k]
                count += 1
        if count and total >= least * count:
            bright_before = True
        elif count and bright_before:
            # The bin before may be mixed, too.
            return max(low - strip_px / bins, 0.0)
    return math.inf


@kernel
def _is_edge_everywhere(samples: Array, edge: Array, strip_px: float) -> bool:
    """Return whether each part of an edge is dark inside and bright outside, and on the curve."""
    per_part = samples.shape[1] // _PARTS
    for part in range(_PARTS):
        inner, outer, total, inside, outside, count = 0.0, 0.0, 0.0, 0, 0, 0
        for k in range(part * per_part, (part + 1) * per_part):
            u = samples[0, k]
            e = samples[1, k] - (edge[0] + u * (edge[1] + u * (edge[2] + u * edge[3])))
            if samples[3, k] == 0.0:
                continue
            total += samples[2, k]
            count += 1
            if e > 0.4 * strip_px:
                outer += samples[2, k]
                outside += 1
            elif e < -0.4 * strip_px:
                inner += samples[2, k]
                inside += 1
        if not inside or not outside:
            continue  # beyond the image
        inner, outer = inner / inside, outer / outside
        if outer - inner < _MIN_STEP * edge[6]:
            return False
        # The mean level of the strip tells where the step from dark to bright is.
        off_px = strip_px * (1.0 - 2.0 * (total / count - inner) / (outer - inner))
        if abs(off_px) > _MAX_OFF_PX + _MAX_OFF_IN_STRIPS * strip_px:
            return False
    return True


@kernel
def _depth_px(corners: Array, frame: Array, i: int) -> float:
    """Return the distance of the nearer one of the opposite corners from edge i, pixels."""
    depth_px = math.inf
    for far, near in (((i + 2) % 4, i), ((i + 3) % 4, i)):
        dx, dy = corners[far, 0] - corners[near, 0], corners[far, 1] - corners[near, 1]
        depth_px = min(depth_px, abs(dx * frame[_ACROSS] + dy * frame[_ACROSS + 1]))
    return depth_px


@kernel
def _sample(
    grey: NDArray[np.uint8],
    frame: Array,
    curve: Array,
    extent: float,
    strip_px: float,
    unit: Array,
    samples: Array,
) -> None:
    """Write u, v px, the level and 1 inside or 0 outside the image, at the samples of a strip."""
    height, width = grey.shape
    for k in range(samples.shape[1]):
        u = extent * unit[0, k]
        v_px = strip_px * unit[1, k] + curve[0] + u * (curve[1] + u * (curve[2] + u * curve[3]))
        u_px = frame[_HALF] * u
        x = frame[0] + u_px * frame[2] + v_px * frame[4]
        y = frame[1] + u_px * frame[3] + v_px * frame[5]
        left = min(max(math.floor(x), 0), max(width - 2, 0))
        top = min(max(math.floor(y), 0), max(height - 2, 0))
        dx, dy = min(max(x - left, 0.0), 1.0), min(max(y - top, 0.0), 1.0)
        right, bottom = min(left + 1, width - 1), min(top + 1, height - 1)
        upper = grey[top, left] * (1.0 - dx) + grey[top, right] * dx
        lower = grey[bottom, left] * (1.0 - dx) + grey[bottom, right] * dx
        inside = 0.0 <= x <= width - 1 and 0.0 <= y <= height - 1
        samples[0, k], samples[1, k] = u, v_px
        samples[2, k] = upper * (1.0 - dy) + lower * dy
        samples[3, k] = 1.0 if inside else 0.0


@kernel
def _start(curve: Array, samples: Array, unit: Array, strip_px: float, p: Array) -> None:
    """Write the initial parameters: the curve's four, sharpness, mean, contrast."""
    outer, inner, count = 0.0, 0.0, 0
    for k in range(samples.shape[1]):
        if unit[1, k] > 0.0:
            outer += samples[2, k]
            count += 1
        else:
            inner += samples[2, k]
    outer, inner = outer / count, inner / (samples.shape[1] - count)
    for i in range(4):
        p[i] = curve[i]
    # An initial edge as soft as the strip is wide converges from anywhere in the strip.
    p[4] = -math.log(max(strip_px - 1.0, 0.5))
    p[5], p[6] = 0.5 * (outer + inner), 0.5 * (outer - inner)


@kernel
def _fit(samples: Array, cubic: float, iterations: int, converged_px: float, room: Room) -> float:
    """Fit from the initial parameters in ``room``; return the rms residual."""
    parameters, rows, inside, count = room.parameters, room.rows, samples[3], samples.shape[1]
    cost, damping, trial = math.inf, _FIRST_DAMPING, 0
    for _ in range(1 + iterations):
        _evaluate(samples, cubic, parameters[trial], rows)
        trial_cost = add_up(rows, inside, count, room.weighted, room.normal[trial])
        moved_px = 0.0
        for i in range(4):
            moved_px = max(moved_px, abs(parameters[trial, i] - parameters[0, i]))
        better = trial_cost < cost
        if better:
            accept_trial(room, trial)
            cost = trial_cost
        if trial:
            damping *= DAMPING_AFTER_SUCCESS if better else DAMPING_AFTER_FAILURE
            if better and moved_px < converged_px:
                break
        trial = 1
        damped_step(room, damping)
    total = 0.0
    for k in range(count):
        total += inside[k]
    return math.sqrt(cost / max(total, 1e-9))


@kernel
def _evaluate(samples: Array, cubic: float, p: Array, rows: Array) -> None:
    """Write the derivatives of  a + b tanh(s (v - curve(u))),  and the residuals."""
    c0, c1, c2, c3, a, b = p[0], p[1], p[2], p[3], p[5], p[6]
    s, s_by_q = sharpness(p[4])
    for k in range(samples.shape[1]):
        u = samples[0, k]
        e = samples[1, k] - (c0 + u * (c1 + u * (c2 + u * c3)))
        step = tanh(s * e)
        by_se = b * (1.0 - step * step)
        by_e = s * by_se
        rows[0, k] = -by_e
        rows[1, k] = -by_e * u
        rows[2, k] = -by_e * u * u
        rows[3, k] = -by_e * u * u * u * cubic
        rows[4, k] = s_by_q * by_se * e
        rows[5, k] = 1.0
        rows[6, k] = step
        rows[7, k] = samples[2, k] - a - b * step


@kernel
def _intersect(frames: Array, edges: Array, points: Array) -> None:
    """Write the intersections (4, 2) of each edge's curve with that of the previous edge."""
    for i in range(4):
        j = (i + 3) % 4
        begin, end = -1.0, 1.0
        for _ in range(_INTERSECTION_STEPS):
            # Newton's method on  p(begin) = q(end):  p + p' du = q + q' dw.
            px, py, px_slope, py_slope = _point_and_slope(frames[i], edges[i], begin)
            qx, qy, qx_slope, qy_slope = _point_and_slope(frames[j], edges[j], end)
            determinant = px_slope * qy_slope - py_slope * qx_slope
            if abs(determinant) < 1e-9:  # parallel: stay
                break
            dx, dy = qx - px, qy - py
            begin += (dx * qy_slope - dy * qx_slope) / determinant
            end += (dx * py_slope - dy * px_slope) / determinant
            begin, end = min(max(begin, -1.5), -0.5), min(max(end, 0.5), 1.5)
        points[i, 0], points[i, 1], _, _ = _point_and_slope(frames[i], edges[i], begin)


@kernel
def _point_and_slope(frame: Array, curve: Array, u: float) -> tuple[float, float, float, float]:
    """Return the point of an edge's curve at u, and its derivative by u."""
    across_px = curve[0] + u * (curve[1] + u * (curve[2] + u * curve[3]))
    rise_px = curve[1] + u * (2.0 * curve[2] + u * 3.0 * curve[3])
    half_px, u_px = frame[_HALF], frame[_HALF] * u
    return (
        frame[0] + u_px * frame[2] + across_px * frame[4],
        frame[1] + u_px * frame[3] + across_px * frame[5],
        half_px * frame[2] + rise_px * frame[4],
        half_px * frame[3] + rise_px * frame[5],
    )
