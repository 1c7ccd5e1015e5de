"""The step's linear system: unsymmetric band matrix over all spatial DOFs, assembled and solved.

DOF (control point i, row d) has index i dim + d. Entry (r, c) is stored at band[r, c - r + K] with
half bandwidth K = 4 dim - 1, so that a row operation runs over contiguous memory. A last column of
zeros fills the row up to 2 K + 2 = 8 dim entries, whole vectors of the machine.
"""

from __future__ import annotations

from dlo_sim.kernels.forces import load_amplitude, load_tangent
from dlo_sim.kernels.jit import kernel
from dlo_sim.kernels.layout import LANES


@kernel
def span_matrices(jacobian, lattice, dim, out):
    """Blocks over the four control points of each span: rows ((4 k + other) dim^2 + entry).

    Row r of lane l of a span block is at r LANES + l, in `jacobian` as in `out`.
    """
    square = dim * dim * LANES
    for b in range(jacobian.shape[0]):
        h = jacobian[b]
        e = lattice.extraction[b]
        m = out[b]
        for k in range(4):
            for entry in range(dim * dim):
                row = entry * LANES
                for lane in range(LANES):
                    e0, e1, e2 = e[3 * k, lane], e[3 * k + 1, lane], e[3 * k + 2, lane]
                    at = row + lane
                    t0 = e0 * h[at] + e1 * h[3 * square + at] + e2 * h[6 * square + at]
                    t1 = e0 * h[square + at] + e1 * h[4 * square + at] + e2 * h[7 * square + at]
                    t2 = e0 * h[2 * square + at] + e1 * h[5 * square + at] + e2 * h[8 * square + at]
                    at += 4 * k * square
                    m[at] = t0 * e[0, lane] + t1 * e[1, lane] + t2 * e[2, lane]
                    m[square + at] = t0 * e[3, lane] + t1 * e[4, lane] + t2 * e[5, lane]
                    m[2 * square + at] = t0 * e[6, lane] + t1 * e[7, lane] + t2 * e[8, lane]
                    m[3 * square + at] = t0 * e[9, lane] + t1 * e[10, lane] + t2 * e[11, lane]


@kernel
def scatter_matrices(matrices, n, dim, scale, band):
    """Add scale * span blocks to the band matrix."""
    square = dim * dim
    half = 4 * dim - 1
    for span in range(n - 3):
        b = span // LANES
        lane = span - b * LANES
        m = matrices[b]
        for k in range(4):
            for i in range(dim):
                r = (span + k) * dim + i
                line = band[r]
                offset = span * dim - r + half
                for other in range(4):
                    base = ((4 * k + other) * square + i * dim) * LANES + lane
                    column = offset + other * dim
                    for j in range(dim):
                        line[column + j] += scale * m[base + j * LANES]


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
        source = band[r, half + 1 :]
        for below in range(1, min(half, size - 1 - r) + 1):
            row = band[r + below]
            factor = row[half - below] * inverse
            row[half - below] = factor
            # Always the full width: beyond the matrix there are zeros. A width known to the
            # compiler is worth more than the few operations saved.
            target = row[half + 1 - below :]
            for c in range(half + 1):
                target[c] -= factor * source[c]
    return True


@kernel
def substitute(band, size, half, x):
    """Solve with the factors of `eliminate`, in place.

    Every sum ends with the newest unknown, so that the rest of it is done while that one is being
    computed; away from the borders the sums have a length that the compiler knows.
    """
    for r in range(size):
        value = x[r]
        if r >= half:
            for k in range(half):
                value -= band[r, k] * x[r - half + k]
        else:
            for k in range(half - r, half):
                value -= band[r, k] * x[r - half + k]
        x[r] = value
    for r in range(size - 1, -1, -1):
        value = x[r]
        if r + half < size:
            for k in range(half, 0, -1):
                value -= band[r, half + k] * x[r + k]
        else:
            for k in range(size - 1 - r, 0, -1):
                value -= band[r, half + k] * x[r + k]
        x[r] = value * band[r, half]
