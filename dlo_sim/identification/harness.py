"""Branches of a recorded cable: where they begin, and their shape while nothing bends them.

Branches of harnesses are stiff: on four recorded ones each moves as a rigid body to within 0.1 to
4 mm, while the main cable bends by 20 to 60 degrees from one marker to the next. So the mean shape
in the recording, seen from the main cable, is close to the natural shape.
"""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from dlo_sim.core.bent_line import bent_line
from dlo_sim.identification.measurement import TANGENT, MeasurementError, shares_along

Array = NDArray[np.float64]
# Frame of the main cable in that of the start's end effector, as rows: its tangent, the side on
# which the branches are, and the axis about which they bend within that plane.
DRAWN = np.array([TANGENT, (0.0, 0.0, 1.0), (0.0, 1.0, 0.0)])
CONTROL_POINTS = 5
POINTS = 3  # of the natural curvature of a branch
ITERATIONS = 15
EVEN = 0.005  # weight of a radian of bend, and of its changes, against an error of the length


def branch_values(name: str, at: float, points: Array, around: Array) -> dict[str, object]:
    """Scene values of a branch.

    Args:
        at: where on the main cable it begins, 0 to 1.
        points: its markers [m], first that where it begins, shape (pieces, F, M, 3).
        around: the markers before and behind that on the main cable, shape (pieces, F, 2, 3).
    """
    length, shares = shares_along(points)
    arms = points[:, :, 1:] - points[:, :, :1]
    tangent = _unit(around[:, :, 1] - around[:, :, 0])
    middle = arms.mean(axis=2)
    side = _unit(middle - np.sum(middle * tangent, axis=-1, keepdims=True) * tangent)
    frames = np.stack([tangent, side, np.cross(tangent, side)], axis=-2)
    seen = np.einsum("pfcd,pfmd->pfmc", frames, arms)
    seen = seen[np.isfinite(seen).all(axis=(2, 3))]
    if not len(seen):
        raise MeasurementError(
            f"branch {name} and the markers beside its start are in no frame all known and apart; "
            "leave it out"
        )
    direction, axis, bend = _bent_through(np.median(seen, axis=0) / length, shares[1:])
    return {
        f"branches.{name}.at": at,
        f"branches.{name}.direction": (direction @ DRAWN).tolist(),
        f"branches.{name}.discretization.control_points": CONTROL_POINTS,
        f"branches.{name}.cable.length": length,
        f"branches.{name}.cable.rest_curvature": (bend[0] / length).tolist(),
        f"branches.{name}.cable.rest_curvature_2": (bend[1] / length).tolist(),
        f"branches.{name}.cable.rest_curvature_axis": (axis @ DRAWN).tolist(),
    }


def _bent_through(points: Array, shares: Array) -> tuple[Array, Array, Array]:
    """Direction at the start, axis of the first curvature, and both curvatures, shape (2, POINTS),
    of a curve of unit length from the origin through points (M, 3) at shares of its length.
    """

    def errors(x: Array) -> Array:
        bend = x[2:].reshape(2, POINTS)
        uneven = EVEN * np.concatenate([bend, np.diff(bend)], axis=1)
        return np.concatenate([(_curve(x, shares) - points).ravel(), uneven.ravel()])

    azimuth = math.atan2(points[0, 1], points[0, 0])
    x = np.array([azimuth, *np.zeros(1 + 2 * POINTS)])
    for _ in range(ITERATIONS):
        here, step = errors(x), 1e-6
        columns = [(errors(x + row) - here) / step for row in step * np.eye(len(x))]
        x = x - np.linalg.lstsq(np.stack(columns, axis=1), here, rcond=None)[0]
    direction, axis, _ = _frame(x).T
    return direction, axis, x[2:].reshape(2, POINTS)


def _frame(x: Array) -> Array:
    """Direction, axis of the first and axis of the second curvature at the start, as columns."""
    c, s, up, out = math.cos(x[0]), math.sin(x[0]), math.cos(x[1]), math.sin(x[1])
    direction, axis = np.array([up * c, up * s, out]), np.array([-out * c, -out * s, up])
    return np.stack([direction, axis, np.cross(direction, axis)], axis=-1)


def _curve(x: Array, shares: Array) -> Array:
    """Points of the curve at shares of its length, shape (M, 3)."""
    return bent_line(_frame(x), (*x[2:].reshape(2, -1), np.zeros(1)), 1.0, shares)


def _unit(vectors: Array) -> Array:
    size = np.linalg.norm(vectors, axis=-1, keepdims=True)
    return np.asarray(np.divide(vectors, size, out=np.full_like(vectors, np.nan), where=size > 0.0))
