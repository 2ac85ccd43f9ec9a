# Copyright 2026 p4pfr_ros maintainers
# SPDX-License-Identifier: Apache-2.0

"""``law``: hypothesis over compiled kernels."""

from hypothesis import given, settings
from p4pfr_ros.core.jit import COMPILED


def law(examples=100, **drawn):
    """Do as ``given``, with the same cases each time; fewer of them interpreted."""
    cases = settings(
        deadline=None,  # the first call compiles
        derandomize=True,
        max_examples=examples if COMPILED else max(2, examples // 5),
    )
    return lambda test: cases(given(**drawn)(test))
