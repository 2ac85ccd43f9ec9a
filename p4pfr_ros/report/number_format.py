# Copyright 2026 p4pfr_ros maintainers
# SPDX-License-Identifier: Apache-2.0

"""Formats numbers with their standard deviations: of lenses, and of the shapes of boards."""

from __future__ import annotations

from collections.abc import Iterator
import math

from p4pfr_ros.core.many_views.results import CameraEstimate
from p4pfr_ros.core.model.board_shape import BoardShape, SKEW

_MAX_DIGITS = 9

# A deviation of a board is reported from this many standard deviations on.
_SIGNIFICANT = 3.0


def plus_minus(value: float, sigma: float) -> str:
    """
    Format a number and its standard deviation, rounded to two digits of the latter.

    A standard deviation of 0 marks a parameter that was held fixed.
    """
    if not sigma > 0.0:
        return f'{value:g} (held)'
    digits = min(max(0, 1 - math.floor(math.log10(sigma))), _MAX_DIGITS)
    return f'{value:.{digits}f} ± {sigma:.{digits}f}'


def shape_text(shape: BoardShape) -> str:
    """
    Describe the shape of a board, in metres, in words: what is significant of it.

    For example 'bowed by 1.52 ± 0.11 mm, stretched by 0.100 ± 0.012 %' or 'flat within 0.2 mm'.
    """
    bow_mm, bow_sigma_mm = 1e3 * shape.bow, 1e3 * shape.bow_sigma
    parts = [f'flat within {bow_mm + 2.0 * bow_sigma_mm:.2g} mm']
    if bow_mm > _SIGNIFICANT * bow_sigma_mm:
        parts = [f'bowed by {plus_minus(bow_mm, bow_sigma_mm)} mm']
    stretch, stretch_sigma = 100.0 * shape.stretch, 100.0 * shape.stretch_sigma
    if abs(stretch) > _SIGNIFICANT * stretch_sigma:
        parts.append(f'stretched by {plus_minus(stretch, stretch_sigma)} %')
    skew = math.degrees(shape.skew)
    skew_sigma = math.degrees(2.0 * math.sqrt(max(float(shape.covariance[SKEW, SKEW]), 0.0)))
    if abs(skew) > _SIGNIFICANT * skew_sigma:
        parts.append(f'skewed by {plus_minus(skew, skew_sigma)} degrees')
    return ', '.join(parts)


def lens_terms(estimate: CameraEstimate) -> Iterator[tuple[str, float, float]]:
    """List the terms of the lens with their standard deviations: k, and those that are in use."""
    camera = estimate.camera
    names = ('k', 'k2', 'k3', 'k4')
    for name, k, sigma in zip(names, camera.terms, estimate.terms_sigma, strict=True):
        if name == 'k' or k != 0.0:
            yield name, k, sigma
    if camera.aspect != 1.0:
        yield 'fy/fx', camera.aspect, estimate.aspect_sigma
    if camera.is_decentred:
        for i, name in enumerate(('p1', 'p2')):
            yield name, getattr(camera, name), estimate.decentring_sigma[i]
