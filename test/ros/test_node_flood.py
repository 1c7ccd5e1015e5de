"""Requests that come faster than the node can answer them."""

from __future__ import annotations

from collections.abc import Callable
from itertools import count
from pathlib import Path

import pytest

pytest.importorskip("rclpy", reason="needs rclpy: pip install 'dlo_sim[ros]'")

from diagnostic_msgs.msg import DiagnosticArray
from geometry_msgs.msg import PoseArray
from node_harness import CABLE, NodeProcess, Peer
from rcl_interfaces.srv import SetParameters
from rclpy.parameter import Parameter


def test_diagnostics_and_state_go_on_while_parameters_pour_in(
    started: Callable[..., NodeProcess], peer: Peer, tmp_path: Path
) -> None:
    """Each change needs a new simulator, so that the node is always preparing one."""
    saved = tmp_path / "state"
    started({**CABLE, "rate": 50, "state.save_to": str(saved)})
    reports = peer.collect(DiagnosticArray, "/diagnostics")
    shapes = peer.collect(PoseArray, "/dlo_sim/control_points")
    peer.until(lambda: reports and saved.exists(), "a report and a state")
    client = peer.node.create_client(SetParameters, "/dlo_sim/set_parameters")
    peer.until(client.service_is_ready, "the service")
    number, answers = count(), []

    def change() -> None:
        value = Parameter("damping.stiffness", value=0.01 + 1e-6 * next(number))
        request = SetParameters.Request(parameters=[value.to_parameter_msg()])
        client.call_async(request).add_done_callback(lambda future: answers.append(future.result()))

    flood = peer.node.create_timer(0.01, change)
    peer.until(lambda: len(answers) > 5, "the first answers")
    reports.clear(), shapes.clear()
    begun, written = len(answers), saved.stat().st_ino
    peer.until(lambda: len(reports) > 3, "reports meanwhile")
    peer.until(lambda: saved.stat().st_ino != written, "another state meanwhile")
    peer.until(lambda: len(answers) > begun + 5 and len(shapes) > 50, "answers and ticks meanwhile")
    peer.node.destroy_timer(flood)
    assert all(answer.results[0].successful for answer in answers)
