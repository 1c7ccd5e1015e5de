"""The oracle itself: curves with known strains, energy by hand, gradient by differences."""

import numpy as np
import pytest
from differences import assert_limit
from elasticity import Section, energies, gradient, strains

from dlo_sim.core import bspline, quadrature

LENGTH = 1.3
SECTION = Section(
    EA=30.0, EI=0.02, GJ=0.015, rest_curvature=(0.5, -1.0, 2.0), rest_axis=(0.6, 0.0, 0.8)
)


def spline_through(n, curve):
    """Knots and control points of the spline through curve(u), exact for cubics."""
    knots = bspline.clamped_knots(n, LENGTH)
    return knots, bspline.interpolate(knots, curve(bspline.greville(knots)))


def wild(n, seed=0):
    """Knots and control points of a bent, stretched and twisted cable."""
    knots = bspline.clamped_knots(n, LENGTH)
    points = np.random.default_rng(seed).normal(size=(n, 4)) * [0.05, 0.05, 0.05, 1.0]
    points[:, 0] += bspline.greville(knots)
    return knots, points


def test_strains_of_a_twisted_parabola():
    """r = (u, a u^2, 0), theta = b u^2: |r'|^2 = 1 + 4 a^2 u^2, kappa = 2 a / |r'|^3 about z."""
    a, b = 0.7, 0.4
    knots, points = spline_through(8, lambda u: np.stack((u, a * u**2, 0 * u, b * u**2), axis=1))
    u = np.linspace(0.0, LENGTH, 23)
    found = strains(points, knots, u)
    speed = np.sqrt(1 + 4 * a**2 * u**2)
    assert np.allclose(found.stretch, 1 - speed, rtol=0, atol=1e-13)
    assert np.allclose(found.curvature, 2 * a / speed**3, rtol=1e-11)
    assert np.allclose(found.binormal, np.outer(2 * a / speed**3, [0, 0, 1]), atol=1e-11)
    assert np.allclose(found.twist_rate, 2 * b * u, rtol=0, atol=1e-12)


def test_energies_of_the_parabola_by_fine_integration():
    a, b = 0.7, 0.4
    knots, points = spline_through(8, lambda u: np.stack((u, a * u**2, 0 * u, b * u**2), axis=1))
    rule = quadrature.gauss(np.linspace(0.0, LENGTH, 6), 10)
    section = Section(EA=30.0, EI=0.02, GJ=0.015, rest_curvature=(0.5,), rest_axis=(0, 0, 1))
    u = np.linspace(0.0, LENGTH, 20001)
    speed = np.sqrt(1 + 4 * a**2 * u**2)
    expected = (
        15.0 * np.trapezoid((speed - 1) ** 2, u),
        0.01 * np.trapezoid((2 * a / speed**3 - 0.5) ** 2, u),
        0.015 / 2 * (2 * b) ** 2 * LENGTH**3 / 3,
    )
    assert np.allclose(energies(points, knots, rule, section), expected, rtol=1e-7)


def test_a_straight_cable_holds_no_energy_but_that_of_its_natural_curvature():
    knots, points = spline_through(9, lambda u: np.stack((0 * u, u, 0 * u, 0 * u + 2), axis=1))
    rule = quadrature.uniform(np.linspace(0.0, LENGTH, 7), 31)
    assert np.allclose(energies(points, knots, rule, Section(EA=30, EI=1, GJ=1)), 0.0, atol=1e-25)
    bent = Section(EI=0.02, rest_curvature=(2.0,))
    assert energies(points, knots, rule, bent)[1] == pytest.approx(0.5 * 0.02 * 4 * LENGTH)


@pytest.mark.parametrize(
    "rule",
    [
        quadrature.gauss(np.linspace(0.0, LENGTH, 4), 3),
        quadrature.uniform(np.linspace(0.0, LENGTH, 4), 11),
    ],
)
@pytest.mark.parametrize(
    "section",
    [
        Section(EA=30.0),
        Section(EI=0.02),
        Section(GJ=0.015),
        Section(EI=0.02, rest_curvature=SECTION.rest_curvature, rest_axis=SECTION.rest_axis),
        SECTION,
    ],
)
def test_gradient_is_the_limit_of_differences(section, rule):
    knots, points = wild(6)
    assert_limit(
        gradient(points, knots, rule, section),
        lambda p: sum(energies(p, knots, rule, section)),
        points,
        bound=3e-9,
    )


def test_a_vanishing_tangent_is_refused():
    knots = bspline.clamped_knots(4, LENGTH)
    with pytest.raises(ValueError, match="tangent vanishes at u = 0.5 m"):
        strains(np.ones((4, 4)), knots, np.array([0.5]))
