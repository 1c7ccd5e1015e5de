"""The processes that forecast plans: a queue that is bounded, a process that dies."""

from __future__ import annotations

import time
import warnings
from collections.abc import Callable, Iterator

import numpy as np
import pytest

from dlo_sim import Plan, load_scene
from dlo_sim.process import warning_lines
from dlo_sim.ros import forecaster as room
from dlo_sim.ros.forecaster import Forecaster
from dlo_sim.session.plans import Planned, Plans
from dlo_sim.session.session import Session

PLACE = np.tile([0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 1.0], (2, 1))


@pytest.fixture
def forecaster(monkeypatch: pytest.MonkeyPatch) -> Iterator[Forecaster]:
    session = Session(load_scene({"forecast.processes": 1, "damping.stiffness": 0.01}))

    def plan(self: Plans, raw: bytes, arrival_ns: int) -> Planned:
        return Planned(session.simulator, Plan([0.0, 0.1], {"start": PLACE}), 7, 0.0)  # type: ignore[arg-type]

    monkeypatch.setattr(Plans, "accept", plan)
    found = Forecaster(session, "/plan", 1)
    yield found
    found.close()


def until(condition: Callable[[], object]) -> None:
    deadline = time.monotonic() + 60.0
    while not condition():
        assert time.monotonic() < deadline


def values(forecaster: Forecaster) -> dict[str, str]:
    return dict(forecaster.statuses(0)[0].values)


def test_a_process_that_dies_is_replaced(forecaster: Forecaster) -> None:
    forecaster.accept(b"", 0)
    answers: list[str] = []
    until(lambda: answers.extend(m.topic for m in forecaster.answers()) or answers)
    assert answers == ["~/forecast", "~/forecast/ghosts"]
    forecaster._workers[0].process.kill()
    forecaster._workers[0].process.join()
    forecaster.accept(b"", 0)
    until(
        lambda: (
            list(forecaster.answers())
            or "1 plans failed, last: the process" in forecaster.statuses(0)[0].message
        )
    )
    assert values(forecaster)["plans that failed"] == "1"
    forecaster.accept(b"", 0)
    until(lambda: list(forecaster.answers()))
    assert values(forecaster)["plans forecast"] == "3"


class Zero(float):
    """Becomes 0.0, with a warning in the process that unpickles it."""

    def __reduce__(self) -> tuple[object, ...]:
        return eval, ("__import__('warnings').warn('cable.length: 1; \\n shorten it') or 0.0",)


@pytest.mark.parametrize("as_node", [True, False])
def test_its_warnings_are_lines_as_those_of_its_parent(
    as_node: bool, monkeypatch: pytest.MonkeyPatch, capfd: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.setattr(warnings, "formatwarning", warnings.formatwarning)
    warning_lines.use_lines(as_node)
    session = Session(load_scene({"damping.stiffness": 0.01}))
    planned = Planned(session.simulator, Plan([0.0, 0.1], {"start": PLACE}), 7, Zero())
    monkeypatch.setattr(Plans, "accept", lambda *arguments: planned)
    forecaster = Forecaster(session, "/plan", 1)
    try:
        forecaster.accept(b"", 0)
        until(lambda: list(forecaster.answers()))
    finally:
        forecaster.close()
    said = capfd.readouterr().err
    line = "dlo_sim: warning: cable.length: 1; shorten it\n"
    assert said == line if as_node else "UserWarning: cable.length" in said


def test_a_queue_that_is_full(forecaster: Forecaster, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(room, "_MOST_WAITING", 2)
    for _ in range(3):
        forecaster.accept(b"", 0)
    assert "refused too_many" in dict(forecaster.statuses(0)[1].values)
    assert values(forecaster)["plans waiting"] == "2"
