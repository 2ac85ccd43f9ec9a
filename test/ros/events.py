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

"""What happens to messages, told to Health; and what it makes of them."""

from dataclasses import replace

import numpy as np
from p4pfr_ros import estimate_pose, Observability
from p4pfr_ros.ros.rejections import Rejected
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
