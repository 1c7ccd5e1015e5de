"""Tension and curvature of curves whose values are known."""

import numpy as np
import pytest

from dlo_sim.core import bspline
from dlo_sim.core.strain import Strain

LENGTH = 0.8
U = np.linspace(0.0, LENGTH, 33)


def circle(n, radius, stretch=1.0):
    """Control points of an arc that is `stretch` times as long as its parameter."""
    knots = bspline.clamped_knots(n, LENGTH)
    angle = stretch * bspline.greville(knots) / radius
    places = np.stack([radius * np.cos(angle), radius * np.sin(angle), 0.0 * angle], axis=1)
    return knots, bspline.interpolate(knots, places)


@pytest.mark.parametrize("stretch", [0.9, 1.0, 1.2])
def test_curvature_and_tension_of_a_stretched_arc(stretch):
    knots, points = circle(25, 0.25, stretch)
    found = Strain(knots, U)
    assert found.curvature(points) == pytest.approx(4.0, rel=0.02)
    assert found.tension(points, 100.0, 0.0) == pytest.approx(100.0 * (stretch - 1.0), abs=0.2)
    assert found.tension(points, 0.0, 0.5) == pytest.approx(-0.5 * 4.0**2, rel=0.02)


def test_tension_is_the_derivative_of_the_energy():
    """A closed ring that is blown up: dW/ds = L N, W its energy of stretching and bending."""

    def energy(s):
        return LENGTH * (0.5 * 100.0 * (s - 1.0) ** 2 + 0.5 * 0.5 / (0.25 * s) ** 2)

    slope = (energy(1.0 + 1e-6) - energy(1.0 - 1e-6)) / 2e-6
    knots, points = circle(25, 0.25)
    force = Strain(knots, U).tension(points, 100.0, 0.5)
    assert force.mean() * LENGTH == pytest.approx(slope, rel=0.03)


def test_tension_that_rises_along_a_straight_line():
    """r = (u + a u^2 / 2) e has |r'| - 1 = a u: right between the middles of the outer spans."""
    knots = bspline.clamped_knots(9, LENGTH)
    g = bspline.greville(knots)
    points = bspline.interpolate(knots, np.outer(g + 0.05 * g**2, [0.6, 0.0, 0.8]))
    found = Strain(knots, U)
    inside = (U > 0.07) & (U < LENGTH - 0.07)
    assert found.tension(points, 10.0, 1.0)[inside] == pytest.approx(U[inside], abs=1e-12)
    assert found.curvature(points) == pytest.approx(0.0, abs=1e-9)
