"""Weights, places and degrees of the two quadratures."""

import numpy as np
import pytest

from dlo_sim.core import quadrature

LENGTH = 2.4


def places(rule):
    """Material coordinates of all samples, padding included, shape (n_spans, m)."""
    n_spans = len(rule.xi)
    return (np.arange(n_spans)[:, None] + 0.5 * (rule.xi + 1)) * LENGTH / n_spans


@pytest.mark.parametrize("points", [1, 2, 3, 4, 10])
@pytest.mark.parametrize("n_spans", [1, 2, 9])
def test_gauss_is_exact_to_its_degree_and_no_further(n_spans, points):
    rule = quadrature.gauss(np.linspace(0.0, LENGTH, n_spans + 1), points)
    assert np.count_nonzero(rule.weights) == n_spans * points
    assert rule.weights.sum() == pytest.approx(LENGTH, rel=1e-14)
    u = places(rule)
    for degree in range(2 * points):
        exact = LENGTH ** (degree + 1) / (degree + 1)
        assert np.sum(rule.weights * u**degree) == pytest.approx(exact, rel=1e-13)
    # The square of the Legendre polynomial, of degree 2 points: its integral is L / (2 points + 1),
    # but every sample is one of its zeros.
    legendre = np.polynomial.legendre.Legendre.basis(points)(rule.xi)
    assert np.sum(rule.weights * legendre**2) < 1e-12


@pytest.mark.parametrize("points", [3, 4, 10])
@pytest.mark.parametrize("ends", [(True, False), (False, True), (True, True)])
def test_a_sample_at_an_end_costs_one_degree(points, ends):
    gauss = quadrature.gauss(np.linspace(0.0, LENGTH, 6), points)
    rule = quadrature.with_ends(gauss, ends)
    assert (rule.xi[0, 0] == -1.0, rule.xi[-1, -1] == 1.0) == ends
    assert np.array_equal(rule.xi[1:-1], gauss.xi[1:-1])
    u = places(rule)
    for degree in range(2 * points - 1):
        exact = LENGTH ** (degree + 1) / (degree + 1)
        assert np.sum(rule.weights * u**degree) == pytest.approx(exact, rel=1e-12)
    for span in np.flatnonzero([ends[0], *[False] * 3, ends[1]]):
        moment = rule.weights[span] @ rule.xi[span] ** (2 * points - 1)
        assert abs(moment) > 1e-6  # an odd power: 0 if it were exact


@pytest.mark.parametrize(
    ("n_spans", "samples"), [(1, 2), (3, 7), (6, 101), (9, 10), (8, 8), (17, 4)]
)
def test_uniform_is_the_trapezoidal_rule_on_equal_steps(n_spans, samples):
    rule = quadrature.uniform(np.linspace(0.0, LENGTH, n_spans + 1), samples)
    used = rule.weights > 0
    u = np.sort(places(rule)[used])
    assert used.sum() == samples
    assert np.allclose(u, np.linspace(0, LENGTH, samples), rtol=0, atol=1e-14)
    assert np.all(np.abs(rule.xi) <= 1.0 + 1e-12)
    assert rule.weights.sum() == pytest.approx(LENGTH, rel=1e-14)
    expected = np.trapezoid(np.exp(u) * np.cos(3 * u), u)
    values = np.exp(places(rule)) * np.cos(3 * places(rule))
    assert np.sum(rule.weights * values) == pytest.approx(expected, rel=1e-13)


def test_knots_are_found_at_every_size():
    """samples = 10 spans + 1: each inner knot belongs to the span on its right, at xi = -1."""
    for n_spans in range(1, 60):
        rule = quadrature.uniform(np.linspace(0.0, LENGTH, n_spans + 1), 10 * n_spans + 1)
        count = (rule.weights > 0).sum(axis=1)
        assert list(count) == [10] * (n_spans - 1) + [11]
        assert np.allclose(rule.xi[:, 0], -1.0, atol=1e-12)


def test_a_single_uniform_sample_is_refused():
    with pytest.raises(ValueError, match="at least 2 samples, got 1"):
        quadrature.uniform(np.linspace(0.0, LENGTH, 4), 1)
