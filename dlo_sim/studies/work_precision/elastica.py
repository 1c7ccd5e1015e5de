"""Heavy elastica: the static shape of a cable in a plane, by shooting; no spline in it.

In the plane, with slope angle th, moment M and internal force (H, V) along rest length s,
    x' = c cos th, z' = c sin th, th' = M / EI, M' = c (H sin th - V cos th), V' = w,
with the stretch c = 1 + (H cos th + V sin th) / EA (Antman, Nonlinear Problems of Elasticity, 2005,
ch. 4, without shear). There the bending energy is EI th'^2 / 2; the simulator's curvature is per
deformed length, th' / c, so that M = EI th' / c^2 and
    th' = M c^2 / EI,   c = (1 + (H cos th + V sin th) / EA) / (1 - M^2 / (EI EA)).
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace
from functools import cache

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]
Residual = Callable[[Array, Array], Array]  # of the states at the far end and the unknowns
STEPS = (150, 1200)  # Runge-Kutta steps along the cable: roughly, finely
TOLERANCE = 1e-11


@dataclass(frozen=True)
class Rod:
    """EI [N m^2], EA [N], weight per rest length w [N/m], and whether curvature is per deformed
    length, as in the simulator."""

    bending: float
    axial: float
    weight: float
    deformed: bool = False


@cache
def wire_sag(rod: Rod, length: float, spring: float) -> float:
    """Sag [m] of the middle of a wire pinned on springs along it, k = `spring` [N/m] at each end.

    From the middle, th = V = 0, to the end, M = 0 and x = L / 2 - H / k.
    """

    def residual(end: Array, unknown: Array) -> Array:
        return np.stack((end[3], end[0] - 0.5 * length + unknown[1] / spring))

    # A parabola between springs: H = k w^2 L^3 / (48 H^2) along the cable, twice.
    pull = (spring * rod.weight**2 * length**3 / 48.0) ** (1.0 / 3.0)
    guess = np.array([rod.bending * rod.weight / pull, pull])
    return float(_solved(rod, 0.5 * length, _from_middle, residual, guess)[1][1])


@cache
def clamped_sag(rod: Rod, length: float, gap: float) -> float:
    """Sag [m] of the middle of a cable clamped along x at both ends, which are `gap` [m] apart.

    From the middle, th = V = 0, to the end, th = 0 and x = gap / 2.
    """

    def residual(end: Array, unknown: Array) -> Array:
        return np.stack((end[2], end[0] - 0.5 * gap))

    # Newton's method needs a close start: for many pulls, the moment by bisection (a catenary bends
    # more in its middle, a straight cable less), then the pull whose gap is nearest.
    pulls = rod.weight * length * np.geomspace(0.02, 5.0, 120)
    low, high = np.zeros_like(pulls), rod.bending * rod.weight / pulls
    for _ in range(40):
        tried = np.stack((0.5 * (low + high), pulls))
        ends = _integrated(rod, 0.5 * length, *_from_middle(tried), 100)
        low, high = np.where(ends[2] < 0.0, (tried[0], high), (low, tried[0]))
    off = np.abs(ends[0] - 0.5 * gap) + length * np.abs(ends[2])
    guess = tried[:, int(np.argmin(off))]
    return float(_solved(rod, 0.5 * length, _from_middle, residual, guess)[1][1])


@cache
def cantilever_tip(rod: Rod, length: float) -> tuple[float, float]:
    """Tip (x, z) [m] of a cable clamped along x at the origin; z < 0.

    From the clamp, th = 0, V = -w L, to the tip, M = 0; the weight is put on bit by bit.
    """
    unknown = np.array([-0.05 * rod.weight * length**2])
    for share in np.linspace(0.1, 1.0, 8):
        part = replace(rod, weight=float(share) * rod.weight)

        def start(unknown: Array, load: float = part.weight * length) -> tuple[Array, Array]:
            rows = np.zeros((5, unknown.shape[1]))
            rows[3], rows[4] = unknown[0], -load
            return rows, np.zeros(unknown.shape[1])

        unknown, end = _solved(part, length, start, lambda end, unknown: end[3:4], unknown)
    return float(end[0]), float(end[1])


def _from_middle(unknown: Array) -> tuple[Array, Array]:
    """States at the middle of a symmetric cable and pulls, for columns of unknowns M, H."""
    rows = np.zeros((5, unknown.shape[1]))
    rows[3] = unknown[0]
    return rows, unknown[1]


def _solved(
    rod: Rod,
    length: float,
    start: Callable[[Array], tuple[Array, Array]],
    residual: Residual,
    unknown: Array,
) -> tuple[Array, Array]:
    """Newton's method with differences: the unknowns, and the state at the far end.

    Raises:
        RuntimeError: no convergence.
    """
    for steps in STEPS:
        for _ in range(60):
            change = 1e-6 * np.abs(unknown)
            columns = np.column_stack((unknown, unknown[:, None] + np.diag(change)))
            values = residual(_integrated(rod, length, *start(columns), steps), columns)
            slope = (values[:, 1:] - values[:, :1]) / change
            move = -np.linalg.solve(slope, values[:, 0])
            # The full move, or the largest of its halves that brings the residual down.
            tries = unknown[:, None] + move[:, None] * 0.5 ** np.arange(30.0)
            tried = residual(_integrated(rod, length, *start(tries), steps), tries)
            size, before = np.linalg.norm(tried, axis=0), np.linalg.norm(values[:, 0])
            better = np.flatnonzero(size < before)
            if len(better) == 0:
                break  # at round-off
            unknown = tries[:, better[0]]
            if float(np.max(np.abs(move) / np.abs(unknown))) < TOLERANCE:
                break
        if not before < 1e-6:
            raise RuntimeError(f"the elastica's shooting did not converge: {before}")
    return unknown, _integrated(rod, length, *start(unknown[:, None]), STEPS[-1])[:, 0]


def _integrated(rod: Rod, length: float, state: Array, pull: Array, steps: int) -> Array:
    """Classical Runge-Kutta over the length, columns at once; state x, z, th, M, V."""

    def slope(y: Array) -> Array:
        cos, sin = np.cos(y[2]), np.sin(y[2])
        stretch = 1.0 + (pull * cos + y[4] * sin) / rod.axial
        turn = y[3] / rod.bending
        if rod.deformed:
            stretch = stretch / (1.0 - y[3] ** 2 / (rod.bending * rod.axial))
            turn = turn * stretch**2
        moment = stretch * (pull * sin - y[4] * cos)
        return np.stack((stretch * cos, stretch * sin, turn, moment, 0.0 * cos + rod.weight))

    h = length / steps
    for _ in range(steps):
        k1 = slope(state)
        k2 = slope(state + 0.5 * h * k1)
        k3 = slope(state + 0.5 * h * k2)
        k4 = slope(state + h * k3)
        state = state + h / 6.0 * (k1 + 2.0 * k2 + 2.0 * k3 + k4)
    return state
