"""Kinematics of a grasp: attachment point, direction and twist angle from the gripper's path.

The motion m of a grasp is a row of `inputs.motion`, MOTION_SIZE numbers:
    0      1 once it moves or was moved, else 0 (its rows keep their targets)
    1, 2   start time and duration of the motion [s]
    3:12   position p0, p1, p2 [m, m/s, m/s^2]: p(s) = p0 + p1 s + p2 s^2
    12:21  rotation matrix R0 of the gripper at s = 0, row major
    21:27  rotation vector w1, w2 [rad/s, rad/s^2]: R(s) = exp(w1 s + w2 s^2) R0
    27:30  attachment point in the gripper's frame [m]
    30:33  unit direction of the cable, from start to end, in the gripper's frame
    33:36  unit vector normal to it, the gripper's director, in the gripper's frame
with s = clip(t - start, 0, duration). World coordinates unless stated.

A gripper that holds the roll prescribes the angle theta between a frame that follows the cable's
tangent in time by the smallest rotations and its director. `state.frame` holds for each grasp where
this is known, at the end of the last step:
    0      the time [s]
    1:4    the tangent there; of a clamp, the direction of the gripper
    4:7    the director, turned to this tangent by the smallest rotation
    7      theta [rad]
Up to the end of a step, the frame follows the tangent from there by one smallest rotation. The
angle that the director makes with it is exact then, but for whole turns, which the motion gives.
"""

from __future__ import annotations

import numpy as np
from numba import float64, types

from dlo_sim.compiling.kernels import inline, kernel
from dlo_sim.engine.arrays import VECTOR
from dlo_sim.engine.spans import store_three, three
from dlo_sim.terms.material_frame import transported
from dlo_sim.terms.vectors import combined, cross, dot

ACTIVE, START, DURATION, POSITION, FRAME, TURN, ATTACHMENT, DIRECTION, DIRECTOR = (
    *(0, 1, 2, 3, 12),
    *(21, 27, 30, 33),
)
TIME, TANGENT, NORMAL, ANGLE = 0, 1, 4, 7  # of a row of `state.frame`
SMALLEST = 1e-14  # 1 + cosine of an angle that counts as half a turn


THREE, SEVEN, NINE = (types.UniTuple(float64, count) for count in (3, 7, 9))


@inline
def component(a, axis):
    """Entry `axis` of a tuple, one of its first three."""
    return a[0] if axis == 0 else (a[1] if axis == 1 else a[2])


@inline
def moves(m):
    """Whether the grasp moves or was moved."""
    return m[ACTIVE] != 0.0


@inline
def elapsed(m, t):
    """Time s since the start of the motion, at most its duration [s]."""
    return min(max(t - m[START], 0.0), m[DURATION])


@inline
def turn_at(m, t):
    """Rotation vector w1 s + w2 s^2 at time t [rad]."""
    s = elapsed(m, t)
    return (
        s * (m[TURN] + s * m[TURN + 3]),
        s * (m[TURN + 1] + s * m[TURN + 4]),
        s * (m[TURN + 2] + s * m[TURN + 5]),
    )


@inline
def rotation_terms(w):
    """a and b of exp([w]) = 1 + a [w] + b [w]^2, Rodrigues' formula; a series for small angles."""
    angle2 = dot(w, w)
    if angle2 < 1e-6:
        a = 1.0 - angle2 / 6.0 + angle2 * angle2 / 120.0
        b = 0.5 - angle2 / 24.0 + angle2 * angle2 / 720.0
    else:
        angle = np.sqrt(angle2)
        a = np.sin(angle) / angle
        b = (1.0 - np.cos(angle)) / angle2
    return a, b


@inline
def rotated(w, terms, v):
    """exp([w]) v with `rotation_terms`."""
    x = cross(w, v)
    return combined(1.0, combined(1.0, v, terms[0], x), terms[1], cross(w, x))


@inline
def times(r, k, v0, v1, v2):
    """R v of a matrix by rows, the nine entries of r from k on."""
    return (
        r[k] * v0 + r[k + 1] * v1 + r[k + 2] * v2,
        r[k + 3] * v0 + r[k + 4] * v1 + r[k + 5] * v2,
        r[k + 6] * v0 + r[k + 7] * v1 + r[k + 8] * v2,
    )


@inline
def column(m, k):
    """Column k of R0."""
    return m[FRAME + k], m[FRAME + 3 + k], m[FRAME + 6 + k]


@kernel(NINE, VECTOR, float64)
def rotation_at(m, t):
    """Rotation matrix of the gripper at time t, by rows."""
    w, x, y, z = turn_at(m, t), column(m, 0), column(m, 1), column(m, 2)
    if dot(w, w) > 0.0:
        terms = rotation_terms(w)
        x, y, z = rotated(w, terms, x), rotated(w, terms, y), rotated(w, terms, z)
    return x[0], y[0], z[0], x[1], y[1], z[1], x[2], y[2], z[2]


@kernel(THREE, VECTOR, float64, float64, float64, float64)
def turned(m, t, v0, v1, v2):
    """World components at time t of a vector in the gripper's frame."""
    return times(rotation_at(m, t), 0, v0, v1, v2)


@inline
def direction_by(m, r):
    """Unit direction of the cable for the rotation matrix r."""
    return times(r, 0, m[DIRECTION], m[DIRECTION + 1], m[DIRECTION + 2])


@inline
def direction_at(m, t):
    """Unit direction of the cable at time t."""
    return direction_by(m, rotation_at(m, t))


@inline
def place_by(m, t, r):
    """`place`, with the rotation matrix r of that time."""
    s = elapsed(m, t)
    arm = times(r, 0, m[ATTACHMENT], m[ATTACHMENT + 1], m[ATTACHMENT + 2])
    return (
        m[POSITION] + s * (m[POSITION + 3] + s * m[POSITION + 6]) + arm[0],
        m[POSITION + 1] + s * (m[POSITION + 4] + s * m[POSITION + 7]) + arm[1],
        m[POSITION + 2] + s * (m[POSITION + 5] + s * m[POSITION + 8]) + arm[2],
    )


@kernel(THREE, VECTOR, float64)
def place(m, t):
    """Attachment point [m] at time t."""
    return place_by(m, t, rotation_at(m, t))


# -- the twist angle ----------------------------------------------------------------------------


@inline
def carried(a, b, v):
    """A vector v normal to the unit vector a, turned with it to b by the smallest rotation; as it
    is for half a turn, about v.
    """
    return transported(v, a, b) if 1.0 + dot(a, b) > SMALLEST else v


@inline
def angle_about(axis, a, b):
    """Angle [rad] from a to b, both normal to a unit axis, within half a turn."""
    return np.arctan2(dot(axis, cross(a, b)), dot(a, b))


@inline
def nearest(angle, guess):
    """Of the angles that differ from `angle` by whole turns the one closest to `guess`."""
    return angle + 2.0 * np.pi * np.floor((guess - angle) / (2.0 * np.pi) + 0.5)


@inline
def director_at(m, r, tangent):
    """The director, with the rotation matrix r, turned to this tangent."""
    e = times(r, 0, m[DIRECTOR], m[DIRECTOR + 1], m[DIRECTOR + 2])
    return carried(direction_by(m, r), tangent, e)


@inline
def prescribed_twist(m, frame, t, r):
    """theta [rad] that the gripper prescribes at time t, with the rotation matrix r there."""
    tangent = three(frame, TANGENT)
    angle = angle_about(tangent, three(frame, NORMAL), director_at(m, r, tangent))
    rolled = dot(combined(1.0, turn_at(m, t), -1.0, turn_at(m, frame[TIME])), tangent)
    return frame[ANGLE] + nearest(angle, rolled)


@inline
def count_from(m, frame, t, r, tangent, angle):
    """theta is this angle at time t, where the cable has this tangent."""
    frame[TIME], frame[ANGLE] = t, angle
    store_three(frame, TANGENT, tangent)
    store_three(frame, NORMAL, director_at(m, r, tangent))


@kernel(SEVEN, VECTOR, float64, VECTOR, VECTOR)
def rates(m, t, r, frame):
    """Velocity of the attachment point (3), rate of `prescribed_twist` and angular velocity (3) at
    time t, with the rotation matrix r there.
    """
    s = t - m[START]
    slack = 1e-9 * m[DURATION]  # t is rounded, and a step may end exactly with the motion
    if s < -slack or s > m[DURATION] + slack:
        return 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0
    s = elapsed(m, t)
    w = turn_at(m, t)
    rate = (
        m[TURN] + 2.0 * s * m[TURN + 3],
        m[TURN + 1] + 2.0 * s * m[TURN + 4],
        m[TURN + 2] + 2.0 * s * m[TURN + 5],
    )
    # Angular velocity of exp([w]): left Jacobian of the rotation vector times its rate.
    angle2 = dot(w, w)
    if angle2 < 1e-6:
        a = 0.5 - angle2 / 24.0
        b = 1.0 / 6.0 - angle2 / 120.0
    else:
        angle = np.sqrt(angle2)
        a = (1.0 - np.cos(angle)) / angle2
        b = (angle - np.sin(angle)) / (angle2 * angle)
    x = cross(w, rate)
    y = cross(w, x)
    omega = (
        rate[0] + a * x[0] + b * y[0],
        rate[1] + a * x[1] + b * y[1],
        rate[2] + a * x[2] + b * y[2],
    )
    around = cross(omega, times(r, 0, m[ATTACHMENT], m[ATTACHMENT + 1], m[ATTACHMENT + 2]))
    # Of a frame that turns from the tangent d0 to d by the smallest rotation.
    d, d0 = direction_by(m, r), three(frame, TANGENT)
    both = 1.0 + dot(d, d0)
    twist = 0.0
    if both > 0.0:
        twist = dot(omega, (d[0] + d0[0], d[1] + d0[1], d[2] + d0[2])) / both
    return (
        m[POSITION + 3] + 2.0 * s * m[POSITION + 6] + around[0],
        m[POSITION + 4] + 2.0 * s * m[POSITION + 7] + around[1],
        m[POSITION + 5] + 2.0 * s * m[POSITION + 8] + around[2],
        twist,
        omega[0],
        omega[1],
        omega[2],
    )
