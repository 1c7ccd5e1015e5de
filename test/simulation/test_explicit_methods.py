"""Explicit methods on a cable: order, stability limit, damping, moved ends, restarts."""

from __future__ import annotations

from functools import cache

import numpy as np
import pytest
from cables import ELASTIC

from dlo_sim.core.end_motion import EndMotion
from dlo_sim.core.methods import IMPLICIT
from dlo_sim.scene.description import Scene
from dlo_sim.scene.loading import SceneError, scene_from_values
from dlo_sim.simulation.report import Status
from dlo_sim.simulation.simulator import Simulator

EXPLICIT = [name for name, method in ELASTIC.items() if method.family != IMPLICIT]

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
    simulator.set_motion(
        "start",
        EndMotion(
            start=0.0,
            duration=DURATION,
            position=[0.0, 0.0, 0.0],
            orientation=[0.0, 0.0, 0.0, 1.0],
            velocity=[0.1, -0.2, 0.3],
            acceleration=[2.0, 4.0, -2.0],
            angular_velocity=[0.0, 1.5, 2.0],
            angular_acceleration=[6.0, 0.0, -16.0],
        ),
    )


def end_state(method: str, steps: int, alpha: float = 0.0) -> np.ndarray:
    simulator = Simulator(
        scene(integrator__method=method, integrator__step=DURATION / steps, damping__mass=alpha)
    )
    swing(simulator)
    report = simulator.advance_steps(steps)
    assert report.status is Status.OK
    return simulator.control_points[:, :3]


@cache
def reference(method: str, alpha: float) -> np.ndarray:
    """The same motion at a much finer step, by another method of order four."""
    return end_state("forest_ruth" if method == "rk4" and not alpha else "rk4", 6400, alpha)


@pytest.mark.parametrize(
    ("method", "alpha"),
    [
        (name, alpha)
        for name in EXPLICIT
        for alpha in (0.0, 6.0)
        if ELASTIC[name].mass_damping or not alpha
    ],
)
def test_order_with_moved_end_load_and_damping(method: str, alpha: float) -> None:
    steps = (400, 566, 800, 1131) if ELASTIC[method].order == 4 else (400, 800, 1600, 3200)
    errors = np.array(
        [np.abs(end_state(method, n, alpha) - reference(method, alpha)).max() for n in steps]
    )
    slopes = -np.diff(np.log(errors)) / np.diff(np.log(steps))
    assert np.abs(slopes - ELASTIC[method].order).max() < 0.2
    assert errors[0] < {2: 1e-6, 4: 4e-9}[ELASTIC[method].order]  # [m], of a motion of some 5 cm


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
def test_a_step_beyond_the_limit_is_refused(method: str) -> None:
    limit = Simulator(scene(integrator__method=method)).choice.limit
    with pytest.raises(SceneError, match="integrator.step"):
        Simulator(scene(integrator__method=method, integrator__step=1.01 * limit))


@pytest.mark.parametrize("method", EXPLICIT)
def test_pieces_and_snapshots_give_the_same_bits(method: str) -> None:
    def simulator() -> Simulator:
        simulator = Simulator(scene(integrator__method=method, integrator__step=DURATION / 800))
        swing(simulator)
        return simulator

    whole, pieces = simulator(), simulator()
    whole.advance_steps(157)
    saved = None
    for count in (1, 15, 1, 40, 100):
        if count == 40:
            saved = pieces.snapshot()
        pieces.advance_steps(count)
    assert saved is not None
    assert np.array_equal(whole.control_points, pieces.control_points)
    assert np.array_equal(whole.velocities, pieces.velocities)
    assert whole.energy_error == pieces.energy_error
    pieces.restore(saved)
    pieces.advance_steps(140)
    assert np.array_equal(whole.control_points, pieces.control_points)
    pieces.reset()
    swing(pieces)
    pieces.advance_steps(157)
    assert np.array_equal(whole.control_points, pieces.control_points)


@pytest.mark.parametrize("method", EXPLICIT)
def test_energy_account_closes_with_load_gripper_and_damping(method: str) -> None:
    alpha = 6.0 if ELASTIC[method].mass_damping else 0.0
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
        per_step = ELASTIC[method].force_evaluations
        # One more for each of the parts in which a straight cable is looked at until it is bent.
        assert per_step * 1000 <= report.force_evaluations <= per_step * 1000 + 4
