# Copyright 2026 p4pfr_ros maintainers
# SPDX-License-Identifier: Apache-2.0

"""
Reads K, D and the name of the model, as camera drivers and calibration programs write them.

CameraInfo messages and calibration files of all formats are read by this one code, so that they
mean the same camera. What loses no information is read, and what does is rejected, with a way out.
"""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass
import math

from p4pfr_ros.core.cameras.camera_info import (
    CameraInfoModel,
    COEFFICIENTS,
    MAX_NUMBER,
    MIN_FOCAL_PX,
)
from p4pfr_ros.files.printable import shown

PLUMB_BOB, RATIONAL, EQUIDISTANT = COEFFICIENTS

# No distortion: the name of a model that has no coefficients.
NO_MODEL = 'none'

# Other names of the models: Kalibr, EuRoC, OpenVINS, realsense, isaac, cameras of OpenCV.
_SYNONYMS = {
    'pinhole': PLUMB_BOB,
    'plumbbob': PLUMB_BOB,
    'radtan': PLUMB_BOB,
    'radial_tangential': PLUMB_BOB,
    'brown_conrady': PLUMB_BOB,
    'rational': RATIONAL,
    'fisheye': EQUIDISTANT,
    'opencv_fisheye': EQUIDISTANT,
    'equi': EQUIDISTANT,
    'kannala_brandt': EQUIDISTANT,
    'kannala_brandt4': EQUIDISTANT,
    'kannala_brandt8': EQUIDISTANT,
}

# Numbers of coefficients that OpenCV knows: k1 k2 p1 p2, k3, k4 k5 k6, s1 s2 s3 s4, tau_x tau_y.
_OPENCV_SIZES = (4, 5, 8, 12, 14)
_PRISM, _TILT = slice(8, 12), slice(12, 14)

# Entries of K that are this close to 0 or 1 are meant to be 0 or 1.
_ROUNDING = 1e-9

_AGAIN = 'calibrate again, or use intrinsics.mode self_calibrate'


@dataclass(frozen=True, slots=True, kw_only=True)
class Names:
    """What K, D and the name of the model are called where they are read, for errors."""

    k: str = 'K'
    d: str = 'D'
    model: str = 'distortion_model'


def camera_from_k_and_d(
    k: Iterable[float],
    d: Iterable[float],
    distortion_model: str,
    image_size: tuple[int, int],
    names: Names | None = None,
) -> CameraInfoModel:
    """
    Return the camera of a matrix K, coefficients D and the name of their model.

    Parameters
    ----------
    k
        [fx s cx 0 fy cy 0 0 1], pixels; the skew s is kept.
    d
        The coefficients, in OpenCV's order. Zeros beyond those of the model are dropped.
    distortion_model
        Its name in ROS or in another program. plumb_bob and rational_polynomial are told apart by
        the number of coefficients. Empty: plumb_bob (see ``assumption``), or, without
        coefficients, no distortion.
    image_size
        Width and height of the full raw image, pixels.
    names
        What the three are called, for errors.

    Raises
    ------
    ValueError
        ``NAME: expected ..., got ...: way out``, in one line.

    """
    names = names or Names()
    focal_px, center_px, skew_px = _checked_matrix(tuple(k), names)
    coefficients = _checked_numbers(d, names.d)
    kind = _kind(distortion_model, coefficients, names)
    if kind == EQUIDISTANT:
        coefficients = _equidistant(coefficients, names)
    else:
        coefficients = _polynomial(coefficients, kind, names)
        if len(coefficients) > COEFFICIENTS[PLUMB_BOB]:
            kind = RATIONAL
        coefficients += (0.0,) * (COEFFICIENTS[kind] - len(coefficients))
    return CameraInfoModel(
        kind, coefficients, focal_px, center_px, 0.0, image_size, skew_px=skew_px
    )


def assumption(d: Iterable[float], distortion_model: str) -> str:
    """Return a warning if the model of the coefficients is not named; empty if it is."""
    if distortion_model.strip() or not any(d):
        return ''
    return (
        f'no distortion_model: taken as {PLUMB_BOB}. If the lens is a fisheye, set it to '
        f'{EQUIDISTANT}'
    )


def _checked_matrix(
    entries: tuple[float, ...], names: Names
) -> tuple[tuple[float, float], tuple[float, float], float]:
    """Return (fx, fy), (cx, cy) and the skew."""
    if len(entries) != 9:
        raise ValueError(f'{names.k}: expected 9 numbers, got {len(entries)}: write K row by row')
    fx, skew, cx, below, fy, cy, *last = (float(entry) for entry in entries)
    off = max(abs(below), *map(abs, last[:2]), abs(last[2] - 1.0))
    if not off <= _ROUNDING:
        got = ' '.join(f'{entry:g}' for entry in entries)
        hint = 'transpose it' if cx == cy == 0.0 else 'write K row by row'
        raise ValueError(f'{names.k}: expected [fx s cx 0 fy cy 0 0 1], got [{got}]: {hint}')
    for focal_px in (fx, fy):
        if not MIN_FOCAL_PX <= focal_px <= MAX_NUMBER:
            raise ValueError(
                f'{names.k}: expected a focal length from {MIN_FOCAL_PX:g} to {MAX_NUMBER:g} px, '
                f'got {focal_px:g}: calibrate the camera'
            )
    cx, cy, skew = _checked_numbers((cx, cy, skew), names.k)
    if not abs(skew) <= fx:
        raise ValueError(f'{names.k}: expected a skew of at most fx, got {skew:g}: {_AGAIN}')
    return (fx, fy), (cx, cy), skew


def _checked_numbers(numbers: Iterable[float], name: str) -> tuple[float, ...]:
    given = tuple(float(number) for number in numbers)
    for number in given:
        if not (math.isfinite(number) and abs(number) <= MAX_NUMBER):
            raise ValueError(
                f'{name}: expected numbers within {MAX_NUMBER:g}, got {number:g}: {_AGAIN}'
            )
    return given


def _kind(distortion_model: str, coefficients: tuple[float, ...], names: Names) -> str:
    """Return the model of a name."""
    word = distortion_model.strip().lower().replace('-', '_').replace(' ', '_')
    kind = _SYNONYMS.get(word, word or PLUMB_BOB)
    if kind == NO_MODEL:
        if any(coefficients):
            raise ValueError(
                f'{names.model}: expected the name of the model of {names.d}, got {word}: name '
                f'it, or leave {names.d} empty'
            )
        return PLUMB_BOB
    if kind not in COEFFICIENTS:
        hint = 'use the topic camera_info of the node' if kind == 'division' else _AGAIN
        raise ValueError(
            f'{names.model}: expected one of {", ".join(COEFFICIENTS)}, '
            f'got {shown(distortion_model)}: {hint}'
        )
    return kind


def _equidistant(coefficients: tuple[float, ...], names: Names) -> tuple[float, ...]:
    """Return k1 to k4."""
    size = COEFFICIENTS[EQUIDISTANT]
    if len(coefficients) >= size and not any(coefficients[size:]):
        return coefficients[:size]
    hint = 'add zeros for terms that are not used'
    if not coefficients:
        hint = 'write four zeros for an ideal fisheye, or name plumb_bob for a pinhole'
    elif len(coefficients) > size:
        hint = f'is the model {RATIONAL}?'
    raise ValueError(
        f'{names.d}: expected 4 numbers of {EQUIDISTANT} (k1 k2 k3 k4), '
        f'got {len(coefficients)}: {hint}'
    )


def _polynomial(coefficients: tuple[float, ...], kind: str, names: Names) -> tuple[float, ...]:
    """Return the coefficients of plumb_bob or rational_polynomial, without those that are zero."""
    if not any(coefficients):
        return ()
    given = coefficients
    while len(given) not in _OPENCV_SIZES and len(given) > min(_OPENCV_SIZES) and given[-1] == 0.0:
        given = given[:-1]
    if len(given) not in _OPENCV_SIZES:
        expected = ', '.join(map(str, _OPENCV_SIZES))
        raise ValueError(
            f'{names.d}: expected {expected} numbers of {kind} (k1 k2 p1 p2 k3 ...), '
            f'got {len(coefficients)}: add zeros for terms that are not used'
        )
    for terms, what, flag in (
        (given[_PRISM], 'thin prism terms (s1 s2 s3 s4)', 'THIN_PRISM'),
        (given[_TILT], 'tilt of the sensor (tau_x tau_y)', 'TILTED'),
    ):
        if any(terms):
            got = ' '.join(f'{term:g}' for term in terms)
            raise ValueError(
                f"{names.d}: expected no {what}, got {got}: calibrate again without OpenCV's "
                f'CALIB_{flag}_MODEL'
            )
    return given[: COEFFICIENTS[RATIONAL]]
