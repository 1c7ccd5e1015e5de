"""Mass bands: integrals of the basis, sums, products and factors against dense algebra."""

import numpy as np
import pytest

from dlo_sim.core import bspline, mass, quadrature

SIZES = [4, 5, 11, 12, 20]
LENGTH = 0.8


def integrated(knots, derivative):
    """Gram matrix by a fine independent quadrature of the full basis, shape (n, n)."""
    n = len(knots) - 4
    breaks = np.unique(knots)
    nodes, weights = np.polynomial.legendre.leggauss(7)
    total = np.zeros((n, n))
    for left, right in zip(breaks[:-1], breaks[1:], strict=True):
        u = 0.5 * (left + right) + 0.5 * (right - left) * nodes
        basis = bspline.evaluate(np.eye(n), knots, u, derivative)
        total += basis.T @ (0.5 * (right - left) * weights[:, None] * basis)
    return total


@pytest.mark.parametrize("derivative", [0, 1, 2])
@pytest.mark.parametrize("n", SIZES)
def test_gram_is_the_integral(n, derivative):
    knots = bspline.clamped_knots(n, LENGTH)
    expected = integrated(knots, derivative)
    found = mass.dense(mass.gram(knots, derivative))
    assert np.allclose(found, expected, rtol=0, atol=1e-13 * np.abs(expected).max())


@pytest.mark.parametrize("n", SIZES)
def test_lumped_keeps_the_mass_and_its_centre_but_not_its_inertia(n):
    knots = bspline.clamped_knots(n, LENGTH)
    band = mass.lumped(mass.gram(knots))
    g = bspline.greville(knots)
    assert not band[1:].any()
    assert np.all(band[0] > 0)
    assert band[0].sum() == pytest.approx(LENGTH, rel=1e-13)
    assert band[0] @ g == pytest.approx(LENGTH**2 / 2, rel=1e-13)
    assert band[0] @ g**2 > LENGTH**3 / 3 * 1.0001


def test_gram_of_a_rule_is_that_rules_sum():
    """One midpoint a span: rank is the number of spans, not more."""
    knots = bspline.clamped_knots(9, LENGTH)
    dense = mass.dense(mass.gram(knots, 0, quadrature.gauss(np.linspace(0.0, LENGTH, 7), 1)))
    assert np.linalg.matrix_rank(dense) == 6
    u = (np.arange(6) + 0.5) * LENGTH / 6
    basis = bspline.evaluate(np.eye(9), knots, u)
    assert np.allclose(dense, basis.T @ basis * LENGTH / 6, atol=1e-16)


@pytest.mark.parametrize("n", SIZES)
def test_products_agree_with_the_dense_matrix(n):
    band = mass.gram(bspline.clamped_knots(n, LENGTH))
    x = np.random.default_rng(n).normal(size=(n, 2))
    assert np.allclose(mass.multiply(band, x), mass.dense(band) @ x, rtol=0, atol=1e-15)
    assert np.allclose(mass.multiply(band, x[:, 0]), mass.dense(band) @ x[:, 0], atol=1e-15)


def solve(lower, inverse_diagonal, right):
    """x with L D L^T x = right, through full matrices; zero where the inverse diagonal is."""
    n = len(right)
    unit = np.eye(n)
    for k in range(1, 4):
        for i in range(k, n):
            unit[i, i - k] = lower[k - 1, i]
    y = np.linalg.solve(unit, right)
    return np.linalg.solve(unit.T, inverse_diagonal * y)


@pytest.mark.parametrize("held", [(), (0,), (0, 1), (0, 1, -2, -1), (3,), (0, 2, 5)])
@pytest.mark.parametrize("n", [8, 12, 20])
def test_factors_solve_the_free_part(n, held):
    band = mass.gram(bspline.clamped_knots(n, LENGTH))
    prescribed = np.zeros(n, dtype=bool)
    prescribed[list(held)] = True
    lower, inverse = mass.factorize(band, prescribed)
    right = np.random.default_rng(n).normal(size=n)
    right[prescribed] = 0.0
    free = ~prescribed
    expected = np.zeros(n)
    expected[free] = np.linalg.solve(mass.dense(band)[np.ix_(free, free)], right[free])
    assert np.array_equal(inverse == 0.0, prescribed)
    assert np.allclose(solve(lower, inverse, right), expected, rtol=1e-11, atol=1e-11)


def test_a_matrix_that_is_not_positive_is_refused():
    band = mass.gram(bspline.clamped_knots(6, LENGTH))
    band[0, 3] = -1.0
    with pytest.raises(ValueError, match="not positive definite at control point 3"):
        mass.factorize(band, np.zeros(6, dtype=bool))
