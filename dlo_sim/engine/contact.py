"""Contact with planes, assembled from the gap g = n . r(u) - d at the quadrature points.

n is the plane's normal, and d includes the cable's radius. The gap is linear in the control points,
hence a cubic polynomial on each span. The mesh stores the derivatives of the basis as polynomials
of the local coordinate xi; with their values at xi = 0 these determine the basis.
"""

from __future__ import annotations

from dlo_sim.compiling.lanes import fabs, lane_sum, zero
from dlo_sim.compiling.pieces import part, piece
from dlo_sim.engine.arrays import CONTACT, TOUCHING
from dlo_sim.engine.band import add_to_spans
from dlo_sim.engine.spans import (
    add_cubic,
    basis_at,
    integrated,
    line_polynomial,
    scatter_values,
)
from dlo_sim.engine.term import ENERGY, FORCE, TANGENT
from dlo_sim.terms import contact


@part
def gap_polynomial(cable, b, x, plane):
    """The gap on the spans of a block, in the form of `spans.line_polynomial`."""
    g = zero() - cable.planes.distance[plane], zero(), zero(), zero()
    for d in range(cable.dim):
        normal, line = cable.planes.normal[plane, d], line_polynomial(cable.mesh, b, x[d])
        g = (
            g[0] + normal * line[0],
            g[1] + normal * line[1],
            g[2] + normal * line[2],
            g[3] + normal * line[3],
        )
    return g


@piece(*FORCE, terms=CONTACT)
def force(cable, x0, x1, out):
    """out -= discrete gradient of the contact energy between x0 and x1."""
    mesh, stiffness = cable.mesh, cable.physics.contact_stiffness
    for plane in range(cable.planes.count):
        for b in range(cable.blocks):
            inverse = 1.0 / mesh.slope[b]
            p, q = gap_polynomial(cable, b, x0, plane), gap_polynomial(cable, b, x1, plane)
            f = (zero(), zero(), zero(), zero())
            for j in range(cable.samples):
                xi = mesh.xi[b, j]
                g0, g1 = integrated(inverse, p, xi), integrated(inverse, q, xi)
                w = mesh.weight[b, j]
                f = add_cubic(f, w * contact.discrete_gradient(stiffness, g0, g1), xi)
            for d in range(cable.dim):
                scatter_values(mesh, b, f, -cable.planes.normal[plane, d], out[d])


@piece(*ENERGY, terms=CONTACT)
def energy(cable, x, out):
    """Add the contact energy [J]."""
    mesh, stiffness, sum_ = cable.mesh, cable.physics.contact_stiffness, zero()
    for plane in range(cable.planes.count):
        for b in range(cable.blocks):
            inverse, p = 1.0 / mesh.slope[b], gap_polynomial(cable, b, x, plane)
            for j in range(cable.samples):
                g = integrated(inverse, p, mesh.xi[b, j])
                sum_ += mesh.weight[b, j] * contact.energy(stiffness, g)
    out[TOUCHING] += lane_sum(sum_)


@piece(*TANGENT, terms=CONTACT)
def tangent(cable, x0, x1, scale, band):
    """band += scale times the Jacobian of the discrete gradient with respect to x1."""
    mesh, shares = cable.mesh, cable.work.shares
    stiffness = cable.physics.contact_stiffness
    for plane in range(cable.planes.count):
        for b in range(cable.blocks):
            inverse = 1.0 / mesh.slope[b]
            p, q = gap_polynomial(cable, b, x0, plane), gap_polynomial(cable, b, x1, plane)
            touched = zero()
            for j in range(cable.samples):
                xi = mesh.xi[b, j]
                g0, g1 = integrated(inverse, p, xi), integrated(inverse, q, xi)
                w = scale * mesh.weight[b, j]
                shares[j] = w * contact.discrete_jacobian(stiffness, g0, g1)
                touched += fabs(shares[j])
            if lane_sum(touched) > 0.0:
                for first in range(4):
                    for other in range(4):
                        f = zero()
                        for j in range(cable.samples):
                            xi = mesh.xi[b, j]
                            both = basis_at(mesh, b, first, inverse, xi)
                            both = both * basis_at(mesh, b, other, inverse, xi)
                            f += both * shares[j]
                        add_block(cable, b, plane, first, other, f, band)


@part
def add_block(cable, b, plane, first, other, f, band):
    """Add f n n^T, f one number per span, between two control points of every span of a block."""
    normal = cable.planes.normal[plane]
    for i in range(cable.dim):
        for j in range(cable.dim):
            add_to_spans(cable, b, first, other, i, j, normal[i] * normal[j] * f, band)
