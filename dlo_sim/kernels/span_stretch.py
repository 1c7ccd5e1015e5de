"""Stretching energy from means over knot spans, where the stretch at every sample would lock.

A span that is bent cannot keep |r'| = 1 at all of its samples: a thin cable, a million times
stiffer along itself than across, would rather not bend at all (membrane locking). So the strain
eps = |r'| - 1 counts by its projection on one number a span, and on a linear function in the first
and the last span: n - 1 numbers, as many as r' has degrees of freedom along a straight cable. With
m = 1/h integral eps du, l = 1/h integral eps xi du and f = 3 where linear, 0 elsewhere,
    U = sum over spans EA h/2 (m^2 + f l^2),     force of a sample along r': EA w (m + f xi l).
Its discrete gradient takes the means of m and l of the two configurations; the increment of |r'|
is that of c = r'.r' over |r'_0| + |r'_1|. Viscosity acts on the rates of m and l.

Here are m and l, and what couples the samples of a span in the Jacobian; the kernels that go
through the samples (`elastic`, `discrete_gradient`, `tangent`) take `counted` for the strain.

A uniformly stretched cable is exact; waves along it are of second order in h (half a percent slow
at six spans a half wave with free ends, one percent with fixed ends).

Source: assumed natural strains, Bucalem & Bathe 1993, Int. J. Numer. Meth. Eng. 36, 3729-3754; for
splines the B-bar projection of Elguedj et al. 2008, Comput. Methods Appl. Mech. Eng. 197,
2732-2762.
"""

from __future__ import annotations

import numpy as np

from dlo_sim.kernels.jit import kernel
from dlo_sim.kernels.layout import LANES

# Row r of lane l of SpanStretch.sums is at r LANES + l. Pairs of rows: m and l of the present
# configuration, of the old one, of the rate.
NOW, OLD, RATE = 0, 2, 4
# Moments 1, xi, xi^2, xi^3 (x 3) of the directions of force, strain and flow.
FORCE, STRAIN, FLOW, ROWS = 6, 18, 30, 42


@kernel
def direction(p, dim, x, lane):
    """r' of one lane at local coordinate x."""
    t0 = p[0, lane] + x * (p[dim, lane] + x * p[2 * dim, lane])
    t1 = p[1, lane] + x * (p[dim + 1, lane] + x * p[2 * dim + 1, lane])
    t2 = 0.0
    if dim == 3:
        t2 = p[2, lane] + x * (p[dim + 2, lane] + x * p[2 * dim + 2, lane])
    return t0, t1, t2


@kernel
def clear_sums(sums, first, last):
    """Rows first to last of the sums = 0."""
    for entry in range(first * LANES, last * LANES):
        sums[entry] = 0.0


@kernel
def mean_strains(p, lattice, spans, dim, b, at):
    """m and l of every span of block b into rows `at` and `at` + 1 of the sums."""
    if spans is not None:
        sums = spans.sums
        clear_sums(sums, at, at + 2)
        for j in range(lattice.xi.shape[1]):
            for lane in range(p.shape[1]):
                x = lattice.xi[b, j, lane]
                t0, t1, t2 = direction(p, dim, x, lane)
                c = t0 * t0 + t1 * t1 + t2 * t2
                # |r'| - 1 without cancellation for nearly unstretched cables
                part = spans.share * lattice.weights[b, j, lane] * (c - 1.0) / (np.sqrt(c) + 1.0)
                sums[at * LANES + lane] += part
                sums[(at + 1) * LANES + lane] += x * part


@kernel
def mean_rates(p0, p1, dp, lattice, spans, viscosity, dim, b):
    """m and l of the motion dp at the mean of two configurations; only where viscosity asks."""
    if spans is not None and viscosity is not None:
        sums = spans.sums
        clear_sums(sums, RATE, RATE + 2)
        for j in range(lattice.xi.shape[1]):
            for lane in range(p0.shape[1]):
                x = lattice.xi[b, j, lane]
                a0, a1, a2 = direction(p0, dim, x, lane)
                b0, b1, b2 = direction(p1, dim, x, lane)
                d0, d1, d2 = direction(dp, dim, x, lane)
                t0, t1, t2 = a0 + b0, a1 + b1, a2 + b2
                along = t0 * d0 + t1 * d1 + t2 * d2
                size = np.sqrt(t0 * t0 + t1 * t1 + t2 * t2)
                part = spans.share * lattice.weights[b, j, lane] * along / size
                sums[RATE * LANES + lane] += part
                sums[(RATE + 1) * LANES + lane] += x * part


@kernel
def counted(spans, at, x, b, lane):
    """The strain, or rate of strain, that counts at local coordinate x of one span."""
    return (
        spans.sums[at * LANES + lane]
        + spans.linear[b, lane] * x * spans.sums[(at + 1) * LANES + lane]
    )


@kernel
def span_stretch_energy(p, lattice, spans, axes):
    """Stretching energy [J]."""
    total = 0.0
    if spans is not None:
        sums = spans.sums
        for b in range(p.shape[0]):
            mean_strains(p[b], lattice, spans, len(axes), b, NOW)
            for lane in range(p.shape[2]):
                m, slope = sums[NOW * LANES + lane], sums[(NOW + 1) * LANES + lane]
                total += m * m + spans.linear[b, lane] * slope * slope
        total *= 0.5 * spans.stiffness / spans.share
    return total


@kernel
def clear_moments(spans):
    """Forget the moments of the block before."""
    if spans is not None:
        clear_sums(spans.sums, FORCE, ROWS)


@kernel
def add_moments(p0, p1, lattice, spans, viscosity, dim, b, j):
    """Add sample j of every lane of block b to the moments."""
    if spans is not None:
        sums = spans.sums
        for lane in range(LANES):
            x = lattice.xi[b, j, lane]
            w = lattice.weights[b, j, lane]
            a0, a1, a2 = direction(p0, dim, x, lane)
            b0, b1, b2 = direction(p1, dim, x, lane)
            s0 = np.sqrt(a0 * a0 + a1 * a1 + a2 * a2)
            s1 = np.sqrt(b0 * b0 + b1 * b1 + b2 * b2)
            both = (a0 + b0, a1 + b1, a2 + b2)
            add_powers(w / (s0 + s1), both, x, dim, FORCE, sums, lane)
            add_powers(w / s1, (b0, b1, b2), x, dim, STRAIN, sums, lane)
        if viscosity is not None:
            for lane in range(LANES):
                x = lattice.xi[b, j, lane]
                w = lattice.weights[b, j, lane]
                a0, a1, a2 = direction(p0, dim, x, lane)
                b0, b1, b2 = direction(p1, dim, x, lane)
                both = (a0 + b0, a1 + b1, a2 + b2)
                size = np.sqrt(both[0] * both[0] + both[1] * both[1] + both[2] * both[2])
                add_powers(w / size, both, x, dim, FLOW, sums, lane)


@kernel
def add_powers(f, t, x, dim, first, sums, lane):
    """Add f t times 1, x, x^2 and x^3 to the moments from row `first`."""
    for i in range(dim):
        value = f * t[i]
        at = (first + i) * LANES + lane
        sums[at] += value
        value *= x
        sums[at + 3 * LANES] += value
        value *= x
        sums[at + 6 * LANES] += value
        value *= x
        sums[at + 9 * LANES] += value


@kernel
def add_dyads(spans, viscosity, tau, dim, b, h):
    """Add what couples the samples of a span to the Jacobian; rows as in `kernels.tangent`."""
    if spans is not None:
        scale = 0.5 * spans.stiffness * spans.share
        linear = spans.linear[b]
        add_dyad(FORCE, STRAIN, scale, linear, dim, spans.sums, h)
        if viscosity is not None:
            add_dyad(FLOW, FLOW, 2.0 * viscosity / tau * scale, linear, dim, spans.sums, h)


@kernel
def add_dyad(left, right, scale, linear, dim, sums, h):
    """h += scale (L_p R_q' + linear L_(p+1) R_(q+1)') of moments L and R, blocks p, q = 0 .. 2."""
    for p in range(3):
        for i in range(dim):
            of_left = (left + 3 * p + i) * LANES
            for q in range(3):
                for j in range(dim):
                    row = (((3 * p + q) * dim + i) * dim + j) * LANES
                    of_right = (right + 3 * q + j) * LANES
                    # Of a length that the compiler does not know: it would unroll the loop and
                    # not find the vectors any more (in three dimensions six times as long).
                    for lane in range(linear.shape[0]):
                        h[row + lane] += scale * sums[of_left + lane] * sums[of_right + lane]
    for lane in range(LANES):
        if linear[lane] != 0.0:
            add_linear_dyad(left + 3, right + 3, scale * linear[lane], dim, sums, h, lane)


@kernel
def add_linear_dyad(left, right, scale, dim, sums, h, lane):
    """h += scale L_p R_q' of one lane."""
    for p in range(3):
        for i in range(dim):
            value = scale * sums[(left + 3 * p + i) * LANES + lane]
            for q in range(3):
                for j in range(dim):
                    row = (((3 * p + q) * dim + i) * dim + j) * LANES
                    h[row + lane] += value * sums[(right + 3 * q + j) * LANES + lane]
