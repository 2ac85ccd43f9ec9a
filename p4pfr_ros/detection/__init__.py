# Copyright 2026 p4pfr_ros maintainers
# SPDX-License-Identifier: Apache-2.0

"""From a picture to correspondences: where the board's points are seen."""

from __future__ import annotations

from p4pfr_ros.detection.detector import detect, Detection

__all__ = ['Detection', 'detect']
