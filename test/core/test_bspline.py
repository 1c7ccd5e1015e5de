"""The spline basis against the definition, against differences, and at its borders."""

import numpy as np
import pytest

from dlo_sim.core import bspline

SIZES = [4, 5, 11, 12, 20]
LENGTH = 1.7


def coordinates(n, count=57):
    """Material coordinates between the knots, and the knots themselves."""
    rng = np.random.default_rng(n)
    breaks = np.linspace(0.0, LENGTH, n - 2)
    return np.concatenate((rng.uniform(0.0, LENGTH, count), breaks))


def test_graded_spans_share_the_density_of_knots():
    def density(u):
        return 1.0 + 4.0 * np.exp(-u / 0.2) + 1.5 * np.exp((u - LENGTH) / 0.2)

    knots = bspline.clamped_knots(12, LENGTH, bspline.Grading(4.0, 1.5, 0.2))
    ends = bspline.breaks(knots)
    assert (ends[0], ends[-1]) == (0.0, LENGTH)
    points, weights = np.polynomial.legendre.leggauss(20)
    middles, halves = 0.5 * (ends[1:] + ends[:-1]), 0.5 * np.diff(ends)
    shares = halves * (density(middles[:, None] + halves[:, None] * points) @ weights)
    np.testing.assert_allclose(shares, shares.mean(), rtol=1e-5)


def test_fewer_than_four_control_points_are_refused():
    with pytest.raises(ValueError, match="at least 4 control points, got 3"):
        bspline.clamped_knots(3, 1.0)


@pytest.mark.parametrize("n", SIZES)
def test_values_and_derivatives_agree_with_scipy(n):
    interpolate = pytest.importorskip("scipy.interpolate")
    knots = bspline.clamped_knots(n, LENGTH)
    u = coordinates(n)
    points = np.random.default_rng(1).normal(size=(n, 3))
    spline = interpolate.BSpline(knots, points, 3)
    for derivative in range(4):
        ours = bspline.evaluate(points, knots, u, derivative)
        scale = (n / LENGTH) ** derivative
        assert np.allclose(ours / scale, spline(u, derivative) / scale, rtol=0, atol=1e-12)


@pytest.mark.parametrize("n", SIZES)
def test_greville_points_make_a_straight_cable_of_rest_length(n):
    knots = bspline.clamped_knots(n, LENGTH)
    line = np.outer(bspline.greville(knots), [0.6, 0.0, 0.8])
    u = coordinates(n)
    assert np.allclose(bspline.evaluate(line, knots, u), np.outer(u, [0.6, 0, 0.8]), atol=2e-15)
    assert np.allclose(bspline.evaluate(line, knots, u, 1), [0.6, 0, 0.8], atol=1e-13)
    assert np.allclose(bspline.evaluate(line, knots, u, 2), 0.0, atol=1e-10)


def test_ends_hold_the_curve_and_its_tangent():
    knots = bspline.clamped_knots(9, 1.2)
    points = np.random.default_rng(2).normal(size=(9, 3))
    ends = np.array([0.0, 1.2])
    assert np.allclose(bspline.evaluate(points, knots, ends), points[[0, -1]], atol=1e-15)
    slopes = np.array([points[1] - points[0], points[-1] - points[-2]]) * 3 / 0.2
    assert np.allclose(bspline.evaluate(points, knots, ends, 1), slopes, rtol=1e-13)


@pytest.mark.parametrize("n", SIZES)
def test_interpolation_reproduces_every_cubic(n):
    knots = bspline.clamped_knots(n, LENGTH)

    def cubic(u):
        return np.stack((1 - 2 * u + u**3, u**2 - 0.3 * u**3), axis=1)

    points = bspline.interpolate(knots, cubic(bspline.greville(knots)))
    u = coordinates(n)
    assert np.allclose(bspline.evaluate(points, knots, u), cubic(u), rtol=0, atol=1e-13)
    assert np.allclose(bspline.evaluate(points, knots, u, 3)[:, 0], 6.0, rtol=1e-7)


def test_coordinates_beyond_the_cable_are_refused_but_round_off_is_not():
    knots = bspline.clamped_knots(6, LENGTH)
    inside = bspline.active_basis(knots, [-1e-12, LENGTH + 1e-12])[1]
    assert np.allclose(inside, [[1, 0, 0, 0], [0, 0, 0, 1]], atol=1e-10)
    with pytest.raises(ValueError, match=r"outside \[0, 1.7\] m: .* 1.8"):
        bspline.active_basis(knots, [0.1, 1.8])
    with pytest.raises(ValueError, match="outside"):
        bspline.active_basis(knots, [-0.01])
