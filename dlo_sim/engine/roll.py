"""Roll between a strand and a rigid body: theta(u) - Theta(body) = 0.

A strand leaves a body along the tangent T = unit(sum along_i e_i), and the material frame of the
strand turns about it with the director N of the body, the unit part of sum side_i e_i normal to T.
theta is an angle in a frame that follows the tangent in time by the smallest rotations
(`engine.bishop`), and so is
    Theta = angle + angle from N0, carried from T0 to T by the smallest rotation, to N about T
with tangent, director and angle T0, N0, `angle` at the end of the last step (`state.roll`), less
than half a turn ago. The row is open by gap = theta(u) - Theta.

C is the derivative at the end of a step; where the body turns by d omega it is
    d Theta = g . d omega,   g = (T0 + T) / (1 + T0 . T).

F is the discrete gradient. From the start of a step to its end the body turns by the Cayley vector
w, de_i = w x m_i, m_i = mean(e_i), and w.T0 = w.T = 2 tan(dTheta / 2). So the torque
    q = dTheta / (2 tan(dTheta / 2)) (T0 + T) / 2
does the work q.w = dTheta. The forces on the directors are the gradient h_i of Theta at m_i, and
    x x m_i,   (tr J - J) x = q - sum m_i x h_i,   J = sum m_i m_i^T,
which give this torque. What is still missing is of third order in de_i, and added along them.
(Without h it was of first order in what strains the body, and its derivative like 1 / de_i: with a
moment of 5e-3 N m Newton's method did not converge.) Rigid rows do no work, up to the gap that the
iteration leaves. A roll that gives has the moment k times the mean gap. Quasistatic twist, of which
bodies have none, is refused (`scene.needs`).

The moment is a couple on the body about the mean tangent, but acts on the strand through theta; the
angular momentum is that of the twist against the Bishop frame, exact only to second order in the
step. Rows P of the projected velocity (`engine.rows`) do not contain rolls.

Needs the bits BORDERED, RIGID and BISHOP. Twist angles turn with the frame at the end of a step;
`follow` lets Theta turn with them.
"""

from __future__ import annotations

import numpy as np
from numba import boolean, float64, void

from dlo_sim.compiling.kernels import YES, inline, kernel
from dlo_sim.engine.arrays import (
    BETWEEN,
    CABLE,
    IMPLICIT,
    LINES,
    MARGIN,
    ROLLED,
    SPRING,
)
from dlo_sim.engine.border import first_of
from dlo_sim.engine.grasps import angle_about, carried
from dlo_sim.engine.rigid_body import directors, means
from dlo_sim.engine.spans import store_three, three
from dlo_sim.engine.term import ENERGY, FORCE
from dlo_sim.terms.vectors import combined, cross, dot

TANGENT, NORMAL, ANGLE = 0, 3, 6  # of a row of `state.roll`
STILL = 1e-16  # square of a change of directors within round-off


@inline
def normalized(v):
    """v / |v|."""
    return combined(1.0 / np.sqrt(dot(v, v)), v, 0.0, v)


@inline
def in_body(e, share, roll):
    """sum_i share_i e_i."""
    first = combined(share[roll, 0], e[0], share[roll, 1], e[1])
    return combined(1.0, first, share[roll, 2], e[2])


@inline
def frame_of(cable, roll, e):
    """Tangent T and director N for the directors e of the body."""
    t = normalized(in_body(e, cable.rolls.along, roll))
    side = in_body(e, cable.rolls.side, roll)
    return t, normalized(combined(1.0, side, -dot(side, t), t))


@inline
def turned_since(cable, roll, t, n):
    """Theta, with the tangent t and the director n, less that at the end of the last step."""
    frame = cable.state.roll[roll]
    return angle_about(t, carried(three(frame, TANGENT), t, three(frame, NORMAL)), n)


@inline
def twist_at(cable, roll, theta):
    """Value of theta (or a change of it) at the place of a roll."""
    rolls, value = cable.rolls, 0.0
    for k in range(4):
        value += rolls.weights[roll, k] * theta[MARGIN + rolls.first[roll] + k]
    return value


@inline
def roll_at(cable, roll, x):
    """Theta [rad] of the configuration x."""
    t, n = frame_of(cable, roll, directors(cable, cable.rolls.body[roll], x))
    return cable.state.roll[roll, ANGLE] + turned_since(cable, roll, t, n)


@inline
def gap_at(cable, roll, x):
    """theta(u) - Theta [rad] of the configuration x."""
    return twist_at(cable, roll, x[cable.dim]) - roll_at(cable, roll, x)


@inline
def spread_torque(m, q):
    """x of (tr J - J) x = q, J = sum m_i m_i^T, by Cramer's rule."""
    a = m[1][0] * m[1][0] + m[2][0] * m[2][0] + m[0][0] * m[0][0]
    b = m[1][1] * m[1][1] + m[2][1] * m[2][1] + m[0][1] * m[0][1]
    c = m[1][2] * m[1][2] + m[2][2] * m[2][2] + m[0][2] * m[0][2]
    d = -(m[0][0] * m[0][1] + m[1][0] * m[1][1] + m[2][0] * m[2][1])
    e = -(m[0][0] * m[0][2] + m[1][0] * m[1][2] + m[2][0] * m[2][2])
    f = -(m[0][1] * m[0][2] + m[1][1] * m[1][2] + m[2][1] * m[2][2])
    r0, r1, r2 = (b + c, d, e), (d, a + c, f), (e, f, a + b)
    s0, s1, s2 = cross(r1, r2), cross(r2, r0), cross(r0, r1)
    inverse = 1.0 / dot(r0, s0)
    return combined(inverse, combined(q[0], s0, q[1], s1), inverse * q[2], s2)


@inline
def gradient(cable, roll, e):
    """Derivatives of Theta by the directors e: dTheta = B . dN + (g x T) . dT, B = T x N."""
    along, side = cable.rolls.along, cable.rolls.side
    t, n = frame_of(cable, roll, e)
    before, b = three(cable.state.roll[roll], TANGENT), cross(t, n)
    a, s = in_body(e, along, roll), in_body(e, side, roll)
    across, size = 1.0 / dot(s, n), 1.0 / np.sqrt(dot(a, a))
    by_tangent = combined(
        size / (1.0 + dot(before, t)), cross(before, t), -size * across * dot(s, t), b
    )
    return (
        combined(side[roll, 0] * across, b, along[roll, 0], by_tangent),
        combined(side[roll, 1] * across, b, along[roll, 1], by_tangent),
        combined(side[roll, 2] * across, b, along[roll, 2], by_tangent),
    )


@inline
def write(cable, roll, push, twists, out):
    """Write a row of F or C: minus these forces on the directors, and, if it `twists`, theta(u)."""
    bodies, body, lines = cable.bodies, cable.rolls.body[roll], cable.lines
    for w in range(2):
        for r in range(out.shape[2]):
            out[roll, w, r] = 0.0
    for k in range(4 if twists else 0):
        out[roll, 0, k * lines + cable.dim] = cable.rolls.weights[roll, k]
    first = first_of(cable, body)
    origin = (bodies.point[body, 0] - first) * lines
    for i in range(3):
        at = (bodies.point[body, i + 1] - first) * lines
        for line in range(3):
            out[roll, 1, at + line] -= push[i][line] / bodies.length[body, i]
            out[roll, 1, origin + line] += push[i][line] / bodies.length[body, i]


@kernel(void, CABLE, LINES, LINES, boolean, terms=ROLLED)
def set_rolls(cable, x0, x1, twists):
    """Set `work.roll_force` and `work.roll_condition` for a step from x0, where Theta counts from,
    to x1, and the gaps of the rigid rows at its end. Without `twists` the twist angles stay as they
    are.
    """
    work, dim = cable.work, cable.dim
    for roll in range(len(cable.rolls.stiffness)):
        body, before = cable.rolls.body[roll], three(cable.state.roll[roll], TANGENT)
        e0, e1 = directors(cable, body, x0), directors(cable, body, x1)
        t, n = frame_of(cable, roll, e1)
        write(cable, roll, gradient(cable, roll, e1), twists, work.roll_condition)
        t0, n0 = frame_of(cable, roll, e0)
        turn = turned_since(cable, roll, t, n) - turned_since(cable, roll, t0, n0)
        half = 0.5 * turn
        scale = 1.0 - half * half / 3.0 if abs(half) < 1e-4 else half / np.tan(half)
        m = means(e0, e1)
        h = gradient(cable, roll, m)
        there = combined(1.0, cross(m[0], h[0]), 1.0, cross(m[1], h[1]))
        there = combined(1.0, there, 1.0, cross(m[2], h[2]))
        q = combined(0.5 * scale, before, 0.5 * scale, t)
        x = spread_torque(m, combined(1.0, q, -1.0, there))
        d = (
            combined(1.0, e1[0], -1.0, e0[0]),
            combined(1.0, e1[1], -1.0, e0[1]),
            combined(1.0, e1[2], -1.0, e0[2]),
        )
        f = (
            combined(1.0, h[0], 1.0, cross(x, m[0])),
            combined(1.0, h[1], 1.0, cross(x, m[1])),
            combined(1.0, h[2], 1.0, cross(x, m[2])),
        )
        square = dot(d[0], d[0]) + dot(d[1], d[1]) + dot(d[2], d[2])
        work_done = dot(f[0], d[0]) + dot(f[1], d[1]) + dot(f[2], d[2])
        more = (turn - work_done) / square if square > STILL else 0.0
        f = (
            combined(1.0, f[0], more, d[0]),
            combined(1.0, f[1], more, d[1]),
            combined(1.0, f[2], more, d[2]),
        )
        write(cable, roll, f, twists, work.roll_force)
        if roll < cable.rolls.rigid_rolls:
            theta = cable.state.roll[roll, ANGLE] + turned_since(cable, roll, t, n)
            work.border_gap[cable.rows.border + roll] = twist_at(cable, roll, x1[dim]) - theta


# -- rolls that give -----------------------------------------------------------------------------


@kernel(*FORCE, terms=ROLLED)
def force(cable, x0, x1, out):
    """Set the rows for a step from x0 to x1; out += forces of the rolls that give."""
    set_rolls(cable, x0, x1, YES)
    rolls, lines, rows = cable.rolls, cable.lines, cable.work.roll_force
    for roll in range(rolls.rigid_rolls, len(rolls.stiffness)):
        before, now = gap_at(cable, roll, x0), gap_at(cable, roll, x1)
        moment = -0.5 * rolls.stiffness[roll] * (before + now)
        cable.work.roll_moment[roll] = moment
        strand, body = MARGIN + rolls.first[roll], MARGIN + first_of(cable, rolls.body[roll])
        for k in range(4):
            for line in range(lines):
                out[line, strand + k] += moment * rows[roll, 0, k * lines + line]
                out[line, body + k] += moment * rows[roll, 1, k * lines + line]


@kernel(*ENERGY, terms=ROLLED)
def energy(cable, x, out):
    """Add the energy [J] of rolls that give to that of the springs."""
    for roll in range(cable.rolls.rigid_rolls, len(cable.rolls.stiffness)):
        gap = gap_at(cable, roll, x)
        out[SPRING] += 0.5 * cable.rolls.stiffness[roll] * gap * gap


# -- rigid rolls ---------------------------------------------------------------------------------


@kernel(float64, CABLE, terms=ROLLED, family=IMPLICIT)
def defect(cable):
    """Sum of |moment gap| [J]: the work that open rows do."""
    sum_, begin = 0.0, cable.rows.border
    for roll in range(cable.rolls.rigid_rolls):
        sum_ += abs(cable.work.roll_moment[roll] * cable.work.border_gap[begin + roll])
    return sum_


# -- counting ------------------------------------------------------------------------------------


@inline
def count_from(cable, roll, x, angle):
    """Theta is this angle in the configuration x, from which it counts on."""
    frame = cable.state.roll[roll]
    t, n = frame_of(cable, roll, directors(cable, cable.rolls.body[roll], x))
    store_three(frame, TANGENT, t)
    store_three(frame, NORMAL, n)
    frame[ANGLE] = angle


@kernel(void, CABLE, boolean, terms=ROLLED, family=IMPLICIT | BETWEEN)
def follow(cable, turns):
    """Count from the present configuration on; if the frame of theta `turns`, with the angle by
    which it does (`work.psi`).
    """
    x = cable.state.x
    for roll in range(len(cable.rolls.stiffness)):
        angle = roll_at(cable, roll, x)
        if turns:
            angle += twist_at(cable, roll, cable.work.psi)
        count_from(cable, roll, x, angle)
