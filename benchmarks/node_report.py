# Copyright 2026 p4pfr_ros maintainers
# SPDX-License-Identifier: Apache-2.0

"""Headings and notes for the tables of the pose_node benchmark."""

from __future__ import annotations

from .node_load import DEPTH

LATENCY_HEADER = (
    'points',
    'messages/s',
    'mode',
    'board motion',
    'p50 ms',
    'p99 ms',
    'echo p50',
    'echo p99',
    'added p50',
    'added p99',
    'lost',
    'CPU ms',
    'echo CPU ms',
)
RATE_HEADER = ('', 'highest rate without loss', 'p50 ms', 'p99 ms', 'CPU %')
NOTE = (
    'Latency from publishing a message to receiving pose_with_covariance, between processes; one '
    'process sends and receives. Echo: a Python node that receives the same messages and replies '
    'immediately; added: latency of pose_node minus echo, measured alternately. Boards of 4 '
    'points are markers on the topic corners, the others clouds on correspondences. QoS on both '
    f'sides: reliable, depth {DEPTH}. Lost: messages without a pose. self_calibrate: measured '
    'after the calibration has converged. Board motion: jumping (each view from another place, '
    'faster than a board moves), moving (back and forth, real time at 200 messages per second), '
    'or static. CPU ms: CPU time per pose; echo CPU ms: the same for the echo node.'
)
