"""Explicit methods on a cable: order, stability limit, damping, moved ends, restarts."""

from __future__ import annotations

import numpy as np
import pytest
from cables import move

from dlo_sim.core.methods import IMPLICIT, METHODS
from dlo_sim.scene.description import Scene
from dlo_sim.scene.loading import scene_from_values
from dlo_sim.simulation.report import Status
from dlo_sim.simulation.simulator import Simulator

EXPLICIT = [name for name, method in METHODS.items() if method.family != IMPLICIT]

# A soft strip, clamped at a moving gripper, with a swinging force and moment at its free end.
NONLINEAR = {
    "cable.length": 0.5,
    "cable.diameter": 0.02,
    "cable.youngs_modulus": 1.0e5,
    "discretization.control_points": 6,
    "start.clamped": True,
    "start.fixed": [True, True, True],
    "end.position": [0.5, 0.0, 0.0],
    "loads.names": ["tip"],
    "loads.tip.type": "wrench",
    "loads.tip.signal": "sine",
    "loads.tip.force": [0.0, 0.6, 0.2],
    "loads.tip.torque": [0.0, 0.01, 0.0],
    "loads.tip.frequency": 4.0,
    "terms.twist": "off",
    "terms.out_of_plane": "on",
}
DURATION = 0.08  # [s]


def scene(**values: object) -> Scene:
    return scene_from_values({**NONLINEAR, **{k.replace("__", "."): v for k, v in values.items()}})


def swing(simulator: Simulator) -> None:
    """Move and turn the gripper through the whole run."""
    move(
        simulator,
        "start",
        DURATION,
        velocity=[0.1, -0.2, 0.3],
        acceleration=[2.0, 4.0, -2.0],
        angular_velocity=[0.0, 1.5, 2.0],
        angular_acceleration=[6.0, 0.0, -16.0],
    )


def pulled_wire(method: str, share: float) -> Simulator:
    """A straight wire that rings with a tiny amplitude, at a share of the stability limit."""
    values = {
        "cable.length": 2.0,
        "cable.diameter": 0.002,
        "cable.youngs_modulus": 6.9e10,
        "discretization.control_points": 9,
        "start.fixed": [True, True, True],
        "end.fixed": [False, True, True],
        "end.position": [2.0, 0.0, 0.0],
        "gravity": [0.0, 0.0, 0.0],
        "loads.names": ["tip"],
        "loads.tip.type": "force",
        "loads.tip.signal": "constant",
        "loads.tip.force": [1e-3, 0.0, 0.0],
        "integrator.method": method,
    }
    limit = Simulator(scene_from_values(values)).choice.limit
    at_share = scene_from_values({**values, "integrator.step": share * limit})
    return Simulator(at_share, unchecked_step=True)


@pytest.mark.parametrize("method", EXPLICIT)
def test_stability_limit_of_a_cable(method: str) -> None:
    below = pulled_wire(method, 0.99)
    report = below.advance_steps(20_000)
    assert report.status is Status.OK
    assert below.energy().kinetic > 0.0
    above = pulled_wire(method, 1.01)
    report = above.advance_steps(20_000)
    assert report.status is Status.DIVERGED
    assert np.isfinite(above.control_points).all()


@pytest.mark.parametrize("method", EXPLICIT)
def test_energy_account_closes_with_load_gripper_and_damping(method: str) -> None:
    alpha = 6.0 if METHODS[method].mass_damping else 0.0
    errors = []
    for steps in (400, 800):
        simulator = Simulator(
            scene(
                integrator__method=method,
                integrator__step=DURATION / steps,
                damping__mass=alpha,
            )
        )
        swing(simulator)
        simulator.advance_steps(steps)
        errors.append(simulator.energy_error)
    assert simulator.energy().kinetic > 1e-4
    assert errors[0] < 2e-3
    assert errors[1] < 0.5 * errors[0]


def test_zhai_with_one_half_walks_in_the_steps_of_verlet() -> None:
    tracks = []
    for method in ("velocity_verlet", "zhai"):
        simulator = Simulator(scene(integrator__method=method, integrator__step=DURATION / 800))
        swing(simulator)
        simulator.advance_steps(800)
        tracks.append((simulator.control_points, simulator.velocities))
    moved = np.abs(tracks[0][0]).max()
    assert np.abs(tracks[0][0] - tracks[1][0]).max() < 1e-12 * moved
    assert np.abs(tracks[0][1] - tracks[1][1]).max() > 1e-6  # its velocities are others


def test_force_evaluations_per_step() -> None:
    for method in EXPLICIT:
        simulator = Simulator(scene(integrator__method=method))
        report = simulator.advance_steps(1000)
        per_step = METHODS[method].force_evaluations
        # One more for each of the parts in which a straight cable is looked at until it is bent.
        assert per_step * 1000 <= report.force_evaluations <= per_step * 1000 + 4
