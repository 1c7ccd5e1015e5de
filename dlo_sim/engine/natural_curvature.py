"""Natural curvature: - e / c^(3/2) with e = n . (r' x r'') and the vector n = EI kappa0 [N m].

This is the mixed term of EI/2 |kappa - kappa0|^2, with the curvature kappa0 of the unloaded cable
or the plastic curvature. The constant EI/2 |kappa0|^2 is left out.

Fixed in the world, the natural curvature in the state changes only if the caller rotates it, the
plastic one at the end of a step (`engine.plasticity`). In the material frame (bit MATERIAL) the
state holds the vectors at the end of the last step; within a step they rotate with the tangent and
with theta (`terms.material_frame`), which couples bending to twist.
"""

from __future__ import annotations

from numba import int64, void

from dlo_sim.compiling.kernels import inline, kernel
from dlo_sim.compiling.lanes import lane_sum, sqrt, zero
from dlo_sim.engine.arrays import (
    BENDING,
    CABLE,
    CURVED,
    LINES,
    MATERIAL,
    PLASTICITY,
    cable_at,
)
from dlo_sim.engine.plasticity import CURVATURE, TANGENT, curvature, slipping
from dlo_sim.engine.spans import (
    add_cubic,
    add_sample,
    bending_at,
    curve,
    integrated,
    line_polynomial,
    scatter_lines,
    scatter_values,
    store_three,
    tangent_at,
    three,
)
from dlo_sim.engine.term import ENERGY
from dlo_sim.terms import material_frame
from dlo_sim.terms.vectors import combined, cross, dot


@inline
def triple(n, t, k):
    """e = n . (t x k)."""
    b = cross(t, k)
    return n[0] * b[0] + n[1] * b[1] + n[2] * b[2]


@inline
def density(n, t, k, c):
    """- e / c^(3/2)."""
    return -triple(n, t, k) / (c * sqrt(c))


@inline
def density_gradient(c0, c1, e0, e1):
    """Divided differences in c and e."""
    s0, s1 = sqrt(c0), sqrt(c1)
    both = 1.0 / (s0 * s1)
    cube = both * both * both
    return (
        0.5 * (e0 + e1) * (c0 + s0 * s1 + c1) * cube * (1.0 / (s0 + s1)),
        -0.5 * (c0 * s0 + c1 * s1) * cube,
    )


@inline
def density_jacobian(c0, c1, e0, e1):
    """Derivatives of the divided differences (c, e) by (c1, e1): cc, ce, ec; ee is zero."""
    s0, s1 = sqrt(c0), sqrt(c1)
    numerator = c0 + s0 * s1 + c1
    denominator = c0 * s0 * c1 * s1 * (s0 + s1)
    slope = numerator * c0 * s0 * c1 * (3.0 * s0 + 4.0 * s1) / (denominator * denominator)
    slope -= (s0 + 2.0 * s1) / denominator
    return (
        -0.25 * (e0 + e1) * slope / s1,
        0.5 * numerator / denominator,
        0.75 / (c1 * c1 * s1),
    )


@inline
def natural_with(cable, b, j, n, p):
    """n plus p times the weight of quadrature point j of block b and EI."""
    return combined(1.0, n, cable.mesh.weight[b, j] * cable.mesh.bending[b], p)


@inline
def natural_at(cable, b, j):
    """Natural plus plastic curvature at quadrature point j of block b, times its weight and EI."""
    n = three(cable.state.natural[b, j], 0)
    if cable.terms & PLASTICITY:
        n = natural_with(cable, b, j, n, three(cable.state.plastic[b, j], 0))
    return n


@inline
def rest_twist_at(cable, b, j):
    """Twist rate [rad/m] of the unloaded cable at quadrature point j of block b."""
    if cable.terms & MATERIAL:
        return cable.state.natural[b, j, 3]
    return zero()


@inline
def vector_now(n, before, t, angle):
    """Rotate n by `angle` about the tangent `before`, then by the smallest rotation to t."""
    u = material_frame.unit(before)
    return material_frame.transported(material_frame.turned(n, u, angle), u, material_frame.unit(t))


@inline
def turn_polynomial(cable, b, x):
    """Change of theta since the last step on the spans of a block, as `spans.line_polynomial`."""
    p = line_polynomial(cable.mesh, b, x[cable.dim])
    q = line_polynomial(cable.mesh, b, cable.state.reference[cable.dim])
    return p[0] - q[0], p[1] - q[1], p[2] - q[2], p[3] - q[3]


@kernel(void, CABLE, LINES, LINES, LINES, terms=CURVED)
def natural_force(cable, x0, x1, out):
    """out -= discrete gradient between x0 and x1, on the centreline and, in the material frame, on
    theta.
    """
    mesh, state = cable.mesh, cable.state
    follows = cable.terms & MATERIAL != 0
    for b in range(cable.blocks):
        s = mesh.slope[b]
        p, q = curve(cable, x0, b, 1.0), curve(cable, x1, b, 1.0)
        r = p
        angle0 = angle1 = (zero(), zero(), zero(), zero())
        if follows:
            r = curve(cable, state.reference, b, 1.0)
            angle0, angle1 = turn_polynomial(cable, b, x0), turn_polynomial(cable, b, x1)
        g0 = g1 = g2 = (zero(), zero(), zero())
        twisted = (zero(), zero(), zero(), zero())
        for j in range(cable.samples):
            xi = mesh.xi[b, j]
            ta, ka = tangent_at(p, xi), bending_at(p, xi, s)
            tb, kb = tangent_at(q, xi), bending_at(q, xi, s)
            t, k = combined(0.5, ta, 0.5, tb), combined(0.5, ka, 0.5, kb)
            n0 = three(state.natural[b, j], 0)
            if cable.terms & PLASTICITY:
                kappa = curvature(tb, kb)
                if follows:
                    # rotated back to the start of the step, unlike `vector_now`
                    u, now = material_frame.unit(tangent_at(r, xi)), material_frame.unit(tb)
                    kappa = material_frame.transported(kappa, now, u)
                    kappa = material_frame.turned(kappa, u, -integrated(1.0 / s, angle1, xi))
                slip = slipping(cable, b, kappa, three(state.plastic[b, j], 0))
                n0 = natural_with(cable, b, j, n0, slip)
            n1 = n0
            on_t = (zero(), zero(), zero())
            on_angle = zero()
            if follows:
                across0, across1 = cross(ta, ka), cross(tb, kb)
                n0, n1, on_t, on_angle = material_frame.discrete_gradient(
                    n0, material_frame.unit(tangent_at(r, xi)),
                    integrated(1.0 / s, angle0, xi), integrated(1.0 / s, angle1, xi),
                    ta, tb, combined(0.5, across0, 0.5, across1),
                )  # fmt: skip
            on_c, on_e = density_gradient(
                dot(ta, ta), dot(tb, tb),
                triple(n0, ta, ka), triple(n1, tb, kb),
            )  # fmt: skip
            if follows:
                twisted = add_cubic(twisted, on_e * on_angle, xi)
            n = combined(0.5, n0, 0.5, n1)
            on_t = combined(on_e, on_t, 2.0 * on_c, t)
            on_t = combined(1.0, on_t, on_e, cross(k, n))
            on_k = combined(on_e, cross(n, t), 0.0, t)
            g0 = add_sample(g0, on_t[0], s * on_k[0], xi)
            g1 = add_sample(g1, on_t[1], s * on_k[1], xi)
            g2 = add_sample(g2, on_t[2], s * on_k[2], xi)
        scatter_lines(cable, b, g0, g1, g2, -1.0, out)
        if follows:
            scatter_values(mesh, b, twisted, -1.0, out[cable.dim])


@kernel(*ENERGY, terms=CURVED)
def energy(cable, x, out):
    """Add the energy of the natural curvature [J] to the bending energy."""
    mesh, sum_ = cable.mesh, zero()
    follows = cable.terms & MATERIAL != 0
    for b in range(cable.blocks):
        s = mesh.slope[b]
        p = curve(cable, x, b, 1.0)
        r, angle = p, (zero(), zero(), zero(), zero())
        if follows:
            r, angle = curve(cable, cable.state.reference, b, 1.0), turn_polynomial(cable, b, x)
        for j in range(cable.samples):
            xi = mesh.xi[b, j]
            t, k, n = tangent_at(p, xi), bending_at(p, xi, s), natural_at(cable, b, j)
            if follows:
                n = vector_now(n, tangent_at(r, xi), t, integrated(1.0 / s, angle, xi))
            sum_ += density(n, t, k, dot(t, t))
    out[BENDING] += lane_sum(sum_)


@inline
def follow_natural(cable, x):
    """Rotate the vectors in the state to the material frame at the end of a step."""
    mesh, state = cable.mesh, cable.state
    for b in range(cable.blocks):
        p, r = curve(cable, x, b, 1.0), curve(cable, state.reference, b, 1.0)
        angle = turn_polynomial(cable, b, x)
        for j in range(cable.samples):
            xi = mesh.xi[b, j]
            before, t = tangent_at(r, xi), tangent_at(p, xi)
            turned = integrated(1.0 / mesh.slope[b], angle, xi)
            natural = state.natural[b, j]
            store_three(natural, 0, vector_now(three(natural, 0), before, t, turned))
            if cable.terms & PLASTICITY:
                plastic = state.plastic[b, j]
                store_three(plastic, 0, vector_now(three(plastic, 0), before, t, turned))
                store_three(plastic, TANGENT, material_frame.unit(t))
                kappa = vector_now(three(plastic, CURVATURE), before, t, turned)
                store_three(plastic, CURVATURE, kappa)


@kernel(void, int64)
def follow_to_present(address):
    """`follow_natural` to the present shape, for callers from Python."""
    cable = cable_at(address)
    follow_natural(cable, cable.state.x)
