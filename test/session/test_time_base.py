"""Each row of the table of cases in `TimeBase`."""

from collections import Counter

import pytest

from dlo_sim.session.cdr import Stamped
from dlo_sim.session.time_base import MOST_PENDING, SECOND, Copy, TimeBase

MS = SECOND // 1000
T0 = 1000 * SECOND
CLOCK = 1_700_000_000 * SECOND
USE, OVER = "used", "all starts over"


class Stream:
    """A time base and its sources; uses what it decides to use."""

    def __init__(self, mode="auto", sources=1):
        self.base = TimeBase(mode)
        self.sources = [self.base.add_source() for _ in range(sources)]
        self.refused = Counter()
        self.used = []

    def _follow(self, source, decisions):
        outcomes = []
        for decision in decisions:
            if decision.refusal is None:
                source.use(decision.message)
                self.used.append(decision.message.stamp_ns)
                outcomes.append(OVER if decision.restart else USE)
            else:
                copy = isinstance(decision.refusal, Copy)
                outcomes.append("copy" if copy else decision.refusal.reason)
                self.refused[outcomes[-1]] += 1
        return outcomes

    def send(self, stamp_ns, clock_ns, source=0, values=()):
        """What becomes of it, and of those that waited with it."""
        self.base.watch(clock_ns, tick=False)
        source = self.sources[source]
        return self._follow(source, self.base.sort(source, Stamped(stamp_ns, "", values), clock_ns))

    def tick(self, clock_ns):
        self.base.watch(clock_ns, tick=True)
        return [out for s in self.sources for out in self._follow(s, self.base.due(s, clock_ns))]

    def run(self, begin_ns, seconds, late_ns=0, source=0):
        """A message each 20 ms, so much later than its stamp."""
        outcomes = []
        for stamp in range(begin_ns, begin_ns + round(seconds * SECOND), 20 * MS):
            outcomes += self.send(stamp, stamp + late_ns, source)
            outcomes += self.tick(stamp + late_ns)
        return outcomes


def test_which_messages_are_placed_by_their_stamp():
    for mode, stamp, placed in (
        ("auto", T0, T0),
        ("auto", 0, T0 + MS),
        ("stamp", T0, T0),
        ("arrival", T0, T0 + MS),
    ):
        stream = Stream(mode)
        assert stream.send(stamp, T0 + MS) == [USE]
        assert stream.used == [placed]


def test_unstamped_messages_of_one_instant_are_one():
    stream = Stream("arrival")
    assert stream.send(0, T0) == [USE]
    assert stream.send(0, T0) == ["copy"]
    assert stream.send(0, T0, values=(1.0,)) == ["out_of_order"]
    assert stream.send(0, T0 + 1) == [USE]


def test_slow_messages_correct_an_offset_too():
    """One a second: each is a second nearer to the clock than the one before."""
    stream = Stream()
    over = T0 + 5 * SECOND
    for stamp in range(T0, over, SECOND):
        stream.send(stamp, over)
    for now in range(over, over + 2 * SECOND, 20 * MS):
        stream.tick(now)
    assert stream.base.offset_ns == 0
    assert stream.used == list(range(T0, over, SECOND))
    assert not stream.refused


def test_while_the_clock_stands_still_few_wait():
    stream = Stream()
    stream.run(T0, 1.0)
    now = T0 + SECOND
    for k in range(5000):
        stream.send(now + SECOND + k * MS, now)
    assert len(stream.sources[0].pending) == MOST_PENDING
    assert stream.refused == {"in_future": 5000 - MOST_PENDING}
    assert stream.tick(now + 6 * SECOND) == [USE] * MOST_PENDING


def test_what_was_dated_by_the_clock_comes_again_in_the_epoch_of_the_first_stamp():
    """Of another topic at its next message or tick, the newest hundred."""
    stream = Stream(sources=2)
    for k in range(300):
        assert stream.send(0, CLOCK + k * MS, values=(k,)) == [USE]
    assert stream.send(T0 + SECOND, CLOCK + SECOND, source=1) == [OVER]
    assert stream.base.offset_ns == CLOCK - T0
    assert stream.tick(CLOCK + SECOND) == [USE] * 100
    assert stream.used[-100:] == [T0 + k * MS for k in range(200, 300)]
    assert stream.tick(CLOCK + SECOND) == []
    same = Stream()
    assert same.send(0, CLOCK) == same.send(CLOCK + 1, CLOCK + MS) == [USE]
    assert same.tick(CLOCK + MS) == []


class TestWhichClockIsWrong:
    """Two topics whose stamps are seconds apart: the one that differs is refused, not the other."""

    @staticmethod
    def play(differences, poses=(True, False), seconds=1.0, begins=None):
        """Messages at 50 Hz whose stamps are the clock plus a difference; returns the stream."""
        stream = Stream(sources=len(differences))
        for source, pose in zip(stream.sources, poses, strict=True):
            source.is_pose = pose
        stream.outcomes = [[] for _ in differences]
        for k in range(round(50 * seconds)):
            for j, difference in enumerate(differences):
                clock = CLOCK + k * 20 * MS + (7 * MS * j if begins is None else begins[j])
                if k == 0 or clock > CLOCK:
                    stream.outcomes[j] += stream.send(clock + round(difference * SECOND), clock, j)
                    stream.outcomes[j] += stream.tick(clock)
        return stream

    @pytest.mark.parametrize("off", [5.0, -5.0, 90.0, -90.0, 0.7, -1.2, -1e6, 1e6])
    @pytest.mark.parametrize("first", [True, False])
    def test_the_one_that_does_not_fit_the_clock(self, off, first):
        """Even if it comes first, and even if it is that of the poses."""
        differences = (off, 0.0) if first else (0.0, off)
        stream = self.play(differences, poses=(True, True))
        wrong, right = (0, 1) if first else (1, 0)
        assert stream.base.offset_ns == 0
        assert USE in stream.outcomes[right][-20:] and set(stream.outcomes[right][-20:]) == {USE}
        if off == 0.7:  # a message so little ahead waits until its time comes
            assert set(stream.outcomes[wrong][-20:]) == {USE}
        else:
            assert not {USE, OVER} & set(stream.outcomes[wrong][-20:])

    @pytest.mark.parametrize("off", [5.0, -5.0, 1e3])
    @pytest.mark.parametrize("pose", [0, 1])
    def test_of_an_old_recording_the_one_that_is_no_pose(self, off, pose):
        epoch = -1e6
        differences = [epoch + off, epoch + off]
        differences[pose] = epoch
        stream = self.play(differences, poses=[pose == 0, pose == 1])
        assert stream.base.offset_ns == pytest.approx(1e6 * SECOND, abs=MS)
        assert set(stream.outcomes[pose][-20:]) == {USE}
        assert not {USE, OVER} & set(stream.outcomes[1 - pose][-20:])

    def test_a_topic_that_was_held_up_blames_no_other(self):
        """Its messages of three seconds come at one instant: their distances do not agree."""
        stream = self.play([-1e6, -1e6], poses=(False, True), begins=(0, -4 * SECOND), seconds=4)
        assert stream.outcomes[0].count(OVER) == 0
        over = CLOCK + 4 * SECOND
        for k in range(150):
            stamp = over - 3 * SECOND + k * 20 * MS - 10**6 * SECOND
            assert OVER not in stream.send(stamp, over, 1)
