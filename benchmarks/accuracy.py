# Copyright 2026 p4pfr_ros maintainers
# SPDX-License-Identifier: Apache-2.0

"""Recall of the minimal solver, and checks of every solution that it returns."""

from __future__ import annotations

from dataclasses import dataclass
import functools
import operator

import numpy as np
from p4pfr_ros import solve_p4pfr_batch
from p4pfr_ros.core.geometry import Array
from p4pfr_ros.core.minimal.solver import SolutionBatch
from p4pfr_ros.scenes.instances import draw_instances, IMAGE_SIZE, Instances, KINDS

_CHUNK = 20_000

# Solutions with a larger reprojection error, as a share of the image size, are counted.
_MAX_REPROJECTION = 1e-9

# Rounding errors of the translation that the bound for those solutions allows, in ulps.
_ROUNDINGS = 4.0


@dataclass(frozen=True, slots=True)
class Accuracy:
    """Recall and checks over the instances of a class."""

    instances: int
    to_1e6: int  # instances with a solution within 1e-6 of ground truth
    to_1e3: int
    solutions: int
    max_rotation_defect: float  # largest |RᵀR - I|
    negative_depths: int  # solutions with a depth λ ≤ 0
    max_reprojection_px: float  # largest reprojection error of a point
    over_limit: int  # solutions with a reprojection error above 1e-9 of the image size
    unexplained: int  # those of them that rounding of the translation does not explain

    def __add__(self, other: Accuracy) -> Accuracy:
        """Combine the results of two sets of instances."""
        return Accuracy(
            instances=self.instances + other.instances,
            to_1e6=self.to_1e6 + other.to_1e6,
            to_1e3=self.to_1e3 + other.to_1e3,
            solutions=self.solutions + other.solutions,
            max_rotation_defect=max(self.max_rotation_defect, other.max_rotation_defect),
            negative_depths=self.negative_depths + other.negative_depths,
            max_reprojection_px=max(self.max_reprojection_px, other.max_reprojection_px),
            over_limit=self.over_limit + other.over_limit,
            unexplained=self.unexplained + other.unexplained,
        )

    @property
    def valid(self) -> bool:
        """Whether every returned solution passes its checks."""
        return (
            self.max_rotation_defect < 1e-12
            and self.negative_depths == 0
            and self.unexplained == 0
        )


@dataclass(frozen=True, slots=True)
class InstanceClass:
    """Instances of one kind, with the board in another unit or shifted from its origin."""

    kind: str
    scale: float = 1.0
    shift: float = 0.0

    def draw(self, n: int, seed: int) -> Instances:
        """Draw n instances; their translation is that of the unscaled, unshifted board."""
        drawn = draw_instances(self.kind, n, seed)
        board = self.scale * drawn.board_points + self.shift
        return Instances(
            drawn.image_points, board, drawn.focal_px, drawn.k, drawn.rotation, drawn.translation
        )


CLASSES = {kind: InstanceClass(kind) for kind in KINDS} | {
    'patch, board in mm': InstanceClass('patch', scale=1e3),
    'patch, board in km': InstanceClass('patch', scale=1e-3),
    'patch, board moved by 1000': InstanceClass('patch', shift=1000.0),
}


def measure(instance_class: InstanceClass, n: int) -> Accuracy:
    """Solve n instances and check every solution."""
    chunks = (
        instance_class.draw(min(_CHUNK, n - start), seed)
        for seed, start in enumerate(range(0, n, _CHUNK))
    )
    return functools.reduce(operator.add, map(_measure_chunk, chunks))


def _measure_chunk(drawn: Instances) -> Accuracy:
    batch = solve_p4pfr_batch(drawn.image_points, drawn.board_points)
    error = errors(drawn, batch)
    filled = np.arange(batch.k.shape[1]) < batch.count[:, None]
    instance = np.nonzero(filled)[0]
    rotation, translation = batch.rotation[filled], batch.translation[filled]
    focal_px, k = batch.focal_px[filled], batch.k[filled]
    image, board = drawn.image_points[instance], drawn.board_points[instance]
    points = np.einsum('nij,npj->npi', rotation[:, :, :2], board) + translation[:, None]
    reprojection_px = np.linalg.norm(project(points, focal_px, k) - image, axis=-1).max(axis=1)
    # λ > 0: the ray of the pixel and the vector to the point have the same direction.
    along = np.sum(points * _rays(image, focal_px, k), axis=-1)
    product = np.einsum('nji,njk->nik', rotation, rotation)
    over_limit = ~(reprojection_px < _MAX_REPROJECTION * max(IMAGE_SIZE))
    floor_px = _rounding_px(
        points[over_limit], translation[over_limit], focal_px[over_limit], k[over_limit]
    )
    return Accuracy(
        instances=len(drawn),
        to_1e6=int(np.sum(error < 1e-6)),
        to_1e3=int(np.sum(error < 1e-3)),
        solutions=len(instance),
        max_rotation_defect=float(np.abs(product - np.eye(3)).max(initial=0.0)),
        negative_depths=int(np.sum(~(along > 0.0).all(axis=1))),
        max_reprojection_px=float(reprojection_px.max(initial=0.0)),
        over_limit=int(np.sum(over_limit)),
        unexplained=int(np.sum(~(reprojection_px[over_limit] < floor_px))),
    )


def _rounding_px(points: Array, translation: Array, focal_px: Array, k: Array) -> Array:
    """Bound the image error that a few rounding errors of the translation cause."""
    step = 1e-7 * np.linalg.norm(points, axis=-1, keepdims=True)
    moved = [
        project(points + sign * step * axis, focal_px, k)
        for axis in np.eye(3)
        for sign in (1.0, -1.0)
    ]
    by_axis = [
        np.linalg.norm(plus - minus, axis=-1, keepdims=True) / (2.0 * step)
        for plus, minus in zip(moved[::2], moved[1::2], strict=True)
    ]
    px_per_unit = np.max(by_axis, axis=(0, 2, 3), initial=0.0)
    rounding = _ROUNDINGS * np.finfo(float).eps * np.linalg.norm(translation, axis=-1)
    bound: Array = px_per_unit * rounding
    return bound


def errors(drawn: Instances, batch: SolutionBatch) -> Array:
    """Return the best solution's error (n,): the larger of focal length and rotation error."""
    with np.errstate(invalid='ignore'):
        focal = np.abs(batch.focal_px / drawn.focal_px[:, None] - 1.0)
        # |A - B|_F = 2√2 sin(angle / 2): divided by √2, it is the angle for small angles.
        chord = np.linalg.norm(batch.rotation - drawn.rotation[:, None], axis=(-2, -1))
    error = np.maximum(focal, chord / np.sqrt(2.0))
    best: Array = np.where(np.isnan(error), np.inf, error).min(axis=1)
    return best


def project(points: Array, focal_px: Array, k: Array) -> Array:
    """Project (n, p, 3) points with n division cameras; independent of the package."""
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
