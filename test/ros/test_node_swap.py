"""A structural change of the running node: ticks go on."""

from __future__ import annotations

import itertools
import struct
import time
from collections.abc import Callable
from typing import Any

import numpy as np
import pytest

pytest.importorskip("rclpy", reason="needs rclpy: pip install 'dlo_sim[ros]'")

from geometry_msgs.msg import PoseArray
from node_harness import CABLE, NodeProcess, Peer
from rclpy.qos import QoSProfile

RATE = 200.0  # [Hz]
SCENE = {**CABLE, "rate": RATE, "discretization.control_points": 40}
COMPILING = "compiling, once per installation"


class Heard:
    """The control points that have come: number and time of publication, stamp [ns]."""

    def __init__(self, peer: Peer) -> None:
        self.numbers: list[int] = []
        self.times: list[int] = []
        self.stamps: list[int] = []
        peer.node.create_subscription(
            PoseArray, "/dlo_sim/control_points", self._take, QoSProfile(depth=1000), raw=True
        )

    def _take(self, raw: bytes, info: dict[str, Any]) -> None:
        self.numbers.append(info["publication_sequence_number"])
        self.times.append(info["source_timestamp"])
        seconds, nanoseconds = struct.unpack_from("<iI", raw, 4)
        self.stamps.append(seconds * 1_000_000_000 + nanoseconds)


def change(node: NodeProcess, peer: Peer) -> None:
    """One control point less, one more, and so on, until the ticks go on meanwhile: not all that
    the machine does is known.
    """
    heard = Heard(peer)
    peer.until(lambda: heard.stamps, "control points")
    assert any(late(count, heard, node, peer) < 0.3 for count in (39, 40) * 3)
    assert set(np.diff(heard.numbers)) == {1}, "none is lost on the way"
    assert np.diff(heard.stamps).min() >= 0, "back in time"


def late(count: int, heard: Heard, node: NodeProcess, peer: Peer) -> float:
    """By how much the ticks are late during a change of control points, in all and as a share of
    the time that it takes: beyond that for which other processes had the core.
    """
    waited, begin = node.waited, time.time_ns()
    assert peer.set({"discretization.control_points": count}).successful
    waited, end = node.waited - waited, time.time_ns()
    peer.until(lambda: heard.times[-1] > end, "a tick after it")
    times = [begin, *(at for at in heard.times if begin < at < end), end]
    gaps = [(later - at) * 1e-9 for at, later in itertools.pairwise(times)]
    late = sum(gap - 1.0 / RATE for gap in gaps if gap > 1.5 / RATE)
    took = (end - begin) * 1e-9
    print(f"{len(gaps)} ticks in {took:.3f} s, {late:.3f} s late, {waited:.3f} s without a core")
    return (late - waited) / took


@pytest.mark.usefixtures("incomplete_machine_code")
def test_ticks_go_on_while_a_change_is_made_ready_and_nothing_is_compiled(
    started: Callable[..., NodeProcess], peer: Peer
) -> None:
    """The start does that, and says so; nothing is left for the change."""
    node = started(SCENE)
    assert COMPILING in node.output
    change(node, peer)
    assert node.output.count(COMPILING) == 1
