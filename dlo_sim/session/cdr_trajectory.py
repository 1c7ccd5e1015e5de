"""Planned motions from serialised MultiDOFJointTrajectory messages (`cdr`)."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from dlo_sim.session.cdr import Bytes, DecodeError, Reader

Array = NDArray[np.float64]
_TRANSFORM, _TWIST = 7, 6  # numbers


class Trajectory(NamedTuple):
    """A decoded trajectory.

    Attributes:
        joints: their names, J.
        times: of the points, from the stamp on [s], shape (T,).
        poses: position [m] and quaternion x, y, z, w, shape (T, J, 7).
    """

    stamp_ns: int
    frame_id: str
    joints: tuple[str, ...]
    times: Array
    poses: Array


def decode_trajectory(raw: Bytes) -> Trajectory:
    """Names, times and transforms; velocities and accelerations are passed over.

    Raises:
        DecodeError: not such a message, or a point with another number of transforms than joints.
    """
    reader = Reader(raw)
    stamp_ns, frame_id = reader.header()
    joints = tuple(reader.text() for _ in range(reader.whole()))
    times, poses = [], []
    for number in range(reader.whole()):
        transforms = reader.table(_TRANSFORM)
        if len(transforms) != len(joints):
            raise DecodeError(
                f"point {number} has {len(transforms)} transforms for {len(joints)} joints"
            )
        reader.table(_TWIST)  # velocities
        reader.table(_TWIST)  # accelerations
        times.append(reader.whole("i") + 1e-9 * reader.whole())
        poses.append(transforms)
    shape = len(times), len(joints), _TRANSFORM
    return Trajectory(stamp_ns, frame_id, joints, np.array(times), np.reshape(poses, shape))
