"""Several cables in one process: each has its scene, names, rate, failures and end."""

from __future__ import annotations

import itertools
import math
import signal
import statistics
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import pytest

pytest.importorskip("rclpy", reason="needs rclpy: pip install 'dlo_sim[ros]'")

import rclpy
from diagnostic_msgs.msg import DiagnosticArray
from geometry_msgs.msg import PoseArray
from node_harness import CABLE, START, UNSTABLE, NodeProcess, Peer, push
from visualization_msgs.msg import Marker

from dlo_sim.ros import FAILED
from dlo_sim.ros.arguments import read_arguments
from dlo_sim.ros.cables import cables as cables_of
from dlo_sim.scene.loading import SceneError

TWO = {"cables": ["a", "b"]}
HANGING = {**CABLE, "start.tangent": [0, 0, -1]}  # keeps its plane, unlike one that swings freely
Start = Callable[..., NodeProcess]


def of(name: str, values: dict[str, Any]) -> dict[str, Any]:
    return {f"{name}.{key}": value for key, value in values.items()}


@pytest.fixture
def cables(launch: Start, peer: Peer) -> Iterator[Start]:
    """`cables(values, *arguments)`: up and running as far as the names say."""
    nodes: list[NodeProcess] = []

    def start(values: dict[str, Any], *arguments: str, up: str = "ab") -> NodeProcess:
        node = launch(values, *arguments)
        nodes.append(node)
        peer.watched = node
        for name in up:
            service = f"/dlo_sim/{name}/reset"
            peer.until(lambda service=service: peer.node.count_services(service), name, START)
        return node

    yield start
    peer.watched = None
    for node in nodes:
        node.end()
    for name in "ab":
        service = f"/dlo_sim/{name}/reset"
        peer.until(lambda service=service: not peer.node.count_services(service), "the end")


def period(points: list[PoseArray]) -> float:
    """Median time between two stamps [s]: a tick that the machine holds up is further from the one
    before it, and nearer to the next.
    """
    stamps = [m.header.stamp.sec + m.header.stamp.nanosec * 1e-9 for m in points]
    return statistics.median(later - stamp for stamp, later in itertools.pairwise(stamps))


def sideways(points: list[PoseArray]) -> float:
    return max(abs(pose.position.y) for message in points for pose in message.poses)


def test_each_cable_has_its_scene_inputs_refusals_and_parameters(cables: Start, peer: Peer) -> None:
    rates = {**of("a", {"rate": 100.0}), **of("b", {"rate": 25.0, "cable.length": 0.5})}
    node = cables({**TWO, **HANGING, **rates})
    found = {name: peer.collect(PoseArray, f"/dlo_sim/{name}/control_points") for name in "ab"}
    markers = [peer.collect(Marker, f"/dlo_sim/{name}/centerline") for name in "ab"]
    statuses = peer.collect(DiagnosticArray, "/diagnostics")
    with push(peer, 0.05, "/dlo_sim/a"):
        peer.until(lambda: found["a"] and sideways(found["a"]) > 0.1, "motion of a")
        peer.until(lambda: len(found["b"]) > 20, "control points of b")
    assert sideways(found["b"]) < 1e-9
    assert peer.get("cable.length", "rate", node="/dlo_sim/a") == [1.0, 100.0]
    assert peer.get("cable.length", "rate", node="/dlo_sim/b") == [0.5, 25.0]
    assert period(found["a"]) == pytest.approx(0.01, rel=0.1)
    assert period(found["b"]) == pytest.approx(0.04, rel=0.1)

    with push(peer, math.nan, "/dlo_sim/a"):
        peer.status(
            "/dlo_sim/a: input /dlo_sim/a/tip/wrench",
            lambda values, status: int(values.get("refused not_finite", "0")) > 3,
            "refused wrenches of a",
        )
    refused = peer.set({"cable.length": -1.0}, "/dlo_sim/a")
    assert not refused.successful and "cable.length" in refused.reason
    assert peer.set({"rate": 50.0}, "/dlo_sim/b").successful
    assert peer.get("cable.length", "rate", node="/dlo_sim/a") == [1.0, 100.0]
    count = len(found["b"])
    peer.until(lambda: len(found["b"]) > count + 10, "b going on")
    refusing = {
        status.name.split(":")[0]
        for array in statuses
        for status in array.status
        if any(item.key == "refused not_finite" for item in status.values)
    }
    assert refusing == {"/dlo_sim/a"}
    ids = {status.hardware_id for array in statuses for status in array.status}
    assert ids == {"/dlo_sim/a", "/dlo_sim/b"}

    peer.until(lambda: all(m and m[-1].action == Marker.ADD for m in markers), "markers")
    node.process.send_signal(signal.SIGINT)
    peer.watched = None
    peer.until(lambda: all(m[-1].action == Marker.DELETEALL for m in markers), "DELETEALL")
    assert node.wait() == 0
    assert "Traceback" not in node.output


def test_one_that_is_refused_and_one_that_fails_do_not_stop_the_other(
    cables: Start, peer: Peer, tmp_path: Path
) -> None:
    """`a` has a scene file and goes on, `b` fails at a push, `c` has no scene file."""
    scene = tmp_path / "scene.yaml"
    scene.write_text(
        "dlo_sim:\n  ros__parameters:\n    cable: {length: 0.4}\n    start: {fixed: [true, true, "
        "true]}\n    gravity: [0, 0, -9.5]\n    loads: {names: [tip]}\n",
        encoding="utf-8",
    )
    of_a = of("a", {"scene": str(scene), "loads.names": []})
    of_b = of("b", UNSTABLE)
    node = cables({"cables": ["a", "b", "c"], "c.scene": "two_gripers", **of_a, **of_b})
    found = peer.collect(PoseArray, "/dlo_sim/a/control_points")
    names = ("cable.length", "gravity", "loads.names")
    assert peer.get(*names, node="/dlo_sim/a") == [0.4, [0.0, 0.0, -9.5], []]
    peer.until(lambda: "dlo_sim: error: c: 'two_gripers' is not a" in node.output, "a refusal")
    assert not peer.node.count_publishers("/dlo_sim/c/control_points")
    refusal = "'two_gripers' is not a shipped scene"
    said = peer.status("/dlo_sim/c: node", lambda _, s: s.message.startswith(refusal), "why")
    assert said == {"cables running": "a, b"}

    with push(peer, 100.0, "/dlo_sim/b"):
        peer.until(lambda: "dlo_sim: b: " in node.output, "the failure of b")
    peer.until(lambda: not peer.node.count_services("/dlo_sim/b/reset"), "the end of b")
    peer.status("/dlo_sim/b: node", lambda _, s: "the energy grew" in s.message, "why b ended")
    count = len(found)
    peer.until(lambda: len(found) > count + 5, "a going on")
    assert node.stop() == FAILED
    assert "Traceback" not in node.output


@pytest.mark.parametrize(
    ("values", "named"),
    [
        ({"cables": "[a, a]"}, "cables: 'a' is there twice"),
        ({"cables": "[start]"}, "cables: 'start' is not a name"),
        ({"cables": "a"}, "cables: 'a'"),
        ({"cables": "[a]", "a.scene": "3"}, "scene: 3"),
        ({"cables": "[a]", "rate": "9.0", "a.lifecycle": "3"}, "lifecycle: 3"),
        ({"cables": "[a]", "b.cable.length": "2.0"}, "b.cable.length: 2.0 is for a cable 'b'"),
        ({"cables": "[a, b]", "c.scene": "x"}, "c.scene: 'x' is for a cable 'c'; cables names a"),
        ({"cables": "[a]", "cabel.length": "2.0"}, "cabel.length: 2.0 is for"),
        ({"cables": "[a]", "use_sim_time": "false"}, "a.scene: is not given; name a shipped scene"),
        ({"lifecycle": "later"}, "lifecycle: 'later'"),
    ],
)
def test_bad_names_are_refused(domain: int, values: dict[str, str], named: str) -> None:
    rules = [word for key, text in values.items() for word in ("-p", f"{key}:={text}")]
    with read_arguments(["--ros-args", *rules]) as given:
        rclpy.init(args=given.for_rcl, domain_id=domain)
        try:
            with pytest.raises(SceneError, match=named):
                for makers in cables_of(given).values():
                    makers.cable().start()
        finally:
            rclpy.shutdown()


def test_remap_rules_are_for_each_cable_and_new_names_for_all_together(domain: int) -> None:
    rules = ["-r", "__ns:=/arm", "-r", "__node:=left", "-r", "b:~/tip/wrench:=/hand"]
    values = ["-p", "cables:=[a, b]", "-p", "cable.length:=1.0", "-p", "b.rate:=50.0"]
    values += ["-p", "use_sim_time:=true"]
    with read_arguments(["--ros-args", *rules, *values]) as given:
        rclpy.init(args=given.for_rcl, domain_id=domain)
        nodes = [makers.cable() for makers in cables_of(given).values()]
        found = [(n.get_fully_qualified_name(), n.resolved("~/tip/wrench")) for n in nodes]
        clocks = [node.get_parameter("use_sim_time").value for node in nodes]
        rates = [node.overrides.get("rate") for node in nodes]
        for node in nodes:
            node.destroy_node()
        rclpy.shutdown()
    assert found == [("/arm/left/a", "/arm/left/a/tip/wrench"), ("/arm/left/b", "/hand")]
    assert clocks == [True, True]
    assert rates == [None, 50.0]
