"""The node's own line in /diagnostics: ticks, clock, publishers per input topic."""

from collections.abc import Mapping

from dlo_sim.session.cdr import DiagnosticStatus
from dlo_sim.session.diagnostics import OK, WARN


class ClockWatch:
    """Notices that simulated time has not begun or stands still: no timer on that clock could.

    Attributes:
        problem: what is wrong, one line; empty if the clock runs.
    """

    def __init__(self) -> None:
        self.problem = ""
        self._seen_ns = 0
        self._since = 0.0

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


def node_status(
    timing: Mapping[str, str],
    late: int,
    clock_problem: str,
    clock_jumps: int,
    publishers: Mapping[str, int],
) -> DiagnosticStatus:
    """One status of all that only the node can measure.

    Args:
        timing: values of the ticks since the last report.
        late: publications that came late since the last report.
        clock_problem: one line, empty if the clock runs.
        clock_jumps: how often the clock was set back or exchanged.
        publishers: number of publishers on each input topic.
    """
    crowded = [topic for topic, count in publishers.items() if count > 1]
    problems = [clock_problem] if clock_problem else []
    if crowded:
        problems.append(
            f"{publishers[crowded[0]]} publishers on {', '.join(crowded)}; keep one: they mix"
        )
    if late:
        problems.append(f"{late} publications were more than 2.5 periods apart")
    values = [
        *timing.items(),
        ("clock jumps", str(clock_jumps)),
        *((f"publishers on {topic}", str(count)) for topic, count in publishers.items()),
    ]
    level = WARN if problems else OK
    return DiagnosticStatus(level, "dlo_sim: node", "; ".join(problems) or "ticking", tuple(values))
