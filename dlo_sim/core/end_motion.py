"""The motion of one end effector over a short time, with constant acceleration.

Position p(t) = p0 + v s + a s^2 / 2 and orientation q(t) = exp(w s + c s^2 / 2) q0, where s is t -
start, limited to 0 and the duration: the end effector rests before and after. exp is the rotation
vector's rotation in the world frame, applied on the left; w and c are the angular velocity and
acceleration at s = 0. The frame is that of the END EFFECTOR, not of the cable's attachment.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, field
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from dlo_sim.core import arguments, one_rotation, rotations

Array = NDArray[np.float64]

FARTHEST = 1e8  # [m], position along an axis
# A quaternion further from unit length than this is a mistake of the caller, not rounding.
_NORM_TOLERANCE = 1e-6
_ZERO = (0.0, 0.0, 0.0)


@dataclass(frozen=True, eq=False, init=False)
class EndMotion:
    """Motion of an end effector from `start` for `duration`, at rest before and after.

    All vectors are in the world frame; velocities and accelerations are zero by default. The
    angular acceleration is constant if it is parallel to the angular velocity; otherwise it is that
    at the start, and the rotation vector of the turn since then is quadratic in time.

    Attributes:
        start, duration: simulator time [s] at which the motion begins, and its length [s], >= 0.
        position, velocity: at the start [m], [m/s], shape (3,).
        orientation: at the start, unit quaternion x, y, z, w, end-effector frame to world, shape
            (4,).
        acceleration: throughout [m/s^2], shape (3,).
        angular_velocity, angular_acceleration: at the start [rad/s], [rad/s^2], shape (3,).
        position_coefficients: rows p0, v, a / 2 of the formula of this module, shape (3, 3).
        rotation_coefficients: rows w, c / 2, shape (2, 3).

    Raises:
        TypeError: a value that is not made of numbers. ValueError: wrong shape, a value that is not
            finite, a negative duration, or a quaternion that is not unit.
    """

    start: float
    duration: float
    position: Array
    orientation: Array
    velocity: Array
    acceleration: Array
    angular_velocity: Array
    angular_acceleration: Array
    position_coefficients: Array = field(init=False, repr=False)
    rotation_coefficients: Array = field(init=False, repr=False)

    def __init__(
        self,
        *,
        start: float,
        duration: float,
        position: ArrayLike,
        orientation: ArrayLike,
        velocity: ArrayLike = _ZERO,
        acceleration: ArrayLike = _ZERO,
        angular_velocity: ArrayLike = _ZERO,
        angular_acceleration: ArrayLike = _ZERO,
    ) -> None:
        start = arguments.number("end motion: start", start, "s")
        duration = arguments.number("end motion: duration", duration, "s")
        if duration < 0.0:
            raise ValueError(f"end motion: duration {duration:g} s is negative; give 0 or more")
        path = np.stack(
            (
                _three("position", position, "m"),
                _three("velocity", velocity, "m/s"),
                0.5 * _three("acceleration", acceleration, "m/s^2"),
            )
        )
        if np.abs(path[0]).max() > FARTHEST:
            raise ValueError(
                f"end motion: position {path[0].tolist()} m is beyond {FARTHEST:g} m; give it in m"
            )
        turn = np.stack(
            (
                _three("angular_velocity", angular_velocity, "rad/s"),
                0.5 * _three("angular_acceleration", angular_acceleration, "rad/s^2"),
            )
        )
        turned = arguments.numbers("end motion: orientation", orientation, (4,), "x, y, z, w")
        norm = math.hypot(*turned.tolist())
        if abs(norm - 1.0) > _NORM_TOLERANCE:
            raise ValueError(f"end motion: orientation has norm {norm:g}; normalise it")
        self._put(start, duration, path, turned, turn)

    def _put(self, start: float, duration: float, path: Array, turned: Array, turn: Array) -> None:
        for array in (path, turned, turn):
            array.setflags(write=False)
        acceleration, angular_acceleration = 2.0 * path[2], 2.0 * turn[1]
        acceleration.setflags(write=False)
        angular_acceleration.setflags(write=False)
        self.__dict__.update(  # the class is frozen
            start=start,
            duration=duration,
            position=path[0],
            orientation=turned,
            velocity=path[1],
            acceleration=acceleration,
            angular_velocity=turn[0],
            angular_acceleration=angular_acceleration,
            position_coefficients=path,
            rotation_coefficients=turn,
        )

    @classmethod
    def from_coefficients(
        cls, start: float, duration: float, path: Array, orientation: Array, turn: Array
    ) -> EndMotion:
        """The motion with these position and rotation coefficients, shapes (3, 3) and (2, 3).

        Nothing is checked, and the arrays belong to the motion from now on.
        """
        motion = object.__new__(cls)
        motion._put(start, duration, path, orientation, turn)
        return motion

    @classmethod
    def resting(
        cls, position: ArrayLike, orientation: ArrayLike = rotations.IDENTITY, start: float = 0.0
    ) -> EndMotion:
        """An end effector that stays where it is; position (3,) [m], orientation (4,)."""
        return cls(start=start, duration=0.0, position=position, orientation=orientation)

    def then(
        self,
        duration: float,
        *,
        velocity: ArrayLike | None = None,
        acceleration: ArrayLike = _ZERO,
        angular_velocity: ArrayLike | None = None,
        angular_acceleration: ArrayLike = _ZERO,
    ) -> EndMotion:
        """The motion that begins where and when this one ends, with this duration [s].

        Velocities are by default those at the end of this one. Raises as the class.
        """
        end = self.end
        if velocity is None:
            velocity = self.velocity_at(end)
        if angular_velocity is None:
            angular_velocity = self.angular_velocity_at(end)
        return EndMotion(
            start=end,
            duration=duration,
            position=self.position_at(end),
            orientation=self.orientation_at(end),
            velocity=velocity,
            acceleration=acceleration,
            angular_velocity=angular_velocity,
            angular_acceleration=angular_acceleration,
        )

    def moved(self, way: Array) -> EndMotion:
        """The same motion, moved by a vector (3,) [m]."""
        path = self.position_coefficients.copy()
        path[0] += way
        given = path, self.orientation, self.rotation_coefficients
        return EndMotion.from_coefficients(self.start, self.duration, *given)

    def later(self, time: float) -> EndMotion:
        """The same motion, a time [s] later."""
        given = self.position_coefficients, self.orientation, self.rotation_coefficients
        return EndMotion.from_coefficients(self.start + time, self.duration, *given)

    def __deepcopy__(self, memo: dict[int, Any]) -> EndMotion:
        """The motion itself, as nothing of it can change: a copy would take 0.1 ms."""
        return self

    @property
    def end(self) -> float:
        """Simulator time [s] from which the end effector rests again."""
        return self.start + self.duration

    def position_at(self, t: ArrayLike) -> Array:
        """Position [m] at simulator time t [s], shape t.shape + (3,)."""
        s = self._elapsed(t)
        p0, p1, p2 = self.position_coefficients
        return np.asarray(p0 + s * (p1 + s * p2))

    def velocity_at(self, t: ArrayLike) -> Array:
        """Velocity [m/s] at t [s], shape t.shape + (3,); zero outside the motion, its limit from
        inside at both ends.
        """
        s, moving = self._elapsed(t), self._moving(t)
        return np.asarray(moving * (self.velocity + s * self.acceleration))

    def orientation_at(self, t: ArrayLike) -> Array:
        """Orientation, unit quaternion x, y, z, w, at t [s], shape t.shape + (4,)."""
        turn = self._rotation_vector(t)
        if turn.ndim == 1:
            return np.array(one_rotation.turned(self.orientation.tolist(), turn.tolist()))
        return rotations.multiply(rotations.from_rotation_vector(turn), self.orientation)

    def angular_velocity_at(self, t: ArrayLike) -> Array:
        """Angular velocity [rad/s] in the world frame at t [s], shape t.shape + (3,)."""
        turn = self._rotation_vector(t)
        rate = self.angular_velocity + self._elapsed(t) * self.angular_acceleration
        pairs = zip(turn.reshape(-1, 3).tolist(), rate.reshape(-1, 3).tolist(), strict=True)
        spin = np.array([one_rotation.angular_velocity(*pair) for pair in pairs])
        return self._moving(t) * spin.reshape(turn.shape)

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
        w1, w2 = self.rotation_coefficients
        return np.asarray(s * (w1 + s * w2))


def _three(name: str, value: ArrayLike, unit: str) -> Array:
    return arguments.numbers(f"end motion: {name}", value, (3,), unit)
