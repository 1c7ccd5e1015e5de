"""Twist relative to the Frenet torsion gamma.

With t = r', k = r'', c = r''' and C = t x k the torsion of the centreline is gamma = C.c / |C|^2,
which is 0/0 on a straight cable and at an inflection. It is regularised as
    gamma = C.c / (|C|^2 + delta^2)
with the curvature floor delta [1/m]: the true torsion times |C|^2 / (|C|^2 + delta^2). This is
smooth, zero on a straight cable, and bounded by |c| / (2 delta). The limits: where |C| is below
delta, torsion is reduced by more than half; those samples are counted. The jump of the Frenet frame
by half a turn at an inflection does not appear at all.

The energy GJ/2 (theta' - gamma)^2 counts as that of the twist, GJ/2 theta'^2, and of the torsion,
GJ (gamma^2 / 2 - theta' gamma). Three dimensions only.
"""

from __future__ import annotations

from dlo_sim.compiling.kernels import inline, kernel
from dlo_sim.compiling.lanes import LANES, lane, lane_sum, zero
from dlo_sim.engine.arrays import TORSION, TORSIONAL, TWISTING
from dlo_sim.engine.spans import (
    add_sample,
    bending_at,
    curve,
    scatter,
    scatter_lines,
    tangent_at,
    twist_rate,
)
from dlo_sim.engine.term import ENERGY, FORCE
from dlo_sim.terms.vectors import cross, dot


@inline
def torsion_of(floor, t, k, third):
    """gamma, C, 1 / (|C|^2 + delta^2); `floor` is delta^2."""
    b = cross(t, k)
    inverse = 1.0 / (dot(b, b) + floor)
    return dot(b, third) * inverse, b, inverse


@inline
def density_gradient(stiffness, floor, t, k, third, rate):
    """Gradients with respect to r', r'', r''' and theta'."""
    gamma, b, inverse = torsion_of(floor, t, k, third)
    f = stiffness * (gamma - rate) * inverse  # dU = f (C.dc + e.dC), e = c - 2 gamma C
    e = (
        f * (third[0] - 2.0 * gamma * b[0]),
        f * (third[1] - 2.0 * gamma * b[1]),
        f * (third[2] - 2.0 * gamma * b[2]),
    )
    return cross(k, e), cross(e, t), (f * b[0], f * b[1], f * b[2]), stiffness * (rate - gamma)


@inline
def third_derivative(p, slope):
    """r''', constant on each span."""
    f = 2.0 * slope * slope
    return f * p[0][2], f * p[1][2], f * p[2][2]


@kernel(*FORCE, terms=TORSION)
def force(cable, _, x, out):
    """out -= gradient of the energy."""
    mesh, floor = cable.mesh, cable.physics.torsion_floor
    for b in range(cable.blocks):
        s = mesh.slope[b]
        p, angle = curve(cable, x, b, 1.0), twist_rate(cable, x, b)
        third, f = third_derivative(p, s), 2.0 * s * s
        g0 = g1 = g2 = turn = (zero(), zero(), zero())
        for j in range(cable.samples):
            xi, w = mesh.xi[b, j], mesh.torsional[b] * mesh.weight[b, j]
            rate = angle[0] + xi * (angle[1] + xi * angle[2])
            on_t, on_k, on_third, on_rate = density_gradient(
                w, floor, tangent_at(p, xi), bending_at(p, xi, s), third, rate
            )
            g0 = add_sample(g0, on_t[0], s * on_k[0], xi)
            g1 = add_sample(g1, on_t[1], s * on_k[1], xi)
            g2 = add_sample(g2, on_t[2], s * on_k[2], xi)
            g0 = g0[0], g0[1], g0[2] + f * on_third[0]
            g1 = g1[0], g1[1], g1[2] + f * on_third[1]
            g2 = g2[0], g2[1], g2[2] + f * on_third[2]
            turn = turn[0] + on_rate, turn[1] + xi * on_rate, turn[2] + xi * xi * on_rate
        scatter_lines(cable, b, g0, g1, g2, -1.0, out)
        scatter(mesh, b, turn, -1.0, out[cable.dim])


@kernel(*ENERGY, terms=TORSION)
def energy(cable, x, out):
    """Add the energies [J]."""
    mesh, floor, twisting, sum_ = cable.mesh, cable.physics.torsion_floor, zero(), zero()
    for b in range(cable.blocks):
        s = mesh.slope[b]
        p, angle = curve(cable, x, b, 1.0), twist_rate(cable, x, b)
        third = third_derivative(p, s)
        for j in range(cable.samples):
            xi, w = mesh.xi[b, j], mesh.torsional[b] * mesh.weight[b, j]
            rate = angle[0] + xi * (angle[1] + xi * angle[2])
            gamma = torsion_of(floor, tangent_at(p, xi), bending_at(p, xi, s), third)[0]
            twisting += 0.5 * w * rate * rate
            sum_ += w * gamma * (0.5 * gamma - rate)
    out[TWISTING] += lane_sum(twisting)
    out[TORSIONAL] += lane_sum(sum_)


@inline
def undefined_torsion(cable, x):
    """Number of quadrature points with |C| below the curvature floor."""
    mesh, floor, count = cable.mesh, cable.physics.torsion_floor, 0.0
    for b in range(cable.blocks):
        s, p = mesh.slope[b], curve(cable, x, b, 1.0)
        for j in range(cable.samples):
            xi, weight = mesh.xi[b, j], mesh.weight[b, j]
            bend = cross(tangent_at(p, xi), bending_at(p, xi, s))
            found = dot(bend, bend) - floor
            for k in range(LANES):  # the weight is 0 beyond the last span
                if lane(weight, k) != 0.0 and lane(found, k) < 0.0:
                    count += 1.0
    return count
