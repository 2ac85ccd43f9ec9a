# Copyright 2026 p4pfr_ros maintainers
# SPDX-License-Identifier: Apache-2.0

"""Priors on the lens: marginalising a view adds its quadratic cost."""

from hypothesis import strategies as st
from laws import law
import numpy as np
from p4pfr_ros.core.model.prior import LensPrior, typical_camera
import pytest

seeds = st.integers(0, 2**32 - 1)
variances = st.floats(0.01, 4.0)
# Sizes of the lens's uncertainties: focal length and centre (px), k, k2, k3.
UNITS = np.array([300.0, 30.0, 30.0, 0.1, 0.05, 0.02])


def draw_prior(rng):
    """Draw a prior without marginalised views."""
    mean = UNITS * rng.standard_normal(6)
    return LensPrior.without_views(mean, draw_information(rng, 6))


def draw_information(rng, rank):
    """Draw an information matrix (6, 6) of mixed units."""
    factor = rng.standard_normal((rank, 6)) / UNITS
    return factor.T @ factor


def draw_view(rng, variance, rank=6):
    """Draw a view's information and negative gradient, px², and the lens that they are at."""
    information = variance * draw_information(rng, rank)
    lens = UNITS * rng.standard_normal(6)
    optimum = lens + UNITS * rng.standard_normal(6)
    return information, information @ (optimum - lens), lens


def scaled(information):
    return information * np.outer(UNITS, UNITS)


@law(seed=seeds, variance=variances, rank=st.integers(1, 6))
def test_marginalising_a_view_adds_its_information(seed, variance, rank):
    rng = np.random.default_rng(seed)
    prior = draw_prior(rng)
    information, gradient, lens = draw_view(rng, variance, rank)
    result = prior.marginalise(information, gradient, lens, variance)
    added = information / variance
    np.testing.assert_allclose(
        scaled(result.information), scaled(prior.information + added), rtol=1e-9, atol=1e-9
    )
    np.testing.assert_allclose(scaled(result.marginalised), scaled(added), rtol=1e-9, atol=1e-9)
    assert result.views == 1


@law(seed=seeds, variance=variances, rank=st.integers(1, 6))
def test_the_mean_moves_to_where_the_gradients_cancel(seed, variance, rank):
    rng = np.random.default_rng(seed)
    prior = draw_prior(rng)
    information, gradient, lens = draw_view(rng, variance, rank)
    mean = prior.marginalise(information, gradient, lens, variance).mean
    by_prior = prior.information @ (mean - prior.mean)
    by_view = (information @ (mean - lens) - gradient) / variance
    size = np.abs(UNITS * by_prior).max() + np.abs(UNITS * by_view).max()
    np.testing.assert_allclose(UNITS * (by_prior + by_view), 0.0, atol=1e-6 * (1.0 + size))


@law(seed=seeds, variance=variances)
def test_a_view_with_much_information_moves_the_mean_to_its_optimum(seed, variance):
    rng = np.random.default_rng(seed)
    prior = draw_prior(rng)
    lens, optimum = UNITS * rng.standard_normal((2, 6))
    information = 1e9 * variance * np.diag(UNITS**-2.0)
    result = prior.marginalise(information, information @ (optimum - lens), lens, variance)
    np.testing.assert_allclose(result.mean / UNITS, optimum / UNITS, atol=1e-6)


@law(seed=seeds, variance=variances)
def test_the_order_of_two_views_does_not_matter(seed, variance):
    rng = np.random.default_rng(seed)
    prior, first, second = draw_prior(rng), draw_view(rng, variance), draw_view(rng, variance)
    one = prior.marginalise(*first, variance).marginalise(*second, variance)
    other = prior.marginalise(*second, variance).marginalise(*first, variance)
    # The first of two views fades by 1 in 2000.
    np.testing.assert_allclose(
        scaled(one.information),
        scaled(other.information),
        atol=2e-3 * np.abs(scaled(one.information)).max(),
    )
    assert one.views == other.views == 2


@law(seed=seeds, variance=variances)
def test_a_view_without_information_changes_nothing(seed, variance):
    rng = np.random.default_rng(seed)
    prior = draw_prior(rng)
    lens = UNITS * rng.standard_normal(6)
    result = prior.marginalise(np.zeros((6, 6)), np.zeros(6), lens, variance)
    np.testing.assert_array_equal(result.mean, prior.mean)
    np.testing.assert_array_equal(result.information, prior.information)
    np.testing.assert_array_equal(result.marginalised, 0.0)


@law(seed=seeds, variance=variances)
def test_a_view_that_would_leave_no_positive_information_is_ignored(seed, variance):
    """Rounding may make a view's information negative."""
    rng = np.random.default_rng(seed)
    prior = draw_prior(rng)
    lens = UNITS * rng.standard_normal(6)
    negative = -2.0 * variance * prior.information
    assert prior.marginalise(negative, np.zeros(6), lens, variance) is prior


def test_marginalised_views_count_as_at_most_two_thousand():
    prior = LensPrior.without_views(np.zeros(6), np.diag(UNITS**-2.0))
    view = np.diag(UNITS**-2.0)
    for _ in range(20_000):
        prior = prior.marginalise(view, np.zeros(6), np.zeros(6), 1.0)
    np.testing.assert_allclose(np.diag(scaled(prior.marginalised)), 2000.0, rtol=1e-3)
    np.testing.assert_allclose(np.diag(scaled(prior.information)), 2001.0, rtol=1e-3)


def test_a_typical_camera_has_a_field_of_view_of_60_degrees_and_the_callers_priors():
    typical = typical_camera((1280, 960), 0.03, None, (0.0, None))
    corner_px = 800.0
    assert 2.0 * np.degrees(np.arctan(corner_px / typical.mean[0])) == pytest.approx(60.0)
    sigma = np.diag(typical.information) ** -0.5
    assert sigma[0] == pytest.approx(0.5 * typical.mean[0])
    np.testing.assert_allclose(sigma[1:3], 48.0)
    bend = (corner_px / typical.mean[0]) ** (2.0 * np.arange(1, 4))
    np.testing.assert_allclose(bend * sigma[3:], 0.3)
    given = typical_camera((1280, 960), 0.03, (900.0, 9.0), (-0.2, 0.01))
    np.testing.assert_allclose(given.mean[[0, 3]], [900.0, -0.2])
    np.testing.assert_allclose(np.diag(given.information)[[0, 3]] ** -0.5, [9.0, 0.01])
