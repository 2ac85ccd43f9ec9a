# Copyright 2026 p4pfr_ros maintainers
# SPDX-License-Identifier: Apache-2.0

"""The fixture that reduces the number of a test's cases when the kernels are interpreted."""

from p4pfr_ros.core.jit import COMPILED
import pytest


@pytest.fixture(scope='session')
def sample():
    """Return a number of cases: all if compiled, else ``interpreted`` or one in a hundred."""
    return lambda n, interpreted=None: n if COMPILED else interpreted or max(1, n // 100)
