"""Elastic energy of the sampled spline and its exact gradient, vectorised over knot spans.

With t = r'(u), k = r''(u) and the invariants c = t.t, h = k.k, d = t.k the energy density per rest
length is
    stretch  EA/2 (sqrt(c) - 1)^2
    bend     EI/2 kappa^2 = EI/2 (h / c^2 - d^2 / c^3)
    natural curvature  - EI kappa0 n.(t x k) / c^(3/2)
where n is the axis of the natural curvature (the constant EI kappa0^2 / 2 is left out of the
gradient and of the energy). `dlo_sim.core.elasticity` is the slow, obvious twin.
"""

from __future__ import annotations

import numpy as np

from dlo_sim.kernels.jit import kernel, shared
from dlo_sim.kernels.span_stretch import NOW, counted, mean_strains


@shared
def tangent_coefficients(x, lattice, axes, out):
    """Coefficients of r' = A + B xi + C xi^2 on every span; rows (A, B, C) x dim of `out`."""
    dim = len(axes)
    lanes = out.shape[2]
    for b in range(out.shape[0]):
        first = b * lanes
        rows = out[b]
        weights = lattice.extraction[b]
        padding = lattice.padding[b]
        for d in range(dim):
            line = x[d]
            for lane in range(lanes):
                q0 = line[first + lane]
                q1 = line[first + lane + 1]
                q2 = line[first + lane + 2]
                q3 = line[first + lane + 3]
                rows[d, lane] = (
                    weights[0, lane] * q0
                    + weights[3, lane] * q1
                    + weights[6, lane] * q2
                    + weights[9, lane] * q3
                )
                rows[dim + d, lane] = (
                    weights[1, lane] * q0
                    + weights[4, lane] * q1
                    + weights[7, lane] * q2
                    + weights[10, lane] * q3
                )
                rows[2 * dim + d, lane] = (
                    weights[2, lane] * q0
                    + weights[5, lane] * q1
                    + weights[8, lane] * q2
                    + weights[11, lane] * q3
                )
        for lane in range(lanes):
            rows[0, lane] += padding[lane]


@kernel
def scatter_gradient(rows, lattice, axes, scale, out):
    """out += scale * (transpose of `tangent_coefficients`) applied to `rows`."""
    dim = len(axes)
    lanes = rows.shape[2]
    for b in range(rows.shape[0]):
        first = b * lanes
        weights = lattice.extraction[b]
        block = rows[b]
        for d in range(dim):
            line = out[d]
            for k in range(4):
                for lane in range(lanes):
                    line[first + lane + k] += scale * (
                        weights[3 * k, lane] * block[d, lane]
                        + weights[3 * k + 1, lane] * block[dim + d, lane]
                        + weights[3 * k + 2, lane] * block[2 * dim + d, lane]
                    )


@kernel
def span_gradient(coefficients, lattice, stretch, spans, bend, rest, axes, out):
    """Gradient of the elastic energy with respect to the span coefficients A, B, C."""
    dim = len(axes)
    lanes = coefficients.shape[2]
    s = lattice.slope
    for b in range(coefficients.shape[0]):
        p = coefficients[b]
        g = out[b]
        for row in range(3 * dim):
            for lane in range(lanes):
                g[row, lane] = 0.0
        mean_strains(p, lattice, spans, dim, b, NOW)
        for j in range(lattice.xi.shape[1]):
            xi = lattice.xi[b, j]
            weights = lattice.weights[b, j]
            for lane in range(lanes):
                x = xi[lane]
                w = weights[lane]
                t0 = p[0, lane] + x * (p[dim, lane] + x * p[2 * dim, lane])
                t1 = p[1, lane] + x * (p[dim + 1, lane] + x * p[2 * dim + 1, lane])
                k0 = s * (p[dim, lane] + 2.0 * x * p[2 * dim, lane])
                k1 = s * (p[dim + 1, lane] + 2.0 * x * p[2 * dim + 1, lane])
                c = t0 * t0 + t1 * t1
                h = k0 * k0 + k1 * k1
                d = t0 * k0 + t1 * k1
                t2 = 0.0
                k2 = 0.0
                if dim == 3:
                    t2 = p[2, lane] + x * (p[dim + 2, lane] + x * p[2 * dim + 2, lane])
                    k2 = s * (p[dim + 2, lane] + 2.0 * x * p[2 * dim + 2, lane])
                    c += t2 * t2
                    h += k2 * k2
                    d += t2 * k2
                ic = 1.0 / c
                along_t = 0.0  # dU/dt = along_t t + cross k, dU/dk = along_k k + cross t
                cross = 0.0
                along_k = 0.0
                if stretch is not None:
                    along_t += stretch.stiffness * w * (1.0 - np.sqrt(c) * ic)
                if spans is not None:
                    along_t += spans.stiffness * w * np.sqrt(ic) * counted(spans, NOW, x, b, lane)
                if bend is not None:
                    f = bend.stiffness * w * ic * ic
                    along_k = f
                    cross = -f * d * ic
                    along_t += f * ic * (3.0 * d * d * ic - 2.0 * h)
                gt0 = along_t * t0 + cross * k0
                gt1 = along_t * t1 + cross * k1
                gk0 = along_k * k0 + cross * t0
                gk1 = along_k * k1 + cross * t1
                gt2 = 0.0
                gk2 = 0.0
                if dim == 3:
                    gt2 = along_t * t2 + cross * k2
                    gk2 = along_k * k2 + cross * t2
                if rest is not None:
                    m = rest.moment[b, j, lane] * ic * np.sqrt(ic)
                    n2 = rest.axis[2]
                    if dim == 3:
                        n0 = rest.axis[0]
                        n1 = rest.axis[1]
                        e = (
                            n0 * (t1 * k2 - t2 * k1)
                            + n1 * (t2 * k0 - t0 * k2)
                            + n2 * (t0 * k1 - t1 * k0)
                        )
                        pull = 3.0 * m * e * ic
                        gt0 += pull * t0 - m * (k1 * n2 - k2 * n1)
                        gt1 += pull * t1 - m * (k2 * n0 - k0 * n2)
                        gt2 += pull * t2 - m * (k0 * n1 - k1 * n0)
                        gk0 -= m * (n1 * t2 - n2 * t1)
                        gk1 -= m * (n2 * t0 - n0 * t2)
                        gk2 -= m * (n0 * t1 - n1 * t0)
                    else:
                        pull = 3.0 * m * n2 * (t0 * k1 - t1 * k0) * ic
                        gt0 += pull * t0 - m * k1 * n2
                        gt1 += pull * t1 + m * k0 * n2
                        gk0 += m * n2 * t1
                        gk1 -= m * n2 * t0
                gk0 *= s
                gk1 *= s
                g[0, lane] += gt0
                g[1, lane] += gt1
                g[dim, lane] += x * gt0 + gk0
                g[dim + 1, lane] += x * gt1 + gk1
                g[2 * dim, lane] += x * (x * gt0 + 2.0 * gk0)
                g[2 * dim + 1, lane] += x * (x * gt1 + 2.0 * gk1)
                if dim == 3:
                    gk2 *= s
                    g[2, lane] += gt2
                    g[dim + 2, lane] += x * gt2 + gk2
                    g[2 * dim + 2, lane] += x * (x * gt2 + 2.0 * gk2)


@shared
def elastic_energy(coefficients, lattice, stretch, bend, rest, axes, scratch):
    """Stretching and bending energy [J] (natural curvature counts as bending).

    The sums of every lane are kept in the first two rows of `scratch`, so that lanes stay vectors.
    """
    dim = len(axes)
    s = lattice.slope
    stretching = 0.0
    bending = 0.0
    for b in range(coefficients.shape[0]):
        p = coefficients[b]
        sums = scratch[b]
        for lane in range(p.shape[1]):
            sums[0, lane] = 0.0
            sums[1, lane] = 0.0
        for j in range(lattice.xi.shape[1]):
            xi = lattice.xi[b, j]
            weights = lattice.weights[b, j]
            for lane in range(p.shape[1]):
                w = weights[lane]
                x = xi[lane]
                t0 = p[0, lane] + x * (p[dim, lane] + x * p[2 * dim, lane])
                t1 = p[1, lane] + x * (p[dim + 1, lane] + x * p[2 * dim + 1, lane])
                k0 = s * (p[dim, lane] + 2.0 * x * p[2 * dim, lane])
                k1 = s * (p[dim + 1, lane] + 2.0 * x * p[2 * dim + 1, lane])
                t2 = 0.0
                k2 = 0.0
                if dim == 3:
                    t2 = p[2, lane] + x * (p[dim + 2, lane] + x * p[2 * dim + 2, lane])
                    k2 = s * (p[dim + 2, lane] + 2.0 * x * p[2 * dim + 2, lane])
                c = t0 * t0 + t1 * t1 + t2 * t2
                if stretch is not None:
                    # (sqrt(c) - 1) without cancellation for nearly unstretched cables
                    strain = (c - 1.0) / (np.sqrt(c) + 1.0)
                    sums[0, lane] += 0.5 * stretch.stiffness * w * strain * strain
                c0 = t1 * k2 - t2 * k1
                c1 = t2 * k0 - t0 * k2
                c2 = t0 * k1 - t1 * k0
                if bend is not None:
                    sums[1, lane] += (
                        0.5 * bend.stiffness * w * (c0 * c0 + c1 * c1 + c2 * c2) / (c * c * c)
                    )
                if rest is not None:
                    e = rest.axis[2] * c2
                    if dim == 3:
                        e += rest.axis[0] * c0 + rest.axis[1] * c1
                    sums[1, lane] -= rest.moment[b, j, lane] * e / (c * np.sqrt(c))
        for lane in range(p.shape[1]):
            stretching += sums[0, lane]
            bending += sums[1, lane]
    return stretching, bending
