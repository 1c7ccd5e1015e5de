"""Reactions: weight at rest, the balance of momenta in motion, twist, springs, end masses."""

import numpy as np
import pytest
from cables import (
    FLAT,
    FULL,
    FULLY_DAMPED,
    MASS_DAMPED,
    MOTIONS,
    SOFT,
    momenta,
    move,
    simulator,
)

from dlo_sim.core import bspline, mass

SPATIAL = {"terms.out_of_plane": "on"}
WEIGHT = np.array([0.0, 0.0, -0.1 * 9.81])  # of the scene SOFT
LOAD = {
    "loads.tip.signal": "constant",
    "loads.tip.force": [0.1, 0.05, -0.2],
    "loads.tip.position": 0.7,
}


def first_moment(sim):
    """Mass times position of the cable with its end masses [kg m], (3,)."""
    weighed = mass.multiply(sim.model.mass(0), sim.control_points[:, :3])
    return weighed.sum(axis=0)


def test_tension_at_rest_is_the_weight_beyond_along_the_tangent():
    """Also where the cable bends from a level clamp: it pulls no more there than elsewhere."""
    values = {"end.position": [1.0, 0.0, 0.0], "end.mass": 0.05, "initial.shape": "equilibrium"}
    values |= {"cable.bending_stiffness": 0.01, "cable.axial_stiffness": 200.0}
    values |= {"discretization.stretch": "span"}
    sim = simulator(SOFT, values, n=25, method="energy_momentum")
    u = sim.greville[1:-1]
    weight = 9.81 * (0.05 + 0.1 * (1.0 - u))
    tangent = np.gradient(sim.centerline(u), u, axis=0)
    down = -tangent[:, 2] / np.linalg.norm(tangent, axis=1)
    assert np.allclose(sim.tension(u)[2:-1], (weight * down)[2:-1], rtol=0, atol=0.05)
    assert sim.curvature(u).max() == pytest.approx(sim.curvature([0.0])[0], rel=0.2)


@pytest.mark.parametrize("planar", [True, False])
def test_a_cantilever_at_rest_is_held_against_its_weight_load_and_their_moments(planar):
    """The moment is about the attachment, which is off the end effector and off the origin."""
    values = {
        "start.position": [0.3, 0.0, 0.1],
        "start.offset": [0.0, 0.0, 0.05],
        "end.position": [2.0, 0.0, 0.1],
        "end.mass": 0.02,
        "initial.shape": "equilibrium",
        "loads.tip.signal": "constant",
        "loads.tip.position": 0.7,
        "loads.tip.force": [0.1, 0.0 if planar else 0.05, -0.2],
        # Out of the plane a moment has a part along the cable, which takes twist to carry.
        "loads.tip.torque": [0.0, 0.03 if planar else 0.0, 0.0],
        "terms.out_of_plane": "off" if planar else "auto",
    }
    sim = simulator(SOFT, values, n=11, method="energy_momentum")
    assert ("out_of_plane" in sim.left_out) == planar
    force, moment = sim.reaction("start")
    load = np.array(values["loads.tip.force"])
    weight = WEIGHT * 1.2
    assert np.allclose(force, -weight - load, rtol=0, atol=1e-8)
    attachment = np.array([0.3, 0.0, 0.15])
    centre = first_moment(sim) / 0.12 - attachment
    lever = sim.centerline([0.7])[0] - attachment
    expected = -np.cross(centre, weight) - np.cross(lever, load) - values["loads.tip.torque"]
    assert np.abs(expected).max() > 0.1
    assert np.allclose(moment, expected, rtol=0, atol=1e-8)
    assert not np.any(sim.reaction("end"))


def test_a_twisted_cable_turns_its_two_clamps_against_each_other():
    """Torque G J phi / L about the cable, equal and opposite at the ends."""
    values = {
        "terms.twist": "bishop",
        "terms.gravity": "off",
        "end.clamped": True,
        "end.fixed": [True, True, True],
    }
    sim = simulator(SOFT, values, n=9)
    sim.set_end("end", orientation=[np.sin(0.2), 0.0, 0.0, np.cos(0.2)])
    points = sim.control_points
    points[:, 3] = 0.4 * sim.greville / sim.scene.cable.length
    sim.start_from(points)
    torque = sim.scene.cable.GJ * 0.4 / sim.scene.cable.length
    for end, sign in (("start", -1.0), ("end", 1.0)):
        force, moment = sim.reaction(end)
        assert np.allclose(moment, [sign * torque, 0.0, 0.0], rtol=0, atol=1e-12)
        assert np.allclose(force, 0.0, rtol=0, atol=1e-12)


def test_a_pinned_end_has_no_moment_and_a_guide_no_force_along_itself():
    pinned = {"start.clamped": False, "end.fixed": [False, True, True]}
    sim = simulator(SOFT, SPATIAL, pinned, n=8, method="velocity_verlet")
    sim.advance(0.2)
    for end in ("start", "end"):
        assert np.abs(sim.reaction(end)[1]).max() < 1e-12
    assert sim.reaction("end")[0][0] == 0.0
    assert abs(sim.reaction("end")[0][2]) > 0.1


def balance(sim, steps, motions):
    """d/dt of both momenta by differences over two steps, and the reactions and state between."""
    for end, motion in motions.items():
        sim.set_motion(end, motion)
    sim.advance_steps(steps)
    before = momenta(sim)
    sim.advance_steps(1)
    now = [sim.reaction(end) for end in ("start", "end")]
    points, rates, inertia, lever = (
        sim.control_points[:, :3],
        sim.velocities[:, :3],
        momenta(sim)[0],
        first_moment(sim),
    )
    sim.advance_steps(1)
    after = momenta(sim)
    if sim.method == "energy_momentum":  # the mean over the last two steps is that between them
        now = [sim.reaction(end) for end in ("start", "end")]
    change = [(b - a) / (2 * sim.step) for a, b in zip(before, after, strict=True)]
    return change, now, points, rates, inertia, lever


@pytest.mark.parametrize("method", ["velocity_verlet", "rk4", "energy_momentum"])
@pytest.mark.parametrize("case", ["undamped", "mass"])
def test_forces_balance_the_change_of_momentum_while_both_ends_move(method, case):
    """Clamp and spring reaction, weight, load and mass damping add up to dP / dt."""
    scene = {"undamped": FULL, "mass": MASS_DAMPED}[case]
    masses = {"start.mass": 0.05, "end.mass": 0.03}
    sim = simulator(scene, LOAD, masses, n=8, method=method, step=1e-5)
    change, now, _, _, inertia, _ = balance(sim, 3000, MOTIONS)
    damped = -sim.scene.damping.mass * inertia
    total = now[0][0] + now[1][0] + WEIGHT * 1.8 + np.array(LOAD["loads.tip.force"]) + damped
    assert np.abs(now[0][0]).max() > 0.5
    assert np.abs(now[1][0]).max() > 0.05
    assert np.abs(change[0] - total).max() < 2e-4 * np.abs(now[0][0]).max()


def test_forces_balance_with_every_damping():
    """Air drag is c times the integral of the velocity; stiffness damping is internal."""
    sim = simulator(FULLY_DAMPED, LOAD, n=8, method="energy_momentum", step=1e-5)
    change, now, _, rates, inertia, _ = balance(sim, 3000, MOTIONS)
    drag = -0.05 * mass.multiply(mass.gram(sim.model.knots), rates).sum(axis=0)
    total = now[0][0] + now[1][0] + WEIGHT + np.array(LOAD["loads.tip.force"])
    total = total - 0.8 * inertia + drag
    assert np.abs(drag).max() > 1e-3
    assert np.abs(change[0] - total).max() < 2e-4 * np.abs(now[0][0]).max()


def test_moments_balance_the_change_of_angular_momentum():
    """About the origin: reaction at the attachment, weight, load; there is no twist here."""
    sim = simulator(SOFT, LOAD, SPATIAL, n=8, method="velocity_verlet", step=1e-5)
    change, now, points, _, _, lever = balance(sim, 3000, {"start": MOTIONS["start"]})
    force, moment = now[0]
    place = bspline.evaluate(points, sim.model.knots, [0.7])[0]
    total = moment + np.cross(points[0], force) + np.cross(lever, [0, 0, -9.81])
    total = total + np.cross(place, LOAD["loads.tip.force"])
    assert np.abs(moment).max() > 0.01
    assert np.abs(change[1] - total).max() < 1e-4 * np.abs(moment).max()


def test_the_reaction_of_a_stiff_cable_does_not_alternate_after_a_jump():
    """A light cable that its gripper begins to drag through air at once; the axial mode, far faster
    than the steps, alternates for long.
    """
    values = {
        "cable.length": 0.3,
        "cable.diameter": 0.004,
        "cable.axial_stiffness": 5000.0,
        "cable.bending_stiffness": 1e-7,
        "damping.stiffness": 0.003,
        "damping.air_drag": 0.3,
        "end.position": [0.3, 0.0, 0.0],
    }
    sim = simulator(FLAT, values, n=9, method="energy_momentum", step=2.5e-3)
    move(sim, "start", 9.0, velocity=[-0.4, 0.0, 0.0])
    sim.advance(1.0)
    drag = -0.3 * 0.4 * 0.3
    for _ in range(4):
        sim.advance_steps(1)
        assert sim.reaction("start")[0][0] == pytest.approx(drag, rel=0.005)


def test_reactions_hold_within_a_motion_and_at_its_borders():
    """No spike where one motion ends and the next begins: the same force from both sides."""
    sim = simulator(SOFT, SPATIAL, n=8, method="velocity_verlet", step=1e-4)
    first = move(sim, "start", 0.05, acceleration=[4.0, 0.0, 8.0])
    sim.advance_steps(499)
    before = sim.reaction("start")[0]
    sim.advance_steps(1)
    at = sim.reaction("start")[0]
    sim.set_motion("start", first.then(0.05, acceleration=first.acceleration))
    next_at = sim.reaction("start")[0]
    sim.advance_steps(1)
    after = sim.reaction("start")[0]
    steady = np.abs(after - before).max()
    assert np.abs(at - before).max() < 2 * steady + 1e-6
    assert np.abs(next_at - at).max() < 1e-9


def test_twisted_cable_asks_for_a_moment_along_itself():
    """A moment of GJ 0.8 rad / L at the free end; the clamp turned by 0.5 rad about the cable."""
    moment = 0.015 * 0.8
    values = {
        "damping.mass": 60.0,
        "loads.tip.signal": "constant",
        "loads.tip.torque": [moment, 0.0, 0.0],
        "terms.twist": "bishop",
    }
    sim = simulator(MASS_DAMPED, FLAT, values, n=6, method="energy_momentum", step=1e-3)
    sim.set_end("start", orientation=[np.sin(0.25), 0.0, 0.0, np.cos(0.25)])
    assert sim.advance(2.0).status.ok
    assert np.allclose(sim.control_points[:, 3], 0.5 + 0.8 * sim.greville, rtol=0, atol=1e-6)
    assert np.allclose(sim.reaction("start")[1], [-moment, 0, 0], rtol=0, atol=1e-7)
    assert np.abs(sim.reaction("start")[0]).max() < 1e-9
    assert not np.any(sim.reaction("end")[1])


def test_end_mass_hangs_and_accelerates_on_the_reaction():
    """A held point mass at the start: M (a - g), with the cable left almost weightless."""
    values = {"start.mass": 2.0, "cable.linear_density": 1e-4, "cable.axial_stiffness": 0.06}
    light = {"cable.bending_stiffness": 2e-5}
    sim = simulator(SOFT, SPATIAL, values, light, n=6, method="velocity_verlet", step=2e-4)
    assert np.allclose(sim.reaction("start")[0], [0, 0, 2.0 * 9.81], atol=2e-3)
    move(sim, "start", 1.0, acceleration=[3.0, 0.0, 4.0])
    sim.advance_steps(10)
    assert np.allclose(sim.reaction("start")[0], [6.0, 0, 2.0 * 13.81], atol=5e-3)
