# Copyright 2026 p4pfr_ros maintainers
# SPDX-License-Identifier: Apache-2.0

"""How many cases a test draws: all of them compiled, a few interpreted."""

from p4pfr_ros.core.jit import COMPILED
import pytest


@pytest.fixture(scope='session')
def sample():
    """Scale a number of cases to what the interpreter can do in the same time."""
    return lambda n, interpreted=None: n if COMPILED else interpreted or max(1, n // 100)
