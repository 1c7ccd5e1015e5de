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
from dataclasses import dataclass
from functools import cache

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]
ROUGH, FINE = 150, 1200  # Runge-Kutta steps along the cable
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

    def residual(end: Array, unknown: Array, weight: float) -> Array:
        return np.array([end[3], end[0] - 0.5 * length + unknown[1] / spring])

    # A parabola between springs: H = k w^2 L^3 / (48 H^2) along the cable, twice.
    pull = (spring * rod.weight**2 * length**3 / 48.0) ** (1.0 / 3.0)
    guess = np.array([rod.bending * rod.weight / pull, pull])
    end = _solve(rod, 0.5 * length, residual, guess, _from_middle, [1.0])
    return float(end[1])


@cache
def clamped_sag(rod: Rod, length: float, gap: float) -> float:
    """Sag [m] of the middle of a cable clamped along x at both ends, which are `gap` [m] apart.

    From the middle, th = V = 0, to the end, th = 0 and x = gap / 2.
    """

    def residual(end: Array, unknown: Array, share: float) -> Array:
        return np.array([end[2], end[0] - 0.5 * gap])

    # Newton's method needs a close start: for many pulls, the moment by bisection (a catenary bends
    # more in its middle, a straight cable less), then the pull whose gap is nearest.
    pulls = rod.weight * length * np.geomspace(0.02, 5.0, 120)
    low, high = np.zeros_like(pulls), rod.bending * rod.weight / pulls
    for _ in range(40):
        tried = np.stack((0.5 * (low + high), pulls))
        ends = _integrated(rod, rod.weight, 0.5 * length, _from_middle(tried, 1.0), pulls, 100)
        low, high = np.where(ends[2] < 0.0, (tried[0], high), (low, tried[0]))
    off = np.abs(ends[0] - 0.5 * gap) + length * np.abs(ends[2])
    guess = tried[:, int(np.argmin(off))]
    end = _solve(rod, 0.5 * length, residual, guess, _from_middle, [1.0])
    return float(end[1])


@cache
def cantilever_tip(rod: Rod, length: float) -> tuple[float, float]:
    """Tip (x, z) [m] of a cable clamped along x at the origin; z < 0.

    From the clamp, th = 0, V = -w L, to the tip, M = 0; the weight is put on bit by bit.
    """

    def start(unknown: Array, share: float) -> Array:
        rows = np.zeros((5, unknown.shape[1]))
        rows[3] = unknown[0]
        rows[4] = -share * rod.weight * length
        return rows

    def residual(end: Array, unknown: Array, share: float) -> Array:
        return end[3:4]

    guess = np.array([-0.05 * rod.weight * length**2])
    shares = list(np.linspace(0.1, 1.0, 8))
    end = _solve(rod, length, residual, guess, start, shares, pulled=False)
    return float(end[0]), float(end[1])


def _from_middle(unknown: Array, share: float) -> Array:
    """State at the middle of a symmetric cable; unknown rows: M, H."""
    rows = np.zeros((5, unknown.shape[1]))
    rows[3] = unknown[0]
    return rows


def _solve(
    rod: Rod,
    length: float,
    residual: Callable[[Array, Array, float], Array],
    guess: Array,
    start: Callable[[Array, float], Array],
    shares: list[float],
    pulled: bool = True,
) -> Array:
    """Newton's method with differences, through the shares in turn; the state at the far end.

    Raises:
        RuntimeError: no convergence.
    """
    unknown = guess.copy()

    def shot(trial: Array, share: float, steps: int) -> tuple[Array, Array]:
        """Far ends and residuals for columns of unknowns."""
        weight = rod.weight if pulled else share * rod.weight
        pull = trial[1] if pulled else np.zeros(trial.shape[1])
        ends = _integrated(rod, weight, length, start(trial, share), pull, steps)
        columns = [residual(end, k, share) for end, k in zip(ends.T, trial.T, strict=True)]
        return ends, np.stack(columns, axis=1)

    for steps, share in [*((ROUGH, s) for s in shares), (FINE, shares[-1])]:
        for _ in range(60):
            change = 1e-6 * np.abs(unknown)
            columns = np.column_stack((unknown, unknown[:, None] + np.diag(change)))
            _, values = shot(columns, share, steps)
            slope = (values[:, 1:] - values[:, :1]) / change
            move = -np.linalg.solve(slope, values[:, 0])
            # The full move, or the largest of its halves that brings the residual down.
            halves = 0.5 ** np.arange(30.0)
            ends, tried = shot(unknown[:, None] + move[:, None] * halves, share, steps)
            size = np.linalg.norm(tried, axis=0)
            better = np.flatnonzero(size < np.linalg.norm(values[:, 0]))
            if len(better) == 0:
                break  # at round-off
            best = int(better[0])
            unknown = unknown + halves[best] * move
            if float(np.max(np.abs(move) / np.abs(unknown))) < TOLERANCE:
                break
        if not np.max(np.abs(values[:, 0])) < 1e-6:
            raise RuntimeError(f"the elastica's shooting did not converge: {values[:, 0]}")
    end: Array = shot(unknown[:, None], shares[-1], FINE)[0][:, 0]
    return end


def _integrated(
    rod: Rod, weight: float, length: float, state: Array, pull: Array, steps: int
) -> Array:
    """Classical Runge-Kutta over the length, columns at once; state x, z, th, M, V."""

    def slope(y: Array) -> Array:
        cos, sin = np.cos(y[2]), np.sin(y[2])
        stretch = 1.0 + (pull * cos + y[4] * sin) / rod.axial
        turn = y[3] / rod.bending
        if rod.deformed:
            stretch = stretch / (1.0 - y[3] ** 2 / (rod.bending * rod.axial))
            turn = turn * stretch**2
        return np.stack(
            (
                stretch * cos,
                stretch * sin,
                turn,
                stretch * (pull * sin - y[4] * cos),
                np.full_like(cos, weight),
            )
        )

    h = length / steps
    for _ in range(steps):
        k1 = slope(state)
        k2 = slope(state + 0.5 * h * k1)
        k3 = slope(state + 0.5 * h * k2)
        k4 = slope(state + h * k3)
        state = state + h / 6.0 * (k1 + 2.0 * k2 + 2.0 * k3 + k4)
    return state
