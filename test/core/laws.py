# Copyright 2026 p4pfr_ros maintainers
# SPDX-License-Identifier: Apache-2.0

"""``law``: property-based tests of the kernels."""

from hypothesis import given, settings
from p4pfr_ros.core.jit import COMPILED


def law(examples=100, **arguments):
    """Decorate as ``given`` does, with the same cases in each run; fewer if interpreted."""
    cases = settings(
        deadline=None,  # the first call compiles
        derandomize=True,
        max_examples=examples if COMPILED else max(2, examples // 5),
    )
    return lambda test: cases(given(**arguments)(test))
