"""QoS that a scene overrides, as subscribers and publishers that demand it meet it."""

from __future__ import annotations

from collections.abc import Callable

import pytest

pytest.importorskip("rclpy", reason="needs rclpy: pip install 'dlo_sim[ros]'")

from diagnostic_msgs.msg import DiagnosticArray
from geometry_msgs.msg import PoseArray, WrenchStamped
from node_harness import CABLE, NodeProcess, Peer
from rclpy.qos import DurabilityPolicy, QoSProfile, ReliabilityPolicy
from visualization_msgs.msg import MarkerArray

KEPT = 2
QOS = {
    "qos_overrides./diagnostics.publisher.durability": "transient_local",
    "qos_overrides./diagnostics.publisher.depth": KEPT,
    "qos_overrides./dlo_sim/control_points.publisher.reliability": "best_effort",
    "qos_overrides./dlo_sim/start/reaction.publisher.durability": "volatile",
    "qos_overrides./dlo_sim/tip/wrench.subscription.reliability": "reliable",
}


@pytest.fixture(scope="module", autouse=True)
def node(running: Callable[..., NodeProcess]) -> NodeProcess:
    return running({**CABLE, **QOS})


def test_each_topic_has_the_qos_that_was_asked_for(peer: Peer) -> None:
    assert peer.get(*QOS) == list(QOS.values())
    live = peer.collect(DiagnosticArray, "/diagnostics")
    peer.until(lambda: len(live) > 3 * KEPT, "diagnostics")

    # Only for what is kept for late readers does a subscriber that demands it match.
    late = QoSProfile(depth=10 * KEPT, durability=DurabilityPolicy.TRANSIENT_LOCAL)

    def kept() -> int:
        """How many of before it gets; they are gone if matching it takes seconds."""
        old: list[DiagnosticArray] = []
        subscribed = peer.node.get_clock().now().to_msg()
        peer.node.create_subscription(DiagnosticArray, "/diagnostics", old.append, late)
        peer.until(lambda: old and old[-1].header.stamp.sec > subscribed.sec, "newer diagnostics")
        own = [a for a in old if a.status[0].name.startswith("/dlo_sim: ")]
        return sum(a.header.stamp.sec <= subscribed.sec for a in own)

    before = peer.until(kept, "an older one")
    assert before <= KEPT + 2

    points = [peer.collect(PoseArray, "/dlo_sim/control_points")]
    reactions = [peer.collect(WrenchStamped, "/dlo_sim/start/reaction")]
    for message_type, topic, found, qos in (
        (PoseArray, "control_points", points, {"reliability": ReliabilityPolicy.BEST_EFFORT}),
        (WrenchStamped, "start/reaction", reactions, {"durability": late.durability}),
    ):
        found.append([])
        profile = QoSProfile(depth=10, **qos)
        peer.node.create_subscription(message_type, f"/dlo_sim/{topic}", found[1].append, profile)
    peer.until(lambda: len(points[1]) > 10 and len(reactions[0]) > 10, "outputs")
    assert points[0] == reactions[1] == []  # they demand what is not offered any more


def test_an_override_is_for_its_own_topic_alone(peer: Peer) -> None:
    polygon = "/dlo_sim/control_polygon"
    (kept,) = peer.until(lambda: peer.node.get_publishers_info_by_topic(polygon), "the publisher")
    assert kept.qos_profile.durability == DurabilityPolicy.TRANSIENT_LOCAL
    assert kept.qos_profile.reliability == ReliabilityPolicy.RELIABLE
    for topic, reliability in (
        ("tip/wrench", ReliabilityPolicy.RELIABLE),
        ("force", ReliabilityPolicy.BEST_EFFORT),
    ):
        found = peer.until(
            lambda name=f"/dlo_sim/{topic}": peer.node.get_subscriptions_info_by_topic(name), topic
        )
        assert [info.qos_profile.reliability for info in found] == [reliability]


def test_markers_of_obstacles_that_are_not_used_are_said(peer: Peer, node: NodeProcess) -> None:
    assert "contact.markers" not in node.output
    peer.node.create_publisher(MarkerArray, "/dlo_sim/obstacles", 1)
    peer.until(lambda: "contact.markers is 0; set it" in node.output, "warning")
