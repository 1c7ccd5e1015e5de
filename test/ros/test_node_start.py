"""Starting: what a params file may say, what is refused with exit status 2 and one line."""

from __future__ import annotations

import os
import subprocess
import sys
from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest

from dlo_sim.ros import REFUSED

pytest.importorskip("rclpy", reason="needs rclpy: pip install 'dlo_sim[ros]'")

from diagnostic_msgs.msg import DiagnosticArray
from geometry_msgs.msg import PoseArray
from node_harness import CABLE, HELD, NodeProcess, Peer, write_params

QOS = "qos_overrides./dlo_sim/tip/wrench.subscription"
OUT = "qos_overrides./dlo_sim/control_points.publisher"


@pytest.mark.parametrize(
    ("bad", "named"),
    [
        ({"cable.lenght": 2.0}, "did you mean cable.length?"),
        ({"cable": {"length": 2.0}}, "is given twice"),
        ({"cable.length": "long"}, "cable.length"),
        ({"cable.length": float("nan")}, "cable.length"),
        ({"integrator.method": "forest_ruth", "damping.mass": 1.0}, "damping"),
        ({"qos_overrides./nowhere.subscription.depth": 5}, "qos_overrides./nowhere"),
        ({f"{QOS}.reliability": "fast"}, f"{QOS}.reliability: 'fast'"),
        ({f"{QOS}.depth": 0}, f"{QOS}.depth: 0"),
        ({f"{QOS}.history": ["keep_all"]}, f"{QOS}.history"),
        ({f"{QOS}.durability": "volatile"}, f"{QOS}.durability"),
        ({f"{OUT}.durability": "for ever"}, f"{OUT}.durability: 'for ever'"),
        ({f"{OUT}.history": "keep_all"}, f"{OUT}.history"),
    ],
)
def test_a_bad_parameter_is_refused(
    refusal: Callable[..., str], bad: dict[str, Any], named: str
) -> None:
    assert named in refusal({**CABLE, **bad})


IN_OTHER_NODE = ["--ros-args", "-r", "__node:=other", "-p", "loads.names:=[tip, force]"]
IN_OTHER_NODE += ["-p", "loads.force.type:=force"]


@pytest.mark.parametrize(
    ("arguments", "named"),
    [
        (["--ros-args", "--params-file", "/nowhere/scene.yaml"], "/nowhere/scene.yaml"),
        (["--ros-args", "--parms-file", "scene.yaml"], "--parms-file"),
        (["scene.yaml"], "scene.yaml"),
        (["--ros-args", "-p", "other:rate:=50.0"], "for /other, none for this one, /dlo_sim"),
        (
            [*IN_OTHER_NODE, "-r", "/other/tip/wrench:=/x", "-r", "/other/force:=/x"],
            "/x: stands for ~/tip/wrench",
        ),
    ],
)
def test_a_bad_argument_is_refused(
    refusal: Callable[..., str], arguments: list[str], named: str
) -> None:
    assert named in refusal(None, *arguments)


def test_a_params_file_for_other_nodes_is_refused_unless_told_otherwise(
    refusal: Callable[..., str], running: Callable[..., NodeProcess], peer: Peer, tmp_path: Path
) -> None:
    scene = tmp_path / "scene.yaml"
    scene.write_text("/dlo_sim:\n  ros__parameters: {rate: 50.0}\n", encoding="utf-8")
    arguments = ["--ros-args", "--params-file", str(scene), "-r", "__node:=left"]
    why = f"{scene}: holds parameters for /dlo_sim, none for this one, /left"
    line = refusal(None, *arguments)
    assert line.startswith(f"dlo_sim: error: {why}")
    assert "--allow-unmatched" in line
    node = running(None, "--allow-unmatched", *arguments, name="/left")
    assert why in node.output
    assert node.stop() == 0
    peer.watched = None


def test_every_start_goes_by_its_own_name(running: Callable[..., NodeProcess], peer: Peer) -> None:
    """Two nodes of one file, told apart by name; topics, services and diagnostics follow it."""
    remaps = ["__node:=left", "__ns:=/arm", "/gripper_pose:=/left/pose"]
    rules = [argument for remap in remaps for argument in ("-r", remap)]
    node = running(HELD, *rules, name="/arm/left")
    points = "/arm/left/control_points"
    peer.until(lambda: peer.node.count_publishers(points) == 1, "the publisher")
    peer.until(lambda: peer.node.count_subscribers("/left/pose") == 1, "the subscriber")
    assert peer.node.count_subscribers("/gripper_pose") == 0
    statuses = peer.collect(DiagnosticArray, "/diagnostics")
    peer.until(lambda: len(statuses) >= 2, "diagnostics")
    found = [status for array in statuses for status in array.status]
    names = {"/arm/left: node", "/arm/left: session", "/arm/left: input /left/pose"}
    assert {status.name for status in found} == names
    assert {status.hardware_id for status in found} == {"/arm/left"}
    stranger = peer.node.create_publisher(PoseArray, "/left/pose", 1)
    both = "/peer publishes geometry_msgs/msg/PoseArray on /left/pose, the input takes "
    both += "geometry_msgs/msg/PoseStamped"
    peer.status("/arm/left: node", lambda values, status: both in status.message, "both types")
    peer.node.destroy_publisher(stranger)
    peer.until(lambda: both in node.output, "a line in the log")
    assert node.stop() == 0


def test_the_command_is_the_node(tmp_path: Path, domain: int) -> None:
    """`dlo_sim node` passes everything after it on, and its exit status back."""
    command = [sys.executable, "-m", "dlo_sim", "node", "--ros-args", "-p", "cable.lenght:=2.0"]
    environment = {**os.environ, "ROS_DOMAIN_ID": str(domain)}
    done = subprocess.run(command, capture_output=True, text=True, env=environment, timeout=60)
    assert done.returncode == REFUSED
    assert "did you mean cable.length?" in done.stderr


def test_a_shipped_scene_starts_by_its_name_with_changes_as_users_write_them(
    started: Callable[..., NodeProcess], peer: Peer, tmp_path: Path
) -> None:
    """Integers, mixed and empty lists and what a YAML 1.1 parser makes of `on` are fine."""
    values = {"gravity": [0, 0, -9.5], "end.position": [2, 0, 0], "grasps.names": []}
    params = str(write_params(tmp_path, {**values, "terms.bend": True}))
    scene = ("--scene", "paper_wire_force", "--ros-args", "--params-file", params)
    started(None, *scene, "-p", "rate:=50")
    received = peer.collect(PoseArray, "/dlo_sim/control_points", depth=1)
    peer.until(lambda: received, "control points")
    names = ("rate", "loads.names", "cable.diameter", "end.position", "gravity", "terms.bend")
    found = [50.0, ["centre"], 0.002, [2.0, 0.0, 0.0], [0.0, 0.0, -9.5], "on"]
    assert peer.get(*names, "grasps.names") == [*found, []]
    assert len(received[-1].poses) == peer.get("discretization.control_points")[0]
