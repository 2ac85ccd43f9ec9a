# Copyright 2026 p4pfr_ros maintainers
# SPDX-License-Identifier: Apache-2.0

"""CameraInfo models of several lenses, and pixels to test them at."""

import numpy as np
from p4pfr_ros.core.cameras.camera_info import CameraInfoModel

SIZE = (1280, 960)
CENTER = (639.5, 479.5)
MODELS = {
    'no distortion': CameraInfoModel('plumb_bob', (0.0,) * 5, (600.0, 600.0), CENTER, 0.0, SIZE),
    'barrel': CameraInfoModel(
        'plumb_bob', (-0.3, 0.12, 1e-3, -8e-4, -0.02), (900.0, 905.0), (650.0, 470.0), 0.0, SIZE
    ),
    'pincushion': CameraInfoModel(
        'plumb_bob', (0.1, 0.05, 0.0, 0.0), (900.0, 900.0), CENTER, 0.0, SIZE
    ),
    'wide': CameraInfoModel(
        'rational_polynomial',
        (0.8, 0.13, 4e-4, -3e-4, 0.002, 1.05, 0.27, 0.013),
        (600.0, 602.0),
        CENTER,
        0.0,
        SIZE,
    ),
    'fisheye': CameraInfoModel(
        'equidistant', (-0.02, 0.005, -0.003, 5e-4), (400.0, 401.0), CENTER, 0.0, SIZE
    ),
}


def pixels(n=2000, seed=0):
    """Return the corners and the centre of the image, and n random pixels."""
    corners = [[-0.5, -0.5], [1279.5, -0.5], [-0.5, 959.5], [1279.5, 959.5], CENTER]
    drawn = np.random.default_rng(seed).uniform(-0.5, (1279.5, 959.5), (n, 2))
    return np.concatenate([corners, drawn])
