"""The time at which a message takes effect, from its header stamp and the clock at its arrival.

All times within a session are in the *time base* [ns], that of the header stamps of the inputs, so
that the result does not depend on when messages arrive. The offset (clock minus time base) is zero
unless the stamps are of another epoch.
"""

from __future__ import annotations

from bisect import bisect_left
from collections import deque
from collections.abc import Iterator
from dataclasses import dataclass, field
from typing import NamedTuple

from dlo_sim.session.cdr import Stamped
from dlo_sim.session.diagnostics import Refused

SECOND = 1_000_000_000

# A stamp fits the offset if it is at most this far ahead of the clock (clocks that are not quite
# synchronised) or behind it (usual delays); a clock set back by more than the latter has jumped.
MOST_AHEAD = SECOND // 2
MOST_BEHIND = 1 * SECOND

# Stamps that do not fit are believed after PATIENCE, from AGREEMENT messages in a row that keep
# their distance from the clock within _STEADY (it changes while a queue empties). _SOON is enough
# if they fit the clock itself or none of their topic is used; no wait if they go back by over 1 s.
PATIENCE, _SOON = 2 * SECOND // 5, SECOND // 10
AGREEMENT = 3
_STEADY = SECOND // 20

# Part of an advance of the clock (by seconds, after a stop) that counts as patience.
_LONGEST_WAIT = SECOND // 10

# While the clock stands still no patience is spent; at most this many messages of a topic wait.
MOST_PENDING = 1000
_MOST_UNDATED = 100

_CURE = "synchronise the clocks or set inputs.time: arrival"


class Copy(Refused):
    """The same message again, as from a second recorder: neither used nor counted as refused."""

    def __init__(self) -> None:
        super().__init__("copy", "")


class Decision(NamedTuple):
    """Whether a message is used, ignored as a copy, or refused.

    Attributes:
        message: the message, with its stamp in the time base.
        restart: whether all earlier messages are forgotten, as stamps or clocks have jumped or are
            of another epoch.
        refusal: why it is not used (`Copy`: it was, before); None if it is.
    """

    message: Stamped
    restart: bool = False
    refusal: Refused | None = None


class _Pending(NamedTuple):
    """A waiting message, its arrival [ns], and the watched time [ns] at its arrival."""

    message: Stamped
    arrival_ns: int
    since_ns: int


@dataclass
class _Run:
    """Consecutive messages of a topic at one distance from the clock: clock minus stamp [ns] of the
    first, watched time [ns] of the first and of the last, and their number.
    """

    difference_ns: int
    since_ns: int
    last_ns: int
    number: int = 1


@dataclass
class Source:
    """State of the stamps of one topic.

    Attributes:
        is_pose: whether it drives an end effector.
        last_ns: newest stamp used in the time base [ns], None = none.
        seen: stamp -> message, of those used in the second before `last_ns`.
        passed_ns: time base [ns] up to which the simulation has used the topic, None = nothing
            used; set by the user of the messages. A later message can still be put in order.
        run: the latest messages. pending: waiting messages, in the order of their stamps.
        undated: the newest messages without a stamp, with their arrivals [ns], until a topic has a
            stamp. If that is of another epoch than the clock, they are dated again.
    """

    is_pose: bool = False
    last_ns: int | None = None
    seen: dict[int, Stamped] = field(default_factory=dict)
    passed_ns: int | None = None
    run: _Run | None = None
    pending: deque[_Pending] = field(default_factory=deque)
    undated: deque[tuple[Stamped, int]] = field(default_factory=lambda: deque(maxlen=_MOST_UNDATED))

    def clear(self) -> None:
        """Forget the used messages; waiting ones are decided by those that follow."""
        self.last_ns = self.passed_ns = None
        self.seen.clear()

    def use(self, message: Stamped) -> None:
        """Note that a message with its stamp in the time base is used."""
        stamp_ns = message.stamp_ns
        self.last_ns = stamp_ns if self.last_ns is None else max(stamp_ns, self.last_ns)
        self.seen[stamp_ns] = message
        while (oldest := next(iter(self.seen))) < self.last_ns - MOST_BEHIND:
            del self.seen[oldest]

    def conflict(self, message: Stamped) -> Refused | None:
        """Why a message that is not the newest cannot be put in its place: its stamp is taken, or
        it comes too late.
        """
        stamp_ns = message.stamp_ns
        if stamp_ns in self.seen:
            return _of_one_stamp(message, self.seen[stamp_ns])
        if self.passed_ns is not None and stamp_ns <= self.passed_ns:
            return _out_of_order(self.passed_ns - stamp_ns)
        return None

    def note(self, difference_ns: int, now_ns: int) -> None:
        """Note the distance of a stamp from the clock [ns] at this watched time [ns]."""
        run = self.run
        if run is None or abs(difference_ns - run.difference_ns) > _STEADY:
            self.run = _Run(difference_ns, now_ns, now_ns)
        else:
            run.last_ns, run.number = now_ns, run.number + 1


class TimeBase:
    """Decides for every message whether its stamp can be used, and determines the offset.

    Queues can only add delay: the smallest difference clock - stamp determines the epoch, and
    stamps that continue those of their topic are of the same epoch however late they arrive. With d
    = clock - stamp and the offset o, a message is
    - dated by its ARRIVAL if its stamp is 0, or in mode `arrival`;
    - the FIRST stamped one of all: it decides o = d, as in an old recording; messages that were
      dated by the clock before are then dated again;
    - STALE if its stamp is not after the newest used of its topic: a `copy` if it is the same
      message; used in its place if the simulation has not used a later one; else `out_of_order`, or
      `too_old` if it is more than 1 s back;
    - EARLY if it is more than 0.5 s ahead: it waits for its time, as /clock may follow, but is
      `in_future` if a later message refutes it, if others fit for 0.4 s, or if 1000 wait. Where
      nothing fits and 3 wait, a clock has JUMPED;
    - else used. If it is ahead and o is not 0, the first one was delayed: o = d. If it is more than
      1 s late and none of its topic is used, the clock of the other topics differs: `too_old`.
    A clock has JUMPED, too, if messages that do not fit keep their distance from it (a queue that
    empties does not), and more topics heard lately agree with this d than with o: first d = 0, then
    their number, then that of poses. Then o = d and all starts over, as when the clock goes back by
    more than 1 s.

    Two sources whose clocks differ by less than 0.5 s both fit. `o = d` means o = 0 if d fits the
    clock itself. In mode `stamp` o is always 0; stamps that would change it are refused.

    Args:
        mode: `auto`, `stamp` or `arrival` (stamps are ignored).
    """

    def __init__(self, mode: str) -> None:
        self._sources: list[Source] = []
        self._tick_ns: int | None = None
        self._seen_ns: int | None = None
        self._spent_ns = 0  # time for which the clock has been watched
        self.set_mode(mode)

    def set_mode(self, mode: str) -> None:
        """Start over in this mode, without an offset."""
        self.mode = mode
        self.offset_ns = 0
        self.start_over()

    def add_source(self, is_pose: bool = False) -> Source:
        """Add a topic, and whether it drives an end effector; return the state of its stamps."""
        self._sources.append(Source(is_pose))
        return self._sources[-1]

    def start_over(self) -> None:
        """Forget all used messages; in mode auto the next stamped one decides the offset."""
        self._decided, self._epoch_is_new = self.mode != "auto", False
        for source in self._sources:
            source.clear()
            source.undated.clear()

    def from_clock(self, clock_ns: int) -> int:
        """Time base [ns] at this clock time [ns]."""
        return clock_ns - self.offset_ns

    def to_clock(self, base_ns: int) -> int:
        """Clock time [ns] at this time of the time base [ns]."""
        return base_ns + self.offset_ns

    def watch(self, clock_ns: int, tick: bool) -> int:
        """Read the clock [ns]; start over if it was set back by more than 1 s since the last tick.

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
        """Decide about a valid message (stamp 0 = unstamped) and the waiting ones of its topic.

        Call `source.use` with what is used before taking the next decision. `arrival_ns`: clock
        time [ns].
        """
        dated = message.stamp_ns == 0 or self.mode == "arrival"
        if not (dated or self._decided):
            self._decide_first(arrival_ns - message.stamp_ns)
        yield from self.due(source, arrival_ns)
        if dated:
            if not self._decided:
                source.undated.append((message, arrival_ns))
            yield self._dated(source, message, arrival_ns)
            return
        placed = self._place(source, message, arrival_ns)
        if placed is None:
            yield from self._wait(source, _Pending(message, arrival_ns, self._spent_ns))
            return
        if placed.refusal is None:
            yield from self.refute(source, message.stamp_ns)
        yield placed

    def _used(self, message: Stamped, restart: bool = False) -> Decision:
        """The decision to use a message; the first one in an epoch may start all over."""
        restart, self._epoch_is_new = restart or self._epoch_is_new, False
        return Decision(message, restart)

    def _dated(self, source: Source, message: Stamped, arrival_ns: int) -> Decision:
        """Date a message by its arrival."""
        message = message._replace(stamp_ns=self.from_clock(arrival_ns))
        if source.last_ns is not None and message.stamp_ns <= source.last_ns:
            same = message == source.seen.get(message.stamp_ns)
            return Decision(message, refusal=Copy() if same else _at_one_instant())
        return self._used(message)

    def _wait(self, source: Source, new: _Pending) -> Iterator[Decision]:
        """Put a message among those that wait; refuse those that it refutes."""
        stamp_ns = new.message.stamp_ns
        yield from self.refute(source, stamp_ns + MOST_BEHIND)
        pending = source.pending
        at = bisect_left(pending, stamp_ns, key=lambda one: one.message.stamp_ns)
        if at < len(pending) and pending[at].message.stamp_ns == stamp_ns:
            yield Decision(new.message, refusal=_of_one_stamp(new.message, pending[at].message))
        else:
            pending.insert(at, new)
        if len(pending) > MOST_PENDING:
            yield self._refused(pending.popleft())

    def refute(self, source: Source, stamp_ns: int = 0) -> Iterator[Decision]:
        """Refuse the waiting messages of a topic with this stamp or a later one."""
        while source.pending and source.pending[-1].message.stamp_ns >= stamp_ns:
            yield self._refused(source.pending.pop())

    def due(self, source: Source, clock_ns: int) -> Iterator[Decision]:
        """Decide about the messages of a topic that have waited long enough; as `sort`."""
        while self._decided and source.undated:
            yield self._dated(source, *source.undated.popleft())
        while source.pending:
            first, restart = source.pending[0], False
            refusal: Refused | None = None
            ahead = first.message.stamp_ns - self.from_clock(clock_ns)
            if ahead > MOST_AHEAD:
                if self._spent_ns - first.since_ns < PATIENCE:
                    return
                if self.mode != "auto" or self._heard(self.offset_ns, PATIENCE // 2):
                    refusal = _in_future(ahead)
                elif len(source.pending) < AGREEMENT:
                    return
                else:
                    newest = source.pending[-1]
                    restart = self._begin_again(newest.arrival_ns - newest.message.stamp_ns)
            source.pending.popleft()
            if refusal is None and not restart:
                refusal = source.conflict(first.message)
            yield Decision(first.message, restart, refusal)

    def _refused(self, pending: _Pending) -> Decision:
        ahead = pending.message.stamp_ns - self.from_clock(pending.arrival_ns)
        return Decision(pending.message, refusal=_in_future(ahead))

    def _place(self, source: Source, message: Stamped, clock_ns: int) -> Decision | None:
        """Apply the rules to a stamped message that arrives now; None if it waits."""
        stamp_ns, difference_ns = message.stamp_ns, clock_ns - message.stamp_ns
        source.note(difference_ns, self._spent_ns)
        if self._has_jumped(source, stamp_ns):
            return self._used(message, self._begin_again(difference_ns))
        refusal: Refused | None = None
        if source.last_ns is not None and stamp_ns <= source.last_ns:
            back_ns = source.last_ns - stamp_ns
            refusal = _too_old(back_ns) if back_ns > MOST_BEHIND else source.conflict(message)
        ahead_ns = self.offset_ns - difference_ns
        if refusal is None and ahead_ns > MOST_AHEAD:
            return None
        if ahead_ns < -MOST_BEHIND and source.last_ns is None:
            what = "those of other topics" if self.offset_ns else "the clock"
            refusal = _too_old(-ahead_ns, what)
        if refusal is not None:
            return Decision(message, refusal=refusal)
        if self.offset_ns and ahead_ns > 0:
            self.offset_ns = _offset(difference_ns)
        return self._used(message)

    def _decide_first(self, difference_ns: int) -> None:
        """Let the first stamped message decide the offset; what another one dated starts over."""
        before_ns, self.offset_ns, self._decided = self.offset_ns, _offset(difference_ns), True
        if self.offset_ns != before_ns:
            self._epoch_is_new = any(source.last_ns is not None for source in self._sources)
        for source in self._sources:
            if self.offset_ns == before_ns:
                source.undated.clear()
            else:
                source.clear()

    def _heard(self, offset_ns: int, lately_ns: int) -> list[Source]:
        """The topics that were heard within a time [ns] with stamps that fit an offset."""
        runs = [(source, source.run) for source in self._sources]
        return [
            source
            for source, run in runs
            if run is not None
            and self._spent_ns - run.last_ns < lately_ns
            and _fits(run.difference_ns - offset_ns)
        ]

    def _has_jumped(self, source: Source, stamp_ns: int) -> bool:
        """Whether more topics agree with the distance of this newest stamp from the clock than with
        o.
        """
        run = source.run
        if run is None or self.mode != "auto":
            return False
        offset_ns = _offset(run.difference_ns)
        if _fits(run.difference_ns - self.offset_ns) and (offset_ns or not self.offset_ns):
            return False
        patience_ns = PATIENCE if offset_ns and source.last_ns is not None else _SOON
        if source.last_ns is not None and stamp_ns < source.last_ns - MOST_BEHIND:
            patience_ns = 0
        if run.number < AGREEMENT or self._spent_ns - run.since_ns < patience_ns:
            return False

        def support(offset_ns: int) -> tuple[bool, int, int]:
            theirs = self._heard(offset_ns, PATIENCE)
            return bool(theirs and not offset_ns), len(theirs), sum(s.is_pose for s in theirs)

        return support(offset_ns) > support(self.offset_ns)

    def _begin_again(self, difference_ns: int) -> bool:
        """Forget all used messages of all topics, and set a new offset."""
        self.start_over()
        self._decided, self.offset_ns = True, _offset(difference_ns)
        return True


def _offset(difference_ns: int) -> int:
    return 0 if _fits(difference_ns) else difference_ns


def _fits(behind_ns: int) -> bool:
    return -MOST_AHEAD <= behind_ns <= MOST_BEHIND


def _in_future(ahead_ns: int) -> Refused:
    return Refused("in_future", f"stamp is {ahead_ns * 1e-9:.3f} s ahead of its arrival; {_CURE}")


def _too_old(behind_ns: int, what: str = "the last one used") -> Refused:
    return Refused("too_old", f"stamp is {behind_ns * 1e-9:.3f} s behind {what}; {_CURE}")


def _of_one_stamp(message: Stamped, other: Stamped) -> Refused:
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
