"""The tangent stiffness: symmetric, the limit of force differences, rigid motions in its kernel."""

import numpy as np
import pytest
from cables import FLAT, FULL, SOFT, Bench, inflected, rotation, straight, wild
from differences import assert_limit

from dlo_sim.core import bspline

SHAPES = {"wild": wild, "straight": straight, "inflected": inflected}


@pytest.mark.parametrize("shape", SHAPES)
@pytest.mark.parametrize("n", [4, 5, 12])
def test_stiffness_is_the_derivative_of_the_force(n, shape):
    bench = Bench(FULL, n=n)
    points = SHAPES[shape](bench)

    def force(xyz):
        return bench.force(np.concatenate((xyz, points[:, 3:]), axis=1))[:, :3].ravel()

    found = -bench.stiffness(points).reshape(3 * n, n, 3)
    # Straight and unstretched, the second derivative of the force vanishes: exact early.
    assert_limit(found, force, points[:, :3].copy(), bound=1e-7)


@pytest.mark.parametrize("rule", [("gauss", 3), ("uniform", 41)])
@pytest.mark.parametrize("n", [4, 11, 12, 20])
def test_stiffness_is_symmetric(n, rule):
    places = {"discretization.quadrature": rule[0], "discretization.samples": rule[1]}
    bench = Bench(FULL, places, n=n)
    found = bench.stiffness(wild(bench))
    assert np.abs(found - found.T).max() < 1e-12 * np.abs(found).max()


def test_straight_cable_has_exactly_five_free_motions():
    """Three translations and two rotations; a turn about its own axis moves no control point."""
    bench = Bench(SOFT, FLAT, n=9)
    values = np.linalg.eigvalsh(bench.stiffness(straight(bench)))
    assert np.abs(values[:5]).max() < 1e-10 * values[-1]
    assert values[5] > 1e-5 * values[-1]


def test_stiffness_turns_with_the_cable():
    bench = Bench(SOFT, FLAT, n=9)
    points = wild(bench)
    turn = np.kron(np.eye(9), rotation([0.3, 1.2, -0.5]))
    moved = points.copy()
    moved[:, :3] = (turn @ points[:, :3].ravel()).reshape(9, 3)
    expected = turn @ bench.stiffness(points) @ turn.T
    assert np.abs(bench.stiffness(moved) - expected).max() < 1e-12 * np.abs(expected).max()


def test_stretched_and_bent_stiffness_of_a_straight_cable():
    """Energy of the shapes u^2 along and across: EA integral (2 u)^2 du, EI integral 2^2 du."""
    bench = Bench(SOFT, FLAT, n=10)
    square = np.zeros((10, 3))
    knots = bench.model.knots
    parabola = bspline.interpolate(knots, (bspline.greville(knots) ** 2)[:, None])[:, 0]
    found = bench.stiffness(straight(bench))
    for axis, expected in ((0, 60.0 * 4 / 3), (1, 0.02 * 4), (2, 0.02 * 4)):
        mode = square.copy()
        mode[:, axis] = parabola
        assert mode.ravel() @ found @ mode.ravel() == pytest.approx(expected, rel=1e-11)
