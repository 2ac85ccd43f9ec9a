# Copyright 2026 p4pfr_ros maintainers
# SPDX-License-Identifier: Apache-2.0

"""
Lattices of points that know their neighbours along four edges, in any orientation.

This module stands apart from the searches of saddles and of circles, which find the neighbours:
how these join to lattices is the same for both.
"""

from __future__ import annotations

import numpy as np
from p4pfr_ros.core.geometry import Array, Ints, Mask
from p4pfr_ros.core.jit import kernel

# Largest ratio of the lengths of two squares in a line.
_MAX_LENGTH_RATIO = 2.0


def joined(links: Ints, length2: Array, at_least: int) -> list[tuple[Ints, Ints]]:
    """
    Group points into lattices of at least so many points, the largest first.

    Parameters
    ----------
    links, length2
        The neighbour of each point along its four edges (N, 4), or -1, and the squared distances
        (N, 4). The edges are numbered in the direction from x to y, with any of them first.
    at_least
        Size of the smallest lattice.

    Returns
    -------
    For each lattice the indices (M,) of its points and their cells (M, 2): integers along its
    two directions, from (0, 0); no cell twice, but of several points the first.

    """
    count = len(links)
    back = np.empty((count, 4), np.int64)
    in_square = np.zeros((count, 4), np.bool_)
    lattice, cells = np.empty(count, np.int64), np.empty((count, 3), np.int64)
    _keep_mutual(links, length2, back)
    _mark_squares(links, back, in_square)
    _spread(links, back, in_square, lattice, cells, np.empty(count, np.int64))
    sizes = np.bincount(lattice, minlength=1) if count else np.zeros(1, np.int64)
    found = []
    for label in np.argsort(-sizes, kind='stable').tolist():
        if sizes[label] < at_least:
            break
        members = np.flatnonzero(lattice == label)
        corner = cells[members, :2].min(axis=0)
        distinct, first = np.unique(cells[members, :2] - corner, axis=0, return_index=True)
        found.append((members[first], distinct))
    return found


@kernel
def _keep_mutual(links: Ints, length2: Array, back: Ints) -> None:
    """
    Drop links that are not mutual, or long; write to which edge of the neighbour each one leads.

    A long one is longer than the one on the other side of the point: it leads to another board.
    """
    for i in range(len(links)):
        for p in range(4):
            back[i, p] = -1
            j = links[i, p]
            for q in range(4):
                if j >= 0 and links[j, q] == i:
                    back[i, p] = q
    for i in range(len(links)):
        for p in range(4):
            opposite, q = (p + 2) % 4, back[i, p]
            is_long = length2[i, p] > _MAX_LENGTH_RATIO**2 * length2[i, opposite]
            if q >= 0 and links[i, opposite] >= 0 and is_long:
                back[links[i, p], q] = back[i, p] = -1
    for i in range(len(links)):
        for p in range(4):
            if back[i, p] < 0:
                links[i, p] = -1


@kernel
def _mark_squares(links: Ints, back: Ints, in_square: Mask) -> None:
    """Mark the links that are sides of a square; other ones lead out of the board."""
    for i in range(len(links)):
        for p in range(4):
            p1 = (p + 1) % 4
            j, k = links[i, p], links[i, p1]
            if j < 0 or k < 0:
                continue
            # If edge q of j leads back to i, edge q - 1 of j is parallel to edge p + 1 of i.
            across, along = (back[i, p] + 3) % 4, (back[i, p1] + 1) % 4
            if links[j, across] >= 0 and links[j, across] == links[k, along]:
                in_square[i, p] = in_square[i, p1] = True


@kernel
def _spread(
    links: Ints, back: Ints, in_square: Mask, lattice: Ints, cells: Ints, queue: Ints
) -> None:
    """
    Give points joined by sides of squares one number; write their cells and orientations.

    cells (N, 3): an orientation o says that edge p points along the lattice's direction p + o
    (modulo 4), where 0 to 3 are (1, 0), (0, 1), (-1, 0), (0, -1).
    """
    count = len(links)
    for i in range(count):
        lattice[i] = -1
    label = 0
    for seed in range(count):
        if lattice[seed] >= 0:
            continue
        lattice[seed] = label
        cells[seed, 0] = cells[seed, 1] = cells[seed, 2] = 0
        queue[0] = seed
        begin, end = 0, 1
        while begin < end:
            i = queue[begin]
            begin += 1
            for p in range(4):
                j = links[i, p]
                if not in_square[i, p] or lattice[j] >= 0:
                    continue
                direction = (p + cells[i, 2]) % 4
                cells[j, 0] = cells[i, 0] + (direction == 0) - (direction == 2)
                cells[j, 1] = cells[i, 1] + (direction == 1) - (direction == 3)
                cells[j, 2] = (direction + 2 - back[i, p]) % 4
                lattice[j] = label
                queue[end] = j
                end += 1
        label += 1
