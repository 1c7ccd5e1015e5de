"""Plans as messages: what is forecast of the good ones, why the others are refused."""

import numpy as np
import pytest
from plans import AT_ORIGIN, trajectory
from rosbags.typesys import Stores, get_typestore
from session_bench import MS, SECOND, T0, feed, poses

from dlo_sim.scene.loading import SceneError, load_scene
from dlo_sim.session import cdr, plans
from dlo_sim.session.diagnostics import Refused
from dlo_sim.session.plans import answer, check_method, decode_trajectory, request
from dlo_sim.session.session import Session

STORE = get_typestore(Stores.ROS2_JAZZY)
TYPES = STORE.types
NOW = T0 + SECOND
SCENE = {"cable.rest_curvature": [0.0], "forecast.processes": 1, "start.pose_topic": "/pose"}


def gripper(seconds):
    """Where the gripper is, and will be."""
    return np.stack([0.2 * np.sin(seconds), 0.0 * seconds, 0.05 * seconds], axis=-1)


@pytest.fixture
def session():
    """A cable that has been moved for a second; the newest pose is at NOW."""
    session = Session(load_scene("hanging_cable", SCENE))
    told = poses("/pose", gripper, T0, NOW + 1, frame="")
    for _ in feed(session, told, T0, NOW + 1, 10 * MS):
        pass
    return session


def message(joints=("start",), times=None, shift=0.0, stamp=NOW, frame="", turn=(0, 0, 0, 1)):
    """A plan that goes on as the gripper did."""
    times = 0.05 * np.arange(21) if times is None else np.array(times)
    turns = np.tile(turn, (len(times), 1))
    rows = np.hstack([gripper(1.0 + times) + shift, turns])[:, None]
    times_ns = [round(time * SECOND) for time in times]
    return trajectory(joints, times_ns, np.repeat(rows, len(joints), axis=1), stamp, frame)


def test_what_comes_of_a_plan(session):
    before = session.saved.state
    asked = request(session, message(), NOW)
    assert NOW - asked.now_ns == 255 * MS  # latency and smoothing
    found = answer(asked)
    assert not found.problem
    assert np.array_equal(session.saved.state, before)
    cloud = STORE.deserialize_cdr(found.messages[0].data, cdr.POINT_CLOUD)
    assert cloud.header.stamp.sec * SECOND + cloud.header.stamp.nanosec == NOW
    assert [field.name for field in cloud.fields] == ["x", "y", "z", "u", "t", "tension"]
    rows = cloud.data.view(np.float32).reshape(-1, 50, 6)
    plan, _, _ = plans._planned(asked)
    expected = session.simulator.forecast(plan, session.scene.forecast.every)
    assert len(rows) == 25
    assert np.array_equal(rows[..., :3], expected.centerline.astype(np.float32))
    assert np.array_equal(rows[..., 5], expected.tension.astype(np.float32))
    # t counts from the stamp: the gripper is where the plan says.
    for row in rows[6::5]:
        assert row[0, :3] == pytest.approx(gripper(1.0 + row[0, 4]), abs=1e-4)
    ghosts = STORE.deserialize_cdr(found.messages[1].data, cdr.MARKER)
    assert (ghosts.type, len(ghosts.points), ghosts.color.a) == (5, 5 * 2 * 49, np.float32(0.3))
    last = ghosts.points[-1]
    assert [last.x, last.y, last.z] == expected.centerline[-1, -1].tolist()
    values = dict(found.values)
    assert "clearance [m]" not in values
    assert float(values["peak tension [N]"]) == pytest.approx(expected.peak_tension, rel=1e-3)


@pytest.mark.parametrize("turn", [(0, 0, 0, 1), (0, 0, 0, -1)])
def test_a_plan_without_a_stamp_begins_as_it_comes(session, turn):
    found = answer(request(session, message(stamp=0, turn=turn), NOW + 20 * MS))
    assert {one.stamp_ns for one in found.messages} == {NOW + 20 * MS}
    assert not found.problem


@pytest.mark.parametrize(
    ("changes", "reason", "text"),
    [
        ({"joints": ["tcp"]}, "bad_plan", "tcp; name what holds the cable, each once: start"),
        ({"joints": []}, "bad_plan", "has the joints none"),
        ({"joints": ["end"]}, "bad_plan", "has the joints end; name what holds the cable"),
        ({"joints": ["start", "start"]}, "bad_plan", "has the joints start, start"),
        ({"times": [0.0, 0.1, 0.1]}, "bad_plan", "has the times 0, 0.1, 0.1 ... s; give rising"),
        ({"times": []}, "bad_plan", "has the times none"),
        ({"times": [0.0, 100.0]}, "bad_plan", "ends 100.255 s after the present state"),
        ({"stamp": NOW - 2 * SECOND}, "bad_plan", "ends -0.745 s after the present state"),
        ({"shift": 0.1}, "bad_plan", "begins 0.173 m and 0 rad away from the newest pose of start"),
        ({"shift": np.nan}, "not_finite", "the plan's pose 0 of start: [nan, "),
        ({"turn": (0, 0, 0.6, 0.8)}, "bad_plan", "1.29 rad away"),
        (
            {"turn": (0, 0, 0, 2)},
            "bad_quaternion",
            "the plan's pose 0 of start: orientation [0, 0, 0, 2] has norm 2",
        ),
        ({"frame": "base"}, "bad_plan", "is in frame 'base'; transform it to 'fr3_link0'"),
    ],
)
def test_bad_plans_are_refused(session, changes, reason, text):
    found = answer(request(session, message(**changes), NOW))
    assert found == plans.Answer(refused=(reason, found.refused[1]))
    assert text in found.refused[1]
    assert "\n" not in found.refused[1]


def test_a_plan_that_is_too_fast(session):
    slow = session.scene.with_values({"inputs.max_speed": 0.05})
    session.reconfigure(slow, session.prepare(slow))
    _, detail = answer(request(session, message(), NOW)).refused
    assert "inputs.max_speed is 0.05 m/s; plan it slower" in detail


def test_damaged_messages(session):
    whole = message()
    for length in range(0, len(whole), 37):
        assert answer(request(session, whole[:length], NOW)).refused[0] == "undecodable"


def many(count, joints=("start",)):
    """A message of so many points at rest."""
    still = np.tile(AT_ORIGIN, (count, len(joints), 1))
    return trajectory(joints, [0] * count, still, 2000 * SECOND)


@pytest.mark.parametrize(
    ("plan", "reason", "text"),
    [
        ((20_001,), "too_many", "20001 points, 20000 at most are used; publish trajectory_msgs"),
        ((20_000, ["tcp"]), "bad_plan", "the plan has the joints tcp; name what holds"),
        ((1, ["start"] * 2000), "too_many", "2000 joints, 1000 at most are used"),
    ],
)
def test_long_plans_are_refused(session, plan, reason, text):
    found = answer(request(session, many(*plan), NOW)).refused
    assert found[0] == reason and text in found[1]


def test_a_plan_that_is_too_long_to_be_handed_on_is_not_looked_at(session):
    with pytest.raises(Refused, match="16000001 bytes; plan at most 20000 points"):
        request(session, bytes(16_000_001), NOW)


def test_the_longest_plan_is_decoded_as_a_whole():
    found = decode_trajectory(many(20_000))
    assert found.poses.shape == (20_000, 1, 7)
    assert np.all(found.poses == [0, 0, 0, 0, 0, 0, 1]) and not found.times.any()


def test_before_the_cable_is_placed():
    session = Session(load_scene("hanging_cable", SCENE))
    reason, detail = answer(request(session, message(), NOW)).refused
    assert reason == "bad_plan" and "plan once every end has a pose" in detail


def test_a_method_that_follows_no_plans():
    scene = load_scene("paper_wire", {"forecast.processes": 1})
    with pytest.raises(SceneError, match="processes: forest_ruth follows no plans; set it to 0"):
        check_method(scene, "forest_ruth")
