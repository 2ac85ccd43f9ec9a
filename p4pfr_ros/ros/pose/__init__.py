# Copyright 2026 p4pfr_ros maintainers
# SPDX-License-Identifier: Apache-2.0

"""
The pipeline of pose_node and lifecycle_pose_node.

``pipeline`` reads top-down: message, observation (``inputs``), camera and estimate
(``camera_source``), publishers (``outputs``), calibration (``calibration_keeper``), log and
diagnostics (``health``).
"""
