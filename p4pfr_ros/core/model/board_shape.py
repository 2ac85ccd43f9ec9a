# Copyright 2026 p4pfr_ros maintainers
# SPDX-License-Identifier: Apache-2.0

"""
The shape of a real board: printed a little too wide, mounted a little bent.

Eight numbers for each board, common to all its views. With the point (x, y) of the board from the
middle of its points, in units of the larger half of their extent, h,

    point = board point + h (a x + b y, b x - a y, Σ cᵢ φᵢ(x, y)),
    φ = P2(x), P2(y), x y, P2(x) P2(y), P4(x), P4(y),

P: Legendre polynomials. A scale of the whole board cannot be told from its distance.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike

from ..geometry import Array, as_points, fields_equal, read_only

SHAPE_SIZE = 8
STRETCH, SKEW, WARP = 0, 1, 2

# Standard deviations of real boards: paper is stretched by 0.1 %, paper and foam are bowed.
SHAPE_SIGMAS = np.array([0.001, 0.001, 0.003, 0.003, 0.003, 0.002, 0.002, 0.002])

# A shape is a polynomial: beyond the board's points by this share of the half size it is not
# extrapolated.
_BEYOND = 0.1

# Heights are sampled on a grid of so many points along a side.
_ALONG_A_SIDE = 21


@dataclass(frozen=True, slots=True, eq=False, repr=False)
class BoardShape:
    """
    How a board deviates from its specification.

    Parameters
    ----------
    center : (2,) array
        Middle of the board's points, board units.
    half_extent : (2,) array
        Half of their extent along x and y, board units; the larger one is the unit of the shape.
    numbers : (8,) array
        Stretch (of x, and shrinkage of y), skew, and the six coefficients of the height, all as
        shares of the larger half extent.
    covariance : (8, 8) array
        Their covariance.

    Raises
    ------
    ValueError
        A wrong shape, a number that is not finite, or no extent.

    """

    center: Array
    half_extent: Array
    numbers: Array
    covariance: Array

    def __post_init__(self) -> None:
        for name, shape in (
            ('center', (2,)),
            ('half_extent', (2,)),
            ('numbers', (SHAPE_SIZE,)),
            ('covariance', (SHAPE_SIZE, SHAPE_SIZE)),
        ):
            array = as_points(getattr(self, name), name, shape)
            object.__setattr__(self, name, read_only(array.copy()))
        if not (self.half_extent >= 0.0).all() or not self.half_extent.max() > 0.0:
            raise ValueError(f'half_extent must be > 0, got {self.half_extent.tolist()}')

    def __eq__(self, other: object) -> bool:
        return fields_equal(self, other)

    __hash__ = None  # type: ignore[assignment]

    def __repr__(self) -> str:
        return f'BoardShape(bow={self.bow:.3g}, stretch={self.stretch:.3g}, skew={self.skew:.3g})'

    @property
    def half_size(self) -> float:
        """The unit of the shape: the larger half extent, board units."""
        return float(self.half_extent.max())

    @property
    def stretch(self) -> float:
        """By which share the board is wider than specified, compared with its height."""
        return 2.0 * float(self.numbers[STRETCH])

    @property
    def stretch_sigma(self) -> float:
        """Standard deviation of ``stretch``."""
        return 2.0 * float(np.sqrt(max(self.covariance[STRETCH, STRETCH], 0.0)))

    @property
    def skew(self) -> float:
        """By which angle, radians, the board's axes are off a right angle."""
        return 2.0 * float(self.numbers[SKEW])

    @property
    def bow(self) -> float:
        """Largest minus smallest height over the board's best plane, board units."""
        return float(np.ptp(self._basis_of_heights() @ self.numbers[WARP:])) * self.half_size

    @property
    def bow_sigma(self) -> float:
        """Standard deviation of the height where the bow is largest, board units."""
        basis = self._basis_of_heights()
        heights = basis @ self.numbers[WARP:]
        across = basis[np.argmax(heights)] - basis[np.argmin(heights)]
        if not np.ptp(heights) > 0.0:
            across = basis[np.argmax(np.sum(basis**2, axis=1))]
        variance = float(across @ self.covariance[WARP:, WARP:] @ across)
        return float(np.sqrt(max(variance, 0.0))) * self.half_size

    def points(self, board_points: ArrayLike) -> Array:
        """Return where points (N, 2) of the specification are on the real board, (N, 3)."""
        points = np.asarray(board_points, dtype=np.float64)
        moved = displacement(basis_of(points, self.center, self.half_size), self.numbers)
        return np.pad(points, ((0, 0), (0, 1))) + self.half_size * moved

    def covers(self, board_points: Array) -> bool:
        """Return whether points (N, 2) of the specification are where the shape is known."""
        return covers(board_points, self.center, self.half_extent)

    def _basis_of_heights(self) -> Array:
        """Return the polynomials of the height over the board, without their best plane."""
        x, y = (np.linspace(-half, half, _ALONG_A_SIDE) for half in self.half_extent)
        grid = np.stack(np.meshgrid(x, y), axis=-1).reshape(-1, 2)
        basis = basis_of(grid, np.zeros(2), self.half_size)[:, WARP:]
        plane = np.column_stack([grid, np.ones(len(grid))])
        flat: Array = basis - plane @ np.linalg.lstsq(plane, basis, rcond=None)[0]
        return flat


def covers(board_points: Array, center: Array, half_extent: Array) -> bool:
    """Return whether points (N, 2) are within the extent of a board, or hardly outside."""
    beyond = np.abs(board_points - center) - half_extent
    return bool(beyond.max() <= _BEYOND * half_extent.max())


def basis_of(board_points: Array, center: Array, half_size: float) -> Array:
    """Return x, y and the six polynomials of the height at board points, (N, 8)."""
    x, y = ((board_points - center) / half_size).T
    x2, y2 = 1.5 * x * x - 0.5, 1.5 * y * y - 0.5
    x4, y4 = (0.125 * (t * t * (35.0 * t * t - 30.0) + 3.0) for t in (x, y))
    return np.stack([x, y, x2, y2, x * y, x2 * y2, x4, y4], axis=-1)


def displacement(basis: Array, numbers: Array) -> Array:
    """Return the displacement (N, 3), in units of the basis, that a shape (8,) makes."""
    x, y = basis[:, 0], basis[:, 1]
    a, b = numbers[STRETCH], numbers[SKEW]
    return np.stack([a * x + b * y, b * x - a * y, basis[:, WARP:] @ numbers[WARP:]], axis=-1)
