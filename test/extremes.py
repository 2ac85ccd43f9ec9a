# Copyright 2026 p4pfr_ros maintainers
# SPDX-License-Identifier: Apache-2.0

"""Extreme numbers, and what must hold of an estimate from them."""

import math
import warnings

import numpy as np
from p4pfr_ros import DivisionCamera, Pose
from p4pfr_ros.files.yaml_fields import ConfigError

VALUES = [
    *(0.0, 5e-324, 1e-310, 1e-300, 1e-160, 1e-30, 1e-9, 1e7, 1e9, 1e30, 1e77, 1e155, 1e300),
    *(1e308, math.inf, math.nan, -1e-300, -1.0, -1e155, -1e308, -math.inf),
]
SIZE = (640, 480)
CAMERA = DivisionCamera(520.0, (319.5, 239.5), -0.2)
BOARD = np.stack(np.meshgrid(np.linspace(-0.1, 0.1, 6), np.linspace(-0.08, 0.08, 5)), -1)
BOARD = BOARD.reshape(-1, 2)
POSE = Pose(np.diag([1.0, -1.0, -1.0]), [0.03, -0.02, 0.45]) @ Pose.from_rotation_vector(
    [0.5, 0.3, 0.2], np.zeros(3)
)
IMAGE = CAMERA.project(POSE.transform(np.pad(BOARD, ((0, 0), (0, 1)))))


def survives(function, *arguments, **named):
    """
    Call a function that may return an estimate or reject its arguments in one line.

    Any other exception, and any warning, is an error. Return the result; None if rejected.
    """
    with warnings.catch_warnings():
        warnings.simplefilter('error')
        try:
            result = function(*arguments, **named)
        except (ValueError, ConfigError) as error:
            rejection = error
        else:
            check_finite(result)
            return result
    assert not isinstance(rejection, np.linalg.LinAlgError)
    assert str(rejection)
    assert '\n' not in str(rejection)
    return None


def passes(function, *arguments, **named):
    """Call a function as `survives` does; here a rejection is an error too."""
    with warnings.catch_warnings():
        warnings.simplefilter('error')
        result = function(*arguments, **named)
        check_finite(result)
    return result


def check_finite(result):
    """Check that an estimate has finite numbers, if it has a model."""
    model = getattr(result, 'model', None)
    if not hasattr(model, 'camera_from_board'):
        return
    camera = model.camera
    assert np.isfinite(model.camera_from_board.matrix).all()
    assert np.isfinite([camera.focal_px, *camera.center_px, *camera.terms]).all()
    # The properties, and what is logged and drawn.
    assert repr(result)
    assert not result.distance_sigma < 0.0
    assert not result.focal_sigma_px < 0.0


def with_number(array, index, value):
    """Return a copy with one number, row or column replaced."""
    changed = np.array(array)
    changed[index] = value
    return changed
