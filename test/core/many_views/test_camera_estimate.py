# Copyright 2026 p4pfr_ros maintainers
# SPDX-License-Identifier: Apache-2.0

"""``CameraEstimate``: its standard deviations, and the check of its fields."""

import numpy as np
from p4pfr_ros import DivisionCamera
from p4pfr_ros.core.many_views.results import CameraEstimate
import pytest

CAMERA = DivisionCamera(600.0, (319.5, 239.5), -0.2)
SIGMA = np.array([0.8, 0.5, 0.6, 0.004, 0.0, 0.0])
CORRELATED = np.eye(6) + 0.9 * (np.eye(6, k=3) + np.eye(6, k=-3))
VARIANCES = np.outer(SIGMA, SIGMA)
COVARIANCE = CORRELATED * VARIANCES


def test_standard_deviations_are_square_roots_of_the_variances():
    estimate = CameraEstimate(CAMERA, COVARIANCE, 0.2, 12)
    assert estimate.focal_sigma_px == pytest.approx(0.8)
    np.testing.assert_allclose(estimate.center_sigma_px, [0.5, 0.6])
    assert estimate.k_sigma == pytest.approx(0.004)
    sigma = np.arange(1.0, 11.0)
    full = CameraEstimate(CAMERA, np.diag(sigma**2), 0.2, 12)
    assert full.terms_sigma == (4.0, 5.0, 6.0, 7.0)
    assert full.aspect_sigma == 8.0
    assert full.decentring_sigma == (9.0, 10.0)


def test_a_covariance_up_to_k3_is_completed_with_zeros():
    covariance = CameraEstimate(CAMERA, COVARIANCE, 0.2, 12).covariance
    np.testing.assert_array_equal(covariance[:6, :6], COVARIANCE)
    assert not covariance[6:].any()
    assert not covariance[:, 6:].any()


@pytest.mark.parametrize(
    ('arguments', 'message'),
    [
        ({'covariance': np.eye(5)}, r'covariance must have shape \(10, 10\)'),
        ({'covariance': -np.eye(6)}, 'covariance must be symmetric and ≥ 0'),
        ({'covariance': COVARIANCE + 1e-3 * np.eye(6, k=1)}, 'covariance must be symmetric'),
        # A correlation of focal length and k above one; its covariance is a small number.
        ({'covariance': (1.2 * CORRELATED - 0.2 * np.eye(6)) * VARIANCES}, 'covariance must be'),
        ({'covariance': COVARIANCE + 1e-3 * (np.eye(6, k=5) + np.eye(6, k=-5))}, 'covariance'),
        ({'rms_px': np.nan}, 'rms_px must be finite and ≥ 0, got nan'),
        ({'rms_px': -0.1}, 'rms_px must be finite and ≥ 0'),
        ({'views': 0}, 'views must be at least 1, got 0'),
        ({'scatter': 0.5}, 'scatter must be finite and ≥ 1, got 0.5'),
        ({'projection_sigma_px': -1.0}, 'projection_sigma_px must be finite and ≥ 0'),
        ({'seen_radius_px': 0.0}, 'seen_radius_px must be finite and > 0'),
        ({'coverage': np.ones((3, 3))}, r'coverage must have shape \(12, 16\)'),
    ],
)
def test_an_invalid_estimate_is_rejected(arguments, message):
    good = {'camera': CAMERA, 'covariance': COVARIANCE, 'rms_px': 0.2, 'views': 12}
    CameraEstimate(**good)
    with pytest.raises(ValueError, match=message):
        CameraEstimate(**{**good, **arguments})
