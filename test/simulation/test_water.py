"""A cable in water: buoyancy, and drag that is quadratic in the velocity relative to a current."""

import numpy as np
import pytest
from cables import Bench, scene_of, simulator, wild
from differences import assert_limit, central
from scipy.integrate import solve_ivp
from scipy.optimize import brentq, root

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


def in_water(depth, radius):
    """Share of a circle of this radius, whose centre is at this depth, below a surface."""
    t = np.clip(depth / radius, -1.0, 1.0)
    return 0.5 + (np.arcsin(t) + t * np.sqrt(1.0 - t * t)) / np.pi


def low_middle(length, gap, weight, lift, level, radius):
    """Height of the middle of a string that hangs between two points at height 0, and the force
    along x: from the middle, x' = H / T, z' = V / T, V' = w - b (share in water), T^2 = H^2 + V^2.
    """

    def far(unknown):
        def rates(_, y):
            pull = np.hypot(unknown[0], y[2])
            wet = in_water(level - y[1], radius)
            return [unknown[0] / pull, y[2] / pull, weight - lift * wet]

        ends = solve_ivp(rates, (0.0, 0.5 * length), [0.0, unknown[1], 0.0], rtol=1e-9, atol=1e-12)
        return ends.y[:2, -1] - [0.5 * gap, 0.0]

    force, height = root(far, [0.2 * weight * length, -0.35 * length]).x
    return height, force


@pytest.mark.parametrize("level", [-0.2, -0.31, -0.6, 0.5])
def test_a_string_hangs_into_the_water(level):
    """Partly, just with its lowest place, not at all, and wholly."""
    values = {"end.position": [0.6, 0.0, 0.0], "end.fixed": [True] * 3, "terms.bend": "off"}
    values |= {"start.fixed": [True] * 3, "initial.shape": "equilibrium", "water.level": level}
    sim = simulator(CABLE, values, {"terms.out_of_plane": "auto"}, n=43)
    weight, lift = DENSITY * SECTION * GRAVITY, WATER * SECTION * GRAVITY
    height, force = low_middle(LENGTH, 0.6, weight, lift, level, 0.5 * DIAMETER)
    assert sim.centerline([0.5])[0, 2] == pytest.approx(height, abs=1e-4)
    assert -sim.reaction("start")[0][0] == pytest.approx(force, rel=1e-3)
    dry = simulator(CABLE, values, {"water.density": 0.0, "water.level": 1e9}, n=43)
    if level == -0.6:
        assert np.abs(sim.control_points - dry.control_points).max() < 1e-12


@pytest.mark.parametrize("density", [200.0, 500.0, 900.0])
def test_a_floating_cable_has_the_draught_of_archimedes(density):
    values = {"cable.density": density, "damping.mass": 20.0, "water.level": 0.003}
    sim = simulator(CABLE, values, step=5e-3)
    sim.advance(5.0)
    depth = brentq(lambda s: in_water(s, 0.5 * DIAMETER) - density / WATER, -0.005, 0.005)
    np.testing.assert_allclose(0.003 - sim.control_points[:, 2], depth, atol=2e-5)


def test_what_falls_into_the_water_keeps_the_energy():
    """Without drag: its end dives in at some 2 m/s, and the cable jumps out again."""
    values = {"cable.density": 500.0, "water.drag": 0.0, "water.drag_along": 0.0}
    values |= {"water.level": -0.1, "end.position": [0.8, 0.0, 0.6]}
    sim = simulator(CABLE, values, {"integrator.tolerance": 1e-10}, step=2e-3)
    lowest = 0.0
    for _ in range(50):
        assert sim.advance(0.02).status.ok
        lowest = min(lowest, sim.control_points[:, 2].min())
    assert lowest < -0.2 and sim.energy_error < 1e-9
    assert sim.control_points[:, 2].max() > 0.0


def test_there_is_no_drag_above_the_water():
    """It falls freely for 0.1 s, then the drag of the water stops it."""
    sim = simulator(CABLE, {"water.level": -0.0541}, step=1e-3)
    sim.advance(0.1)
    np.testing.assert_allclose(sim.velocities[:, 2], -0.1 * GRAVITY, rtol=1e-9)
    sim.advance(0.5)
    last = np.sqrt(SUBMERGED / (0.5 * WATER * 1.2 * DIAMETER))
    np.testing.assert_allclose(sim.velocities[:, 2], -last, rtol=1e-3)


def test_the_stiffness_of_the_surface_is_a_gradient():
    bench = Bench(CABLE, {"water.level": 0.0, "cable.axial_stiffness": 10.0}, n=9)
    points = wild(bench, 1, size=0.003)
    points[:, 2] *= 0.005
    rises = np.abs(points[:, 2] / DIAMETER)
    assert 0.05 < rises.max() < 0.5
    assert_limit(-bench.force(points), bench.potential, points, bound=1e-7)
    found = -central(lambda moved: bench.force(moved)[:, :3], points, 1e-6)[..., :3]
    exact = bench.stiffness(points).reshape(found.shape)
    assert np.abs(found - exact).max() < 1e-6 * np.abs(exact).max()


def test_water_everywhere_is_an_assumption():
    (line,) = scene_of(
        CABLE, {"cable.bending_stiffness": 0.0, "cable.axial_stiffness": 0.0}
    ).assumptions
    assert line == "water.level: not given, so that there is water of 1000 kg/m^3 everywhere"
    assert not any("water" in line for line in scene_of(CABLE, {"water.level": 0.0}).assumptions)


def test_a_cable_that_floats_up_where_water_is_everywhere_is_told():
    """Not one that sinks, and not with a surface."""

    def told(**changes):
        return [one for one in simulator(CABLE | HELD | changes).notes if "floats up" in one]

    light = {"cable.density": 0.8 * WATER}
    (line,) = told(**light)
    assert line.startswith("water.level: not given")
    assert not told()
    assert not told(**light, **{"water.level": 0.0})
