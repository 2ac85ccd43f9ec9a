# Copyright 2026 p4pfr_ros maintainers
# SPDX-License-Identifier: Apache-2.0

"""
Search for lattices of circles among dark ellipses.

The ellipse that shows a circle also shows how its surroundings are foreshortened: in units of its
own radii, the neighbours in a square lattice are at one distance, in four directions that are
perpendicular, however the board is tilted and the lens bends it. So no model of lens or board is
needed, only the ratio of spacing and diameter. The time depends on the number of ellipses, which
is limited, and on nothing else.

This module stands alone: it is numerics, without boards, and has tests of its own.
"""

from __future__ import annotations

import numpy as np
from p4pfr_ros.core.geometry import Array, Ints, Mask
from p4pfr_ros.detection.ellipse_blobs import Blobs, CLEARLY_LARGER
from p4pfr_ros.detection.square_lattice import joined

# Distances of neighbours, in expected spacings: diagonal ones are at 1.4.
_NEAREST, _FARTHEST = 0.5, 1.25
_FARTHEST_DIAGONAL = 1.8
# Blur makes up at most this part of the smallest second moment, or divides radii by this.
_MAX_BLUR, _MAX_SHRINKAGE = 0.6, 1.5
# Largest angle between a neighbour and its edge, radians.
_MAX_ANGLE = np.radians(27.0)
# An ellipse belongs to a cell if it is so near the expected place, in spacings.
_NEAR_CELL = 0.3
# Lattices grow by so many lines beyond those that their squares show.
_ROUNDS = 4
# Pairs of ellipses are compared in portions of about this number.
_PORTION = 400_000


def circle_lattices(blobs: Blobs, spacing_in_radii: float, at_least: int) -> list[Ints]:
    """
    Group ellipses into lattices of at least so many, the largest first.

    Parameters
    ----------
    blobs
        The ellipses.
    spacing_in_radii
        Distance of neighbouring centres, in radii of a circle.
    at_least
        Number of ellipses of the smallest lattice that lie in squares of four.

    Returns
    -------
    Each lattice as the indices (n, m) of its ellipses in their cells, -1 where there is none. Its
    second direction is turned from the first one as y is from x.

    """
    links, length2 = _links(blobs, spacing_in_radii)
    is_free = np.ones(len(blobs.middles), dtype=bool)
    lattices = []
    for members, cells in joined(links, length2, at_least):
        # A larger lattice may have grown over this one, from which covered circles parted it.
        members, cells = members[is_free[members]], cells[is_free[members]]
        if len(members) >= at_least:
            lattice = np.full(cells.max(axis=0) + 1, -1)
            lattice[cells[:, 0], cells[:, 1]] = members
            is_free[members] = False
            lattices.append(_grown(lattice, blobs, spacing_in_radii, is_free))
    return sorted(lattices, key=lambda each: -int((each >= 0).sum()))


def _links(blobs: Blobs, spacing_in_radii: float) -> tuple[Ints, Array]:
    """Return the nearest neighbour of each ellipse along its four edges (M, 4); its distance²."""
    i, j = _pairs(blobs, spacing_in_radii)
    distance = _distances(i, j, blobs, spacing_in_radii)
    good = distance > _NEAREST
    i, j, distance = i[good], j[good], distance[good]
    if len(i):
        blobs = _unblurred(i, distance, blobs)
        distance = _distances(i, j, blobs, spacing_in_radii)
    # The offset to the neighbour as seen from straight above, but for a turn.
    offset = np.einsum(
        'pij,pj->pi', _inverse_roots(blobs.moments)[i], blobs.middles[j] - blobs.middles[i]
    )
    angle = np.arctan2(offset[:, 1], offset[:, 0])
    # The direction of an edge modulo a quarter turn: neighbours and diagonal ones agree on it.
    weight = np.where(
        distance < _FARTHEST, 1.0, np.where(distance < _FARTHEST_DIAGONAL, -1.0, 0.0)
    )
    vote = weight * np.exp(4j * angle)
    edge_angle = 0.25 * np.angle(
        np.bincount(i, vote.real, len(blobs.middles))
        + 1j * np.bincount(i, vote.imag, len(blobs.middles))
    )
    quarters = (angle - edge_angle[i]) / (0.5 * np.pi)
    edge = np.rint(quarters).astype(np.int64)
    good = np.abs(quarters - edge) < _MAX_ANGLE / (0.5 * np.pi)
    good &= distance < _FARTHEST
    i, j, edge, distance = i[good], j[good], edge[good] % 4, distance[good]
    links = np.full((len(blobs.middles), 4), -1)
    length2 = np.full((len(blobs.middles), 4), np.inf)
    farthest_first = np.argsort(-distance, kind='stable')
    at = i[farthest_first], edge[farthest_first]
    links[at], length2[at] = j[farthest_first], distance[farthest_first] ** 2
    return links, length2


def _pairs(blobs: Blobs, spacing_in_radii: float) -> tuple[Ints, Ints]:
    """
    Return the indices (P,), (P,) of pairs of ellipses that may be neighbours, or diagonal ones.

    Each pair is there twice, once from each side.
    """
    middles, inverses = blobs.middles, np.linalg.inv(blobs.moments)
    area2 = np.linalg.det(blobs.moments)
    # Radii are twice the roots of the moments.
    unit2 = (2.0 * spacing_in_radii) ** 2
    portion = max(1, _PORTION // max(1, len(middles)))
    found = []
    for first in range(0, len(middles), portion):
        own = slice(first, first + portion)
        dx, dy = (middles[:, axis] - middles[own, axis, None] for axis in (0, 1))
        (xx, xy), (_, yy) = inverses[own].transpose(1, 2, 0)[..., None]
        distance2 = (xx * dx + 2.0 * xy * dy) * dx + yy * dy * dy
        near = distance2 < 2.0 * _FARTHEST_DIAGONAL**2 * unit2
        near &= distance2 > 0.5 * _NEAREST**2 * unit2
        ratio2 = area2 / area2[own, None]
        near &= (ratio2 < CLEARLY_LARGER**2) & (ratio2 > CLEARLY_LARGER**-2)
        i, j = np.nonzero(near)
        found.append((i + first, j))
    i, j = (np.concatenate(each) for each in zip(*found, strict=True)) if found else (_NONE, _NONE)
    return i, j


def _distances(i: Ints, j: Ints, blobs: Blobs, spacing_in_radii: float) -> Array:
    """Return the distances (P,) of pairs of ellipses, in expected spacings."""
    # The mean of both ellipses is the better measure: it allows for perspective.
    offset = blobs.middles[j] - blobs.middles[i]
    inverse = np.linalg.inv(0.5 * (blobs.moments[i] + blobs.moments[j]))
    # Radii are twice the roots of the moments.
    distance: Array = np.sqrt(np.einsum('pi,pij,pj->p', offset, inverse, offset))
    return distance / (2.0 * spacing_in_radii)


def _unblurred(i: Ints, distance: Array, blobs: Blobs) -> Blobs:
    """
    Return ellipses as sharp ones of the expected spacing would be.

    How much is wrong is seen from the second nearest neighbour (P,): corners of a grid have two.
    Blur adds the same to the second moments in all directions, and makes ellipses too large and
    too round; of those with little white in between, it leaves too small a part.
    """
    order = np.lexsort((distance, i))
    own = np.arange(len(blobs.middles))
    second = np.minimum(np.searchsorted(i[order], own) + 1, len(order) - 1)
    has_two = i[order[second]] == own
    ratio2 = np.where(has_two, np.minimum(distance[order[second]], _MAX_SHRINKAGE) ** 2, 1.0)
    smallest = np.linalg.eigvalsh(blobs.moments)[:, 0]
    added = smallest * np.clip(1.0 - ratio2, 0.0, _MAX_BLUR)
    moments = blobs.moments - added[:, None, None] * np.eye(2)
    return Blobs(blobs.middles, moments * np.maximum(ratio2, 1.0)[:, None, None])


_NONE = np.empty(0, dtype=np.int64)


def _inverse_roots(moments: Array) -> Array:
    """Return the inverse square roots of symmetric matrices (M, 2, 2)."""
    values, vectors = np.linalg.eigh(moments)
    roots: Array = vectors / np.sqrt(values)[:, None] @ vectors.swapaxes(1, 2)
    return roots


def _grown(lattice: Ints, blobs: Blobs, spacing_in_radii: float, is_free: Mask) -> Ints:
    """
    Return a lattice (n, m) with ellipses that lie where its lines continue, or in its gaps.

    So it gains circles that are in no square, such as some corners of an asymmetric grid, and
    those that covered ones part from the others.
    """
    for _ in range(_ROUNDS):
        lattice = np.pad(lattice, 2, constant_values=-1)
        is_found = (lattice >= 0)[..., None]
        # Also beyond a gap.
        near = _with_expected(np.where(is_found, blobs.middles[lattice], np.nan))
        places = np.where(is_found, np.nan, _with_expected(near))
        cells = np.argwhere(np.isfinite(places[..., 0]))
        expected = places[tuple(cells.T)]
        free = np.flatnonzero(is_free & _is_around(blobs.middles, expected))
        if not len(free):
            break
        offset = expected[:, None] - blobs.middles[free]
        nearest = np.sum(offset**2, axis=2).argmin(axis=1)
        offset = offset[np.arange(len(cells)), nearest]
        members = free[nearest]
        inverses = np.linalg.inv(blobs.moments[members])
        distance2 = np.einsum('pi,pij,pj->p', offset, inverses, offset)
        good = np.flatnonzero(distance2 < (2.0 * spacing_in_radii * _NEAR_CELL) ** 2)
        # Of several cells near an ellipse, the nearest one.
        good = good[np.argsort(distance2[good], kind='stable')]
        good = good[np.unique(members[good], return_index=True)[1]]
        if not len(good):
            break
        lattice[tuple(cells[good].T)] = members[good]
        is_free[members[good]] = False
    taken = np.argwhere(lattice >= 0)
    low, high = taken.min(axis=0), taken.max(axis=0) + 1
    return lattice[low[0] : high[0], low[1] : high[1]]


def _is_around(points: Array, places: Array) -> Mask:
    """Return which points (M, 2) px are among some places (K, 2), or near their outermost."""
    if not len(places):
        return np.zeros(len(points), dtype=bool)
    low, high = places.min(axis=0), places.max(axis=0)
    margin_px = 0.1 * (high - low).max() + 1.0
    is_inside = (points > low - margin_px) & (points < high + margin_px)
    return np.asarray(is_inside.all(axis=1))


def _with_expected(points: Array) -> Array:
    """Return points (n, m, 2) with those next to them where their lines continue; NaN: unknown."""
    padded = np.pad(points, ((2, 2), (2, 2), (0, 0)), constant_values=np.nan)
    total, count = np.zeros_like(points), np.zeros((*points.shape[:2], 1))
    for axis in (0, 1):
        before2, before, after, after2 = (
            np.roll(padded, shift, axis=axis)[2:-2, 2:-2] for shift in (2, 1, -1, -2)
        )
        for guess in (0.5 * (before + after), 2.0 * before - before2, 2.0 * after - after2):
            total += np.nan_to_num(guess)
            count += np.isfinite(guess[..., :1])
    with np.errstate(invalid='ignore'):
        return np.where(np.isnan(points), total / count, points)
