"""Pressure p in the bore of a hose, of area A: the energy - p A (integral |r'| du - L).

It is minus the work of the pressure on the volume inside; the bore does not widen. Its ends are
closed by what holds them, or by caps. A hose that is free to stretch becomes longer until its wall
bears p A; one that is held at both ends pushes them apart with it, and buckles if p A is more than
it bears.
"""

from __future__ import annotations

from dlo_sim.compiling.kernels import inline, kernel
from dlo_sim.compiling.lanes import lane_sum, sqrt, zero
from dlo_sim.engine.arrays import PRESSURE, STRETCHING
from dlo_sim.engine.band import add_to_spans
from dlo_sim.engine.spans import add_sample, curve, scatter_lines, store_three, tangent_at
from dlo_sim.engine.term import ENERGY, FORCE, TANGENT
from dlo_sim.terms.vectors import combined, dot


@inline
def mean_direction(t0, t1):
    """Discrete gradient (t0 + t1) / (|t0| + |t1|) of |t|, and 1 / (|t0| + |t1|)."""
    inverse = 1.0 / (sqrt(dot(t0, t0)) + sqrt(dot(t1, t1)))
    return combined(inverse, t0, inverse, t1), inverse


@kernel(*ENERGY, terms=PRESSURE)
def energy(cable, x, out):
    """Add the energy [J] to that of stretching."""
    mesh, sum_ = cable.mesh, zero()
    for b in range(cable.blocks):
        p = curve(cable, x, b, 1.0)
        for j in range(cable.samples):
            t = tangent_at(p, mesh.xi[b, j])
            sum_ += mesh.weight[b, j] * (sqrt(dot(t, t)) - 1.0)
    out[STRETCHING] -= cable.physics.thrust * lane_sum(sum_)


@kernel(*FORCE, terms=PRESSURE)
def force(cable, x0, x1, out):
    """out -= discrete gradient of the energy between x0 and x1."""
    mesh, thrust = cable.mesh, cable.physics.thrust
    for b in range(cable.blocks):
        p, q = curve(cable, x0, b, 1.0), curve(cable, x1, b, 1.0)
        g0 = g1 = g2 = (zero(), zero(), zero())
        for j in range(cable.samples):
            xi, w = mesh.xi[b, j], mesh.weight[b, j]
            n, _ = mean_direction(tangent_at(p, xi), tangent_at(q, xi))
            g0 = add_sample(g0, w * n[0], zero(), xi)
            g1 = add_sample(g1, w * n[1], zero(), xi)
            g2 = add_sample(g2, w * n[2], zero(), xi)
        scatter_lines(cable, b, g0, g1, g2, thrust, out)


@kernel(*TANGENT, terms=PRESSURE)
def tangent(cable, x0, x1, scale, band):
    """band += scale times the Jacobian of the discrete gradient with respect to x1: per sample
    - p A (1 - n t1^T / |t1|) / (|t0| + |t1|), with the mean direction n.
    """
    mesh, f = cable.mesh, cable.work.factors
    for b in range(cable.blocks):
        p, q = curve(cable, x0, b, 1.0), curve(cable, x1, b, 1.0)
        for k in range(cable.samples):
            xi = mesh.xi[b, k]
            t1 = tangent_at(q, xi)
            n, inverse = mean_direction(tangent_at(p, xi), t1)
            store_three(f[k], 0, n)
            store_three(f[k], 3, combined(1.0 / sqrt(dot(t1, t1)), t1, 0.0, t1))
            f[k, 6] = -scale * cable.physics.thrust * mesh.weight[b, k] * inverse
        for i in range(cable.dim):
            for j in range(cable.dim):
                add_pairs(cable, b, i, j, band)


@inline
def add_pairs(cable, b, i, j, band):
    """Add the entries (i, j) between all control points of every span of a block."""
    mesh, f, unit = cable.mesh, cable.work.factors, 1.0 if i == j else 0.0
    for first in range(4):
        for other in range(4):
            sum_ = zero()
            for k in range(cable.samples):
                both = slope_at(mesh, b, first, mesh.xi[b, k]) * slope_at(
                    mesh, b, other, mesh.xi[b, k]
                )
                sum_ += f[k, 6] * (unit - f[k, i] * f[k, 3 + j]) * both
            add_to_spans(cable, b, first, other, i, j, sum_, band)


@inline
def slope_at(mesh, b, k, xi):
    """Derivative by u of basis function k of a span."""
    m = mesh.slopes
    return m[b, 3 * k] + xi * (m[b, 3 * k + 1] + xi * m[b, 3 * k + 2])
