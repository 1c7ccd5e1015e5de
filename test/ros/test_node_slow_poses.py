"""Poses at a few hertz, over ROS: all states are published, and the log says how late."""

from __future__ import annotations

import math
import re
from collections.abc import Callable

import pytest

pytest.importorskip("rclpy", reason="needs rclpy: pip install 'dlo_sim[ros]'")

from geometry_msgs.msg import PoseArray, PoseStamped, WrenchStamped
from node_harness import HELD, START, NodeProcess, Peer

RATE = 50.0  # Hz, of the node
POSES = 6.0  # Hz


def test_slow_poses_and_a_wrench_without_a_frame(
    launch: Callable[..., NodeProcess], peer: Peer
) -> None:
    node = launch({**HELD, "rate": RATE, "loads.names": ["tip"]})
    peer.watched = node
    peer.until(lambda: peer.node.count_services("/dlo_sim/reset"), "node", START)
    pose_out = peer.publisher(PoseStamped, "/gripper_pose")
    load_out = peer.publisher(WrenchStamped, "/dlo_sim/tip/wrench")
    received = peer.collect(PoseArray, "/dlo_sim/control_points", 200)
    clock = peer.node.get_clock()
    begin = clock.now().nanoseconds

    def publish() -> None:
        now = clock.now()
        pose = PoseStamped()
        pose.header.frame_id, pose.header.stamp = "world", now.to_msg()
        pose.pose.position.x = 0.05 * math.sin((now.nanoseconds - begin) * 3e-9)
        pose.pose.orientation.w = 1.0
        pose_out.publish(pose)
        load = WrenchStamped()
        load.header.stamp = now.to_msg()
        load_out.publish(load)

    timer = peer.node.create_timer(1.0 / POSES, publish)
    waited = node.waited
    peer.until(lambda: len(received) >= 300, "states")
    peer.node.destroy_timer(timer)
    stamps = [m.header.stamp.sec * 10**9 + m.header.stamp.nanosec for m in received]
    tail = stamps[-200:]  # the first poses set the latency
    missing = round((tail[-1] - tail[0]) * 1e-9 * RATE) + 1 - len(tail)
    # A tick that the machine holds up leaves out its states; 40 of 50 were left out before.
    assert missing <= 4 + RATE * (node.waited - waited)
    late = (clock.now().nanoseconds - stamps[-1]) * 1e-9
    assert 1.5 / POSES < late
    peer.until(lambda: "loads without a frame_id are taken in 'world'" in node.output, "log")
    # A machine that holds up the publisher may stretch the first intervals.
    line = re.compile(r"poses of start come 0\.[12]\d* s apart; to move between them")
    peer.until(lambda: line.search(node.output), "log")
