# Copyright 2026 p4pfr_ros maintainers
# SPDX-License-Identifier: Apache-2.0

"""
Views with the shapes of their boards, as a joint fit takes them.

A board's shape is in a frame of its own, the extent of all its points: a view may see a part.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from .bundle_adjustment import StackedViews
from ..geometry import Array
from ..model.board_shape import basis_of, covers, displacement, SHAPE_SIZE
from ..model.observation import CenteredView, Observation
from ..model.prior import shape_slice

# The shapes of at most so many boards are estimated; others are taken as flat.
MAX_BOARDS = 8

# A frame grows at most to this multiple at once: points farther away are none of the board.
_LARGEST_GROWTH = 5.0


@dataclass(frozen=True, slots=True, eq=False)
class BoardFrame:
    """The frame of a board's shape: its name, middle (2,) and half extent (2,), board units."""

    name: str
    center: Array
    half_extent: Array

    @classmethod
    def of(cls, name: str, points: Array) -> BoardFrame:
        """Return the frame of points (N, 2)."""
        low, high = points.min(axis=0), points.max(axis=0)
        return cls(name, 0.5 * (low + high), 0.5 * (high - low))

    def covers(self, points: Array) -> bool:
        """Return whether points are within the frame, or hardly outside."""
        return covers(points, self.center, self.half_extent)

    def may_reach(self, points: Array) -> bool:
        """Return whether points may be of this board, not of a much larger one."""
        reach = np.abs(points - self.center).max()
        return bool(reach <= _LARGEST_GROWTH * self.half_extent.max())

    def with_points(self, points: Array) -> BoardFrame:
        """Return the smallest frame that holds this one and points."""
        corners = self.center + np.array([-1.0, 1.0])[:, None] * self.half_extent
        return BoardFrame.of(self.name, np.vstack([corners, points]))


@dataclass(frozen=True, slots=True, eq=False)
class BoardView:
    """
    A view in a joint fit.

    name: of its board; board: its place among those whose shapes are estimated; basis (N, 8): of
    the shape, scaled as the view's points; zero for a board that is taken as flat.
    """

    view: CenteredView
    name: str
    board: int
    basis: Array

    @property
    def observation(self) -> Observation:
        """The points, independent of a camera."""
        return self.view.observation

    @property
    def image(self) -> Array:
        """The image points (N, 2), px from the middle of the image."""
        return self.view.image

    def shaped(self, common: Array) -> Observation:
        """Return the observation with its points on the real board of a fit (C,)."""
        moved = displacement(self.basis, common[shape_slice(self.board)])
        return self.observation.displaced(moved)


def board_view(view: CenteredView, name: str, boards: Sequence[BoardFrame]) -> BoardView:
    """Return a view with the basis of its board's shape; flat without a frame that covers it."""
    points, place = view.observation.board_points, place_of(name, boards)
    if place is None or view.observation.collinear or not boards[place].covers(points):
        return BoardView(view, name, 0, np.zeros((len(points), SHAPE_SIZE)))
    frame = boards[place]
    half_size = float(frame.half_extent.max())
    basis = basis_of(points, frame.center, half_size)
    return BoardView(view, name, place, basis * (half_size / view.observation.board_size))


def number_of_shapes(boards: Sequence[BoardFrame]) -> int:
    """Return the number of shapes in a fit: one that stays zero where no board has one."""
    return max(len(boards), 1)


def place_of(name: str, boards: Sequence[BoardFrame]) -> int | None:
    """Return the place of a board by its name; None if its shape is not estimated."""
    return next((i for i, frame in enumerate(boards) if frame.name == name), None)


def stacked_views(views: Sequence[BoardView]) -> StackedViews:
    """Stack the points of views, one view after the other."""
    boards = np.array([view.board for view in views], dtype=np.int64)
    if len(views) == 1:
        [view] = views
        starts = np.array([0, len(view.image)])
        return StackedViews(view.image, view.view.board, view.basis, starts, boards)
    starts = np.zeros(len(views) + 1, dtype=np.int64)
    np.cumsum([len(view.image) for view in views], out=starts[1:])
    return StackedViews(
        np.concatenate([view.image for view in views]),
        np.concatenate([view.view.board for view in views]),
        np.concatenate([view.basis for view in views]),
        starts,
        boards,
    )
