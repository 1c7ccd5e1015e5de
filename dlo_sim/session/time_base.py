"""The time at which a message takes effect, from its header stamp and the clock at its arrival.

All times within a session are in the *time base* [ns], that of the header stamps of the inputs, so
that the result does not depend on when messages arrive. The offset (clock minus time base) is zero
unless the stamps are of another epoch.
"""

from __future__ import annotations

from collections import deque
from collections.abc import Iterator
from dataclasses import dataclass, field
from enum import Enum
from typing import NamedTuple

from dlo_sim.session.cdr import Stamped
from dlo_sim.session.diagnostics import Refused

SECOND = 1_000_000_000

# A stamp fits the offset if it is at most this far ahead of the clock (clocks that are not quite
# synchronised) and at most this far behind it (usual delays). A clock set back by more than the
# latter has jumped.
MOST_AHEAD = SECOND // 2
MOST_BEHIND = 1 * SECOND

# Stamps that do not fit are believed after this time, from this many messages in a row.
PATIENCE = 2 * SECOND // 5
AGREEMENT = 3

# The clock may advance by seconds at once (a stopped process, /clock); time in which no messages
# were handled does not count as patience, so each advance counts at most this much.
_LONGEST_WAIT = SECOND // 10

# The lag of messages behind a clock that was set is constant; if it shrinks by more than this, it
# is the lag of a queue that empties.
_SHRUNK = SECOND // 20

# A topic may show that the offset is wrong, by stamps that keep the same distance from the clock,
# within _SHRUNK, for so long: any topic if they fit the clock itself, else one none of whose
# messages is used, as the offset is then another topic's fault.
_STEADY = SECOND // 10

# While the clock stands still no patience is spent; at most this many messages of a topic wait.
MOST_PENDING = 1000

_CURE = "synchronise the clocks or set inputs.time: arrival"


class Verdict(Enum):
    """Effect of a message on everything before it."""

    USE = "nothing"
    DECIDE = "it has decided the offset, until which all was dated by the clock"
    START_OVER = "it is forgotten: the stamps or clocks have jumped"


class Copy(Exception):
    """The same message again, as from a second recorder: it is neither used nor refused."""


class Decision(NamedTuple):
    """Whether a message is used, ignored as a copy, or refused.

    Attributes:
        message: the message, with its stamp in the time base.
        verdict: its effect on everything before it.
        refusal: why it is not used; None if it is.
    """

    message: Stamped
    verdict: Verdict = Verdict.USE
    refusal: Refused | Copy | None = None


class _Pending(NamedTuple):
    """A waiting message, its arrival [ns], and the watched time [ns] at its arrival."""

    message: Stamped
    arrival_ns: int
    since_ns: int


class _Run(NamedTuple):
    """Consecutive messages of a topic at one distance from the clock: arrival [ns] and clock minus
    stamp [ns] of the first, and how many they are.
    """

    since_ns: int
    difference_ns: int
    number: int = 1


class _Late(NamedTuple):
    """The watched time [ns] since which all messages are late, and their lag [ns]."""

    since_ns: int
    lag_ns: int


@dataclass
class Source:
    """State of the stamps of one topic.

    Attributes:
        is_pose: whether it drives an end effector.
        last_ns: newest stamp used in the time base [ns], None = none.
        seen: stamp -> message, of those used in the second before `last_ns`.
        passed_ns: time base [ns] up to which the simulation has used the topic; set by the user of
            the messages, None = nothing used. What comes late but after that can be put in order.
        run: the latest messages.
        pending: waiting messages, in the order of their stamps.
        strays: stamps and arrivals [ns] of the latest consecutive messages that jump back.
        uses: number of messages of all sources used when the strays began.
    """

    is_pose: bool = False
    last_ns: int | None = None
    seen: dict[int, Stamped] = field(default_factory=dict)
    passed_ns: int | None = None
    run: _Run | None = None
    pending: deque[_Pending] = field(default_factory=deque)
    strays: list[tuple[int, int]] = field(default_factory=list)
    uses: int = 0

    def clear(self) -> None:
        """Forget the used messages; waiting ones are decided by those that follow."""
        self.last_ns = self.passed_ns = None
        self.seen.clear()
        self.strays.clear()

    def use(self, message: Stamped) -> None:
        """Note that a message with its stamp in the time base is used."""
        stamp_ns = message.stamp_ns
        self.last_ns = stamp_ns if self.last_ns is None else max(stamp_ns, self.last_ns)
        self.seen[stamp_ns] = message
        while (oldest := next(iter(self.seen))) < self.last_ns - MOST_BEHIND:
            del self.seen[oldest]

    def check_free(self, message: Stamped) -> None:
        """Check that a message that is not the newest can still be put in its place.

        Raises:
            Copy: it is the same message again.
            Refused: another one has its stamp, or it comes too late.
        """
        stamp_ns = message.stamp_ns
        if stamp_ns in self.seen:
            raise _of_one_stamp(message, self.seen[stamp_ns])
        if self.passed_ns is not None and stamp_ns <= self.passed_ns:
            raise _out_of_order(self.passed_ns - stamp_ns)

    def steady(self, clock_ns: int, difference_ns: int) -> bool:
        """Note a stamped message; returns whether its topic keeps its distance from the clock."""
        run = self.run
        if run is None or abs(difference_ns - run.difference_ns) > _SHRUNK:
            self.run = _Run(clock_ns, difference_ns)
            return False
        self.run = run._replace(number=run.number + 1)
        return run.number + 1 >= AGREEMENT and clock_ns - run.since_ns >= _STEADY


class TimeBase:
    """Decides for every message whether its stamp can be used, and determines the offset.

    Queues can only add delay: the smallest difference clock - stamp determines the epoch, and
    stamps that continue those of their topic are of the same epoch however late they arrive. With
    d = clock - stamp, the offset o, and `last` = the last used stamp of the topic:

    | message | case | decision |
    |---|---|---|
    | stamp 0, or mode `arrival` | after last | used at its arrival |
    | | at the same instant, the same message again | `copy` |
    | | at the same instant or before, else | `out_of_order` |
    | first stamped one of all, mode `auto` | -0.5 s <= d <= 1 s: the clock's epoch | o = 0 |
    | | else: another epoch (an old recording), delayed, or wrong | o = d |
    | after last | -0.5 s <= d - o <= 1 s: it fits | used; if o was not 0, o = min(o, d) |
    | | later: a delay, a slow network, a queue that overflowed | used all the same |
    | | later, with a shrinking lag (50 ms): a queue that empties | used all the same |
    | | later, as all messages for 0.4 s: a clock was set forward | o = d, start over |
    | | earlier, /clock follows: the clock had stood still in a delay | waits, used |
    | | earlier, a later message refutes it: a wrong stamp | waits, `in_future` |
    | | earlier, more than 1000 wait: the clock stands still | the oldest `in_future` |
    | | earlier for 0.4 s, other messages fit: one source's clock is wrong | `in_future` |
    | | earlier for 0.4 s, nothing fits, 3 wait: a clock was set, o was wrong | o = d, start over |
    | any, o not 0 | for 0.1 s d fits the clock itself: so o was wrong | o = 0, start over |
    | none of the topic used | more topics, or more poses, have its epoch | o = d, start over |
    | | later: one source's clock is wrong, or delayed | `too_old` |
    | not after last | up to 1 s back, the same message again: a second recorder | `copy` |
    | | up to 1 s back, the simulation has not used a later one | used in its place |
    | | up to 1 s back, else | `out_of_order` |
    | | further back: one source is wrong, a wrong stamp | `too_old` |
    | | third in a row, nothing used meanwhile: a bag loops | o = d, start over |
    | the clock goes back by more than 1 s | set back, /clock loops | start over |

    Two sources whose clocks differ by less than 0.5 s both fit. `o = d` means o = 0 if d fits the
    clock itself. In mode `stamp` o is always 0; stamps that would change it are refused.

    Args:
        mode: `auto`, `stamp` or `arrival` (stamps are ignored).
    """

    def __init__(self, mode: str) -> None:
        self._sources: list[Source] = []
        self._tick_ns: int | None = None
        self._seen_ns: int | None = None
        self._uses = 0
        self._spent_ns = 0  # time for which the clock has been watched
        self.set_mode(mode)

    def set_mode(self, mode: str) -> None:
        """Start over in this mode, without an offset."""
        self.mode = mode
        self.offset_ns = 0
        self.start_over()

    def add_source(self, is_pose: bool = False) -> Source:
        """Add a topic; returns its state.

        Args:
            is_pose: whether it drives an end effector.
        """
        self._sources.append(Source(is_pose))
        return self._sources[-1]

    def start_over(self) -> None:
        """Forget all used messages; in mode auto the next stamped one decides the offset."""
        self._decided = self.mode != "auto"
        self._fit_ns = self._spent_ns - PATIENCE
        self._late: _Late | None = None
        for source in self._sources:
            source.clear()

    def from_clock(self, clock_ns: int) -> int:
        """Time base [ns] at this clock time [ns]."""
        return clock_ns - self.offset_ns

    def to_clock(self, base_ns: int) -> int:
        """Clock time [ns] at this time of the time base [ns]."""
        return base_ns + self.offset_ns

    def watch(self, clock_ns: int, tick: bool) -> int:
        """Read the clock, and start over if it was set back by more than 1 s since the last tick.

        Args:
            clock_ns: clock time [ns].
            tick: whether a tick is made now.

        Returns:
            By how much the clock was set back [ns] if the time base has started over; else 0.
        """
        passed = 0 if self._seen_ns is None else clock_ns - self._seen_ns
        self._spent_ns += min(max(0, passed), _LONGEST_WAIT)
        self._seen_ns = clock_ns
        back = 0 if self._tick_ns is None else self._tick_ns - clock_ns
        if back > MOST_BEHIND:
            self._tick_ns = None
            self.start_over()
        if tick:
            self._tick_ns = clock_ns
        return back if back > MOST_BEHIND else 0

    def sort(self, source: Source, message: Stamped, arrival_ns: int) -> Iterator[Decision]:
        """Decide about a valid message and the waiting ones of its topic.

        Call `source.use` with what is used before taking the next decision.

        Args:
            message: stamp 0 = unstamped.
            arrival_ns: clock time of its arrival [ns].
        """
        yield from self.due(source, arrival_ns)
        if message.stamp_ns == 0 or self.mode == "arrival":
            stamp_ns = self.from_clock(arrival_ns)
            refusal: Refused | Copy | None = None
            message = message._replace(stamp_ns=stamp_ns)
            if source.last_ns is not None and stamp_ns <= source.last_ns:
                same = stamp_ns in source.seen and message == source.seen[stamp_ns]
                refusal = Copy() if same else _at_one_instant()
            yield Decision(message, refusal=refusal)
            return
        try:
            verdict = self._place(source, message, arrival_ns)
        except (Copy, Refused) as refused:
            yield Decision(message, refusal=refused)
            return
        if verdict is None:
            yield from self._wait(source, _Pending(message, arrival_ns, self._spent_ns))
        else:
            yield from self.refute(source, message.stamp_ns)
            self._uses += 1
            yield Decision(message, verdict)

    def _wait(self, source: Source, new: _Pending) -> Iterator[Decision]:
        """Put a message among those that wait; refuse those that it refutes."""
        stamp_ns = new.message.stamp_ns
        yield from self.refute(source, stamp_ns + MOST_BEHIND)
        later = []
        while source.pending and source.pending[-1].message.stamp_ns >= stamp_ns:
            later.append(source.pending.pop())
        if later and later[-1].message.stamp_ns == stamp_ns:
            refusal = _of_one_stamp(new.message, later[-1].message)
            yield Decision(new.message, refusal=refusal)
        else:
            source.pending.append(new)
        source.pending.extend(reversed(later))
        if len(source.pending) > MOST_PENDING:
            yield self._refused(source.pending.popleft())

    def refute(self, source: Source, stamp_ns: int = 0) -> Iterator[Decision]:
        """Refuse the waiting messages of a topic with this stamp or a later one."""
        while source.pending and source.pending[-1].message.stamp_ns >= stamp_ns:
            yield self._refused(source.pending.pop())

    def due(self, source: Source, clock_ns: int) -> Iterator[Decision]:
        """Decide about the messages of a topic that have waited long enough; as `sort`."""
        while source.pending:
            first = source.pending[0]
            verdict = Verdict.USE
            refusal: Refused | Copy | None = None
            ahead = first.message.stamp_ns - self.from_clock(clock_ns)
            if ahead > MOST_AHEAD:
                if self._spent_ns - first.since_ns < PATIENCE:
                    return
                if self.mode != "auto" or self._spent_ns - self._fit_ns < PATIENCE // 2:
                    refusal = _in_future(ahead)
                elif len(source.pending) < AGREEMENT:
                    return
                else:
                    newest = source.pending[-1]
                    verdict = self._begin_again(newest.arrival_ns - newest.message.stamp_ns)
            source.pending.popleft()
            if refusal is None and verdict is Verdict.USE:
                try:
                    source.check_free(first.message)
                except (Copy, Refused) as refused:
                    refusal = refused
            self._uses += refusal is None
            yield Decision(first.message, verdict, refusal)

    def _refused(self, pending: _Pending) -> Decision:
        ahead = pending.message.stamp_ns - self.from_clock(pending.arrival_ns)
        return Decision(pending.message, refusal=_in_future(ahead))

    def _place(self, source: Source, message: Stamped, clock_ns: int) -> Verdict | None:
        """Apply the table to a stamped message that arrives now; None: it waits.

        Raises:
            Copy, Refused: it is not used.
        """
        stamp_ns = message.stamp_ns
        steady = source.steady(clock_ns, clock_ns - stamp_ns)
        # Deciding the offset shifts the stamps that were dated by the clock so far.
        renaming = 0 if self._decided else self.offset_ns - _offset(clock_ns - stamp_ns)
        if source.last_ns is not None and stamp_ns <= source.last_ns + renaming:
            back_ns = source.last_ns + renaming - stamp_ns
            if back_ns > MOST_BEHIND:
                return self._place_past(source, back_ns, stamp_ns, clock_ns)
            source.strays.clear()
            source.check_free(message)
            if not self._decided:
                raise _out_of_order(back_ns)
        elif not self._decided:
            self._decide(clock_ns - stamp_ns)
            for other in self._sources:
                other.seen.clear()
                if other.last_ns is not None:
                    other.last_ns += renaming
            return Verdict.DECIDE
        elif steady and self._is_better(source, clock_ns - stamp_ns):
            return self._begin_again(clock_ns - stamp_ns)
        source.strays.clear()
        ahead = stamp_ns - self.from_clock(clock_ns)
        if ahead > MOST_AHEAD:
            return None
        if ahead < -MOST_BEHIND:
            return self._place_late(source, stamp_ns, clock_ns)
        if self.offset_ns and ahead > 0:
            self.offset_ns = _offset(clock_ns - stamp_ns)
        self._note_fit()
        return Verdict.USE

    def _place_late(self, source: Source, stamp_ns: int, clock_ns: int) -> Verdict:
        lag_ns = self.from_clock(clock_ns) - stamp_ns
        if self._late is None or lag_ns < self._late.lag_ns - _SHRUNK:
            self._late = _Late(self._spent_ns, lag_ns)
        if self.mode == "auto" and self._spent_ns - self._late.since_ns >= PATIENCE:
            return self._begin_again(clock_ns - stamp_ns)
        if source.last_ns is None:
            raise _too_old(lag_ns, "the clock" if not self.offset_ns else "those of other topics")
        return Verdict.USE

    def _is_better(self, source: Source, difference_ns: int) -> bool:
        """Whether more speaks for the epoch of stamps with this distance from the clock than for
        the present one: first the clock itself, then the number of topics, then that of poses.
        The latter two count only while no message of the topic is used.
        """
        offset_ns = _offset(difference_ns)
        if self.mode != "auto" or not self.offset_ns:
            return False
        if offset_ns and (source.last_ns is not None or _fits(difference_ns - self.offset_ns)):
            return False

        def support(offset_ns: int) -> tuple[bool, int, int]:
            runs = [(source, source.run) for source in self._sources]
            theirs = [s for s, run in runs if run and _fits(run.difference_ns - offset_ns)]
            return offset_ns == 0, len(theirs), sum(source.is_pose for source in theirs)

        return support(offset_ns) > support(self.offset_ns)

    def _place_past(self, source: Source, back_ns: int, stamp_ns: int, clock_ns: int) -> Verdict:
        if source.strays:
            stamp_before, clock_before = source.strays[-1]
            passed, arrived = stamp_ns - stamp_before, clock_ns - clock_before
            if passed <= 0 or abs(passed - arrived) > MOST_BEHIND or self._uses != source.uses:
                source.strays.clear()
        if not source.strays:
            source.uses = self._uses
        source.strays.append((stamp_ns, clock_ns))
        fixed = self.mode != "auto" and not _fits(clock_ns - stamp_ns)
        if len(source.strays) < AGREEMENT or fixed:
            raise _too_old(back_ns)
        return self._begin_again(clock_ns - stamp_ns)

    def _begin_again(self, difference_ns: int) -> Verdict:
        """Forget all used messages of all topics, and set a new offset."""
        self.start_over()
        self._decide(difference_ns)
        return Verdict.START_OVER

    def _decide(self, difference_ns: int) -> None:
        self._decided = True
        self.offset_ns = _offset(difference_ns)
        self._note_fit()

    def _note_fit(self) -> None:
        self._fit_ns = self._spent_ns
        self._late = None


def _offset(difference_ns: int) -> int:
    return 0 if _fits(difference_ns) else difference_ns


def _fits(behind_ns: int) -> bool:
    return -MOST_AHEAD <= behind_ns <= MOST_BEHIND


def _in_future(ahead_ns: int) -> Refused:
    return Refused("in_future", f"stamp is {ahead_ns * 1e-9:.3f} s ahead of its arrival; {_CURE}")


def _too_old(behind_ns: int, what: str = "the last one used") -> Refused:
    return Refused("too_old", f"stamp is {behind_ns * 1e-9:.3f} s behind {what}; {_CURE}")


def _of_one_stamp(message: Stamped, other: Stamped) -> Refused | Copy:
    return Copy() if message == other else _out_of_order(0)


def _at_one_instant() -> Refused:
    return Refused(
        "out_of_order",
        "is dated by its arrival, which is not after that of the last one; stamp the messages, "
        "each differently, with inputs.time: auto",
    )


def _out_of_order(back_ns: int) -> Refused:
    if back_ns == 0:
        detail = "another message has the same stamp; stamp each differently"
    else:
        detail = (
            f"stamp is {back_ns * 1e-9:.6f} s before the last one used; send it earlier, raise "
            "inputs.latency"
        )
    return Refused("out_of_order", f"{detail} or set inputs.time: arrival")
