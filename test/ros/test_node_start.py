"""Starting: what a params file may say, what is refused with exit status 2 and one line."""

from __future__ import annotations

import os
import subprocess
import sys
from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest

from dlo_sim.ros import main as node_main

pytest.importorskip("rclpy", reason="needs rclpy: pip install 'dlo_sim[ros]'")

from geometry_msgs.msg import PoseArray
from node_harness import CABLE, HELD, START, NodeProcess, Peer


@pytest.mark.parametrize(
    ("bad", "named"),
    [
        ({"cable.lenght": 2.0}, "did you mean cable.length?"),
        ({"cable.length": -2.0}, "cable.length"),
        ({"cable": {"length": 2.0}}, "is given twice"),
        ({"cable.length": "long"}, "cable.length"),
        ({"cable.length": float("nan")}, "cable.length"),
        ({"start.fixed": [True, True]}, "start.fixed"),
        ({"start.fixed": [True, True, False]}, "start.clamped"),
        ({"loads.belly.position": 0.5}, "loads.names"),
        ({"integrator.method": "euler"}, "integrator.method"),
        ({"integrator.method": "forest_ruth", "damping.mass": 1.0}, "damping"),
        ({"qos_overrides./nowhere.subscription.depth": 5}, "qos_overrides./nowhere"),
    ],
)
def test_a_bad_parameter_is_refused(
    launch: Callable[..., NodeProcess], bad: dict[str, Any], named: str
) -> None:
    node = launch({**CABLE, **bad})
    assert node.wait(START) == node_main.REFUSED
    refusals = [line for line in node.output.splitlines() if line.startswith("dlo_sim: error:")]
    assert len(refusals) == 1, node.output
    assert named in refusals[0]
    assert "Traceback" not in node.output


@pytest.mark.parametrize(
    ("arguments", "named"),
    [
        (["--ros-args", "--params-file", "/nowhere/scene.yaml"], "/nowhere/scene.yaml"),
        (["--ros-args", "--parms-file", "scene.yaml"], "--parms-file"),
        (["scene.yaml"], "scene.yaml"),
    ],
)
def test_a_bad_argument_is_refused(
    launch: Callable[..., NodeProcess], arguments: list[str], named: str
) -> None:
    node = launch(None, *arguments)
    assert node.wait() == node_main.REFUSED
    assert named in node.output.splitlines()[-1]
    assert "Traceback" not in node.output


def test_integers_mixed_lists_and_empty_lists_are_fine(
    started: Callable[..., NodeProcess], peer: Peer
) -> None:
    values = {
        **CABLE,
        "cable.length": 1,
        "gravity": [0, 0, -9.5],
        "end.position": [2, 0, 0],
        "terms.bend": True,  # what a YAML 1.1 parser makes of: on
        "loads.names": [],
        "cable.rest_curvature": [0, 0.5],
    }
    started({key: value for key, value in values.items() if not key.startswith("loads.force")})
    names = ("cable.length", "gravity", "end.position", "terms.bend", "loads.names")
    assert peer.get(*names) == [1.0, [0.0, 0.0, -9.5], [2.0, 0.0, 0.0], "on", []]


def test_every_start_goes_by_its_own_name(launch: Callable[..., NodeProcess], peer: Peer) -> None:
    """Two nodes of one file, told apart by name; topics and services follow it."""
    node = launch(HELD, "-r", "__node:=left", "-r", "/gripper_pose:=/left/pose")
    peer.watched = node
    peer.until(lambda: peer.node.count_services("/left/reset"), "node", START)
    topics = [name for name, _ in peer.node.get_topic_names_and_types()]
    assert "/left/control_points" in topics
    assert peer.node.count_subscribers("/left/pose") == 1
    assert peer.node.count_subscribers("/gripper_pose") == 0
    assert node.stop() == 0


def test_the_command_is_the_node(tmp_path: Path, domain: int) -> None:
    """`dlo_sim node` passes everything after it on, and its exit status back."""
    command = [sys.executable, "-m", "dlo_sim", "node", "--ros-args", "-p", "cable.lenght:=2.0"]
    environment = {**os.environ, "ROS_DOMAIN_ID": str(domain)}
    done = subprocess.run(command, capture_output=True, text=True, env=environment, timeout=60)
    assert done.returncode == node_main.REFUSED
    assert "did you mean cable.length?" in done.stderr


def test_shipped_scenes_start(
    started: Callable[..., NodeProcess], peer: Peer, checkout: Path
) -> None:
    scene = checkout / "config" / "paper_wire_force.yaml"
    started({}, "--params-file", str(scene))
    received = peer.collect(PoseArray, "/dlo_sim/control_points", depth=1)
    peer.until(lambda: received, "control points")
    assert len(received[-1].poses) == peer.get("discretization.control_points")[0]


def test_pages_stay_in_memory_where_that_is_allowed(
    started: Callable[..., NodeProcess], peer: Peer
) -> None:
    """What another process of the same user may lock, the node has locked."""
    probe = "from dlo_sim.ros.residence import settle; raise SystemExit(0 if settle() else 1)"
    allowed = subprocess.run([sys.executable, "-c", probe], check=False).returncode == 0
    node = started(HELD)
    peer.status("dlo_sim: node", lambda values, status: True, "the first report")
    status = Path(f"/proc/{node.process.pid}/status").read_text()
    locked = [int(line.split()[1]) for line in status.splitlines() if line.startswith("VmLck")]
    assert (locked[0] > 1000) == allowed  # kB
