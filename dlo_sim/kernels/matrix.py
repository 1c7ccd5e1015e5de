"""The step's linear system: unsymmetric band matrix over all spatial DOFs, assembled and solved.

DOF (control point i, row d) has index i dim + d. Entry (r, c) is stored at band[r, c - r + K] with
half bandwidth K = 4 dim - 1, so that a row operation runs over contiguous memory.
"""

from __future__ import annotations

from dlo_sim.kernels.forces import load_amplitude, load_tangent
from dlo_sim.kernels.jit import kernel


@kernel
def span_matrices(jacobian, lattice, dim, out):
    """Blocks over the four control points of each span: rows ((4 k + other) dim^2 + entry)."""
    square = dim * dim
    for b in range(jacobian.shape[0]):
        h = jacobian[b]
        e = lattice.extraction[b]
        m = out[b]
        for entry in range(square):
            for k in range(4):
                row = 4 * k * square + entry
                for lane in range(h.shape[1]):
                    e0, e1, e2 = e[3 * k, lane], e[3 * k + 1, lane], e[3 * k + 2, lane]
                    t0 = (
                        e0 * h[entry, lane]
                        + e1 * h[3 * square + entry, lane]
                        + e2 * h[6 * square + entry, lane]
                    )
                    t1 = (
                        e0 * h[square + entry, lane]
                        + e1 * h[4 * square + entry, lane]
                        + e2 * h[7 * square + entry, lane]
                    )
                    t2 = (
                        e0 * h[2 * square + entry, lane]
                        + e1 * h[5 * square + entry, lane]
                        + e2 * h[8 * square + entry, lane]
                    )
                    m[row, lane] = t0 * e[0, lane] + t1 * e[1, lane] + t2 * e[2, lane]
                    m[row + square, lane] = t0 * e[3, lane] + t1 * e[4, lane] + t2 * e[5, lane]
                    m[row + 2 * square, lane] = t0 * e[6, lane] + t1 * e[7, lane] + t2 * e[8, lane]
                    m[row + 3 * square, lane] = (
                        t0 * e[9, lane] + t1 * e[10, lane] + t2 * e[11, lane]
                    )


@kernel
def scatter_matrices(matrices, n, dim, scale, band):
    """Add scale * span blocks to the band matrix."""
    square = dim * dim
    half = 4 * dim - 1
    lanes = matrices.shape[2]
    for span in range(n - 3):
        b = span // lanes
        lane = span - b * lanes
        m = matrices[b]
        for k in range(4):
            for i in range(dim):
                r = (span + k) * dim + i
                line = band[r]
                offset = span * dim - r + half
                for other in range(4):
                    base = (4 * k + other) * square + i * dim
                    column = offset + other * dim
                    for j in range(dim):
                        line[column + j] += scale * m[base + j, lane]


@kernel
def add_mass(mass_band, n, dim, scale, band):
    """Set the band matrix to scale * M on the diagonal blocks (everything else zero)."""
    half = 4 * dim - 1
    for r in range(n * dim):
        for c in range(band.shape[1]):
            band[r, c] = 0.0
    for d in range(dim):
        for i in range(n):
            r = i * dim + d
            band[r, half] = scale * mass_band[d, 0, i]
            for k in range(1, 4):
                if i + k < n:
                    value = scale * mass_band[d, k, i]
                    band[r, half + k * dim] = value
                    band[r + k * dim, half - k * dim] = value


@kernel
def add_springs(springs, n, dim, scale, band):
    """Add scale * spring stiffness to the diagonal."""
    if springs is not None:
        half = 4 * dim - 1
        for d in range(dim):
            band[d, half] += scale * springs.stiffness[0, d]
            band[(n - 1) * dim + d, half] += scale * springs.stiffness[1, d]


@kernel
def add_load_stiffness(x, loads, axes, t, scale, band):
    """Subtract scale * d(load force)/dq of moments, which turn with the tangent."""
    if loads is not None:
        dim = len(axes)
        half = 4 * dim - 1
        for load in range(loads.first.shape[0]):
            amplitude = load_amplitude(loads.frequency[load], t)
            m0 = amplitude * loads.torque[load, 0]
            m1 = amplitude * loads.torque[load, 1]
            m2 = amplitude * loads.torque[load, 2]
            if m0 == 0.0 and m1 == 0.0 and m2 == 0.0:
                continue
            first = loads.first[load]
            t0, t1, t2 = load_tangent(x, loads.slope[load], first, axes)
            ic = 1.0 / (t0 * t0 + t1 * t1 + t2 * t2)
            tangent = (t0, t1, t2)
            moment = (m0, m1, m2)
            g = (m1 * t2 - m2 * t1, m2 * t0 - m0 * t2, m0 * t1 - m1 * t0)
            for i in range(dim):
                for j in range(dim):
                    a, c = axes[i], axes[j]
                    # d/dt_c of (m x t)_a / |t|^2
                    value = -2.0 * g[a] * tangent[c] * ic * ic
                    if a != c:
                        sign = -1.0 if (c - a) % 3 == 1 else 1.0
                        value += sign * moment[3 - a - c] * ic
                    for k in range(4):
                        r = (first + k) * dim + i
                        for other in range(4):
                            band[r, (first + other) * dim + j - r + half] -= (
                                scale * value * loads.slope[load, k] * loads.slope[load, other]
                            )


@kernel
def hold_prescribed(free, n, dim, band):
    """Turn the equations of prescribed DOFs into 'no change' (their residual is 0 already)."""
    half = 4 * dim - 1
    for i in range(n):
        for d in range(dim):
            if free[d, i] == 0.0:
                r = i * dim + d
                for c in range(band.shape[1]):
                    band[r, c] = 0.0
                band[r, half] = 1.0


@kernel
def eliminate(band, size, half):
    """LU in place without pivoting; false if a pivot vanishes or is not finite.

    The matrix is inertia plus stiffness; where it is not close to positive definite the step is too
    long anyway and is retried shorter.
    """
    for r in range(size):
        pivot = band[r, half]
        if not abs(pivot) > 0.0 or pivot - pivot != 0.0:
            return False
        inverse = 1.0 / pivot
        band[r, half] = inverse
        last = min(size - 1, r + half)
        for row in range(r + 1, last + 1):
            shift = r - row + half
            factor = band[row, shift] * inverse
            band[row, shift] = factor
            if factor != 0.0:
                eliminate_row(
                    band[row, shift + 1 : shift + 1 + last - r], band[r, half + 1 :], factor
                )
    return True


@kernel
def eliminate_row(target, source, factor):
    """target -= factor * source over the length of target."""
    for c in range(target.shape[0]):
        target[c] -= factor * source[c]


@kernel
def substitute(band, size, half, x):
    """Solve with the factors of `eliminate`, in place."""
    for r in range(size):
        value = x[r]
        for c in range(max(0, r - half), r):
            value -= band[r, c - r + half] * x[c]
        x[r] = value
    for r in range(size - 1, -1, -1):
        value = x[r]
        for c in range(r + 1, min(size, r + half + 1)):
            value -= band[r, c - r + half] * x[c]
        x[r] = value * band[r, half]
