"""Anisotropic air drag, assembled: the excess of the normal over the tangential drag.

The force per length is - c_t v - (c_n - c_t) (v - t (t . v)) with the unit tangent t. The first
part is isotropic and belongs to the linear damping (`simulation.external_damping`); the second part
is here, with the tangents of a given shape. Both dissipate.
"""

from __future__ import annotations

from dlo_sim.compiling.lanes import sqrt, zero
from dlo_sim.compiling.pieces import part, piece
from dlo_sim.engine.arrays import DRAG
from dlo_sim.engine.band import add_to_spans
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


@piece(*DAMPING, terms=DRAG)
def drag_force(cable, x, moved, scale, out):
    """out -= scale (c_n - c_t) integral b (v - t (t . v)) du, for v = `moved` at shape x."""
    mesh, scale = cable.mesh, scale * cable.physics.drag_across
    for b in range(cable.blocks):
        inverse, p = 1.0 / mesh.slope[b], curve(cable, x, b, 1.0)
        r0, r1 = line_polynomial(mesh, b, moved[0]), line_polynomial(mesh, b, moved[1])
        f0 = f1 = f2 = r2 = (zero(), zero(), zero(), zero())
        if cable.dim == 3:
            r2 = line_polynomial(mesh, b, moved[2])
        for j in range(cable.samples):
            xi, w = mesh.xi[b, j], scale * mesh.weight[b, j]
            t = tangent_at(p, xi)
            v = (
                integrated(inverse, r0, xi),
                integrated(inverse, r1, xi),
                integrated(inverse, r2, xi),
            )
            along = dot(t, v) / dot(t, t)
            f0 = add_cubic(f0, w * (v[0] - along * t[0]), xi)
            f1 = add_cubic(f1, w * (v[1] - along * t[1]), xi)
            f2 = add_cubic(f2, w * (v[2] - along * t[2]), xi)
        scatter_values(mesh, b, f0, -1.0, out[0])
        scatter_values(mesh, b, f1, -1.0, out[1])
        if cable.dim == 3:
            scatter_values(mesh, b, f2, -1.0, out[2])


@piece(*DAMPING_TANGENT, terms=DRAG)
def drag_tangent(cable, x, scale, band):
    """band += scale times the damping matrix of `drag_force`, minus its derivative with respect to
    v. The derivative with respect to the shape is left out.
    """
    mesh, work = cable.mesh, cable.work
    scale = scale * cable.physics.drag_across
    for b in range(cable.blocks):
        inverse, p = 1.0 / mesh.slope[b], curve(cable, x, b, 1.0)
        for j in range(cable.samples):
            t = tangent_at(p, mesh.xi[b, j])
            store_three(work.factors[j], 0, combined(1.0 / sqrt(dot(t, t)), t, 0.0, t))
        for first in range(4):
            for other in range(4):
                for j in range(cable.samples):
                    xi = mesh.xi[b, j]
                    both = basis_at(mesh, b, first, inverse, xi)
                    both = both * basis_at(mesh, b, other, inverse, xi)
                    work.shares[j] = scale * mesh.weight[b, j] * both
                add_pair(cable, b, first, other, band)


@part
def add_pair(cable, b, first, other, band):
    """Add sum_k w_k (1 - t_k t_k^T) between two control points of every span of a block; w_k are
    `work.shares`, and the unit tangents t_k the first three of `work.factors`.
    """
    tangents, shares = cable.work.factors, cable.work.shares
    for i in range(cable.dim):
        for j in range(cable.dim):
            f, unit = zero(), 1.0 if i == j else 0.0
            for k in range(cable.samples):
                f += shares[k] * (unit - tangents[k, i] * tangents[k, j])
            add_to_spans(cable, b, first, other, i, j, f, band)
