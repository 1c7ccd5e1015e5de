"""A bag through the real simulator into a bag: what is written, how it is refused, what is kept."""

import math

import numpy as np
import pytest
import solids
from bag_files import MS, SECOND, STORAGES, T0, contents, cut, messages
from fake_simulator import FakeSimulator
from marker_arrays import array, marker

from dlo_sim.replay.bags import Bag
from dlo_sim.replay.replay import ReplayError, replay_bag
from dlo_sim.session import cdr
from dlo_sim.session.session import Session

OUTPUTS = {
    "/dlo_sim/control_points": cdr.POSE_ARRAY,
    "/dlo_sim/start/reaction": cdr.WRENCH_STAMPED,
    "/dlo_sim/centerline": cdr.MARKER,
    "/dlo_sim/control_polygon": cdr.MARKER,
    "/diagnostics": cdr.DIAGNOSTIC_ARRAY,
}


def files(path):
    return {f.name: f.read_bytes() for f in path.iterdir()}


@pytest.mark.parametrize("storage", STORAGES)
class TestDone:
    def test_writes_what_the_node_would_publish(self, make_bag, scene, tmp_path, storage):
        path = make_bag(storage=storage)
        summary = replay_bag(path, scene, tmp_path / "out")
        assert summary.status == "done" and summary.ok and not summary.message
        assert summary.messages_used == 196 and summary.messages_refused == 0
        bag = Bag(tmp_path / "out")
        assert bag.storage == storage
        assert bag.topics == {topic: (kind,) for topic, kind in OUTPUTS.items()}
        found = contents(tmp_path / "out")
        assert sum(map(len, found.values())) == summary.messages_written
        times = [t for t, _ in found["/dlo_sim/control_points"]]
        assert set(np.diff(times)) == {5 * MS}  # the scene's rate
        assert len(found["/dlo_sim/start/reaction"]) == len(times) > 280
        assert len(found["/diagnostics"]) == 1
        assert 40 < len(found["/dlo_sim/centerline"]) < 46  # 30 Hz
        last = cdr.decode_pose_array(found["/dlo_sim/control_points"][-1][1])
        assert len(last.rows) == 6
        assert np.isfinite(last.rows).all()
        assert last.stamp_ns == pytest.approx(T0 + 1.483 * SECOND, abs=5 * MS)
        assert summary.simulated_s == pytest.approx((last.stamp_ns - T0) * 1e-9, abs=5e-3)

    def test_the_same_bytes_again_wherever_they_go(self, make_bag, scene, tmp_path, storage):
        path = make_bag(storage=storage)
        (tmp_path / "deeper").mkdir()
        replay_bag(path, scene, tmp_path / "one")
        replay_bag(path, scene, tmp_path / "deeper" / "two")
        assert files(tmp_path / "one") == files(tmp_path / "deeper" / "two")
        assert len(files(tmp_path / "one")) == 2
        assert sorted(p.name for p in tmp_path.iterdir()) == ["deeper", "one", "recorded"]


def test_a_hand_seen_by_two_markers_takes_the_cable_beside_a_wall_that_comes(
    make_bag, recorded, scene, tmp_path
):
    """Live is the session alone: what it computes the replay of the bag computes. The wall is of
    triangles, and a finger of a mesh file comes, too.
    """
    hand = {"names": ["hand"], "hand.at": 0.6, "hand.taken": False, "hand.taken_topic": "/closed"}
    hand |= {"hand.pose_topic": "/markers", "hand.pose_type": "two_points"}
    held = scene.with_values({f"grasps.{key}": value for key, value in hand.items()})
    (tmp_path / "finger.glb").write_bytes(solids.files(solids.sphere(0.03, 8), "glb"))
    finger = {"shape": "mesh", "mesh": str(tmp_path / "finger.glb"), "pose_topic": "/finger"}
    finger |= {"mesh_cells": 16, "position": [0.03, 0.19, 0.21]}
    touched = {f"obstacles.finger.{key}": value for key, value in finger.items()}
    held = held.with_values({"obstacles.names": ["finger"], "contact.markers": 2} | touched)
    markers, pose = cdr.PoseArrayEncoder("world", 2), cdr.StampedEncoder(cdr.POSE_STAMPED, "world")
    corners = solids.box(1.0, 1.0, 1.0).reshape(-1, 3)
    messages = [*recorded, ("/closed", T0 + 500 * MS, b"\x00\x01\x00\x00\x01")]
    for stamp in range(T0 + 200 * MS, T0 + 1200 * MS, 100 * MS):  # a wall that comes near
        x = 0.25 - 0.09e-9 * (stamp - T0)
        wall = marker(0, (x, 0.0, 0.3), (0.2, 1.0, 1.0), cdr.TRIANGLE_LIST, points=corners)
        messages.append(("/dlo_sim/obstacles", stamp, array(stamp, wall)))
    for stamp in range(T0, T0 + 1500 * MS, 10 * MS):
        y = 1e-10 * max(stamp - T0 - 600 * MS, 0)
        markers.rows[:, :3] = [[0.0, y, 0.3], [0.0, y, 0.28]]
        messages.append(("/markers", stamp, markers.encode(stamp)))
        y = 0.19 - 5e-11 * (stamp - T0)
        messages.append(("/finger", stamp, pose.encode(stamp, (0.03, y, 0.21, 0, 0, 0, 1))))
    messages.sort(key=lambda message: message[1])
    types = {"/gripper_pose": cdr.POSE_STAMPED, "/wrench": cdr.WRENCH_STAMPED}
    types |= {"/markers": cdr.POSE_ARRAY, "/closed": cdr.BOOL, "/finger": cdr.POSE_STAMPED}
    types |= {"/dlo_sim/obstacles": cdr.MARKER_ARRAY}
    summary = replay_bag(make_bag(messages, types), held, tmp_path / "out")
    assert summary.status == "done" and summary.messages_refused == 0
    found = contents(tmp_path / "out")["/dlo_sim/control_points"]
    replayed = {cdr.decode_pose_array(data).stamp_ns: data for _, data in found}

    session, live = Session(held), {}
    for now in range(T0, T0 + 1500 * MS, 5 * MS):
        while messages and messages[0][1] <= now:
            topic, arrival, raw = messages.pop(0)
            session.receive(topic, raw, arrival)
        session.tick(now)
        for message in session.messages(["~/control_points"]):
            live[message.stamp_ns] = message.data
    shared = live.keys() & replayed.keys()
    assert len(shared) > 250 and all(live[stamp] == replayed[stamp] for stamp in shared)
    simulator = session.simulator
    assert simulator.contact("cell/0").force[0] < -1e-3
    assert simulator.contact("finger").force[1] < -1e-3
    moved = simulator.centerline([0.24])[0, 1]
    assert moved > 0.05 and session.scene.grasp("hand").taken


def test_summary_and_comparison_without_an_output(make_bag, scene, tmp_path):
    path = make_bag()
    summary = replay_bag(path, scene, None, compare={"start": "/wrench"})
    assert [row.axis for row in summary.comparison["start"]] == ["x", "y", "z"]
    assert summary.comparison["start"][0].samples > 100
    assert summary.messages_written == 0
    assert [p.name for p in tmp_path.iterdir()] == ["recorded"]
    written = replay_bag(path, scene, tmp_path / "out", compare={"start": "/wrench"})
    assert summary.comparison == written.comparison
    assert math.isnan(summary.comparison["start"][0].correlation), "x is never loaded"
    assert summary.refused_by_reason == {}


def test_refused_messages_are_counted_by_reason(make_bag, recorded, scene, tmp_path):
    bad = cdr.StampedEncoder(cdr.WRENCH_STAMPED, "world")
    extra = [
        ("/wrench", T0 + 500 * MS + 1, bad.encode(T0 + 500 * MS + 1, (math.nan, 0, 0, 0, 0, 0))),
        ("/wrench", T0 + 500 * MS + 2, bad.encode(T0 + 500 * MS + 2, (1e9, 0, 0, 0, 0, 0))),
        ("/wrench", T0 + 500 * MS + 3, b"rubbish"),
        ("/gripper_pose", T0 + 500 * MS + 3, b""),
    ]
    found = sorted(recorded + extra, key=lambda m: m[1])
    summary = replay_bag(make_bag(found, name="bad"), scene, tmp_path / "bad_out")
    assert summary.ok
    assert summary.refused_by_reason == {"not_finite": 1, "too_large": 1, "undecodable": 2}
    assert summary.messages_refused == 4
    replay_bag(make_bag(), scene, tmp_path / "out")
    good, other = contents(tmp_path / "out"), contents(tmp_path / "bad_out")
    assert good["/dlo_sim/control_points"] == other["/dlo_sim/control_points"]
    assert good["/diagnostics"] != other["/diagnostics"]


@pytest.mark.parametrize(("share", "status"), [(20, "done"), (18, "refused")])
def test_a_topic_that_lacks_more_than_a_few_messages(
    make_bag, recorded, scene, tmp_path, share, status
):
    """One in 20 refused is still a replay, more is said with the reason."""
    poses = [message for message in recorded if message[0] == "/gripper_pose"]
    wrenches = [message for message in recorded if message[0] == "/wrench"][:100]
    bad = cdr.StampedEncoder(cdr.WRENCH_STAMPED, "camera")
    for k in range(0, 100, share):
        topic, t, _ = wrenches[k]
        wrenches[k] = topic, t, bad.encode(t, (0, 0, 0, 0, 0, 0))
    count = len(range(0, 100, share))
    bag = make_bag(sorted(poses + wrenches, key=lambda m: m[1]))
    summary = replay_bag(bag, scene, tmp_path / "out")
    assert summary.status == status
    assert summary.refused_by_topic == {"/wrench": {"unknown_frame": count}}
    if status == "refused":
        assert not summary.ok
        text = "/wrench: 6 of 100 messages refused, last unknown_frame: frame_id 'camera'"
        assert summary.message.startswith(text)
    assert contents(tmp_path / "out")["/dlo_sim/control_points"]  # kept


class Folding(FakeSimulator):
    """Reports a fold after one step, and a sound shape after all others."""

    step_of_fold = 0

    def __init__(self, *given, **named):
        super().__init__(*given, **named)
        self.folds_at = self.step_of_fold


@pytest.mark.parametrize("step", (1000, 1005, 1011))
def test_a_fold_at_any_step_is_reported_beside_what_else_is_wrong(
    make_bag, recorded, scene, tmp_path, monkeypatch, step
):
    """Also where a message or a motion of the gripper divides the steps of a tick."""
    monkeypatch.setattr(Folding, "step_of_fold", step)
    scene = scene.with_values({"integrator.step": 1e-3, "rate": 40.0})  # 25 steps in a tick
    summary = replay_bag(make_bag(), scene, tmp_path / "out", simulator_factory=Folding)
    assert (summary.status, summary.message) == ("unresolved", "folded: fake")
    assert summary.events == {"unresolved": 1}
    bad = cdr.StampedEncoder(cdr.WRENCH_STAMPED, "camera")
    lacking = [
        (topic, t, bad.encode(t, (0,) * 6) if topic == "/wrench" else data)
        for topic, t, data in recorded
    ]
    bag = make_bag(lacking, name="lacking")
    summary = replay_bag(bag, scene, tmp_path / "other", simulator_factory=Folding)
    assert summary.status == "refused"
    assert summary.message.startswith("/wrench: ") and summary.message.endswith("; folded: fake")


def test_what_still_waits_at_the_end_is_refused(make_bag, recorded, scene, tmp_path):
    pose = cdr.StampedEncoder(cdr.POSE_STAMPED, "world")
    stamp = recorded[-1][1] + 5000 * SECOND
    extra = ("/gripper_pose", recorded[-1][1], pose.encode(stamp, (0, 0, 0.5, 0, 0, 0, 1)))
    summary = replay_bag(make_bag([*recorded, extra]), scene, tmp_path / "out")
    assert summary.refused_by_reason == {"in_future": 1}
    assert summary.messages_used + summary.messages_refused == len(recorded) + 1


def test_a_recorder_that_was_held_up(make_bag, long_recording, scene, tmp_path):
    """Everything of 3 to 4.2 s was recorded at 4.2 s: all is used, and a second later the cable,
    which hardly swings here, is where it would have been.
    """
    scene = scene.with_values({"damping.mass": 20.0})
    begin, end = T0 + 3 * SECOND, T0 + 4200 * MS
    late = [(topic, end if begin < t < end else t, data) for topic, t, data in long_recording]
    held_up = replay_bag(make_bag(late, name="late"), scene, tmp_path / "held_up")
    assert held_up.status == "done"
    assert (held_up.messages_used, held_up.messages_refused) == (len(long_recording), 0)
    assert "time_jump" not in held_up.events
    replay_bag(make_bag(long_recording), scene, tmp_path / "out")
    one, two = (
        {t: cdr.decode_pose_array(data).rows for t, data in found["/dlo_sim/control_points"]}
        for found in (contents(tmp_path / "out"), contents(tmp_path / "held_up"))
    )
    after = [t for t in one if t > end + 1060 * MS]
    assert len(after) > 300
    assert max(np.abs(one[t] - two[t])[:, :3].max() for t in after) < 1e-3


def test_frames_are_written_on_request(make_bag, scene, tmp_path):
    replay_bag(make_bag(), scene.with_values({"outputs.tf": True}), tmp_path / "out")
    assert Bag(tmp_path / "out").topics["/tf"] == ("tf2_msgs/msg/TFMessage",)
    found = contents(tmp_path / "out")
    assert [t for t, _ in found["/tf"]] == [t for t, _ in found["/dlo_sim/control_points"]]


WRENCH = {"/wrench": cdr.WRENCH_STAMPED}
BY_TF2 = {"start.pose_topic": "", "start.tf_frame": "tool0"}
ONE = "geometry_msgs/msg/"
# What is wrong -> the topics of the bag (None = those of the scene), changes of the scene, what is
# compared, and the line.
REFUSED = {
    "a frame of tf2": (None, BY_TF2, {}, "start.tf_frame: 'tool0' is looked up in tf2, which a"),
    "other topics": (
        {"/elsewhere": cdr.WRENCH_STAMPED},
        {},
        {},
        rf"no message on /gripper_pose, /wrench; it has /elsewhere \({ONE}Wrench",
    ),
    "no pose": (WRENCH, {}, {}, "no pose on /gripper_pose; it has /wrench"),
    "another type": (
        {"/gripper_pose": cdr.POSE_STAMPED, "/wrench": cdr.VECTOR3_STAMPED},
        {},
        {},
        f"topic /wrench of bag .* is {ONE}Vector3Stamped, the scene needs .*Wrench",
    ),
    "no such reaction": (None, {}, {"start": "/other"}, "no topic /other in bag"),
    "no reaction": (None, {}, {"end": "/wrench"}, "'end': this end is free"),
    "no such end": (None, {}, {"middle": "/wrench"}, "nothing of that name holds the cable"),
    "no wrench": (None, {}, {"start": "/gripper_pose"}, f"is {ONE}Pose"),
    "no inputs": (
        None,
        {"start.pose_topic": "", "loads.names": []},
        {},
        "the scene listens to no topic",
    ),
    "not one usable": (None, {"frame_id": "map"}, {}, "46 refused, last unknown_frame: .*'world'"),
}


@pytest.mark.parametrize("why", REFUSED)
def test_refused_in_one_line_and_nothing_written(make_bag, recorded, scene, tmp_path, why):
    topics, changes, compare, text = REFUSED[why]
    if topics is None:
        bag = make_bag()
    else:
        known = dict(zip(("/gripper_pose", "/wrench"), topics, strict=False))
        if len(topics) == 1:  # the wrenches alone
            known = {"/wrench": next(iter(topics))}
        found = [(known[topic], t, data) for topic, t, data in recorded if topic in known]
        bag = make_bag(found, topics=topics)
    with pytest.raises(ReplayError, match=text) as refusal:
        replay_bag(bag, scene.with_values(changes), tmp_path / "out", compare=compare)
    assert "\n" not in str(refusal.value)
    assert [path.name for path in tmp_path.iterdir()] == ["recorded"]


@pytest.mark.parametrize("storage", STORAGES)
@pytest.mark.parametrize("topics", [{}, WRENCH])
def test_an_empty_bag_is_refused(make_bag, scene, tmp_path, storage, topics):
    with pytest.raises(ReplayError, match="is empty"):
        replay_bag(make_bag([], topics=topics, storage=storage), scene, tmp_path / "out")
    assert [path.name for path in tmp_path.iterdir()] == ["recorded"]


@pytest.mark.parametrize("storage", STORAGES)
def test_the_part_that_is_left_of_a_bag_gives_the_same_states(
    make_bag, long_recording, scene, tmp_path, storage
):
    whole = make_bag(long_recording, storage=storage)
    replay_bag(whole, scene, tmp_path / "whole_out")
    cut(whole, 0.5)
    summary = replay_bag(whole, scene, tmp_path / "half_out")
    assert summary.status == "truncated" and not summary.ok
    assert f"of {len(long_recording)} messages could be read" in summary.message
    assert "\n" not in summary.message and 1.0 < summary.simulated_s < 6.0
    one = contents(tmp_path / "whole_out")["/dlo_sim/control_points"]
    half = contents(tmp_path / "half_out")["/dlo_sim/control_points"]
    same = len(half) - 20  # at the end it waits for poses that are lost
    assert same > 200
    assert one[:same] == half[:same]


def test_a_diverged_run_is_kept_with_its_reason(make_bag, scene, tmp_path):
    """The simulator is made to fail; the states up to there are in the bag."""
    from dlo_sim.simulation.report import Status
    from dlo_sim.simulation.simulator import Simulator

    class Failing(Simulator):
        def advance_steps(self, steps, *rest):
            report = super().advance_steps(steps, *rest)
            if self.time > 0.5:
                return report._replace(status=Status.DIVERGED, message="diverged: made to")
            return report

    summary = replay_bag(make_bag(), scene, tmp_path / "out", simulator_factory=Failing)
    assert summary.status == "diverged"
    assert "diverged: made to (at 0.5" in summary.message
    assert 90 < len(contents(tmp_path / "out")["/dlo_sim/control_points"]) < 130


def test_a_bag_recorded_while_an_old_one_was_played(make_bag, recorded, scene, tmp_path):
    """Times of recording of today, stamps of then: the same states, published on today's clock."""
    shift = 123_456_789 * SECOND
    later = [(topic, t + shift, data) for topic, t, data in recorded]
    compare = {"start": "/wrench"}
    one = replay_bag(make_bag(), scene, tmp_path / "one", compare=compare)
    two = replay_bag(make_bag(later, name="later"), scene, tmp_path / "two", compare=compare)
    assert two.events == {"other_epoch": 1}
    assert two.comparison["start"][2] == one.comparison["start"][2]
    first, second = (
        [cdr.decode_pose_array(data) for _, data in contents(path)["/dlo_sim/control_points"]]
        for path in (tmp_path / "one", tmp_path / "two")
    )
    assert len(first) == len(second) > 280
    for a, b in zip(first, second, strict=True):
        assert b.stamp_ns - a.stamp_ns == shift
        assert np.array_equal(a.rows, b.rows)


@pytest.mark.parametrize("at", [2000, 5000])
def test_a_message_written_long_after_its_time_is_refused_alone(make_bag, scene, at):
    """It arrives when it was written: its old time says nothing about the clocks of the others."""
    found = messages(20.0)
    found.insert(at, ("/gripper_pose", T0 - 300 * SECOND, found[0][2]))
    summary = replay_bag(make_bag(found), scene, None, simulator_factory=FakeSimulator)
    assert summary.status == "truncated" and "s out of order" in summary.message
    assert summary.refused_by_topic == {"/gripper_pose": {"too_old": 1}}
    assert summary.messages_used == len(found) - 1 and summary.events == {}
    assert summary.simulated_s == pytest.approx(20.0, abs=0.05)
