"""Prescribed motion of the cable's ends: the end effector's path turned into control points.

Row e of `Drive.motion` describes end e (0 start, 1 end); its columns are
    0      1 if this end moves, else 0 (the control points stay as they are)
    1, 2   start time and duration of the motion [s]
    3:12   position p0, p1, p2 [m, m/s, m/s^2]: p(s) = p0 + p1 s + p2 s^2
    12:21  rotation matrix R0 of the end effector at s = 0, row major
    21:27  rotation vector w1, w2 [rad/s, rad/s^2]: R(s) = exp(w1 s + w2 s^2) R0
    27:30  attachment point in the end effector frame [m]
    30:33  (h / 3) times the unit tangent in the end effector frame, pointing into the cable [m]
    33     twist angle at s = 0 [rad]
    34     1 if the end is clamped (tangent and twist held)
    35:38  1 for each axis that is held
    38     +1 at the start, -1 at the end: the cable's direction along the inward tangent
with s = clip(t - start, 0, duration). All are world coordinates.
"""

from __future__ import annotations

import numpy as np

from dlo_sim.kernels.jit import entry, kernel, shared


@kernel
def rotate(w0, w1, w2, v0, v1, v2):
    """exp([w]) v by Rodrigues' formula, well conditioned for small angles."""
    angle2 = w0 * w0 + w1 * w1 + w2 * w2
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


@entry
def turn(m, t, v0, v1, v2):
    """World direction at time t of a vector in the end effector frame."""
    s = min(max(t - m[1], 0.0), m[2])
    return rotate(
        s * (m[21] + s * m[24]),
        s * (m[22] + s * m[25]),
        s * (m[23] + s * m[26]),
        m[12] * v0 + m[13] * v1 + m[14] * v2,
        m[15] * v0 + m[16] * v1 + m[17] * v2,
        m[18] * v0 + m[19] * v1 + m[20] * v2,
    )


@entry
def end_points(m, t):
    """Control points of one driven end at time t: attachment (3), neighbour (3), twist [rad]."""
    s = min(max(t - m[1], 0.0), m[2])
    w0 = s * (m[21] + s * m[24])
    w1 = s * (m[22] + s * m[25])
    w2 = s * (m[23] + s * m[26])
    a0, a1, a2 = rotate(
        w0,
        w1,
        w2,
        m[12] * m[27] + m[13] * m[28] + m[14] * m[29],
        m[15] * m[27] + m[16] * m[28] + m[17] * m[29],
        m[18] * m[27] + m[19] * m[28] + m[20] * m[29],
    )
    u0 = m[12] * m[30] + m[13] * m[31] + m[14] * m[32]
    u1 = m[15] * m[30] + m[16] * m[31] + m[17] * m[32]
    u2 = m[18] * m[30] + m[19] * m[31] + m[20] * m[32]
    t0, t1, t2 = rotate(w0, w1, w2, u0, u1, u2)
    x0 = m[3] + s * (m[6] + s * m[9]) + a0
    x1 = m[4] + s * (m[7] + s * m[10]) + a1
    x2 = m[5] + s * (m[8] + s * m[11]) + a2
    # Twist about the tangent: swing-twist split of exp([w]) about the tangent at s = 0.
    norm = np.sqrt(u0 * u0 + u1 * u1 + u2 * u2)
    angle = np.sqrt(w0 * w0 + w1 * w1 + w2 * w2)
    twist = m[33]
    if angle > 0.0 and norm > 0.0:
        along = m[38] * (w0 * u0 + w1 * u1 + w2 * u2) / (norm * angle)
        twist += 2.0 * np.arctan2(np.sin(0.5 * angle) * along, np.cos(0.5 * angle))
        # The arctangent covers one turn of the half angle; count the whole ones.
        turns = np.floor(angle / (4.0 * np.pi) + 0.5)
        twist += np.copysign(4.0 * np.pi * turns, along)
    return x0, x1, x2, x0 + t0, x1 + t1, x2 + t2, twist


@kernel
def pick(axis, p0, p1, p2):
    """Component of a world vector."""
    return p0 if axis == 0 else (p1 if axis == 1 else p2)


@kernel
def place_ends(motion, t, n, axes, x):
    """Write the prescribed control points of driven ends at time t."""
    dim = len(axes)
    for e in range(2):
        m = motion[e]
        if m[0] == 0.0:
            continue
        p0, p1, p2, q0, q1, q2, twist = end_points(m, t)
        outer = 0 if e == 0 else n - 1
        inner = 1 if e == 0 else n - 2
        for d in range(dim):
            if m[35 + axes[d]] != 0.0:
                x[d, outer] = pick(axes[d], p0, p1, p2)
            if m[34] != 0.0:
                x[d, inner] = pick(axes[d], q0, q1, q2)
        if x.shape[0] > dim and m[34] != 0.0:
            x[dim, outer] = twist


@kernel
def move_anchors(motion, springs, t, axes):
    """Let the springs of driven ends pull towards the end effector."""
    if springs is not None:
        for e in range(2):
            if motion[e, 0] != 0.0:
                p0, p1, p2, _, _, _, _ = end_points(motion[e], t)
                for d in range(len(axes)):
                    springs.anchor[e, d] = pick(axes[d], p0, p1, p2)


@shared
def end_rates(m, t):
    """Velocities of `end_points`: attachment (3), neighbour (3), twist rate [rad/s]."""
    s = t - m[1]
    slack = 1e-9 * m[2]  # t is rounded: a step that ends with the motion still moves with it
    if s < -slack or s > m[2] + slack:
        return 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0
    s = min(max(s, 0.0), m[2])
    w0 = s * (m[21] + s * m[24])
    w1 = s * (m[22] + s * m[25])
    w2 = s * (m[23] + s * m[26])
    d0 = m[21] + 2.0 * s * m[24]
    d1 = m[22] + 2.0 * s * m[25]
    d2 = m[23] + 2.0 * s * m[26]
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
    p0, p1, p2, q0, q1, q2, _ = end_points(m, t)
    t0 = q0 - p0
    t1 = q1 - p1
    t2 = q2 - p2
    a0 = p0 - (m[3] + s * (m[6] + s * m[9]))
    a1 = p1 - (m[4] + s * (m[7] + s * m[10]))
    a2 = p2 - (m[5] + s * (m[8] + s * m[11]))
    v0 = m[6] + 2.0 * s * m[9] + o1 * a2 - o2 * a1
    v1 = m[7] + 2.0 * s * m[10] + o2 * a0 - o0 * a2
    v2 = m[8] + 2.0 * s * m[11] + o0 * a1 - o1 * a0
    # Rate of the swing-twist angle: omega.(t + u) / (1 + t.u) with the unit tangents now and at s =
    # 0.
    u0 = m[12] * m[30] + m[13] * m[31] + m[14] * m[32]
    u1 = m[15] * m[30] + m[16] * m[31] + m[17] * m[32]
    u2 = m[18] * m[30] + m[19] * m[31] + m[20] * m[32]
    norm = np.sqrt(u0 * u0 + u1 * u1 + u2 * u2)
    twist = 0.0
    both = norm * norm + t0 * u0 + t1 * u1 + t2 * u2
    if both > 0.0:
        along = o0 * (t0 + u0) + o1 * (t1 + u1) + o2 * (t2 + u2)
        twist = m[38] * norm * along / both
    return (
        v0,
        v1,
        v2,
        v0 + o1 * t2 - o2 * t1,
        v1 + o2 * t0 - o0 * t2,
        v2 + o0 * t1 - o1 * t0,
        twist,
    )


@shared
def one_end_velocity(motion, e, t, n, axes, free, out):
    """Write the velocities of the prescribed control points of end e at time t."""
    dim = len(axes)
    v0, v1, v2, u0, u1, u2, twist = end_rates(motion[e], t)
    outer = 0 if e == 0 else n - 1
    inner = 1 if e == 0 else n - 2
    for d in range(dim):
        if free[d, outer] == 0.0:
            out[d, outer] = pick(axes[d], v0, v1, v2)
        if free[d, inner] == 0.0:
            out[d, inner] = pick(axes[d], u0, u1, u2)
    if out.shape[0] > dim and free[dim, outer] == 0.0:
        out[dim, outer] = twist


@kernel
def end_velocities(motion, t, n, axes, free, out):
    """Write the velocities of the prescribed control points of driven ends at time t."""
    for e in range(2):
        if motion[e, 0] != 0.0:
            one_end_velocity(motion, e, t, n, axes, free, out)


@kernel
def keep_anchors(drive, springs, kept):
    """kept = where the springs' anchors are."""
    if drive is not None:
        copy_anchors(springs, kept)


@kernel
def copy_anchors(springs, kept):
    """kept = where the springs' anchors are."""
    if springs is not None:
        for e in range(2):
            for d in range(kept.shape[1]):
                kept[e, d] = springs.anchor[e, d]


@kernel
def restore_anchors(drive, springs, kept):
    """Put the springs' anchors back."""
    if drive is not None:
        put_anchors(springs, kept)


@kernel
def put_anchors(springs, kept):
    """Put the springs' anchors back."""
    if springs is not None:
        for e in range(2):
            for d in range(kept.shape[1]):
                springs.anchor[e, d] = kept[e, d]


@kernel
def anchor_work(springs, kept, x0, x1, n):
    """Work done on the springs by anchors that moved from `kept` while the cable moved from x0 to
    x1: k (mean anchor - mean end) . (change of the anchor), exact for straight and even motion.
    """
    done = 0.0
    if springs is not None:
        for e in range(2):
            i = 0 if e == 0 else n - 1
            for d in range(kept.shape[1]):
                moved = springs.anchor[e, d] - kept[e, d]
                if moved != 0.0:
                    anchor = 0.5 * (springs.anchor[e, d] + kept[e, d])
                    done += springs.stiffness[e, d] * moved * (anchor - 0.5 * (x0[d, i] + x1[d, i]))
    return done


@entry
def end_wrench(missing, x, springs, axes, n, e, twist_row):
    """Force [N] and moment about the attachment [N m] on the cable by end e (0 start, 1 end), world
    frame, six numbers.

    `missing` holds the forces on the prescribed rows; a spring of the end pulls too. The row of the
    twist angle is -1 without twist.
    """
    outer = 0 if e == 0 else n - 1
    inner = 1 if e == 0 else n - 2
    a0 = a1 = a2 = f0 = f1 = f2 = m0 = m1 = m2 = 0.0
    for d in range(len(axes)):
        arm = x[d, inner] - x[d, outer]
        near = missing[d, inner]
        total = missing[d, outer] + near
        if springs is not None:
            total -= springs.stiffness[e, d] * (x[d, outer] - springs.anchor[e, d])
        if axes[d] == 0:
            a0, f0, m0 = arm, total, near
        elif axes[d] == 1:
            a1, f1, m1 = arm, total, near
        else:
            a2, f2, m2 = arm, total, near
    about = 0.0
    if twist_row >= 0:
        about = missing[twist_row, outer] / np.sqrt(a0 * a0 + a1 * a1 + a2 * a2)
        about = about if e == 0 else -about
    return (
        f0,
        f1,
        f2,
        a1 * m2 - a2 * m1 + about * a0,
        a2 * m0 - a0 * m2 + about * a1,
        a0 * m1 - a1 * m0 + about * a2,
    )
