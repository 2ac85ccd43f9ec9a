# Copyright 2026 p4pfr_ros maintainers
# SPDX-License-Identifier: Apache-2.0

"""The headings of the benchmark of pose_node, and what is to be said of its tables."""

from __future__ import annotations

from .node_load import DEPTH

LATENCY_HEADER = (
    'points',
    'messages/s',
    'mode',
    'board',
    'p50 ms',
    'p99 ms',
    'bare p50',
    'bare p99',
    'beyond p50',
    'beyond p99',
    'lost',
    'CPU ms',
    'bare CPU',
)
RATE_HEADER = ('', 'highest rate without loss', 'p50 ms there', 'p99 ms there', 'CPU % there')
NOTE = (
    'Corners in to pose out (pose_with_covariance) between processes, the sender being the '
    'receiver. Bare transport: a node in Python that hears the same messages and answers at once; '
    'beyond: the difference of the two, which were measured in turns. Boards of 4 points are '
    'markers on the topic corners, the '
    f'others clouds on correspondences. Both sides reliable, depth {DEPTH}; lost: of all '
    'that were sent. self_calibrate after it has converged. The '
    'board is everywhere: each view from another place, as no board moves; moving: there and '
    'back, in real time at 200 messages a second; or still. CPU ms: processor time of an answer, '
    "the bare transport's beside it."
)
