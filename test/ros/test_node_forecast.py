"""Plans are forecast in other processes while the node ticks."""

from __future__ import annotations

import os
from collections.abc import Callable
from pathlib import Path

import pytest

pytest.importorskip("rclpy", reason="needs rclpy: pip install 'dlo_sim[ros]'")

from geometry_msgs.msg import PoseArray, PoseStamped, Transform
from node_harness import HELD, NodeProcess, Peer
from sensor_msgs.msg import PointCloud2
from trajectory_msgs.msg import MultiDOFJointTrajectory, MultiDOFJointTrajectoryPoint

PLANNED = {**HELD, "rate": 50, "forecast.processes": 2}
PLANS = MultiDOFJointTrajectory, "/dlo_sim/plan"


def plan(joint: str) -> MultiDOFJointTrajectory:
    """The gripper stays for a second."""
    message = MultiDOFJointTrajectory()
    message.joint_names = [joint]
    for second in (0, 1):
        point = MultiDOFJointTrajectoryPoint()
        point.transforms = [Transform()]
        point.time_from_start.sec = second
        message.points.append(point)
    return message


def children(process: int) -> list[str]:
    threads = Path(f"/proc/{process}/task").glob("*/children")
    return [child for thread in threads for child in thread.read_text().split()]


def test_plans_are_forecast_and_bad_ones_refused(
    started: Callable[..., NodeProcess], peer: Peer
) -> None:
    node = started(PLANNED)
    pose = PoseStamped()
    pose.pose.orientation.w = 1.0
    poses = peer.publisher(PoseStamped, "/gripper_pose")
    clouds = peer.collect(PointCloud2, "/dlo_sim/forecast")
    shapes = peer.collect(PoseArray, "/dlo_sim/control_points")
    with peer.repeating(poses, pose):
        peer.until(lambda: shapes, "a cable")
        with peer.repeating(peer.publisher(*PLANS), plan("start")):
            peer.until(lambda: len(clouds) > 5, "forecasts")
        with peer.repeating(peer.publisher(*PLANS), plan("elbow")):
            peer.status(
                "/dlo_sim: input /dlo_sim/plan", lambda _, s: "elbow" in s.message, "a refusal"
            )
        values = peer.status("/dlo_sim: forecast", lambda _, s: True, "forecasts")
    assert float(values["peak tension [N]"]) > 0.0
    assert int(values["plans forecast"]) > 5 and values["plans that failed"] == "0"
    assert [field.name for field in clouds[0].fields] == ["x", "y", "z", "u", "t", "tension"]
    assert clouds[0].width % 50 == 0 and clouds[0].width >= 20 * 50  # latency comes on top
    pids = children(node.process.pid)
    assert len(pids) >= 2
    assert node.stop() == 0
    peer.watched = None
    peer.until(
        lambda: not any(os.path.exists(f"/proc/{pid}") for pid in pids), "end of its processes"
    )
