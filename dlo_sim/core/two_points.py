"""Poses of an end effector of which two points on the line of the cable are measured.

Its position is midway between the points. Its roll about that line is not measured: from one pose
to the next the orientation changes by the least rotation.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from dlo_sim.core.one_rotation import Quaternion, Vector, aligned

Array = NDArray[np.float64]
X_AXIS: Vector = (1.0, 0.0, 0.0)
LEAST_APART = 1e-4  # [m]; nearer points give no direction


def poses_of_two_points(points: Array, before: Quaternion, body: Vector = X_AXIS) -> Array:
    """Positions [m] and quaternions x, y, z, w, shape (T, 7).

    Args:
        points: first and second [m], shape (T, 2, 3), apart.
        before: orientation from which the first pose turns.
        body: direction from the first to the second point in the end-effector's frame, unit length.
    """
    apart = points[:, 1] - points[:, 0]
    directions = apart / np.linalg.norm(apart, axis=1, keepdims=True)
    poses = np.empty((len(points), 7))
    poses[:, :3] = points.mean(axis=1)
    for pose, direction in zip(poses, directions.tolist(), strict=True):
        pose[3:] = before = aligned(before, body, direction)
    return poses
