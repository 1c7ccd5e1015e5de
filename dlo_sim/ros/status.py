"""The node's own line in /diagnostics: ticks, clock, publishers per input topic."""

from __future__ import annotations

import time
from collections.abc import Iterable, Sequence
from dataclasses import dataclass, field
from typing import Any

from dlo_sim.session.cdr import DiagnosticStatus
from dlo_sim.session.diagnostics import OK, WARN, Journal

REPORT_PERIOD = 1.0  # [s], REP-107
LOG_PAUSE = 5.0  # [s] between two log lines of the same kind
_EARLY = 0.1  # [s] by which a report may come before a period is over
_LATE = 2.5  # periods between two ticks from which on a publication counts as late


class Reports:
    """When the diagnostics are due, and which lines the logger `log` of the node repeats."""

    def __init__(self, log: Any) -> None:
        self._log = log
        self._logged = (0, 0)  # events and refusals that the log knows of
        self._advised = 0  # number of lines of advice in the log
        self._source_problems: list[str] = []

    def begin(self) -> None:
        """The first ones are due in a period."""
        self._due = time.perf_counter() + REPORT_PERIOD

    def are_due(self) -> bool:
        """Whether they are, once a period; asked by a timer, and when no timer fires."""
        now = time.perf_counter()
        if now < self._due - _EARLY:
            return False
        self._due = max(self._due, now - _EARLY) + REPORT_PERIOD
        return True

    def log(self, journal: Journal, sources: Iterable[InputSources]) -> None:
        """Say in the log what the diagnostics have counted anew; not every second again."""
        counts = (sum(journal.events.values()), sum(journal.refused.values()))
        for line in journal.advice[self._advised :]:
            self._log.warning(line)
        self._advised = len(journal.advice)
        if counts[0] > self._logged[0] and journal.last_event not in journal.advice:
            self._log.warning(journal.last_event, throttle_duration_sec=LOG_PAUSE)
        if counts[1] > self._logged[1]:
            last = [f"{r.topic}: {r.last_refusal}" for r in journal.topics.values() if r.refused]
            self._log.warning(
                f"{counts[1]} messages refused so far; last on {'; '.join(last)}",
                throttle_duration_sec=LOG_PAUSE,
            )
        self._logged = counts
        problems = [line for source in sources for line in source.problems]
        for line in set(problems).difference(self._source_problems):
            self._log.warning(line)
        self._source_problems = problems


@dataclass
class TickTimes:
    """The ticks of the node and of one report interval. All times [ns].

    Attributes:
        ticks: number of ticks. dropped: timer periods without a tick, whose time the next tick has
            simulated. late: gaps between ticks of more than 2.5 periods.
    """

    ticks: int = 0
    dropped: int = 0
    late: int = 0
    _late_reported: int = 0
    _previous: int | None = None
    _begin: int | None = None
    # Of each tick since the last report: all its time, that of its steps, their number.
    _made: list[tuple[int, int, int]] = field(default_factory=list)

    def record(
        self, clock: int, begin: int, stepped: int, end: int, steps: int, period: int
    ) -> None:
        """Add one tick of `steps` steps, when the wanted timer period is `period`.

        Args:
            clock: the clock that the timer follows, at this tick.
            begin, stepped, end: steady clock when it began, had made its steps, and had published.
        """
        if self._begin is None:
            self._begin = begin
        if self._previous is not None:
            gap = clock - self._previous
            self.dropped += max(0, round(gap / period) - 1)
            self.late += gap > _LATE * period
        self._previous = clock
        self.ticks += 1
        self._made.append((end - begin, stepped - begin, steps))

    def interrupt(self) -> None:
        """The next gap is not a lapse: the timer was changed or the clock stood still or jumped."""
        self._previous = None

    def report(self, now: int, step: float) -> tuple[dict[str, str], int]:
        """Values for the diagnostics of the interval that ends now, and its number of late ticks.

        Begins a new interval. `now`: steady clock; `step`: duration of one step [s].
        """
        elapsed = max(now - (now if self._begin is None else self._begin), 1)
        count = len(self._made)
        busy, stepping, steps = map(sum, zip(*self._made, strict=True)) if count else (0, 0, 0)
        longest = max((tick[0] for tick in self._made), default=0)
        values = {
            "ticks": str(self.ticks),
            "dropped ticks": str(self.dropped),
            "late ticks": str(self.late),
            "tick rate [Hz]": f"{count / elapsed * 1e9:.1f}",
            "tick time mean [ms]": f"{busy / max(count, 1) * 1e-6:.3f}",
            "tick time max [ms]": f"{longest * 1e-6:.3f}",
            "step time mean [us]": f"{stepping / max(steps, 1) * 1e-3:.2f}",
            "real-time factor": f"{steps * step * 1e9 / max(stepping, 1):.1f}",
            "load": f"{busy / elapsed:.3f}",
        }
        late, self._late_reported = self.late - self._late_reported, self.late
        self._begin, self._made = now, []
        return values, late


class ClockWatch:
    """Notices that simulated time has not begun or stands still, which no timer on that clock
    could.

    Attributes:
        problem: what is wrong, one line; empty if the clock runs.
        refused: number of invalid messages on /clock. jumps: how often the clock was set back or
            exchanged; incremented by LiveCable.
    """

    def __init__(self) -> None:
        self.problem = ""
        self.refused = self.jumps = 0
        self._refused_reported = 0
        self._last_refused = ""
        self._seen_ns = 0
        self._since = 0.0

    def accept(self, sec: int, nanosec: int) -> bool:
        """Whether ROS can hold this time of /clock; one that it cannot is counted."""
        if sec >= 0 and nanosec < 1_000_000_000:
            return True
        self.refused += 1
        self._last_refused = f"sec {sec}, nanosec {nanosec}"
        return False

    def look(self, clock_ns: int, steady: float) -> None:
        """Compare the node's clock [ns] and a steady clock [s] with the last call."""
        if clock_ns != self._seen_ns:
            self._seen_ns, self._since, self.problem = clock_ns, steady, ""
        elif clock_ns == 0:
            self.problem = (
                "use_sim_time is true and no /clock has come; publish /clock or set it to false"
            )
        else:
            self.problem = f"/clock has stood still for {steady - self._since:.0f} s"
        fresh = self.refused - self._refused_reported
        self._refused_reported = self.refused
        if fresh:
            refusal = (
                f"{fresh} times on /clock refused, last {self._last_refused}; "
                "publish 0 s or more and nanoseconds below 1e9"
            )
            self.problem = "; ".join(filter(None, (refusal, self.problem)))


@dataclass
class InputSources:
    """The publishers on one input topic.

    Attributes:
        topic: its resolved name. type: of the input, such as geometry_msgs/msg/PoseStamped.
        count: publishers of that type. mismatched: node and type of each publisher of another type,
            which ROS does not connect.
    """

    topic: str
    type: str
    count: int = 0
    mismatched: list[tuple[str, str]] = field(default_factory=list)

    @property
    def problems(self) -> list[str]:
        """One line for each thing that is wrong."""
        lines = [
            f"{node} publishes {kind} on {self.topic}, the input takes {self.type}; publish that"
            for node, kind in self.mismatched
        ]
        if self.count > 1:
            lines.append(f"{self.count} publishers on {self.topic}; keep one: they mix")
        return lines


def node_status(
    times: TickTimes, now: int, step: float, clock: ClockWatch, sources: Sequence[InputSources]
) -> DiagnosticStatus:
    """One status of all that only the node can measure, of the interval that ends now.

    `now`, `step`: as of `TickTimes.report`; `sources`: publishers on each input topic.
    """
    timing, late = times.report(now, step)
    problems = [clock.problem] if clock.problem else []
    problems += [line for source in sources for line in source.problems]
    if late:
        problems.append(f"{late} publications were more than 2.5 periods apart")
    values = [
        *timing.items(),
        ("clock jumps", str(clock.jumps)),
        ("clock refused", str(clock.refused)),
        *((f"publishers on {source.topic}", str(source.count)) for source in sources),
    ]
    level = WARN if problems else OK
    return DiagnosticStatus(level, "node", "; ".join(problems) or "ticking", tuple(values))
