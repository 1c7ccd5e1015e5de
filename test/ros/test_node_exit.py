"""Ending: status 0 on SIGINT and SIGTERM with the markers gone, 3 when the simulation fails."""

from __future__ import annotations

import os
import signal
from collections.abc import Callable

import pytest

pytest.importorskip("rclpy", reason="needs rclpy: pip install 'dlo_sim[ros]'")

from geometry_msgs.msg import PoseArray
from node_harness import CABLE, START, UNSTABLE, NodeProcess, Peer, push
from std_srvs.srv import Trigger
from visualization_msgs.msg import Marker

from dlo_sim.ros import FAILED

# DLO_SIM_EXITS=20 repeats every way to end so often.
TIMES = int(os.environ.get("DLO_SIM_EXITS", "1"))


def collect_markers(peer: Peer) -> list[list[Marker]]:
    return [
        peer.collect(Marker, f"/dlo_sim/{name}", depth=100)
        for name in ("centerline", "control_polygon")
    ]


def gone(markers: list[list[Marker]]) -> bool:
    return all(m and m[-1].action == Marker.DELETEALL for m in markers)


@pytest.mark.parametrize(
    "numbers", [(signal.SIGINT,), (signal.SIGTERM, signal.SIGINT, signal.SIGTERM)] * TIMES
)
def test_a_signal_ends_it_with_status_0_and_without_markers(
    started: Callable[..., NodeProcess], peer: Peer, numbers: tuple[int, ...]
) -> None:
    """Those that follow the first change nothing."""
    node = started(CABLE)
    markers = collect_markers(peer)
    peer.until(lambda: all(m and m[-1].action == Marker.ADD for m in markers), "markers")
    peer.watched = None
    for number in numbers:
        node.process.send_signal(number)
    peer.until(lambda: gone(markers), "DELETEALL on both topics")
    assert node.wait() == 0
    assert "Traceback" not in node.output


@pytest.mark.parametrize("number", [signal.SIGINT] * TIMES)
def test_it_ends_before_simulated_time_begins(
    started: Callable[..., NodeProcess], peer: Peer, number: int
) -> None:
    """Where it stands still again, see test_node_sim_time.py."""
    node = started({**CABLE, "use_sim_time": True})
    peer.until(lambda: peer.node.count_publishers("/dlo_sim/centerline"), "topics")
    peer.watched = None
    assert node.stop(number) == 0
    assert "Traceback" not in node.output


@pytest.mark.parametrize("number", [signal.SIGTERM] * TIMES)
def test_a_signal_while_it_builds_ends_it_too(
    launch: Callable[..., NodeProcess], peer: Peer, number: int
) -> None:
    node = launch(CABLE)
    peer.watched = node
    peer.until(lambda: "building the simulator" in node.output, "begin of the build", START)
    assert node.stop(number) == 0
    peer.watched = None


def test_a_failed_simulation_is_held_and_can_be_reset_or_stops_the_node_if_asked(
    started: Callable[..., NodeProcess], peer: Peer
) -> None:
    node = started({**UNSTABLE, "integrator.on_failure": "hold"})
    with push(peer, 100.0):
        peer.until(lambda: "failed: " in node.output, "a failure")
    received = peer.collect(PoseArray, "/dlo_sim/control_points", depth=1)
    peer.until(lambda: received, "control points of the last good state")
    peer.status("/dlo_sim: session", lambda v, s: v["status"].startswith("failed"), "the failure")
    assert peer.call(Trigger, "/dlo_sim/reset", Trigger.Request()).success
    peer.status("/dlo_sim: session", lambda v, s: v["status"] == "running", "a running session")
    assert peer.set({"integrator.on_failure": "stop"}).successful
    peer.watched = None
    with push(peer, 100.0):
        peer.until(lambda: node.process.poll() is not None, "end of the node")
    assert node.wait() == FAILED
    assert node.output.splitlines()[-1].startswith("dlo_sim: ")
    assert "Traceback" not in node.output
