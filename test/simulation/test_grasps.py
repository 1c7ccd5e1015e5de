"""Grasps between the ends: held points, forces, energy, taking and releasing."""

from dataclasses import replace

import numpy as np
import pytest
from cables import SOFT, simulator

from dlo_sim.core import rotations
from dlo_sim.core.end_motion import EndMotion
from dlo_sim.scene.refusal import SceneError

HELD = {
    "start.clamped": False,
    "end.position": [0.3, 0.0, 0.05],
    "end.fixed": [True, True, True],
    "end.spring": [0.0, 0.0, 0.0],
    "terms.out_of_plane": "on",
    "initial.shape": "equilibrium",
    "grasps.names": ["hand"],
    "grasps.hand.at": 0.4,
    "grasps.hand.position": [0.12, 0.05, -0.02],
    "loads.names": [],
}
CABLE = SOFT | HELD
TURN = EndMotion.resting([0.12, 0.05, -0.02]).then(
    0.2,
    velocity=[0.1, 0.1, 0.2],
    acceleration=[0.2, -0.4, 0.2],
    angular_velocity=[0.3, 0.5, 1.0],
    angular_acceleration=[0.4, 0.0, -0.8],
)


def held(method="energy_momentum", **more):
    values = {"integrator.method": method, "integrator.step": 2e-3}
    return simulator(CABLE, values, more)


def at(sim, share):
    return sim.centerline([share * sim.scene.cable.length])[0]


def weight(sim):
    return sim.scene.cable.mu * sim.scene.cable.length * np.array(sim.scene.gravity)


@pytest.mark.parametrize("clamped", [False, True], ids=["position", "direction"])
def test_reactions_of_a_resting_cable_balance_its_weight(clamped):
    sim = held(**{"grasps.hand.clamped": clamped, "grasps.hand.tangent": [0.8, 0.6, 0.0]})
    assert at(sim, 0.4) == pytest.approx([0.12, 0.05, -0.02], abs=1e-12)
    forces = sum(sim.reaction(name)[0] for name in ("start", "hand", "end"))
    assert forces == pytest.approx(-weight(sim), abs=1e-8)
    assert np.linalg.norm(sim.reaction("hand")[0]) > 0.1 * np.linalg.norm(weight(sim))
    sim.advance(0.1)
    assert at(sim, 0.4) == pytest.approx([0.12, 0.05, -0.02], abs=1e-12)
    assert np.abs(sim.velocities).max() < 1e-6


@pytest.mark.parametrize("share, place", [(0.03, [0.029, 0, 0.002]), (0.97, [0.271, 0, 0.043])])
@pytest.mark.parametrize("method", ["energy_momentum", "implicit_midpoint"])
def test_reactions_balance_where_a_grasp_is_beside_a_clamp(method, share, place):
    """The force of the grasp also pushes the control points that the clamp holds."""
    ends = {"start.clamped": True, "end.clamped": True, "damping.mass": 20.0}
    sim = held(method, **ends, **{"grasps.hand.at": share, "grasps.hand.position": place})
    sim.advance(0.1)
    forces = sum(sim.reaction(name)[0] for name in ("start", "hand", "end"))
    assert forces == pytest.approx(-weight(sim), abs=2e-3 * np.linalg.norm(weight(sim)))


def test_a_place_that_is_held_already_is_not_taken():
    sim = held(**{"grasps.names": ["hand", "other"], "grasps.other.taken": False})
    for grasp, at in (("other", 0.0), ("other", 1.0), ("other", 0.4)):
        before = sim.cable.state.copy()
        with pytest.raises(ValueError, match="^grasps.other.at: the cable is held at .* already"):
            sim.take(grasp, at)
        assert np.array_equal(sim.cable.state, before)
        assert sim.advance_steps(1).status.ok
    sim.take("other", 0.41)
    assert sim.advance(0.02).status.ok
    with pytest.raises(SceneError, match="^grasps.hand.at: the cable is held at 0 m already"):
        held(**{"grasps.hand.at": 0.0})


def test_a_shorter_cable_is_held_at_the_same_share():
    sim = held()
    other = sim.reconfigured(sim.scene.with_values({"cable.length": 0.8}))
    assert at(other, 0.4) == pytest.approx([0.12, 0.05, -0.02], abs=1e-9)
    assert np.isfinite(other.control_points).all() and other.advance(0.05).status.ok


def test_a_cable_that_hangs_from_its_middle_alone_finds_its_rest():
    free = {"start.fixed": [False] * 3, "end.fixed": [False] * 3}
    middle = {"grasps.hand.at": 0.5, "grasps.hand.clamped": True}
    middle["grasps.hand.tangent"] = [1.0, 0.0, 0.0]
    sim = held(**free, **middle)
    arms = sim.centerline(np.array([0.0, 1.0]) * sim.scene.cable.length) - at(sim, 0.5)
    assert arms[0] * [-1.0, 1.0, 1.0] == pytest.approx(arms[1], abs=1e-7)
    assert arms[0][2] < -1e-3
    assert sim.reaction("hand")[0] == pytest.approx(-weight(sim), abs=1e-9)


@pytest.mark.parametrize("clamped", [False, True], ids=["position", "direction"])
def test_a_gripper_that_moves_and_turns_carries_the_cable_along(clamped):
    sim = held(**{"grasps.hand.clamped": clamped, "grasps.hand.offset": [0.0, 0.01, 0.0]})
    start, axis = at(sim, 0.4), tangent(sim)
    sim.set_motion("hand", TURN)
    assert sim.advance(0.1).status.ok
    place, turn = TURN.position_at(sim.time), rotations.to_matrix(TURN.orientation_at(sim.time))
    assert at(sim, 0.4) == pytest.approx(place + turn @ [0.0, 0.01, 0.0], abs=1e-10)
    assert np.linalg.norm(at(sim, 0.4) - start) > 0.01
    if clamped:
        assert tangent(sim) == pytest.approx(turn @ axis, abs=1e-9)
    assert sim.energy_error < 1e-9


def test_taking_and_releasing_moves_nothing_and_keeps_the_account():
    sim = held()
    sim.advance(0.02)
    before = sim.control_points
    sim.release("hand")
    assert np.array_equal(sim.control_points, before)
    assert sim.reaction("hand")[0] == pytest.approx([0.0, 0.0, 0.0], abs=0.0)
    assert sim.advance(0.05).status.ok
    assert np.linalg.norm(at(sim, 0.4) - [0.12, 0.05, -0.02]) > 1e-3
    before = sim.control_points
    sim.take("hand", 0.7)
    assert np.array_equal(sim.control_points, before)
    place = at(sim, 0.7)
    assert sim.advance(0.05).status.ok
    assert at(sim, 0.7) == pytest.approx(place, abs=1e-10)
    assert sim.energy_error < 1e-9


def test_a_grasp_that_stops_the_cable_books_what_it_takes():
    sim = held()
    sim.release("hand")
    sim.advance(0.05)
    kinetic = sim.energy().kinetic
    sim.take("hand")
    assert sim.energy().kinetic < 0.9 * kinetic
    assert sim.energy_error < 1e-9


def test_the_nearest_point_is_taken():
    sim = held(**{"grasps.hand.at": -1.0, "grasps.hand.taken": False})
    line = np.linspace(0.0, sim.scene.cable.length, 4001)
    sim.set_end("hand", position=[0.2, 0.03, -0.1])
    nearest = sim.centerline(line)
    nearest = nearest[np.argmin(np.linalg.norm(nearest - [0.2, 0.03, -0.1], axis=1))]
    sim.take("hand")
    sim.set_end("hand", position=[0.2, 0.03, -0.09])
    sim.advance_steps(1)
    moved = sim.centerline(line)
    assert np.abs(moved - nearest - [0.0, 0.0, 0.01]).sum(axis=1).min() < 1e-3


def test_a_spring_pulls_towards_its_gripper():
    soft = {"grasps.hand.fixed": [False] * 3, "grasps.hand.spring": [2.0, 3.0, 4.0]}
    sim = held(**soft)
    away = np.array([0.12, 0.05, -0.02]) - at(sim, 0.4)
    assert sim.reaction("hand")[0] == pytest.approx(away * [2.0, 3.0, 4.0], rel=1e-6)
    assert np.linalg.norm(away) > 1e-4


def test_a_spring_alone_may_hold_the_cable():
    """By which it hangs in the end: weight = stiffness times what it gives."""
    free = {"end.fixed": [False] * 3, "start.fixed": [False] * 3, "start.spring": [0.0] * 3}
    soft = {"grasps.hand.fixed": [False] * 3, "grasps.hand.spring": [50.0] * 3}
    sim = held(**free, **soft, **{"damping.mass": 20.0, "initial.shape": "straight"})
    sim.advance(2.0)
    cable = sim.scene.cable
    assert sim.reaction("hand")[0][2] == pytest.approx(
        9.81 * cable.mu * cable.length, rel=0.05
    )  # it still sways


def test_snapshots_and_reconfiguration_keep_what_is_held():
    sim = held()
    saved = sim.snapshot()
    sim.release("hand")
    sim.advance(0.05)
    sim.restore(saved)
    sim.advance(0.05)
    assert at(sim, 0.4) == pytest.approx([0.12, 0.05, -0.02], abs=1e-10)
    sim.release("hand")
    sim.take("hand", 0.7)
    place = at(sim, 0.7)
    other = sim.reconfigured(sim.scene.with_values({"damping.mass": 3.0}))
    other.advance(0.05)
    assert at(other, 0.7) == pytest.approx(place, abs=1e-9)
    free = other.reconfigured(other.scene.with_values({"grasps.hand.taken": False}))
    free.advance(0.05)
    assert np.linalg.norm(at(free, 0.7) - place) > 1e-3
    again = free.reconfigured(other.scene)
    place = at(again, 0.4)
    again.advance(0.05)
    assert at(again, 0.4) == pytest.approx(place, abs=1e-9)


@pytest.mark.parametrize(
    ("calls", "text"),
    [
        ([("take", "hand")], "grasp 'hand': holds the cable already"),
        ([("take", "foot")], "grasp: 'foot' is not known; give one of hand"),
        ([("release", "hand")] * 2, "grasp 'hand': does not hold the cable"),
        ([("release", "hand"), ("take", "hand", 1.5)], "at: needs a number from 0 to 1"),
    ],
)
def test_impossible_grasps_are_refused(calls, text):
    sim = held()
    with pytest.raises(ValueError, match=f"^{text}"):
        for name, *arguments in calls:
            getattr(sim, name)(*arguments)


def tangent(sim):
    length = sim.scene.cable.length
    edge = np.diff(sim.centerline([0.4 * length - 1e-6, 0.4 * length + 1e-6]), axis=0)[0]
    return edge / np.linalg.norm(edge)


SOFTLY = {
    "grasps.hand.tangent_spring": 0.03,
    "grasps.hand.tangent": [0.8, 0.6, 0.0],
    "grasps.hand.position": [0.3, 0.05, -0.1],
    "end.position": [0.75, 0.0, 0.05],
}


def torque_about_origin(sim, names):
    """Of the reactions, about the world's origin [N m]."""
    total = np.zeros(3)
    for name in names:
        force, moment = sim.reaction(name)
        place = at(sim, {"start": 0.0, "hand": 0.4, "end": 1.0}[name])
        total += moment + np.cross(place, force)
    return total


def torque_of_weight(sim):
    u = (np.arange(4000) + 0.5) / 4000 * sim.scene.cable.length
    return np.cross(sim.centerline(u).mean(axis=0), weight(sim))


@pytest.mark.parametrize("end", ["start", "end"])
def test_a_soft_clamp_adds_its_turn_to_a_cantilever(end):
    """Sag of the tip P L^3 / (3 EI) + P L^2 / k, of a force so small that it is linear."""
    free = "end" if end == "start" else "start"
    push, k = 1e-5, 0.05
    values = {
        f"{end}.tangent_spring": k,
        f"{end}.fixed": [True] * 3,
        f"{free}.fixed": [False] * 3,
        "end.position": [1.0, 0.0, 0.0],
        "initial.shape": "equilibrium",
        "gravity": [0.0, 0.0, 0.0],
        "loads.names": ["tip"],
        "loads.tip.signal": "constant",
        "loads.tip.position": 1.0 if free == "end" else 0.0,
        "loads.tip.force": [0.0, 0.0, push],
        "discretization.control_points": 17,
    }
    sim = simulator({**SOFT, "start.clamped": False, "terms.out_of_plane": "on"}, values)
    sag = at(sim, 1.0 if free == "end" else 0.0)[2]
    assert sag == pytest.approx(push / (3.0 * sim.scene.cable.EI) + push / k, rel=1e-3)
    sign = 1.0 if free == "end" else -1.0
    assert sim.reaction(end)[1] == pytest.approx([0.0, sign * push, 0.0], rel=1e-3, abs=1e-9)


def test_reactions_balance_force_and_moment_where_a_spring_holds_the_direction():
    sim = held(**SOFTLY)
    names = ("start", "hand", "end")
    assert torque_about_origin(sim, names) == pytest.approx(-torque_of_weight(sim), abs=1e-6)
    sine = np.cross(tangent(sim), [0.8, 0.6, 0.0])
    assert sim.reaction("hand")[1] == pytest.approx(0.03 * sine, abs=0.01 * 0.03)
    assert np.linalg.norm(sine) > 0.9


def test_a_gripper_that_turns_the_cable_through_a_spring_books_its_work():
    sim = held(**SOFTLY)
    begin = replace(TURN, position=SOFTLY["grasps.hand.position"])
    sim.set_motion("hand", begin)
    before = sim.energy().spring
    assert sim.advance(0.1).status.ok
    assert abs(sim.energy().spring - before) > 1e-4
    aim = rotations.to_matrix(TURN.orientation_at(sim.time)) @ SOFTLY["grasps.hand.tangent"]
    assert sim.cable.anchors[:3] == pytest.approx(aim, abs=1e-9)
    assert sim.energy_error < 1e-9


def test_a_spring_takes_the_direction_that_it_finds_and_releases_it():
    sim = held(**SOFTLY)
    before = sim.energy().spring
    sim.release("hand")
    sim.advance(0.02)
    assert sim.energy().spring == 0.0
    sim.take("hand", 0.6)
    assert sim.energy().spring < 2e-3 * before  # the cable is stretched a little there
    assert sim.advance(0.05).status.ok
    assert sim.energy_error < 1e-9
