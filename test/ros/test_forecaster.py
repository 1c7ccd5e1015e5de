"""The processes that forecast plans: a queue that is bounded, a process that dies."""

from __future__ import annotations

import errno
import os
import signal
import time
import warnings
from collections.abc import Callable, Iterator
from queue import Queue
from typing import Any

import numpy as np
import pytest
from plans import still_plan

from dlo_sim import load_scene
from dlo_sim.process import beginning
from dlo_sim.ros import forecaster as room
from dlo_sim.ros.forecaster import Forecaster
from dlo_sim.session.plans import Request
from dlo_sim.session.session import Session

TIMES_NS = np.linspace(0, 100_000_000, 7000).astype(int).tolist()  # 450 kB, a pipe takes 64 kB


@pytest.fixture
def forecaster(monkeypatch: pytest.MonkeyPatch) -> Iterator[Forecaster]:
    session = Session(load_scene({"forecast.processes": 1, "damping.stiffness": 0.01}))

    asked = Request(still_plan(TIMES_NS), 7, session.simulator, 7, {})
    monkeypatch.setattr(room, "request", lambda *arguments: asked)
    found = Forecaster(session, "/plan", 1)
    yield found
    found.close()


def until(condition: Callable[[], object]) -> None:
    deadline = time.monotonic() + 60.0
    while not condition():
        assert time.monotonic() < deadline
        time.sleep(0.002)  # the processes need the cores


def values(forecaster: Forecaster) -> dict[str, str]:
    return dict(forecaster.statuses(0)[0].values)


def running(forecaster: Forecaster) -> Any:
    """The process of the only worker, once there is one."""
    until(lambda: forecaster._workers[0].process is not None)
    return forecaster._workers[0].process


def test_a_process_that_dies_is_replaced(forecaster: Forecaster) -> None:
    forecaster.accept(b"", 0)
    answers: list[str] = []
    until(lambda: answers.extend(m.topic for m in forecaster.answers()) or answers)
    assert answers == ["~/forecast", "~/forecast/ghosts"]
    first = running(forecaster)
    first.kill()
    until(lambda: running(forecaster) is not first)
    forecaster.accept(b"", 0)
    until(lambda: list(forecaster.answers()))
    assert values(forecaster)["plans forecast"] == "2"
    assert values(forecaster)["plans that failed"] == "0"


def test_a_process_that_does_not_read_holds_up_nobody(
    forecaster: Forecaster, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Plans are much larger than a pipe. What it had is lost and said, what waited is forecast."""
    monkeypatch.setattr(room, "_LONG", 0.0)
    forecaster.accept(b"", 0)
    until(lambda: list(forecaster.answers()))
    process = running(forecaster)
    os.kill(process.pid, signal.SIGSTOP)
    for _ in range(3):
        forecaster.accept(b"", 0)
        assert list(forecaster.answers()) == []
    until(lambda: values(forecaster)["plans waiting"] == "2")
    status = forecaster.statuses(0)[0]
    assert status.level == 1 and f"process {process.pid} has not answered" in status.message
    process.kill()
    failed = "1 plans failed, last: the process that forecast it has ended; another begins"
    until(lambda: [*forecaster.answers()] or forecaster.statuses(0)[0].message == failed)
    until(lambda: list(forecaster.answers()) or values(forecaster)["plans forecast"] == "4")
    assert values(forecaster)["plans that failed"] == "1"


def test_a_process_that_cannot_be_started_is_tried_again(
    forecaster: Forecaster, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Without memory, or without an open file left for its pipe. No plan has failed by that."""
    first = running(forecaster)
    real, refused = room.children, [OSError(errno.ENOMEM, "no memory")]

    def children() -> Any:
        if refused:
            raise refused[0]
        return real()

    monkeypatch.setattr(room, "_PAUSE", 0.01)
    monkeypatch.setattr(room, "children", children)
    first.kill()
    until(lambda: forecaster.statuses(0)[0].level == 1)
    until(lambda: int(values(forecaster)["failed starts of processes"]) > 1)
    problem = "no process can be started (no memory); it is tried again"
    assert forecaster.statuses(0)[0].message == problem
    assert list(forecaster.answers()) == []
    refused.clear()
    until(lambda: running(forecaster) is not first)
    until(lambda: forecaster.statuses(0)[0].level == 0)
    assert forecaster.statuses(0)[0].message == "forecasting"
    forecaster.accept(b"", 0)
    until(lambda: list(forecaster.answers()))
    assert values(forecaster)["plans forecast"] == "1"
    assert values(forecaster)["plans that failed"] == "0"


def test_a_process_that_was_stopped_does_not_hold_up_the_end(forecaster: Forecaster) -> None:
    process = running(forecaster)
    os.kill(process.pid, signal.SIGSTOP)
    forecaster.close()
    assert process.exitcode is not None


class Zero(float):
    """Becomes 0.0, with a warning in the process that unpickles it."""

    def __reduce__(self) -> tuple[object, ...]:
        return eval, ("__import__('warnings').warn('cable.length: 1; \\n shorten it') or 0.0",)


def test_its_warnings_are_lines_as_those_of_its_parent(
    monkeypatch: pytest.MonkeyPatch, capfd: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.setattr(warnings, "formatwarning", warnings.formatwarning)
    beginning.use_lines(True)
    session = Session(load_scene({"damping.stiffness": 0.01}))
    asked = Request(still_plan(TIMES_NS), 7, session.simulator, Zero(), {})  # type: ignore[arg-type]
    monkeypatch.setattr(room, "request", lambda *arguments: asked)
    forecaster = Forecaster(session, "/plan", 1)
    try:
        forecaster.accept(b"", 0)
        until(lambda: list(forecaster.answers()))
    finally:
        forecaster.close()
    assert capfd.readouterr().err == "dlo_sim: warning: cable.length: 1; shorten it\n"


def test_a_queue_that_is_full(forecaster: Forecaster, monkeypatch: pytest.MonkeyPatch) -> None:
    process = running(forecaster)
    os.kill(process.pid, signal.SIGSTOP)  # before it is ready
    monkeypatch.setattr(forecaster, "_waiting", Queue(2))
    for _ in range(3):
        forecaster.accept(b"", 0)
    assert "refused too_many" in dict(forecaster.statuses(0)[1].values)
    assert values(forecaster)["plans waiting"] == "2"
