# Copyright 2026 p4pfr_ros maintainers
#
# Licensed under the Apache License, Version 2.0 (the "License");
# you may not use this file except in compliance with the License.
# You may obtain a copy of the License at
#
#     http://www.apache.org/licenses/LICENSE-2.0
#
# Unless required by applicable law or agreed to in writing, software
# distributed under the License is distributed on an "AS IS" BASIS,
# WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express or implied.
# See the License for the specific language governing permissions and
# limitations under the License.

"""Calibrated cameras of each kind, and the pixels to ask them about."""

import numpy as np
from p4pfr_ros.core.camera_info_model import CameraInfoModel

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
    """Draw pixels of the picture, corners and centre among them."""
    corners = [[-0.5, -0.5], [1279.5, -0.5], [-0.5, 959.5], [1279.5, 959.5], CENTER]
    drawn = np.random.default_rng(seed).uniform(-0.5, (1279.5, 959.5), (n, 2))
    return np.concatenate([corners, drawn])
