"""Scenes and a workbench for sessions on the fake simulator."""

from __future__ import annotations

import math
from typing import Any, cast

import numpy as np
from fake_simulator import FakeSimulator

from dlo_sim.scene.loading import scene_from_values
from dlo_sim.session import cdr
from dlo_sim.session.diagnostics import Refused
from dlo_sim.session.session import Session
from dlo_sim.simulation.error_estimate import advice
from dlo_sim.simulation.report import DiscretizationError

MS = 1_000_000
SECOND = 1_000_000_000
T0 = 1000 * SECOND
GRIPPER = {
    "gravity": [0.0, 0.0, 0.0],
    "start.pose_topic": "/gripper_pose",
    "start.frame": "tool",
    "integrator.step": 1e-3,
    "discretization.control_points": 5,
}
LOADED = {**GRIPPER, "loads.names": ["tip"], "loads.tip.topic": "/wrench", "loads.tip.timeout": 0.5}
FREE = {key: value for key, value in LOADED.items() if not key.startswith("start.")}


class Bench:
    """A session on a fake simulator, with messages made from numbers."""

    def __init__(self, values: dict, live: bool = False, transforms=None, **changes) -> None:
        # The fake simulator has no companions.
        self.scene = scene_from_values({"accuracy.estimate": "off", **values, **changes})
        self.session = Session(
            self.scene, cast(Any, FakeSimulator), live=live, transforms=transforms
        )

    def pose(
        self, stamp_ns, position=(0, 0, 0), orientation=(0, 0, 0, 1), *, arrival=None, frame="world"
    ):
        raw = cdr.StampedEncoder(cdr.POSE_STAMPED, frame).encode(
            stamp_ns, (*position, *orientation)
        )
        self.session.receive("/gripper_pose", raw, stamp_ns if arrival is None else arrival)

    def points(self, stamp_ns, *points, frame="world"):
        encoder = cdr.PoseArrayEncoder(frame, len(points))
        encoder.rows[:] = 0.0
        encoder.rows[:, :3] = np.reshape(points, (-1, 3))
        self.session.receive("/gripper_pose", encoder.encode(stamp_ns), stamp_ns)

    def wrench(self, stamp_ns, force=(0, 0, 0), torque=(0, 0, 0), *, arrival=None, frame="world"):
        raw = cdr.StampedEncoder(cdr.WRENCH_STAMPED, frame).encode(stamp_ns, (*force, *torque))
        self.session.receive("/wrench", raw, stamp_ns if arrival is None else arrival)

    def run(self, begin_ns, end_ns, period_ns=5 * MS):
        """Tick from begin to end (exclusive); returns the last report."""
        report = None
        for now in range(begin_ns, end_ns, period_ns):
            report = self.session.tick(now)
        return report

    @property
    def simulator(self) -> FakeSimulator:
        return cast(FakeSimulator, self.session.simulator)

    def refused(self, topic) -> dict:
        return dict(self.session.journal.topics[topic].refused)

    @property
    def events(self) -> dict:
        return dict(self.session.journal.events)


class FakeEstimate:
    """An error estimate that looks at nothing and reports what it is told to."""

    order = 2

    def __init__(self, simulator) -> None:
        self.simulator = simulator
        self.recent = DiscretizationError(1e-5, 2e-5)

    def advice(self, error) -> str:
        return advice(self.simulator.scene, "energy_momentum", self.simulator.step, 2, error)

    def take_over(self) -> None:
        self.recent = DiscretizationError(0.0, 0.0)

    def end(self) -> None:
        pass

    def next_look(self, steps: int) -> int:
        return steps + 1000

    def look(self, report) -> str:
        return ""


class FakeFrames:
    """What tf2 knows: transforms by frame, which may come late, and up to a time alone."""

    def __init__(self, **found) -> None:
        self.found, self.known_ns = found, 1 << 62
        self.asked: list[int] = []
        self.cleared = 0

    def lookup(self, frame, stamp_ns):
        if frame not in self.found:
            raise Refused("no_transform", f"frame_id '{frame}': nobody publishes it")
        if stamp_ns is not None:
            self.asked.append(stamp_ns)
            if stamp_ns > self.known_ns:
                raise Refused("no_transform", f"frame_id '{frame}': would extrapolate")
        return self.found[frame]

    def clear(self):
        self.cleared += 1


def poses(topic, place, begin_ns, end_ns, period_ns=10 * MS, frame="world"):
    """Messages (arrival, topic, bytes) of a gripper that is at place(seconds since T0)."""
    encoder = cdr.StampedEncoder(cdr.POSE_STAMPED, frame)
    for stamp in range(begin_ns, end_ns, period_ns):
        where = (*place((stamp - T0) * 1e-9), 0.0, 0.0, 0.0, 1.0)[:7]
        yield stamp, topic, encoder.encode(stamp, where)


def feed(session, messages, begin_ns, end_ns, period_ns=5 * MS):
    """Hand over messages (arrival, topic, bytes) as they arrive, and tick; after each tick its
    time."""
    waiting = sorted(messages, key=lambda message: message[0])
    for now in range(begin_ns, end_ns, period_ns):
        while waiting and waiting[0][0] <= now:
            arrival, topic, raw = waiting.pop(0)
            session.receive(topic, raw, arrival)
        session.tick(now)
        yield now


def motion(now):
    return 0.05 * math.sin((now - T0) * 4e-9), 0.02 * math.sin((now - T0) * 7e-9), 0.0


def play(bench, seconds, jitter=None, gap=(0.0, 0.0), tick=5 * MS):
    """Poses at 30 Hz and wrenches at 100 Hz, with jitter; returns (topic, stamp) -> bytes."""
    rng = np.random.default_rng(jitter)
    arrivals = []
    for kind, period in (("pose", 33_333_333), ("wrench", 10 * MS)):
        for stamp in range(T0, T0 + round(seconds * SECOND), period):
            if not gap[0] <= (stamp - T0) * 1e-9 < gap[1] or kind == "wrench":
                delay = 0 if jitter is None else int(rng.uniform(0, 8 * MS))
                arrivals.append((stamp + delay, kind, stamp))
    arrivals.sort()
    out: dict[tuple[str, int], bytes] = {}
    for now in range(T0, T0 + round(seconds * SECOND), tick):
        while arrivals and arrivals[0][0] <= now:
            arrival, kind, stamp = arrivals.pop(0)
            if kind == "pose":
                turn = 0.2 * math.sin((stamp - T0) * 3e-9)
                quaternion = (0, math.sin(turn), 0, math.cos(turn))
                bench.pose(stamp, motion(stamp), quaternion, arrival=arrival)
            else:
                force = (0.1 * math.sin((stamp - T0) * 5e-9), 0, 0.02)
                bench.wrench(stamp, force, arrival=arrival)
        bench.session.tick(now)
        for message in bench.session.messages():
            if message.topic in ("~/control_points", "~/start/reaction"):
                out.setdefault((message.topic, message.stamp_ns), message.data)
    return out
