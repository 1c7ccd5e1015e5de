"""Poses at a few hertz, over ROS: all states are published, and the log says how late."""

from __future__ import annotations

import math
import re
from collections.abc import Callable

import pytest

pytest.importorskip("rclpy", reason="needs rclpy: pip install 'dlo_sim[ros]'")

from geometry_msgs.msg import PoseArray, PoseStamped, WrenchStamped
from node_harness import HELD, START, NodeProcess, Peer
from rclpy.time import Time

PERIOD = 20_000_000  # [ns], of the node
BETWEEN = 160_000_000  # [ns], of the poses
ROW = 30  # states; no fewer than those between three poses


def test_slow_poses_and_a_wrench_without_a_frame(
    launch: Callable[..., NodeProcess], peer: Peer
) -> None:
    node = launch({**HELD, "rate": 1e9 / PERIOD, "loads.names": ["tip"]})
    peer.watched = node
    peer.until(lambda: peer.node.count_services("/dlo_sim/reset"), "node", START)
    pose_out = peer.publisher(PoseStamped, "/gripper_pose")
    load_out = peer.publisher(WrenchStamped, "/dlo_sim/tip/wrench")
    received = peer.collect(PoseArray, "/dlo_sim/control_points", 200)
    clock = peer.node.get_clock()
    begin = due = clock.now().nanoseconds

    def publish() -> None:
        """What is due: stamps are regular, however late the machine calls this."""
        nonlocal due
        while due <= clock.now().nanoseconds:
            pose, load = PoseStamped(), WrenchStamped()
            load.header.stamp = pose.header.stamp = Time(nanoseconds=due).to_msg()
            pose.header.frame_id = "world"
            pose.pose.position.x = 0.05 * math.sin((due - begin) * 3e-9)
            pose.pose.orientation.w = 1.0
            pose_out.publish(pose)
            load_out.publish(load)
            due += BETWEEN

    def row() -> list[int]:
        """Stamps of the newest states [ns] if none is missing between them. That has to come: the
        machine does not hold up every tick. With a latency that is too short, four of five states
        are left out, and a row ends at each pose.
        """
        stamps = [m.header.stamp.sec * 10**9 + m.header.stamp.nanosec for m in received[-ROW:]]
        return stamps if round((stamps[-1] - stamps[0]) / PERIOD) == ROW - 1 else []

    timer = peer.node.create_timer(BETWEEN * 1e-9, publish)
    stamps = peer.until(lambda: len(received) > ROW and row(), "states without a gap")
    assert clock.now().nanoseconds - stamps[-1] > 1.5 * BETWEEN
    peer.until(lambda: "loads without a frame_id are taken in 'world'" in node.output, "log")
    line = re.compile(r"poses of start come 0\.16 s apart(, \S+ s late)?; to move between them")
    peer.until(lambda: line.search(node.output), "log")
    peer.node.destroy_timer(timer)
