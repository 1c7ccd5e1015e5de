"""Where other frames are in the world frame: what a session asks of tf2, without knowing it."""

from __future__ import annotations

from typing import NamedTuple, Protocol

import numpy as np

from dlo_sim.core.one_rotation import Quaternion, Vector
from dlo_sim.core.rotations import multiply, rotate
from dlo_sim.session.cdr import Stamped


class Transform(NamedTuple):
    """Where a frame is in the world frame: its stamp [ns], 0 = it stands still; position [m], unit
    quaternion x, y, z, w.
    """

    stamp_ns: int
    position: Vector
    orientation: Quaternion


class Transforms(Protocol):
    """What is known of the frames."""

    def lookup(self, frame: str, stamp_ns: int | None) -> Transform:
        """Where a frame is at a stamp [ns], interpolated, never extrapolated; None = the newest.

        Raises:
            Refused: `no_transform`: it is not known there, or not yet.
        """

    def clear(self) -> None:
        """Forget how frames have moved: clock or stamps have jumped."""


def in_world(message: Stamped, kind: str, transform: Transform) -> Stamped:
    """A message in the world frame.

    Positions become p + R x; forces and torques, whose point the frame does not change, R x.

    Args:
        message: its numbers in the frame of the transform.
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
