"""Drag of the surrounding fluid that depends on the direction of the cable: of air, linear in the
velocity, and of water, quadratic in the velocity relative to its current.

With the unit tangent t and the parts v_n = v - t (t . v) across and v_t = t . v along the cable,
the force per length of air is - (c_n - c_t) v_n: the excess of the normal over the tangential drag,
as the isotropic part, - c_t v, belongs to the linear damping. That of water is, with the velocity
relative to the current u = v - current (Morison, without added mass),
    - k_n |u_n| u_n - k_t |u_t| u_t t,   k_n = rho C_n D / 2,   k_t = rho C_t pi D / 2,
times the share of the section in water where that has a surface (`terms.wet_section`). At the
velocity of the cable they dissipate; water also works on the cable where it flows.
"""

from __future__ import annotations

from dlo_sim.compiling.kernels import inline, kernel
from dlo_sim.compiling.lanes import fabs, sqrt, zero
from dlo_sim.engine.arrays import DRAG, SURFACE
from dlo_sim.engine.band import add_to_spans
from dlo_sim.engine.buoyancy import depth_at, depth_polynomial
from dlo_sim.engine.spans import (
    add_cubic,
    basis_at,
    curve,
    integrated,
    line_polynomial,
    scatter_values,
    store_three,
    tangent_at,
)
from dlo_sim.engine.term import DAMPING, DAMPING_TANGENT
from dlo_sim.terms.vectors import combined, dot
from dlo_sim.terms.wet_section import share

SLOWEST = 1e-12  # [m/s] below which a velocity across the cable has no direction


@inline
def law(physics, t, v, wet):
    """Force per length, but for its sign, at the unit tangent t and the velocity v [N/m], of which
    the share `wet` of the section is in water; returns it and u_t, u_n, |u_n|.
    """
    water = physics.water_current
    u = v[0] - water[0], v[1] - water[1], v[2] - water[2]
    v_t, u_t = dot(t, v), dot(t, u)
    v_n, u_n = combined(1.0, v, -v_t, t), combined(1.0, u, -u_t, t)
    speed = sqrt(dot(u_n, u_n))
    force = combined(physics.drag_across, v_n, wet * physics.water_across * speed, u_n)
    force = combined(1.0, force, wet * physics.water_along * fabs(u_t) * u_t, t)
    return force, u_t, u_n, speed


@kernel(*DAMPING, terms=DRAG)
def drag_force(cable, x, moved, scale, out):
    """out -= integral b (force per length) du at shape x and the velocity scale times `moved`."""
    mesh = cable.mesh
    for b in range(cable.blocks):
        p = curve(cable, x, b, 1.0)
        r = velocity_polynomials(cable, b, moved)
        f0 = f1 = f2 = (zero(), zero(), zero(), zero())
        for j in range(cable.samples):
            xi, w = mesh.xi[b, j], mesh.weight[b, j]
            v = velocity_at(mesh, b, r, xi, scale)
            f, _, _, _ = law(cable.physics, unit_at(p, xi), v, wet_at(cable, b, x, xi))
            f0 = add_cubic(f0, w * f[0], xi)
            f1 = add_cubic(f1, w * f[1], xi)
            f2 = add_cubic(f2, w * f[2], xi)
        scatter_values(mesh, b, f0, -1.0, out[0])
        scatter_values(mesh, b, f1, -1.0, out[1])
        if cable.dim == 3:
            scatter_values(mesh, b, f2, -1.0, out[2])


@kernel(*DAMPING_TANGENT, terms=DRAG)
def drag_tangent(cable, x, moved, scale, band):
    """band += minus the derivative of `drag_force` with respect to `moved`.

    That with respect to the shape is left out: with it a step takes as many iterations. The
    derivative of the law is, with n = u_n / |u_n|,
        (c_n - c_t + k_n |u_n|) (1 - t t^T) + k_n |u_n| n n^T + 2 k_t |u_t| t t^T.
    """
    mesh, physics = cable.mesh, cable.physics
    for b in range(cable.blocks):
        p, r = curve(cable, x, b, 1.0), velocity_polynomials(cable, b, moved)
        for k in range(cable.samples):
            xi, factors, weight = mesh.xi[b, k], cable.work.factors[k], scale * mesh.weight[b, k]
            t = unit_at(p, xi)
            wet = wet_at(cable, b, x, xi)
            _, u_t, u_n, speed = law(physics, t, velocity_at(mesh, b, r, xi, scale), wet)
            water, along = wet * physics.water_across * speed, wet * physics.water_along * fabs(u_t)
            store_three(factors, 0, t)
            store_three(factors, 3, combined(1.0 / (speed + SLOWEST), u_n, 0.0, t))
            across = physics.drag_across + water
            store_three(factors, 6, (weight * across, weight * water, weight * 2.0 * along))
        for i in range(cable.dim):
            for j in range(cable.dim):
                add_pairs(cable, b, i, j, band)


@inline
def add_pairs(cable, b, i, j, band):
    """Add the entries (i, j) between all control points of every span of a block."""
    mesh, f = cable.mesh, cable.work.factors
    inverse, unit = 1.0 / mesh.slope[b], 1.0 if i == j else 0.0
    for k in range(cable.samples):
        t_t, n_n = f[k, i] * f[k, j], f[k, 3 + i] * f[k, 3 + j]
        f[k, 9] = f[k, 6] * (unit - t_t) + f[k, 7] * n_n + f[k, 8] * t_t
    for first in range(4):
        for other in range(4):
            sum_ = zero()
            for k in range(cable.samples):
                xi = mesh.xi[b, k]
                both = basis_at(mesh, b, first, inverse, xi)
                sum_ += f[k, 9] * (both * basis_at(mesh, b, other, inverse, xi))
            add_to_spans(cable, b, first, other, i, j, sum_, band)


@inline
def wet_at(cable, b, x, xi):
    """Share of the section in water at a sample."""
    if cable.terms & SURFACE:
        return share(depth_at(cable, b, depth_polynomial(cable, x, b), xi))
    return zero() + 1.0


@inline
def unit_at(p, xi):
    """Unit tangent at a sample."""
    t = tangent_at(p, xi)
    return combined(1.0 / sqrt(dot(t, t)), t, 0.0, t)


@inline
def velocity_polynomials(cable, b, moved):
    """`line_polynomial` of three lines of `moved`; zeros for a missing one."""
    r0 = line_polynomial(cable.mesh, b, moved[0])
    r1 = line_polynomial(cable.mesh, b, moved[1])
    r2 = zero(), zero(), zero(), zero()
    if cable.dim == 3:
        r2 = line_polynomial(cable.mesh, b, moved[2])
    return r0, r1, r2


@inline
def velocity_at(mesh, b, r, xi, scale):
    """Velocity at a sample: scale times the value of the polynomials."""
    inverse = 1.0 / mesh.slope[b]
    return (
        scale * integrated(inverse, r[0], xi),
        scale * integrated(inverse, r[1], xi),
        scale * integrated(inverse, r[2], xi),
    )
