# Copyright 2026 p4pfr_ros maintainers
# SPDX-License-Identifier: Apache-2.0

"""Images of boards: rendered through a camera, or printed to scale."""

from __future__ import annotations

from p4pfr_ros.rendering.renderer import render, Renderer

__all__ = ['Renderer', 'render']
