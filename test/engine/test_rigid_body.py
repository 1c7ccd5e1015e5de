"""Rigid bodies: their forces and Jacobian, and how one tumbles freely."""

import numpy as np
import pytest
from nets import STRING, WEIGHTLESS, momenta, net
from numba import float64, int64, void
from scipy.integrate import solve_ivp

from dlo_sim.compiling.groups import grid
from dlo_sim.compiling.kernels import ARRAY, ARRAY_2D, kernel
from dlo_sim.core import mass, rotations, spectrum
from dlo_sim.engine import rigid_body
from dlo_sim.engine.arrays import BETWEEN, ENERGIES, IMPLICIT, cable_at
from dlo_sim.engine.band import clear_band


@kernel(void, int64, ARRAY_2D, ARRAY_2D, ARRAY_2D, family=IMPLICIT | BETWEEN)
def force_between(address, x0, x1, out):
    rigid_body.force(cable_at(address), grid(x0), grid(x1), grid(out))


@kernel(void, int64, ARRAY_2D, ARRAY, family=IMPLICIT | BETWEEN)
def energy_at(address, x, out):
    rigid_body.energy(cable_at(address), grid(x), grid(out))


@kernel(void, int64, ARRAY_2D, ARRAY_2D, ARRAY_2D, family=IMPLICIT | BETWEEN)
def tangent_between(address, x0, x1, moved):
    cable = cable_at(address)
    clear_band(cable.work.band)
    rigid_body.predict(cable, grid(x0), grid(x1), grid(moved))
    rigid_body.tangent(cable, grid(x0), grid(x1), 1.0, cable.work.band)


@kernel((float64, float64), int64, ARRAY_2D, ARRAY_2D, ARRAY_2D, family=IMPLICIT | BETWEEN)
def beyond(address, x0, x1, moved):
    return rigid_body.unpredicted(cable_at(address), grid(x0), grid(x1), grid(moved))


def connector(name, **values):
    return {"connectors.names": [name]} | {f"connectors.{name}.{k}": v for k, v in values.items()}


class Between:
    """A body that shares points of its cable and one that does not, at two configurations with
    strains of some per cent; the first director of the one points to its origin."""

    def __init__(self):
        given = {"mass": 0.1, "inertia": [2e-4, 3e-4, 4e-4]}
        bodies = connector("far", **given) | connector("amid", **given, at=0.5)
        sim = net(bodies, {"connectors.names": ["far", "amid"], "terms.out_of_plane": "on"})
        self.cable, self.n = sim.cable, sim.model.n
        assert [body.alone for body in sim.model.bodies] == [False, True]
        self.cable.arrays.bodies.stiffness[:] = 30.0, 50.0
        random = np.random.default_rng(4)
        self.first, self.second = random.standard_normal((2, self.n, 4))
        for points in (self.first, self.second):
            for body in sim.model.bodies:
                turn, origin = turned(random.standard_normal(3)), points[body.points[0], :3]
                ends = origin + body.length * np.array(body.signs)[:, None] * turn.T
                ends += 0.03 * body.length * random.standard_normal((3, 3))
                points[body.points[1:], :3] = ends

    def padded(self, points):
        return self.cable.padded(self.cable.model.to_lines(points))

    def force(self, first, second):
        out = self.padded(np.zeros((self.n, 4)))
        self.cable.call(force_between, self.padded(first), self.padded(second), out)
        return self.cable.shown(out).T[:, :3].copy()

    def energy(self, points):
        out = np.zeros(len(ENERGIES))
        self.cable.call(energy_at, self.padded(points), out)
        return out.sum()

    def tangent(self, moved=0.0):
        step = self.padded(moved + np.zeros((self.n, 4)))
        ends = self.padded(self.first), self.padded(self.second)
        self.cable.call(tangent_between, *ends, step)
        lines = self.cable.model.lines
        full = spectrum.dense(self.cable.band, 4 * lines - 1)
        return full.reshape(self.n, lines, self.n, lines)[:, :3, :, :3]


def turned(vector):
    return rotations.to_matrix(rotations.from_rotation_vector(vector))


def test_a_step_changes_the_energy_by_the_work_of_the_force_and_turns_nothing():
    both = Between()
    force = both.force(both.first, both.second)
    work = (force * (both.second - both.first)[:, :3]).sum()
    before, after = both.energy(both.first), both.energy(both.second)
    assert after > 0.01
    assert work == pytest.approx(before - after, abs=1e-13 * np.abs(force).max())
    middle = 0.5 * (both.first + both.second)[:, :3]
    assert np.abs(force.sum(axis=0)).max() < 1e-12 * np.abs(force).max()
    assert np.abs(np.cross(middle, force).sum(axis=0)).max() < 1e-12 * np.abs(force).max()


def test_the_jacobian_is_that_of_the_force():
    both, size = Between(), 1e-6
    exact = np.zeros((both.n, 3, both.n, 3))
    for i, d in np.ndindex(both.n, 3):
        moved = np.zeros((both.n, 4))
        moved[i, d] = size
        ahead, behind = (both.force(both.first, both.second + s * moved) for s in (1.0, -1.0))
        exact[:, :, i, d] = -(ahead - behind) / (2.0 * size)
    assert np.abs(both.tangent() - exact).max() < 1e-8 * np.abs(exact).max()


def test_a_predicted_stress_is_that_of_the_end_of_a_small_correction():
    """In the Jacobian, and to second order in the correction; what is beyond it is its energy."""
    both = Between()
    moved = 2e-5 * np.random.default_rng(2).standard_normal((both.n, 4))
    both.tangent(moved)
    stress = both.cable.arrays.state.stress.copy()
    before, both.second = both.second, both.second + moved
    both.tangent()
    assert np.abs(stress - both.cable.arrays.state.stress).max() < 1e-5
    both.second = before
    both.tangent(moved)
    ends = both.padded(both.first), both.padded(before + moved), both.padded(moved)
    energy, work = both.cable.call(beyond, *ends)
    assert 0.0 < energy < 1e-9 and abs(work) < 1e-6


MOMENTS = np.array([2e-4, 3.5e-4, 5e-4])
TURN = turned(np.array([0.4, -0.7, 0.2]))
SPIN, SPEED = np.array([3.0, 8.0, 1.0]), np.array([0.3, -0.2, 0.1])  # in the body; of the centre


def tumbling(step, tolerance=1e-13, stiffness=1e7):
    """A body on a free cable of a millionth of its mass."""
    top = connector("top", mass=0.2, inertia=MOMENTS.tolist(), joint="hinged")
    top |= {"connectors.top.center": [0.02, -0.01, 0.03], "start.fixed": [False] * 3}
    light = {"cable.length": 0.02, "cable.linear_density": 1e-5, "end.position": [0.02, 0.0, 0.0]}
    light |= {"cable.diameter": 1e-3, "cable.axial_stiffness": 1.0}
    numbers = {"integrator.step": step, "integrator.tolerance": tolerance}
    numbers |= {"discretization.control_points": 5, "terms.out_of_plane": "on"}
    sim = net(STRING, WEIGHTLESS, top, light, numbers)
    sim.cable.arrays.bodies.stiffness[:] = stiffness
    points, rates = sim.cable.points, np.zeros_like(sim.cable.points)
    points[:, :3] = (points[:, :3] - centre(sim)) @ TURN.T
    rates[:, :3] = SPEED + np.cross(TURN @ SPIN, points[:, :3])
    sim.begin(points, rates)
    return sim


def centre(sim):
    """Centre of mass [m] of everything."""
    masses = mass.multiply(sim.model.mass(0), np.ones(sim.model.n))
    return masses @ sim.cable.points[:, :3] / masses.sum()


def exact_turn(t):
    """Rotation matrix by Euler's equations at time t."""

    def rate(_, y):
        spin = y[9:]
        turning = y[:9].reshape(3, 3) @ np.cross(np.eye(3), spin)
        return np.append(turning.ravel(), np.cross(MOMENTS * spin, spin) / MOMENTS)

    start = np.append(TURN.ravel(), SPIN)
    return solve_ivp(rate, (0.0, t), start, rtol=1e-11, atol=1e-12).y[:9, -1].reshape(3, 3)


def test_a_free_body_keeps_energy_and_momenta_and_follows_eulers_equations():
    errors, exact = [], exact_turn(1.0)
    for step in (1e-2, 5e-3, 2.5e-3):
        sim = tumbling(step)
        (body,), before = sim.model.bodies, np.array(momenta(sim))
        for _ in range(4):
            assert sim.advance(0.25).status.ok
            now = np.array(momenta(sim))
            assert np.abs(now - before).max() < 1e-10 * np.abs(before).max()
        assert sim.cable.kinetic() > 0.01 and sim.energy_error < 1e-10
        assert np.abs(centre(sim) - SPEED).max() < 1e-9
        points = sim.cable.points[body.points, :3]
        e = (points[1:] - points[0]) / body.length
        assert np.abs(e @ e.T - np.eye(3)).max() < 1e-4
        errors.append(np.abs(e.T - exact).max())
    assert errors[-1] < 2e-3
    orders = np.log2(np.array(errors[:-1]) / errors[1:])
    assert np.all(np.abs(orders - 2.0) < 0.1), errors


def test_a_stiff_body_costs_as_many_iterations_as_a_soft_one():
    """By the predicted stress; with that of the shape it takes several times as many."""
    counts = []
    for stiffness in (1e3, 1e7):
        sim = tumbling(5e-3, 1e-9, stiffness)
        counts.append(sim.advance_steps(40).force_evaluations)
    assert counts[1] <= 1.5 * counts[0], counts
