"""Messages that let a grasp take and release the cable."""

import numpy as np
import pytest
from session_bench import MS, SECOND, T0, feed, poses
from test_saved_state import VALUES, swinging

from dlo_sim.core import bspline
from dlo_sim.scene.loading import scene_from_values
from dlo_sim.session import cdr
from dlo_sim.session.session import Session

HAND = {
    **VALUES,
    "inputs.latency": 0.05,
    "grasps.names": ["hand"],
    "grasps.hand.at": 0.7,
    "grasps.hand.taken": False,
    "grasps.hand.taken_topic": "/closed",
    "grasps.hand.position": [0.25, 0.0, 0.1],
}
YES, NO = b"\x00\x01\x00\x00\x01", b"\x00\x00\x00\x00\x00\x00\x00\x00"


def play(session, end_ns, told=(), phase=0):
    """A gripper that swings at 100 Hz, Bools (arrival, bytes); states by their stamps."""
    messages = [(arrival, "/closed", raw) for arrival, raw in told]
    messages += poses("/pose", swinging, T0, end_ns)
    states = {}
    for _ in feed(session, messages, T0 + phase, end_ns):
        if session.started:
            states[session.stamp_ns] = session.simulator.control_points
    return states


def held_at(session, states):
    """Stamps [s] after T0 of the first and the last state in which the hand's point is still."""
    knots, stamps = session.simulator.model.knots, sorted(states)
    row = bspline.evaluate(np.eye(len(knots) - 4), knots, np.array([0.28]))[0]
    place = np.array([row @ states[stamp][:, :3] for stamp in stamps])
    still = np.linalg.norm(np.diff(place, axis=0), axis=1) < 1e-9
    found = np.flatnonzero(still)
    return (stamps[found[0]] - T0) * 1e-9, (stamps[found[-1] + 1] - T0) * 1e-9


def test_it_holds_from_the_arrival_of_one_message_to_that_of_the_next():
    session = Session(scene_from_values(HAND))
    told = [(T0 + 401 * MS, YES), (T0 + 450 * MS, YES), (T0 + 702 * MS, NO)]
    states = play(session, T0 + SECOND, told)
    first, last = held_at(session, states)
    assert first == pytest.approx(0.405, abs=1e-6) and last == pytest.approx(0.7, abs=1e-6)
    assert not session.scene.grasp("hand").taken
    assert session.journal.topics["/closed"].accepted == 3
    assert not session.journal.refused and not session.journal.events


def test_ticks_of_another_phase_give_the_same_bits():
    told = [(T0 + 401 * MS, YES), (T0 + 702 * MS, NO)]
    scene = scene_from_values(HAND)
    one = play(Session(scene), T0 + SECOND, told)
    two = play(Session(scene), T0 + SECOND, told, phase=2 * MS)
    shared = sorted(one.keys() & two.keys())
    assert len(shared) > 150
    assert all(np.array_equal(one[stamp], two[stamp]) for stamp in shared)
    free = play(Session(scene), T0 + SECOND)
    assert not np.array_equal(one[shared[-1]], free[shared[-1]])


def test_a_message_before_the_cable_is_placed_says_how_it_is_placed():
    session = Session(scene_from_values(HAND))
    session.receive("/closed", YES, T0 - MS)
    play(session, T0 + 200 * MS)
    assert session.scene.grasp("hand").taken
    assert session.simulator.centerline([0.28])[0] == pytest.approx([0.25, 0.0, 0.1], abs=1e-9)


def test_what_cannot_be_taken_is_counted_and_nothing_else_happens():
    session = Session(scene_from_values({**HAND, "grasps.hand.at": 0.0}))
    told = [(T0 + 100 * MS, YES)]
    states = play(session, T0 + 300 * MS, told)
    free = play(Session(session.scene), T0 + 300 * MS)
    assert dict(session.journal.events) == {"not_taken": 1}
    assert session.journal.last_event.startswith("grasps.hand.at: the cable is held at 0 m already")
    assert not session.scene.grasp("hand").taken
    assert all(np.array_equal(states[stamp], free[stamp]) for stamp in free)


def test_a_message_counts_that_comes_while_other_parameters_are_prepared():
    session = Session(scene_from_values(HAND))
    play(session, T0 + 300 * MS)
    scene = session.scene.with_values({"damping.mass": 1.0})
    prepared = session.prepare(scene)
    session.receive("/closed", YES, T0 + 260 * MS)
    session.tick(T0 + 320 * MS)
    assert session.scene.grasp("hand").taken
    session.reconfigure(scene, prepared)
    assert session.scene == scene.with_values({"grasps.hand.taken": True})
    assert session.saved.geometries["hand"].u == pytest.approx(0.28)


def test_other_bytes_are_refused():
    session = Session(scene_from_values(HAND))
    for raw in (b"", b"\x00\x01\x00\x00", b"\x07\x01\x00\x00\x01", bytes(40)):
        session.receive("/closed", raw, T0)
    assert session.journal.topics["/closed"].refused == {"undecodable": 4}
    assert session.journal.topics["/closed"].last_refusal.endswith("publish std_msgs/msg/Bool")


def test_a_cable_that_slips_out_of_a_gripper_is_noted_and_can_be_taken_again():
    far = [0.25, 0.0, -0.3]  # in the slack of a cable whose end is free
    slippery = {
        **HAND,
        "grasps.hand.slides": True,
        "grasps.hand.at": 0.98,
        "end.fixed": [False] * 3,
    }
    session = Session(scene_from_values(slippery | {"grasps.hand.position": far}))
    states = play(session, T0 + 900 * MS, [(T0 - MS, YES), (T0 + 605 * MS, YES)])
    assert len(states) > 100
    assert dict(session.journal.events) == {"slipped_out": 1}
    assert session.scene.grasp("hand").taken  # by the second message
    assert session.simulator.held_at("hand") == pytest.approx(0.36, abs=0.02)
    (status, *_) = cdr.decode_diagnostic_array(session.diagnostics(T0 + 900 * MS))[1]
    values, slide = dict(status.values), session.simulator.slides["hand"]
    assert values["hand tensions [N]"] == f"{slide.before:.6g}, {slide.after:.6g}"
    assert float(values["peak tension [N]"]) > 0.0
