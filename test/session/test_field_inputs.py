"""What is often wrong with inputs in the field: the line names the cure, and the cure helps."""

import re

import numpy as np
import pytest
from fake_simulator import FakeSimulator
from session_bench import FREE, GRIPPER, LOADED, MS, SECOND, T0, Bench, play

from dlo_sim.core import rotations
from dlo_sim.scene.loading import SceneError, scene_from_values
from dlo_sim.session import cdr
from dlo_sim.session.outputs import Outputs
from dlo_sim.session.session import Session

QUARTER = rotations.from_rotation_vector([0, 0, np.pi / 2])


class TestLoadsWithoutFrame:
    """`loads.<name>.frame` says in which frame they are meant; the default is said."""

    @staticmethod
    def load(frame_id="", values=LOADED, **changes):
        """The force on the cable of a message (1, 0, 0) N, the gripper turned by 90 degrees."""
        bench = Bench(values, **changes)
        for k in range(30):
            if "start.pose_topic" in values:
                bench.pose(T0 + k * 10 * MS, orientation=tuple(QUARTER))
            bench.wrench(T0 + k * 10 * MS, (1, 0, 0), frame=frame_id)
        bench.run(T0, T0 + 200 * MS)
        calls = [c for c in bench.simulator.calls if c[0] == "load"]
        return bench, np.round(calls[-1][3], 12).tolist() if calls else None

    def test_without_the_key_it_is_the_world_and_said_once(self):
        bench, force = self.load()
        assert force == [1, 0, 0]
        assert bench.events == {"no_frame": 1}
        (line,) = bench.session.journal.advice
        assert "loads without a frame_id are taken in 'world'" in line
        assert "set loads.tip.frame to its frame (tool), else set it to 'world'" in line
        raw = bench.session.diagnostics(T0 + SECOND)
        assert b"frame of messages without frame_id\0" in raw

    @pytest.mark.parametrize(("key", "force"), [("tool", [0, 1, 0]), ("world", [1, 0, 0])])
    def test_with_the_key_it_is_that_frame(self, key, force):
        bench, found = self.load(**{"loads.tip.frame": key})
        assert found == force
        assert not bench.events
        raw = bench.session.diagnostics(T0 + SECOND)
        assert b"frame of messages without frame_id\0" in raw

    @pytest.mark.parametrize(("frame_id", "force"), [("tool", [0, 1, 0]), ("world", [1, 0, 0])])
    def test_a_message_with_a_frame_is_taken_at_its_word(self, frame_id, force):
        for key in ("", "tool", "world"):
            bench, found = self.load(frame_id, **{"loads.tip.frame": key})
            assert found == force and not bench.events

    def test_forces_too(self):
        values = {k: v for k, v in LOADED.items() if not k.startswith("loads")}
        values |= {"loads.names": ["tip"], "loads.tip.type": "force", "loads.tip.frame": "tool"}
        values["accuracy.estimate"] = "off"  # the fake simulator has no companions
        session = Session(scene_from_values(values), FakeSimulator)
        pose = cdr.StampedEncoder(cdr.POSE_STAMPED, "world")
        force = cdr.StampedEncoder(cdr.VECTOR3_STAMPED, "")
        for k in range(30):
            stamp = T0 + k * 10 * MS
            session.receive("/gripper_pose", pose.encode(stamp, (0, 0, 0, *QUARTER)), stamp)
            session.receive("/dlo_sim/tip/force", force.encode(stamp, (1, 0, 0)), stamp)
            session.tick(stamp)
        (call, *_) = (c for c in session.simulator.calls if c[0] == "load")
        assert call[3] == pytest.approx([0, 1, 0])

    def test_a_frame_that_nothing_has_is_refused_with_those_there_are(self):
        with pytest.raises(SceneError, match=r"loads.tip.frame.*no frame here \(world, tool\)"):
            scene_from_values({**LOADED, "loads.tip.frame": "wrist"})
        scene_from_values({**LOADED, "loads.tip.frame": "wrist", "inputs.tf": True})

    def test_two_loads_of_one_topic_have_one_frame(self):
        two = {**FREE, "loads.names": ["a", "b"], "start.frame": "tool"}
        two = {k: v for k, v in two.items() if ".tip." not in k}
        two |= {"loads.a.topic": "/wrench", "loads.b.topic": "/wrench"}
        scene_from_values({**two, "loads.a.frame": "tool", "loads.b.frame": "tool"})
        with pytest.raises(SceneError, match="differs from loads.a.frame"):
            scene_from_values({**two, "loads.a.frame": "tool"})


def test_the_frame_of_another_world_names_the_key_and_it_helps():
    bench = Bench(LOADED)
    bench.pose(T0, frame="map")
    said = bench.session.journal.topics["/gripper_pose"].last_refusal
    key = re.search(r"set (frame_id): (map) if it is the world frame", said)
    bench = Bench(LOADED, **{key[1]: key[2]})
    bench.pose(T0, frame="map")
    assert not bench.refused("/gripper_pose")
    bench = Bench(LOADED)
    bench.pose(T0, frame="tool")  # the gripper's own frame is no world
    assert "set frame_id" not in bench.session.journal.topics["/gripper_pose"].last_refusal


class TestMillimetres:
    HINT = "1000 times too large: metres?"
    VALUES = {**GRIPPER, "start.position": [0.4, 0.1, 0.5], "end.position": [0.4, 0.1, -0.5]}

    def send(self, scale, away=(0.0, 0.0, 0.0), **changes):
        bench = Bench(self.VALUES, **changes)
        for k in range(40):
            x, y, z = 0.4 + 0.002 * k + away[0], 0.1 + away[1], 0.5 + away[2]
            bench.pose(T0 + k * 10 * MS, (scale * x, scale * y, scale * z))
        bench.run(T0, T0 + 300 * MS)
        return bench

    def test_they_are_suspected(self):
        bench = self.send(1000.0)
        assert bench.events["units"] == 1
        (line,) = bench.session.journal.advice
        assert "/gripper_pose: the first pose is" in line and self.HINT in line
        refusal = bench.session.journal.topics["/gripper_pose"].last_refusal
        assert refusal.startswith("too_fast") and self.HINT in refusal

    @pytest.mark.parametrize("away", [(0, 0, 0), (3, 0, 0), (4.5e5, 5.4e6, 100), (30, 0, 0)])
    def test_metres_are_not(self, away):
        assert not self.send(1.0, away).events

    def test_a_cable_that_cannot_be_placed_says_so(self):
        def refuse(scene, end_poses=None):
            if end_poses:
                raise ValueError("the ends are 1000 m apart")
            return FakeSimulator(scene, end_poses=end_poses)

        session = Session(scene_from_values(self.VALUES), refuse)
        encoder = cdr.StampedEncoder(cdr.POSE_STAMPED, "world")
        session.receive("/gripper_pose", encoder.encode(T0, (400, 100, 500, 0, 0, 0, 1)), T0)
        assert session.tick(T0 + 100 * MS).message.endswith(f"1000 m apart; {self.HINT}")

    def test_two_points_a_thousand_times_too_far_apart(self):
        two = {**GRIPPER, "start.pose_type": "two_points", "start.pose_spacing": 0.05}
        bench = Bench(two)
        bench.points(T0, (0, 0, 0), (50.5, 0, 0))
        assert self.HINT in bench.session.journal.topics["/gripper_pose"].last_refusal
        bench.points(T0, (0, 0, 0), (0.06, 0, 0))
        assert self.HINT not in bench.session.journal.topics["/gripper_pose"].last_refusal


@pytest.mark.parametrize("away", [0.0, 900.0, 1.1e3, 5e5, 4.5e6, 9e7])
def test_points_far_from_the_origin_are_as_exact_as_near_to_it(away):
    values = {"cable.length": 1.0, "outputs.points": True, "discretization.control_points": 6}
    values |= {"start.position": [away, 0.0, 0.5], "end.position": [away + 1.0, 0.0, 0.5]}
    scene = scene_from_values(values)
    simulator = FakeSimulator(scene)
    (message,) = Outputs(scene, 6).messages(simulator, T0, ["~/points"])
    points = cdr.decode_points(cdr.POINT_CLOUD, message.data).rows
    exact = simulator.centerline(np.linspace(0.0, 1.0, 50))
    assert len(points) == 50 and np.ptp(points[:, 0]) > 0.5
    assert np.abs(points - exact).max() < 4e-5
    assert (len(message.data) > 50 * 5 * 8) == (away > 1e3)  # doubles


def test_nothing_is_said_of_ordinary_inputs():
    bench = Bench(LOADED)
    play(bench, 2.0)
    assert not bench.events and not bench.session.journal.advice
