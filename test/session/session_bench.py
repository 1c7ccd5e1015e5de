"""Scenes and a workbench for sessions on the fake simulator."""

from __future__ import annotations

from fake_simulator import FakeSimulator

from dlo_sim.scene.loading import scene_from_values
from dlo_sim.session import cdr
from dlo_sim.session.session import Session

GRIPPER = {
    "gravity": [0.0, 0.0, 0.0],
    "start.pose_topic": "/gripper_pose",
    "start.frame": "tool",
    "integrator.step": 1e-3,
    "discretization.control_points": 5,
}
LOADED = {
    **GRIPPER,
    "loads.names": ["tip"],
    "loads.tip.topic": "/wrench",
    "loads.tip.timeout": 0.5,
}
FREE = {
    "gravity": [0.0, 0.0, 0.0],
    "integrator.step": 1e-3,
    "discretization.control_points": 5,
    "loads.names": ["tip"],
    "loads.tip.topic": "/wrench",
    "loads.tip.timeout": 0.5,
}
SECOND = 1_000_000_000
MS = 1_000_000


class Bench:
    """A session on a fake simulator, with messages made from numbers."""

    def __init__(self, values: dict, **changes) -> None:
        self.scene = scene_from_values({**values, **changes})
        self.session = Session(self.scene, FakeSimulator)

    def pose(
        self, stamp_ns, position=(0, 0, 0), orientation=(0, 0, 0, 1), *, arrival=None, frame="world"
    ):
        raw = cdr.StampedEncoder(cdr.POSE_STAMPED, frame).encode(
            stamp_ns, (*position, *orientation)
        )
        self.session.receive("/gripper_pose", raw, stamp_ns if arrival is None else arrival)

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
        return self.session.simulator

    def refused(self, topic) -> dict:
        return dict(self.session.journal.topics[topic].refused)

    @property
    def events(self) -> dict:
        return dict(self.session.journal.events)
