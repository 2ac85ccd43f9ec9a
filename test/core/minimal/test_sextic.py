# Copyright 2026 p4pfr_ros maintainers
# SPDX-License-Identifier: Apache-2.0

"""The sextic: values, slope and coefficients agree, and no root is missed."""

from hypothesis import strategies as st
from laws import law
import numpy as np
from p4pfr_ros.core.minimal.cone import Cone
from p4pfr_ros.core.minimal.four import points_of
from p4pfr_ros.core.minimal.roots import feasible_roots, MAX_ROOTS, STACK_SHAPE
from p4pfr_ros.core.minimal.sextic import coefficients, evaluate, Factors, factors
import pytest

seeds = st.integers(0, 2**32 - 1)
shares = st.floats(0.0, 1.0)
BINOMIALS = np.array([1, 6, 15, 20, 15, 6, 1])


def random_factors(seed):
    """Draw factors: any twelve numbers belong to some problem."""
    rng = np.random.default_rng(seed)
    numbers = rng.standard_normal(8) + 1j * rng.standard_normal(8)
    return Factors(*map(complex, numbers), *map(float, rng.standard_normal(4)))


def factors_with_roots(roots):
    """
    Make factors whose sextic has the given real roots.

    With l = 1, p = 0 and n = 0, z = d is real, so S = Im(u v) d². With v = i, S = Re(u) d², and
    Re(u) and d are linear: u gives a single root, d a double root.
    """
    single, double = roots
    u = [complex(end - single, 0.3) for end in (0.0, 1.0)]
    # The real part of u v, -Im(u), is negative throughout: f² is positive.
    return Factors(*u, 1j, 1j, 1 + 0j, 1 + 0j, 0j, 0j, 0.0, 0.0, -double, 1.0 - double)


def factors_with_close_roots(middle, gap):
    """Make factors with S = t² - gap²/4, t = τ - middle: two roots, f² > 0 at both."""
    # u = 1 + i t and v = (t - 1) + i (t - gap²/4):  Re(u v) = t - 1 - t² + ... is negative.
    u = [complex(1.0, end - middle) for end in (0.0, 1.0)]
    v = [complex(end - middle - 1.0, end - middle - 0.25 * gap**2) for end in (0.0, 1.0)]
    return Factors(*u, *v, 1 + 0j, 1 + 0j, 0j, 0j, 0.0, 0.0, 1.0, 1.0)


def real_parts(f, tau):
    return np.array([evaluate(f, float(t)).sextic for t in tau])


def roots_of(f, max_bend=np.inf):
    all_roots = np.full(MAX_ROOTS, np.nan)
    count = feasible_roots(f, max_bend, all_roots, np.empty(STACK_SHAPE))
    return np.sort(all_roots[:count])


def size(f):
    return np.abs(coefficients(f, 0.0, 1.0)).max()


@law(seed=seeds, low=shares, high=shares, share=shares)
def test_coefficients_agree_with_values(seed, low, high, share):
    f = random_factors(seed)
    basis = BINOMIALS * share ** np.arange(7) * (1.0 - share) ** np.arange(6, -1, -1)
    from_coefficients = basis @ np.array(coefficients(f, low, high))
    at = evaluate(f, low + share * (high - low))
    assert from_coefficients == pytest.approx(at.sextic, abs=1e-12 * size(f))


@law(seed=seeds, tau=st.floats(0.01, 0.99))
def test_the_slope_is_the_derivative(seed, tau):
    f = random_factors(seed)
    h = 1e-5
    difference = (evaluate(f, tau + h).sextic - evaluate(f, tau - h).sextic) / (2.0 * h)
    assert evaluate(f, tau).slope == pytest.approx(difference, abs=1e-7 * size(f))


@law(seed=seeds)
def test_factors_equal_the_sums_that_define_them(seed):
    rng = np.random.default_rng(seed)
    image, m, rays, duals = (rng.standard_normal(s) for s in ((4, 2), 4, (2, 4), (4, 2)))
    tau = rng.uniform()
    depths = (1.0 - tau) * rays[0] + tau * rays[1]
    xi, c, r2 = image @ [1, 1j], duals @ [1, 1j], np.sum(image**2, axis=1)
    cone = Cone(True, tuple(rays[0]), tuple(rays[1]))
    at = evaluate(factors(points_of(image), tuple(m), cone, points_of(duals)), tau)
    n, d = np.sum(m * depths), np.sum(m * r2 * depths)
    assert at.u == pytest.approx(np.sum(depths * xi * c), abs=1e-12)
    assert at.v == pytest.approx(np.sum(depths * xi.conj() * c), abs=1e-12)
    assert (at.n, at.d) == pytest.approx((n, d), abs=1e-12)
    # h₃ d / f: the third row of Σ Q c, with k = -n/d.
    z = np.sum(depths * (d - n * r2) * c)
    assert at.z == pytest.approx(z, abs=1e-12 * (1.0 + abs(n) + abs(d)))


@law(seed=seeds)
def test_no_root_is_missed(seed, sample):
    f = random_factors(seed)
    tau = np.linspace(0.0, 1.0, sample(4001, 301))
    values = real_parts(f, tau)
    change = np.nonzero(values[:-1] * values[1:] < 0.0)[0]
    middle = 0.5 * (tau[change] + tau[change + 1])
    expected = [t for t in middle if evaluate(f, float(t)).re < -1e-3 * size(f)]
    roots = roots_of(f)
    for t in expected:
        assert np.abs(roots - t).min() <= tau[1]
    for t in roots:
        at = evaluate(f, float(t))
        assert abs(at.sextic) <= 1e-9 * abs(at.slope) + 1e-14 * size(f)


@pytest.mark.parametrize('gap', [1e-1, 1e-3, 1e-5, 1e-7])
@pytest.mark.parametrize('middle', [0.137, 0.5, 0.9])
def test_two_close_roots_are_separated(gap, middle):
    roots = roots_of(factors_with_close_roots(middle, gap))
    assert len(roots) == 2
    np.testing.assert_allclose(
        roots, [middle - gap / 2, middle + gap / 2], atol=1e-6 * gap + 1e-15
    )


@pytest.mark.parametrize('root', [0.5, 0.25, 0.3, 1e-6, 1.0 - 1e-6])
def test_a_single_root_is_exact(root):
    np.testing.assert_allclose(roots_of(factors_with_roots((root, 5.0))), [root], rtol=1e-14)


@pytest.mark.parametrize('root', [0.0, 1.0, -1e-3, 1.001])
def test_roots_at_the_ends_and_beyond_are_excluded(root):
    assert roots_of(factors_with_roots((root, 5.0))).size == 0


def test_a_sextic_of_zeros_has_no_roots():
    f = Factors(*[1 + 0j] * 8, 0.0, 0.0, 1.0, 1.0)
    assert evaluate(f, 0.3).sextic == 0.0
    assert roots_of(f).size == 0


def test_the_search_ends_for_a_sextic_of_rounding_errors():
    # Tiny values of random sign at every τ: the search ends at its maximum number of intervals.
    rng = np.random.default_rng(3)
    for _ in range(20):
        noise = rng.standard_normal(8) * 1e-17j
        f = Factors(*(complex(1.0) + noise), 0.0, 0.0, 1.0, 1.0)
        assert roots_of(f).size <= MAX_ROOTS


@law(seed=seeds, max_bend=st.floats(0.01, 100.0))
def test_the_bound_on_k_only_excludes_roots(seed, max_bend):
    f = random_factors(seed)

    def cameras(roots):
        at = [(t, evaluate(f, float(t))) for t in roots]
        return [t for t, v in at if v.re < 0.0 and -v.n / v.d < max_bend]

    bounded = roots_of(f, max_bend)
    np.testing.assert_allclose(cameras(bounded), cameras(roots_of(f)), atol=1e-12)
    assert all(
        -v.n / v.d < max_bend * (1 + 1e-9) for v in (evaluate(f, float(t)) for t in bounded)
    )
