# Copyright 2026 p4pfr_ros maintainers
# SPDX-License-Identifier: Apache-2.0

"""What happens to messages, told to Health; and what it makes of them."""

from dataclasses import replace

import numpy as np
from p4pfr_ros import estimate_pose, Observability
from p4pfr_ros.ros.runtime.rejections import Rejected
import scenes

SEEN = scenes.seen(scenes.GRID) + np.random.default_rng(3).normal(0.0, 0.2, scenes.GRID.shape)
SEEN[7] += 30.0
GOOD = estimate_pose(SEEN, scenes.GRID, image_size=scenes.SIZE)
AMBIGUOUS = replace(GOOD, alternatives=(GOOD.model,))
UNSEEN = replace(GOOD, observable=Observability(direction=True))
NO_SIZE = Rejected('no_image_size', 'the size of the picture is not known')
BROKEN = Rejected('fields', 'expected other fields')


def answer(health, now_s, estimate=GOOD, latency_s=0.001):
    """Let a message come and be answered."""
    health.received(now_s)
    health.answered(now_s, estimate, latency_s, 0.02)


def reject(health, now_s, rejected):
    """Let a message come and be rejected."""
    health.received(now_s)
    health.rejected(now_s, rejected)


def head(health, now_s):
    """Return level and message."""
    status = health.status(now_s)
    return status.level, status.message
