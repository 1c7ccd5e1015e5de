"""Linear equations by elimination without exchanging rows, and without LAPACK, which rounds
differently on another processor.

That suits matrices that are positive definite, diagonally dominant or totally positive (de Boor &
Pinkus 1977, SIAM J. Numer. Anal. 14, 123-132).
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]


def solve(matrix: Array, values: Array, reach: int | None = None) -> tuple[Array, Array]:
    """Solution x of matrix x = values, shape (n,) or (n, m), and the pivots, shape (n,).

    As many pivots are negative as eigenvalues of a symmetric matrix. `reach`: how far from the
    diagonal entries are that are not zero; default: anywhere.
    """
    left, x = matrix.copy(), np.array(values, dtype=float)
    reach = len(x) if reach is None else reach
    for i in range(len(x) - 1):
        below = slice(i + 1, i + 1 + reach)
        factors = left[below, i] / left[i, i]
        left[below, below] -= np.multiply.outer(factors, left[i, below])
        x[below] -= np.multiply.outer(factors, x[i])
    for i in range(len(x) - 1, -1, -1):
        x[i] /= left[i, i]
        above = slice(max(i - reach, 0), i)
        x[above] -= np.multiply.outer(left[above, i], x[i])
    return x, left.diagonal()
