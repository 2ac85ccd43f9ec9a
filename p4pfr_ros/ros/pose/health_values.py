# Copyright 2026 p4pfr_ros maintainers
# SPDX-License-Identifier: Apache-2.0

"""
The numbers on /diagnostics: rates, latencies, the camera and the last view.

This module stands alone: ``health`` decides on level and message without these numbers.
"""

from __future__ import annotations

from collections import deque
from itertools import takewhile
import math

import numpy as np
from p4pfr_ros import CameraEstimate, DivisionCamera, PoseEstimate
from p4pfr_ros.report.number_format import shape_text

WINDOW_S = 5.0

UNKNOWN = 'unknown'

# Terms of the lens that are estimated only if the views ask for them, and their defaults.
_OTHER_TERMS = {'k2': 0.0, 'k3': 0.0, 'k4': 0.0, 'aspect': 1.0, 'p1': 0.0, 'p2': 0.0}

# With more estimates in a window, the window is shorter.
_MAX_COUNT = 8192


class Latencies:
    """
    Rate and latency of the estimates in a sliding window of some seconds.

    Adding one takes less than a microsecond; quantiles are computed on request. All times are
    seconds of one steady clock.
    """

    def __init__(self, start_s: float) -> None:
        self._start_s = start_s
        self._estimates: deque[tuple[float, float]] = deque(maxlen=_MAX_COUNT)

    def add(self, now_s: float, latency_s: float) -> None:
        """Add an estimate, with the time since its message was received."""
        self._estimates.append((now_s, latency_s))

    def rate_hz(self, now_s: float) -> float:
        """Return the number of estimates per second."""
        count = len(self._within(now_s))
        begin_s = max(self._start_s, now_s - WINDOW_S)
        if count == _MAX_COUNT:
            begin_s = max(begin_s, self._estimates[0][0])
        # At least a second, so that the rate is not overestimated right after the start.
        return count / max(now_s - begin_s, 1.0)

    def quantiles_s(self, now_s: float, *shares: float) -> list[float]:
        """Return the quantiles (shares from 0 to 1) of the latencies; NaN without estimates."""
        latencies = self._within(now_s)
        if not latencies:
            return [math.nan for _ in shares]
        # A measured latency, not an interpolation between two.
        quantiles: list[float] = np.quantile(latencies, shares, method='inverted_cdf').tolist()
        return quantiles

    def _within(self, now_s: float) -> list[float]:
        recent = takewhile(lambda one: one[0] > now_s - WINDOW_S, reversed(self._estimates))
        return [latency_s for _, latency_s in recent]


def number(value: float, digits: int) -> str:
    """Format a number with this many decimals; 'unknown' if it is not finite."""
    return f'{value:.{digits}f}' if math.isfinite(value) else UNKNOWN


def camera_values(fused: CameraEstimate | None, estimate: PoseEstimate | None) -> dict[str, str]:
    """List the calibrated camera; without one, what the last view determines of the camera."""
    focal = k = center_x = center_y = (math.nan, math.nan)
    camera: DivisionCamera | None = None
    if fused is not None:
        camera = fused.camera
        focal, k = (camera.focal_px, fused.focal_sigma_px), (camera.k, fused.k_sigma)
        # A sigma of 0: the centre is still assumed, not estimated.
        sigma_x, sigma_y = (float(sigma) or math.nan for sigma in fused.center_sigma_px)
        center_x, center_y = (camera.center_px[0], sigma_x), (camera.center_px[1], sigma_y)
    elif estimate is not None and estimate.model is not None:
        camera = estimate.model.camera
        if estimate.observable.focal:
            focal = (camera.focal_px, estimate.focal_sigma_px)
        if estimate.observable.distortion:
            k = (camera.k, estimate.k_sigma)
        center_x, center_y = (camera.center_px[0], math.nan), (camera.center_px[1], math.nan)
    return {
        'focal_px': number(focal[0], 2),
        'focal_sigma_px': number(focal[1], 2),
        'k': number(k[0], 5),
        'k_sigma': number(k[1], 5),
        **_other_terms(camera, fused),
        'center_x_px': number(center_x[0], 2),
        'center_x_sigma_px': number(center_x[1], 2),
        'center_y_px': number(center_y[0], 2),
        'center_y_sigma_px': number(center_y[1], 2),
        **_calibration_values(fused),
    }


def board_values(fused: CameraEstimate | None) -> dict[str, str]:
    """List the shapes of the boards, as text."""
    shapes = {} if fused is None else fused.board_shapes
    return {f'board.{name}' if name else 'board': shape_text(s) for name, s in shapes.items()}


def _other_terms(camera: DivisionCamera | None, fused: CameraEstimate | None) -> dict[str, str]:
    """List the terms of a lens but focal length, centre and k; with sigma if it was estimated."""
    sigmas = dict.fromkeys(_OTHER_TERMS, math.nan)
    if fused is not None:
        found = (*fused.terms_sigma[1:], fused.aspect_sigma, *fused.decentring_sigma)
        sigmas = dict(zip(_OTHER_TERMS, found, strict=True))
    values = {}
    for name, without in _OTHER_TERMS.items():
        term = math.nan if camera is None else getattr(camera, name)
        values[name] = number(term, 5)
        # A term that was not estimated has its default, not a measured number.
        values[f'{name}_sigma'] = number(sigmas[name] if term != without else math.nan, 5)
    return values | {'distortion_order': UNKNOWN if camera is None else str(camera.order)}


def _calibration_values(fused: CameraEstimate | None) -> dict[str, str]:
    """List how well the calibration fits, and how well the camera is known."""
    names = ('calibration_rms_px', 'calibration_scatter', 'projection_sigma_px')
    if fused is None:
        return dict.fromkeys(names, UNKNOWN)
    numbers = (fused.rms_px, fused.scatter, fused.projection_sigma_px)
    return dict(zip(names, (number(value, 3) for value in numbers), strict=True))


def view_values(estimate: PoseEstimate | None) -> dict[str, str]:
    """List the properties of the last view."""
    if estimate is None:
        return dict.fromkeys(('inlier_ratio', 'rms_px', 'alternatives', 'status'), UNKNOWN)
    return {
        'inlier_ratio': number(float(np.mean(estimate.inliers)), 3),
        'rms_px': number(estimate.rms_px, 3),
        'alternatives': str(len(estimate.alternatives)),
        'status': estimate.status.value,
    }
