"""The spline on knot spans: r, t = r' and k = r'' at local coordinates, and the way back, from
derivatives of an energy by them to forces on the control points. Eight spans at a time, a block.

On a span r' = A + B xi + C xi^2, xi from -1 to 1. A `curve` is (A, B, C) of the lines x, y, z; that
of a planar cable has zeros for its third line.
"""

from __future__ import annotations

from dlo_sim.compiling.groups import load, store
from dlo_sim.compiling.kernels import inline
from dlo_sim.compiling.lanes import LANES, sqrt, zero
from dlo_sim.engine.arrays import MARGIN
from dlo_sim.terms.vectors import dot


@inline
def coefficients(mesh, b, line):
    """A, B, C of one line on the spans of block b."""
    at, m = MARGIN + LANES * b, mesh.slopes
    q0, q1, q2, q3 = load(line, at), load(line, at + 1), load(line, at + 2), load(line, at + 3)
    return (
        m[b, 0] * q0 + m[b, 3] * q1 + (m[b, 6] * q2 + m[b, 9] * q3),
        m[b, 1] * q0 + m[b, 4] * q1 + (m[b, 7] * q2 + m[b, 10] * q3),
        m[b, 2] * q0 + m[b, 5] * q1 + (m[b, 8] * q2 + m[b, 11] * q3),
    )


@inline
def twist_rate(cable, x, b):
    """A, B, C of theta' on the spans of a block, from differences between control points: free of
    cancellation for any offset, such as the angle after a thousand turns.
    """
    at, m, line = MARGIN + LANES * b, cable.mesh.slopes, x[cable.dim]
    here = load(line, at + 1)
    q0, q2, q3 = load(line, at) - here, load(line, at + 2) - here, load(line, at + 3) - here
    return (
        m[b, 0] * q0 + m[b, 6] * q2 + m[b, 9] * q3,
        m[b, 1] * q0 + m[b, 7] * q2 + m[b, 10] * q3,
        m[b, 2] * q0 + m[b, 8] * q2 + m[b, 11] * q3,
    )


@inline
def curve(cable, x, b, straight):
    """A, B, C of all spatial lines; `straight` times a unit tangent on lanes beyond the last."""
    mesh = cable.mesh
    p0 = coefficients(mesh, b, x[0])
    p0 = p0[0] + straight * mesh.padding[b], p0[1], p0[2]
    p1 = coefficients(mesh, b, x[1])
    p2 = zero(), zero(), zero()
    if cable.dim == 3:
        p2 = coefficients(mesh, b, x[2])
    return p0, p1, p2


@inline
def tangent_at(p, xi):
    """t = r' at a local coordinate."""
    return (
        p[0][0] + xi * (p[0][1] + xi * p[0][2]),
        p[1][0] + xi * (p[1][1] + xi * p[1][2]),
        p[2][0] + xi * (p[2][1] + xi * p[2][2]),
    )


@inline
def bending_at(p, xi, slope):
    """k = r'' at a local coordinate; `slope` is d xi / du."""
    two = 2.0 * xi
    return (
        slope * (p[0][1] + two * p[0][2]),
        slope * (p[1][1] + two * p[1][2]),
        slope * (p[2][1] + two * p[2][2]),
    )


@inline
def blocks_of(cable, number):
    """First block with spans of a strand, and the one behind the last."""
    begin, end = cable.mesh.strand[number, 0], cable.mesh.strand[number, 1]
    return begin // LANES, (end - 4) // LANES + 1


@inline
def belongs(cable, b, number):
    """Above 0 on the spans of a block that are of a strand."""
    apart = cable.mesh.number[b] - number
    return 0.5 - apart * apart


@inline
def three(row, k):
    """Three successive entries as a vector."""
    return row[k], row[k + 1], row[k + 2]


@inline
def store_three(row, k, v):
    """Set three successive entries to a vector."""
    row[k] = v[0]
    row[k + 1] = v[1]
    row[k + 2] = v[2]


@inline
def add_sample(g, on_t, on_k, xi):
    """g + gradient on A, B, C of one line from one sample's, on r' and (times d xi/du) on r''."""
    return g[0] + on_t, g[1] + (xi * on_t + on_k), g[2] + xi * (xi * on_t + 2.0 * on_k)


@inline
def scatter(mesh, b, g, scale, out):
    """out += scale times the gradient on the control points of a line; g: on A, B, C."""
    at, m = MARGIN + LANES * b, mesh.slopes
    for k in range(4):
        f = m[b, 3 * k] * g[0] + m[b, 3 * k + 1] * g[1]
        f += m[b, 3 * k + 2] * g[2]
        store(out, at + k, load(out, at + k) + scale * f)


@inline
def scatter_lines(cable, b, g0, g1, g2, scale, out):
    """`scatter` of all spatial lines."""
    mesh = cable.mesh
    scatter(mesh, b, g0, scale, out[0])
    scatter(mesh, b, g1, scale, out[1])
    if cable.dim == 3:
        scatter(mesh, b, g2, scale, out[2])


@inline
def integrated(inverse_slope, p, xi):
    """Value at xi of p0 + integral over u of p1 + p2 xi + p3 xi^2 from the middle of the span."""
    return p[0] + xi * inverse_slope * (p[1] + xi * (0.5 * p[2] + xi * p[3] * (1.0 / 3.0)))


@inline
def line_polynomial(mesh, b, line):
    """One line on the spans of a block: value at xi = 0, then A, B, C of its derivative."""
    at = MARGIN + LANES * b
    value = mesh.values[b, 0] * load(line, at)
    for k in range(1, 4):
        value += mesh.values[b, k] * load(line, at + k)
    p = coefficients(mesh, b, line)
    return value, p[0], p[1], p[2]


@inline
def basis_at(mesh, b, k, inverse_slope, xi):
    """Value of basis function k of a span."""
    m = mesh.slopes
    p = mesh.values[b, k], m[b, 3 * k], m[b, 3 * k + 1], m[b, 3 * k + 2]
    return integrated(inverse_slope, p, xi)


@inline
def add_cubic(a, f, xi):
    """a + f (1, xi, xi^2, xi^3), with f a sample's gradient on a line's value: `scatter_values`."""
    g = xi * f
    return a[0] + f, a[1] + g, a[2] + xi * g, a[3] + xi * xi * g


@inline
def scatter_values(mesh, b, f, scale, out):
    """out += scale times the gradient on the control points of a line; f: from `add_cubic`."""
    inverse, at = 1.0 / mesh.slope[b], MARGIN + LANES * b
    on_slopes = inverse * f[1], 0.5 * inverse * f[2], (1.0 / 3.0) * inverse * f[3]
    scatter(mesh, b, on_slopes, scale, out)
    for k in range(4):
        store(out, at + k, load(out, at + k) + scale * mesh.values[b, k] * f[0])


@inline
def span_strains(mesh, b, p):
    """m and l, mean and linear part of the axial strain, of the spans of a block (`elastic`)."""
    mean, slope, share = zero(), zero(), mesh.share[b]
    for j in range(mesh.xi.shape[1]):
        xi = mesh.xi[b, j]
        t = tangent_at(p, xi)
        # `stretch.strain` without its division, which costs 5 % of a step; c is no more exact.
        f = share * mesh.weight[b, j] * (sqrt(dot(t, t)) - 1.0)
        mean += f
        slope += xi * f
    return mean, slope


@inline
def products(p):
    """Inner products A.A, A.B, A.C, B.B, B.C, C.C of the coefficients of r'."""
    a, b, c = (
        (p[0][0], p[1][0], p[2][0]),
        (p[0][1], p[1][1], p[2][1]),
        (p[0][2], p[1][2], p[2][2]),
    )
    return dot(a, a), dot(a, b), dot(a, c), dot(b, b), dot(b, c), dot(c, c)


@inline
def matrix_times(g, p):
    """The symmetric matrix g, (AA, AB, AC, BB, BC, CC), times A, B, C of one line."""
    return (
        g[0] * p[0] + g[1] * p[1] + g[2] * p[2],
        g[1] * p[0] + g[3] * p[1] + g[4] * p[2],
        g[2] * p[0] + g[4] * p[1] + g[5] * p[2],
    )
