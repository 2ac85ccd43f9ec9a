# Copyright 2026 p4pfr_ros maintainers
# SPDX-License-Identifier: Apache-2.0

"""
Rigid poses, array types, and the checks of array arguments.

The name of a pose states its frames, ``target_from_source``: in ``a_from_b @ b_from_c`` the inner
frames must match.
"""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass, fields
import math
from typing import Any, TypeVar

import numpy as np
from numpy.typing import ArrayLike, NDArray

Array = NDArray[np.float64]
Mask = NDArray[np.bool_]
Ints = NDArray[np.int64]
ArrayType = TypeVar('ArrayType', bound='NDArray[Any]')

# Largest accepted deviation of RᵀR from I: the rounding of single precision.
_ORTHOGONALITY = 1e-6


# In the kernels a pose is an array (12,): the rotation row by row, then the translation.
TRANSLATION = 9
POSE_SIZE = 12


@dataclass(frozen=True, slots=True, eq=False, repr=False)
class Pose:
    """
    A rigid motion ``target_from_source``: p_target = rotation @ p_source + translation.

    Parameters
    ----------
    rotation : (3, 3) array
        A rotation matrix: RᵀR = I and det R = 1. Read-only.
    translation : (3,) array
        The source frame's origin in the target frame, metres. Read-only.

    Raises
    ------
    ValueError
        A wrong shape, a number that is not finite, or a matrix that is not a rotation.

    """

    rotation: Array
    translation: Array

    def __post_init__(self) -> None:
        rotation = as_points(self.rotation, 'rotation', (3, 3))
        translation = as_points(self.translation, 'translation', (3,))
        deviation = np.abs(rotation.T @ rotation - np.eye(3)).max()
        if not deviation < _ORTHOGONALITY or np.linalg.det(rotation) < 0.0:
            raise ValueError(f'rotation must be a rotation matrix, got {rotation.tolist()}')
        # A copy: the caller's array stays writeable, and cannot change the pose.
        object.__setattr__(self, 'rotation', read_only(rotation.copy()))
        object.__setattr__(self, 'translation', read_only(translation.copy()))

    @classmethod
    def unchecked(cls, rotation: Array, translation: Array) -> Pose:
        """Make a pose from a kernel's arrays, which must be read-only; thirty times faster."""
        pose = object.__new__(cls)
        _set_rotation(pose, rotation)
        _set_translation(pose, translation)
        return pose

    def __eq__(self, other: object) -> bool:
        return fields_equal(self, other)

    def __hash__(self) -> int:
        return hash((*self.rotation.ravel().tolist(), *self.translation.tolist()))

    def __repr__(self) -> str:
        rotation_deg = np.degrees(self.rotation_vector)
        return (
            f'Pose(translation=[{_numbers(self.translation)}], '
            f'rotation_vector_deg=[{_numbers(rotation_deg)}])'
        )

    @classmethod
    def identity(cls) -> Pose:
        """Return the identity."""
        return cls(np.eye(3), np.zeros(3))

    @classmethod
    def from_rotation_vector(cls, rotation_rad: ArrayLike, translation: ArrayLike) -> Pose:
        """Make a pose from a rotation vector (axis times angle, radians) and a translation."""
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
        """Transform points (..., 3) from the source frame to the target frame."""
        moved: Array = np.asarray(points, dtype=np.float64) @ self.rotation.T + self.translation
        return moved

    @property
    def matrix(self) -> Array:
        """The homogeneous (4, 4) matrix."""
        matrix = np.eye(4)
        matrix[:3, :3], matrix[:3, 3] = self.rotation, self.translation
        return matrix

    @property
    def shows_back(self) -> bool:
        """Whether this pose of a board, camera_from_board, shows the camera the board's back."""
        x, y, z = self.rotation[:, 2].tolist()
        tx, ty, tz = self.translation.tolist()
        # The board's z axis points out of its front. Any point of its plane may be the origin.
        return bool(x * tx + y * ty + z * tz > 0.0)

    @property
    def rotation_vector(self) -> Array:
        """The rotation as axis times angle (3,), radians, the angle from 0 to π."""
        q = self.quaternion_xyzw()
        sine = float(np.linalg.norm(q[:3]))
        # For small angles the vector is 2 q; the quotient below is 0 / 0 there.
        scale = 2.0 * math.atan2(sine, q[3]) / sine if sine > 0.0 else 2.0
        vector: Array = scale * q[:3]
        return vector

    @property
    def distance(self) -> float:
        """The distance between the origins of the two frames, in the unit of the translation."""
        return float(np.linalg.norm(self.translation))

    @property
    def tilt_deg(self) -> float:
        """
        The angle between the source's z axis and the negative z axis of the target.

        For ``camera_from_board``: 0 if the board is parallel to the image and faces the camera, 90
        if it is seen edge-on, 180 if it is seen from behind.
        """
        x, y, z = self.rotation[:, 2].tolist()
        return math.degrees(math.atan2(math.hypot(x, y), -z))

    def quaternion_xyzw(self) -> Array:
        """Return the (4,) unit quaternion in ROS order, w ≥ 0."""
        (xx, xy, xz), (yx, yy, yz), (zx, zy, zz) = self.rotation.tolist()
        # 4 q qᵀ in terms of the entries of R. Each column is a multiple of q; the one with the
        # largest diagonal entry (at least 1, as the trace is 4) is accurate.
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


# A frozen object's slots, set without its check: half the time of object.__setattr__.
_set_rotation = vars(Pose)['rotation'].__set__
_set_translation = vars(Pose)['translation'].__set__


def rotation_from_vector(rotation_rad: ArrayLike) -> Array:
    """Return the (3, 3) rotation of a rotation vector, axis times angle in radians (Rodrigues)."""
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


def read_only(array: ArrayType) -> ArrayType:
    """Make an array read-only, in place, and return it."""
    array.flags.writeable = False
    return array


def fields_equal(a: Any, b: Any) -> bool:
    """Compare two dataclasses field by field, arrays by value; NaN equals NaN."""
    return type(a) is type(b) and all(
        _same(getattr(a, f.name), getattr(b, f.name)) for f in fields(a)
    )


def _same(a: Any, b: Any) -> bool:
    if isinstance(a, np.ndarray):
        return bool(np.array_equal(a, b, equal_nan=a.dtype.kind == 'f'))
    return bool(a == b or (isinstance(a, float) and math.isnan(a) and b != b))


def _numbers(values: Array) -> str:
    return ', '.join(f'{value:.4g}' for value in values.tolist())


def as_image_points(values: ArrayLike, name: str, n: int | None = None) -> Array:
    """Return pixels as (n, 2) doubles; accept OpenCV's (n, 1, 2) too. Errors as `as_points`."""
    return as_points(_without_opencv_axis(values), name, (n, 2))


def as_board_points(values: ArrayLike, name: str, n: int) -> Array:
    """
    Return points of the plane Z = 0 as (n, 2) doubles; accept OpenCV's (n, 3) and (n, 1, 3) too.

    Raises
    ------
    ValueError
        As `as_points` does; a point is not on the plane Z = 0.

    """
    points = _without_opencv_axis(values)
    if isinstance(points, np.ndarray) and points.ndim == 2 and points.shape[1] == 3:
        off_plane = np.abs(points[:, 2]) > 0.0
        if off_plane.any():
            z = points[off_plane, 2][0]
            raise ValueError(f'{name} must lie on the plane Z = 0, got a point with Z = {z:g}')
        points = points[:, :2]
    return as_points(points, name, (n, 2))


def _without_opencv_axis(values: ArrayLike) -> ArrayLike:
    """Remove the middle axis of OpenCV's (N, 1, d)."""
    if isinstance(values, np.ndarray) and values.ndim == 3 and values.shape[1] == 1:
        return values[:, 0]
    return values


def as_points(values: ArrayLike, name: str, shape: tuple[int | None, ...]) -> Array:
    """
    Return the values as finite, contiguous doubles of a shape (None: any length).

    Raises
    ------
    ValueError
        Names the argument, the expected shape and the given one.

    """
    try:
        array: Array = np.ascontiguousarray(values, dtype=np.float64)
    except (TypeError, ValueError, OverflowError) as error:
        raise ValueError(f'{name} must be numbers of shape {_text(shape)}: {error}') from None
    if array.shape != shape and not _matches(array.shape, shape):
        raise ValueError(f'{name} must have shape {_text(shape)}, got {_text(array.shape)}')
    # Fast check first: the sum of squares is not finite if a number is not, or if one is huge.
    if not math.isfinite(np.vdot(array, array)) and not np.isfinite(array).all():
        raise ValueError(f'{name} must be finite, got {_first_bad(array)}')
    return array


def finite_numbers(values: Iterable[Any], name: str) -> tuple[float, ...]:
    """
    Return numbers as floats; name: what they are, or a name for each, separated by spaces.

    Raises
    ------
    ValueError
        One is not a number, or not finite.

    """
    values, names = tuple(values), name.split()
    if len(names) != len(values):
        names = [name] * len(values)
    return tuple(finite_number(*each) for each in zip(values, names, strict=True))


def finite_number(value: Any, name: str) -> float:
    """
    Return a number as a float.

    Raises
    ------
    ValueError
        It is not a number, or not finite.

    """
    try:
        number = float(value)
    except (TypeError, ValueError) as error:
        raise ValueError(f'{name} must be a number: {error}') from None
    except OverflowError:  # an int of hundreds of digits
        number = math.inf
    if not math.isfinite(number):
        raise ValueError(f'{name} must be finite, got {number}')
    return number


def _matches(shape: tuple[int, ...], expected: tuple[int | None, ...]) -> bool:
    return len(shape) == len(expected) and all(
        length is None or length == n for length, n in zip(expected, shape, strict=True)
    )


def _text(shape: tuple[Any, ...]) -> str:
    inside = ', '.join('N' if n is None else str(n) for n in shape)
    return f'({inside},)' if len(shape) == 1 else f'({inside})'


def _first_bad(array: Array) -> str:
    index = tuple(int(i) for i in np.argwhere(~np.isfinite(array))[0])
    return f'{array[index]} at {list(index)}'
