"""The paper's wire stepped by plain interpreted numpy: what stands in for MATLAB.

Nothing is shared with the compiled step but the scene, the spline and the methods' tables. Two ways
of writing the elastic force are kept apart, because an interpreter's speed depends on nothing else:
`sample_by_sample` is the oracle of `core.elasticity`, a loop over the quadrature points with a
linear solve per evaluation as the paper describes it; `whole_arrays` does the same with one numpy
call per operation for all samples. Ends may be held per axis or hang on springs; loads are constant
or sine forces; no twist, damping or moved ends.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from dlo_sim.core import bspline, elasticity, mass, quadrature
from dlo_sim.core.methods import METHODS, RUNGE_KUTTA, SPLITTING, ZHAI, Method
from dlo_sim.scene.description import Scene

Array = NDArray[np.float64]
Force = Callable[[Array], Array]


@dataclass
class State:
    """Positions [m] and velocities [m/s] of the control points, (n, 3), and accelerations.

    before: of the step before (Zhai); now: of the present positions, while they are known.
    """

    position: Array
    velocity: Array
    before: Array | None = None
    now: Array | None = None


class Wire:
    """A scene as dense numpy arrays.

    Args:
        sample_by_sample: loop over the quadrature points instead of whole-array operations.

    Raises:
        ValueError: the scene has something that this twin does not know.
    """

    def __init__(self, scene: Scene, sample_by_sample: bool) -> None:
        _check(scene)
        self.scene = scene
        n = scene.discretization.control_points
        self.knots = bspline.clamped_knots(n, scene.cable.length)
        self._rule = _rule(scene, n - bspline.DEGREE)
        self._section = elasticity.Section(scene.cable.EA, scene.cable.EI)
        self._mass = scene.cable.mu * mass.dense(mass.gram(self.knots))
        self.free = np.ones((n, 3), dtype=bool)
        self.free[0], self.free[-1] = ~np.array(scene.start.fixed), ~np.array(scene.end.fixed)
        u, self._weights = elasticity.samples(self._rule, scene.cable.length)
        self._slopes = bspline.evaluate(np.eye(n), self.knots, u, 1)
        self._curls = bspline.evaluate(np.eye(n), self.knots, u, 2)
        self._loop = sample_by_sample
        self._inverse = [
            np.linalg.inv(self._mass[np.ix_(self.free[:, axis], self.free[:, axis])])
            for axis in range(3)
        ]
        where = np.array([load.position for load in scene.loads]) * scene.cable.length
        self._load_basis = bspline.evaluate(np.eye(n), self.knots, where)

    def start(self) -> State:
        """The straight wire at rest."""
        share = (bspline.greville(self.knots) / self.scene.cable.length)[:, None]
        ends = [np.array(end.position) for end in (self.scene.start, self.scene.end)]
        position = (1.0 - share) * ends[0] + share * ends[1]
        return State(position, np.zeros_like(position))

    def gradient(self, x: Array) -> Array:
        """dU/dq of stretching and bending [N], shape (n, 3)."""
        if self._loop:
            points = np.concatenate((x, np.zeros((len(x), 1))), axis=1)
            return elasticity.gradient(points, self.knots, self._rule, self._section)[:, :3]
        t, k = self._slopes @ x, self._curls @ x
        c = (t * t).sum(1)
        d = (t * k).sum(1)
        bend = self._section.EI * self._weights / (c * c)
        stretch = self._section.EA * self._weights * (1.0 - 1.0 / np.sqrt(c))
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
        out = np.zeros_like(force)
        for axis in range(3):
            free = self.free[:, axis]
            if self._loop:
                out[free, axis] = np.linalg.solve(self._mass[np.ix_(free, free)], force[free, axis])
            else:
                out[free, axis] = self._inverse[axis] @ force[free, axis]
        return out

    def step(self, state: State, method: str, t: float, tau: float) -> None:
        """Advance by one step of an explicit method from time t."""
        table = METHODS[method]
        {SPLITTING: _splitting, RUNGE_KUTTA: _runge_kutta, ZHAI: _zhai}[table.family](
            self, state, table, t, tau
        )

    def run(self, method: str, tau: float, steps: int) -> State:
        """The state after a number of steps from the start."""
        state = self.start()
        for step in range(steps):
            self.step(state, method, step * tau, tau)
        return state


def _splitting(wire: Wire, state: State, method: Method, t: float, tau: float) -> None:
    for drift, kick in zip(method.drift_weights, method.kick_weights, strict=True):
        t += drift * tau
        if drift:
            state.position += drift * tau * state.velocity
            state.now = None
        if kick:
            if state.now is None:
                state.now = wire.acceleration(state.position, t)
            state.velocity += kick * tau * state.now


def _runge_kutta(wire: Wire, state: State, method: Method, t: float, tau: float) -> None:
    slopes: list[tuple[Array, Array]] = []
    for row in method.stage_matrix:
        x, v = state.position.copy(), state.velocity.copy()
        for weight, (rate, acceleration) in zip(row, slopes, strict=True):
            x += weight * tau * rate
            v += weight * tau * acceleration
        slopes.append((v, wire.acceleration(x, t + sum(row) * tau)))
    for weight, (rate, acceleration) in zip(method.stage_weights, slopes, strict=True):
        state.position += weight * tau * rate
        state.velocity += weight * tau * acceleration


def _zhai(wire: Wire, state: State, method: Method, t: float, tau: float) -> None:
    psi, phi = wire.scene.integrator.zhai_psi, wire.scene.integrator.zhai_phi
    now = wire.acceleration(state.position, t)
    before = now if state.before is None else state.before
    state.position += tau * state.velocity + tau * tau * ((0.5 + psi) * now - psi * before)
    state.velocity += tau * ((1.0 + phi) * now - phi * before)
    state.before = now


def _rule(scene: Scene, n_spans: int) -> quadrature.Quadrature:
    choice = scene.discretization
    if choice.quadrature == "uniform":
        return quadrature.uniform(n_spans, scene.cable.length, choice.samples)
    return quadrature.gauss(n_spans, scene.cable.length, choice.samples)


def _check(scene: Scene) -> None:
    known = {
        "damping": not any((scene.damping.mass, scene.damping.stiffness, scene.damping.air_drag)),
        "clamped ends": not (scene.start.clamped or scene.end.clamped),
        "end masses": not (scene.start.mass or scene.end.mass),
        "driven ends": not (scene.start.driven or scene.end.driven),
        "natural curvature": not any(scene.cable.rest_curvature),
        "torques": all(load.type == "force" for load in scene.loads),
        "lumped mass": scene.discretization.mass == "consistent",
        "stretching by span": scene.discretization.stretch == "sample",
        "topics": all(load.signal != "none" for load in scene.loads),
    }
    missing = [name for name, fine in known.items() if not fine]
    if missing:
        raise ValueError(f"the interpreted twin does not know: {', '.join(missing)}")
