"""The node is stopped for a while, with a gripper at 50 Hz, and goes on."""

from __future__ import annotations

import math
import signal
import time
from collections.abc import Callable

import pytest

pytest.importorskip("rclpy", reason="needs rclpy: pip install 'dlo_sim[ros]'")

from geometry_msgs.msg import PoseArray, PoseStamped
from node_harness import HELD, NodeProcess, Peer

LENGTH = 3.0  # [s], of the hold-up; the queues hold 2 s


def place(seconds: float) -> tuple[float, float]:
    """Where the gripper is at this time [m]."""
    return 0.05 * math.sin(2.0 * seconds), 0.05 * math.sin(3.0 * seconds)


def test_all_that_waited_is_used(peer: Peer, started: Callable[..., NodeProcess]) -> None:
    """Of what the queues still hold; session/test_hold_ups.py has shorter ones, and other kinds."""
    node = started(HELD)
    publisher = peer.publisher(PoseStamped, "/gripper_pose")

    def publish() -> None:
        now = peer.node.get_clock().now()
        pose = PoseStamped()
        pose.header.frame_id = "world"
        pose.header.stamp = now.to_msg()
        pose.pose.position.x, pose.pose.position.y = place(now.nanoseconds * 1e-9)
        publisher.publish(pose)

    timer = peer.node.create_timer(0.02, publish)
    received = peer.collect(PoseArray, "/dlo_sim/control_points")
    peer.until(lambda: len(received) > 50, "control points")
    node.process.send_signal(signal.SIGSTOP)
    begin = time.monotonic()
    peer.until(lambda: time.monotonic() > begin + LENGTH, "the end of the hold-up")
    node.process.send_signal(signal.SIGCONT)
    over = peer.node.get_clock().now().nanoseconds * 1e-9

    def stamp(message: PoseArray) -> float:
        return message.header.stamp.sec + 1e-9 * message.header.stamp.nanosec

    peer.until(lambda: stamp(received[-1]) > over + 1.0, "control points after the hold-up")
    values = peer.status("/dlo_sim: session", lambda values, status: True, "the session")
    assert values["messages refused"] == "0"
    assert "event time_jump" not in values

    def in_place() -> bool:
        """Ten states in a row: after poses that the machine delayed the path is less accurate."""
        firsts = [(stamp(message), message.poses[0].position) for message in received[-10:]]
        return all((p.x, p.y) == pytest.approx(place(t), abs=1e-3) for t, p in firsts)

    peer.until(in_place, "control points at the poses")
    timer.cancel()
