"""A session that is too slow sheds markers, its estimate, then time, and takes them up again."""

from __future__ import annotations

from collections import Counter

from session_bench import GRIPPER, MS, SECOND, T0, Bench, FakeEstimate, motion

from dlo_sim.session import drive
from dlo_sim.session.topics import CENTERLINE, CONTROL_POINTS

SHED = "markers_spared", "estimate_spared", "time_skipped"
FAST = {"inputs.catch_up": 0.02}  # of each tick; ticks that come every 30 ms fall behind by 10


class Overloaded:
    """A gripper's poses at 50 Hz and a session whose ticks can be too rare."""

    def __init__(self, monkeypatch, **changes) -> None:
        self.estimates: list[FakeEstimate] = []
        monkeypatch.setattr(drive, "_estimate", self.make)
        estimated = {"accuracy.estimate": "auto"}
        self.bench = Bench(GRIPPER | FAST | estimated, live=True, **changes)
        self.now, self.posed = T0, T0
        self._seen = Counter()

    def make(self, simulator, begins=False):
        self.estimates.append(FakeEstimate(simulator))
        return self.estimates[-1]

    def run(self, seconds: float, period_ns: int) -> tuple[list[str], set[str]]:
        """Tick so often for so long; what was shed or taken up, and the topics put out."""
        log: list[str] = []
        out: set[str] = set()
        for _ in range(round(seconds * SECOND / period_ns)):
            self.now += period_ns
            while self.posed <= self.now:
                self.bench.pose(self.posed, motion(self.posed))
                self.posed += 20 * MS
            self.bench.session.tick(self.now)
            out |= {message.topic for message in self.bench.session.messages()}
            events = Counter(self.bench.events)
            log += [name for name in (*SHED, "taken_up") if events[name] > self._seen[name]]
            self._seen = events
        return log, out


def test_it_sheds_in_the_written_order_and_no_more_than_it_must(monkeypatch):
    world = Overloaded(monkeypatch)
    log, out = world.run(1.0, 5 * MS)
    assert not log and {CENTERLINE, CONTROL_POINTS} <= out
    assert world.run(0.9, 30 * MS)[0] == ["markers_spared"]  # 0.3 s behind
    log, out = world.run(0.9, 30 * MS)
    assert log == ["estimate_spared"]
    assert CONTROL_POINTS in out and CENTERLINE not in out
    assert set(world.run(3.0, 30 * MS)[0]) == {"time_skipped"}
    assert world.bench.session.journal.skipped_ns > 0.9 * SECOND


def test_it_takes_up_the_last_first_once_it_keeps_up_and_waits_longer_each_time(monkeypatch):
    world = Overloaded(monkeypatch)
    assert world.run(2.8, 30 * MS)[0] == ["markers_spared", "estimate_spared"]
    assert world.run(9.5, 5 * MS)[0] == []
    log, out = world.run(1.5, 5 * MS)
    assert log == ["taken_up"] and CENTERLINE not in out
    assert world.run(18.0, 5 * MS)[0] == []
    log, out = world.run(2.0, 5 * MS)
    assert log == ["taken_up"] and CENTERLINE in out
    assert len(world.estimates) == 2


def test_an_estimate_that_was_asked_for_is_kept(monkeypatch):
    world = Overloaded(monkeypatch, **{"accuracy.estimate": "on"})
    assert tuple(dict.fromkeys(world.run(6.0, 30 * MS)[0])) == (SHED[0], SHED[2])
    assert world.run(35.0, 5 * MS)[0] == ["taken_up"]
    assert len(world.estimates) == 1


def test_a_gap_in_the_poses_and_one_long_tick_shed_nothing(monkeypatch):
    world = Overloaded(monkeypatch)
    world.run(1.0, 5 * MS)
    world.now += 900 * MS
    log, _ = world.run(1.0, 5 * MS)
    world.posed += 2 * SECOND
    assert log + world.run(3.0, 5 * MS)[0] == []


def test_a_reset_gives_everything_back(monkeypatch):
    loaded = Overloaded(monkeypatch)
    log, _ = loaded.run(3.0, 30 * MS)
    assert "estimate_spared" in log
    before = len(loaded.estimates)
    loaded.bench.session.reset()
    _, out = loaded.run(0.5, 5 * MS)
    assert CENTERLINE in out and len(loaded.estimates) == before + 1
