"""Two grippers at 50 Hz, a session on a clock of its own, and all that delays and dates messages in
between; random cases of it.

`python test/session/disturbances.py 2000` runs so many cases and says which fail.
"""

from __future__ import annotations

import math
import sys
from collections import Counter
from dataclasses import dataclass
from typing import Any, cast

import numpy as np
from fake_simulator import FakeSimulator
from session_bench import LOADED, MS, SECOND

from dlo_sim.scene.loading import scene_from_values
from dlo_sim.session import cdr
from dlo_sim.session.session import Session

EPOCH = 1_700_000_000 * SECOND
PERIOD = 20 * MS
TICK = 5 * MS
QUEUE = 100
FIRST = 0.05  # every topic has had a message [s]
SPEED = 5  # of a queue that empties, in real time
TWO = {
    **LOADED,
    "end.pose_topic": "/other_pose",
    "end.fixed": [True] * 3,
    "end.position": [0.9, 0.0, 0.0],
}
TOPICS = {"/gripper_pose": "start", "/other_pose": "end"}
ENCODER = cdr.StampedEncoder(cdr.POSE_STAMPED, "world")
WRENCH = "/wrench"
WRENCH_ENCODER = cdr.StampedEncoder(cdr.WRENCH_STAMPED, "world")


def place(topic: str, true_ns: int) -> np.ndarray:
    """Where the gripper really is [m]."""
    t = true_ns * 1e-9
    x = 0.0 if topic == "/gripper_pose" else 0.9
    return np.array([x + 0.1 * math.sin(2.0 * t), 0.05 * math.sin(3.1 * t + x), 0.0])


@dataclass(frozen=True)
class Case:
    """One disturbance. All times [s], since the beginning.

    Attributes:
        at, length: when it begins; the length of a hold-up.
        kind: `node`: the process stands still; `topic`: nothing comes on one topic; `both`: on
            all; `drain`: the same, and what waited comes at SPEED times real time; `clocks`,
            `node_clock`, `source_clocks`: set by `jump`; `loop`: the bag begins anew; `nonsense`:
            one stamp is wrong by `jump`.
        sim_time: the clock is /clock, 100 a second, and stands still with the process.
        difference: clock of the second source minus that of the first.
        epoch: clock minus stamps (an old recording).
        tick_first: whether a tick or the messages come first after a hold-up.
        clock_first: whether /clock is heard before the messages that waited.
        jitter: largest delay of the transport.
        mode: inputs.time.
        unstamped: whether the wrenches carry no stamp.
    """

    kind: str
    at: float
    length: float = 0.0
    jump: float = 0.0
    sim_time: bool = False
    difference: float = 0.0
    epoch: float = 0.0
    tick_first: bool = False
    clock_first: bool = True
    jitter: float = 0.008
    mode: str = "auto"
    unstamped: bool = False
    seed: int = 0

    @property
    def over(self) -> float:
        """When the disturbance is over."""
        drained = self.length / (SPEED - 1) if self.kind == "drain" else 0.0
        return self.at + self.length + drained

    @property
    def hold_up(self) -> bool:
        """Whether messages are only late."""
        return self.kind in ("node", "topic", "both", "drain")

    @property
    def settled(self) -> float:
        """How long after it all must be as if it had not been: the latency and one second, and what
        stamps take that were set back by less than a jump.
        """
        small = "clock" in self.kind and abs(self.jump) < 1.0
        return 1.06 + (abs(self.jump) + abs(self.difference) if small else 0.0)


def random_case(seed: int) -> Case:
    rng = np.random.default_rng(seed)

    def one_of(*values):
        return values[rng.integers(len(values))]

    kinds = ("node", "node", "topic", "both", "clocks", "node_clock", "source_clocks", "loop")
    kind = one_of(*kinds, "nonsense", "drain", "drain")
    far = 4e8 if kind == "nonsense" else 10.0
    sim_time = bool(rng.integers(2)) and "clock" not in kind
    return Case(
        kind,
        at=float(rng.uniform(1.5 if kind == "loop" else 0.0, 4.0)),
        length=float(0.2 * 300 ** rng.uniform())
        if kind in ("node", "topic", "both", "drain")
        else 0.0,
        jump=one_of(-1, 1) * one_of(3600.0, 3600.0, 0.3, 0.7, 1.5, far),
        sim_time=sim_time,
        difference=one_of(0.0, 0.0, 0.3, -0.3),
        epoch=0.0 if sim_time else one_of(0.0, 0.0, 1e6),
        tick_first=bool(rng.integers(2)),
        clock_first=bool(rng.integers(2)),
        jitter=one_of(0.0, 0.008, 0.03),
        unstamped=bool(rng.integers(2)),
        seed=seed,
    )


class World:
    """Plays a case, true time running from 0."""

    def __init__(self, case: Case, **changes) -> None:
        self.case = case
        self.rng = np.random.default_rng(case.seed)
        self.session = Session(
            scene_from_values(
                {**TWO, "accuracy.estimate": "off", "inputs.time": case.mode, **changes}
            ),
            cast(Any, FakeSimulator),
        )
        self.wrongly_refused: list[str] = []
        self.doubles = 0  # unstamped messages that came at one instant
        self.refusals: list[int] = []  # in all, at each tick after it should be over
        self.stamps: list[int] = []
        self._watch_decisions()
        self.end_ns = round((case.over + 4.0) * SECOND)
        self._clock_ns: int | None = None

    def _watch_decisions(self) -> None:
        base: Any = self.session._time  # its methods are replaced

        def watched(method):
            def call(source, *rest):
                for decision in method(source, *rest):
                    stamp_ns = decision.message.stamp_ns
                    if decision.refusal is not None:
                        self.doubles += stamp_ns == source.last_ns
                        if source.last_ns is not None and stamp_ns > source.last_ns:
                            self.wrongly_refused.append(str(decision.refusal))
                    yield decision

            return call

        base.sort, base.due = watched(base.sort), watched(base.due)

    def shown(self, true_ns: int) -> int:
        """What the stamps of the first source call this time."""
        case, at = self.case, self.case.at * SECOND
        jump = round(case.jump * SECOND) if true_ns >= at else 0
        stamp = EPOCH - round(case.epoch * SECOND) + true_ns
        if case.kind in ("clocks", "source_clocks"):
            stamp += jump
        if case.kind == "loop" and true_ns >= at:
            stamp -= round(at)
        return stamp

    def clock(self, true_ns: int) -> int:
        """What the node's clock says."""
        case, at = self.case, self.case.at * SECOND
        if case.sim_time:
            return self.shown(true_ns // (10 * MS) * (10 * MS))
        jump = round(case.jump * SECOND) if true_ns >= at else 0
        return EPOCH + true_ns + (jump if case.kind in ("clocks", "node_clock") else 0)

    def deliveries(self) -> list[tuple[int, int, str]]:
        """(true time of delivery, true time of the stamp, topic), in order; None lost."""
        case, found = self.case, []
        at, over = round(case.at * SECOND), round(case.over * SECOND)
        begin = round((case.at + case.length) * SECOND)
        for k, topic in enumerate([*TOPICS, WRENCH]):
            held: list[tuple[int, int, str]] = []
            arrival = 0
            for sent in range(7 * MS * k, self.end_ns, PERIOD):
                delay = int(self.rng.uniform(0, case.jitter * SECOND + 1))
                arrival = max(arrival, sent + delay)
                came = arrival
                if case.kind == "drain" and arrival >= at:
                    came = max(arrival, begin + (arrival - at) // SPEED)
                stopped = case.kind in ("node", "both") or (case.kind == "topic" and k == 1)
                if stopped and at <= arrival < over:
                    held.append((over, sent, topic))
                else:
                    found += held[-QUEUE:] if held and arrival >= over else []
                    held = held if arrival < over else []
                    found.append((came, sent, topic))
        by_topic = self.rng.integers(2)
        return sorted(found, key=lambda d: (d[0], d[2] if by_topic else "", d[1], d[2]))

    def play(self) -> None:
        case = self.case
        at, over = round(case.at * SECOND), round(case.over * SECOND)
        self._pending = self.deliveries()
        self._nonsense = case.kind == "nonsense"
        tick = int(self.rng.integers(1, TICK))
        while tick < self.end_ns:
            stale = None
            if case.kind == "node" and at <= tick < over:
                self.deliver(at, None)
                stale = self.clock(at) if case.sim_time and not case.clock_first else None
                tick += TICK * (1 + (over - tick) // TICK)
                if case.tick_first and stale is None:
                    self.tick(over, self.clock(over))
            self.deliver(tick, stale)
            self.tick(tick, self.clock(tick))
            tick += TICK

    def deliver(self, until_ns: int, stale_ns: int | None) -> None:
        """Hand over what has come; on a clock that stands still, if one is given."""
        case, pending = self.case, self._pending
        while pending and pending[0][0] <= until_ns:
            arrival, sent, topic = pending.pop(0)
            stamp = self.shown(sent)
            if topic == "/other_pose":
                stamp += round(case.difference * SECOND)
                if self._nonsense and sent >= case.at * SECOND:
                    self._nonsense, stamp = False, stamp + round(case.jump * SECOND)
            raw = ENCODER.encode(stamp, (*place(topic, sent), 0, 0, 0, 1))
            if topic == WRENCH:
                raw = WRENCH_ENCODER.encode(0 if case.unstamped else stamp, (0.1, 0, 0, 0, 0, 0))
            self.session.receive(topic, raw, self.clock(arrival) if stale_ns is None else stale_ns)

    def tick(self, true_ns: int, clock_ns: int) -> None:
        session = self.session
        before = session.simulator
        report = session.tick(clock_ns)
        if session.started:
            ends = [np.array(session.simulator.end_pose(end)[0]) for end in TOPICS.values()]
            if session.simulator is before and self._ends is not None and report.advanced_steps:
                way = max(float(np.abs(b - a).max()) for a, b in zip(self._ends, ends, strict=True))
                passed = report.advanced_steps * session.simulator.step
                self.top_speed = max(self.top_speed, way / passed)
            self._ends = ends
        if true_ns > (self.case.over + self.case.settled) * SECOND:
            self.refusals.append(session.journal.refused.total() - self.doubles)
            if session.started:
                self.check(true_ns, clock_ns)

    _ends: list[np.ndarray] | None = None
    top_speed = 0.0
    worst_age = 0.0
    worst_error = 0.0
    checks = 0

    def check(self, true_ns: int, clock_ns: int) -> None:
        """How old the state is, and how far the ends are from where they were then."""
        session = self.session
        state_ns = session.stamp_ns - session.offset_ns  # in stamps
        now_ns = self.shown(true_ns)
        self.worst_age = max(self.worst_age, (now_ns - state_ns) * 1e-9)
        for topic, end in TOPICS.items():
            true_state = true_ns - (now_ns - state_ns)
            if topic == "/other_pose":
                true_state -= round(self.case.difference * SECOND)
            there = np.asarray(session.simulator.end_pose(end)[0])
            error = float(np.abs(there - place(topic, true_state)).max())
            self.worst_error = max(self.worst_error, error)
        self.checks += 1

    def problems(self) -> list[str]:
        """What is wrong after the play, none if it passed."""
        found = []
        hold_up = self.case.hold_up
        if len(self.wrongly_refused) > (self.case.kind == "nonsense"):
            found.append(f"{len(self.wrongly_refused)} refused, last {self.wrongly_refused[-1]}")
        refused = self.session.journal.refused.copy()
        refused["out_of_order"] -= self.doubles
        # A topic held up before its first message cannot be told from one whose clock is wrong.
        excused = {"too_old"} if self.case.at <= FIRST else set()
        if hold_up and (+refused).keys() - excused:
            found.append(f"refused {dict(refused)}")
        if self.refusals[-1] > self.refusals[0]:
            found.append(f"refused {dict(refused)}, when it was over")
        if hold_up and self.session.journal.events["time_jump"]:
            found.append("taken for a jump")
        if self.checks < 100:
            found.append(f"running in {self.checks} ticks only")
        if hold_up and self.top_speed > 3.0:
            found.append(f"an end moved at {self.top_speed:.3g} m/s")
        allowed = 0.06 + 0.03 + self.case.jitter + abs(self.case.difference)
        allowed += 0.0 if hold_up else 1.0
        if self.worst_age > allowed:
            found.append(f"{self.worst_age:.3f} s old, allowed {allowed:.3f}")
        if self.worst_error > 1e-3:
            found.append(f"{self.worst_error:.4f} m away")
        return found


def main() -> None:
    count, first = int(sys.argv[1]), int(sys.argv[2]) if len(sys.argv) > 2 else 0
    failed: Counter[str] = Counter()
    totals: Counter[str] = Counter()
    for seed in range(first, first + count):
        case = random_case(seed)
        world = World(case)
        world.play()
        totals[case.kind] += 1
        if problems := world.problems():
            failed[case.kind] += 1
            print(case, problems, dict(world.session.journal.events))
    print({kind: f"{failed[kind]} of {number} failed" for kind, number in totals.items()})


if __name__ == "__main__":
    main()
