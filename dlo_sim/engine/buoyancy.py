"""Buoyancy of a cable that a water surface crosses: the energy rho A g R integral w(t) du, with the
potential w of `terms.wet_section` of the depth t of the centerline below the surface, in radii R.

It is that of the displaced water, so it belongs to the energy of gravity. Sections count as if they
lay in the surface. The sum is over equal parts of each span, short ones, as the force changes over
one diameter.
"""

from __future__ import annotations

from dlo_sim.compiling.kernels import inline, kernel
from dlo_sim.compiling.lanes import lane_sum, zero
from dlo_sim.engine.arrays import SURFACE, WEIGHT
from dlo_sim.engine.band import add_to_spans
from dlo_sim.engine.spans import add_cubic, integrated, line_polynomial, scatter_values
from dlo_sim.engine.term import ENERGY, FORCE, TANGENT
from dlo_sim.terms import wet_section


@inline
def depth_polynomial(cable, x, b):
    """`line_polynomial` of t but for its constant part, `physics.water_level`."""
    up = cable.physics.water_up
    p = line_polynomial(cable.mesh, b, x[0])
    a0, a1, a2, a3 = -up[0] * p[0], -up[0] * p[1], -up[0] * p[2], -up[0] * p[3]
    for line in range(1, cable.dim):
        p = line_polynomial(cable.mesh, b, x[line])
        a0, a1 = a0 - up[line] * p[0], a1 - up[line] * p[1]
        a2, a3 = a2 - up[line] * p[2], a3 - up[line] * p[3]
    return a0, a1, a2, a3


@inline
def depth_at(cable, b, p, xi):
    """Depth of the centerline below the surface at a local coordinate [radii]."""
    return integrated(1.0 / cable.mesh.slope[b], p, xi) + cable.physics.water_level


@inline
def weight_of(cable, b):
    """Length of a part of a span [m], 0 on lanes beyond the last span."""
    half = 1.0 / cable.mesh.slope[b]
    return (4.0 / cable.physics.water_parts) * cable.mesh.share[b] * half * half


@inline
def middle_of(cable, k):
    """Local coordinate of the middle of part k of a span."""
    return (2.0 * k + 1.0) / cable.physics.water_parts - 1.0


@kernel(*ENERGY, terms=SURFACE)
def energy(cable, x, out):
    """Add the energy [J] to that of gravity."""
    sum_ = zero()
    for b in range(cable.blocks):
        p, w = depth_polynomial(cable, x, b), weight_of(cable, b)
        for k in range(int(cable.physics.water_parts)):
            sum_ += w * wet_section.potential(depth_at(cable, b, p, middle_of(cable, k)))
    out[WEIGHT] += cable.physics.buoyancy * lane_sum(sum_)


@kernel(*FORCE, terms=SURFACE)
def force(cable, x0, x1, out):
    """out -= discrete gradient of the energy between x0 and x1."""
    mesh, physics = cable.mesh, cable.physics
    for b in range(cable.blocks):
        p, q, w = (
            depth_polynomial(cable, x0, b),
            depth_polynomial(cable, x1, b),
            weight_of(cable, b),
        )
        f = (zero(), zero(), zero(), zero())
        for k in range(int(physics.water_parts)):
            xi = middle_of(cable, k)
            t0, t1 = depth_at(cable, b, p, xi), depth_at(cable, b, q, xi)
            f = add_cubic(f, w * wet_section.discrete_gradient(t0, t1), xi)
        for line in range(cable.dim):
            scatter_values(mesh, b, f, physics.buoyancy * physics.water_up[line], out[line])


@kernel(*TANGENT, terms=SURFACE)
def tangent(cable, x0, x1, scale, band):
    """band += scale times the Jacobian of the discrete gradient with respect to x1."""
    mesh, physics = cable.mesh, cable.physics
    for b in range(cable.blocks):
        p, q, w = (
            depth_polynomial(cable, x0, b),
            depth_polynomial(cable, x1, b),
            weight_of(cable, b),
        )
        low, high = (zero(), zero(), zero(), zero()), (zero(), zero(), zero(), zero())
        for k in range(int(physics.water_parts)):
            xi = middle_of(cable, k)
            t0, t1 = depth_at(cable, b, p, xi), depth_at(cable, b, q, xi)
            f = w * wet_section.discrete_jacobian(t0, t1)
            low, high = add_cubic(low, f, xi), add_cubic(high, xi * xi * xi * f, xi)
        for first in range(4):
            c = value_polynomial(mesh, b, first)
            for other in range(4):
                d = value_polynomial(mesh, b, other)
                both = c[0] * product(d, low[0], low[1], low[2], low[3])
                both += c[1] * product(d, low[1], low[2], low[3], high[1])
                both += c[2] * product(d, low[2], low[3], high[1], high[2])
                both += c[3] * product(d, low[3], high[1], high[2], high[3])
                for i in range(cable.dim):
                    for j in range(cable.dim):
                        up = physics.water_up[i] * physics.water_up[j]
                        value = scale * physics.buoyancy * up * both
                        add_to_spans(cable, b, first, other, i, j, value, band)


@inline
def value_polynomial(mesh, b, k):
    """Coefficients of basis function k of a span by powers of xi."""
    m, inverse = mesh.slopes, 1.0 / mesh.slope[b]
    return (
        mesh.values[b, k],
        inverse * m[b, 3 * k],
        0.5 * inverse * m[b, 3 * k + 1],
        (1.0 / 3.0) * inverse * m[b, 3 * k + 2],
    )


@inline
def product(d, m0, m1, m2, m3):
    """Sum of coefficients times moments."""
    return d[0] * m0 + d[1] * m1 + (d[2] * m2 + d[3] * m3)
