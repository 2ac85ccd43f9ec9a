# Copyright 2026 p4pfr_ros maintainers
# SPDX-License-Identifier: Apache-2.0

"""Covariances match the errors over many views."""

from errors import estimate_error
from ideal import estimate_pose, ideal_options
import numpy as np
from p4pfr_ros.core.model.uncertainty import noise_variance
from p4pfr_ros.scenes.instances import IMAGE_SIZE
from p4pfr_ros.scenes.single_view import draw_view
import pytest

VIEWS = 1000


def errors_and_covariances(n, views, sigma_px=None, noise_px=0.5, known=False):
    rng = np.random.default_rng(5)
    options = ideal_options(sigma_px=sigma_px)
    errors, covariances = [], []
    for _ in range(views):
        drawn = draw_view(rng, n, noise_px=noise_px)
        arguments = {'camera': drawn.camera} if known else {'image_size': IMAGE_SIZE}
        estimate = estimate_pose(
            drawn.image_points, drawn.board_points, options=options, **arguments
        )
        if not estimate.observable.undetermined:
            errors.append(estimate_error(estimate.model, drawn))
            covariances.append(estimate.covariance)
    return np.array(errors), np.array(covariances)


def normalised(errors, covariances):
    """Return the squares of errors (n, m) in units of their covariances (n, m, m)."""
    solved = np.linalg.solve(covariances, errors[..., None])[..., 0]
    return np.einsum('ni,ni->n', errors, solved)


def assert_mean(squares, freedom, rel):
    """Compare the mean of χ² values with its expectation, at least within five sigma."""
    five_sigma = 5.0 * np.sqrt(2.0 * freedom / len(squares))
    assert squares.mean() == pytest.approx(freedom, abs=max(rel * freedom, five_sigma))


@pytest.mark.exhaustive
@pytest.mark.parametrize('n', [24, 100])
@pytest.mark.parametrize('sigma_px', [None, 0.5], ids=['measured', 'given'])
def test_normalised_errors_and_intervals_match_the_covariance(n, sigma_px, sample):
    errors, covariances = errors_and_covariances(n, sample(VIEWS, 3), sigma_px)
    assert len(errors) >= 0.99 * sample(VIEWS, 3)
    squares = normalised(errors, covariances)
    inside = np.abs(errors) < 1.96 * np.sqrt(np.einsum('nii->ni', covariances))
    assert_mean(squares, 8.0, rel=0.1)
    # 95 % within five sigma: 3.4 % for a thousand views.
    tolerance = max(0.02, 5.0 * np.sqrt(0.95 * 0.05 / len(errors)))
    np.testing.assert_allclose(inside.mean(axis=0), 0.95, atol=tolerance)


def test_the_covariance_of_a_pose_with_a_known_camera_matches_its_error(sample):
    errors, covariances = errors_and_covariances(24, sample(VIEWS, 3), known=True)
    errors, covariances = errors[:, :6], covariances[:, :6, :6]
    squares = normalised(errors, covariances)
    assert_mean(squares, 6.0, rel=0.1)


def test_noise_near_the_threshold_is_measured(sample):
    # With 0.9 px and a threshold of 2 px, 8 % of the errors are beyond it.
    errors, covariances = errors_and_covariances(100, sample(400, 3), noise_px=0.9)
    squares = normalised(errors, covariances)
    assert_mean(squares, 8.0, rel=0.15)


@pytest.mark.parametrize('sigma_px', [0.1, 0.5, 1.0])
def test_the_measured_noise_is_corrected_for_the_threshold(sigma_px):
    errors = np.random.default_rng(0).normal(0.0, sigma_px, (200_000, 2))
    squares = np.sum(errors**2, axis=1)
    inside = squares[squares < 4.0]
    variance = noise_variance(inside.sum(), 2 * len(inside), 4.0)
    assert variance == pytest.approx(sigma_px**2, rel=0.02)


def test_the_covariance_scales_with_the_given_noise_variance():
    drawn = draw_view(np.random.default_rng(1), 40)
    covariances = [
        estimate_pose(
            drawn.image_points,
            drawn.board_points,
            image_size=IMAGE_SIZE,
            options=ideal_options(sigma_px=sigma_px),
        ).covariance
        for sigma_px in (0.15, 0.3)
    ]
    np.testing.assert_allclose(covariances[1], 4.0 * covariances[0], rtol=1e-3)


def test_four_points_have_the_default_noise():
    drawn = draw_view(np.random.default_rng(7), 4, noise_px=0.0)
    covariances = [
        estimate_pose(
            drawn.image_points,
            drawn.board_points,
            image_size=IMAGE_SIZE,
            options=ideal_options(sigma_px=sigma_px),
        ).covariance
        for sigma_px in (None, 0.5)
    ]
    np.testing.assert_array_equal(*covariances)
