"""A simulator with next to no physics, for testing what surrounds it.

Control point 0 follows the start end-effector exactly; the last one is a free 1 kg point mass that
the loads accelerate. Every call that changes something is recorded with the step at which it came.
"""

from __future__ import annotations

from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
from numpy.typing import ArrayLike, NDArray

from dlo_sim.core.end_motion import EndMotion
from dlo_sim.scene.description import Scene
from dlo_sim.simulation.report import Report, Status

Array = NDArray[np.float64]


class FakeSimulator:
    """See the module."""

    built: list[FakeSimulator] = []

    def __init__(self, scene: Scene, end_poses=None, step: float = 1e-3) -> None:
        self.scene = scene
        self.step = scene.integrator.step or step
        self.method = "fake"
        self.resolution = "5 control points as the scene asks"
        self.active_terms: tuple[str, ...] = ("stretch",)
        self.left_out = {"twist": "fake"}
        self.contacts: dict[str, Any] = {}
        self.clearance_to_itself = np.inf
        self.slides: dict[str, Any] = {}
        self.warnings: tuple[str, ...] = ()
        self.fail_at: int | None = None
        self.folds_at: int | None = None  # step after which the shape is reported as a fold
        self.note = ""
        self.calls: list[tuple] = []
        self.end_poses = dict(end_poses or {})
        n = scene.discretization.control_points or 5
        self.greville = np.linspace(0.0, scene.cable.length, n)
        self._place()
        self.curves, self.points = {"cable": self}, self.centerline
        FakeSimulator.built.append(self)

    def _place(self) -> None:
        self.steps = 0
        poses = self.end_poses
        self.motions = {
            name: EndMotion.resting(*poses.get(name, (end.position, (0, 0, 0, 1))))
            for name, end in self.scene.ends.items()
        }
        self.tip = np.array(self.scene.end.position, dtype=float)
        self.speed = np.zeros(3)
        self.loads: dict[str, np.ndarray] = {}

    def warnings_with(self, found: Any) -> tuple[str, ...]:
        return self.warnings

    @property
    def time(self) -> float:
        return self.steps * self.step

    @property
    def control_points(self) -> Array:
        start = self.motions["start"].position_at(self.time)
        fraction = self.greville[:, None] / self.greville[-1]
        points = np.zeros((len(self.greville), 4))
        points[:, :3] = start + fraction * (self.tip - start)
        return points

    def centerline(self, u: ArrayLike) -> Array:
        points = self.control_points[:, :3]
        at = np.asarray(u)
        return np.stack([np.interp(at, self.greville, points[:, k]) for k in range(3)], axis=1)

    def tension(self, u: ArrayLike) -> Array:
        return 2.0 * np.asarray(u)

    def curvature(self, u: ArrayLike) -> Array:
        return 3.0 * np.asarray(u)

    def strand(self, name: str) -> FakeSimulator:
        return self.curves[name]

    def control_poses(self, out: Array, strand: str = "cable") -> None:
        out[:, :3] = self.control_points[:, :3]
        out[:, 3:] = 0.0, 0.0, 0.0, 1.0

    def reaction_wrench(self, end: str) -> tuple[float, ...]:
        return (*self.motions[end].velocity_at(self.time).tolist(), 0.0, 0.0, 0.0)

    def end_pose(self, end: str) -> tuple[Array, Array]:
        motion = self.motions[end]
        return motion.position_at(self.time), motion.orientation_at(self.time)

    def energy(self) -> Any:
        return SimpleNamespace(kinetic=0.5 * float(self.speed @ self.speed), total=1.0)

    def set_load(self, name: str, force: Any = None, torque: Any = None) -> None:
        self.calls.append(("load", self.steps, name, force, torque))
        if force is not None:
            self.loads[name] = np.array(force, dtype=float)

    def set_motion(self, end: str, motion: EndMotion) -> None:
        position, orientation = self.end_pose(end)
        assert motion.start == pytest.approx(self.time, abs=1e-9), "a simulator refuses the past"
        assert motion.position == pytest.approx(position, abs=1e-6), "and jumps"
        assert abs(motion.orientation @ orientation) == pytest.approx(1.0, abs=1e-12)
        self.calls.append(("motion", self.steps, end, motion))
        self.motions[end] = motion

    def advance_steps(self, steps: int, recorder: Any = None) -> Report:
        done = 0
        for _ in range(steps):
            if self.fail_at is not None and self.steps >= self.fail_at:
                return Report(Status.DIVERGED, "diverged: fake", done, done * self.step, 0)
            force = sum(self.loads.values(), np.zeros(3)) + np.array(self.scene.gravity)
            self.speed = self.speed + self.step * force
            self.tip = self.tip + self.step * self.speed
            self.steps += 1
            done += 1
        folded = self.folds_at is not None and self.steps - done < self.folds_at <= self.steps
        status, message = (Status.UNRESOLVED, "folded: fake") if folded else (Status.OK, "")
        return Report(status, message, done, done * self.step, 0, self.note)

    def reset(self) -> None:
        self.calls.append(("reset", self.steps))
        self._place()

    def reconfigured(self, scene: Scene) -> FakeSimulator:
        if scene.cable.diameter > 0.5:
            raise ValueError("fake: too thick")
        other = FakeSimulator(scene, {end: self.end_pose(end) for end in ("start", "end")})
        other.take_over(self)
        return other

    def take_over(self, other: FakeSimulator) -> None:
        self.tip, self.speed = other.tip, other.speed
        for end in self.motions:
            self.motions[end] = EndMotion.resting(*other.end_pose(end))
