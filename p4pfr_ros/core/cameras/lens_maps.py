# Copyright 2026 p4pfr_ros maintainers
# SPDX-License-Identifier: Apache-2.0

"""
The lenses that ROS has names for, as maps between rays and the plane of unit focal length.

Each map is one to one up to its first fold, and NaN beyond: a polynomial that turns back would
show things twice that a lens shows once.
"""

from __future__ import annotations

import math
from typing import Protocol

import numpy as np
from numpy.polynomial import polynomial as poly

from ..geometry import Array

_TABLE_SIZE = 1024
_MAX_STEPS = 20
# Of the plane of unit focal length: 1e-10 px where the focal length is 1000 px.
_CONVERGED = 1e-13
# A ray nearer than this to 90 degrees has no place on a plane before the camera.
_NEARLY_SIDEWAYS_RAD = 1e-6
_BEFORE_POLE = 1.0 - 1e-9
# A pair of roots that close to the real axis is a slope that all but vanishes.
_NEARLY_REAL = 1e-7
_NEGLIGIBLE = 1e-60


class LensMap(Protocol):
    """A lens about its axis, apart from focal length and centre."""

    def distort(self, rays: Array) -> Array:
        """Take rays (N, 3) to the plane (N, 2); NaN beyond the fold."""
        ...

    def undistort(self, points: Array) -> Array:
        """Take points of the plane (N, 2) to unit rays (N, 3); NaN where there is none."""
        ...

    def radii(self, angles_rad: Array) -> Array:
        """Return the radii (N,) in the plane at angles to the axis, without tangential terms."""
        ...


class PolynomialLens:
    """
    OpenCV's lens: plumb_bob (k1 k2 p1 p2 k3) and rational_polynomial (and k4 k5 k6).

    With (x, y) = (X, Y) / Z and q = x² + y² the point of the plane is

        (x, y) N(q) / D(q) + (2 p1 x y + p2 (q + 2 x²), p1 (q + 2 y²) + 2 p2 x y),
        N = 1 + k1 q + k2 q² + k3 q³,    D = 1 + k4 q + k5 q² + k6 q³.
    """

    def __init__(self, coefficients: tuple[float, ...]) -> None:
        k1, k2, p1, p2, k3, k4, k5, k6 = (*coefficients, *[0.0] * (8 - len(coefficients)))
        self._tangential = p1, p2
        self._n, self._d = np.array([1.0, k1, k2, k3]), np.array([1.0, k4, k5, k6])
        # √q N / D has the slope (N D + 2 q (N' D - N D')) / D².
        with np.errstate(all='ignore'):
            self._turn = poly.polysub(
                poly.polymul(poly.polyder(self._n), self._d),
                poly.polymul(self._n, poly.polyder(self._d)),
            )
            slope = poly.polyadd(poly.polymul(self._n, self._d), 2.0 * poly.polymulx(self._turn))
        fold, pole = smallest_positive_root(slope), smallest_positive_root(self._d)
        self._q_end = min(fold, pole * _BEFORE_POLE)

    def distort(self, rays: Array) -> Array:
        """Take rays (N, 3) to the plane (N, 2); NaN beyond the fold and for Z ≤ 0."""
        with np.errstate(all='ignore'):
            flat = rays[:, :2] / np.where(rays[:, 2:] > 0.0, rays[:, 2:], np.nan)
            return self._within(flat, self._forward(flat)[0])

    def undistort(self, points: Array) -> Array:
        """Take points of the plane (N, 2) to unit rays (N, 3); NaN where there is none."""
        radius = np.linalg.norm(points, axis=1, keepdims=True)
        with np.errstate(all='ignore'):
            scale = np.tan(_angle_table(self, self._end_rad, radius)) / radius
            flat = points * np.where(radius > 0.0, scale, 1.0)
            for _ in range(_MAX_STEPS):
                reached, ((a, b), (_, d)) = self._forward(flat)
                ex, ey = (points - reached).T
                if not (np.hypot(ex, ey) > _CONVERGED).any():
                    break
                step = np.stack([d * ex - b * ey, a * ey - b * ex], axis=1)
                flat = flat + step / (a * d - b * b)[:, None]
            missed = np.abs(self._forward(flat)[0] - points).max(axis=1, keepdims=True)
            close = missed <= 10.0 * _CONVERGED * np.maximum(1.0, radius)
            flat = self._within(flat, np.where(close, flat, np.nan))
        rays = np.column_stack([flat, np.ones(len(flat))])
        unit: Array = rays / np.linalg.norm(rays, axis=1, keepdims=True)
        return unit

    def radii(self, angles_rad: Array) -> Array:
        """Return the radii (N,) in the plane at angles to the axis, below 90 degrees."""
        rho = np.tan(angles_rad)
        radii: Array = rho * poly.polyval(rho**2, self._n) / poly.polyval(rho**2, self._d)
        return radii

    @property
    def _end_rad(self) -> float:
        return min(math.atan(math.sqrt(self._q_end)), 0.5 * math.pi - _NEARLY_SIDEWAYS_RAD)

    def _within(self, flat: Array, values: Array) -> Array:
        q = np.sum(flat**2, axis=1, keepdims=True)
        return np.where(q <= self._q_end, values, np.nan)

    def _forward(self, flat: Array) -> tuple[Array, tuple[tuple[Array, Array], ...]]:
        """Return the points of the plane (N, 2) and their derivatives, each (N,)."""
        (x, y), (p1, p2) = flat.T, self._tangential
        q = x * x + y * y
        n, d = poly.polyval(q, self._n), poly.polyval(q, self._d)
        g, slope = n / d, 2.0 * poly.polyval(q, self._turn) / (d * d)
        points = np.stack(
            [
                x * g + 2.0 * p1 * x * y + p2 * (q + 2.0 * x * x),
                y * g + p1 * (q + 2.0 * y * y) + 2.0 * p2 * x * y,
            ],
            axis=1,
        )
        across = x * y * slope + 2.0 * (p1 * x + p2 * y)
        by_x = g + x * x * slope + 2.0 * p1 * y + 6.0 * p2 * x
        by_y = g + y * y * slope + 6.0 * p1 * y + 2.0 * p2 * x
        return points, ((by_x, across), (across, by_y))


class EquidistantLens:
    """
    OpenCV's fisheye lens, equidistant in ROS.

    A ray at the angle θ to the axis has the radius θ (1 + k1 θ² + k2 θ⁴ + k3 θ⁶ + k4 θ⁸) in the
    plane; rays from behind (θ above 90°) have one too.
    """

    def __init__(self, coefficients: tuple[float, ...]) -> None:
        self._n = np.array([1.0, *coefficients])
        with np.errstate(all='ignore'):
            self._slope = self._n * np.arange(1.0, 2 * len(self._n), 2.0)
        self._end_rad = min(math.sqrt(smallest_positive_root(self._slope)), math.pi)

    def distort(self, rays: Array) -> Array:
        """Take rays (N, 3) to the plane (N, 2); NaN beyond the fold and on the backward axis."""
        rho = np.linalg.norm(rays[:, :2], axis=1, keepdims=True)
        angle = np.arctan2(rho, rays[:, 2:])
        with np.errstate(all='ignore'):
            seen = (angle <= self._end_rad) & (angle < math.pi) & ((rho > 0.0) | (angle == 0.0))
            scale = np.where(rho > 0.0, self.radii(angle) / rho, 0.0)
        points: Array = rays[:, :2] * np.where(seen, scale, np.nan)
        return points

    def undistort(self, points: Array) -> Array:
        """Take points of the plane (N, 2) to unit rays (N, 3); NaN where there is none."""
        radius = np.linalg.norm(points, axis=1, keepdims=True)
        with np.errstate(all='ignore'):
            angle = _angle_table(self, self._end_rad, radius)
            for _ in range(_MAX_STEPS):
                missed = radius - self.radii(angle)
                if not (np.abs(missed) > _CONVERGED).any():
                    break
                angle = angle + missed / poly.polyval(angle**2, self._slope)
            close = np.abs(radius - self.radii(angle)) <= 10.0 * _CONVERGED
            angle = np.where(close & (angle <= self._end_rad), angle, np.nan)
            scale = np.where(radius > 0.0, np.sin(angle) / radius, 1.0)
        return np.concatenate([points * scale, np.cos(angle)], axis=1)

    def radii(self, angles_rad: Array) -> Array:
        """Return the radii in the plane at angles to the axis."""
        radii: Array = angles_rad * poly.polyval(angles_rad**2, self._n)
        return radii


def lens_map(distortion_model: str, coefficients: tuple[float, ...]) -> LensMap:
    """Make the map of a model by its name in ROS."""
    kind = EquidistantLens if distortion_model == 'equidistant' else PolynomialLens
    return kind(coefficients)


def smallest_positive_root(polynomial: Array) -> float:
    """Return it, of ascending coefficients; infinite where there is none, 0 where not finite."""
    if not np.isfinite(polynomial).all():
        return 0.0
    size = np.abs(polynomial)
    roots = poly.polyroots(poly.polytrim(np.where(size > _NEGLIGIBLE * size.max(), polynomial, 0)))
    real = roots.real[(np.abs(roots.imag) <= _NEARLY_REAL * np.abs(roots)) & (roots.real > 0.0)]
    return float(real.min()) if real.size else math.inf


def _angle_table(lens: LensMap, end_rad: float, radius: Array) -> Array:
    """Look up the angle of a radius, well enough for Newton's method to start."""
    angles = np.linspace(0.0, end_rad, _TABLE_SIZE)
    table: Array = np.interp(radius, lens.radii(angles), angles)
    return table
