"""Transforms of other frames to the world frame: an interface to tf2 that does not depend on it."""

from __future__ import annotations

from typing import NamedTuple, Protocol

import numpy as np

from dlo_sim.core.one_rotation import Quaternion, Vector
from dlo_sim.core.rotations import multiply, rotate
from dlo_sim.session.cdr import Stamped


class Transform(NamedTuple):
    """Pose of a frame in the world frame: stamp [ns], 0 = static; position [m], unit quaternion
    x, y, z, w.
    """

    stamp_ns: int
    position: Vector
    orientation: Quaternion


class Transforms(Protocol):
    """Looks up frames."""

    def lookup(self, frame: str, stamp_ns: int | None) -> Transform:
        """Pose of a frame at a stamp [ns], interpolated, never extrapolated; None = the newest.

        Raises:
            Refused: `no_transform`: not available at that stamp, or not yet.
        """

    def clear(self) -> None:
        """Discard the poses of moving frames, because the clock or the stamps have jumped."""


def in_world(message: Stamped, kind: str, transform: Transform) -> Stamped:
    """The message transformed to the world frame.

    Positions become p + R x. Forces and torques become R x: the point they refer to is the same.

    Args:
        message: in the frame of the transform.
        kind: of its topic (`session.topics`).
    """
    _, position, orientation = transform
    values = np.array(message.values)
    if kind == "pose":
        at = rotate(orientation, values[:3]) + position
        values = np.concatenate([at, multiply(orientation, values[3:])])
    else:
        rows = rotate(orientation, values.reshape(-1, 3))
        values = (rows if kind in ("wrench", "force") else rows + position).ravel()
    return Stamped(message.stamp_ns, "", tuple(values.tolist()))
