"""The interpreted twin against the compiled step, and its force against the oracle."""

from dataclasses import dataclass

import elasticity
import numpy as np
import pytest
from cables import merged

from dlo_sim.core import bspline, quadrature
from dlo_sim.core.methods import METHODS, RUNGE_KUTTA, SPLITTING, ZHAI, Method
from dlo_sim.scene.loading import load_scene
from dlo_sim.simulation.simulator import Simulator
from dlo_sim.studies.paper.interpreted import Wire

METHODS_OF_THE_PAPER = ["forest_ruth", "rk4", "velocity_verlet", "zhai"]


@dataclass
class State:
    """Positions, velocities and accelerations: of the step before (Zhai), and while known now."""

    position: np.ndarray
    velocity: np.ndarray
    before: np.ndarray | None = None
    now: np.ndarray | None = None


def steps_of(wire, method, tau, steps) -> State:
    """The state after a number of steps from the start, by the textbook's formulas."""
    state = State(wire.start(), np.zeros_like(wire.start()))
    step = {SPLITTING: _splitting, RUNGE_KUTTA: _runge_kutta, ZHAI: _zhai}[METHODS[method].family]
    for number in range(steps):
        step(wire, state, METHODS[method], number * tau, tau)
    return state


def _splitting(wire, state, method: Method, t, tau) -> None:
    for drift, kick in zip(method.drift_weights, method.kick_weights, strict=True):
        t += drift * tau
        if drift:
            state.position += drift * tau * state.velocity
            state.now = None
        if kick:
            if state.now is None:
                state.now = wire.acceleration(state.position, t)
            state.velocity += kick * tau * state.now


def _runge_kutta(wire, state, method: Method, t, tau) -> None:
    slopes = []
    for row in method.stage_matrix:
        x, v = state.position.copy(), state.velocity.copy()
        for weight, (rate, acceleration) in zip(row, slopes, strict=True):
            x += weight * tau * rate
            v += weight * tau * acceleration
        slopes.append((v, wire.acceleration(x, t + sum(row) * tau)))
    for weight, (rate, acceleration) in zip(method.stage_weights, slopes, strict=True):
        state.position += weight * tau * rate
        state.velocity += weight * tau * acceleration


def _zhai(wire, state, method: Method, t, tau) -> None:
    now = wire.acceleration(state.position, t)
    before = now if state.before is None else state.before
    state.position += tau * state.velocity + tau * tau * (now - 0.5 * before)
    state.velocity += tau * (1.5 * now - 0.5 * before)
    state.before = now


def scene(**values):
    return load_scene("paper_wire_force", merged(**values))


@pytest.mark.parametrize("method", METHODS_OF_THE_PAPER)
def test_interpreted_is_compiled(method):
    force = [0.2, 5.0, -3.0]
    one = scene(integrator__method=method, loads__centre__force=force)
    simulator = Simulator(one)
    simulator.advance_steps(400)
    state = steps_of(Wire(one), method, simulator.step, 400)
    assert np.abs(simulator.control_points[:, 1]).max() > 1e-4
    assert np.abs(state.position - simulator.control_points[:, :3]).max() < 1e-12
    if method != "zhai":
        apart = np.abs(state.velocity - simulator.velocities[:, :3]).max(axis=0)
        # Along the wire its axial stiffness amplifies round-off a thousandfold.
        assert np.all(apart < [1e-8, 1e-11, 1e-11])


def test_evaluations_per_step_are_those_of_the_method():
    wire = Wire(scene())
    count = 0
    original = wire.acceleration

    def counted(x, t):
        nonlocal count
        count += 1
        return original(x, t)

    wire.acceleration = counted
    for method in METHODS_OF_THE_PAPER:
        count = 0
        steps_of(wire, method, 1e-5, 20)
        assert METHODS[method].force_evaluations * 20 <= count
        assert count <= METHODS[method].force_evaluations * 20 + 1


def test_force_is_that_of_the_oracle():
    one = scene()
    wire = Wire(one)
    x = wire.start() + 0.02 * np.random.default_rng(0).normal(size=(9, 3))
    rule = quadrature.uniform(bspline.breaks(wire.knots), one.discretization.samples)
    section = elasticity.Section(one.cable.EA, one.cable.EI)
    points = np.concatenate((x, np.zeros((9, 1))), axis=1)
    there = elasticity.gradient(points, wire.knots, rule, section)[:, :3]
    here = wire.gradient(x)
    assert np.abs(here).max() > 1.0
    assert np.abs(here - there).max() < 1e-11 * np.abs(here).max()
    assert (wire.acceleration(x, 0.3)[0, 1:] == 0.0).all()
