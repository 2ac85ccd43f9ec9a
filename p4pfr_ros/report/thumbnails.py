# Copyright 2026 p4pfr_ros maintainers
# SPDX-License-Identifier: Apache-2.0

"""
Small images of views with their points, for reports.

This module stands alone: ``drawing`` annotates images in full size.
"""

from __future__ import annotations

import cv2
import numpy as np
from p4pfr_ros.detection import Detection
from p4pfr_ros.files.images import ImageArray

# Larger side, pixels; most of the points lie a few pixels apart then.
_SIDE_PX = 224
_QUALITY = 72
_POINT = (255, 200, 0)  # blue, green, red
# Fractional bits of the coordinates that cv2 draws at.
_SHIFT = 4


def thumbnail(image: ImageArray, detection: Detection | None = None) -> bytes:
    """Return a small image, with the detected points if there are any, as JPEG."""
    share = min(1.0, _SIDE_PX / max(image.shape[:2]))
    size = tuple(max(1, round(share * side)) for side in image.shape[1::-1])
    small = cv2.resize(image, size, interpolation=cv2.INTER_AREA)
    if small.ndim == 2:
        small = cv2.cvtColor(small, cv2.COLOR_GRAY2BGR)
    for point in detection.image_points if detection is not None else ():
        x, y = np.rint((share * (point + 0.5) - 0.5) * 2**_SHIFT).astype(int).tolist()
        cv2.circle(small, (x, y), 2**_SHIFT, _POINT, -1, cv2.LINE_AA, _SHIFT)
    _, data = cv2.imencode('.jpg', small, [cv2.IMWRITE_JPEG_QUALITY, _QUALITY])
    return data.tobytes()
