"""A gripper between the ends: its poses, its reaction, what lets it take and release the cable."""

from __future__ import annotations

from collections.abc import Callable

import pytest

pytest.importorskip("rclpy", reason="needs rclpy: pip install 'dlo_sim[ros]'")

from geometry_msgs.msg import Pose, PoseArray, PoseStamped, WrenchStamped
from node_harness import CABLE, NodeProcess, Peer
from std_msgs.msg import Bool
from std_srvs.srv import Trigger

BARE = {key: value for key, value in CABLE.items() if not key.startswith("loads.")}
HAND = {
    "rate": 50,
    "discretization.control_points": 9,
    "grasps.names": ["hand"],
    "grasps.hand.at": 0.6,
    "grasps.hand.pose_topic": "/hand_pose",
}


def test_a_grasp_is_driven_released_and_taken_again(
    started: Callable[..., NodeProcess], peer: Peer
) -> None:
    node = started({**BARE, **HAND})
    poses = peer.publisher(PoseStamped, "/hand_pose")
    message = PoseStamped()
    message.header.frame_id = "world"
    message.pose.position.x, message.pose.position.z = 0.55, 0.1
    message.pose.orientation.w = 1.0
    reactions = peer.collect(WrenchStamped, "/dlo_sim/hand/reaction")
    shapes = peer.collect(PoseArray, "/dlo_sim/control_points")

    def pull() -> float:
        return reactions[-1].wrench.force.z if reactions else 0.0

    with peer.repeating(poses, message):
        peer.until(lambda: pull() > 0.01 and shapes, "a reaction of the hand")
        response = peer.call(Trigger, "/dlo_sim/hand/release", Trigger.Request())
        assert response.success and response.message == "grasps.hand.taken: false"
        assert peer.get("grasps.hand.taken") == [False]
        peer.until(lambda: pull() == 0.0, "a hand that holds nothing")
        low = shapes[-1].poses[4].position.z
        peer.until(lambda: shapes[-1].poses[4].position.z < low - 0.02, "a cable that falls")
        assert peer.set({"grasps.hand.taken": True}).successful
        peer.until(lambda: pull() != 0.0, "a hand that holds the cable again")
        response = peer.call(Trigger, "/dlo_sim/hand/take", Trigger.Request())
        assert response.success and response.message == "nothing to do: hand holds the cable"
        peer.until(lambda: "took 'hand' at u = 0.60" in node.output, "a line in the log")


def test_two_points_and_a_topic_do_the_same(
    started: Callable[..., NodeProcess], peer: Peer
) -> None:
    topics = {"grasps.hand.pose_type": "two_points", "grasps.hand.taken_topic": "/closed"}
    node = started({**BARE, **HAND, **topics})
    points, closed = peer.publisher(PoseArray, "/hand_pose"), peer.publisher(Bool, "/closed")
    message = PoseArray()
    message.header.frame_id = "world"
    for x in (0.5, 0.6):
        pose = Pose()
        pose.position.x, pose.position.z = x, 0.1
        message.poses.append(pose)
    reactions = peer.collect(WrenchStamped, "/dlo_sim/hand/reaction")

    def pull() -> float:
        return reactions[-1].wrench.force.z if reactions else 0.0

    def told(value: bool, condition: Callable[[], bool], what: str) -> None:
        """Say it until it shows: a message alone may be lost."""

        def asked() -> bool:
            closed.publish(Bool(data=value))
            return condition()

        peer.until(asked, what)

    with peer.repeating(points, message):
        peer.until(lambda: pull() > 0.01, "a reaction of the hand")
        told(False, lambda: pull() == 0.0, "a hand that holds nothing")
        peer.until(lambda: peer.get("grasps.hand.taken") == [False], "the parameter")
        peer.until(lambda: "released 'hand'" in node.output, "a line in the log")
        assert peer.set({"damping.mass": 1.0}).successful
        peer.until(lambda: "parameters changed" in node.output, "the change")
        assert pull() == 0.0
        told(True, lambda: pull() != 0.0, "a hand that holds the cable again")
