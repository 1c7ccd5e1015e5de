"""The node as a lifecycle node, driven by ROS's own services."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from pathlib import Path

import pytest

pytest.importorskip("rclpy", reason="needs rclpy: pip install 'dlo_sim[ros]'")

from geometry_msgs.msg import PoseArray
from lifecycle_msgs.msg import Transition
from lifecycle_msgs.srv import ChangeState, GetState
from node_harness import CABLE, START, NodeProcess, Peer

MANAGED = {**CABLE, "lifecycle": True}


class Managed:
    """What a lifecycle manager does with the node."""

    def __init__(self, peer: Peer, node: NodeProcess) -> None:
        self._peer = peer
        self.node = node
        self.points = peer.collect(PoseArray, "/dlo_sim/control_points")

    def change(self, name: str) -> str:
        """Ask for a transition; the state afterwards, and ! before it if it was not made."""
        request = ChangeState.Request()
        request.transition.id = getattr(Transition, f"TRANSITION_{name.upper()}")
        done = self._peer.call(ChangeState, "/dlo_sim/change_state", request, START).success
        return ("" if done else "!") + self.state

    @property
    def state(self) -> str:
        found = self._peer.call(GetState, "/dlo_sim/get_state", GetState.Request())
        return found.current_state.label

    def moves(self) -> int:
        """Wait for new control points; the stamp of the first [ns]."""
        self.points.clear()
        self._peer.until(lambda: len(self.points) > 3, "control points")
        stamps = [m.header.stamp.sec * 10**9 + m.header.stamp.nanosec for m in self.points]
        assert stamps == sorted(set(stamps))
        return stamps[0]


@pytest.fixture
def managed(launch: Callable[..., NodeProcess], peer: Peer) -> Iterator[Callable[..., Managed]]:
    nodes: list[NodeProcess] = []

    def start(**changes: object) -> Managed:
        node = launch({**MANAGED, **changes})
        nodes.append(node)
        peer.watched = node
        peer.until(lambda: peer.node.count_services("/dlo_sim/change_state"), "node", START)
        return Managed(peer, node)

    yield start
    peer.watched = None
    for node in nodes:
        node.end()
    peer.until(lambda: not peer.node.count_services("/dlo_sim/change_state"), "the end")


def lowest(message: PoseArray) -> float:
    return min(pose.position.z for pose in message.poses)


def test_configure_compiles_activate_ticks_deactivate_keeps_the_state(
    managed: Callable[..., Managed], peer: Peer
) -> None:
    node = managed()
    assert node.state == "unconfigured"
    assert not peer.node.count_publishers("/dlo_sim/control_points")
    assert node.change("activate") == "!unconfigured"
    assert node.change("configure") == "inactive"
    peer.until(lambda: "ready after" in node.node.output, "a line in the log")
    peer.until(lambda: peer.node.count_publishers("/dlo_sim/control_points") == 1, "publisher")
    assert node.points == []
    assert node.change("activate") == "active"
    peer.until(lambda: node.points and lowest(node.points[-1]) < -0.1, "a cable that sags")
    assert node.change("deactivate") == "inactive"
    count, held = len(node.points), node.points[-1]
    assert node.change("activate") == "active"
    peer.until(lambda: len(node.points) > count, "control points")
    assert lowest(node.points[count]) == pytest.approx(lowest(held), abs=0.05)

    # A change while it is configured lasts; what fixes topics can change after a cleanup alone.
    assert peer.set({"cable.length": 0.5}).successful
    refused = peer.set({"frame_id": "base"})
    assert "frame_id: cannot change while the node is configured" in refused.reason
    assert node.change("deactivate") == "inactive"
    assert node.change("cleanup") == "unconfigured"
    peer.until(lambda: not peer.node.count_publishers("/dlo_sim/control_points"), "no publisher")
    assert peer.get("cable.length", "start.tangent") == [0.5, [1.0, 0.0, 0.0]]
    assert peer.set({"frame_id": "base", "loads.names": ["force"]}).successful
    assert (node.change("configure"), node.change("activate")) == ("inactive", "active")
    node.moves()
    assert node.points[-1].header.frame_id == "base"
    assert peer.get("cable.length", "loads.names") == [0.5, ["force"]]
    peer.until(lambda: not peer.node.count_subscribers("/dlo_sim/tip/wrench"), "no such input")
    assert node.change("active_shutdown") == "finalized"
    peer.until(lambda: not peer.node.count_services("/dlo_sim/reset"), "the end of its services")
    assert node.node.stop() == 0
    assert "Traceback" not in node.node.output


def test_a_refused_configure_can_be_mended(
    managed: Callable[..., Managed], peer: Peer, tmp_path: Path
) -> None:
    bad = {"cable.length": "long", "state.save_to": "/no/where", "integrator.method": "forest_ruth"}
    bad["cable.lenght"] = 2.0
    mended = {"cable.length": 0.6, "state.save_to": str(tmp_path / "state")}
    mended["integrator.method"] = "auto"
    mended["cable.lenght"] = None  # delete it
    node = managed(**bad)
    left = dict(bad)
    while left:
        assert node.change("configure") == "!unconfigured"
        (key,) = peer.until(
            lambda: [key for key in left if f"refused: {key}: " in node.node.output], "a refusal"
        )
        assert peer.get(key) == [left.pop(key)]
        assert peer.set({key: mended[key]}).successful
    assert not peer.node.count_services("/dlo_sim/reset")
    assert node.change("configure") == "inactive"
    assert node.change("activate") == "active"
    node.moves()
    assert peer.get(*mended) == list(mended.values())
    assert (node.change("deactivate"), node.change("cleanup")) == ("inactive", "unconfigured")
    assert node.change("configure") == "inactive"  # the file is free again
    assert node.node.stop() == 0
