# Copyright 2026 p4pfr_ros maintainers
# SPDX-License-Identifier: Apache-2.0

"""Rigid poses. A name says the frames: ``target_from_source``."""

from __future__ import annotations

from dataclasses import dataclass
import math
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

Array = NDArray[np.float64]
Mask = NDArray[np.bool_]
Ints = NDArray[np.int64]

# How far a rotation may be from RᵀR = I and still pass: what single precision leaves behind.
_ORTHOGONALITY = 1e-6


@dataclass(frozen=True, slots=True, eq=False)
class Pose:
    """
    A rigid motion ``target_from_source``: p_target = rotation @ p_source + translation.

    Parameters
    ----------
    rotation : (3, 3) array
        A rotation matrix: RᵀR = I and det R = 1.
    translation : (3,) array
        The source frame's origin in the target frame, metres.

    Raises
    ------
    ValueError
        A wrong shape, a number that is not finite, or a matrix that is no rotation.

    """

    rotation: Array
    translation: Array

    def __post_init__(self) -> None:
        rotation = as_points(self.rotation, 'rotation', (3, 3))
        translation = as_points(self.translation, 'translation', (3,))
        away = np.abs(rotation.T @ rotation - np.eye(3)).max()
        if not away < _ORTHOGONALITY or np.linalg.det(rotation) < 0.0:
            raise ValueError(f'rotation must be a rotation matrix, got {rotation.tolist()}')
        object.__setattr__(self, 'rotation', rotation)
        object.__setattr__(self, 'translation', translation)

    @classmethod
    def unchecked(cls, rotation: Array, translation: Array) -> Pose:
        """Make a pose of what is known to be one: a kernel's answer. Ten times as fast."""
        pose = object.__new__(cls)
        object.__setattr__(pose, 'rotation', rotation)
        object.__setattr__(pose, 'translation', translation)
        return pose

    @classmethod
    def identity(cls) -> Pose:
        """Return the pose that moves nothing."""
        return cls(np.eye(3), np.zeros(3))

    @classmethod
    def from_rotation_vector(cls, rotation_rad: ArrayLike, translation: ArrayLike) -> Pose:
        """Make a pose from an axis times an angle (radians) and a translation (metres)."""
        return cls(rotation_from_vector(rotation_rad), np.asarray(translation, dtype=np.float64))

    @classmethod
    def from_quaternion_xyzw(cls, quaternion: ArrayLike, translation: ArrayLike) -> Pose:
        """Make a pose from a quaternion in ROS order (any length but 0) and a translation."""
        q = as_points(quaternion, 'quaternion', (4,))
        norm = np.linalg.norm(q)
        if not norm > 0.0:
            raise ValueError('quaternion must not be zero')
        x, y, z, w = q / norm
        rotation = np.array(
            [
                [1.0 - 2.0 * (y * y + z * z), 2.0 * (x * y - z * w), 2.0 * (x * z + y * w)],
                [2.0 * (x * y + z * w), 1.0 - 2.0 * (x * x + z * z), 2.0 * (y * z - x * w)],
                [2.0 * (x * z - y * w), 2.0 * (y * z + x * w), 1.0 - 2.0 * (x * x + y * y)],
            ]
        )
        return cls(rotation, np.asarray(translation, dtype=np.float64))

    def __matmul__(self, other: Pose) -> Pose:
        """Compose: ``a_from_b @ b_from_c`` is ``a_from_c``."""
        return Pose(
            self.rotation @ other.rotation, self.rotation @ other.translation + self.translation
        )

    def inverse(self) -> Pose:
        """Return ``source_from_target``."""
        return Pose(self.rotation.T, -self.rotation.T @ self.translation)

    def transform(self, points: ArrayLike) -> Array:
        """Take (..., 3) points of the source frame to the target frame."""
        moved: Array = np.asarray(points, dtype=np.float64) @ self.rotation.T + self.translation
        return moved

    def quaternion_xyzw(self) -> Array:
        """Return the (4,) unit quaternion in ROS order, w ≥ 0."""
        (xx, xy, xz), (yx, yy, yz), (zx, zy, zz) = self.rotation.tolist()
        # 4 q qᵀ, written by R's entries. Its columns are all ∝ q; the one with the largest
        # diagonal entry (at least 1, as the trace is 4) loses no digits.
        columns = (
            (1.0 + xx - yy - zz, xy + yx, xz + zx, zy - yz),
            (xy + yx, 1.0 - xx + yy - zz, yz + zy, xz - zx),
            (xz + zx, yz + zy, 1.0 - xx - yy + zz, yx - xy),
            (zy - yz, xz - zx, yx - xy, 1.0 + xx + yy + zz),
        )
        largest = max(range(4), key=lambda i: columns[i][i])
        q = columns[largest]
        norm = -math.hypot(*q) if q[3] < 0.0 else math.hypot(*q)
        return np.array(q) / norm


def rotation_from_vector(rotation_rad: ArrayLike) -> Array:
    """Turn an axis times an angle (radians) into a (3, 3) rotation: Rodrigues' formula."""
    v = as_points(rotation_rad, 'rotation_rad', (3,))
    angle = float(np.linalg.norm(v))
    cross = np.array([[0.0, -v[2], v[1]], [v[2], 0.0, -v[0]], [-v[1], v[0], 0.0]])
    # sinc(x) = sin(πx)/(πx): finite at zero. (1 - cos a)/a² = ½ (sin(a/2)/(a/2))².
    first = np.sinc(angle / np.pi)
    second = 0.5 * np.sinc(angle / (2.0 * np.pi)) ** 2
    rotation: Array = np.eye(3) + first * cross + second * (cross @ cross)
    return rotation


def rotation_angle_rad(a: ArrayLike, b: ArrayLike) -> float:
    """Return the angle between two (3, 3) rotations, exact for small angles too."""
    # |A - B|_F = 2√2 sin(angle / 2); an arc cosine of the trace would stop at 1e-8.
    chord = float(np.linalg.norm(np.asarray(a) - np.asarray(b)))
    return 2.0 * float(np.arcsin(min(1.0, chord / (2.0 * np.sqrt(2.0)))))


def as_points(values: ArrayLike, name: str, shape: tuple[int | None, ...]) -> Array:
    """
    Return the values as finite, contiguous doubles of a shape (None: any length).

    Raises
    ------
    ValueError
        Names the argument, what was expected and what came.

    """
    try:
        array: Array = np.ascontiguousarray(values, dtype=np.float64)
    except (TypeError, ValueError) as error:
        raise ValueError(f'{name} must be numbers of shape {_text(shape)}: {error}') from None
    if array.shape != shape and not _fits(array.shape, shape):
        raise ValueError(f'{name} must have shape {_text(shape)}, got {_text(array.shape)}')
    # A sum of squares is not finite where a number is not, or where one is huge: then look again.
    if not math.isfinite(np.vdot(array, array)) and not np.isfinite(array).all():
        raise ValueError(f'{name} must be finite, got {_first_bad(array)}')
    return array


def _fits(got: tuple[int, ...], wanted: tuple[int | None, ...]) -> bool:
    return len(got) == len(wanted) and all(
        want is None or want == have for want, have in zip(wanted, got, strict=True)
    )


def _text(shape: tuple[Any, ...]) -> str:
    inside = ', '.join('N' if n is None else str(n) for n in shape)
    return f'({inside},)' if len(shape) == 1 else f'({inside})'


def _first_bad(array: Array) -> str:
    index = tuple(int(i) for i in np.argwhere(~np.isfinite(array))[0])
    return f'{array[index]} at {list(index)}'
