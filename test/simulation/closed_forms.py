"""Closed forms, the heavy elastica by collocation, and conservation laws: exact results that share
no code with the simulator."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from functools import cache

import numpy as np
from numpy.typing import NDArray
from scipy.integrate import solve_bvp
from scipy.optimize import brentq
from scipy.special import ellipe, ellipk

from dlo_sim.core import bspline, quadrature
from dlo_sim.scene.description import Scene
from dlo_sim.simulation.simulator import Simulator

Array = NDArray[np.float64]


def string_deflection(force: float, stiffness: float, length: float, bending: float = 0.0) -> float:
    """Deflection [m] of the middle of an elastic string, initially straight and stress-free.

    P = 2 EA (1 / cos a - 1) sin a with the slope a of its two straight halves. Bending stiffness
    EI rounds the kink over the length l = sqrt(EI / T) and reduces the deflection by the share
    2 l / L, to first order in l / L (a beam under a large tension T).
    """

    def tension(angle: float) -> float:
        return stiffness * (1.0 / np.cos(angle) - 1.0)

    angle = brentq(
        lambda angle: 2.0 * tension(angle) * np.sin(angle) - force,
        *(0.0, 0.5 * np.pi - 1e-9),
        xtol=1e-15,
    )
    rounding = 2.0 / length * np.sqrt(bending / tension(angle))
    return float(0.5 * length * np.tan(angle) * (1.0 - rounding))


def euler_load(scene: Scene) -> float:
    """Buckling load EI pi^2 / L^2 [N] of a column pinned at both ends."""
    return scene.cable.EI * np.pi**2 / scene.cable.length**2


def elastica_gap(share: float) -> float:
    """Distance of the ends of a buckled pinned column as a share of its length.

    Args:
        share: P / Pc > 1. With k = sin(a / 2) for the slope a at the ends, P / Pc = (2 K(k) / pi)^2
            and gap / L = 2 E(k) / K(k) - 1, K and E the complete elliptic integrals.

    Source: Timoshenko & Gere, Theory of Elastic Stability, 1961, section 2.7.
    """
    square = brentq(lambda m: (2.0 * ellipk(m) / np.pi) ** 2 - share, 0.0, 1.0 - 1e-12)
    return float(2.0 * ellipe(square) / ellipk(square) - 1.0)


def momenta(simulator: Simulator) -> tuple[Array, Array]:
    """Momentum [kg m/s] and angular momentum about the origin [kg m^2/s] of the cable itself."""
    scene, knots = simulator.scene, simulator.model.knots
    points, rates = simulator.control_points[:, :3], simulator.velocities[:, :3]
    weights = (knots[4:] - knots[:-4]) / 4.0
    if scene.discretization.mass == "consistent":
        rule = quadrature.gauss(bspline.breaks(knots), 4)
        used = rule.weights != 0.0
        u, weights = rule.places(bspline.breaks(knots))[used], rule.weights[used]
        points, rates = simulator.centerline(u), bspline.evaluate(rates, knots, u)
    impulse = scene.cable.mu * weights[:, None] * rates
    return impulse.sum(axis=0), np.cross(points, impulse).sum(axis=0)


def catenary(
    u: Array, length: float, span: float, weight: float, stiffness: float
) -> tuple[Array, Array]:
    """Elastic catenary between two points at the same height: x(u), z(u) [m].

    With the horizontal force H and V = w L / 2 at the left end,
        x = H u / EA + H/w (asinh(V / H) - asinh((V - w u) / H))
        z = - u (V - w u / 2) / EA - H/w (sqrt(1 + (V/H)^2) - sqrt(1 + ((V - w u) / H)^2)).

    Args:
        u: rest arc length [m]. span: distance of the ends [m], below the length. weight: w per rest
            length [N/m]. stiffness: EA [N].

    Source: Irvine, Cable Structures, 1981, section 2.3.
    """
    vertical = 0.5 * weight * length

    def reach(horizontal: float, at: Array) -> Array:
        slope = (vertical - weight * at) / horizontal
        start = np.arcsinh(vertical / horizontal)
        return np.asarray(
            horizontal * at / stiffness + horizontal / weight * (start - np.arcsinh(slope))
        )

    end, far = np.array([length]), 12.0 * np.log(10.0)
    force = vertical * np.exp(
        brentq(lambda log: reach(vertical * np.exp(log), end)[0] - span, -far, far, xtol=1e-15)
    )
    slope = (vertical - weight * u) / force
    z = -u * (vertical - 0.5 * weight * u) / stiffness - force / weight * (
        np.sqrt(1.0 + (vertical / force) ** 2) - np.sqrt(1.0 + slope**2)
    )
    return reach(force, u), z


# Boundary residuals as a function of (x, z, th, M) at both ends and the horizontal force H.
Ends = Callable[[Array, Array, Array], list[float]]
TOLERANCE, MOST_NODES = 1e-10, 20_000


@dataclass(frozen=True)
class Rod:
    """Constants of a heavy elastica: EI [N m^2], EA [N], weight per rest length w [N/m], and
    whether curvature is per deformed length, as in the simulator."""

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
def cantilever_tip(
    rod: Rod, length: float, slope: float = 0.0, load: float = 0.0
) -> tuple[float, float]:
    """Tip (x, z) [m] of a cable clamped at the origin at an angle to x, with a force along z [N].

    From the clamp, th = slope, V = F - w L, to the tip, M = H = 0.
    """

    def ends(clamp: Array, tip: Array, pull: Array) -> list[float]:
        return [clamp[0], clamp[1], clamp[2] - slope, tip[3], pull[0]]

    x, z, *_ = _solved(rod, length, load - rod.weight * length, ends).tolist()
    return x, z


def _solved(rod: Rod, length: float, shear: float, ends: Ends) -> Array:
    """x, z, th, M at the far end of a heavy elastica with V = `shear` at the near end.

    In the plane, with slope angle th, moment M and internal force (H, V) along rest length s,
        x' = c cos th, z' = c sin th, th' = M / EI, M' = c (H sin th - V cos th), V' = w,
    with the stretch c = 1 + (H cos th + V sin th) / EA. This has the bending energy EI th'^2 / 2.
    The simulator's curvature is per deformed length, th' / c, so that M = EI th' / c^2 and
        th' = M c^2 / EI,   c = (1 + (H cos th + V sin th) / EA) / (1 - M^2 / (EI EA)).

    Raises:
        RuntimeError: no convergence.

    Source: Antman, Nonlinear Problems of Elasticity, 2005, ch. 4, without shear.
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
