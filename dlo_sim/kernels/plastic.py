"""Plastic bending: a plastic curvature vector per quadrature point, with its flow rule.

With the curvature vector kappa = C / |t|^3 (C = t x k, t = r', k = r'') and the plastic curvature p
the stored energy per rest length is EI/2 |kappa - p|^2 + H/2 |p|^2. The plain bending term holds
EI/2 |kappa|^2; this module adds
    - EI p.C |t|^-3 + (EI + H)/2 |p|^2.
Yield and flow (rate independent, linear kinematic hardening) are those of
`dlo_sim.core.plasticity`, applied once per step at the step's end configuration: an operator split,
first order in the step.

Objectivity: p is kept in world coordinates, normal to the tangent, and is carried along by the
smallest rotation that takes the old tangent to the new one. That follows every motion but a spin of
the cable about its own axis, in which p keeps its direction in the world. Carrying changes the
energy by second order in the rotation of one step; the ledger counts it as dissipated. Three
dimensions only.
"""

from __future__ import annotations

import numpy as np

from dlo_sim.kernels.elastic import scatter_gradient, tangent_coefficients
from dlo_sim.kernels.jit import kernel
from dlo_sim.kernels.layout import DISSIPATED, PLASTIC_WORK

TINY = 1e-300


@kernel
def plastic_gradient(p, lattice, plastic, g):
    """Gradient of - sum w EI p.C |t|^-3 on the span coefficients of r'."""
    s = lattice.slope
    for b in range(p.shape[0]):
        for row in range(9):
            for lane in range(p.shape[2]):
                g[b, row, lane] = 0.0
        for j in range(lattice.xi.shape[1]):
            for lane in range(p.shape[2]):
                x = lattice.xi[b, j, lane]
                t0 = p[b, 0, lane] + x * (p[b, 3, lane] + x * p[b, 6, lane])
                t1 = p[b, 1, lane] + x * (p[b, 4, lane] + x * p[b, 7, lane])
                t2 = p[b, 2, lane] + x * (p[b, 5, lane] + x * p[b, 8, lane])
                k0 = s * (p[b, 3, lane] + 2.0 * x * p[b, 6, lane])
                k1 = s * (p[b, 4, lane] + 2.0 * x * p[b, 7, lane])
                k2 = s * (p[b, 5, lane] + 2.0 * x * p[b, 8, lane])
                n0 = plastic.curvature[b, j, 0, lane]
                n1 = plastic.curvature[b, j, 1, lane]
                n2 = plastic.curvature[b, j, 2, lane]
                ic = 1.0 / (t0 * t0 + t1 * t1 + t2 * t2)
                m = plastic.stiffness * lattice.weights[b, j, lane] * ic * np.sqrt(ic)
                a0 = k1 * n2 - k2 * n1  # k x p
                a1 = k2 * n0 - k0 * n2
                a2 = k0 * n1 - k1 * n0
                pull = 3.0 * m * (t0 * a0 + t1 * a1 + t2 * a2) * ic
                gt0 = pull * t0 - m * a0
                gt1 = pull * t1 - m * a1
                gt2 = pull * t2 - m * a2
                gk0 = s * m * (t1 * n2 - t2 * n1)  # - m p x t
                gk1 = s * m * (t2 * n0 - t0 * n2)
                gk2 = s * m * (t0 * n1 - t1 * n0)
                g[b, 0, lane] += gt0
                g[b, 1, lane] += gt1
                g[b, 2, lane] += gt2
                g[b, 3, lane] += x * gt0 + gk0
                g[b, 4, lane] += x * gt1 + gk1
                g[b, 5, lane] += x * gt2 + gk2
                g[b, 6, lane] += x * (x * gt0 + 2.0 * gk0)
                g[b, 7, lane] += x * (x * gt1 + 2.0 * gk1)
                g[b, 8, lane] += x * (x * gt2 + 2.0 * gk2)


@kernel
def plastic_force(x, lattice, plastic, axes, coefficients, gradient, out):
    """out += - dU/dq of the plastic curvature."""
    if plastic is not None:
        tangent_coefficients(x, lattice, axes, coefficients)
        plastic_gradient(coefficients, lattice, plastic, gradient)
        scatter_gradient(gradient, lattice, axes, -1.0, out)


@kernel
def curvature_vector(p, x, s, lane):
    """Unit tangent and curvature vector C / |t|^3 of one sample."""
    t0 = p[0, lane] + x * (p[3, lane] + x * p[6, lane])
    t1 = p[1, lane] + x * (p[4, lane] + x * p[7, lane])
    t2 = p[2, lane] + x * (p[5, lane] + x * p[8, lane])
    k0 = s * (p[3, lane] + 2.0 * x * p[6, lane])
    k1 = s * (p[4, lane] + 2.0 * x * p[7, lane])
    k2 = s * (p[5, lane] + 2.0 * x * p[8, lane])
    ic = 1.0 / (t0 * t0 + t1 * t1 + t2 * t2)
    i = np.sqrt(ic)
    f = ic * i
    return (
        t0 * i,
        t1 * i,
        t2 * i,
        f * (t1 * k2 - t2 * k1),
        f * (t2 * k0 - t0 * k2),
        f * (t0 * k1 - t1 * k0),
    )


@kernel
def plastic_energy(lattice, plastic, coefficients):
    """- EI p.kappa + (EI + H)/2 |p|^2, integrated [J]; expects the present shape's coefficients."""
    total = 0.0
    if plastic is not None:
        half = 0.5 * (plastic.stiffness + plastic.hardening)
        for b in range(coefficients.shape[0]):
            for j in range(lattice.xi.shape[1]):
                for lane in range(coefficients.shape[2]):
                    x = lattice.xi[b, j, lane]
                    _, _, _, c0, c1, c2 = curvature_vector(coefficients[b], x, lattice.slope, lane)
                    p0 = plastic.curvature[b, j, 0, lane]
                    p1 = plastic.curvature[b, j, 1, lane]
                    p2 = plastic.curvature[b, j, 2, lane]
                    total += lattice.weights[b, j, lane] * (
                        half * (p0 * p0 + p1 * p1 + p2 * p2)
                        - plastic.stiffness * (p0 * c0 + p1 * c1 + p2 * c2)
                    )
    return total


@kernel
def plastic_flow(state, lattice, plastic, axes, coefficients):
    """Carry the plastic curvature to the present shape and let it flow; true if the scene has any.

    The forces of the present shape have to be computed anew afterwards.
    """
    if plastic is None:
        return False
    tangent_coefficients(state.position, lattice, axes, coefficients)
    stiffness = plastic.stiffness
    total = stiffness + plastic.hardening
    carried = 0.0
    flowed = 0.0
    for b in range(coefficients.shape[0]):
        p = plastic.curvature[b]
        a = plastic.tangent[b]
        for j in range(lattice.xi.shape[1]):
            for lane in range(coefficients.shape[2]):
                t0, t1, t2, c0, c1, c2 = curvature_vector(
                    coefficients[b], lattice.xi[b, j, lane], lattice.slope, lane
                )
                p0, p1, p2 = p[j, 0, lane], p[j, 1, lane], p[j, 2, lane]
                # smallest rotation from the old tangent a to t, applied to p normal to a
                h0, h1, h2 = a[j, 0, lane] + t0, a[j, 1, lane] + t1, a[j, 2, lane] + t2
                f = 2.0 * (t0 * p0 + t1 * p1 + t2 * p2) / (h0 * h0 + h1 * h1 + h2 * h2 + TINY)
                w = lattice.weights[b, j, lane]
                carried -= w * stiffness * f * (h0 * c0 + h1 * c1 + h2 * c2)
                p0, p1, p2 = p0 - f * h0, p1 - f * h1, p2 - f * h2
                # relative moment EI (kappa - p) - H p against the yield moment
                m0 = stiffness * c0 - total * p0
                m1 = stiffness * c1 - total * p1
                m2 = stiffness * c2 - total * p2
                m = np.sqrt(m0 * m0 + m1 * m1 + m2 * m2)
                flow = max(m - plastic.yield_moment, 0.0) / total
                f = flow / (m + TINY)
                p[j, 0, lane] = p0 + f * m0
                p[j, 1, lane] = p1 + f * m1
                p[j, 2, lane] = p2 + f * m2
                a[j, 0, lane], a[j, 1, lane], a[j, 2, lane] = t0, t1, t2
                flowed += w * flow * (plastic.yield_moment + 0.5 * total * flow)
    state.ledger[DISSIPATED] += flowed + carried
    state.ledger[PLASTIC_WORK] += flowed
    return True
