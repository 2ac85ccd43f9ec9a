# Copyright 2026 p4pfr_ros maintainers
# SPDX-License-Identifier: Apache-2.0

"""Parts of the least-squares kernels."""

import numpy as np
from p4pfr_ros.detection import fitting


def test_tanh_is_accurate_everywhere():
    x = np.concatenate([np.linspace(-12.0, 12.0, 4001), [-1e300, -1e-300, 0.0, 1e-9, 1e300]])
    errors = [abs(fitting.tanh(each) - np.tanh(each)) for each in x]
    assert max(errors) < 4e-8


def test_a_step_without_damping_solves_the_normal_equations():
    rng = np.random.default_rng(3)
    jacobian, residuals = rng.standard_normal((40, 7)), rng.standard_normal(40)
    weights = rng.uniform(0.0, 1.0, 40)
    room = fitting.room(50)
    room.rows[:7, :40], room.rows[7, :40] = jacobian.T, residuals
    padded = np.pad(weights, (0, 10), constant_values=9.0)  # beyond the count: ignored
    cost = fitting.add_up(room.rows, padded, 40, room.weighted, room.normal[0])
    fitting.damped_step(room, 0.0)
    root = np.sqrt(weights)
    expected = np.linalg.lstsq(root[:, None] * jacobian, root * residuals, rcond=None)[0]
    np.testing.assert_allclose(room.parameters[1], expected, rtol=1e-5)
    np.testing.assert_allclose(cost, weights @ residuals**2)
