"""A node that is killed goes on from its state file when it is started again."""

from __future__ import annotations

import os
import signal
from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest

pytest.importorskip("rclpy", reason="needs rclpy: pip install 'dlo_sim[ros]'")

from geometry_msgs.msg import PoseArray, PoseStamped
from node_harness import HELD, START

from dlo_sim.scene.loading import SceneError, scene_from_values
from dlo_sim.session import saved_state


def swinging(peer: Any) -> PoseStamped:
    """A pose of now that turns the clamp upwards, so that the cable's shape tells old from new."""
    message = PoseStamped()
    message.header.stamp = peer.node.get_clock().now().to_msg()
    message.header.frame_id = "world"
    message.pose.position.x = 0.3
    message.pose.orientation.w = 1.0
    return message


def test_killed_node_goes_on(launch: Any, peer: Any, tmp_path: Path) -> None:
    path = tmp_path / "state"
    # So much damping that the cable falls without swinging up again.
    values = {**HELD, "state.save_to": str(path), "initial.shape": "straight", "damping.mass": 10}
    poses = peer.node.create_publisher(PoseStamped, "/gripper_pose", 10)
    timer = peer.node.create_timer(0.02, lambda: poses.publish(swinging(peer)))
    shapes = peer.collect(PoseArray, "/dlo_sim/control_points")
    node = peer.watched = launch(values)
    peer.until(path.is_file, "state file", START)
    # Placed straight, the cable's end falls; wait until a state is saved in which it hangs.
    peer.until(lambda: shapes and shapes[-1].poses[-1].position.z < -0.3, "fall", START)
    written = path.stat().st_mtime_ns
    peer.until(lambda: path.stat().st_mtime_ns > written, "newer state")
    assert node.stop(signal.SIGKILL) == -signal.SIGKILL
    shapes.clear()

    again = peer.watched = launch(values)
    first = peer.until(lambda: shapes and shapes[0], "control points", START)
    assert first.poses[-1].position.z < -0.2, "a cable that is placed begins straight"
    peer.until(lambda: "goes on from the state saved" in again.output, "the line that says so")
    peer.status("/dlo_sim: session", lambda v, _: v.get("event resumed") == "1", "resumed")
    peer.watched = None
    assert again.stop(signal.SIGINT) == 0
    assert [entry.name for entry in tmp_path.iterdir()] == ["state"], "no leftovers"
    peer.node.destroy_timer(timer)
    peer.node.destroy_publisher(poses)


@pytest.mark.parametrize(
    ("changes", "complaint"),
    [
        ({"cable.length": 0.7}, "is no saved state"),
        ({"state.save_to": "/nowhere/state"}, "the folder /nowhere does not exist; create it"),
    ],
)
def test_state_that_cannot_be_used_is_refused(
    refusal: Callable[..., str], tmp_path: Path, changes: dict[str, Any], complaint: str
) -> None:
    path = tmp_path / "state"
    path.write_bytes(b"something else")
    assert complaint in refusal({**HELD, "state.save_to": str(path), **changes})
    assert path.read_bytes() == b"something else"


@pytest.mark.parametrize(
    ("place", "writable", "text"),
    [
        ("", True, "is a folder; give a file in it"),
        ("pipe", True, "is a device, a pipe or a link to nowhere; give the name of a file"),
        ("loop", True, "is a device, a pipe or a link to nowhere; give the name of a file"),
        ("none/state", True, "/none does not exist; create it first"),
        ("state", False, "nothing can be written in .*; give another folder"),
    ],
)
def test_a_place_for_no_file_is_refused(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, place: str, writable: bool, text: str
) -> None:
    os.mkfifo(tmp_path / "pipe")
    (tmp_path / "loop").symlink_to("loop")
    monkeypatch.setattr(saved_state.os, "access", lambda folder, mode: writable)
    scene = scene_from_values({"state.save_to": str(tmp_path / place)})
    with pytest.raises(SceneError, match=f"^state.save_to: .*{text}$"):
        saved_state.StateKeeper(scene, None).found(scene)


def test_two_cables_do_not_share_a_file(tmp_path: Path) -> None:
    scene = scene_from_values({"state.save_to": str(tmp_path / "state")})
    (tmp_path / "link").symlink_to(tmp_path)
    linked = scene.with_values({"state.save_to": str(tmp_path / "link" / "state")})
    one, other = (saved_state.StateKeeper(given, None) for given in (scene, linked))
    assert one.found(scene) is None
    with pytest.raises(SceneError, match="state is the file of another cable; give each its own"):
        other.found(scene)
    one.release()
    assert other.found(scene) is None
    other.release()
