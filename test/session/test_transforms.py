"""Messages in frames that the scene does not name, and ends that follow a frame."""

from __future__ import annotations

import math

import numpy as np
import pytest
from fake_simulator import FakeSimulator
from rosbags.typesys import Stores, get_typestore
from session_bench import GRIPPER, LOADED, MS, SECOND, T0, FakeFrames, motion

from dlo_sim.scene.loading import scene_from_values
from dlo_sim.session import cdr
from dlo_sim.session.intake import Transform, in_world
from dlo_sim.session.outputs import Outputs

STORE = get_typestore(Stores.ROS2_JAZZY)
HALF = math.sqrt(0.5)
QUARTER_TURN = (0.0, 0.0, HALF, HALF)  # about z: x becomes y
CAMERA = Transform(0, (1.0, 2.0, 3.0), QUARTER_TURN)
TF = {"inputs.tf": True}
TOOL = {**{k: v for k, v in GRIPPER.items() if "pose_topic" not in k}, "start.tf_frame": "tool0"}


def in_camera(position):
    """A point of the world as the camera sees it."""
    x, y, z = np.subtract(position, CAMERA.position)
    return y, -x, z


def follow(bench, frames=None, known_after=0):
    """Poses at 100 Hz for half a second, ticks at 200 Hz; the path of the end of the cable."""
    path = []
    for now in range(T0, T0 + SECOND // 2, 5 * MS):
        if frames is not None:
            frames.known_ns = now - known_after
        if now % (10 * MS) == 0 and frames is not None:
            bench.pose(now, in_camera(motion(now)), (0, 0, -HALF, HALF), frame="camera")
        elif now % (10 * MS) == 0:
            bench.pose(now, motion(now))
        bench.session.tick(now)
        if bench.session.started:
            path.append(np.concatenate(bench.simulator.end_pose("start")))
    return np.array(path)


@pytest.mark.parametrize("known_after", [0, 30 * MS])
def test_a_pose_in_another_frame_is_that_in_the_world_even_if_its_transform_comes_later(
    bench, known_after
):
    frames = FakeFrames(camera=CAMERA)
    seen = bench(GRIPPER | TF, transforms=frames)
    path, expected = follow(seen, frames, known_after), follow(bench(GRIPPER))
    late = len(expected) - len(path)
    assert 0 <= late <= known_after / (5 * MS)
    assert np.ptp(path[:, 0]) > 0.01
    assert path == pytest.approx(expected[late:], abs=1e-9)
    assert set(frames.asked) <= set(range(T0, T0 + SECOND, 10 * MS))
    assert seen.refused("/gripper_pose") == {}


def test_a_message_whose_transform_does_not_come_is_refused_once_the_latency_is_over(bench):
    frames = FakeFrames(camera=CAMERA)
    frames.known_ns = T0
    seen = bench(GRIPPER | TF, transforms=frames)
    seen.pose(T0, in_camera((0, 0, 0)), (0, 0, -HALF, HALF), frame="camera")
    seen.pose(T0 + 10 * MS, in_camera((0, 0, 0)), (0, 0, -HALF, HALF), frame="camera")
    seen.pose(T0 + 20 * MS, (0.001, 0, 0))  # waits behind it, lest it come out of order
    seen.session.tick(T0 + 70 * MS)
    record = seen.session.journal.topics["/gripper_pose"]
    assert (record.accepted, record.refusals) == (1, 0)
    seen.session.tick(T0 + 71 * MS)
    assert (record.accepted, dict(record.refused)) == (2, {"no_transform": 1})
    assert record.last_refusal == "no_transform: frame_id 'camera': would extrapolate"


def test_no_more_than_a_thousand_wait_while_the_clock_stands_still(bench):
    seen = bench(GRIPPER | TF, transforms=FakeFrames(camera=CAMERA))
    for number in range(1002):
        seen.pose(T0 + number, frame="nowhere", arrival=T0)
    assert seen.refused("/gripper_pose") == {"no_transform": 2}


def test_a_force_is_turned_and_not_moved(bench):
    seen = bench(LOADED | TF, transforms=FakeFrames(camera=CAMERA))
    for now in range(T0, T0 + 200 * MS, 5 * MS):
        seen.pose(now)
        seen.wrench(now, (0.3, 0, 0.1), (0, 0.2, 0), frame="camera")
        seen.session.tick(now)
    _, _, _, force, torque = [call for call in seen.simulator.calls if call[0] == "load"][-1]
    assert force == pytest.approx([0, 0.3, 0.1])
    assert torque == pytest.approx([-0.2, 0, 0])


def test_an_unstamped_message_is_looked_up_at_its_arrival(bench):
    frames = FakeFrames(camera=CAMERA)
    bench(GRIPPER | TF, transforms=frames).pose(0, frame="camera", arrival=T0 + 7)
    assert frames.asked == [T0 + 7]


def test_the_frames_of_the_scene_are_not_looked_up_and_nothing_is_unless_asked_for(bench):
    frames = FakeFrames(camera=CAMERA)
    asked = bench(GRIPPER | TF, transforms=frames)
    asked.pose(T0, frame="tool")
    asked.pose(T0)
    assert asked.refused("/gripper_pose") == {"unknown_frame": 1}  # a pose in the frame it moves
    other = bench(GRIPPER, transforms=frames)
    other.pose(T0, frame="camera")
    assert other.refused("/gripper_pose") == {"unknown_frame": 1}
    assert not frames.asked


@pytest.mark.parametrize("kind", ["two_points", "point_cloud", "pose_array"])
def test_points_are_moved(kind):
    message = cdr.Stamped(T0, "camera", (1.0, 0.0, 0.0, 0.0, 0.0, 2.0))
    moved = in_world(message, kind, CAMERA)
    assert moved.values == pytest.approx((1.0, 3.0, 3.0, 1.0, 2.0, 5.0))
    assert (moved.stamp_ns, moved.frame_id) == (T0, "")


def test_an_end_follows_a_frame_as_it_follows_poses(bench):
    frames = FakeFrames(camera=CAMERA)
    driven = bench(TOOL, transforms=frames)
    assert driven.session.tick(T0).message == "waiting for the first pose on tool0"
    path = []
    for now in range(T0, T0 + SECOND // 2, 5 * MS):
        if now % (10 * MS) == 0:
            frames.found["tool0"] = Transform(now, motion(now), (0.0, 0.0, 0.0, 1.0))
        driven.session.tick(now)
        if driven.session.started:
            path.append(np.concatenate(driven.simulator.end_pose("start")))
    assert np.array_equal(path, follow(bench(GRIPPER)))
    record = driven.session.journal.topics["tool0"]
    assert (record.accepted, record.refusals) == (50, 0)  # every other tick has nothing new


def test_a_frame_that_stands_still_holds_an_end(bench):
    frames = FakeFrames(camera=CAMERA)
    frames.found["tool0"] = Transform(0, (0.1, 0.2, 0.3), (0.0, 0.0, 0.0, 1.0))
    driven = bench(TOOL, transforms=frames)
    driven.run(T0, T0 + 3 * SECOND)
    assert driven.simulator.end_pose("start")[0] == pytest.approx([0.1, 0.2, 0.3])
    assert not driven.events
    driven.session.reset()
    assert frames.cleared == 1


def test_ends_and_grasps_are_put_out_as_frames():
    values = {"outputs.tf": True, "grasps.names": ["hand"], "discretization.control_points": 5}
    scene = scene_from_values(values)
    simulator = FakeSimulator(scene)
    simulator.end_pose = lambda name: (np.array([0.5, 0.1, 0.2]), np.array([0, 0, HALF, HALF]))
    (message,) = Outputs(scene, 5, node="/left/dlo_sim").messages(simulator, T0 + 7, {"/tf"})
    assert message.type == "tf2_msgs/msg/TFMessage"
    frames = STORE.deserialize_cdr(message.data, message.type).transforms
    assert [frame.child_frame_id for frame in frames] == [
        f"left/dlo_sim/{name}" for name in ("start", "end", "hand")
    ]
    for frame, at, turn in zip(
        frames,
        ([0.0, 0.0, 0.0], [1.0, 0.0, 0.0], [0.5, 0.1, 0.2]),
        ([0.0, 1.0], [0.0, 1.0], [HALF, HALF]),
        strict=True,
    ):
        stamp, p, q = frame.header.stamp, frame.transform.translation, frame.transform.rotation
        assert (stamp.sec, stamp.nanosec, frame.header.frame_id) == (1000, 7, "world")
        assert [p.x, p.y, p.z] == pytest.approx(at)
        assert [q.x, q.y, q.z, q.w] == pytest.approx([0.0, 0.0, *turn])
    assert Outputs(scene_from_values({}), 5).messages(simulator, T0, {"/tf"}) == []
