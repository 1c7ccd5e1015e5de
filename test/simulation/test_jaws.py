"""Clamps that hold a length of cable straight."""

import numpy as np
import pytest
from cables import simulator

ROD = {
    "cable.length": 1.0,
    "cable.linear_density": 0.03,
    "cable.bending_stiffness": 0.02,
    "cable.axial_stiffness": 500.0,
    "discretization.control_points": 20,
    "initial.shape": "equilibrium",
    "integrator.method": "energy_momentum",
    "integrator.step": 2e-3,
    "terms.out_of_plane": "on",
}
MIDDLE = {
    "start.fixed": [False] * 3,
    "end.fixed": [False] * 3,
    "grasps.names": ["hand"],
    "grasps.hand.position": [0.5, 0.0, 0.0],
    "grasps.hand.clamped": True,
    "grasps.hand.tangent": [1.0, 0.0, 0.0],
}
CLAMP = {"start.clamped": True, "start.tangent": [1.0, 0.0, 0.0]}
JAW = 0.06  # [m], about a span


def sag(length):
    """Of the tip of a cantilever of this length."""
    values = {"cable.length": length, "end.position": [length, 0.0, 0.0]}
    sim = simulator(ROD, CLAMP, values, {"discretization.control_points": 30})
    return sim.centerline([length])[0, 2]


def test_the_arms_beside_a_jaw_sag_as_cantilevers_of_what_is_free():
    """Measured 6 % (1.6 % at an end); without the jaw they are 27 % (11 %) too long."""
    ends = np.array([0.0, 1.0])
    free, held = sag(0.5 * (1.0 - JAW)), simulator(ROD, MIDDLE, {"grasps.hand.jaw": JAW})
    assert held.centerline(ends)[:, 2] == pytest.approx(np.full(2, free), rel=0.08)
    loose = simulator(ROD, MIDDLE).centerline(ends)[:, 2]
    assert loose == pytest.approx(np.full(2, 1.27 * free), rel=0.02)
    start = simulator(ROD, CLAMP, {"start.jaw": JAW}).centerline(ends)
    assert start[1, 2] == pytest.approx(sag(1.0 - JAW), rel=0.02)


def test_a_jaw_that_closes_moves_nothing_then_straightens_and_keeps_the_account():
    later = {**CLAMP, "grasps.hand.jaw": 0.2, "grasps.hand.taken": False, "damping.mass": 2.0}
    later |= {"start.fixed": [True] * 3}
    sim = simulator(ROD, MIDDLE, later)
    before, u = sim.control_points, np.array([0.4, 0.5, 0.6])
    bent = np.ptp(np.diff(sim.centerline(u)[:, 2]))
    sim.take("hand")
    assert np.array_equal(sim.control_points, before)
    assert sim.advance(1.0).status.ok
    assert np.ptp(np.diff(sim.centerline(u)[:, 2])) < 0.4 * bent
    assert sim.energy_error < 1e-6
    sim.release("hand")
    assert sim.advance(1.0).status.ok
    assert sim.control_points == pytest.approx(before, abs=0.02)
