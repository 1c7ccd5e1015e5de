"""What the node publishes and takes in, between two processes, with ROS's own message classes."""

from __future__ import annotations

import math
from collections.abc import Callable

import numpy as np
import pytest

pytest.importorskip("rclpy", reason="needs rclpy: pip install 'dlo_sim[ros]'")

from diagnostic_msgs.msg import DiagnosticStatus
from geometry_msgs.msg import PoseArray, Vector3Stamped, WrenchStamped
from node_harness import CABLE, NodeProcess, Peer
from visualization_msgs.msg import Marker

from dlo_sim.core import bspline


@pytest.fixture(scope="module", autouse=True)
def node(running: Callable[..., NodeProcess]) -> NodeProcess:
    return running(CABLE)


def test_control_points_come_in_order_and_hang_from_the_start(peer: Peer) -> None:
    received = peer.collect(PoseArray, "/dlo_sim/control_points")
    peer.until(lambda: len(received) >= 10, "control points")
    stamps = [m.header.stamp.sec + m.header.stamp.nanosec * 1e-9 for m in received]
    assert stamps == sorted(stamps)
    assert stamps[-1] > stamps[0]
    now = peer.node.get_clock().now().nanoseconds * 1e-9
    assert 0.0 < now - stamps[-1] < 10.0
    last = received[-1]
    assert last.header.frame_id == "world"
    assert len(last.poses) == CABLE["discretization.control_points"]
    assert last.poses[0].position.x == 0.0
    places = np.array([(p.position.x, p.position.y, p.position.z) for p in last.poses])
    # However the cable swings, the centreline of these control points keeps its length.
    knots = bspline.clamped_knots(len(places), CABLE["cable.length"])
    line = bspline.evaluate(places, knots, np.linspace(0.0, CABLE["cable.length"], 401))
    along = np.linalg.norm(np.diff(line, axis=0), axis=1).sum()
    assert along == pytest.approx(CABLE["cable.length"], rel=0.01)
    x, y, z = places[1]  # on the clamp's tangent, however the rest swings
    assert 0.05 < x < 0.2 and abs(y) < 1e-9 and abs(z) < 1e-9
    assert last.poses[-1].position.z < 0.0  # it sags
    for pose in last.poses:
        q = pose.orientation
        assert math.hypot(q.x, q.y, q.z, q.w) == pytest.approx(1.0, abs=1e-12)


def test_markers_show_the_line_and_the_polygon(peer: Peer) -> None:
    lines = peer.collect(Marker, "/dlo_sim/centerline")
    polygons = peer.collect(Marker, "/dlo_sim/control_polygon")
    peer.until(lambda: len(lines) >= 3 and len(polygons) >= 3, "markers")
    line, polygon = lines[-1], polygons[-1]
    assert (line.type, line.action) == (Marker.LINE_STRIP, Marker.ADD)
    assert line.header.frame_id == polygon.header.frame_id == "world"
    assert len(line.points) == 50
    assert len(polygon.points) == CABLE["discretization.control_points"]
    assert line.scale.x == pytest.approx(0.005)
    assert line.pose.orientation.w == 1.0
    assert line.color.a > 0.0
    assert line.lifetime.sec + line.lifetime.nanosec * 1e-9 > 1.0 / 30.0
    assert {(m.ns, m.id) for m in lines} == {(line.ns, line.id)}


def test_reaction_of_the_held_end_only(peer: Peer) -> None:
    received = peer.collect(WrenchStamped, "/dlo_sim/start/reaction")
    # The cable swings; where it hangs the clamp carries its weight, 0.23 N, and more.
    peer.until(lambda: received and received[-1].wrench.force.z > 0.23, "reactions")
    peer.until(lambda: len(received) >= 3, "reactions")
    assert received[-1].header.frame_id == "world"
    assert max(message.wrench.force.z for message in received) > 0.0
    topics = [name for name, _ in peer.node.get_topic_names_and_types()]
    assert "/dlo_sim/start/reaction" in topics
    assert "/dlo_sim/end/reaction" not in topics


@pytest.mark.parametrize(
    ("topic", "message_type"),
    [("/dlo_sim/tip/wrench", WrenchStamped), ("/dlo_sim/force", Vector3Stamped)],
)
def test_a_load_moves_the_cable(peer: Peer, topic: str, message_type: type) -> None:
    publisher = peer.publisher(message_type, topic)
    received = peer.collect(PoseArray, "/dlo_sim/control_points", depth=1)
    message = message_type()
    vector = message.wrench.force if message_type is WrenchStamped else message.vector
    vector.y = 0.05
    with peer.repeating(publisher, message):
        peer.until(lambda: received and received[-1].poses[-1].position.y > 0.01, "motion")


def test_a_bad_wrench_is_refused_and_counted(node: NodeProcess, peer: Peer) -> None:
    """And said in the log; session/test_intake.py has all that is bad."""
    reason, message = "not_finite", WrenchStamped()
    message.wrench.force.x = math.nan
    poses = peer.collect(PoseArray, "/dlo_sim/control_points", depth=1)
    publisher = peer.publisher(WrenchStamped, "/dlo_sim/tip/wrench")
    name = "/dlo_sim: input /dlo_sim/tip/wrench"
    before = peer.status(name, lambda values, status: True, "the input")
    count = int(before.get(f"refused {reason}", "0"))
    with peer.repeating(publisher, message):
        values = peer.status(
            name,
            lambda values, status: (
                int(values.get(f"refused {reason}", "0")) > count
                and status.level != DiagnosticStatus.OK
            ),
            f"one more {reason}",
        )
    assert reason in values["last refusal"]
    poses.clear()
    peer.until(lambda: poses, "control points after it")
    assert all(math.isfinite(p.position.x) for p in poses[-1].poses)
    peer.until(lambda: "messages refused so far" in node.output, "a line in the log")


def test_two_publishers_are_a_warning(peer: Peer) -> None:
    name, key = "/dlo_sim: node", "publishers on /dlo_sim/tip/wrench"
    first = peer.publisher(WrenchStamped, "/dlo_sim/tip/wrench")
    peer.status(name, lambda values, status: values[key] == "1", "one publisher")
    second = peer.publisher(WrenchStamped, "/dlo_sim/tip/wrench")
    peer.status(
        name,
        lambda values, status: (
            values[key] == "2"
            and status.level == DiagnosticStatus.WARN
            and "2 publishers on /dlo_sim/tip/wrench" in status.message
        ),
        "a warning of two publishers",
    )
    peer.node.destroy_publisher(second)
    peer.status(name, lambda values, status: values[key] == "1", "one publisher again")
    peer.node.destroy_publisher(first)


def test_diagnostics_tell_how_the_ticks_keep_up(peer: Peer) -> None:
    values = peer.status(
        "/dlo_sim: node", lambda values, status: float(values["tick rate [Hz]"]) > 0.0, "ticks"
    )
    assert float(values["tick time mean [ms]"]) > 0.0
    assert float(values["step time mean [us]"]) > 0.0
    assert float(values["real-time factor"]) > 0.0
    assert int(values["dropped ticks"]) >= 0
    session = peer.status(
        "/dlo_sim: session", lambda values, status: values["status"] == "running", "the session"
    )
    assert float(session["simulated time [s]"]) > 0.0
    assert session["method"]


def test_everything_is_said_at_the_start(node: NodeProcess, peer: Peer) -> None:
    outputs = ("control_points", "centerline", "control_polygon", "start/reaction")
    for said in (
        "listens to /dlo_sim/tip/wrench, /dlo_sim/force",
        *(f"/dlo_sim/{topic}" for topic in outputs),
        *("computes ", "leaves out "),
    ):
        peer.until(lambda said=said: said in node.output, said)
