"""Where the energy integral is sampled: Gauss points per knot span, or the paper's uniform samples.

Samples are grouped by knot span because a span is a vector lane of the compiled functions.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import lru_cache

import numpy as np
from numpy.typing import NDArray


@dataclass(frozen=True)
class Quadrature:
    """Samples of an integral over the cable, shape (n_spans, m) each.

    `xi`: local coordinates in [-1, 1]; `weights` [m], which sum to the length; 0 marks padding.
    """

    xi: NDArray[np.float64]
    weights: NDArray[np.float64]

    def places(self, breaks: NDArray[np.float64]) -> NDArray[np.float64]:
        """Material coordinates of the samples [m], shape (n_spans, m)."""
        inside = 0.5 * (self.xi + 1.0) * np.diff(breaks)[:, None]
        return np.asarray(breaks[:-1, None] + inside)


def gauss(breaks: NDArray[np.float64], points: int) -> Quadrature:
    """`points` Gauss-Legendre points per span: exact for degree 2 points - 1 on each span."""
    xi, weights = _gauss(points)
    half = 0.5 * np.diff(breaks)[:, None]
    return Quadrature(np.tile(xi, (len(half), 1)), weights * half)


@lru_cache(maxsize=16)
def _gauss(points: int) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Nodes and weights on [-1, 1]; kept, as the search for them takes a tenth of a millisecond."""
    return np.polynomial.legendre.leggauss(points)


@lru_cache(maxsize=16)
def _radau(points: int) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Nodes and weights on [-1, 1] of Gauss-Radau points, the first at -1; kept as `_gauss`."""
    basis = np.polynomial.legendre.Legendre.basis
    nodes = np.sort((basis(points) + basis(points - 1)).roots().real)
    nodes[0] = -1.0
    return nodes, (1.0 - nodes) / (points * basis(points - 1)(nodes)) ** 2


def with_ends(rule: Quadrature, ends: tuple[bool, bool]) -> Quadrature:
    """A Gauss rule with a sample at u = 0, u = L, or both: Gauss-Radau points in the first and the
    last span, as many as before, exact for degree 2 points - 2.

    Nodes are the roots of P_m + P_{m-1}, weights (1 - xi) / (m P_{m-1})^2 (Abramowitz & Stegun
    25.4.31).
    """
    nodes, weights = _radau(rule.xi.shape[1])
    xi, shares = rule.xi.copy(), rule.weights.copy()
    if ends[0]:
        xi[0], shares[0] = nodes, 0.5 * weights * shares[0].sum()
    if ends[1]:
        xi[-1], shares[-1] = -nodes[::-1], 0.5 * weights[::-1] * shares[-1].sum()
    return Quadrature(xi, shares)


def uniform(breaks: NDArray[np.float64], samples: int) -> Quadrature:
    """Trapezoidal rule on `samples` equally spaced points with both ends (Khalifa & Palli's n_s).

    The paper does not give its weights; the trapezoidal rule is the choice made here. Breaks are
    to be equally spaced too.
    """
    if samples < 2:
        raise ValueError(f"uniform quadrature needs at least 2 samples, got {samples}")
    n_spans, length = len(breaks) - 1, float(breaks[-1])
    # Position in units of a span; integers first, so that samples on a knot are found exactly.
    scaled = np.arange(samples) * n_spans / (samples - 1)
    span = np.minimum(np.floor(scaled + 1e-12).astype(int), n_spans - 1)
    local = 2.0 * (scaled - span) - 1.0
    weight = np.full(samples, length / (samples - 1))
    weight[[0, -1]] *= 0.5
    within = np.arange(samples) - np.searchsorted(span, span)  # number of the sample in its span
    xi, weights = np.zeros((2, n_spans, int(within.max()) + 1))
    xi[span, within] = local
    weights[span, within] = weight
    return Quadrature(xi, weights)
