"""The predicted bag read back as arrays."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from dlo_sim.core import bspline
from dlo_sim.replay.bags import Bag
from dlo_sim.session import cdr
from dlo_sim.session.topics import CONTROL_POINTS, REACTION, resolved

Array = NDArray[np.float64]

_POINTS = 60  # of the centerline


@dataclass(frozen=True)
class Prediction:
    """What a replay predicted, at the times of its outputs.

    Attributes:
        time: [s] since the origin asked for, shape (T,).
        centerline: points of the cable from start to end [m], shape (T, n, 3).
        reaction: force [N] on the cable by the gripper, world frame, shape (T, 3).
    """

    time: Array
    centerline: Array
    reaction: Array


def read_prediction(bag: Path, length: float, origin_ns: int) -> Prediction:
    """Read the control points and the reaction of a predicted bag.

    Args:
        bag: written by a replay whose start is held.
        length: rest length of the cable [m].
        origin_ns: stamp that counts as time zero [ns].
    """
    stamps: list[int] = []
    points: list[Array] = []
    forces: list[tuple[float, ...]] = []
    poses, reaction = resolved(CONTROL_POINTS), resolved(REACTION.format("start"))
    for message in Bag(bag).messages({poses: cdr.POSE_ARRAY, reaction: cdr.WRENCH_STAMPED}):
        if message.topic == poses:
            decoded = cdr.decode_pose_array(message.data)
            stamps.append(decoded.stamp_ns)
            points.append(decoded.poses[:, :3])
        else:
            forces.append(cdr.decode(cdr.WRENCH_STAMPED, message.data).values[:3])
    # While a tick waits for a pose the same state is published again.
    _, new = np.unique(stamps, return_index=True)
    control_points = np.array(points)[new]
    n = control_points.shape[1]
    knots = bspline.clamped_knots(n, length)
    basis = bspline.evaluate(np.eye(n), knots, np.linspace(0.0, length, _POINTS))
    time = (np.array(stamps)[new] - origin_ns) * 1e-9
    return Prediction(time, basis @ control_points, np.array(forces)[new])
