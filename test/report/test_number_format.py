# Copyright 2026 p4pfr_ros maintainers
# SPDX-License-Identifier: Apache-2.0

"""Numbers are rounded to two digits of their standard deviation."""

from p4pfr_ros.report.number_format import plus_minus
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
