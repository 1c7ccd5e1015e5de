"""A cable in water: buoyancy, and drag that is quadratic in the velocity relative to a current."""

import numpy as np
import pytest
from cables import simulator

from dlo_sim.scene.loading import SceneError

LENGTH, DIAMETER, DENSITY, WATER, GRAVITY = 1.0, 0.01, 1400.0, 1000.0, 9.81
SECTION = np.pi * DIAMETER**2 / 4.0
SUBMERGED = (DENSITY - WATER) * SECTION * GRAVITY  # weight in water [N/m]
CABLE = {
    "cable.length": LENGTH,
    "cable.diameter": DIAMETER,
    "cable.density": DENSITY,
    "cable.bending_stiffness": 1e-4,
    "cable.axial_stiffness": 1e4,
    "water.density": WATER,
    "start.fixed": [False] * 3,
    "end.fixed": [False] * 3,
    "initial.shape": "straight",
    "terms.out_of_plane": "on",
    "discretization.control_points": 13,
}
HELD = {"start.fixed": [True] * 3, "end.position": [0.0, 0.0, -1.0]}


def test_a_falling_cable_reaches_the_velocity_at_which_drag_balances_its_weight():
    """Across itself: weight = k v^2; it approaches it as tanh."""
    sim = simulator(CABLE, step=2e-3)
    sim.advance(0.05)
    factor = 0.5 * WATER * 1.2 * DIAMETER
    last = np.sqrt(SUBMERGED / factor)
    rate = SUBMERGED / (DENSITY * SECTION * last)
    expected = last * np.tanh(rate * 0.05)
    np.testing.assert_allclose(sim.velocities[:, 2], -expected, rtol=1e-4)
    sim.advance(2.0)
    np.testing.assert_allclose(sim.velocities[:, 2], -last, rtol=1e-6)


def test_a_cable_sinks_faster_along_itself():
    sim = simulator(CABLE, HELD, {"start.fixed": [False] * 3}, step=2e-3)
    sim.advance(0.5)
    last = np.sqrt(SUBMERGED / (0.5 * WATER * 0.01 * np.pi * DIAMETER))
    rate = SUBMERGED / (DENSITY * SECTION * last)
    np.testing.assert_allclose(sim.velocities[:, 2], -last * np.tanh(rate * 0.5), rtol=1e-4)


def test_a_cable_of_the_density_of_water_rests():
    sim = simulator(CABLE, {"cable.density": WATER}, step=2e-3)
    before = sim.control_points
    sim.advance(1.0)
    np.testing.assert_allclose(sim.control_points, before, atol=1e-12)


@pytest.mark.parametrize("plane", [True, False], ids=["in a plane", "in space"])
def test_a_cable_towed_hangs_straight_at_its_critical_angle(plane):
    """Far from its held end: weight cos a = k V^2 sin^2 a, with the angle a to the current."""
    current = 0.5
    flow = [current, 0.0, 0.0] if plane else [0.3, 0.4, 0.0]
    out = {"terms.out_of_plane": "off" if plane else "on"}
    values = {"water.velocity": flow, "cable.bending_stiffness": 1e-6, "initial.shape": "straight"}
    sim = simulator(CABLE, HELD, values, out, step=5e-3)
    assert len(sim.model.axes) == (2 if plane else 3)
    sim.advance(8.0)
    points = sim.centerline(np.linspace(0.1, 0.9, 9)) - sim.centerline([0.0])
    across = 0.5 * WATER * 1.2 * DIAMETER * current**2
    ratio = SUBMERGED / across
    cosine = (-ratio + np.sqrt(ratio**2 + 4.0)) / 2.0  # ratio cos a = 1 - cos^2 a
    downstream = points @ np.array(flow) / current
    np.testing.assert_allclose(downstream / np.linalg.norm(points, axis=1), cosine, rtol=2e-3)


def test_the_work_of_the_current_is_in_the_account():
    values = {"water.velocity": [0.5, 0.3, 0.0], "integrator.tolerance": 1e-10}
    sim = simulator(CABLE, HELD, values, step=2e-3)
    sim.advance(1.0)
    assert sim.cable.account.exchanged > 1e-3 and sim.energy_error < 1e-8


def test_newton_knows_the_drag():
    """2.9 iterations a step; without the derivative of the drag 8."""
    values = {"water.velocity": [2.0, 1.0, 0.0]}
    sim = simulator(CABLE, HELD, values, step=2e-3)
    assert sim.advance_steps(250).force_evaluations < 3.5 * 250


def test_explicit_methods_refuse_water():
    with pytest.raises(SceneError, match=r"water\.density 1000; use energy_momentum"):
        simulator(CABLE, method="velocity_verlet")


def test_no_water_no_drag():
    values = {"water.density": 0.0, "water.velocity": [1.0, 0.0, 0.0]}
    assert "damping" in simulator(CABLE, values, method="velocity_verlet", step=1e-5).left_out
