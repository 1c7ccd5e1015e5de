"""Clamped cubic B-splines: knots, basis functions, control points <-> curve.

The curve is r(u) = sum_i b_i(u) q_i with u in [0, L] the rest arc length. On every knot span only
four basis functions are non-zero and each is a cubic in the local coordinate
xi = (u - mid) / (h / 2) in [-1, 1]; all evaluation goes through those cubics.
"""

from __future__ import annotations

import functools
import itertools
from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray

from dlo_sim.core import elimination

DEGREE = 3
ACTIVE = DEGREE + 1
RESOLUTION = 10_001  # points at which the density of graded knots is integrated

Array = NDArray[np.float64]


class Grading(NamedTuple):
    """Density of knots near the ends in excess of that elsewhere, which counts as 1.

    It is `start` and `end` at the ends and decays by 1/e over the length `reach` [m].
    """

    start: float = 0.0
    end: float = 0.0
    reach: float = 1.0


EQUAL = Grading()


def clamped_knots(control_points: int, length: float, grading: Grading = EQUAL) -> Array:
    """Knot vector [m] of a clamped cubic spline: 0 and L with multiplicity 4, n - 4 breaks between.

    Each span has the same part of the integral of the density of knots, 1 + start exp(-u / reach) +
    end exp(-(L - u) / reach); by default all spans have the same length.

    Args:
        control_points: their number n, at least 4. length: rest length L [m].
    """
    if control_points < ACTIVE:
        raise ValueError(f"a cubic spline needs at least 4 control points, got {control_points}")
    ends = np.linspace(0.0, length, control_points - DEGREE + 1)
    start, end, reach = grading
    if start or end:
        u = np.linspace(0.0, length, RESOLUTION)
        knots_up_to = u - start * reach * np.expm1(-u / reach)
        knots_up_to += end * reach * (np.exp((u - length) / reach) - np.exp(-length / reach))
        ends[1:-1] = np.interp(knots_up_to[-1] / length * ends[1:-1], knots_up_to, u)
    return np.concatenate((np.zeros(DEGREE), ends, np.full(DEGREE, length)))


def cut(knots: Array, places: Sequence[float]) -> Array:
    """Knots of a spline that may bend and twist sharply at these places [m], rising, inside it:
    there they are threefold, so that only the curve itself goes on. Between the places the spans
    are equal, at least two, and as many in all as far as that allows; each place adds two control
    points.
    """
    if not places:
        return knots
    length, spans = float(knots[-1]), len(breaks(knots)) - 1
    ends = np.array([0.0, *places, length])
    pieces = [
        np.linspace(a, b, max(round(spans * (b - a) / length), 2) + 1)
        for a, b in itertools.pairwise(ends)
    ]
    inside = [np.concatenate((piece[:-1], [piece[-1]] * DEGREE)) for piece in pieces[:-1]]
    found = [inside[0], *(one[1:] for one in inside[1:]), pieces[-1][1:]]
    return np.concatenate((np.zeros(DEGREE), *found, np.full(DEGREE, length)))


def breaks(knots: Array) -> Array:
    """Ends of the knot spans [m], shape (n_spans + 1,)."""
    return knots[DEGREE : len(knots) - DEGREE]


def span_polynomials(knots: Array, derivative: int = 0) -> Array:
    """Cubics of the four active basis functions of every knot span, or a derivative with respect to
    u.

    Cox-de Boor recursion carried out on polynomial coefficients.

    Returns:
        Coefficients [1/m^derivative], shape (n_spans, 4 basis functions, 4 - derivative powers of
        xi), read-only; basis function k of span s belongs to control point s + k. Zero for spans
        between equal knots.

    Source: de Boor, A Practical Guide to Splines, 1978, ch. X.
    """
    return _span_polynomials(np.ascontiguousarray(knots, dtype=float).tobytes(), derivative)


@functools.lru_cache(maxsize=64)  # one model asks for the same ones up to ten times
def _span_polynomials(knot_bytes: bytes, derivative: int) -> Array:
    knots = np.frombuffer(knot_bytes)
    n_spans = len(knots) - 2 * DEGREE - 1
    index = np.arange(n_spans) + DEGREE
    mid = 0.5 * (knots[index] + knots[index + 1])
    half = 0.5 * (knots[index + 1] - knots[index])
    empty = half == 0.0  # between equal knots
    basis = np.zeros((n_spans, 1, ACTIVE))
    basis[:, 0, 0] = 1.0
    for degree in range(1, DEGREE + 1):
        raised = np.zeros((n_spans, degree + 1, ACTIVE))
        for k in range(degree):
            # Lower-degree function k lives on knots [left, right] and feeds its two neighbours.
            left = knots[index - degree + 1 + k]
            right = knots[index + 1 + k]
            part = basis[:, k] / np.where(empty, 1.0, right - left)[:, None]
            shifted = np.zeros_like(part)
            shifted[:, 1:] = part[:, :-1] * half[:, None]
            raised[:, k + 1] += (mid - left)[:, None] * part + shifted
            raised[:, k] += (right - mid)[:, None] * part - shifted
        basis = raised
    for _ in range(derivative):
        basis = basis[..., 1:] * np.arange(1, basis.shape[-1])
        basis /= np.where(empty, 1.0, half)[:, None, None]
    basis[empty] = 0.0
    basis.flags.writeable = False
    return basis


def locate(knots: Array, u: ArrayLike) -> tuple[NDArray[np.int64], Array]:
    """Span index and local coordinate xi in [-1, 1] of material coordinates u [m]."""
    u = np.asarray(u, dtype=float)
    length = knots[-1]
    tolerance = 1e-9 * length
    if u.size and not (u.min() >= -tolerance and u.max() <= length + tolerance):  # or not a number
        raise ValueError(
            f"material coordinate outside [0, {length:g}] m: {u.min():g} .. {u.max():g}"
        )
    ends = breaks(knots)
    span = np.clip(np.searchsorted(ends, u, side="right") - 1, 0, len(ends) - 2)
    half = 0.5 * (ends[span + 1] - ends[span])
    xi = (u - 0.5 * (ends[span] + ends[span + 1])) / half
    return span, np.clip(xi, -1.0, 1.0)


def active_basis(
    knots: Array, u: ArrayLike, derivative: int = 0
) -> tuple[NDArray[np.int64], Array]:
    """Values of the four active basis functions, or of a derivative (0 to 3) with respect to u.

    Args:
        knots: from `clamped_knots`. u: material coordinates [m], shape (m,).

    Returns:
        First active control point, shape (m,), and values [1/m^derivative], shape (m, 4).
    """
    span, xi = locate(knots, u)
    coefficients = span_polynomials(knots, derivative)[span]
    values = np.zeros(coefficients.shape[:-1])
    for power in range(coefficients.shape[-1] - 1, -1, -1):
        values = values * xi[:, None] + coefficients[..., power]
    return span, values


def evaluate(control_points: Array, knots: Array, u: ArrayLike, derivative: int = 0) -> Array:
    """Curve, or a derivative, at material coordinates u: sum_i b_i(u) q_i, shape (m, columns)."""
    first, values = active_basis(knots, u, derivative)
    columns = first[:, None] + np.arange(ACTIVE)
    return np.einsum("mk,mkd->md", values, np.asarray(control_points)[columns])


def greville(knots: Array) -> Array:
    """Greville abscissae [m], shape (n,): sum_i b_i(u) g_i = u, so they place a straight cable."""
    n = len(knots) - DEGREE - 1
    return np.array([knots[i + 1 : i + 1 + DEGREE].mean() for i in range(n)])


def interpolate(knots: Array, values: Array) -> Array:
    """Control points of the spline that passes through `values` at the Greville abscissae."""
    matrix = evaluate(np.eye(len(values)), knots, greville(knots))
    return elimination.solve(matrix, values, DEGREE)[0]
