"""Rigid bodies: their forces and Jacobian, and how one tumbles freely."""

import numpy as np
import pytest
from bodies import Body, Loose
from numba import boolean, float64, int64, void

from dlo_sim.compiling.groups import grid
from dlo_sim.compiling.kernels import ARRAY_2D, kernel
from dlo_sim.core import rotations, spectrum
from dlo_sim.engine import rigid_body, tension
from dlo_sim.engine.arrays import BETWEEN, IMPLICIT, cable_at
from dlo_sim.engine.band import clear_band

# Any order of the points; the first director points to the origin.
BODIES = (
    Body((2, 0, 3, 1), (-0.2, 0.1, 0.15), 30.0, center=(0.01, -0.02, 0.03)),
    Body((4, 5, 6, 7), (0.1, 0.12, 0.09), 50.0),
)


@kernel(void, int64, ARRAY_2D, ARRAY_2D, ARRAY_2D, family=IMPLICIT | BETWEEN)
def force_between(address, x0, x1, out):
    rigid_body.force(cable_at(address), grid(x0), grid(x1), grid(out))


@kernel(void, int64, ARRAY_2D, ARRAY_2D, ARRAY_2D, boolean, family=IMPLICIT | BETWEEN)
def tangent_between(address, x0, x1, moved, predicted):
    cable = cable_at(address)
    clear_band(cable.work.band)
    if predicted:
        tension.predict_tension(cable, grid(x0), grid(x1), grid(moved), 1.0)
    else:
        tension.take_tension(cable, grid(x0), grid(x1))
    rigid_body.tangent(cable, grid(x0), grid(x1), 1.0, cable.work.band)


@kernel((float64, float64), int64, ARRAY_2D, ARRAY_2D, ARRAY_2D, family=IMPLICIT | BETWEEN)
def beyond(address, x0, x1, moved):
    return tension.unpredicted(cable_at(address), grid(x0), grid(x1), grid(moved))


def turned(vector):
    return rotations.to_matrix(rotations.from_rotation_vector(vector))


class Between:
    """Two bodies at two configurations, with strains of some per cent."""

    def __init__(self):
        self.loose = Loose(BODIES)
        self.cable, random = self.loose.cable, np.random.default_rng(4)
        ends = []
        for _ in range(2):
            points = np.zeros((8, 4))
            for body in BODIES:
                turn = turned(random.standard_normal(3))
                frame = np.vstack([random.standard_normal(3), turn.T])
                points[list(body.points), :3] = np.linalg.inv(body.weights) @ frame
            ends.append(points + 0.003 * random.standard_normal((8, 4)))
        self.first, self.second = ends

    def padded(self, points):
        return self.cable.padded(self.cable.model.to_lines(points))

    def force(self, first, second):
        out = np.zeros_like(self.padded(first))
        self.cable.call(force_between, self.padded(first), self.padded(second), out)
        return self.cable.shown(out).T[:, :3].copy()

    def energy(self, points):
        self.cable.x[:] = self.cable.model.to_lines(points)
        return self.cable.potentials().sum()

    def tangent(self, moved=None):
        ends = self.padded(self.first), self.padded(self.second)
        step = self.padded(np.zeros((8, 4)) if moved is None else moved)
        self.cable.call(tangent_between, *ends, step, moved is not None)
        lines = self.cable.model.lines
        full = spectrum.dense(self.cable.band, 4 * lines - 1)
        return full.reshape(8, lines, 8, lines)[:, :3, :, :3]


def test_a_step_changes_the_energy_by_the_work_of_the_force_and_turns_nothing():
    both = Between()
    force = both.force(both.first, both.second)
    work = (force * (both.second - both.first)[:, :3]).sum()
    before, after = both.energy(both.first), both.energy(both.second)
    assert after > 0.01
    assert work == pytest.approx(before - after, abs=1e-13 * after)
    middle = 0.5 * (both.first + both.second)[:, :3]
    assert np.abs(force.sum(axis=0)).max() < 1e-12 * np.abs(force).max()
    assert np.abs(np.cross(middle, force).sum(axis=0)).max() < 1e-12 * np.abs(force).max()


def differences(both, size=1e-6):
    """Minus the derivative of the force by the second configuration."""
    exact = np.zeros((8, 3, 8, 3))
    for i, d in np.ndindex(8, 3):
        moved = np.zeros((8, 4))
        moved[i, d] = size
        ahead, behind = (both.force(both.first, both.second + s * moved) for s in (1.0, -1.0))
        exact[:, :, i, d] = -(ahead - behind) / (2.0 * size)
    return exact


def test_the_jacobian_is_that_of_the_force():
    both = Between()
    exact = differences(both)
    assert np.abs(both.tangent() - exact).max() < 1e-8 * np.abs(exact).max()


def test_a_predicted_stress_is_that_of_the_end_of_a_small_correction():
    """In the Jacobian, and to second order in the correction; what is beyond it is its energy."""
    both = Between()
    moved = 1e-4 * np.random.default_rng(2).standard_normal((8, 4))
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


TOP = Body((2, 0, 3, 1), (-0.2, 0.1, 0.15), 1e7, 0.2, (0.02, -0.01, 0.03), (2e-4, 3.5e-4, 5e-4))
SPIN, SPEED = np.array([3.0, 8.0, 1.0]), np.array([0.3, -0.2, 0.1])  # in the body; of its centre


def tumbling(step, tolerance=1e-13, method="energy_momentum"):
    loose = Loose((TOP,), integrator__tolerance=tolerance, method=method, step=step)
    turn = turned(np.array([0.4, -0.7, 0.2]))
    points, rates = np.zeros((8, 4)), np.zeros((8, 4))
    origin = -turn @ np.array(TOP.center)
    spin = turn @ SPIN
    frame = np.vstack([origin, turn.T])
    moving = np.vstack([SPEED + np.cross(spin, origin), np.cross(spin, turn.T)])
    back = np.linalg.inv(TOP.weights)
    points[list(TOP.points), :3], rates[list(TOP.points), :3] = back @ frame, back @ moving
    loose.put(points, rates)
    return loose, turn


def exact_turn(turn, t):
    """Rotation matrix and angular momentum of Euler's equations at time t."""
    from scipy.integrate import solve_ivp

    moments = np.array(TOP.moments)

    def rate(_, y):
        spin = y[9:]
        turning = y[:9].reshape(3, 3) @ np.cross(np.eye(3), spin)
        return np.append(turning.ravel(), np.cross(moments * spin, spin) / moments)

    start = np.append(turn.ravel(), SPIN)
    return solve_ivp(rate, (0.0, t), start, rtol=1e-11, atol=1e-12).y[:9, -1].reshape(3, 3)


def test_a_free_body_keeps_energy_and_momenta_and_follows_eulers_equations():
    errors, exact = [], None
    for step in (1e-2, 5e-3, 2.5e-3):
        loose, turn = tumbling(step)
        exact = exact_turn(turn, 1.0) if exact is None else exact
        energy, momenta = loose.cable.present_energy(), np.array(loose.momenta())
        assert energy > 0.01
        worst = np.zeros(2)
        for _ in range(4):
            loose.advance(round(0.25 / step))
            now = np.array(loose.momenta())
            drift = np.abs(now - momenta).max() / np.abs(momenta).max()
            change = abs(loose.cable.present_energy() / energy - 1.0)
            worst = np.maximum(worst, [change, drift])
        assert worst.max() < 1e-10
        frame = loose.directors()
        centre = frame[0] + np.array(TOP.center) @ frame[1:]
        assert np.abs(centre - SPEED).max() < 1e-9
        assert np.abs(frame[1:] @ frame[1:].T - np.eye(3)).max() < 1e-4
        errors.append(np.abs(frame[1:].T - exact).max())
    assert errors[-1] < 2e-3
    orders = np.log2(np.array(errors[:-1]) / errors[1:])
    assert np.all(np.abs(orders - 2.0) < 0.1), errors


def test_a_stiff_body_costs_as_many_iterations_as_a_soft_one():
    """By the predicted stress; with that of the shape it takes several times as many."""
    counts = []
    for stiffness in (1e3, 1e7):
        top, _ = tumbling(5e-3, 1e-9)
        top.cable.arrays.bodies.stiffness[:] = stiffness
        counts.append(top.advance(40).evaluations)
    assert counts[1] <= 1.5 * counts[0], counts
