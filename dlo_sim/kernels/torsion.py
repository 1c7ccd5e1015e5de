"""Twist measured against the Frenet torsion: strain theta' - gamma, and its exact gradient.

With t = r', k = r'', c = r''' and C = t x k the torsion of the centerline is gamma = C.c / |C|^2,
which is 0/0 on a straight cable and at an inflection. Here
    gamma = C.c / (|C|^2 + delta^2)
with the curvature floor delta [1/m] (`Frenet.floor` is its square): the true torsion times
|C|^2 / (|C|^2 + delta^2). It is smooth, zero on a straight cable, and bounded by |c| / (2 delta).
The
price: where the curvature is below delta, torsion is suppressed by more than half; those samples
are counted. The jump of the Frenet frame by half a turn at an inflection is not seen at all.

The energy GJ/2 integral (theta' - gamma)^2 is split: GJ/2 theta'^2 is the plain twist term, and
    GJ integral (gamma^2 / 2 - theta' gamma)
is what this module adds, on the same samples. r''' is constant on every knot span. Three dimensions
only. `dlo_sim.core.torsion` is the slow, obvious twin.
"""

from __future__ import annotations

from dlo_sim.kernels.elastic import scatter_gradient, tangent_coefficients
from dlo_sim.kernels.jit import kernel
from dlo_sim.kernels.layout import TORSION_LAST, TORSION_LOOKS, TORSION_SUM, TORSION_WORST


@kernel
def angle_coefficients(line, lattice, out):
    """Coefficients of theta' = a + b xi + c xi^2 on every span, shape (blocks, 3, LANES)."""
    lanes = out.shape[2]
    for b in range(out.shape[0]):
        weights = lattice.extraction[b]
        for row in range(3):
            for lane in range(lanes):
                i = b * lanes + lane
                out[b, row, lane] = (
                    weights[row, lane] * line[i]
                    + weights[3 + row, lane] * line[i + 1]
                    + weights[6 + row, lane] * line[i + 2]
                    + weights[9 + row, lane] * line[i + 3]
                )


@kernel
def scatter_angle(rows, lattice, line):
    """Subtract the transpose of `angle_coefficients` applied to `rows` from `line`."""
    lanes = rows.shape[2]
    for b in range(rows.shape[0]):
        weights = lattice.extraction[b]
        for k in range(4):
            for lane in range(lanes):
                line[b * lanes + lane + k] -= (
                    weights[3 * k, lane] * rows[b, 0, lane]
                    + weights[3 * k + 1, lane] * rows[b, 1, lane]
                    + weights[3 * k + 2, lane] * rows[b, 2, lane]
                )


@kernel
def torsion_gradient(p, angle, lattice, frenet, g, h):
    """Gradient of GJ sum w (gamma^2 / 2 - theta' gamma) on the coefficients of r', theta'."""
    s = lattice.slope
    for b in range(p.shape[0]):
        for row in range(9):
            for lane in range(p.shape[2]):
                g[b, row, lane] = 0.0
        for row in range(3):
            for lane in range(p.shape[2]):
                h[b, row, lane] = 0.0
        for j in range(lattice.xi.shape[1]):
            for lane in range(p.shape[2]):
                x = lattice.xi[b, j, lane]
                q0, q1, q2 = p[b, 6, lane], p[b, 7, lane], p[b, 8, lane]
                t0 = p[b, 0, lane] + x * (p[b, 3, lane] + x * q0)
                t1 = p[b, 1, lane] + x * (p[b, 4, lane] + x * q1)
                t2 = p[b, 2, lane] + x * (p[b, 5, lane] + x * q2)
                k0 = s * (p[b, 3, lane] + 2.0 * x * q0)
                k1 = s * (p[b, 4, lane] + 2.0 * x * q1)
                k2 = s * (p[b, 5, lane] + 2.0 * x * q2)
                c0, c1, c2 = 2.0 * s * s * q0, 2.0 * s * s * q1, 2.0 * s * s * q2
                b0 = t1 * k2 - t2 * k1
                b1 = t2 * k0 - t0 * k2
                b2 = t0 * k1 - t1 * k0
                inverse = 1.0 / (b0 * b0 + b1 * b1 + b2 * b2 + frenet.floor)
                gamma = (b0 * c0 + b1 * c1 + b2 * c2) * inverse
                rate = angle[b, 0, lane] + x * (angle[b, 1, lane] + x * angle[b, 2, lane])
                w = frenet.stiffness * lattice.weights[b, j, lane]
                f = w * (gamma - rate) * inverse  # dU = f (C.dc + e.dC), e = c - 2 gamma C
                e0 = f * (c0 - 2.0 * gamma * b0)
                e1 = f * (c1 - 2.0 * gamma * b1)
                e2 = f * (c2 - 2.0 * gamma * b2)
                gt0 = k1 * e2 - k2 * e1
                gt1 = k2 * e0 - k0 * e2
                gt2 = k0 * e1 - k1 * e0
                gk0 = s * (e1 * t2 - e2 * t1)
                gk1 = s * (e2 * t0 - e0 * t2)
                gk2 = s * (e0 * t1 - e1 * t0)
                f *= 2.0 * s * s
                g[b, 0, lane] += gt0
                g[b, 1, lane] += gt1
                g[b, 2, lane] += gt2
                g[b, 3, lane] += x * gt0 + gk0
                g[b, 4, lane] += x * gt1 + gk1
                g[b, 5, lane] += x * gt2 + gk2
                g[b, 6, lane] += x * (x * gt0 + 2.0 * gk0) + f * b0
                g[b, 7, lane] += x * (x * gt1 + 2.0 * gk1) + f * b1
                g[b, 8, lane] += x * (x * gt2 + 2.0 * gk2) + f * b2
                f = -w * gamma
                h[b, 0, lane] += f
                h[b, 1, lane] += x * f
                h[b, 2, lane] += x * x * f


@kernel
def torsion_force(x, lattice, frenet, axes, coefficients, gradient, out):
    """out += - dU/dq of what the Frenet torsion adds to the plain twist term."""
    if frenet is not None:
        row = len(axes)
        tangent_coefficients(x, lattice, axes, coefficients)
        angle_coefficients(x[row], lattice, frenet.angle)
        torsion_gradient(
            coefficients, frenet.angle, lattice, frenet, gradient, frenet.angle_gradient
        )
        scatter_gradient(gradient, lattice, axes, -1.0, out)
        scatter_angle(frenet.angle_gradient, lattice, out[row])


@kernel
def torsion_energy(x, lattice, frenet, axes, coefficients):
    """GJ integral (gamma^2 / 2 - theta' gamma) [J] of the present coefficients."""
    total = 0.0
    if frenet is not None:
        s = lattice.slope
        p = coefficients
        angle = frenet.angle
        angle_coefficients(x[len(axes)], lattice, angle)
        for b in range(p.shape[0]):
            for j in range(lattice.xi.shape[1]):
                for lane in range(p.shape[2]):
                    x_ = lattice.xi[b, j, lane]
                    b0, b1, b2 = binormal(p[b], x_, s, lane)
                    c0, c1, c2 = p[b, 6, lane], p[b, 7, lane], p[b, 8, lane]
                    gamma = (2.0 * s * s * (b0 * c0 + b1 * c1 + b2 * c2)) / (
                        b0 * b0 + b1 * b1 + b2 * b2 + frenet.floor
                    )
                    rate = angle[b, 0, lane] + x_ * (angle[b, 1, lane] + x_ * angle[b, 2, lane])
                    w = frenet.stiffness * lattice.weights[b, j, lane]
                    total += w * gamma * (0.5 * gamma - rate)
    return total


@kernel
def binormal(p, x, s, lane):
    """C = r' x r'' of one sample."""
    t0 = p[0, lane] + x * (p[3, lane] + x * p[6, lane])
    t1 = p[1, lane] + x * (p[4, lane] + x * p[7, lane])
    t2 = p[2, lane] + x * (p[5, lane] + x * p[8, lane])
    k0 = s * (p[3, lane] + 2.0 * x * p[6, lane])
    k1 = s * (p[4, lane] + 2.0 * x * p[7, lane])
    k2 = s * (p[5, lane] + 2.0 * x * p[8, lane])
    return t1 * k2 - t2 * k1, t2 * k0 - t0 * k2, t0 * k1 - t1 * k0


@kernel
def undefined_torsion(lattice, frenet, coefficients):
    """Number of samples whose curvature |C| is below the floor."""
    count = 0
    if frenet is not None:
        for b in range(coefficients.shape[0]):
            for j in range(lattice.xi.shape[1]):
                for lane in range(coefficients.shape[2]):
                    if lattice.weights[b, j, lane] != 0.0:
                        x = lattice.xi[b, j, lane]
                        b0, b1, b2 = binormal(coefficients[b], x, lattice.slope, lane)
                        if b0 * b0 + b1 * b1 + b2 * b2 < frenet.floor:
                            count += 1
    return count


@kernel
def count_undefined(lattice, frenet, coefficients, ledger):
    """Book how many samples have no torsion worth the name at the present shape."""
    if frenet is not None:
        count = float(undefined_torsion(lattice, frenet, coefficients))
        ledger[TORSION_LOOKS] += 1.0
        ledger[TORSION_SUM] += count
        ledger[TORSION_WORST] = max(ledger[TORSION_WORST], count)
        ledger[TORSION_LAST] = count
