"""Symmetric band matrices of half bandwidth 3 (mass, twist) inside the step.

Storage as in `dlo_sim.core.mass`: band[k, j] = A[j + k, j], factors lower[k - 1, i] = L[i, i - k].
"""

from __future__ import annotations

from dlo_sim.kernels.jit import entry, kernel, shared


@entry
def solve_rows(lower, inverse_diagonal, n, x):
    """Solve in place for every row: x[d] <- (L D L^T)^-1 x[d]; prescribed entries become 0.

    The rows are interleaved so that their dependent chains overlap in the pipeline.
    """
    dim = x.shape[0]
    for i in range(n):
        for d in range(dim):
            value = x[d, i]
            if i >= 3:
                value -= lower[d, 2, i] * x[d, i - 3]
            if i >= 2:
                value -= lower[d, 1, i] * x[d, i - 2]
            if i >= 1:
                value -= lower[d, 0, i] * x[d, i - 1]
            x[d, i] = value
    for i in range(n - 1, -1, -1):
        for d in range(dim):
            value = x[d, i] * inverse_diagonal[d, i]
            if i + 3 < n:
                value -= lower[d, 2, i + 3] * x[d, i + 3]
            if i + 2 < n:
                value -= lower[d, 1, i + 2] * x[d, i + 2]
            if i + 1 < n:
                value -= lower[d, 0, i + 1] * x[d, i + 1]
            x[d, i] = value


@kernel
def row_times(band, n, x, i):
    """(A x)_i near the border, where the band is cut off."""
    value = band[0, i] * x[i]
    for k in range(1, 4):
        if i >= k:
            value += band[k, i - k] * x[i - k]
        if i + k < n:
            value += band[k, i] * x[i + k]
    return value


@shared
def multiply(band, n, x, scale, out):
    """out += scale A x for one row of at least four control points."""
    b0, b1, b2, b3 = band[0], band[1], band[2], band[3]
    for i in range(3):
        out[i] += scale * row_times(band, n, x, i)
    for i in range(3, n - 3):
        out[i] += scale * (
            b0[i] * x[i]
            + (b1[i - 1] * x[i - 1] + b1[i] * x[i + 1])
            + (b2[i - 2] * x[i - 2] + b2[i] * x[i + 2])
            + (b3[i - 3] * x[i - 3] + b3[i] * x[i + 3])
        )
    for i in range(max(n - 3, 3), n):
        out[i] += scale * row_times(band, n, x, i)


@kernel
def quadratic_form(band, n, x):
    """x^T A x for one line of control points."""
    total = 0.0
    for i in range(n):
        value = band[0, i] * x[i]
        for k in range(1, 4):
            if i + k < n:
                value += 2.0 * band[k, i] * x[i + k]
        total += value * x[i]
    return total


@kernel
def multiply_differences(band, n, x, scale, out):
    """out += scale A x where the rows of A sum to zero: sum_j A_ij (x_j - x_i).

    Nothing cancels however far x is from zero, as in a cable that has turned a thousand times.
    """
    for i in range(n):
        value = 0.0
        for k in range(1, 4):
            if i >= k:
                value += band[k, i - k] * (x[i - k] - x[i])
            if i + k < n:
                value += band[k, i] * (x[i + k] - x[i])
        out[i] += scale * value


@kernel
def difference_form(band, n, x):
    """x^T A x where the rows of A sum to zero: - sum_(i<j) A_ij (x_j - x_i)^2."""
    total = 0.0
    for i in range(n):
        for k in range(1, 4):
            if i + k < n:
                change = x[i + k] - x[i]
                total -= band[k, i] * change * change
    return total


@kernel
def factorize_row(band, free, n, lower, inverse_diagonal):
    """LDL^T of the free part of one row's matrix; false when it is not positive definite."""
    for i in range(n):
        inverse_diagonal[i] = 0.0
        for k in range(3):
            lower[k, i] = 0.0
        if free[i] == 0.0:
            continue
        diagonal = band[0, i]
        for k in range(min(3, i), 0, -1):
            j = i - k
            if free[j] == 0.0:
                continue
            value = band[k, j]
            for m in range(k + 1, min(3, i) + 1):
                # lower[., i] still holds L D here; it is scaled below
                value -= lower[m - 1, i] * lower[m - k - 1, j]
            lower[k - 1, i] = value
        for k in range(1, min(3, i) + 1):
            scaled = lower[k - 1, i] * inverse_diagonal[i - k]
            diagonal -= scaled * lower[k - 1, i]
            lower[k - 1, i] = scaled
        if not diagonal > 0.0:
            return False
        inverse_diagonal[i] = 1.0 / diagonal
    return True


@kernel
def solve_row(lower, inverse_diagonal, n, x):
    """Solve in place with the factors of `factorize_row`; prescribed entries become 0."""
    for i in range(n):
        value = x[i]
        for k in range(1, 4):
            if i >= k:
                value -= lower[k - 1, i] * x[i - k]
        x[i] = value
    for i in range(n - 1, -1, -1):
        value = x[i] * inverse_diagonal[i]
        for k in range(1, 4):
            if i + k < n:
                value -= lower[k - 1, i + k] * x[i + k]
        x[i] = value
