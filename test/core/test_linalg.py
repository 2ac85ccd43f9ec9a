# Copyright 2026 p4pfr_ros maintainers
# SPDX-License-Identifier: Apache-2.0

"""Small algebra: inversion of information matrices, and polynomial roots."""

from fractions import Fraction

from hypothesis import strategies as st
from laws import law
import numpy as np
from numpy.polynomial import polynomial as poly
from p4pfr_ros.core.linalg import inverse_of_information, smallest_positive_root
import pytest

seeds = st.integers(0, 2**32 - 1)
sizes = st.integers(2, 8)


def draw_information(rng, n, smallest, units=True):
    """Draw a matrix (n, n) with about this smallest eigenvalue and unit diagonal, then units."""
    basis = np.linalg.qr(rng.standard_normal((n, n)))[0]
    eigenvalues = np.append(smallest, rng.uniform(0.5, 2.0, n - 1))
    matrix = (basis * eigenvalues) @ basis.T
    scale = 1.0 / np.sqrt(np.diag(matrix))
    unit = 10.0 ** rng.uniform(-4.0, 4.0, n) if units else np.ones(n)
    matrix = matrix * np.outer(scale, scale) * np.outer(unit, unit)
    return 0.5 * (matrix + matrix.T)


def exact_inverse(matrix):
    """Invert a matrix by elimination in rational numbers; round the result to doubles."""
    n = len(matrix)
    rows = [
        [Fraction(x) for x in row] + [Fraction(i == j) for j in range(n)]
        for i, row in enumerate(matrix.tolist())
    ]
    for j in range(n):
        pivot = next(i for i in range(j, n) if rows[i][j] != 0)
        rows[j], rows[pivot] = rows[pivot], rows[j]
        rows[j] = [x / rows[j][j] for x in rows[j]]
        for i in range(n):
            if i != j:
                rows[i] = [a - rows[i][j] * b for a, b in zip(rows[i], rows[j], strict=True)]
    return np.array([[float(x) for x in row[n:]] for row in rows])


def in_sigmas(matrix, reference):
    """Return a matrix in units of the square roots of a reference's diagonal."""
    sigma = np.sqrt(np.diag(reference))
    return matrix / np.outer(sigma, sigma)


@law(seed=seeds, n=sizes, power=st.floats(-12.0, -0.5))
def test_the_inverse_is_exact_but_for_the_ridge(seed, n, power):
    """The ridge of 1e-13 changes variances by 1 % at an eigenvalue of 1e-11, 10 % at 1e-12."""
    information = draw_information(np.random.default_rng(seed), n, 10.0**power)
    smallest = np.linalg.eigvalsh(in_sigmas(information, information))[0]
    expected = exact_inverse(information)
    inverse = inverse_of_information(information)
    np.testing.assert_allclose(
        in_sigmas(inverse, expected),
        in_sigmas(expected, expected),
        atol=1.05e-13 / smallest + 1e-13,
    )
    if smallest > 1e-11:
        np.testing.assert_allclose(np.diag(inverse), np.diag(expected), rtol=0.02)


@law(seed=seeds, n=sizes)
def test_units_scale_the_inverse(seed, n):
    rng = np.random.default_rng(seed)
    information = draw_information(rng, n, 0.1, units=False)
    unit = 2.0 ** rng.integers(-40, 40, n)  # powers of two: without rounding
    scaled = inverse_of_information(information * np.outer(unit, unit))
    expected = inverse_of_information(information) / np.outer(unit, unit)
    np.testing.assert_allclose(scaled, expected, rtol=1e-12)


@law(seed=seeds, n=sizes, data=st.data())
def test_an_unknown_without_information_has_a_huge_variance_and_changes_no_other(seed, n, data):
    information = draw_information(np.random.default_rng(seed), n, 0.1)
    empty = data.draw(st.integers(0, n))
    others = np.delete(np.arange(n + 1), empty)
    extended = np.zeros((n + 1, n + 1))
    extended[np.ix_(others, others)] = information
    inverse = inverse_of_information(extended)
    assert inverse[empty, empty] >= 1e12
    np.testing.assert_array_equal(inverse[empty, others], 0.0)
    np.testing.assert_allclose(
        inverse[np.ix_(others, others)], inverse_of_information(information), rtol=1e-12
    )


def test_two_unknowns_that_only_their_sum_determines_have_huge_variances():
    inverse = inverse_of_information(np.array([[4.0, 4.0], [4.0, 4.0]]))
    assert (np.diag(inverse) > 1e11).all()
    assert np.ones(2) @ inverse @ np.ones(2) < 1.0


@pytest.mark.parametrize(
    ('polynomial', 'root'),
    [
        (poly.polyfromroots([-1.0, 2.0, 3.0]), 2.0),
        (poly.polyfromroots([-1.0, -2.0]), np.inf),
        ([1.0, 0.0, 1.0], np.inf),
        # Double roots, which a lens folds at: computed, they are slightly off the real axis.
        ([1.0, -2.0, 1.0], 1.0),
        (poly.polyfromroots([0.7, 0.7, 2.0]), 0.7),
        ([1.0, 0.0, 0.0], np.inf),
        ([1.0, -2.0, 0.0], 0.5),
        ([1.0, np.inf], 0.0),
    ],
)
def test_the_smallest_positive_root_of_some_polynomials(polynomial, root):
    assert smallest_positive_root(np.array(polynomial)) == pytest.approx(root)


@law(
    negative=st.lists(st.floats(-10.0, -0.1), max_size=2),
    positive=st.lists(st.floats(0.1, 10.0), max_size=2, unique_by=lambda x: round(x, 1)),
    seed=seeds,
)
def test_the_smallest_positive_root_is_the_smallest_of_the_positive_ones(negative, positive, seed):
    factor = np.random.default_rng(seed).choice([-1.0, 1.0]) * 10.0 ** (seed % 9 - 4)
    complex_pair = [5.0 + 1.0j, 5.0 - 1.0j]
    polynomial = poly.polyfromroots([*negative, *positive, *complex_pair]).real
    root = smallest_positive_root(factor * polynomial)
    assert root == pytest.approx(min(positive, default=np.inf), rel=1e-6)
