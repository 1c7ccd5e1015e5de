"""Knots that are denser towards clamps: where, how much more accurate, and when they change."""

import numpy as np
import pytest
from cables import scene_of

from dlo_sim.core import bspline
from dlo_sim.simulation.resolution import knot_grading, resolved
from dlo_sim.simulation.simulator import Simulator

# It bends at a level clamp within 4 cm, under its own weight of 0.6 N.
HANGING = {
    "cable.length": 1.0,
    "cable.linear_density": 0.06,
    "cable.diameter": 0.008,
    "cable.axial_stiffness": 100.0,
    "cable.bending_stiffness": 1e-3,
    "damping.stiffness": 0.02,
    "discretization.knots": "auto",
    "start.clamped": True,
    "start.tangent": [1.0, 0.0, 0.0],
}
HELD = {
    "end.fixed": [True] * 3,
    "end.clamped": True,
    "end.tangent": [1.0, 0.0, 0.0],
    "end.position": [0.8, 0.0, 0.0],
}
BEND = np.sqrt(1e-3 / (0.06 * 9.81))  # [m]


def grading(scene):
    return knot_grading(resolved(scene)[0])


def excess(bend, held):
    """Of the density of knots at a clamp, by the errors in the docstring of `resolution`.

    This cable closes to a radius of (EI / w)^(1/3), or between two grippers to a twelfth of its
    length; a bend at a clamp may turn by pi / 2.
    """
    ring = min((1e-3 / (0.06 * 9.81)) ** (1.0 / 3.0), 1.0 / 12.0 if held else 1.0 / 6.0)
    middle = ring * (1e-3 / (0.05 * ring)) ** 0.25
    return middle / (bend * (1e-3 / (0.05 * np.pi / 2.0 * bend)) ** 0.2) - 1.0


@pytest.mark.parametrize(
    ("values", "start", "end", "bend"),
    [
        ({}, 1, 0, BEND),
        ({"end.mass": 0.18}, 1, 0, BEND / 2.0),
        (HELD, 1, 1, np.sqrt(2.0) * BEND),
        (HELD | {"end.clamped": False}, 1, 0, np.sqrt(2.0) * BEND),
    ],
)
def test_where_a_cable_is_clamped(values, start, end, bend):
    found = grading(scene_of(HANGING, values, n=13))
    closer = excess(bend, held="end.fixed" in values)
    expected = start * closer, end * closer, 2.8 * bend
    assert found == pytest.approx(expected, rel=1e-3)


def test_a_bend_within_a_span_has_knots_too():
    limp = {"cable.bending_stiffness": 1e-8}
    assert grading(scene_of(HANGING, limp, n=13)).reach == 0.05  # m, half a span


@pytest.mark.parametrize(
    "values",
    [
        {"discretization.knots": "uniform"},
        {"discretization.quadrature": "uniform", "discretization.samples": 31},
        {"start.clamped": False},
        {"gravity": [0.0, 0.0, 0.0]},
        {"terms.gravity": "off"},
        {"terms.bend": "off"},
        {"cable.bending_stiffness": 0.03},  # a bend longer than spans are elsewhere
        {"discretization.mass": "lumped"},
        {"loads.names": ["pull"], "loads.pull.position": 0.5},
        {"grasps.names": ["middle"], "grasps.middle.position": [0.4, 0.0, 0.0]},
        {"damping.stiffness": 0.0, "integrator.method": "velocity_verlet"},
    ],
)
def test_equal_spans_where_others_gain_nothing(values):
    assert grading(scene_of(HANGING, values, n=13)) == bspline.EQUAL
    sim = Simulator(scene_of(HANGING, values, n=13))
    assert np.ptp(np.diff(bspline.breaks(sim.model.knots))) < 1e-12


@pytest.mark.parametrize(
    ("values", "share", "most"),
    [({}, 0.06, 3e-4), ({"end.mass": 0.06}, 0.05, 3e-4), (HELD, 0.4, 4e-5)],
)
def test_a_cable_at_rest_is_much_closer_to_the_converged_one(values, share, most):
    """Than on equal spans, with the number of control points that is chosen. Between two grippers
    spans are short everywhere: the error [m] is smaller, and so is the gain.
    """
    at_rest = HANGING | {"initial.shape": "equilibrium"} | values
    u = np.linspace(0.0, 1.0, 41)
    converged = Simulator(scene_of(at_rest, n=121)).centerline(u)
    chosen = Simulator(scene_of(at_rest, n=0))
    equal = scene_of(at_rest, {"discretization.knots": "uniform"}, n=chosen.model.n)
    graded, equal = (
        np.abs(sim.centerline(u) - converged).max() for sim in (chosen, Simulator(equal))
    )
    assert graded < share * equal
    assert graded < most  # m, of the millimetre that accuracy.target allows


def test_a_cable_clamped_at_its_end_alone_begins_unstretched():
    turned = {"start.fixed": [False] * 3, "start.clamped": False} | HELD
    sim = Simulator(scene_of(HANGING, turned, {"initial.shape": "straight"}, n=13))
    spans = np.diff(bspline.breaks(sim.model.knots))
    assert spans[-1] < 0.5 * spans[0]
    assert sim.energy().stretch < 1e-20  # J


@pytest.mark.parametrize(
    "changes",
    [
        {"cable.bending_stiffness": 5e-4},
        {"cable.linear_density": 0.1},
        {"gravity": [0.0, 0.0, -1.6]},
        {"accuracy.target": 1e-4},
        {"integrator.method": "implicit_midpoint"},
    ],
)
@pytest.mark.parametrize("n", [0, 13])
def test_knots_do_not_move_while_a_cable_moves(changes, n):
    sim = Simulator(scene_of(HANGING, n=n))
    assert sim.advance(0.2).status.ok
    changed = sim.reconfigured(scene_of(HANGING, changes, n=n))
    assert np.array_equal(changed.model.knots, sim.model.knots)
    assert np.array_equal(changed.control_points, sim.control_points)
    assert changed.scene.cable.EI == scene_of(HANGING, changes).cable.EI
