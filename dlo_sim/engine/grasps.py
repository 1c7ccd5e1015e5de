"""Kinematics of a grasp: attachment point, direction and twist angle from the gripper's path.

A grasp is MOTION_SIZE numbers of the inputs:
    0      1 once it moves or was moved, else 0 (its rows keep their values)
    1, 2   start time and duration of the motion [s]
    3:12   position p0, p1, p2 [m, m/s, m/s^2]: p(s) = p0 + p1 s + p2 s^2
    12:21  rotation matrix R0 of the gripper at s = 0, row major
    21:27  rotation vector w1, w2 [rad/s, rad/s^2]: R(s) = exp(w1 s + w2 s^2) R0
    27:30  attachment point in the gripper's frame [m]
    30:33  unit direction of the cable, from start to end, in the gripper's frame
    33     twist angle at s = 0 [rad]
with s = clip(t - start, 0, duration). World coordinates unless stated.
"""

from __future__ import annotations

import numpy as np

from dlo_sim.compiling.pieces import part

MOTION_SIZE = 34
ACTIVE, START, DURATION, POSITION, FRAME, TURN, ATTACHMENT, DIRECTION, TWIST = (
    *(0, 1, 2, 3, 12),
    *(21, 27, 30, 33),
)


@part
def rotate(w0, w1, w2, v0, v1, v2):
    """exp([w]) v by Rodrigues' formula, with a series for small angles."""
    angle2 = w0 * w0 + w1 * w1 + w2 * w2
    if angle2 == 0.0:
        return v0, v1, v2
    if angle2 < 1e-6:
        a = 1.0 - angle2 / 6.0 + angle2 * angle2 / 120.0
        b = 0.5 - angle2 / 24.0 + angle2 * angle2 / 720.0
    else:
        angle = np.sqrt(angle2)
        a = np.sin(angle) / angle
        b = (1.0 - np.cos(angle)) / angle2
    x0 = w1 * v2 - w2 * v1
    x1 = w2 * v0 - w0 * v2
    x2 = w0 * v1 - w1 * v0
    return (
        v0 + a * x0 + b * (w1 * x2 - w2 * x1),
        v1 + a * x1 + b * (w2 * x0 - w0 * x2),
        v2 + a * x2 + b * (w0 * x1 - w1 * x0),
    )


@part
def framed(m, at, v0, v1, v2):
    """R0 v."""
    return (
        m[at + 12] * v0 + m[at + 13] * v1 + m[at + 14] * v2,
        m[at + 15] * v0 + m[at + 16] * v1 + m[at + 17] * v2,
        m[at + 18] * v0 + m[at + 19] * v1 + m[at + 20] * v2,
    )


@part
def turn_at(m, at, t):
    """Rotation vector w1 s + w2 s^2 at time t [rad]."""
    s = min(max(t - m[at + 1], 0.0), m[at + 2])
    return (
        s * (m[at + 21] + s * m[at + 24]),
        s * (m[at + 22] + s * m[at + 25]),
        s * (m[at + 23] + s * m[at + 26]),
    )


@part
def turned(m, at, t, v0, v1, v2):
    """World components at time t of a vector in the gripper's frame."""
    w0, w1, w2 = turn_at(m, at, t)
    u0, u1, u2 = framed(m, at, v0, v1, v2)
    return rotate(w0, w1, w2, u0, u1, u2)


@part
def place(m, at, t):
    """Attachment point (3) [m] and twist angle [rad] at time t."""
    s = min(max(t - m[at + 1], 0.0), m[at + 2])
    w0, w1, w2 = turn_at(m, at, t)
    u0, u1, u2 = framed(m, at, m[at + 27], m[at + 28], m[at + 29])
    a0, a1, a2 = rotate(w0, w1, w2, u0, u1, u2)
    # Twist about the tangent: swing-twist split of exp([w]) about the tangent at s = 0.
    u0, u1, u2 = framed(m, at, m[at + 30], m[at + 31], m[at + 32])
    angle = np.sqrt(w0 * w0 + w1 * w1 + w2 * w2)
    twist = m[at + 33]
    if angle > 0.0:
        along = (w0 * u0 + w1 * u1 + w2 * u2) / angle
        # Whole turns are added. The rest of the half angle is at most a quarter turn, far from
        # where the arctangent jumps: at half a turn, round-off would decide its sign.
        turns = np.floor(angle / (2.0 * np.pi) + 0.5)
        half = 0.5 * angle - np.pi * turns
        twist += 2.0 * np.arctan2(np.sin(half) * along, np.cos(half))
        twist += np.copysign(2.0 * np.pi * turns, along)
    return (
        m[at + 3] + s * (m[at + 6] + s * m[at + 9]) + a0,
        m[at + 4] + s * (m[at + 7] + s * m[at + 10]) + a1,
        m[at + 5] + s * (m[at + 8] + s * m[at + 11]) + a2,
        twist,
    )


@part
def rates(m, at, t):
    """Velocity of the attachment point (3), twist rate and angular velocity (3) at time t."""
    s = t - m[at + 1]
    slack = 1e-9 * m[at + 2]  # t is rounded, and a step may end exactly with the motion
    if s < -slack or s > m[at + 2] + slack:
        return 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0
    s = min(max(s, 0.0), m[at + 2])
    w0, w1, w2 = turn_at(m, at, t)
    d0 = m[at + 21] + 2.0 * s * m[at + 24]
    d1 = m[at + 22] + 2.0 * s * m[at + 25]
    d2 = m[at + 23] + 2.0 * s * m[at + 26]
    # Angular velocity of exp([w]): left Jacobian of the rotation vector times its rate.
    angle2 = w0 * w0 + w1 * w1 + w2 * w2
    if angle2 < 1e-6:
        a = 0.5 - angle2 / 24.0
        b = 1.0 / 6.0 - angle2 / 120.0
    else:
        angle = np.sqrt(angle2)
        a = (1.0 - np.cos(angle)) / angle2
        b = (angle - np.sin(angle)) / (angle2 * angle)
    x0 = w1 * d2 - w2 * d1
    x1 = w2 * d0 - w0 * d2
    x2 = w0 * d1 - w1 * d0
    o0 = d0 + a * x0 + b * (w1 * x2 - w2 * x1)
    o1 = d1 + a * x1 + b * (w2 * x0 - w0 * x2)
    o2 = d2 + a * x2 + b * (w0 * x1 - w1 * x0)
    u0, u1, u2 = framed(m, at, m[at + 27], m[at + 28], m[at + 29])
    a0, a1, a2 = rotate(w0, w1, w2, u0, u1, u2)
    # Rate of the swing-twist angle: omega.(t + u) / (1 + t.u), unit tangents now and at s = 0.
    u0, u1, u2 = framed(m, at, m[at + 30], m[at + 31], m[at + 32])
    t0, t1, t2 = rotate(w0, w1, w2, u0, u1, u2)
    both = 1.0 + t0 * u0 + t1 * u1 + t2 * u2
    twist = 0.0
    if both > 0.0:
        twist = (o0 * (t0 + u0) + o1 * (t1 + u1) + o2 * (t2 + u2)) / both
    return (
        m[at + 6] + 2.0 * s * m[at + 9] + o1 * a2 - o2 * a1,
        m[at + 7] + 2.0 * s * m[at + 10] + o2 * a0 - o0 * a2,
        m[at + 8] + 2.0 * s * m[at + 11] + o0 * a1 - o1 * a0,
        twist,
        o0,
        o1,
        o2,
    )
