"""A structural change of the running node: no tick is left out."""

from __future__ import annotations

import struct
import time
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest

pytest.importorskip("rclpy", reason="needs rclpy: pip install 'dlo_sim[ros]'")

from geometry_msgs.msg import PoseArray
from node_harness import CABLE, Metronomes, NodeProcess, Peer
from rclpy.qos import QoSProfile

RATES = [50.0, 200.0]  # [Hz]
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


def change(node: NodeProcess, peer: Peer, rate: float, folder: Path) -> None:
    """Leave out twist and look at the ticks meanwhile.

    Ticks may be late where a core stood still or other processes had it, by no more than that and
    ten periods: the new simulator is built beside them, in the same interpreter.
    """
    heard = Heard(peer)
    peer.until(lambda: heard.stamps, "control points")
    metronomes = Metronomes(folder)
    waited, begin, since = node.waited, time.monotonic(), time.time_ns()
    try:
        assert peer.set({"terms.twist": "off"}).successful
    finally:
        metronomes.end()
    waited, took = node.waited - waited, time.monotonic() - begin
    assert len(heard.stamps) > 0.4 * rate * took, "most of them while it was made ready"
    assert set(np.diff(heard.numbers)) == {1}, "none is lost on the way"
    assert np.diff(heard.stamps).min() >= 0, "back in time"
    times = [heard_at for heard_at in heard.times if heard_at >= since]
    gaps = np.diff(times) * 1e-9
    spans = zip(times[:-1], times[1:], strict=True)
    late = [
        gap - 1.0 / rate
        for gap, span in zip(gaps, spans, strict=True)
        if gap > 1.5 / rate and not metronomes.stood_still(*span)
    ]
    print(
        f"{len(gaps)} ticks in {took:.2f} s, at most {gaps.max() * 1e3:.1f} ms apart; "
        f"{len(late)} late while the machine ran, by {sum(late) * 1e3:.1f} ms in all and "
        f"{max(late, default=0.0) * 1e3:.1f} ms at most; no core for {waited * 1e3:.1f} ms"
    )
    assert sum(late) < waited + 10.0 / rate


@pytest.mark.parametrize("rate", RATES)
def test_every_tick_comes_while_a_change_is_made_ready(
    started: Callable[..., NodeProcess], peer: Peer, rate: float, tmp_path: Path
) -> None:
    change(started({**CABLE, "rate": rate}), peer, rate, tmp_path)


@pytest.mark.usefixtures("incomplete_machine_code")
def test_the_same_where_something_has_to_be_compiled(
    started: Callable[..., NodeProcess], peer: Peer, tmp_path: Path
) -> None:
    """By the start, which says so; nothing is left for the change, nor for a second node."""
    node = started({**CABLE, "rate": RATES[-1]})
    assert COMPILING in node.output
    change(node, peer, RATES[-1], tmp_path)
    assert node.output.count(COMPILING) == 1
    peer.watched = None
    node.end()
    peer.until(lambda: not peer.node.count_services("/dlo_sim/reset"), "end of the node")
    again = started({**CABLE, "rate": RATES[-1]})
    change(again, peer, RATES[-1], tmp_path)
    assert "compiling" not in again.output
