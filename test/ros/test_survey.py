"""A look at the topics of a scene, with publishers that do it right and wrong."""

from __future__ import annotations

import time
from concurrent.futures import ThreadPoolExecutor
from typing import Any

import pytest

pytest.importorskip("rclpy", reason="needs rclpy: pip install 'dlo_sim[ros]'")


from fake_simulator import FakeSimulator
from geometry_msgs.msg import PoseStamped, WrenchStamped
from node_harness import SOON
from rosgraph_msgs.msg import Clock

from dlo_sim.doctor.findings import of_topics
from dlo_sim.ros.survey import _Listening, survey
from dlo_sim.scene.description import Scene
from dlo_sim.scene.loading import scene_from_values
from dlo_sim.session.session import Session

VALUES = {
    "gravity": [0.0, 0.0, 0.0],
    "accuracy.estimate": "off",  # the simulator is a fake
    "integrator.step": 1e-3,
    "discretization.control_points": 5,
    "start.pose_topic": "/pose",
}
HELD = scene_from_values(VALUES)
LOADED = scene_from_values({**VALUES, "loads.names": ["tip"], "loads.tip.topic": "/wrench"})


@pytest.fixture
def look(domain: int, peer: Any, monkeypatch: pytest.MonkeyPatch) -> Any:
    """`look(scene, publish)`: the findings, while `publish` is called every 10 ms."""
    monkeypatch.setenv("ROS_DOMAIN_ID", str(domain))
    made: list[Any] = []

    def create(kind: type, topic: str) -> Any:
        made.append(peer.node.create_publisher(kind, topic, 10))
        return made[-1]

    def run(scene: Scene, publish: Any = lambda: None) -> dict[str, list]:
        monkeypatch.setattr("dlo_sim.ros.survey._DISCOVERY", SOON if made else 0.2)
        timer = peer.node.create_timer(0.01, publish)
        with ThreadPoolExecutor(1) as pool:
            task = pool.submit(survey, Session(scene, FakeSimulator), 0.5)
            found = peer.until(lambda: task.done() and task.result(), "survey")
        peer.node.destroy_timer(timer)
        levels: dict[str, list] = {"ok": [], "note": [], "problem": []}
        for level, what, _ in of_topics(scene, found):
            levels[level].append(what)
        return levels

    run.publisher = create
    yield run
    for publisher in made:
        peer.node.destroy_publisher(publisher)


def pose(stamp: float, frame: str = "world") -> PoseStamped:
    message = PoseStamped()
    message.header.stamp.sec, message.header.stamp.nanosec = int(stamp), int(stamp % 1 * 1e9)
    message.header.frame_id = frame
    message.pose.orientation.w = 1.0
    return message


def test_the_rate_is_that_of_the_arrivals() -> None:
    heard = _Listening(Session(HELD, FakeSimulator), lambda: 0)
    assert heard.rate("/pose") == 0.0
    for heard.arrivals["/pose"], rate in (([7.0], 0.0), ([7.0, 7.02, 7.03, 7.06], 50.0)):
        assert heard.rate("/pose") == pytest.approx(rate)


def test_inputs_that_nobody_publishes_are_named(look: Any) -> None:
    found = look(LOADED)
    assert found["problem"] == ["nobody publishes /pose; the node waits for it"]
    assert found["note"] == ["nobody publishes /wrench; the load is zero"]


def test_good_poses_and_a_load_of_another_type(look: Any) -> None:
    poses = look.publisher(PoseStamped, "/pose")
    look.publisher(PoseStamped, "/wrench")
    found = look(LOADED, lambda: poses.publish(pose(time.time())))
    rate, now = found["ok"]
    topic, number = rate.split()[:2]
    assert topic == "/pose:" and float(number) > 0.0 and "frame 'world'" in rate
    assert now == "stamps agree with the wall clock"
    (mismatch,) = found["problem"]
    assert "publishes geometry_msgs/msg/PoseStamped on /wrench" in mismatch


def test_poses_in_another_frame_and_a_silent_load(look: Any) -> None:
    poses = look.publisher(PoseStamped, "/pose")
    look.publisher(WrenchStamped, "/wrench")
    found = look(LOADED, lambda: poses.publish(pose(time.time(), "camera")))
    refused, silent = found["problem"]
    assert "frame 'camera'" in refused and "unknown_frame" in refused
    assert silent == "/wrench has a publisher, but too few messages arrived"


def test_stamps_of_another_epoch(look: Any) -> None:
    poses, begin = look.publisher(PoseStamped, "/pose"), time.time() - 100.0
    found = look(HELD, lambda: poses.publish(pose(time.time() - begin)))
    (epoch,) = [line for line in found["note"] if "stamps" in line]
    assert epoch.endswith("s behind the wall clock")


def test_a_clock_that_plays_simulated_time_is_noticed(look: Any) -> None:
    clock, poses = look.publisher(Clock, "/clock"), look.publisher(PoseStamped, "/pose")
    begin = time.time() - 100.0

    def publish() -> None:
        now = pose(time.time() - begin)
        clock.publish(Clock(clock=now.header.stamp))
        poses.publish(now)

    found = look(HELD, publish)
    assert "/clock is published" in found["note"]
    assert "stamps agree with /clock" in found["ok"]
