"""The real `ros2 run` and `ros2 launch` on an installed package."""

from __future__ import annotations

import contextlib
import os
import shutil
import signal
import subprocess
import sys
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import TYPE_CHECKING

import pytest

pytest.importorskip("rclpy", reason="needs rclpy: pip install 'dlo_sim[ros]'")

from node_harness import SOON, START
from visualization_msgs.msg import Marker

if TYPE_CHECKING:
    from node_harness import Peer

# Where its environment is not activated, the command lies beside the interpreter.
_PATH = os.pathsep.join([str(Path(sys.executable).parent), os.environ.get("PATH", "")])
ROS2 = shutil.which("ros2", path=_PATH)

pytestmark = pytest.mark.skipif(ROS2 is None, reason="needs the command ros2, of a ROS 2 Jazzy")

SCENE = """\
/**:
  ros__parameters:
    cable: {length: 0.4}
    start: {clamped: true, tangent: [1.0, 0.0, 0.0]}
    damping: {stiffness: 0.01}
    discretization: {control_points: 7}
    outputs: {color_by: curvature}
"""

Run = Callable[..., "subprocess.Popen[bytes]"]


@pytest.fixture
def ros2(installed: Path, domain: int, tmp_path: Path) -> Iterator[Run]:
    """`ros2(*arguments)`: the command in the background; what it says goes to log.txt."""
    paths = [str(installed), *filter(None, [os.environ.get("AMENT_PREFIX_PATH")])]
    environment = {
        **os.environ,
        "PATH": _PATH,
        "AMENT_PREFIX_PATH": os.pathsep.join(paths),
        "ROS_DOMAIN_ID": str(domain),
        "ROS_LOG_DIR": str(tmp_path),
    }
    started: list[subprocess.Popen[bytes]] = []

    def start(*arguments: str) -> subprocess.Popen[bytes]:
        with (tmp_path / "log.txt").open("wb") as log:
            command = [str(ROS2), *arguments]
            process = subprocess.Popen(
                command, env=environment, stdout=log, stderr=log, start_new_session=True
            )
        started.append(process)
        return process

    yield start
    for process in started:
        with contextlib.suppress(ProcessLookupError):
            os.killpg(process.pid, signal.SIGKILL)
        process.wait(SOON)


@pytest.fixture
def scene(tmp_path: Path) -> str:
    path = tmp_path / "scene.yaml"
    path.write_text(SCENE, encoding="utf-8")
    return str(path)


def seen(peer: Peer, log: Path) -> Marker:
    """The first marker of the centerline."""
    markers = peer.collect(Marker, "/dlo_sim/centerline")
    try:
        peer.until(lambda: markers and markers[-1].points, "centerline", START)
    except AssertionError as error:
        raise AssertionError(f"{error}\n{log.read_text()}") from None
    return markers[-1]


@pytest.mark.parametrize(
    "command",
    [
        ("run", "dlo_sim", "node", "--scene", "{scene}"),
        ("launch", "dlo_sim", "cable.launch.py", "scene:={scene}"),
    ],
    ids=["run", "launch"],
)
def test_node_runs_and_ends(
    ros2: Run, peer: Peer, scene: str, tmp_path: Path, command: tuple[str, ...]
) -> None:
    process = ros2(*(word.format(scene=scene) for word in command))
    marker = seen(peer, tmp_path / "log.txt")
    assert marker.header.frame_id == "world"
    assert len(marker.colors) == len(marker.points) == 50
    os.killpg(process.pid, signal.SIGINT)  # as Ctrl-C in a terminal does
    assert process.wait(SOON) == 0
    peer.until(lambda: not peer.node.count_publishers("/dlo_sim/centerline"), "end of the node")


LIFECYCLE = """\
from launch import LaunchDescription
from launch.actions import EmitEvent, RegisterEventHandler
from launch.events import matches_action
from launch_ros.actions import LifecycleNode
from launch_ros.event_handlers import OnStateTransition
from launch_ros.events.lifecycle import ChangeState

def generate_launch_description():
    values = ["{scene}", {{"lifecycle": True}}]
    names = dict(package="dlo_sim", executable="node", name="dlo_sim", namespace="")
    node = LifecycleNode(**names, parameters=values)
    configure, activate = (
        EmitEvent(event=ChangeState(lifecycle_node_matcher=matches_action(node), transition_id=k))
        for k in (1, 3)
    )
    then = OnStateTransition(target_lifecycle_node=node, goal_state="inactive", entities=[activate])
    return LaunchDescription([node, RegisterEventHandler(then), configure])
"""


def test_launch_brings_a_lifecycle_node_to_active(
    ros2: Run, peer: Peer, scene: str, tmp_path: Path
) -> None:
    """It configures, waits for the transition, and activates."""
    (tmp_path / "managed.launch.py").write_text(LIFECYCLE.format(scene=scene), encoding="utf-8")
    process = ros2("launch", str(tmp_path / "managed.launch.py"))
    seen(peer, tmp_path / "log.txt")
    peer.until(lambda: peer.node.count_services("/dlo_sim/change_state") == 1, "its services")
    os.killpg(process.pid, signal.SIGINT)
    assert process.wait(SOON) == 0
    peer.until(lambda: not peer.node.count_publishers("/dlo_sim/centerline"), "end of the node")


def test_launch_ends_with_a_node_that_refuses_its_scene(ros2: Run, tmp_path: Path) -> None:
    process = ros2("launch", "dlo_sim", "cable.launch.py", "scene:=two_gripers")
    process.wait(SOON)
    said = (tmp_path / "log.txt").read_text()
    assert "did you mean two_grippers?" in said
    assert "shutting down launched system" in said


def test_launch_starts_rviz_only_where_it_is_wanted(ros2: Run, tmp_path: Path) -> None:
    """RViz is not there: asked for, the launch refuses it by name."""
    if shutil.which("rviz2", path=_PATH):
        pytest.skip("would open a window")
    process = ros2("launch", "dlo_sim", "cable.launch.py", "rviz:=true")
    assert process.wait(SOON) == 1
    assert "package 'rviz2' not found" in (tmp_path / "log.txt").read_text()
