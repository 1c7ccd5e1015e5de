"""A gripper between the ends: its poses, its reaction, ~/<grasp>/take and ~/<grasp>/release."""

from __future__ import annotations

from collections.abc import Callable

import pytest

pytest.importorskip("rclpy", reason="needs rclpy: pip install 'dlo_sim[ros]'")

from geometry_msgs.msg import PoseArray, PoseStamped, WrenchStamped
from node_harness import CABLE, NodeProcess, Peer
from std_srvs.srv import Trigger

BARE = {key: value for key, value in CABLE.items() if not key.startswith("loads.")}
HAND = {
    "rate": 50,
    "grasps.names": ["hand"],
    "grasps.hand.at": 0.6,
    "grasps.hand.pose_topic": "/hand_pose",
}


def test_a_grasp_is_driven_released_and_taken_again(
    started: Callable[..., NodeProcess], peer: Peer
) -> None:
    started({**BARE, **HAND})
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
        assert peer.call(Trigger, "/dlo_sim/hand/take", Trigger.Request()).success
