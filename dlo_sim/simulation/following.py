"""Whole trajectories of the end effectors, followed in one compiled call."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np
from numpy.typing import ArrayLike, NDArray

from dlo_sim.compiling.pieces import code_of
from dlo_sim.core import arguments, rotations
from dlo_sim.core.methods import IMPLICIT
from dlo_sim.engine import grasps, layout
from dlo_sim.methods import implicit
from dlo_sim.methods.implicit_along import advance_along
from dlo_sim.simulation.geometry import ENDS, known_end
from dlo_sim.simulation.model import local_axis, natural_vectors
from dlo_sim.simulation.recorder import Recorder
from dlo_sim.simulation.report import Report, Status
from dlo_sim.simulation.simulator import Simulator

Array = NDArray[np.float64]
_ROUNDING = 1e-9  # of a step


def follow(
    simulator: Simulator, times: ArrayLike, poses: Mapping[str, ArrayLike], samples: ArrayLike
) -> tuple[Report, Array]:
    """Advance while the end effectors move through poses.

    Between two poses the position is a cubic with the velocities of central differences; within a
    step both position and orientation change evenly. Ends without poses stay where they are.

    Args:
        times: of the poses, rising [s], shape (T,), from the simulator's time or earlier; the last
            is where the advance ends.
        poses: end -> position [m] and quaternion x, y, z, w, shape (T, 7).
        samples: times of the samples [s], rising, after the simulator's time.

    Returns:
        What `Simulator.advance_steps` returns, and control points x, y, z, theta of the samples up
        to the last good state, shape (S, n_u, 4).

    Raises:
        ValueError: a method that is not implicit, or times and poses that do not fit.
    """
    if simulator.choice.method.family != IMPLICIT:
        raise ValueError(
            f"integrator.method: {simulator.method} follows no poses; take energy_momentum"
        )
    stamps: Array = arguments.numbers("times", times, (None,), "s")
    if len(stamps) < 2 or not np.all(np.diff(stamps) > 0.0):
        raise ValueError("times: need two or more, each later than the one before")
    first, tau = simulator.steps, simulator.step
    count = int(np.floor(stamps[-1] / tau + _ROUNDING)) - first
    grid: Array = np.arange(first, first + count + 1, dtype=float) * tau
    paths = {}
    for end, given in poses.items():
        rows: Array = arguments.numbers(f"poses of {known_end(end)}", given, (len(stamps), 7))
        paths[end] = _on_grid(grid, stamps, rows)
        simulator.set_end(end, paths[end][0, :3], paths[end][0, 3:])
    cable = simulator.cable  # moved ends may have brought in more terms
    motions = np.repeat(cable.motion[None], max(count, 0), axis=0)
    for end, path in paths.items():
        row = ENDS.index(end)
        motions[:, row] = _motions(cable.motion[row], grid, path)
    moments, axes = _natural(simulator, motions)
    recorder = Recorder(simulator.model, arguments.numbers("samples", samples, (None,), "s"))
    status, made, iterations = advance_along.code(
        implicit.advance_implicit.code,
        *cable.arrays,
        code_of(implicit.ENGINE),
        *simulator._stepper._loop._own,  # type: ignore[attr-defined]
        *(first, tau, *recorder.arrays, count, motions[0].size, motions.ravel(), moments, axes),
    )
    simulator._steps = first + made
    simulator._ends.restored()
    outcome = (Status.OK, Status.DIVERGED, Status.NOT_CONVERGED)[status]
    message = "" if outcome.ok else f"{outcome.value} (at {simulator.time:.6g} s)"
    report = Report(outcome, message, made, made * tau, iterations)
    return report, recorder.control_points


def _on_grid(grid: Array, times: Array, poses: Array) -> Array:
    """Poses (T, 7) at the times of a grid: cubic Hermite, quaternions made unit again."""
    signs = np.sign(np.sum(poses[1:, 3:] * poses[:-1, 3:], axis=1))
    poses = poses.copy()
    poses[1:, 3:] *= np.cumprod(np.where(signs < 0.0, -1.0, 1.0))[:, None]
    slopes = np.gradient(poses, times, axis=0)
    k = np.clip(np.searchsorted(times, grid, side="right") - 1, 0, len(times) - 2)
    h = (times[k + 1] - times[k])[:, None]
    s = np.clip((grid - times[k])[:, None] / h, 0.0, 1.0)
    a, b = (1.0 + 2.0 * s) * (1.0 - s) ** 2, s**2 * (3.0 - 2.0 * s)
    path = a * poses[k] + b * poses[k + 1]
    path += h * (s * (1.0 - s) ** 2 * slopes[k] - s**2 * (1.0 - s) * slopes[k + 1])
    path[:, 3:] = rotations.normalized(path[:, 3:])
    return np.asarray(path)


def _motions(present: Array, grid: Array, path: Array) -> Array:
    """Rows of `engine.grasps` of the steps of a path (K + 1, 7), shape (K, MOTION_SIZE)."""
    rows = np.repeat(present[None], len(grid) - 1, axis=0)
    tau = np.diff(grid)
    turn = rotations.to_rotation_vector(
        rotations.multiply(path[1:, 3:], rotations.conjugate(path[:-1, 3:]))
    )
    rows[:, grasps.START], rows[:, grasps.DURATION] = grid[:-1], tau
    rows[:, grasps.POSITION : grasps.FRAME] = 0.0
    rows[:, grasps.POSITION : grasps.POSITION + 3] = path[:-1, :3]
    rows[:, grasps.POSITION + 3 : grasps.POSITION + 6] = np.diff(path[:, :3], axis=0) / tau[:, None]
    frames = rotations.to_matrix(path[:-1, 3:]).reshape(-1, 9)
    rows[:, grasps.FRAME : grasps.TURN] = frames
    rows[:, grasps.TURN : grasps.TURN + 3] = turn / tau[:, None]
    rows[:, grasps.TURN + 3 : grasps.ATTACHMENT] = 0.0
    # The twist goes on from step to step: the part of each turn about the tangent.
    direction = present[grasps.DIRECTION : grasps.DIRECTION + 3]
    half = 0.5 * np.linalg.norm(turn, axis=1)
    along = np.sum(turn * rotations.rotate(path[:-1, 3:], direction), axis=1)
    angle = 2.0 * np.arctan2(0.5 * np.sinc(half / np.pi) * along, np.cos(half))
    rows[1:, grasps.TWIST] += np.cumsum(angle)[:-1]
    return rows


def _natural(simulator: Simulator, motions: Array) -> tuple[Array, Array]:
    """Natural moments per unit of the axis, empty if there are none, and the axis of every step:
    it turns with the start's end effector.
    """
    scene, model = simulator.scene, simulator.model
    if not (model.has(layout.CURVED) and any(scene.cable.rest_curvature)):
        return np.zeros(0), np.zeros(0)
    axis = np.array(scene.cable.rest_curvature_axis) / np.linalg.norm(
        scene.cable.rest_curvature_axis
    )
    frames = motions[:, 0, grasps.FRAME : grasps.TURN].reshape(-1, 3, 3)
    axes = np.array([local_axis(one, model.axes) for one in frames @ axis])
    ones = np.ones(3)
    moments = natural_vectors(scene, model, ones) * local_axis(ones, model.axes)[2]
    return moments.ravel(), axes.ravel()
