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

"""Numbers have the digits that their standard deviation leaves them."""

from p4pfr_ros.plus_minus import plus_minus
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
def test_two_digits_of_sigma(value, sigma, text):
    assert plus_minus(value, sigma) == text
