"""A simulator with the simulator's interface and next to no physics, for testing what surrounds it.

Control point 0 follows the start end-effector exactly; the last one is a free 1 kg point mass that
the loads accelerate. Every call that changes something is recorded with the step at which it came.
"""

from __future__ import annotations

from types import SimpleNamespace

import numpy as np
import pytest

from dlo_sim.core.end_motion import EndMotion
from dlo_sim.scene.description import Scene


class FakeSimulator:
    """See the module."""

    built: list[FakeSimulator] = []

    def __init__(self, scene: Scene, end_poses=None, step: float = 1e-3) -> None:
        self.scene = scene
        self.step = scene.integrator.step or step
        self.method = "fake"
        self.resolution = "5 control points as the scene asks"
        self.active_terms = ("stretch",)
        self.left_out = {"twist": "fake"}
        self.warnings = ()
        self.fail_at: int | None = None
        self.folds_at: int | None = None  # step after which the shape is reported as a fold
        self.note = ""
        self.calls: list[tuple] = []
        self.end_poses = dict(end_poses or {})
        n = scene.discretization.control_points or 5
        self.greville = np.linspace(0.0, scene.cable.length, n)
        self._place()
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

    @property
    def time(self) -> float:
        return self.steps * self.step

    @property
    def control_points(self):
        start = self.motions["start"].position_at(self.time)
        fraction = self.greville[:, None] / self.greville[-1]
        points = np.zeros((len(self.greville), 4))
        points[:, :3] = start + fraction * (self.tip - start)
        return points

    def centerline(self, u):
        points = self.control_points[:, :3]
        return np.stack([np.interp(u, self.greville, points[:, k]) for k in range(3)], axis=1)

    def tension(self, u):
        return 2.0 * np.asarray(u)

    def curvature(self, u):
        return 3.0 * np.asarray(u)

    def control_poses(self, out):
        out[:, :3] = self.control_points[:, :3]
        out[:, 3:] = 0.0, 0.0, 0.0, 1.0

    def reaction_wrench(self, end):
        return (*self.motions[end].velocity_at(self.time).tolist(), 0.0, 0.0, 0.0)

    def end_pose(self, end):
        motion = self.motions[end]
        return motion.position_at(self.time), motion.orientation_at(self.time)

    def energy(self):
        return SimpleNamespace(kinetic=0.5 * float(self.speed @ self.speed), total=1.0)

    def set_load(self, name, force=None, torque=None):
        self.calls.append(("load", self.steps, name, force, torque))
        if force is not None:
            self.loads[name] = np.array(force, dtype=float)

    def set_motion(self, end, motion):
        position, orientation = self.end_pose(end)
        assert motion.start == pytest.approx(self.time, abs=1e-9), "a simulator refuses the past"
        assert motion.position == pytest.approx(position, abs=1e-6), "and jumps"
        assert abs(motion.orientation @ orientation) == pytest.approx(1.0, abs=1e-12)
        self.calls.append(("motion", self.steps, end, motion))
        self.motions[end] = motion

    def advance_steps(self, n):
        done = 0
        for _ in range(n):
            if self.fail_at is not None and self.steps >= self.fail_at:
                status = SimpleNamespace(ok=False, advanced=False)
                return SimpleNamespace(status=status, message="diverged: fake", steps=done, note="")
            force = sum(self.loads.values(), np.zeros(3)) + np.array(self.scene.gravity)
            self.speed = self.speed + self.step * force
            self.tip = self.tip + self.step * self.speed
            self.steps += 1
            done += 1
        folded = self.folds_at is not None and self.steps - done < self.folds_at <= self.steps
        return SimpleNamespace(
            status=SimpleNamespace(ok=not folded, advanced=True),
            message="folded: fake" if folded else "",
            steps=done,
            note=self.note,
        )

    def reset(self):
        self.calls.append(("reset", self.steps))
        self._place()

    def reconfigured(self, scene):
        if scene.cable.diameter > 0.5:
            raise ValueError("fake: too thick")
        other = FakeSimulator(scene, {end: self.end_pose(end) for end in ("start", "end")})
        other.take_over(self)
        return other

    def take_over(self, other):
        self.tip, self.speed = other.tip, other.speed
        for end in self.motions:
            self.motions[end] = EndMotion.resting(*other.end_pose(end))
