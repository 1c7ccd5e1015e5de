"""The forces on the paper's wire in interpreted numpy, as a substitute for MATLAB.

Only the scene and the spline are shared with the compiled step; there is one numpy call per
operation for all samples. Supported are ends held per axis or on springs, and constant and sine
forces; not twist, damping or moving ends.
"""

from __future__ import annotations

import numpy as np

from dlo_sim.core import bspline, mass, quadrature
from dlo_sim.scene.description import Scene
from dlo_sim.studies.report import Array


class Wire:
    """A scene as dense numpy arrays."""

    def __init__(self, scene: Scene) -> None:
        self.scene = scene
        n = scene.discretization.control_points
        self.knots = bspline.clamped_knots(n, scene.cable.length)
        choice = scene.discretization
        rule = quadrature.uniform if choice.quadrature == "uniform" else quadrature.gauss
        breaks = bspline.breaks(self.knots)
        samples = rule(breaks, choice.samples)
        used = samples.weights != 0.0  # the rest is padding
        u, self._weights = samples.places(breaks)[used], samples.weights[used]
        self._slopes = bspline.evaluate(np.eye(n), self.knots, u, 1)
        self._curls = bspline.evaluate(np.eye(n), self.knots, u, 2)
        self._mass = scene.cable.mu * mass.dense(mass.gram(self.knots))
        free = np.ones((n, 3), dtype=bool)
        free[0], free[-1] = ~np.array(scene.start.fixed), ~np.array(scene.end.fixed)
        # Held coordinates are decoupled, with unit mass and no force.
        self._inverses = [
            np.linalg.inv(np.where(np.outer(f, f), self._mass, np.eye(n))) for f in free.T
        ]
        self.free = free
        where = np.array([load.position for load in scene.loads]) * scene.cable.length
        self._load_basis = bspline.evaluate(np.eye(n), self.knots, where)

    def start(self) -> Array:
        """Control points [m] of the straight wire, (n, 3)."""
        share = (bspline.greville(self.knots) / self.scene.cable.length)[:, None]
        ends = [np.array(end.position) for end in (self.scene.start, self.scene.end)]
        return np.asarray((1.0 - share) * ends[0] + share * ends[1])

    def gradient(self, x: Array) -> Array:
        """dU/dq of stretching and bending [N], shape (n, 3)."""
        cable = self.scene.cable
        t, k = self._slopes @ x, self._curls @ x
        c = (t * t).sum(1)
        d = (t * k).sum(1)
        bend = cable.EI * self._weights / (c * c)
        stretch = cable.EA * self._weights * (1.0 - 1.0 / np.sqrt(c))
        along = stretch + bend * (3.0 * d * d / c - 2.0 * (k * k).sum(1)) / c
        cross = (-bend * d / c)[:, None]
        on_t = along[:, None] * t + cross * k
        on_k = bend[:, None] * k + cross * t
        return np.asarray(self._slopes.T @ on_t + self._curls.T @ on_k)

    def acceleration(self, x: Array, t: float) -> Array:
        """M^-1 f on the free coordinates [m/s^2], zero on the others, shape (n, 3)."""
        force = -self.gradient(x)
        force += np.outer(self._mass.sum(axis=1), self.scene.gravity)
        for row, end in ((0, self.scene.start), (-1, self.scene.end)):
            force[row] -= np.array(end.spring) * (x[row] - np.array(end.position))
        for basis, load in zip(self._load_basis, self.scene.loads, strict=True):
            sine = np.sin(2.0 * np.pi * load.frequency * t) if load.signal == "sine" else 1.0
            force += np.outer(basis, sine * np.array(load.force))
        return np.stack(list(map(np.matmul, self._inverses, (force * self.free).T)), axis=1)
