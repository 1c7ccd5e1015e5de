"""The motion of one end effector over a short time, as a polynomial.

Position p(t) = p0 + p1 s + p2 s^2 and orientation q(t) = exp(w1 s + w2 s^2) q0 with s = clip(t -
start, 0, duration): before the start and after the end the end effector rests. exp is the rotation
vector's rotation in the world frame, applied on the left. It is the motion of the END EFFECTOR
frame; the cable's attachment offset and tangent in it are not known here.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from dlo_sim.core import arguments, one_rotation, rotations

Array = NDArray[np.float64]

# A quaternion further from unit length than this is a mistake of the caller, not rounding.
_NORM_TOLERANCE = 1e-6


@dataclass(frozen=True, eq=False)
class EndMotion:
    """Quadratic motion of an end effector from `start` for `duration`, at rest outside.

    Attributes:
        start: simulator time [s] at which the motion begins.
        duration: length of the motion [s], >= 0.
        position: rows p0 [m], p1 [m/s], p2 [m/s^2], shape (3, 3), world frame.
        orientation: q0, unit quaternion x, y, z, w, shape (4,), end-effector frame to world.
        rotation: rows w1 [rad/s], w2 [rad/s^2], shape (2, 3), world frame.

    Raises:
        TypeError: a value that is not made of numbers. ValueError: wrong shape, a value that is not
            finite, a negative duration, or a quaternion that is not unit.
    """

    start: float
    duration: float
    position: Array
    orientation: Array
    rotation: Array

    def __post_init__(self) -> None:
        for name, shape in (("position", (3, 3)), ("orientation", (4,)), ("rotation", (2, 3))):
            value = arguments.numbers(f"end motion: {name}", getattr(self, name), shape)
            value.setflags(write=False)
            object.__setattr__(self, name, value)
        for name in ("start", "duration"):
            time = arguments.number(f"end motion: {name}", getattr(self, name), "s")
            object.__setattr__(self, name, time)
        if self.duration < 0.0:
            raise ValueError(
                f"end motion: duration {self.duration:g} s is negative; give 0 or more"
            )
        norm = math.hypot(*self.orientation.tolist())
        if abs(norm - 1.0) > _NORM_TOLERANCE:
            raise ValueError(f"end motion: orientation has norm {norm:g}; normalise it")

    @classmethod
    def resting(
        cls, position: ArrayLike, orientation: ArrayLike = rotations.IDENTITY, start: float = 0.0
    ) -> EndMotion:
        """An end effector that stays where it is; position (3,) [m], orientation (4,)."""
        coefficients = np.zeros((3, 3))
        coefficients[0] = arguments.numbers("end motion: position", position, (3,), "m")
        turned = arguments.numbers("end motion: orientation", orientation, (4,), "x, y, z, w")
        return cls(start, 0.0, coefficients, turned, np.zeros((2, 3)))

    @property
    def end(self) -> float:
        """Simulator time [s] from which the end effector rests again."""
        return self.start + self.duration

    def position_at(self, t: ArrayLike) -> Array:
        """Position [m] at simulator time t [s], shape t.shape + (3,)."""
        s = self._elapsed(t)
        return np.asarray(self.position[0] + s * (self.position[1] + s * self.position[2]))

    def velocity_at(self, t: ArrayLike) -> Array:
        """Velocity [m/s] at t [s], shape t.shape + (3,); zero outside the motion, its limit from
        inside at both ends.
        """
        s, moving = self._elapsed(t), self._moving(t)
        return np.asarray(moving * (self.position[1] + 2.0 * s * self.position[2]))

    def orientation_at(self, t: ArrayLike) -> Array:
        """Orientation, unit quaternion x, y, z, w, at t [s], shape t.shape + (4,)."""
        turn = self._rotation_vector(t)
        if turn.ndim == 1:
            return np.array(one_rotation.turned(self.orientation.tolist(), turn.tolist()))
        return rotations.multiply(rotations.from_rotation_vector(turn), self.orientation)

    def angular_velocity_at(self, t: ArrayLike) -> Array:
        """Angular velocity [rad/s] in the world frame at t [s], shape t.shape + (3,)."""
        turn, rate = self._rotation_vector(t), self.rotation[0]
        rate = rate + 2.0 * self._elapsed(t) * self.rotation[1]
        pairs = zip(turn.reshape(-1, 3).tolist(), rate.reshape(-1, 3).tolist(), strict=True)
        spin = np.array([one_rotation.angular_velocity(*pair) for pair in pairs])
        return self._moving(t) * spin.reshape(turn.shape)

    def rest(self, now: float) -> EndMotion:
        """What is left of it at `now` [s], as a motion from time 0: the same places at any time and
        the same last pose; it turns there at a constant rate.
        """
        s, orientation = float(np.ravel(self._elapsed(now))[0]), self.orientation_at(now)
        left = self.duration - s
        p0, p1, p2 = self.position
        turn = one_rotation.turn_between(
            orientation.tolist(), self.orientation_at(self.end).tolist()
        )
        rate = np.array(turn) / left if left > 0.0 else np.zeros(3)
        position = np.stack((p0 + s * (p1 + s * p2), p1 + 2.0 * s * p2, p2))
        return EndMotion(0.0, left, position, orientation, np.stack((rate, np.zeros(3))))

    def _elapsed(self, t: Any) -> Array | float:
        if isinstance(t, float):  # asked for at every pose: numpy's clip alone takes 3 us
            return min(max(t - self.start, 0.0), self.duration)
        return np.clip(np.asarray(t, dtype=float) - self.start, 0.0, self.duration)[..., None]

    def _moving(self, t: ArrayLike) -> Array:
        s = np.asarray(t, dtype=float) - self.start
        slack = 1e-9 * self.duration  # t - start is rounded, the end must not depend on it
        inside = (s >= -slack) & (s <= self.duration + slack) & (self.duration > 0.0)
        return np.asarray(inside, dtype=float)[..., None]

    def _rotation_vector(self, t: ArrayLike) -> Array:
        s = self._elapsed(t)
        return np.asarray(s * (self.rotation[0] + s * self.rotation[1]))
