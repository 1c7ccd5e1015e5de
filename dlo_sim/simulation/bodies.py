"""Motions of rigid bodies as rows of numbers for compiled code (`engine.grasps`): of end effectors
and of obstacles alike.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from dlo_sim.core import rotations
from dlo_sim.core.end_motion import EndMotion
from dlo_sim.engine.grasps import DURATION, FRAME, POSITION, START, TURN

Array = NDArray[np.float64]


def write(row: Array, motion: EndMotion) -> None:
    """Make a row of motions that of a motion."""
    row[START], row[DURATION] = motion.start, motion.duration
    row[POSITION : POSITION + 9] = motion.position_coefficients.ravel()
    row[FRAME : FRAME + 9] = rotations.to_matrix(motion.orientation).ravel()
    row[TURN : TURN + 6] = motion.rotation_coefficients.ravel()


def write_steps(rows: Array, grid: Array, path: Array) -> None:
    """Make rows (K, MOTION_SIZE) the motions from each of the poses (K + 1, 7) of a path, at the
    times of a grid, to the next.
    """
    tau, before = np.diff(grid), path[:-1]
    turn = rotations.multiply(path[1:, 3:], rotations.conjugate(before[:, 3:]))
    rows[:, START], rows[:, DURATION] = grid[:-1], tau
    rows[:, POSITION : TURN + 6] = 0.0
    rows[:, POSITION : POSITION + 3] = before[:, :3]
    rows[:, POSITION + 3 : POSITION + 6] = np.diff(path[:, :3], axis=0) / tau[:, None]
    rows[:, FRAME : FRAME + 9] = rotations.to_matrix(before[:, 3:]).reshape(-1, 9)
    rows[:, TURN : TURN + 3] = rotations.to_rotation_vector(turn) / tau[:, None]


def motion_of(row: Array) -> EndMotion:
    """The motion of a row."""
    return EndMotion.from_coefficients(
        float(row[START]),
        float(row[DURATION]),
        row[POSITION : POSITION + 9].reshape(3, 3).copy(),
        rotations.from_matrix(row[FRAME : FRAME + 9].reshape(3, 3)),
        row[TURN : TURN + 6].reshape(2, 3).copy(),
    )


def pose_at(row: Array, t: float) -> tuple[Array, Array]:
    """Position [m] and quaternion x, y, z, w of a row at time t [s]."""
    motion = motion_of(row)
    return motion.position_at(t), motion.orientation_at(t)


def poses_of(motion: EndMotion) -> Array:
    """Poses at the start, in the middle and at the end of a motion, shape (3, 7)."""
    t = motion.start + motion.duration * np.array([0.0, 0.5, 1.0])
    return np.hstack([motion.position_at(t), motion.orientation_at(t)])
