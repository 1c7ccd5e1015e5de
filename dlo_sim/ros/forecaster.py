"""Forecasts of plans, computed in processes of their own, so that the ticks continue.

A thread talks to each process and replaces it when it has ended. A tick only looks into a queue.
"""

from __future__ import annotations

import contextlib
import pickle
import threading
import time
from collections.abc import Iterator
from multiprocessing.connection import Connection
from multiprocessing.process import BaseProcess
from queue import Empty, Queue, SimpleQueue
from typing import TYPE_CHECKING

from dlo_sim.process.children import children
from dlo_sim.session.cdr import DiagnosticStatus
from dlo_sim.session.diagnostics import OK, WARN, Refused, TopicRecord, topic_status
from dlo_sim.session.outputs import OutgoingMessage
from dlo_sim.session.plans import Answer, answer, check_method, request
from dlo_sim.session.session import Session
from dlo_sim.simulation.forecast import Plan

if TYPE_CHECKING:
    from dlo_sim.simulation.simulator import Simulator

_MOST_WAITING = 100  # plans
_END = 1.0  # [s] for a process to end by itself
_PAUSE = 1.0  # [s] before a process is replaced that has ended without a forecast
_LONG = 30.0  # [s] without an answer, from which on a process is reported
_ENDED = Answer(problem="the process that forecast it has ended; another begins")


class _Worker(threading.Thread):
    """A process that forecasts one plan after the other, and the thread that talks to it.

    Args:
        example: a pickled simulator, to load machine code with.
        plans: pickled requests. answers: their results.

    Attributes:
        process: the present process; None before the first one.
        trouble, failed_starts: why no process can be started (one line, or empty), and how often.
    """

    def __init__(self, example: bytes, plans: Queue[bytes], answers: SimpleQueue[Answer]) -> None:
        super().__init__(name="forecaster", daemon=True)
        self._example, self._plans, self._answers = example, plans, answers
        self._closing = threading.Event()
        self._since: float | None = None
        self.process: BaseProcess | None = None
        self.trouble, self.failed_starts = "", 0

    @property
    def working_for(self) -> float:
        """Time for which it has worked on a plan [s]."""
        since = self._since
        return 0.0 if since is None else time.monotonic() - since

    def run(self) -> None:
        """Have a process, until the end."""
        while not self._closing.is_set():
            try:
                process, connection = self._begun()
            except OSError as error:  # no memory, or too many processes or open files
                self.trouble = f"no process can be started ({error.strerror}); it is tried again"
                self.failed_starts += 1
                self._closing.wait(_PAUSE)
                continue
            self.process, self.trouble = process, ""
            # `close` sets `_closing` before it looks for a process to end: one of the two sees it.
            with connection:
                answered = not self._closing.is_set() and self._serve(connection)
            process.kill()  # it may still be there, and not listen
            process.join()
            if not answered:
                self._closing.wait(_PAUSE)

    def _begun(self) -> tuple[BaseProcess, Connection]:
        """A process that is starting, and our side of the pipe to it."""
        ours, theirs = children().Pipe()
        try:
            process = children().Process(target=_work, args=(theirs, self._example), daemon=True)
            process.start()
        except BaseException:
            ours.close()
            raise
        finally:
            theirs.close()
        return process, ours

    def _serve(self, connection: Connection) -> bool:
        """Hand over plans and answers until one side has ended; returns whether there was any."""
        answered = False
        try:
            connection.recv()  # it is ready
            while True:
                planned = self._next_plan()
                if planned is None:
                    return answered
                self._since = time.monotonic()
                connection.send_bytes(planned)
                self._answers.put(connection.recv())
                self._since = None
                answered = True
        except (EOFError, OSError):
            if self._since is not None and not self._closing.is_set():
                self._answers.put(_ENDED)
            self._since = None
            return answered

    def _next_plan(self) -> bytes | None:
        """The plan that has waited longest; None at the end, or when the process has ended."""
        while not self._closing.is_set() and self.process is not None and self.process.is_alive():
            with contextlib.suppress(Empty):
                return self._plans.get(timeout=0.2)
        return None

    def close(self) -> None:
        """End thread and process."""
        self._closing.set()
        if self.process is not None:
            self.process.terminate()
            self.join(_END)
            self.process.kill()  # it may have been stopped, or not have listened
        self.join()


class Forecaster:
    """Passes the plans of a session to `count` processes, and returns the messages about them.

    Args:
        topic: resolved name of ~/plan.

    Attributes:
        record: counts the plans.

    Raises:
        SceneError: the method of the session cannot follow plans.
    """

    def __init__(self, session: Session, topic: str, count: int) -> None:
        check_method(session.scene, session.simulator.method)
        self._session = session
        self.record = TopicRecord(topic, occasional=True)
        self._waiting: Queue[bytes] = Queue(_MOST_WAITING)
        self._answers: SimpleQueue[Answer] = SimpleQueue()
        example = pickle.dumps(session.simulator)
        self._workers = [_Worker(example, self._waiting, self._answers) for _ in range(count)]
        self._answered = self._failed = self._failed_reported = 0
        self._last = Answer()
        for worker in self._workers:
            worker.start()

    def accept(self, raw: bytes, arrival_ns: int) -> None:
        """Take one serialised plan; the present state goes with it."""
        self.record.last_arrival_ns = arrival_ns
        try:
            if self._waiting.full():
                what = f"{self._waiting.maxsize} plans wait; plan less often or raise"
                raise Refused("too_many", f"{what} forecast.processes")
            self._waiting.put_nowait(pickle.dumps(request(self._session, raw, arrival_ns)))
        except Refused as refused:
            self.record.refuse(refused.reason, refused.detail)

    def answers(self) -> Iterator[OutgoingMessage]:
        """Messages about plans that have been forecast since the last call."""
        while not self._answers.empty():
            result = self._answers.get_nowait()
            if result.refused is not None:
                self.record.refuse(*result.refused)
                continue
            self.record.accepted += 1
            self._last = result
            self._answered += 1
            self._failed += bool(result.problem)
            yield from result.messages

    def statuses(self, now_ns: int) -> list[DiagnosticStatus]:
        """For the diagnostics at this time of the clock [ns]."""
        fresh, self._failed_reported = self._failed - self._failed_reported, self._failed
        values = (
            ("plans forecast", str(self._answered)),
            ("plans that failed", str(self._failed)),
            ("plans waiting", str(self._waiting.qsize())),
            ("failed starts of processes", str(sum(one.failed_starts for one in self._workers))),
            *self._last.values,
        )
        level, message = OK, "forecasting"
        slow = max(self._workers, key=lambda worker: worker.working_for)
        if slow.working_for > _LONG and slow.process is not None:
            level = WARN
            message = (
                f"process {slow.process.pid} has not answered for {slow.working_for:.0f} s; plan "
                "shorter motions, or end it, and another begins"
            )
        trouble = max(worker.trouble for worker in self._workers)
        if trouble:
            level, message = WARN, trouble
        if fresh:
            level, message = WARN, f"{fresh} plans failed, last: {self._last.problem}"
        status = DiagnosticStatus(level, "forecast", message, values)
        return [status, topic_status(self.record, now_ns)]

    def close(self) -> None:
        """End the processes."""
        for worker in self._workers:
            worker.close()


def _work(connection: Connection, example: bytes) -> None:
    """Send None when ready, then answer requests until the other side is closed."""
    simulator: Simulator = pickle.loads(example)
    simulator.forecast(Plan([0.0, simulator.step], {}), simulator.step)  # loads machine code
    result: Answer | None = None
    while True:
        try:
            connection.send(result)
            result = answer(connection.recv())
        except (EOFError, OSError):
            return
