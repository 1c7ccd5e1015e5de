"""A structural change while poses come in: built beside the ticks, none of which stops."""

from __future__ import annotations

import threading

import pytest

from dlo_sim.ros.live_cable import in_background


def test_the_first_tick_does_not_wait_for_a_period():
    released = threading.Event()
    in_background(lambda: released.wait(60.0) or pytest.fail("no tick"), released.set, lambda: 1e9)


def test_failure_of_the_work_is_raised_here():
    def fail() -> None:
        raise ValueError("refused")

    with pytest.raises(ValueError, match="refused"):
        in_background(fail, lambda: None, lambda: 1e-3)


def test_failing_tick_waits_for_the_thread():
    begun, released = threading.Event(), threading.Event()

    def work() -> None:
        begun.set()
        released.wait(20.0)

    def tick() -> None:
        if begun.is_set():
            released.set()
            raise RuntimeError("tick")

    with pytest.raises(RuntimeError, match="tick"):
        in_background(work, tick, lambda: 1e-3)
    assert not [t for t in threading.enumerate() if t.name.startswith("preparing")]
