"""Rings and channels through which a cable runs."""

import math

import numpy as np
import pytest
from cables import move, simulator

from dlo_sim.scene.needs import mirrors
from dlo_sim.simulation.obstacles import Contact
from dlo_sim.studies import bodies

TURNED = [0.0, math.sqrt(0.5), 0.0, math.sqrt(0.5)]  # its z axis is along x
# A soft cable along x, through an opening in the middle of it.
THREADED = {
    "cable.length": 0.4,
    "cable.diameter": 0.006,
    "cable.density": 1200.0,
    "cable.youngs_modulus": 2e6,
    "start.position": [-0.2, 0.0, 0.0],
    "end.position": [0.2, 0.0, 0.0],
    "end.fixed": [False] * 3,
    "initial.shape": "straight",
    "terms.twist": "off",
    "discretization.control_points": 23,
    "damping.mass": 1.0,
    "obstacles.names": ["guide"],
    "obstacles.guide.orientation": TURNED,
    "obstacles.guide.friction": 0.3,
}
RING = {"obstacles.guide.shape": "ring", "obstacles.guide.size": [0.02, 0.006, 0.0]}
CHANNEL = {"obstacles.guide.shape": "channel", "obstacles.guide.size": [0.01, 0.002, 0.08]}


def threaded(*values, step=2e-3):
    tight = {"integrator.tolerance": 1e-12}
    return simulator(THREADED, tight, *values, method="energy_momentum", step=step)


def test_forces_that_cancel_are_reported_by_their_sizes():
    """As those of a ring that holds the cable from all sides: their sum is round-off."""
    for off, exerted in ((1e-17, 4.0), (0.01, 0.01)):
        forces = np.array([[2.0 + off, 0.0, 0.0], [-2.0, 0.0, 0.0]])
        none, resultant = np.zeros(0), np.array([off, 0.0, 0.0])
        contact = Contact(-1e-5, resultant, 1.0, none, np.zeros((2, 3)), forces, none, none)
        assert contact.exerted == pytest.approx(exerted, abs=1e-12)


def test_a_ring_is_a_capstan():
    """Over a quarter of its wire, 0.1 m thick; the report knows the tensions on both sides."""
    ring = {
        "obstacles.drum.shape": "ring",
        "obstacles.drum.size": [0.2, 0.1, 0.0],
        "obstacles.drum.orientation": TURNED,
        "obstacles.drum.position": [0.0, 0.0, 0.15],
    }
    found = bodies.capstan(0.5 * math.pi, 43, ring)
    assert abs(found.answers[0].error) < 0.01
    assert found.simulator.energy_error < 1e-4
    sim, pulls = found.simulator, []
    for _ in range(20):
        assert sim.advance(0.01).status.ok
        touched = sim.contact("drum")
        assert len(touched.passes) == 1
        assert touched.u.min() < touched.passes[0] < touched.u.max()
        pulls.append(touched.tensions)
    before, behind = np.mean(pulls, axis=0)
    assert behind == pytest.approx(1.0, rel=0.01)
    assert before / behind == pytest.approx(1.602, rel=0.01)


def test_a_ring_that_moves_does_the_work():
    sim = threaded(RING)
    move(sim, "guide", 1.0, velocity=[0.0, 0.0, 0.2])
    lifted = 0.0
    for _ in range(10):
        assert sim.advance(0.05).status.ok
        lifted = max(lifted, sim.contact("guide").force[2])
    assert lifted > 0.05
    assert sim.cable.account.drive_work > 1e-3
    assert sim.energy_error < 1e-10
    (u,) = sim.contact("guide").passes
    assert sim.centerline([u])[0, 0] == pytest.approx(0.0, abs=1e-6)


def test_a_cable_is_drawn_through_a_channel():
    """Aside too, round its rim, and never through its wall."""
    sim = threaded(CHANNEL)
    move(sim, "start", 1.0, velocity=[-0.1, 0.05, 0.05])
    u, before = np.linspace(0.0, 0.4, 401), 0.2
    for _ in range(20):
        assert sim.advance(0.05).status.ok
        line = sim.centerline(u)
        away = np.hypot(line[:, 1], line[:, 2])
        inside = (np.abs(line[:, 0]) < 0.039) & (away < 0.02)
        assert away[inside].max() < 0.002 + 1e-4
        (now,) = sim.contact("guide").passes
        assert now > before - 1e-3
        before = now
    assert before > 0.28
    assert sim.energy_error < 1e-8


@pytest.mark.parametrize(
    ("aside", "flat"), [([0.0] * 3, True), ([0.0, 1e-3, 0.0], False), ([0.0, 0.0, 2e-3], True)]
)
def test_a_guide_leaves_the_side_open_where_it_is_mirrored(aside, flat):
    for shape in (RING, CHANNEL):
        held = {"end.fixed": [True] * 3, "end.position": [0.19, 0.0, 0.0]}
        sim = threaded(shape, held, {"obstacles.guide.position": aside})
        assert mirrors(sim.scene)[1] == flat
