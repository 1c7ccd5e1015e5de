"""Plans in, forecasts out: computed in processes of their own, so that the ticks go on."""

from __future__ import annotations

import contextlib
import multiprocessing
import pickle
from collections import deque
from collections.abc import Iterator
from dataclasses import dataclass
from multiprocessing.connection import Connection
from multiprocessing.process import BaseProcess
from typing import TYPE_CHECKING

from dlo_sim.process import warning_lines
from dlo_sim.session.cdr import DiagnosticStatus
from dlo_sim.session.diagnostics import OK, WARN, topic_status
from dlo_sim.session.forecasts import Answer, answer
from dlo_sim.session.outputs import OutgoingMessage
from dlo_sim.session.plans import Plans
from dlo_sim.session.session import Session
from dlo_sim.simulation.forecast import Plan

if TYPE_CHECKING:
    from dlo_sim.simulation.simulator import Simulator

_MOST_WAITING = 100  # plans
_END = 1.0  # [s] for a process to end by itself


@dataclass
class _Worker:
    """A process that forecasts one plan after the other; busy: it has one, or is still starting."""

    process: BaseProcess
    connection: Connection
    busy: bool = True

    def give(self, planned: bytes) -> None:
        """Let it forecast a pickled plan."""
        self.busy = True
        with contextlib.suppress(OSError):  # it has ended, which is noticed as it is asked
            self.connection.send_bytes(planned)

    def end(self) -> None:
        """End the process."""
        self.connection.close()
        self.process.join(_END)
        self.process.terminate()


class Forecaster:
    """Takes the plans of a session and hands back what comes of them.

    Args:
        topic: name of ~/plan on the wire.
        count: processes.

    Raises:
        SceneError: the method of the session follows no plans.
    """

    def __init__(self, session: Session, topic: str, count: int) -> None:
        self._session = session
        self._plans = Plans(session, topic)
        self._waiting: deque[bytes] = deque()
        self._workers = [_begun(session) for _ in range(count)]
        self._answered = self._failed = self._failed_reported = 0
        self._last = Answer()

    def accept(self, raw: bytes, arrival_ns: int) -> None:
        """Take one serialised plan; the present state goes with it."""
        if len(self._waiting) >= _MOST_WAITING:
            self._plans.record.refuse(
                "too_many", f"{_MOST_WAITING} wait; plan less often or raise forecast.processes"
            )
            return
        planned = self._plans.accept(raw, arrival_ns)
        if planned is not None:
            self._waiting.append(pickle.dumps(planned))
            self._hand_out()

    def answers(self) -> Iterator[OutgoingMessage]:
        """Messages about plans that have been forecast since the last call."""
        for number, worker in enumerate(self._workers):
            if not worker.busy or not worker.connection.poll():
                continue
            try:
                found: Answer | None = worker.connection.recv()
                worker.busy = False
            except (EOFError, OSError):
                found = Answer(problem="the process that forecast it has ended; another begins")
                worker.end()
                self._workers[number] = _begun(self._session)
            if found is not None:
                self._last = found
                self._answered += 1
                self._failed += bool(found.problem)
                yield from found.messages
        self._hand_out()

    def statuses(self, now_ns: int) -> list[DiagnosticStatus]:
        """For the diagnostics at this time of the clock [ns]."""
        fresh, self._failed_reported = self._failed - self._failed_reported, self._failed
        values = (
            ("plans forecast", str(self._answered)),
            ("plans that failed", str(self._failed)),
            ("plans waiting", str(len(self._waiting))),
            *self._last.values,
        )
        level, message = OK, "forecasting"
        if fresh:
            level, message = WARN, f"{fresh} plans failed, last: {self._last.problem}"
        status = DiagnosticStatus(level, "forecast", message, values)
        return [status, topic_status(self._plans.record, now_ns)]

    def close(self) -> None:
        """End the processes."""
        for worker in self._workers:
            worker.end()

    def _hand_out(self) -> None:
        for worker in self._workers:
            if self._waiting and not worker.busy:
                worker.give(self._waiting.popleft())


def _begun(session: Session) -> _Worker:
    """A process that is starting."""
    # Not fork: threads of this process (numba's, ROS's) would not survive it.
    context = multiprocessing.get_context("spawn")
    ours, theirs = context.Pipe()
    given = theirs, session.simulator, warning_lines.uses_lines()
    process = context.Process(target=_work, args=given, daemon=True)
    process.start()
    theirs.close()
    return _Worker(process, ours)


def _work(connection: Connection, simulator: Simulator, lines: bool) -> None:
    """Say None when ready, then answer plans until the other side is closed; `lines` tells whether
    warnings are printed as lines.
    """
    warning_lines.use_lines(lines)
    simulator.forecast(Plan([0.0, simulator.step], {}), simulator.step)  # loads machine code
    found: Answer | None = None
    while True:
        try:
            connection.send(found)
            found = answer(connection.recv())
        except (EOFError, OSError):
            return
