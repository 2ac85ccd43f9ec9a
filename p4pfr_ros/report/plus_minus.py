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

"""A number and its standard deviation for people."""

from __future__ import annotations

import math

_MOST_DIGITS = 9


def plus_minus(value: float, sigma: float) -> str:
    """
    Write two digits of σ, and as many of the number behind the point as they allow.

    Where σ is 0 nothing was estimated: the number was held where it is.
    """
    if not sigma > 0.0:
        return f'{value:g} (held)'
    digits = min(max(0, 1 - math.floor(math.log10(sigma))), _MOST_DIGITS)
    return f'{value:.{digits}f} ± {sigma:.{digits}f}'
