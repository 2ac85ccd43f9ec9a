# Copyright 2026 p4pfr_ros maintainers
# SPDX-License-Identifier: Apache-2.0

"""Numbers are rounded to two digits of their standard deviation; the words for a board."""

import numpy as np
from p4pfr_ros import BoardShape
from p4pfr_ros.report.number_format import plus_minus, shape_text
import pytest


@pytest.mark.parametrize(
    ('value', 'sigma', 'text'),
    [
        (533.9301, 1.0033, '533.9 ± 1.0'),
        (533.9301, 0.0298, '533.930 ± 0.030'),
        (533.9301, 12.34, '534 ± 12'),
        (533.9301, 1234.5, '534 ± 1234'),
        (-0.302488, 0.00259, '-0.3025 ± 0.0026'),
        (0.5, 1e-30, '0.500000000 ± 0.000000000'),
        (319.5, 0.0, '319.5 (held)'),
    ],
)
def test_two_digits_of_sigma_are_kept(value, sigma, text):
    assert plus_minus(value, sigma) == text


@pytest.mark.parametrize(
    ('numbers', 'text'),
    [
        ({}, 'flat within 0.3 mm'),
        ({2: 0.01}, 'bowed by 1.50 ± 0.17 mm'),
        ({2: 0.002}, 'flat within 0.66 mm'),
        ({0: 0.0025}, 'flat within 0.3 mm'),
        ({0: -0.005}, 'flat within 0.3 mm, stretched by -1.00 ± 0.20 %'),
        ({1: 0.005}, 'flat within 0.3 mm, skewed by 0.57 ± 0.11 degrees'),
    ],
)
def test_what_is_significant_of_a_board_is_said(numbers, text):
    """From three standard deviations on; lengths in mm."""
    given = [numbers.get(i, 0.0) for i in range(8)]
    shape = BoardShape(np.zeros(2), np.array([0.1, 0.05]), given, 1e-6 * np.eye(8))
    assert shape_text(shape) == text
