"""How well the ticks keep up with the clock: counts and times between two diagnostic reports."""

from dataclasses import dataclass

_LATE = 2.5  # periods between two ticks from which on a publication counts as late


@dataclass
class TickTimes:
    """Accumulates the ticks of one report interval. All times [ns].

    Attributes:
        ticks: ticks made, in all.
        dropped: timer periods without a tick, in all; the next tick has simulated their time.
        late: gaps between ticks of more than 2.5 periods, in all.
    """

    ticks: int = 0
    dropped: int = 0
    late: int = 0
    _late_reported: int = 0
    _count: int = 0
    _busy: int = 0
    _longest: int = 0
    _stepping: int = 0
    _steps: int = 0
    _previous: int | None = None
    _interval_begin: int | None = None

    def record(
        self, clock: int, begin: int, stepped: int, end: int, steps: int, period: int
    ) -> None:
        """Add one tick.

        Args:
            clock: the clock that the timer follows, at this tick.
            begin, stepped, end: steady clock when the tick began, the steps were done, and all was
                published.
            steps: steps made.
            period: timer period wanted.
        """
        if self._interval_begin is None:
            self._interval_begin = begin
        if self._previous is not None:
            gap = clock - self._previous
            self.dropped += max(0, round(gap / period) - 1)
            self.late += gap > _LATE * period
        self._previous = clock
        self.ticks += 1
        self._count += 1
        self._busy += end - begin
        self._longest = max(self._longest, end - begin)
        self._stepping += stepped - begin
        self._steps += steps

    def interrupt(self) -> None:
        """The next gap is not a lapse: the timer was changed or the clock stood still or jumped."""
        self._previous = None

    def report(self, now: int, step: float) -> tuple[dict[str, str], int]:
        """Values for the diagnostics of the interval that ends now, and how many ticks in it were
        late; begin a new one.

        Args:
            now: steady clock.
            step: duration of one step [s].
        """
        begin = now if self._interval_begin is None else self._interval_begin
        elapsed = max(now - begin, 1)
        values = {
            "ticks": str(self.ticks),
            "dropped ticks": str(self.dropped),
            "late ticks": str(self.late),
            "tick rate [Hz]": f"{self._count / elapsed * 1e9:.1f}",
            "tick time mean [ms]": f"{_ratio(self._busy, self._count) * 1e-6:.3f}",
            "tick time max [ms]": f"{self._longest * 1e-6:.3f}",
            "step time mean [us]": f"{_ratio(self._stepping, self._steps) * 1e-3:.2f}",
            "real-time factor": f"{_ratio(self._steps * step * 1e9, self._stepping):.1f}",
            "load": f"{self._busy / elapsed:.3f}",
        }
        self._count = self._busy = self._longest = self._stepping = self._steps = 0
        late, self._late_reported = self.late - self._late_reported, self.late
        self._interval_begin = now
        return values, late


def _ratio(amount: float, count: float) -> float:
    return amount / count if count else 0.0
