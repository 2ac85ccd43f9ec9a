# Copyright 2026 p4pfr_ros maintainers
# SPDX-License-Identifier: Apache-2.0

"""
Levels of deep images (16 bits, signed, floating point) to 8 bits.

Sensors of 10 or 12 bits send small numbers in 16 bits, thermal cameras and depth cameras a narrow
band of levels. Scaled by the whole range, such an image would be nearly one level.
"""

from __future__ import annotations

from typing import Any

import cv2
import numpy as np
from numpy.typing import NDArray

# Levels between these quantiles become 0 to 255; a few hot or dead pixels do not count.
_QUANTILES = (0.001, 0.999)
# Every n-th pixel in both directions is enough to know the levels.
_STEP = 4
_ENOUGH = 100
# An image that uses less than this share of its type's range is scaled by its content.
_MIN_SHARE = 0.5


def to_eight_bits(values: NDArray[Any], *, by_content: bool = True) -> NDArray[np.uint8] | None:
    """
    Convert uint8, uint16, int16 or float32 values, (h, w) or (h, w, channels), to uint8.

    The whole range of an integer type becomes 0 to 255. If ``by_content`` and the image uses less
    than half of that range, the levels that it uses do. Floating point has no range: it is always
    scaled by its content, and values that are not finite become 0.

    Returns
    -------
    The image, or None if no value is finite.

    """
    if values.dtype == np.uint8:
        return values
    if values.dtype.kind == 'f':
        finite = np.isfinite(values)
        if not finite.any():
            return None
        low, high = _used(values[::_STEP, ::_STEP][finite[::_STEP, ::_STEP]], values[finite])
        return _stretched(np.where(finite, values, low), low, high)
    limits = np.iinfo(values.dtype)
    if by_content:
        low, high = _used(values[::_STEP, ::_STEP], values)
        if 0.0 < high - low < _MIN_SHARE * (int(limits.max) - int(limits.min)):
            return _stretched(values, low, high)
    shifted = values.astype(np.int32) - int(limits.min)
    whole: NDArray[np.uint8] = (shifted >> 8).astype(np.uint8)
    return whole


def _used(sample: NDArray[Any], values: NDArray[Any]) -> tuple[float, float]:
    """Return the levels that an image uses, from a sample of it if that has enough values."""
    levels = sample if sample.size >= _ENOUGH else values
    measured = levels[levels != 0]  # depth cameras send 0 where there is no measurement
    low, high = np.quantile(measured if measured.size >= _ENOUGH else levels, _QUANTILES)
    return float(low), float(high)


def _stretched(values: NDArray[Any], low: float, high: float) -> NDArray[np.uint8]:
    scale = 255.0 / (high - low) if high > low else 0.0
    above = np.maximum(values.astype(np.float32), np.float32(low)) - np.float32(low)
    return np.asarray(cv2.convertScaleAbs(above, alpha=scale), dtype=np.uint8)
