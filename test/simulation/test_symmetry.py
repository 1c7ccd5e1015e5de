"""A straight cable pushed along itself buckles as soon as it does not bear the compression."""

import numpy as np
import pytest
from cables import move, simulator
from numpy.polynomial import Legendre

from dlo_sim.simulation.forecast import Plan

# Euler's load of the clamped-free column: pi^2 EI / (4 L^2) = 0.0493 N
COLUMN = {
    "cable.length": 1.0,
    "cable.diameter": 0.02,
    "cable.linear_density": 0.1,
    "cable.axial_stiffness": 2000.0,
    "cable.bending_stiffness": 0.02,
    "cable.torsional_stiffness": 0.015,
    "discretization.control_points": 13,
    "gravity": [0.0, 0.0, 0.0],
    "start.clamped": True,
    "start.tangent": [0.0, 0.0, 1.0],
    "end.position": [0.0, 0.0, 1.0],
    "loads.names": ["tip"],
    "loads.tip.position": 1.0,
    "loads.tip.signal": "constant",
    "initial.shape": "straight",
}
EULER = np.pi**2 * 0.02 / 4.0
METHODS = ["energy_momentum", "forest_ruth", "rk4"]
SLUNG = {
    "cable.length": 4.0,
    "cable.diameter": 0.006,
    "cable.linear_density": 0.026,
    "cable.youngs_modulus": 5e9,
    "cable.shear_modulus": 1e9,
    "cable.bending_stiffness": 1e-4,
    "start.position": [0.0, 0.0, 10.0],
    "start.pose_topic": "/drone/pose",
    "end.position": [0.0, 0.0, 6.0],
    "end.mass": 0.75,
    "damping.stiffness": 0.001,
}


def pressed(share, method="energy_momentum", **more):
    """A column under this share of Euler's load."""
    values = {"loads.tip.force": [0.0, 0.0, -share * EULER], "integrator.method": method}
    return simulator(COLUMN, values, more)


def across(sim):
    """Distance of the tip from the line [m]."""
    return float(np.abs(sim.control_points[-1, :2]).max())


@pytest.mark.parametrize("method", METHODS)
def test_a_column_below_eulers_load_stays_exactly_straight(method):
    sim = pressed(0.45, method)  # applied at once, a load compresses up to twice as much
    assert sim.advance(0.5).status.ok
    assert across(sim) == 0.0


@pytest.mark.parametrize("method", METHODS)
def test_a_column_beyond_eulers_load_buckles(method):
    """The work of the push is in the energy account, and the push is far below the accuracy."""
    sim = pressed(20.0, method)
    sim.advance(0.02)
    first = across(sim)
    assert 0.0 < first < 0.2 * sim.scene.accuracy.target
    assert sim.advance(1.5).status.advanced
    assert across(sim) > 0.05
    assert sim.energy_error < 1e-3


def test_it_grows_at_the_rate_of_the_linear_theory():
    """The first mode of a clamped-free column under three times Euler's load: its rate by the Ritz
    method with 12 shapes s^2 P_k(s), P_k the Legendre polynomials of [0, 1]. The powers of s would
    have mass matrices that rounding makes singular."""
    sim = pressed(3.0)
    s = Legendre([0.5, 0.5], domain=[0.0, 1.0])
    shapes = [s * s * Legendre.basis(k, domain=[0.0, 1.0]) for k in range(12)]
    places, weights = np.polynomial.legendre.leggauss(16)
    values = np.array([[f.deriv(k)(0.5 + 0.5 * places) for f in shapes] for k in range(3)])
    inertia, softening, bending = np.einsum("kip,p,kjp->kij", values, 0.5 * weights, values)
    stiffness = 0.02 * bending - 3.0 * EULER * softening
    rate = np.sqrt(-np.linalg.eigvals(np.linalg.solve(0.1 * inertia, stiffness)).real.min())
    sim.advance(1.4)  # until it dominates the other modes, which oscillate
    found = []
    for _ in range(4):
        found.append(across(sim))
        sim.advance(0.2)
    growth = np.diff(np.log(found)) / 0.2
    assert found[-1] < 0.02
    assert growth == pytest.approx(rate, rel=0.01)


def test_a_load_below_a_gripper_that_drops_goes_slack():
    """Dropped by 0.8 m at 2 g for 0.2 s and stopped: the rope cannot push, the load falls freely
    until it is caught with hundreds of newtons. Without the push it stays straight, and pushes with
    18 N, 300,000 times Euler's load."""
    sim = simulator(SLUNG, {"discretization.control_points": 25})
    times = np.linspace(0.0, 0.6, 31)
    fall = np.where(times < 0.2, 10.0 * times**2, 0.8 - 10.0 * np.maximum(0.4 - times, 0.0) ** 2)
    fall = np.where(times < 0.2, fall, np.where(times < 0.4, fall, 0.8))
    poses = np.zeros((31, 7))
    poses[:, 2], poses[:, 6] = 10.0 - fall, 1.0
    found = sim.forecast(Plan(times, {"start": poses}), 0.005)
    assert found.report.status.ok
    slack = (found.times > 0.04) & (found.times < 0.3)
    assert np.median(np.abs(found.tension[slack]).max(axis=1)) < 1.0
    assert found.tension[slack].min() > -10.0
    assert found.tension.max() > 200.0
    # Free fall by 0.708 m until 0.38 s, without what the rope pushes in the first 40 ms.
    z = np.interp(0.38, found.times, found.centerline[:, -1, 2])
    assert z == pytest.approx(5.292, abs=0.1)


def test_a_motion_along_the_line_is_pushed_off_it_too():
    """Both ends held, one pushed towards the other."""
    ends = {"end.fixed": [True] * 3, "loads.names": []}
    values = {key: value for key, value in COLUMN.items() if not key.startswith("loads.")}
    sim = simulator(values, ends)
    move(sim, "end", 0.4, velocity=[0.0, 0.0, -0.5])
    assert sim.advance(0.5).status.ok
    assert np.abs(sim.control_points[:, :2]).max() > 0.1
