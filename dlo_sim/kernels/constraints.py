"""Constraints of an inextensible cable: that its length is kept, and the equations to keep it.

Constraint j is g = (sum_d x_d^T A x_d - 1) / 2 = (|r'|^2 - 1) / 2, at an end or as a mean over a
knot span, quadratic in its four control points with a constant A (`Chain.gram`) whose rows sum to
zero, so only differences of control points count. With G = dg/dq the equations to solve are
[[M, G^T], [G, 0]], a band matrix once every multiplier stands behind the last control point that
its constraint touches.
"""

from __future__ import annotations

import numpy as np

from dlo_sim.kernels.jit import kernel


@kernel
def steepness(chain):
    """Largest derivative [1/m] of r' at an end with respect to a control point."""
    return np.sqrt(chain.gram[0, 0, 0])


@kernel
def slot(j, n, dim):
    """Place of constraint j among the unknowns: behind the last control point that it touches."""
    if j == 0:
        return 1 * (dim + 1) + dim
    if j == n - 2:
        return n * (dim + 1)
    return (j + 2) * (dim + 1) + dim


@kernel
def first_point(j, n):
    """First of the four control points of constraint j."""
    return min(max(j - 1, 0), n - 4)


@kernel
def gradient_row(x, gram, j, n, d):
    """dg_j / dq of row d at the four control points of constraint j."""
    first = first_point(j, n)
    start = x[d, first]
    e1 = x[d, first + 1] - start
    e2 = x[d, first + 2] - start
    e3 = x[d, first + 3] - start
    return (
        gram[j, 0, 1] * e1 + gram[j, 0, 2] * e2 + gram[j, 0, 3] * e3,
        gram[j, 1, 1] * e1 + gram[j, 1, 2] * e2 + gram[j, 1, 3] * e3,
        gram[j, 2, 1] * e1 + gram[j, 2, 2] * e2 + gram[j, 2, 3] * e3,
        gram[j, 3, 1] * e1 + gram[j, 3, 2] * e2 + gram[j, 3, 3] * e3,
    )


@kernel
def along_gradient(x, moved, gram, j, n, dim):
    """G_j moved."""
    first = first_point(j, n)
    total = 0.0
    for d in range(dim):
        g = gradient_row(x, gram, j, n, d)
        start = moved[d, first]
        total += g[1] * (moved[d, first + 1] - start)
        total += g[2] * (moved[d, first + 2] - start)
        total += g[3] * (moved[d, first + 3] - start)
    return total


@kernel
def prepare(mass, chain, n, dim):
    """Write what never changes of the saddle-point matrix into chain.blank."""
    stride = dim + 1
    half = 4 * stride
    blank = chain.blank
    for r in range(blank.shape[0]):
        for c in range(blank.shape[1]):
            blank[r, c] = 0.0
        blank[r, half] = 1.0  # unused places and prescribed DOFs
    for d in range(dim):
        for i in range(n):
            if mass.free[d, i] == 0.0:
                continue
            r = i * stride + d
            blank[r, half] = mass.band[d, 0, i]
            for k in range(1, 4):
                if i + k < n and mass.free[d, i + k] != 0.0:
                    blank[r, half + k * stride] = mass.band[d, k, i]
                    blank[r + k * stride, half - k * stride] = mass.band[d, k, i]
    for j in range(n - 1):
        first = first_point(j, n)
        for d in range(dim):
            for k in range(4):
                if mass.free[d, first + k] != 0.0 and chain.gram[j, k, k] != 0.0:
                    blank[slot(j, n, dim), half] = 0.0


@kernel
def assemble(x, mass, chain, n, dim):
    """Saddle-point matrix [[M, G^T], [G, 0]] at configuration x into chain.band."""
    stride = dim + 1
    half = 4 * stride
    band = chain.band
    for r in range(band.shape[0]):
        for c in range(2 * half + 2):
            band[r, c] = chain.blank[r, c]
    for j in range(n - 1):
        place = slot(j, n, dim)
        first = first_point(j, n)
        for d in range(dim):
            g = gradient_row(x, chain.gram, j, n, d)
            for k in range(4):
                value = g[k] * mass.free[d, first + k]
                r = (first + k) * stride + d
                band[r, place - r + half] = value
                band[place, r - place + half] = value


@kernel
def add_multipliers(x, chain, n, dim, sign, rhs):
    """rhs += sign G(x)^T multipliers on the DOF places."""
    stride = dim + 1
    for j in range(n - 1):
        value = sign * chain.multipliers[j]
        first = first_point(j, n)
        for d in range(dim):
            g = gradient_row(x, chain.gram, j, n, d)
            for k in range(4):
                rhs[(first + k) * stride + d] += g[k] * value


@kernel
def violation(x, chain, n, dim):
    """Write -g into the constraint places of chain.rhs; returns the largest |g|."""
    worst = 0.0
    for j in range(n - 1):
        value = 0.5 * (along_gradient(x, x, chain.gram, j, n, dim) - 1.0)
        chain.rhs[slot(j, n, dim)] = -value
        worst = max(worst, abs(value))
    return worst


@kernel
def clear_prescribed(mass, n, dim, rhs):
    """Prescribed DOFs have no equation."""
    for i in range(n):
        for d in range(dim):
            if mass.free[d, i] == 0.0:
                rhs[i * (dim + 1) + d] = 0.0


@kernel
def clear_row(row):
    """row = 0."""
    for r in range(row.shape[0]):
        row[r] = 0.0
