"""The node with tf2, played by a stand-in module of that name, and without it."""

from __future__ import annotations

import os
import sys
from collections.abc import Callable
from pathlib import Path

import pytest

pytest.importorskip("rclpy", reason="needs rclpy: pip install 'dlo_sim[ros]'")

from diagnostic_msgs.msg import DiagnosticArray
from geometry_msgs.msg import PoseArray, PoseStamped
from node_harness import HELD, NodeProcess, Peer

# `tool0` moves along y and is known up to 10 ms ago; nothing else is known.
STAND_IN = '''
from geometry_msgs.msg import TransformStamped
from rclpy.clock import Clock

PERIOD = 10_000_000

class TransformException(Exception):
    """As of tf2."""

class Buffer:
    def lookup_transform(self, target_frame, source_frame, time):
        newest = (Clock().now().nanoseconds - PERIOD) // PERIOD * PERIOD
        at = time.nanoseconds or newest
        if (target_frame, source_frame) != ("world", "tool0"):
            raise TransformException(f'"{source_frame}" does not exist.\\n')
        if at > newest:
            raise TransformException("Lookup would require extrapolation into the future.")
        found = TransformStamped()
        found.header.stamp.sec, found.header.stamp.nanosec = divmod(at, 1_000_000_000)
        found.transform.translation.x = 2.0
        found.transform.translation.y = at % 1_000_000_000_000 * 1e-12
        found.transform.rotation.w = 1.0
        return found

    def clear(self):
        pass

class TransformListener:
    def __init__(self, buffer, node):
        assert isinstance(buffer, Buffer) and node.get_name() == "dlo_sim"

    def unregister(self):
        pass
'''


@pytest.fixture
def tf2(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Callable[[str], None]:
    """`tf2(text)`: what `import tf2_ros` runs in nodes that are started from now on."""

    def write(text: str) -> None:
        (tmp_path / "tf2_ros.py").write_text(text, encoding="utf-8")
        path = [str(tmp_path), *filter(None, [os.environ.get("PYTHONPATH")])]
        monkeypatch.setenv("PYTHONPATH", os.pathsep.join(path))

    return write


def test_an_end_follows_a_frame(
    started: Callable[..., NodeProcess], peer: Peer, tf2: Callable[[str], None]
) -> None:
    tf2(STAND_IN)
    values = {key: value for key, value in HELD.items() if key != "start.pose_topic"}
    node = started({**values, "start.tf_frame": "tool0", "rate": 50})
    shapes = peer.collect(PoseArray, "/dlo_sim/control_points")
    peer.until(lambda: len(shapes) > 20, "a cable")
    for shape in shapes[5:]:
        stamp = shape.header.stamp.sec * 1_000_000_000 + shape.header.stamp.nanosec
        first = shape.poses[0].position
        assert first.x == pytest.approx(2.0)
        assert first.y == pytest.approx(stamp % 1_000_000_000_000 * 1e-12, abs=1e-6)
    assert "waiting for the first pose" not in node.output


def test_a_pose_is_taken_from_its_frame_and_refused_where_tf2_does_not_know_it(
    started: Callable[..., NodeProcess], peer: Peer, tf2: Callable[[str], None]
) -> None:
    tf2(STAND_IN)
    started({**HELD, "inputs.tf": True, "rate": 50})
    poses = peer.publisher(PoseStamped, "/gripper_pose")
    shapes = peer.collect(PoseArray, "/dlo_sim/control_points")
    reports = peer.collect(DiagnosticArray, "/diagnostics")
    message = PoseStamped()
    message.header.frame_id = "tool0"
    message.pose.position.z = 0.5
    message.pose.orientation.w = 1.0

    def refusals() -> set[str]:
        values = [v for report in reports for status in report.status for v in status.values]
        return {value.value for value in values if value.key == "last refusal"}

    with peer.repeating(poses, message):
        peer.until(lambda: len(shapes) > 5, "a cable")
        message.header.frame_id = "camera"
        peer.until(refusals, "a refusal")
    first = shapes[0].poses[0].position
    assert (first.x, first.z) == pytest.approx((2.0, 0.5))
    assert refusals() == {
        "no_transform: frame_id 'camera': \"camera\" does not exist; publish where it is in world, "
        "or raise inputs.latency"
    }


def test_without_tf2_a_scene_that_asks_for_it_is_refused(
    refusal: Callable[..., str], tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    (tmp_path / "tf2_ros.py").write_text("raise ImportError('no tf2 here')", encoding="utf-8")
    monkeypatch.delitem(sys.modules, "tf2_ros", raising=False)
    monkeypatch.syspath_prepend(tmp_path)
    assert refusal({**HELD, "inputs.tf": True, "outputs.tf": True}) == (
        "dlo_sim: error: inputs.tf, outputs.tf: needs tf2, which cannot be imported (no tf2 here); "
        "install it with: apt install ros-jazzy-tf2-ros-py, or remove what asks for it"
    )
