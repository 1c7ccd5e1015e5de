"""Stretch and curvature of curves whose values are known."""

import numpy as np
import pytest

from dlo_sim.core import bspline
from dlo_sim.core.strain import Strain, strain

LENGTH = 0.8
U = np.linspace(0.0, LENGTH, 33)


def circle(n, radius, stretch=1.0):
    """Control points of an arc that is `stretch` times as long as its parameter."""
    knots = bspline.clamped_knots(n, LENGTH)
    angle = stretch * bspline.greville(knots) / radius
    places = np.stack([radius * np.cos(angle), radius * np.sin(angle), 0.0 * angle], axis=1)
    return knots, bspline.interpolate(knots, places)


@pytest.mark.parametrize("stretch", [0.9, 1.0, 1.2])
def test_arc(stretch):
    knots, points = circle(25, 0.25, stretch)
    found = Strain(knots, U)
    assert found.curvature(points) == pytest.approx(4.0, rel=0.02)
    assert found.stretch(points) == pytest.approx(stretch - 1.0, abs=2e-3)


def test_stretch_that_rises_along_a_straight_line():
    """r = (u + a u^2 / 2) e has |r'| - 1 = a u: right between the middles of the outer spans."""
    knots = bspline.clamped_knots(9, LENGTH)
    g = bspline.greville(knots)
    points = bspline.interpolate(knots, np.outer(g + 0.05 * g**2, [0.6, 0.0, 0.8]))
    found = Strain(knots, U)
    inside = (U > 0.07) & (U < LENGTH - 0.07)
    assert found.stretch(points)[inside] == pytest.approx(0.1 * U[inside], abs=1e-12)
    assert found.curvature(points) == pytest.approx(0.0, abs=1e-9)


def test_many_shapes_at_once():
    knots, points = circle(9, 0.25)
    many = np.stack([points, 2.0 * points])
    found = strain(knots, U)
    assert found.curvature(many).shape == found.stretch(many).shape == (2, 33)
    assert found.curvature(many)[1] == pytest.approx(found.curvature(points) / 2.0)
    assert strain(knots.copy(), U.copy()) is found
