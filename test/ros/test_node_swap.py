"""A structural change of the running node: no tick is left out, whether it compiles or loads."""

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

RATE = 50.0  # [Hz]
COMPILING = "compiling the step of this scene"


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


def change(node: NodeProcess, peer: Peer, folder: Path) -> None:
    """Leave out twist, which needs other machine code, and look at the ticks meanwhile.

    Ticks may be late where a core stood still or other processes had it, by no more than that and
    one period.
    """
    heard = Heard(peer)
    peer.until(lambda: heard.stamps, "control points")
    metronomes = Metronomes(folder)
    waited, begin = node.waited, time.monotonic()
    try:
        assert peer.set({"terms.twist": "off"}).successful
    finally:
        metronomes.end()
    waited, took = node.waited - waited, time.monotonic() - begin
    assert len(heard.stamps) > 0.4 * RATE * took, "most of them while it was made ready"
    assert set(np.diff(heard.numbers)) == {1}, "none is lost on the way"
    gaps = np.diff(heard.stamps) * 1e-9
    assert gaps.min() >= 0.0, "back in time"
    spans = zip(heard.times[:-1], heard.times[1:], strict=True)
    late = [
        gap - 1.0 / RATE
        for gap, span in zip(gaps, spans, strict=True)
        if gap > 1.5 / RATE and not metronomes.stood_still(*span)
    ]
    print(
        f"{len(gaps)} ticks in {took:.2f} s, at most {gaps.max() * 1e3:.1f} ms apart; "
        f"{len(late)} late while the machine ran, by {sum(late) * 1e3:.1f} ms in all; "
        f"no core for {waited * 1e3:.1f} ms"
    )
    assert sum(late) < waited + 1.0 / RATE


def test_every_tick_comes_while_a_change_is_made_ready(
    started: Callable[..., NodeProcess], peer: Peer, tmp_path: Path
) -> None:
    change(started({**CABLE, "rate": RATE}), peer, tmp_path)


@pytest.mark.slow
def test_the_same_with_nothing_compiled_before(
    started: Callable[..., NodeProcess],
    peer: Peer,
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    """The start says that it compiles, the change compiles elsewhere, and the next one loads."""
    monkeypatch.setenv("DLO_SIM_CACHE", str(tmp_path))
    node = started({**CABLE, "rate": RATE})
    assert COMPILING in node.output
    change(node, peer, tmp_path)
    assert node.output.count("in another process") == 1
    assert node.output.count(COMPILING) == 1
    peer.watched = None
    node.end()
    peer.until(lambda: not peer.node.count_services("/dlo_sim/reset"), "end of the node")
    again = started({**CABLE, "rate": RATE})
    change(again, peer, tmp_path)
    assert "compiling" not in again.output
