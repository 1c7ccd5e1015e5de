"""Rigid bodies in natural coordinates: an origin o and three points p_i = o + l_i e_i.

The mass matrix of a body is constant in these four control points, its weight linear, and so is
every place on it, o + a1 e1 + a2 e2 + a3 e3. The directors e_i = (p_i - o) / l_i stay orthonormal
by the six strains E_ij = (e_i.e_j - delta_ij) / 2 with the energy
    U = K/2 sum_ij E_ij^2,
K large. It is quadratic in strains that are quadratic in the points, so that
    force on p_i = - sum_j S_ij m_j / l_i,   S = K mean(E),   m_j = mean(e_j),
of two configurations, and minus the sum of these on the origin, is a discrete gradient: its work is
minus the change of U exactly. Force and torque of a body on itself vanish.

A body that turns by a correction is strained in second order; as for the tension of a cable
(`engine.tension`), the stress in the Jacobian is therefore the one that the last correction
predicted to first order. `state.stress` holds it over K: 11, 22, 33, 12, 13, 23.

The space must have three lines. The twist unknowns of points that are of a body only (`idle`) are
held (`band.hold`).

Sources: natural coordinates, Garcia de Jalon & Bayo 1994, Kinematic and Dynamic Simulation of
Multibody Systems; directors and discrete gradients, Betsch & Steinmann 2001, Int. J. Numer. Meth.
Eng. 50, 1931-1955.
"""

from __future__ import annotations

from numba import boolean, float64, void
from numba.types import UniTuple

from dlo_sim.compiling.kernels import inline, kernel
from dlo_sim.engine.arrays import BETWEEN, CABLE, IMPLICIT, LINES, MARGIN, RIGID, SPRING
from dlo_sim.engine.term import ENERGY, FORCE, TANGENT
from dlo_sim.terms.vectors import combined, dot

TURN = 3.0  # change of a director by a correction, in its largest entry per length: an estimate


@inline
def director(cable, body, i, x):
    """Director i, or its change for a change x of the configuration."""
    bodies = cable.bodies
    o, p = MARGIN + bodies.point[body, 0], MARGIN + bodies.point[body, i + 1]
    share = 1.0 / bodies.length[body, i]
    return share * (x[0, p] - x[0, o]), share * (x[1, p] - x[1, o]), share * (x[2, p] - x[2, o])


@inline
def directors(cable, body, x):
    """The three directors of a body."""
    return director(cable, body, 0, x), director(cable, body, 1, x), director(cable, body, 2, x)


@inline
def strains(e):
    """E_ij of the directors: 11, 22, 33, 12, 13, 23."""
    return (
        0.5 * (dot(e[0], e[0]) - 1.0),
        0.5 * (dot(e[1], e[1]) - 1.0),
        0.5 * (dot(e[2], e[2]) - 1.0),
        0.5 * dot(e[0], e[1]),
        0.5 * dot(e[0], e[2]),
        0.5 * dot(e[1], e[2]),
    )


@inline
def strain_change(e, d):
    """Change of the strains to first order for the change d of the directors."""
    return (
        dot(e[0], d[0]),
        dot(e[1], d[1]),
        dot(e[2], d[2]),
        0.5 * (dot(e[0], d[1]) + dot(e[1], d[0])),
        0.5 * (dot(e[0], d[2]) + dot(e[2], d[0])),
        0.5 * (dot(e[1], d[2]) + dot(e[2], d[1])),
    )


@inline
def full_product(a, b):
    """sum_ij A_ij B_ij of two symmetric matrices."""
    diagonal = a[0] * b[0] + a[1] * b[1] + a[2] * b[2]
    return diagonal + 2.0 * (a[3] * b[3] + a[4] * b[4] + a[5] * b[5])


@inline
def means(e, f):
    """Means of two sets of directors."""
    return (
        combined(0.5, e[0], 0.5, f[0]),
        combined(0.5, e[1], 0.5, f[1]),
        combined(0.5, e[2], 0.5, f[2]),
    )


@inline
def mean_strains(e, f):
    """Means of the strains of two sets of directors."""
    a, b = strains(e), strains(f)
    return (
        0.5 * (a[0] + b[0]),
        0.5 * (a[1] + b[1]),
        0.5 * (a[2] + b[2]),
        0.5 * (a[3] + b[3]),
        0.5 * (a[4] + b[4]),
        0.5 * (a[5] + b[5]),
    )


@inline
def entry(i, j):
    """Place of E_ij among the six."""
    return i if i == j else i + j + 2


@inline
def push(cable, body, i, scale, f, out):
    """out += `scale` f on the point of director i, and minus that on the origin."""
    bodies = cable.bodies
    o, p = MARGIN + bodies.point[body, 0], MARGIN + bodies.point[body, i + 1]
    for d in range(3):
        out[d, p] += scale * f[d]
        out[d, o] -= scale * f[d]


@kernel(*ENERGY, terms=RIGID)
def energy(cable, x, out):
    """Add the energy [J] to that of the springs."""
    for body in range(len(cable.bodies.stiffness)):
        strain = strains(directors(cable, body, x))
        out[SPRING] += 0.5 * cable.bodies.stiffness[body] * full_product(strain, strain)


@kernel(*FORCE, terms=RIGID)
def force(cable, x0, x1, out):
    """out -= discrete gradient of the energy between x0 and x1."""
    for body in range(len(cable.bodies.stiffness)):
        e, f = directors(cable, body, x0), directors(cable, body, x1)
        m, s = means(e, f), mean_strains(e, f)
        rows = (s[0], s[3], s[4]), (s[3], s[1], s[5]), (s[4], s[5], s[2])
        for i in range(3):
            row = rows[i]
            pull = combined(1.0, combined(row[0], m[0], row[1], m[1]), row[2], m[2])
            scale = cable.bodies.stiffness[body] / cable.bodies.length[body, i]
            push(cable, body, i, -scale, pull, out)


@kernel(*TANGENT, terms=RIGID)
def tangent(cable, x0, x1, scale, band):
    """band += scale times the Jacobian of the discrete gradient with respect to x1: between the
    directors i and j, with the predicted stress S,
        S_ij / 2 + K/4 (delta_ij sum_k m_k e_k^T + m_j e_i^T),   e at x1.
    """
    bodies, lines = cable.bodies, cable.lines
    for body in range(len(bodies.stiffness)):
        e = directors(cable, body, x1)
        m, stiffness = means(directors(cable, body, x0), e), bodies.stiffness[body]
        for i in range(3):
            for j in range(3):
                share = scale * stiffness / (bodies.length[body, i] * bodies.length[body, j])
                stress = 0.5 * share * cable.state.stress[body, entry(i, j)]
                for r in range(3):
                    for c in range(3):
                        value = m[j][r] * e[i][c]
                        if i == j:
                            value += m[0][r] * e[0][c]
                            value += m[1][r] * e[1][c]
                            value += m[2][r] * e[2][c]
                        value = 0.25 * share * value + (stress if r == c else 0.0)
                        add_between(bodies.point[body], i + 1, j + 1, r, c, lines, value, band)


@inline
def add_between(points, i, j, r, c, lines, value, band):
    """Add the derivative of a force on director i, line r, by director j, line c, to the matrix
    entries of their points and of the origin.
    """
    for a in range(2):
        row = points[i if a == 0 else 0]
        for b in range(2):
            column = points[j if b == 0 else 0]
            sign = 1.0 if a == b else -1.0
            band[row * lines + r, (column - row) * lines + c - r + 4 * lines - 1] += sign * value


# -- the predicted stress ------------------------------------------------------------------------


@kernel(void, CABLE, LINES, LINES, LINES, terms=RIGID, family=IMPLICIT | BETWEEN)
def predict(cable, x0, x1, moved):
    """Predict the stress for a correction `moved` of x1, as `tension.predict_tension`."""
    stress, before = cable.state.stress, cable.work.stress_before
    for body in range(len(cable.bodies.stiffness)):
        e, f = directors(cable, body, x0), directors(cable, body, x1)
        now, more = mean_strains(e, f), strain_change(f, directors(cable, body, moved))
        for k in range(6):
            before[body, k] = stress[body, k]
            stress[body, k] = now[k] + 0.5 * more[k]


@kernel(void, CABLE, LINES, LINES, terms=RIGID)
def take(cable, x0, x1):
    """Set the stress to that of the mean strains at x0 and x1."""
    for body in range(len(cable.bodies.stiffness)):
        now = mean_strains(directors(cable, body, x0), directors(cable, body, x1))
        for k in range(6):
            cable.state.stress[body, k] = now[k]


@kernel(void, CABLE, float64, terms=RIGID, family=IMPLICIT)
def shorten(cable, share):
    """Leave this share of the last prediction."""
    stress, before = cable.state.stress, cable.work.stress_before
    for body in range(len(cable.bodies.stiffness)):
        for k in range(6):
            stress[body, k] = before[body, k] + share * (stress[body, k] - before[body, k])


@kernel(boolean, CABLE, float64, float64, terms=RIGID, family=IMPLICIT)
def may_strain(cable, moved, allowed):
    """Whether a correction whose largest entry is `moved` [m] may strain a body beyond the
    predicted strain by more than the energy `allowed` [J].
    """
    for body in range(len(cable.bodies.stiffness)):
        shortest = min(abs(cable.bodies.length[body, 0]), abs(cable.bodies.length[body, 1]))
        turned = TURN * moved / min(shortest, abs(cable.bodies.length[body, 2]))
        strain = turned * turned
        if cable.bodies.stiffness[body] * strain * strain > allowed:
            return True
    return False


@kernel(UniTuple(float64, 2), CABLE, LINES, LINES, LINES, terms=RIGID, family=IMPLICIT)
def unpredicted(cable, x0, x1, moved):
    """What the strains e of a step from x0 to x1 have beyond the predicted ones, as
    K sum e_ij^2 and K sum e_ij d E_ij along `moved` [J] (`tension.unpredicted`).
    """
    energy, work, stress = 0.0, 0.0, cable.state.stress
    for body in range(len(cable.bodies.stiffness)):
        e, f = directors(cable, body, x0), directors(cable, body, x1)
        now, stiffness = mean_strains(e, f), cable.bodies.stiffness[body]
        beyond = (
            now[0] - stress[body, 0],
            now[1] - stress[body, 1],
            now[2] - stress[body, 2],
            now[3] - stress[body, 3],
            now[4] - stress[body, 4],
            now[5] - stress[body, 5],
        )
        change = strain_change(means(e, f), directors(cable, body, moved))
        energy += stiffness * full_product(beyond, beyond)
        work += stiffness * full_product(beyond, change)
    return energy, work
