# Copyright 2026 p4pfr_ros maintainers
# SPDX-License-Identifier: Apache-2.0

"""Priors on lens and boards: marginalising a view adds its quadratic cost."""

from dataclasses import replace
import math

from hypothesis import strategies as st
from laws import law
import numpy as np
from p4pfr_ros.core.model.board_shape import SHAPE_SIGMAS, SHAPE_SIZE
from p4pfr_ros.core.model.lens import LENS_SIZE
from p4pfr_ros.core.model.prior import (
    common_places,
    CommonPrior,
    FreeTerms,
    shape_slice,
    terms_of_lens,
    TypicalCamera,
)
import pytest

seeds = st.integers(0, 2**32 - 1)
variances = st.floats(0.01, 4.0)
boards = st.integers(0, 1)
TYPICAL = TypicalCamera(
    corner_px=800.0, center_sigma_px=48.0, focal_px=1385.0, focal_sigma_px=692.0
)
BOARDS = 2
SIZE = LENS_SIZE + BOARDS * SHAPE_SIZE
# Sizes of the uncertainties: focal length and centre (px), k to k4, aspect, p1, p2; two boards.
UNITS = np.array(
    [300.0, 30.0, 30.0, 0.1, 0.05, 0.02, 0.01, 0.01, 1e-3, 1e-3, *np.tile(SHAPE_SIGMAS, BOARDS)]
)


def draw_view(rng, variance, board=0, rank=18):
    """Draw a view: information, negative gradient (px²), where they are linearised, its places."""
    at = common_places(board)
    factor = rng.standard_normal((rank, len(at))) / UNITS[at]
    information = variance * factor.T @ factor
    common = UNITS * rng.standard_normal(SIZE)
    optimum = common + UNITS * rng.standard_normal(SIZE)
    return information, information @ (optimum - common)[at], common, variance, at


def draw_prior(rng):
    """Draw a prior of two boards with some views."""
    prior = CommonPrior.without_views(TYPICAL).for_boards(BOARDS)
    for board in (0, 1, 1):
        prior = prior.marginalise(*draw_view(rng, 1.0, board))
    return prior


def scaled(information):
    return information * np.outer(UNITS, UNITS)


def cost(prior, common):
    """Return the quadratic cost of a prior at lens and boards (C,), without a constant."""
    d = common - prior.reference
    return d @ prior.information @ d - 2.0 * prior.gradient @ d


@law(seed=seeds, variance=variances, board=boards, rank=st.integers(1, 18))
def test_marginalising_a_view_adds_its_information(seed, variance, board, rank):
    rng = np.random.default_rng(seed)
    prior = CommonPrior.without_views(TYPICAL).for_boards(BOARDS)
    view = draw_view(rng, variance, board, rank)
    result = prior.marginalise(*view)
    added, at = np.zeros((SIZE, SIZE)), view[-1]
    added[np.ix_(at, at)] = view[0] / variance
    np.testing.assert_allclose(scaled(result.information), scaled(added), rtol=1e-9, atol=1e-9)
    np.testing.assert_allclose(scaled(result.marginalised), scaled(added), rtol=1e-9, atol=1e-9)
    assert result.views == 1


@law(seed=seeds, variance=variances, board=boards)
def test_marginalising_a_view_adds_its_cost(seed, variance, board):
    """Up to the fading of earlier views by 1 in 2,000 about the present estimate."""
    rng = np.random.default_rng(seed)
    prior = draw_prior(rng)
    information, gradient, common, variance, at = draw_view(rng, variance, board)
    result = prior.marginalise(information, gradient, common, variance, at)
    ours, expected = [], []
    for step in UNITS * rng.standard_normal((5, SIZE)):
        ours.append(cost(result, common + step) - cost(result, common))
        own = step[at] @ information @ step[at] - 2.0 * gradient @ step[at]
        before = cost(prior, common + step) - cost(prior, common)
        faded = step @ prior.marginalised @ step / 2000.0
        expected.append(before - faded + own / variance)
    np.testing.assert_allclose(ours, expected, rtol=1e-7, atol=1e-7 * np.abs(expected).max())


@law(seed=seeds, variance=variances)
def test_the_order_of_two_views_does_not_matter(seed, variance):
    rng = np.random.default_rng(seed)
    prior = CommonPrior.without_views(TYPICAL).for_boards(BOARDS)
    first, second = draw_view(rng, variance, 0), draw_view(rng, variance, 1)
    one = prior.marginalise(*first).marginalise(*second)
    other = prior.marginalise(*second).marginalise(*first)
    size = np.abs(scaled(one.information)).max()
    # The first of two views fades by 1 in 2,000.
    np.testing.assert_allclose(
        scaled(one.information), scaled(other.information), atol=2e-3 * size
    )
    assert one.views == other.views == 2


@law(seed=seeds, variance=variances, board=boards)
def test_a_view_without_information_changes_nothing_but_the_number_of_views(seed, variance, board):
    prior = CommonPrior.without_views(TYPICAL).for_boards(BOARDS)
    common = UNITS * np.random.default_rng(seed).standard_normal(SIZE)
    nothing = np.zeros((18, 18)), np.zeros(18)
    result = prior.marginalise(*nothing, common, variance, common_places(board))
    for name in ('reference', 'information', 'gradient', 'marginalised'):
        np.testing.assert_array_equal(getattr(result, name), getattr(prior, name))


@law(seed=seeds, place=st.integers(0, 17), value=st.sampled_from([np.nan, np.inf]))
def test_a_view_that_is_not_finite_is_ignored(seed, place, value):
    rng = np.random.default_rng(seed)
    prior = draw_prior(rng)
    information, gradient, *rest = draw_view(rng, 1.0)
    information[place, place] = value
    assert prior.marginalise(information, gradient, *rest) is prior
    gradient[place] = value
    information[place, place] = 1.0
    assert prior.marginalise(information, gradient, *rest) is prior


def test_marginalised_views_count_as_at_most_two_thousand():
    prior = CommonPrior.without_views(TYPICAL).for_boards(BOARDS)
    at = common_places(1)
    view = np.diag(UNITS[at] ** -2.0), np.zeros(18), np.zeros(SIZE), 1.0, at
    for _ in range(20_000):
        prior = prior.marginalise(*view)
    np.testing.assert_allclose(np.diag(scaled(prior.marginalised))[at], 2000.0, rtol=1e-3)
    np.testing.assert_allclose(np.diag(scaled(prior.information))[at], 2000.0, rtol=1e-3)
    assert (np.diag(prior.information)[shape_slice(0)] == 0.0).all()


def test_earlier_views_fade_without_moving_a_present_optimum():
    """Views that agree with the estimate keep it where it is, however many they are."""
    rng = np.random.default_rng(0)
    prior, truth = CommonPrior.without_views(TYPICAL), UNITS[:18] * rng.standard_normal(18)
    at = common_places(0)
    prior = prior.for_boards(1)
    for _ in range(3000):
        prior = prior.marginalise(np.diag(UNITS[at] ** -2.0), np.zeros(18), truth, 1.0, at)
    mean = prior.reference + np.linalg.solve(prior.information, prior.gradient)
    np.testing.assert_allclose(mean / UNITS[at], truth / UNITS[at], atol=1e-8)


@law(seed=seeds, board=boards)
def test_dropping_a_board_is_a_minimum_over_its_shape(seed, board):
    """The typical board's prior is counted: the shape had it when it was marginalised."""
    rng = np.random.default_rng(seed)
    prior = replace(draw_prior(rng), reference=UNITS * rng.standard_normal(SIZE))
    typical = SHAPE_SIGMAS**-2.0
    rest = np.setdiff1d(np.arange(SIZE), np.arange(SIZE)[shape_slice(board)])
    result = prior.without_board(board)
    assert not result.information[shape_slice(board)].any()
    assert not result.gradient[shape_slice(board)].any()

    def lowest(common):
        """Return the lowest cost over the shape of the board."""
        at = np.setdiff1d(np.arange(SIZE), rest)
        d = common - prior.reference
        information = prior.information[np.ix_(at, at)] + np.diag(typical)
        gradient = prior.gradient[at] - prior.information[np.ix_(at, rest)] @ d[rest]
        gradient -= typical * prior.reference[at]
        others = prior.information[np.ix_(rest, rest)]
        own = gradient @ np.linalg.solve(information, gradient)
        return d[rest] @ others @ d[rest] - 2.0 * prior.gradient[rest] @ d[rest] - own

    points = UNITS * rng.standard_normal((4, SIZE))
    ours = np.array([cost(result, point) for point in points])
    expected = np.array([lowest(point) for point in points])
    np.testing.assert_allclose(ours - ours[0], expected - expected[0], rtol=1e-6, atol=1e-6)


def test_the_prior_for_kernels_is_the_typical_camera_and_the_views():
    rng = np.random.default_rng(5)
    prior, terms = draw_prior(rng), FreeTerms(2, imperfect=True)
    weighted = prior.weighted(0.25, 900.0, terms, BOARDS)
    mean, sigma = TYPICAL.at(900.0, terms, BOARDS)

    def total(common):
        d = common - weighted.reference
        return d @ weighted.information @ d - 2.0 * weighted.gradient @ d

    def expected(common):
        return 0.25 * (cost(prior, common) + np.sum(((common - mean) / sigma) ** 2))

    points = UNITS * rng.standard_normal((5, SIZE))
    ours = np.array([total(p) for p in points])
    theirs = np.array([expected(p) for p in points])
    np.testing.assert_allclose(ours - ours[0], theirs - theirs[0], rtol=1e-9)


def test_a_calibration_and_a_known_board_are_the_prior_of_the_next():
    lens = np.array([900.0, 3.0, -4.0, -0.2, 0.0, 0.0, 0.0, 0.01, 0.0, 0.0])
    covariance = np.diag([4.0, 1.0, 2.0, 1e-4, 0.0, 0.0, 0.0, 1e-6, 0.0, 0.0])
    prior = CommonPrior.of_calibration(TYPICAL, lens, covariance, 9)
    numbers, of_board = np.full(SHAPE_SIZE, 0.001), 1e-8 * np.eye(SHAPE_SIZE)
    prior = prior.known_shape(1, numbers, of_board)
    known = np.diag(covariance) > 0.0
    np.testing.assert_array_equal(prior.reference[:LENS_SIZE], lens)
    np.testing.assert_array_equal(prior.reference[shape_slice(1)], numbers)
    # The covariance includes the prior of a typical camera, which each fit adds again.
    terms = FreeTerms(1, imperfect=True)
    whole = prior.weighted(1.0, 900.0, terms, 2).information
    lens_part = np.diag(whole)[:LENS_SIZE]
    np.testing.assert_allclose(lens_part[known], 1.0 / np.diag(covariance)[known])
    diagonal = np.diag(prior.information)
    assert not diagonal[:LENS_SIZE][~known].any()
    np.testing.assert_allclose(diagonal[shape_slice(1)], 1e8)
    assert not diagonal[shape_slice(0)].any()
    assert (prior.boards, prior.views) == (2, 9)
    assert not prior.marginalised.any()


@pytest.mark.parametrize('focal_px', [400.0, 900.0, 3000.0])
def test_a_typical_camera_has_the_callers_priors_and_the_usual_spreads(focal_px):
    mean, sigma = TYPICAL.at(focal_px, FreeTerms(), 1)
    np.testing.assert_array_equal(mean, [1385.0, *[0.0] * 17])
    np.testing.assert_allclose(sigma[:3], [692.0, 48.0, 48.0])
    unit = (focal_px / 800.0) ** 2
    for i, (term, bend) in enumerate([(0.4, 0.2), (0.03, 0.1), (0.003, 0.02), (0.0005, 0.01)]):
        assert sigma[3 + i] == pytest.approx(math.hypot(term, bend * unit ** (i + 1)))
    np.testing.assert_allclose(sigma[7:10], [0.003, 0.001, 0.001])
    np.testing.assert_array_equal(sigma[10:], SHAPE_SIGMAS)
    free = TYPICAL.at(focal_px, FreeTerms(1, imperfect=True), 1)[1]
    assert (free[7:10] > 10.0 * sigma[7:10]).all()
    np.testing.assert_array_equal(np.delete(free, range(7, 10)), np.delete(sigma, range(7, 10)))


@pytest.mark.parametrize('order', [1, 2, 3, 4])
@pytest.mark.parametrize('imperfect', [False, True])
def test_the_terms_of_a_lens_are_those_that_are_not_zero(order, imperfect):
    terms = FreeTerms(order, imperfect)
    lens = np.zeros(LENS_SIZE)
    lens[terms.columns] = 0.1
    assert terms_of_lens(lens) == terms
    assert terms.with_boards(2).tolist() == [*terms.columns, *range(10, 26)]
