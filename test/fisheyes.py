# Copyright 2026 p4pfr_ros maintainers
# SPDX-License-Identifier: Apache-2.0

"""Division cameras that are fitted to fisheye lenses whose image circle leaves corners dark."""

import math

import numpy as np
from p4pfr_ros import DivisionCamera


def equidistant_fit(fov_deg, seen_px=470.0):
    """Return the camera of four terms fitted to an equidistant lens, and the radius it has, px."""
    angle = np.linspace(0.0, math.radians(0.5 * fov_deg), 400)[1:]
    r = angle * seen_px / angle[-1]
    # f + f k (r/f)² + ... = r cot θ, linear; an error of it moves the pixel by sin²θ / θ.
    weight, f = np.sin(angle) ** 2 / angle, seen_px / angle[-1]
    powers = (r[:, None] / f) ** [0, 2, 4, 6, 8]
    depth = np.linalg.lstsq(weight[:, None] * powers, weight * r / np.tan(angle), rcond=None)[0]
    g = depth[0]
    terms = [depth[i] / g * (g / f) ** (2 * i) for i in range(1, 5)]
    return DivisionCamera(g, (641.0, 476.0), *terms), seen_px
