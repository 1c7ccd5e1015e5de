"""Obstacles from markers on ~/obstacles, through a session on the real simulator."""

import math
import re
import threading
from concurrent.futures import Future

import cables
import numpy as np
import pytest
from marker_arrays import array, marker
from session_bench import MS, SECOND, T0, FakeFrames, feed

from dlo_sim.compiling.kernels import Kernel
from dlo_sim.scene.description import Obstacle
from dlo_sim.scene.loading import scene_from_values
from dlo_sim.session import cdr, markers
from dlo_sim.session.intake import Transform
from dlo_sim.session.saved_state import load_state, save_state
from dlo_sim.session.session import Session
from dlo_sim.simulation import meshes
from dlo_sim.simulation.obstacles import surface

TOPIC = "/dlo_sim/obstacles"
LYING = cables.LYING | {
    "accuracy.estimate": "off",
    "inputs.latency": 0.05,
    "contact.stiffness": 5e4,
    "contact.markers": 3,
}
TOP = (0.0, 0.0, -0.03)  # centre of a plate below the cable, which falls while the latency passes


# Of a plate of triangles [mm].
CORNERS = 1e3 * surface(Obstacle("plate", "box", (0.8, 0.2, 0.02))).reshape(-1, 3)


def plate(number=0, position=TOP, scale=(1.0, 1.0, 0.02), kind=cdr.CUBE, **changes):
    """A marker; by default a plate 2 cm below the cable."""
    return marker(number, position, scale, kind, **changes)


def mesh_of(scale, stretch=1.0):
    """The changes that make it one of triangles in a unit of `scale` [m], `stretch` as long."""
    points = CORNERS * [stretch, 1.0, 1.0]
    return {"kind": cdr.TRIANGLE_LIST, "scale": (scale,) * 3, "points": points}


def run(session, messages, seconds, begin=0.0, period=5 * MS):
    """Give messages, (seconds, markers), at their times, with a tick every period; shapes by
    stamps.
    """
    stamped = [(T0 + round(at * SECOND), markers) for at, *markers in messages]
    told = [(stamp, TOPIC, array(stamp, *markers)) for stamp, markers in stamped]
    begin_ns, end_ns = T0 + round(begin * SECOND), T0 + round(seconds * SECOND)
    return {
        message.stamp_ns: message.data
        for _ in feed(session, told, begin_ns, end_ns, period)
        for message in session.messages((), ["~/control_points"])
    }


def session_of(**values):
    return Session(scene_from_values(LYING | values))


def weight(session):
    return cables.weight(session.simulator)


def drawn(begin, end, speed):
    """The plate at 10 Hz, which moves along x."""
    times = np.arange(begin, end, 0.1)
    return [(t, plate(position=(speed * (t - begin), 0.0, -0.03))) for t in times]


def test_a_plate_comes_carries_the_cable_and_goes():
    session = session_of()
    assert "contact" not in session.simulator.active_terms
    run(session, drawn(0.0, 1.5, 0.1), 1.5)
    simulator = session.simulator
    assert simulator.contact("cell/0").force[2] == pytest.approx(weight(session), rel=2e-2)
    place = simulator.end_pose("cell/0")[0][0]
    assert place == pytest.approx(0.1 * (1.445 - 0.1), abs=1e-6)  # late by one message
    assert simulator.centerline([0.15])[0, 0] == pytest.approx(0.15 + place, abs=5e-3)  # it bounced
    np.testing.assert_allclose(simulator.velocities[:, 0], 0.1, atol=1e-4)
    assert simulator.energy_error < 1e-4
    run(session, [(1.5, plate(action=cdr.DELETE))], 1.7, begin=1.5)
    assert "contact" not in simulator.active_terms
    assert simulator.centerline([0.15])[0, 2] < -0.03
    assert not session.journal.refused and set(session.journal.events) <= {"slow_newton"}


def test_the_same_markers_give_the_same_bits_however_it_ticks():
    told = [*drawn(0.05, 0.6, 0.2), (0.31, plate(1, (0.1, 0.03, -0.005), (0.03,) * 3, cdr.SPHERE))]
    told += [(0.45, plate(action=cdr.DELETE_ALL)), (0.5, plate(2))]
    first, second = (run(session_of(), told, 0.8, period=period) for period in (5 * MS, 20 * MS))
    shared = first.keys() & second.keys()
    assert len(shared) > 30 and all(first[stamp] == second[stamp] for stamp in shared)


@pytest.mark.parametrize("kept", [False, True])
def test_a_mesh_holds_the_cable(tmp_path, kept):
    """A plate of triangles in millimetres; also of a state that is read again."""
    session = session_of()
    mesh = plate(kind=cdr.TRIANGLE_LIST, scale=(1e-3,) * 3, points=CORNERS)
    run(session, [(0.0, mesh), (0.3, mesh)], 0.7)
    if kept:
        save_state(tmp_path / "state", session.saved)
        saved, _ = load_state(tmp_path / "state", session.scene)
        session = Session(saved.scene, resume=saved)
        run(session, [], 1.5, begin=1.0)
    assert session.simulator.scene.added[0].shape == "mesh"
    (shown,) = session.messages((), ["~/contacts"])  # as triangles, since there is no file
    assert cdr.read(cdr.MARKER_ARRAY, shown.data).markers[1].type == cdr.TRIANGLE_LIST
    force = session.simulator.contact("cell/0").force
    assert force[2] == pytest.approx(weight(session), rel=5e-2)
    assert session.simulator.centerline([0.15])[0, 2] == pytest.approx(-0.017, abs=1e-3)
    assert not session.journal.refused and set(session.journal.events) <= {"slow_newton", "resumed"}


def test_the_error_estimate_knows_them():
    """With air so thick that bounces do not multiply rounding errors: 1.2 mm. A finer run
    without the plate falls 0.36 m."""
    session = session_of(**{"accuracy.estimate": "on", "damping.mass": 20.0})
    run(session, drawn(0.0, 0.8, 0.1), 0.8)
    values = dict(cdr.decode_diagnostic_array(session.diagnostics(T0 + SECOND))[1][0].values)
    assert 0.0 < float(values["error estimate [m]"]) < 5e-3
    assert float(values["contact force [N]"]) == pytest.approx(weight(session), rel=0.2)


@pytest.mark.parametrize("estimate", ["off", "on"])
def test_a_change_of_parameters_keeps_them(estimate):
    session = session_of(**{"accuracy.estimate": estimate})
    run(session, drawn(0.0, 0.5, 0.1), 0.55)
    prepared = session.prepare(session.scene.with_values({"damping.mass": 2.0}))
    run(session, [(0.55, plate(1, (0.0, 0.5, 0.0)))], 0.65, begin=0.55)  # meanwhile
    place = session.simulator.end_pose("cell/0")[0]
    session.reconfigure(session.scene.with_values({"damping.mass": 2.0}), prepared)
    assert session.simulator.scene.damping.mass == 2.0
    np.testing.assert_allclose(session.simulator.end_pose("cell/0")[0], place, atol=1e-12)
    run(session, [(0.7, plate(position=(0.05, 0.0, -0.03)))], 1.2, begin=0.65)
    simulator = session.simulator
    assert [one.name for one in simulator.scene.added] == ["cell/0", "cell/1"]
    assert simulator.contact("cell/0").force[2] == pytest.approx(weight(session), rel=2e-2)
    assert simulator.end_pose("cell/0")[0][0] == pytest.approx(0.05)


def test_they_live_as_long_as_they_say_and_go_all_at_once():
    session = session_of()
    run(
        session,
        [(0.0, plate(0, lifetime=0.2), plate(1, (0.0, 0.5, 0.0))), (0.1, plate(0, lifetime=0.2))],
        0.3,
    )
    assert [one.name for one in session.simulator.scene.added] == ["cell/0", "cell/1"]
    run(session, [], 0.4, begin=0.3)
    assert [one.name for one in session.simulator.scene.added] == ["cell/1"]
    run(session, [(0.4, plate(0, action=cdr.DELETE_ALL), plate(2))], 0.5, begin=0.4)
    assert [one.name for one in session.simulator.scene.added] == ["cell/2"]
    run(session, [(0.5, plate(2, scale=(0.5, 0.5, 0.02)))], 0.6, begin=0.5)  # another size
    assert session.simulator.scene.added[0].size == (0.5, 0.5, 0.02)
    other = plate(0, (0.0, 0.9, 0.0), ns="other")
    run(session, [(0.6, other, plate(7, ns="cell", action=cdr.DELETE_ALL))], 0.7, begin=0.6)
    assert [one.name for one in session.simulator.scene.added] == ["other/0"]
    renewed = plate(0, (0.0, 0.9, 0.0), ns="other", lifetime=0.1)
    run(session, [(0.7, plate(action=cdr.DELETE_ALL, ns=""), renewed)], 0.84, begin=0.7)
    assert [one.name for one in session.simulator.scene.added] == ["other/0"]
    run(session, [], 0.9, begin=0.84)
    assert not session.simulator.scene.added


@pytest.mark.parametrize(
    ("reason", "detail", "changes"),
    [
        ("bad_marker", "scale .* of a sphere that is not round", {"kind": cdr.SPHERE}),
        ("bad_marker", "of a cylinder that is not round", {"kind": 3, "scale": (0.1, 0.2, 0.1)}),
        ("bad_marker", r"scale \[0, 1, 1\]; give lengths of 1e-09", {"scale": (0.0, 1.0, 1.0)}),
        ("bad_marker", "lifetime -1 s; give 0 for one that stays", {"lifetime": -1.0}),
        ("bad_marker", "type 9 is no obstacle; give CUBE", {"kind": 9}),
        ("bad_marker", "0 points; give three for each of 4 to 1000", {"kind": cdr.TRIANGLE_LIST}),
        ("bad_marker", "is not closed", mesh_of(1.0) | {"points": np.tile(CORNERS[:3], (5, 1))}),
        ("bad_marker", "a mesh of 0.0002 m is a crumb beside a cable 0.006 m", mesh_of(2.5e-7)),
        ("bad_marker", "has no extent", mesh_of(1.0) | {"points": 5e-324 * CORNERS}),
        ("bad_marker", "a corner is more than 1e+06 m away; check", mesh_of(1e5)),
        ("bad_marker", "action 7; give ADD", {"action": 7}),
        ("bad_marker", "namespace of 302 letters", {"ns": "a" * 300}),
        ("not_finite", "nan", {"position": (0.0, math.nan, 0.0)}),
        ("not_finite", "inf", {"scale": (0.1, math.inf, 0.1)}),
        ("bad_quaternion", r"orientation \[0, 0, 0, 0\]", {"turn": (0.0,) * 4}),
        ("too_large", "position", {"position": (1e9, 0.0, 0.0)}),
        ("unknown_frame", "frame_id 'camera', known: world", {"frame": "camera"}),
    ],
)
def test_bad_ones_are_refused_in_one_line_and_the_others_used(fallen, reason, detail, changes):
    record = fallen.journal.topics[TOPIC]
    refused, accepted = record.refused[reason], record.accepted
    stamp = T0 + SECOND + accepted * 10 * MS
    fallen.receive(TOPIC, array(stamp, plate(0), plate(1, **changes)), stamp)
    assert (record.refused[reason], record.accepted) == (refused + 1, accepted + 1)
    line = record.last_refusal
    assert line.startswith(f"{reason}: 1 of 2 markers, the first is ") and "\n" not in line
    assert detail in line or re.search(detail, line)


@pytest.fixture(scope="module")
def fallen():
    """A session on a plate."""
    session = session_of()
    run(session, drawn(0.0, 0.1, 0.0), 0.3)
    return session


def test_ten_thousand_at_once_are_refused_unread(fallen):
    raw = array(T0 + 2 * SECOND, *[plate(k) for k in range(8)])
    raw = raw[:4] + (10_000).to_bytes(4, "little") + bytes([255]) * len(raw)  # unreadable
    record = fallen.journal.topics[TOPIC]
    fallen.receive(TOPIC, raw, T0 + 2 * SECOND)
    assert record.last_refusal == (
        f"too_many: 10000 markers in {len(raw)} bytes, 7 at most are used; publish "
        "visualization_msgs/msg/MarkerArray"
    )
    fallen.tick(T0 + 2 * SECOND)
    assert fallen.simulator.centerline([0.15])[0, 2] == pytest.approx(-0.017, abs=2e-3)


def test_of_two_places_in_one_message_the_newer_one_counts():
    """Also where the cable is in the way at the older one."""
    session, scale = session_of(), (0.1, 0.1, 0.1)
    run(session, [(0.0, plate(1, (0.0, 0.0, 0.0), scale), plate(1, (0.0, 0.5, 0.0), scale))], 0.1)
    assert not session.journal.events["not_added"]
    assert session.simulator.end_pose("cell/1")[0].tolist() == [0.0, 0.5, 0.0]


def test_what_cannot_be_had_is_counted():
    """Too many, one in the cable, one that jumps; the others are there, and it goes on."""
    session = session_of()
    far = [plate(k, (0.0, k, 0.0)) for k in range(1, 4)]
    run(session, [(0.0, plate(0), *far)], 0.1)
    assert session.journal.events["not_added"] == 1
    assert "cell/3: not added beyond contact.markers 3" in session.journal.last_event
    inside = plate(2, (0.1, 0.0, -0.01), (0.1,) * 3, cdr.SPHERE)
    run(session, [(0.1, plate(2, action=cdr.DELETE)), (0.11, inside)], 0.2, begin=0.1)
    assert "cell/2.position: the cable begins 0.0" in session.journal.last_event
    run(session, [(0.2, plate(1, (0.0, 9.0, 0.0)))], 0.3, begin=0.2)
    events = session.journal.events
    assert (events["not_added"], events["jumped"]) == (2, 1)
    assert "cell/1: a marker is 8 m away after 0.2 s, inputs.max_speed is 20 m/s" in (
        session.journal.last_event
    )
    simulator = session.simulator
    assert simulator.end_pose("cell/1")[0][1] == 1.0
    assert [one.name for one in simulator.scene.added] == ["cell/0", "cell/1"]
    assert simulator.centerline([0.15])[0, 2] == pytest.approx(-0.017, abs=2e-3)


def test_frames_are_looked_up():
    camera = FakeFrames()
    session = Session(scene_from_values(LYING | {"inputs.tf": True}), transforms=camera)
    there = plate(0, (-2.0, 1.0, -3.1), frame="camera")
    session.receive(TOPIC, array(T0, there), T0)
    session.tick(T0)
    assert session.journal.topics[TOPIC].accepted == 0
    turn = (0.0, 0.0, math.sqrt(0.5), math.sqrt(0.5))
    camera.found["camera"] = Transform(0, (1.0, 2.0, 3.0), turn)
    run(session, [], 0.1, begin=0.005)
    position, orientation = session.simulator.end_pose("cell/0")
    np.testing.assert_allclose(position, [0.0, 0.0, -0.1], atol=1e-12)
    assert abs(orientation[2]) == pytest.approx(math.sqrt(0.5))


def test_no_tick_loads_code_when_the_first_one_comes(monkeypatch):
    for estimate in ("off", "on"):
        session = session_of(**{"accuracy.estimate": estimate})
        run(session, [], 0.1)
        with monkeypatch.context() as patched:
            patched.setattr(Kernel, "_compiled", lambda piece, *_, **__: pytest.fail(piece.name))
            mesh = plate(1, (0.0, 0.5, -0.03), (1e-3,) * 3, cdr.TRIANGLE_LIST, points=CORNERS)
            messages = [(0.1, plate()), (0.2, mesh), (0.3, plate(position=(0.01, 0.0, -0.03)))]
            run(session, [*messages, (0.5, plate(action=cdr.DELETE_ALL))], 0.7, begin=0.1)
            session.messages(["~/contacts"], ["~/contacts"])
            session.diagnostics(T0 + SECOND)
        assert not session.simulator.scene.bodies


class AtOnce:
    """An executor that makes everything when it is told to."""

    def __init__(self, *_):
        pass

    def submit(self, make, *arguments):
        future = Future()
        future.set_result(make(*arguments))
        return future


@pytest.fixture
def slowly(monkeypatch):
    """Fields that take five times as long, or 0.1 s."""
    monkeypatch.setattr(meshes, "TIME_OF_VALUE", 1e-5)


def stretched(time, number):
    """Share by which plate `number` of triangles is longer in the message of this time [s]."""
    return 1.0 + 0.01 * math.sin(9.0 * time + number)


def hulls(begin, end, period, count=2):
    """Plates side by side below the cable, whose triangles differ in each message."""
    return [
        (
            t,
            *(
                plate(k, (0.0, 0.3 * k, -0.03), **mesh_of(1e-3, stretched(t, k)))
                for k in range(count)
            ),
        )
        for t in np.arange(begin, end, period).tolist()
    ]


def length(session, name):
    (found,) = [one for one in session.simulator.scene.added if one.name == name]
    return found.size[0]


def test_meshes_act_at_times_that_the_stamps_decide(monkeypatch, slowly):
    """Live and in a replay, however it ticks; the rest of their messages acts at once."""
    told = [*hulls(0.0, 0.3, 0.1), (0.11, plate(2, (0.1, 0.03, -0.005), (0.03,) * 3, cdr.SPHERE))]
    replayed = session_of()
    first = run(replayed, told, 0.6)
    second = run(session_of(), told, 0.6, period=20 * MS)
    monkeypatch.setattr(markers, "ThreadPoolExecutor", AtOnce)
    live = Session(scene_from_values(LYING), live=True)
    third = run(live, told, 0.6)
    assert first == third and second.items() <= first.items() and len(second) > 20
    assert len(replayed.simulator.scene.added) == 3
    assert not live.journal.events["late"] and not live.journal.events["too_many"]


def test_no_tick_waits_for_a_mesh(monkeypatch):
    """One that is made too late acts then, and it is said."""
    made, field_of = threading.Event(), meshes.field_of
    monkeypatch.setattr(meshes, "field_of", lambda *known: made.wait(60) and field_of(*known))
    session = Session(scene_from_values(LYING), live=True)
    mesh = plate(0, **mesh_of(1e-3))
    run(session, [(0.0, mesh, plate(2, (0.0, 0.9, 0.0))), (0.1, plate(1, (0.0, 0.5, 0.0)))], 0.5)
    assert session.simulator.time == pytest.approx(0.495)
    assert [one.name for one in session.simulator.scene.added] == ["cell/2", "cell/1"]
    assert not session.journal.events["late"]
    made.set()
    for field in session._drive.surroundings._fields.values():
        field.result()
    run(session, [], 0.6, begin=0.5)
    assert [one.shape for one in session.simulator.scene.added] == ["box", "box", "mesh"]
    assert session.journal.events["late"] == 1
    assert re.match(r"meshes of markers were made 0\.\d+ s too late", session.journal.last_event)


def test_of_meshes_that_come_faster_than_they_are_made_the_newest_count(slowly):
    """Those before are shed and counted, and no obstacle is left behind."""
    session, told = session_of(), hulls(0.0, 0.3, 0.01, count=3)
    run(session, told, 1.0)
    for k in range(3):
        wanted = 0.8 * stretched(told[-1][0], k)
        assert length(session, f"cell/{k}") == pytest.approx(wanted, rel=1e-9)
    assert session.journal.events["too_many"] > 30
    assert "a newer mesh came before the last one was made" in session.journal.last_event


def test_what_was_there_stays_until_the_meshes_that_replace_it_are_made(slowly):
    """As of a camera that deletes everything and publishes all it sees under other names."""
    session = session_of()
    run(session, [(0.0, plate(7))], 0.3)
    seen = 0.3, plate(action=cdr.DELETE_ALL), plate(8, **mesh_of(1e-3)), plate(9, (0.0, 0.5, 0.0))
    names = {}
    for k in range(40):
        begin = 0.3 + 5e-3 * k
        run(session, [seen] if k == 0 else [], begin + 5e-3, begin=begin)
        names[tuple(one.name for one in session.simulator.scene.added)] = None
    assert list(names) == [("cell/7",), ("cell/7", "cell/9"), ("cell/9", "cell/8")]


def test_a_mesh_that_waits_can_be_taken_back(slowly):
    """By a removal, by another shape, and by the end of its life."""
    session = session_of()
    waiting = [
        plate(k, **mesh_of(1e-3, 1.0 - 0.1 * k), lifetime=0.005 * (k == 2)) for k in range(3)
    ]
    told = [(0.0, *waiting), (0.005, plate(0, action=cdr.DELETE), plate(1, (0.0, 0.5, 0.0)))]
    run(session, told, 0.5)
    assert [(one.name, one.shape) for one in session.simulator.scene.added] == [("cell/1", "box")]
