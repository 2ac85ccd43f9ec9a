# Copyright 2026 p4pfr_ros maintainers
# SPDX-License-Identifier: Apache-2.0

"""Events for Health, and the status that it derives from them."""

from dataclasses import replace

import numpy as np
from p4pfr_ros import estimate_pose, Observability
from p4pfr_ros.ros.runtime.rejections import Rejected
import scenes

_NOISE_PX = np.random.default_rng(3).normal(0.0, 0.2, scenes.GRID.shape)
IMAGE_POINTS = scenes.project(scenes.GRID) + _NOISE_PX
IMAGE_POINTS[7] += 30.0
GOOD = estimate_pose(IMAGE_POINTS, scenes.GRID, image_size=scenes.SIZE)
AMBIGUOUS = replace(GOOD, alternatives=(GOOD.model,))
UNDETERMINED = replace(GOOD, observable=Observability(direction=True))
NO_SIZE = Rejected('no_image_size', 'unknown image size')
BAD_FIELDS = Rejected('fields', 'expected other fields')


def estimate(health, now_s, result=GOOD, latency_s=0.001):
    """Record a message with points and its estimate."""
    health.received(now_s)
    health.estimated(now_s, result, latency_s, 0.02)


def reject(health, now_s, rejected):
    """Record a message with points and its rejection."""
    health.received(now_s)
    health.rejected(now_s, rejected)


def level_and_message(health, now_s):
    """Return level and message of the status."""
    status = health.status(now_s)
    return status.level, status.message
