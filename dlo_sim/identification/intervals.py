"""How well fitted numbers are known: their covariance from what the fit left.

With the derivatives J, robust weights W and H = J^T W J, an error e of the measurements changes the
numbers by -H^-1 J^T W e. Two kinds of error count:
- what is left, with the sums g_t = J_t^T W_t e_t of frame t. Its part is H^-1 S H^-1, with S the
  sum of the autocovariance of g over the lags up to which errors are correlated (Newey & West 1987,
  doi:10.2307/1913610), within each piece of motion;
- noise of the frames from which a piece starts, which the whole piece then follows: a damping is
  told by how a motion dies away, and that depends on how it began. Its part is the mean of
  H^-1 g g^T H^-1 over simulations from starts with as much noise again, with the sum g over a piece
  (propagation of errors, by Monte Carlo: JCGM 101:2008).
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]
NORMAL = 1.96  # standard deviations of 95 %


def covariance(
    errors: Array, derivatives: Array, pieces: NDArray[np.int64], disturbed: Sequence[Array]
) -> Array:
    """Covariance of the unknowns.

    Args:
        errors: by what counts as large, shape (T, N). derivatives: by the unknowns, (T, N, U).
        pieces: which piece each frame is of, rising from 0, shape (T,).
        disturbed: changes of the errors by noise of the starts, shape (T, N) each.
    """
    weights = 1.0 / np.sqrt(1.0 + errors**2)
    weighted = weights[:, :, None] * derivatives
    inverse = np.linalg.pinv(np.einsum("tnj,tnk->jk", weighted, derivatives))
    scores = np.einsum("tn,tnj->tj", errors, weighted)
    firsts = np.flatnonzero(np.diff(pieces, prepend=-1))
    lags = _correlated_frames(errors)
    left = sum(_long_run(part, lags) for part in np.split(scores, firsts[1:]))
    # As many degrees of freedom are used as there are unknowns.
    count = len(errors) / lags
    used = derivatives.shape[2] / errors.shape[1]
    spread = left * count / max(count - used, 1.0)
    for change in disturbed:
        sums = np.add.reduceat(np.einsum("tn,tnj->tj", change, weighted), firsts)
        spread = spread + sums.T @ sums / len(disturbed)
    return np.asarray(inverse @ spread @ inverse)


def _long_run(scores: Array, lags: int) -> Array:
    """Sum of the autocovariance of scores (T, U) over the lags, with falling weights."""
    spread = scores.T @ scores
    for lag in range(1, min(lags, len(scores))):
        both = (1.0 - lag / lags) * scores[lag:].T @ scores[:-lag]
        spread = spread + both + both.T
    return spread


def _correlated_frames(errors: Array) -> int:
    """Frames up to which errors are correlated: twice the first lag below 1/e, at least 1."""
    power = float(np.sum(errors**2))
    for lag in range(1, len(errors) // 4):
        if float(np.sum(errors[lag:] * errors[:-lag])) < power / np.e:
            return 1 if lag == 1 else 2 * lag
    return max(1, len(errors) // 4)
