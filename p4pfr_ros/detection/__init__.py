# Copyright 2026 p4pfr_ros maintainers
# SPDX-License-Identifier: Apache-2.0

"""
Detection of boards: from an image to point correspondences.

``detector`` has the public function and calls one finder per family of boards (``chessboard``,
``charuco``, ``markers``). ``saddles`` and ``marker_edges`` refine corners by least squares
(``fitting``); ``aruco`` wraps OpenCV's marker detector.
"""

from __future__ import annotations

from p4pfr_ros.detection.detector import detect, Detection

__all__ = ['Detection', 'detect']
