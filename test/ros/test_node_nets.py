"""A node with a net: topics of every cable, parameters of a branch that change while it runs."""

from __future__ import annotations

from collections.abc import Callable

import pytest

pytest.importorskip("rclpy", reason="needs rclpy: pip install 'dlo_sim[ros]'")

from geometry_msgs.msg import PoseArray, PoseStamped, WrenchStamped
from harness import VALUES
from node_harness import NodeProcess, Peer
from rclpy.qos import DurabilityPolicy, QoSProfile
from visualization_msgs.msg import Marker

from dlo_sim.ros.topics import output_qos
from dlo_sim.scene.loading import scene_from_values
from dlo_sim.session.topics import CENTERLINE, CONTROL_POINTS
from dlo_sim.simulation.simulator import Simulator

LIVE = {key: value for key, value in VALUES.items() if not key.endswith((".frame", "_topic"))}


@pytest.fixture(scope="module", autouse=True)
def node(running: Callable[..., NodeProcess]) -> NodeProcess:
    return running({**LIVE, "branches.a.end.pose_topic": "/a"})


@pytest.fixture(scope="module", autouse=True)
def driven(peer: Peer, node: NodeProcess) -> None:
    """The gripper at the end of a branch has told where it is."""
    message = PoseStamped()
    message.pose.position.x, message.pose.position.z = 0.3, -0.3
    message.pose.orientation.w = 1.0
    with peer.repeating(peer.publisher(PoseStamped, "/a"), message):
        peer.status("/dlo_sim: session", lambda values, _: values["status"] == "running", "a run")


def test_every_cable_has_its_topics(peer: Peer) -> None:
    curves = Simulator(scene_from_values(VALUES)).curves.values()
    for name, curve in zip(("", "branches/a/", "branches/b/", "cables/c/"), curves, strict=True):
        received = peer.collect(PoseArray, f"/dlo_sim/{name}control_points")
        peer.until(lambda got=received: got, f"control points of {name or 'the main cable'}")
        assert len(received[-1].poses) == len(curve.greville)
    others = {"branches/a/end/reaction": WrenchStamped, "connectors/plug/pose": PoseStamped}
    for topic, kind in others.items():
        received = peer.collect(kind, f"/dlo_sim/{topic}")
        peer.until(lambda got=received: got, topic)


def test_a_late_viewer_gets_the_lines_of_all_cables(peer: Peer) -> None:
    """The newest of each, as they share a topic."""
    stays = DurabilityPolicy.TRANSIENT_LOCAL
    received: list[Marker] = []
    qos = QoSProfile(depth=10, durability=stays)
    peer.node.create_subscription(Marker, "/dlo_sim/centerline", received.append, qos)
    peer.until(lambda: len({marker.ns for marker in received}) == 4, "lines of four cables")
    assert output_qos(CENTERLINE, 4).depth == 4 and output_qos(CONTROL_POINTS, 4).depth == 1


def test_a_branch_is_stiffened_while_it_runs(peer: Peer) -> None:
    change = {"branches.a.cable.bending_stiffness": 0.05, "branches.b.cable.diameter": 0.02}
    assert peer.set(change).successful
    assert peer.get(*change) == list(change.values())
    refused = peer.set({"branches.a.from": "b"})
    assert not refused.successful and "branches.a.from" in refused.reason
    peer.status("/dlo_sim: session", lambda values, _: values["status"] == "running", "a run")
