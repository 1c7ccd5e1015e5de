"""~/pause, ~/step and ~/reset."""

from __future__ import annotations

import re
from collections.abc import Callable
from pathlib import Path

import pytest

pytest.importorskip("rclpy", reason="needs rclpy: pip install 'dlo_sim[ros]'")

from geometry_msgs.msg import PoseArray
from node_harness import CABLE, NodeProcess, Peer
from rclpy.qos import qos_profile_sensor_data
from std_srvs.srv import SetBool, Trigger
from visualization_msgs.msg import Marker


@pytest.fixture(scope="module", autouse=True)
def node(running: Callable[..., NodeProcess], peer: Peer) -> NodeProcess:
    node = running({**CABLE, "rate": 100})
    peer.until(lambda: "dlo_sim" in peer.node.get_node_names(), "the name of the node")
    return node


def pause(peer: Peer, flag: bool) -> None:
    response = peer.call(SetBool, "/dlo_sim/pause", SetBool.Request(data=flag))
    assert response.success
    assert response.message == ("paused" if flag else "running")


def trigger(peer: Peer, name: str) -> Trigger.Response:
    return peer.call(Trigger, f"/dlo_sim/{name}", Trigger.Request())


def stamp(message: PoseArray) -> int:
    return message.header.stamp.sec * 1_000_000_000 + message.header.stamp.nanosec


def test_services_are_those_of_the_page(peer: Peer, checkout: Path) -> None:
    page = (checkout / "config" / "NODE.md").read_text(encoding="utf-8")
    rows = re.findall(r"^\| `~/(\w+)` \| (std_srvs/\S+) \|", page, re.MULTILINE)
    wanted = {f"/dlo_sim/{name}": [kind] for name, kind in rows}
    assert len(wanted) == 3

    def offered() -> dict[str, list[str]]:
        services = peer.node.get_service_names_and_types_by_node("dlo_sim", "/")
        return {name: kinds for name, kinds in services if kinds[0].startswith("std_srvs/")}

    # Each service is discovered by itself; a pause afterwards shows one too many.
    peer.until(lambda: wanted.items() <= offered().items(), "every service of the page")
    assert offered() == wanted


def test_a_pause_holds_the_state_and_a_step_moves_it(peer: Peer) -> None:
    received = peer.collect(PoseArray, "/dlo_sim/control_points")
    peer.until(lambda: len(received) > 5, "control points")
    pause(peer, True)
    peer.status("/dlo_sim: session", lambda values, status: values["status"] == "paused", "a pause")
    received.clear()
    lines = peer.collect(Marker, "/dlo_sim/centerline")
    peer.until(lambda: len(lines) > 5, "markers, which are renewed")
    assert received == []  # nothing is new
    late = peer.collect(PoseArray, "/dlo_sim/control_points")
    peer.until(lambda: late and received, "the held state for a new reader")
    held = late[-1]
    assert {stamp(m) for m in [*late, *received, *lines]} == {stamp(held)}
    assert len(received) == 1

    sensor: list[PoseArray] = []
    peer.node.create_subscription(
        PoseArray, "/dlo_sim/control_points", sensor.append, qos_profile_sensor_data
    )
    peer.until(lambda: sensor, "the held state for a best-effort reader")

    response = trigger(peer, "step")
    assert response.success, response.message
    peer.until(lambda: stamp(received[-1]) > stamp(held), "control points of the step")
    assert stamp(received[-1]) - stamp(held) == pytest.approx(10_000_000, abs=2_000_000)
    assert received[-1].poses != held.poses

    pause(peer, False)
    moved = stamp(received[-1])
    peer.until(lambda: stamp(received[-1]) > moved + 50_000_000, "motion after the pause")


def test_a_step_without_a_pause_is_refused(peer: Peer) -> None:
    response = trigger(peer, "step")
    assert not response.success
    assert "~/pause" in response.message


def test_a_reset_puts_the_cable_back_and_removes_the_markers(peer: Peer) -> None:
    received = peer.collect(PoseArray, "/dlo_sim/control_points")
    lines = peer.collect(Marker, "/dlo_sim/centerline")
    polygons = peer.collect(Marker, "/dlo_sim/control_polygon")
    peer.until(
        lambda: received and received[-1].poses[-1].position.z < -0.05 and lines and polygons,
        "a cable that sags",
    )
    response = trigger(peer, "reset")
    assert response.success
    peer.until(lambda: abs(received[-1].poses[-1].position.z) < 0.02, "a straight cable")
    for markers in (lines, polygons):
        peer.until(lambda m=markers: Marker.DELETEALL in [x.action for x in m], "DELETEALL")
        peer.until(lambda m=markers: m[-1].action == Marker.ADD, "the marker again")
