# Copyright 2026 p4pfr_ros maintainers
# SPDX-License-Identifier: Apache-2.0

"""Whether the minimal solver finds the truth, and whether all that it returns holds."""

from __future__ import annotations

from dataclasses import dataclass
import functools
import operator

import numpy as np
from p4pfr_ros import solve_p4pfr_batch
from p4pfr_ros.core.geometry import Array
from p4pfr_ros.core.minimal.solver import SolutionBatch
from p4pfr_ros.scenes.instances import IMAGE_SIZE, Instances, instances, KINDS

_CHUNK = 20_000

# A solution that misses a point by more than this share of the image's size is reported.
_REPROJECTION = 1e-9

# Of the translation's size, in the bound for what lies beyond.
_ROUNDINGS = 4.0


@dataclass(frozen=True, slots=True)
class Accuracy:
    """What was found over instances of a class."""

    instances: int
    to_1e6: int  # instances with the truth among the solutions, to 1e-6
    to_1e3: int
    solutions: int
    off_rotation: float  # largest |RᵀR - I|
    behind: int  # solutions with a depth λ ≤ 0
    off_px: float  # largest distance of a reprojected point
    over: int  # solutions that reproject worse than 1e-9 of the image's size
    unexplained: int  # those among them that rounding of the translation does not explain

    def __add__(self, other: Accuracy) -> Accuracy:
        """Take the instances of both together."""
        return Accuracy(
            instances=self.instances + other.instances,
            to_1e6=self.to_1e6 + other.to_1e6,
            to_1e3=self.to_1e3 + other.to_1e3,
            solutions=self.solutions + other.solutions,
            off_rotation=max(self.off_rotation, other.off_rotation),
            behind=self.behind + other.behind,
            off_px=max(self.off_px, other.off_px),
            over=self.over + other.over,
            unexplained=self.unexplained + other.unexplained,
        )

    @property
    def sound(self) -> bool:
        """Say whether every returned solution passes its checks."""
        return self.off_rotation < 1e-12 and self.behind == 0 and self.unexplained == 0


@dataclass(frozen=True, slots=True)
class Class:
    """Instances of a kind, with their board measured in another unit or from another origin."""

    kind: str
    scale: float = 1.0
    shift: float = 0.0

    def draw(self, n: int, seed: int) -> Instances:
        """Draw n instances; what concerns the translation is the board's before the change."""
        drawn = instances(self.kind, n, seed)
        board = self.scale * drawn.board_points + self.shift
        return Instances(
            drawn.image_points, board, drawn.focal_px, drawn.k, drawn.rotation, drawn.translation
        )


CLASSES = {kind: Class(kind) for kind in KINDS} | {
    'patch, board in mm': Class('patch', scale=1e3),
    'patch, board in km': Class('patch', scale=1e-3),
    'patch, board moved by 1000': Class('patch', shift=1000.0),
}


def measure(chosen: Class, n: int) -> Accuracy:
    """Solve n instances and look at every solution."""
    chunks = (
        chosen.draw(min(_CHUNK, n - start), seed) for seed, start in enumerate(range(0, n, _CHUNK))
    )
    return functools.reduce(operator.add, map(_measure_chunk, chunks))


def _measure_chunk(drawn: Instances) -> Accuracy:
    batch = solve_p4pfr_batch(drawn.image_points, drawn.board_points)
    error = errors(drawn, batch)
    there = np.arange(batch.k.shape[1]) < batch.count[:, None]
    instance = np.nonzero(there)[0]
    rotation, translation = batch.rotation[there], batch.translation[there]
    focal_px, k = batch.focal_px[there], batch.k[there]
    image, board = drawn.image_points[instance], drawn.board_points[instance]
    points = np.einsum('nij,npj->npi', rotation[:, :, :2], board) + translation[:, None]
    missed_px = np.linalg.norm(project(points, focal_px, k) - image, axis=-1).max(axis=1)
    # The depth λ > 0 takes the pixel's ray to its point: they look the same way.
    along = np.sum(points * _rays(image, focal_px, k), axis=-1)
    product = np.einsum('nji,njk->nik', rotation, rotation)
    over = ~(missed_px < _REPROJECTION * max(IMAGE_SIZE))
    floor_px = _rounding_px(points[over], translation[over], focal_px[over], k[over])
    return Accuracy(
        instances=len(drawn),
        to_1e6=int(np.sum(error < 1e-6)),
        to_1e3=int(np.sum(error < 1e-3)),
        solutions=len(instance),
        off_rotation=float(np.abs(product - np.eye(3)).max(initial=0.0)),
        behind=int(np.sum(~(along > 0.0).all(axis=1))),
        off_px=float(missed_px.max(initial=0.0)),
        over=int(np.sum(over)),
        unexplained=int(np.sum(~(missed_px[over] < floor_px))),
    )


def _rounding_px(points: Array, translation: Array, focal_px: Array, k: Array) -> Array:
    """Bound what a few roundings of numbers as large as the translation move in the image."""
    step = 1e-7 * np.linalg.norm(points, axis=-1, keepdims=True)
    moved = [
        project(points + sign * step * axis, focal_px, k)
        for axis in np.eye(3)
        for sign in (1.0, -1.0)
    ]
    by_axis = [
        np.linalg.norm(there - back, axis=-1, keepdims=True) / (2.0 * step)
        for there, back in zip(moved[::2], moved[1::2], strict=True)
    ]
    px_per_unit = np.max(by_axis, axis=(0, 2, 3), initial=0.0)
    rounding = _ROUNDINGS * np.finfo(float).eps * np.linalg.norm(translation, axis=-1)
    bound: Array = px_per_unit * rounding
    return bound


def errors(drawn: Instances, batch: SolutionBatch) -> Array:
    """Return the error of the best solution, the larger of focal length's and rotation's (n,)."""
    with np.errstate(invalid='ignore'):
        focal = np.abs(batch.focal_px / drawn.focal_px[:, None] - 1.0)
        # |A - B|_F = 2√2 sin(angle / 2): over √2 it is the angle, where the angle is small.
        chord = np.linalg.norm(batch.rotation - drawn.rotation[:, None], axis=(-2, -1))
    error = np.maximum(focal, chord / np.sqrt(2.0))
    best: Array = np.where(np.isnan(error), np.inf, error).min(axis=1)
    return best


def project(points: Array, focal_px: Array, k: Array) -> Array:
    """Project (n, p, 3) points by n division cameras: written anew, to check the package's."""
    xy, z = points[..., :2], points[..., 2]
    k = k[:, None]
    rho2 = np.sum(xy**2, axis=-1)
    with np.errstate(invalid='ignore', divide='ignore'):
        root = np.sqrt(z**2 - 4.0 * k * rho2)
        scale = np.where(z < 0.0, (z - root) / (2.0 * k * rho2), 2.0 / (z + root))
    pixels: Array = (focal_px[:, None] * scale)[..., None] * xy
    return pixels


def _rays(image: Array, focal_px: Array, k: Array) -> Array:
    d = image / focal_px[:, None, None]
    depth = 1.0 + k[:, None] * np.sum(d**2, axis=-1)
    return np.concatenate([d, depth[..., None]], axis=-1)
