"""The tangent stiffness: symmetric, the limit of force differences, rigid motions in its kernel."""

import numpy as np
import pytest
from cables import BENT, BY_SPAN, FLAT, SOFT, Bench, inflected, straight, wild
from differences import assert_limit

from dlo_sim.core import bspline

SHAPES = {"wild": wild, "straight": straight, "inflected": inflected}
MOMENT = {"loads.tip.signal": "constant", "loads.tip.torque": [0.05, -0.08, 0.03]}


@pytest.mark.parametrize("shape", SHAPES)
@pytest.mark.parametrize(
    ("n", "stretch", "grading"),
    [(4, {}, 0.0), (5, BY_SPAN, 0.0), (12, {}, 0.0), (12, BY_SPAN, 0.5)],
)
def test_stiffness_is_the_derivative_of_the_force(n, stretch, grading, shape):
    """With springs, natural curvature and a moment, which turns with the tangent."""
    bench = Bench(BENT, stretch, MOMENT, {"loads.tip.position": 0.6}, n=n, grading=grading)
    points = SHAPES[shape](bench)
    if shape == "wild" and stretch:
        points = straight(bench) + 0.1 / n * (points - straight(bench))

    def force(xyz):
        return bench.force(np.concatenate((xyz, points[:, 3:]), axis=1))[:, :3].ravel()

    found = -bench.stiffness(points, moments=True)
    assert np.abs(found - found.T).max() > 1e-6 * np.abs(found).max()
    exact = found.reshape(3 * n, n, 3)
    assert_limit(exact, force, points[:, :3].copy(), bound=1e-7)


@pytest.mark.parametrize("rule", [("gauss", 3), ("uniform", 41)])
@pytest.mark.parametrize("n", [4, 11, 12, 20])
def test_stiffness_is_symmetric(n, rule):
    places = {"discretization.quadrature": rule[0], "discretization.samples": rule[1]}
    bench = Bench(BENT, places, n=n)
    found = bench.stiffness(wild(bench))
    assert np.abs(found - found.T).max() < 1e-12 * np.abs(found).max()


def test_straight_cable_has_exactly_five_free_motions():
    """Three translations and two rotations; a turn about its own axis moves no control point."""
    bench = Bench(SOFT, FLAT, {"terms.out_of_plane": "on"}, n=9)
    values = np.linalg.eigvalsh(bench.stiffness(straight(bench)))
    assert np.abs(values[:5]).max() < 1e-10 * values[-1]
    assert values[5] > 1e-5 * values[-1]


@pytest.mark.parametrize("n", [5, 6, 9, 20])
def test_by_span_only_rigid_motions_along_a_straight_cable_are_free(n):
    """As many strains as the derivative has degrees of freedom: nothing moves without energy."""
    bench = Bench(SOFT, BY_SPAN, {"cable.bending_stiffness": 1e-9}, n=n)
    dim = len(bench.axes)
    values = np.linalg.eigvalsh(bench.stiffness(straight(bench))[::dim, ::dim])
    assert values[0] == pytest.approx(0.0, abs=1e-9 * values[-1])
    assert values[1] > 1e-4 * values[-1]


@pytest.mark.parametrize("grading", [0.0, 0.5])
def test_stretched_and_bent_stiffness_of_a_straight_cable(grading):
    """Energy of the shapes u^2 along and across: EA integral (2 u)^2 du, EI integral 2^2 du."""
    bench = Bench(SOFT, FLAT, {"terms.out_of_plane": "on"}, n=10, grading=grading)
    knots = bench.model.knots
    parabola = bspline.interpolate(knots, (bspline.greville(knots) ** 2)[:, None])[:, 0]
    found = bench.stiffness(straight(bench))
    for axis, expected in ((0, 60.0 * 4 / 3), (1, 0.02 * 4), (2, 0.02 * 4)):
        mode = np.zeros((10, 3))
        mode[:, axis] = parabola
        assert mode.ravel() @ found @ mode.ravel() == pytest.approx(expected, rel=1e-11)
