"""Heavy elastica: planar static shape of a cable by collocation, independent of the simulator.

In the plane, with slope angle th, moment M and internal force (H, V) along rest length s,
    x' = c cos th, z' = c sin th, th' = M / EI, M' = c (H sin th - V cos th), V' = w,
with the stretch c = 1 + (H cos th + V sin th) / EA (Antman, Nonlinear Problems of Elasticity, 2005,
ch. 4, without shear). This has the bending energy EI th'^2 / 2. The simulator's curvature is per
deformed length, th' / c, so that M = EI th' / c^2 and
    th' = M c^2 / EI,   c = (1 + (H cos th + V sin th) / EA) / (1 - M^2 / (EI EA)).
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from functools import cache

import numpy as np
from scipy.integrate import solve_bvp

from dlo_sim.studies.runs import Array

# Boundary residuals as a function of (x, z, th, M) at both ends and the horizontal force H.
Ends = Callable[[Array, Array, Array], list[float]]
TOLERANCE, MOST_NODES = 1e-10, 20_000


@dataclass(frozen=True)
class Rod:
    """EI [N m^2], EA [N], weight per rest length w [N/m], and whether curvature is per deformed
    length, as in the simulator."""

    bending: float
    axial: float
    weight: float
    deformed: bool = False


@cache
def sag(rod: Rod, length: float, gap: float, spring: float = np.inf) -> float:
    """Sag [m] of the middle of a cable with a distance `gap` [m] of its ends, clamped along x; or
    pinned on springs k = `spring` [N/m] along x, at rest at that distance.

    From the middle, th = V = 0, to the end, x = gap / 2 - H / k, and th = 0 or M = 0.
    """
    free = 2 if spring == np.inf else 3  # which of x, z, th, M is zero

    def ends(middle: Array, end: Array, pull: Array) -> list[float]:
        return [*middle[:3], end[free], end[0] - 0.5 * gap + pull[0] / spring]

    return float(_solved(rod, 0.5 * length, 0.0, ends)[1])


@cache
def cantilever_tip(rod: Rod, length: float) -> tuple[float, float]:
    """Tip (x, z) [m] of a cable clamped along x at the origin; z < 0.

    From the clamp, th = 0, V = -w L, to the tip, M = H = 0.
    """

    def ends(clamp: Array, tip: Array, pull: Array) -> list[float]:
        return [*clamp[:3], tip[3], pull[0]]

    x, z, *_ = _solved(rod, length, -rod.weight * length, ends).tolist()
    return x, z


def _solved(rod: Rod, length: float, shear: float, ends: Ends) -> Array:
    """x, z, th, M at the far end of a cable with V = `shear` at the near end.

    Raises:
        RuntimeError: no convergence.
    """

    def slopes(s: Array, y: Array, pull: Array) -> Array:
        _, _, angle, moment = y
        cos, sin, cross = np.cos(angle), np.sin(angle), shear + rod.weight * s
        stretch = 1.0 + (pull[0] * cos + cross * sin) / rod.axial
        turn = moment / rod.bending
        if rod.deformed:
            stretch = stretch / (1.0 - moment * turn / rod.axial)
            turn = turn * stretch**2
        bend = stretch * (pull[0] * sin - cross * cos)
        return np.stack((stretch * cos, stretch * sin, turn, bend))

    s = np.linspace(0.0, length, 50)
    bow = np.stack((s, s**2, s, np.full_like(s, rod.bending)))  # initial guess, slightly bent
    guess = [0.01 * rod.weight * length]
    found = solve_bvp(slopes, ends, s, bow, guess, tol=TOLERANCE, max_nodes=MOST_NODES)
    if not found.success:
        raise RuntimeError(f"the elastica did not converge: {found.message}")
    return np.asarray(found.y[:, -1])
