"""The node's own line in /diagnostics: ticks, clock, publishers per input topic."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field

from dlo_sim.session.cdr import DiagnosticStatus
from dlo_sim.session.diagnostics import OK, WARN


class ClockWatch:
    """Notices that simulated time has not begun or stands still: no timer on that clock could.

    Attributes:
        problem: what is wrong, one line; empty if the clock runs.
        refused: messages on /clock that are no time, in all.
        jumps: how often the clock was set back or exchanged; whoever notices counts.
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
        """Compare with the last look.

        Args:
            clock_ns: the node's clock [ns].
            steady: a clock that always runs [s].
        """
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
    """The publishers on the name of one input.

    Attributes:
        topic: its name on the wire.
        type: what the input takes, for example geometry_msgs/msg/PoseStamped.
        count: publishers of that type.
        mismatched: node and type of each publisher of another type; ROS connects none of them.
    """

    topic: str
    type: str
    count: int = 0
    mismatched: list[tuple[str, str]] = field(default_factory=list)

    @property
    def problems(self) -> list[str]:
        """What is wrong, one line each."""
        lines = [
            f"{node} publishes {other} on {self.topic}, the input takes {self.type}; publish that"
            for node, other in self.mismatched
        ]
        if self.count > 1:
            lines.append(f"{self.count} publishers on {self.topic}; keep one: they mix")
        return lines


def node_status(
    timing: Mapping[str, str],
    late: int,
    clock: ClockWatch,
    sources: Sequence[InputSources],
) -> DiagnosticStatus:
    """One status of all that only the node can measure.

    Args:
        timing: values of the ticks since the last report.
        late: publications that came late since the last report.
        clock: what is known of /clock.
        sources: who publishes on each input topic.
    """
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
