"""One rotation in plain numbers: like `rotations` for arrays, in a tenth of the time.

Quaternions are tuples x, y, z, w of unit length; rotation vectors are axis times angle [rad] in the
world frame.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import Any

Vector = tuple[float, float, float]
Quaternion = tuple[float, float, float, float]

# Below this angle [rad] the series of sin(a)/a and its kin are exact to rounding in double
# precision.
SMALL = 1e-4


def product(a: Any, b: Any) -> tuple[Any, Any, Any, Any]:
    """Components of the Hamilton product: b first, then a. Plain numbers or arrays of them."""
    ax, ay, az, aw = a
    bx, by, bz, bw = b
    return (
        aw * bx + ax * bw + ay * bz - az * by,
        aw * by - ax * bz + ay * bw + az * bx,
        aw * bz + ax * by - ay * bx + az * bw,
        aw * bw - ax * bx - ay * by - az * bz,
    )


def cross(a: Any, b: Any) -> tuple[Any, Any, Any]:
    """Components of a x b. Plain numbers or arrays of them."""
    a0, a1, a2 = a
    b0, b1, b2 = b
    return a1 * b2 - a2 * b1, a2 * b0 - a0 * b2, a0 * b1 - a1 * b0


def rotated(q: Any, v: Any) -> tuple[Any, Any, Any]:
    """Components of R(q) v. Plain numbers or arrays of them."""
    x, y, z, w = q
    a, b, c = v
    t0, t1, t2 = 2.0 * (y * c - z * b), 2.0 * (z * a - x * c), 2.0 * (x * b - y * a)
    return (
        a + w * t0 + (y * t2 - z * t1),
        b + w * t1 + (z * t0 - x * t2),
        c + w * t2 + (x * t1 - y * t0),
    )


def exponential(rotation: Vector) -> Quaternion:
    """exp(w), the rotation of a rotation vector."""
    x, y, z = rotation
    size = math.hypot(x, y, z)
    ratio = 0.5 - size * size / 48.0 if size < SMALL else math.sin(0.5 * size) / size
    return ratio * x, ratio * y, ratio * z, math.cos(0.5 * size)


def logarithm(q: Quaternion) -> Vector:
    """log(q), the rotation vector of the shorter way, angle in [0, pi]."""
    x, y, z, w = q
    if w < 0.0:
        x, y, z, w = -x, -y, -z, -w
    size = math.hypot(x, y, z)
    if size < SMALL:
        ratio = 2.0 / w * (1.0 - size * size / (3.0 * w * w))
    else:
        ratio = 2.0 * math.atan2(size, w) / size
    return ratio * x, ratio * y, ratio * z


def turn_between(start: Quaternion, end: Quaternion) -> Vector:
    """Rotation vector of the shorter way from one orientation to another."""
    x, y, z, w = start
    return logarithm(product(end, (-x, -y, -z, w)))


def turned(start: Quaternion, rotation: Vector) -> Quaternion:
    """exp(w) q: an orientation, turned; the inverse of `turn_between`."""
    return product(exponential(rotation), start)


def aligned(q: Quaternion, body: Vector, direction: Vector) -> Quaternion:
    """The orientation nearest to q that turns one unit vector into another, of the world."""
    x, y, z, w = q
    *present, _ = product(product(q, (*body, 0.0)), (-x, -y, -z, w))
    return normalized(product(minimal(present, direction), q))


def minimal(u: Sequence[float], v: Sequence[float]) -> Quaternion:
    """The rotation of smallest angle that turns unit vector u into v. If they are opposite, half a
    turn about the axis across u that is nearest to the coordinate axis least aligned with u.
    """
    # (u x v, 1 + u.v) is good to about 1e-16 / |u x v|, so to 1e-8 at the cut below.
    q = (*cross(u, v), 1.0 + sum(a * b for a, b in zip(u, v, strict=True)))
    if math.hypot(*q) < 1e-8:
        least = min(range(3), key=lambda k: abs(u[k]))
        q = (*cross(u, [float(k == least) for k in range(3)]), 0.0)
    return normalized(q)


def normalized(q: Quaternion) -> Quaternion:
    """q / |q|; ValueError if it is zero or not finite."""
    size = math.hypot(*q)
    if not math.isfinite(size) or size == 0.0:
        raise ValueError("quaternion is zero or not finite: it gives no orientation")
    x, y, z, w = q
    return x / size, y / size, z / size, w / size


def angular_velocity(rotation: Sequence[float], rate: Sequence[float]) -> Vector:
    """World angular velocity [rad/s] of exp(w(t)): J(w) w'.

    With a = |w| and J the left Jacobian of SO(3):
    J(w) w' = w' + (1 - cos a)/a^2 (w x w') + (a - sin a)/a^3 (w x (w x w')).
    """
    x, y, z = rotation
    c1, c2 = _jacobian_factors(x * x + y * y + z * z)
    a0, a1, a2 = once = cross(rotation, rate)
    b0, b1, b2 = cross(rotation, once)
    r0, r1, r2 = rate
    return r0 + c1 * a0 + c2 * b0, r1 + c1 * a1 + c2 * b1, r2 + c1 * a2 + c2 * b2


def _jacobian_factors(angle2: float) -> tuple[float, float]:
    """(1 - cos a)/a^2 and (a - sin a)/a^3; a < 0.01 by series, as the closed form loses digits."""
    if angle2 < 1e-4:
        return (
            0.5 - angle2 / 24.0 + angle2**2 / 720.0,
            1.0 / 6.0 - angle2 / 120.0 + angle2**2 / 5040.0,
        )
    angle = math.sqrt(angle2)
    return (1.0 - math.cos(angle)) / angle2, (angle - math.sin(angle)) / (angle2 * angle)
