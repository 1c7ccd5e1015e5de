"""Buckling of a straight cable: what lets it leave the line, and what a model cannot show of it.

Where a cable is exactly straight, nothing has a component across it, and it stays straight for
ever, however large the compression. A real one leaves the line as soon as the compression exceeds
what the straight shape bears (Euler). So the dynamics look at a straight cable at fixed steps,
whatever part of a run they belong to: at the same steps in a node, a replay and after a restart.
Where it is compressed and its stiffness has a direction of negative curvature, all control points
get velocities across the line, of fixed random directions: so small that they move the cable by
PUSH of the accuracy asked for in the time in which the fastest mode grows e-fold, and without
momentum, so that they do not show in the reactions. Their energy counts as work of the loads. A
cable that bears its compression, or is not straight, is left alone.

Under torsion a straight cable coils, which only twist that acts on the shape shows; for other
models of twist there is a warning.
"""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from dlo_sim.core import bspline, mass
from dlo_sim.engine.arrays import ANY_STRETCH, BISHOP, TORSION
from dlo_sim.scene.description import Scene
from dlo_sim.simulation.cable import Cable

Array = NDArray[np.float64]
LOOK = 2e-3  # [s] between two looks at least
BENT = 1e-3  # of the length, distance of the middle from the line beyond which none will be soon
STRAIGHT = 1e-9  # of the length, distance from the line that counts as none
PUSH = 0.05  # of the accuracy asked for: how far the push goes before it grows


def steps_between_looks(step: float, multiple: int) -> int:
    """Steps between two looks, a multiple of `multiple`."""
    return max(1, round(LOOK / (step * multiple))) * multiple


def is_bent(cable: Cable) -> bool:
    """Whether the middle of a cable is far from the line between its ends."""
    x = cable.x
    n = cable.model.n
    chord, way = x[:, n - 1] - x[:, 0], x[:, n // 2] - x[:, 0]
    lines = range(len(cable.model.axes))
    along = sum(chord[k] * way[k] for k in lines)
    square, reach = sum(chord[k] ** 2 for k in lines), sum(way[k] ** 2 for k in lines)
    return bool(reach * square - along * along > (BENT * cable.model.knots[-1]) ** 2 * square)


def release_from_line(cable: Cable, scene: Scene) -> bool:
    """Push a straight cable that does not bear its compression off its line; whether it did."""
    if is_bent(cable):
        return False
    model = cable.model
    dim = len(model.axes)
    x = cable.x[:dim]
    length = model.knots[-1]
    chord = x[:, -1] - x[:, 0]
    span = math.hypot(*chord)
    if span < 0.1 * length or not model.has(ANY_STRETCH):
        return False
    along = chord / span
    middle = x[:, model.n // 2] - x[:, 0]
    if np.abs(_across(middle, along)).max() > STRAIGHT * length:
        return False  # at first only one point, which costs the least
    way = x - x[:, :1]
    if np.abs(_across(way, along)).max() > STRAIGHT * length:
        return False
    rate = _growth(cable, scene.cable.mu, np.einsum("d,dn->n", along, way))
    if rate == 0.0 or not _unstable(cable):
        return False
    push = np.zeros_like(cable.x)
    push[:dim] = np.random.default_rng(0).standard_normal((dim, model.n))
    push[:dim] = _across(push[:dim], along)
    push = _without_momentum(cable, cable.free_acceleration(push))
    largest = np.abs(push[:dim]).max()
    if largest == 0.0:
        return False
    before = cable.kinetic()
    cable.w[:dim] += PUSH * scene.accuracy.target * rate / largest * push[:dim]
    cable.account.load_work += cable.kinetic() - before
    return True


def _across(vectors: Array, along: Array) -> Array:
    """Vectors (dim,) or (dim, n) less their parts in a unit direction (dim,)."""
    return vectors - np.multiply.outer(along, np.einsum("d...,d->...", vectors, along))


def _without_momentum(cable: Cable, push: Array) -> Array:
    """Free velocities (lines, n) less those of a uniform force that has their momentum."""
    share = mass.multiply(cable.model.mass(0), np.ones(cable.model.n))
    for line in range(len(cable.model.axes)):
        uniform = np.zeros_like(push)
        uniform[line] = share
        uniform = cable.free_acceleration(uniform)
        carried = float((share * uniform[line]).sum())
        if carried > 0.0:
            push = push - float((share * push[line]).sum()) / carried * uniform
    return push


def _growth(cable: Cable, density: float, places: Array) -> float:
    """Rate [1/s] at which the fastest mode of a compressed straight cable grows; 0 under tension.

    A mode with wave number k grows with rate^2 = (P k^2 - EI k^4) / mu, fastest for k^2 = P / 2 EI;
    the spline resolves k up to pi / span. P is the compression of the shortest edge.
    """
    model = cable.model
    rest = (model.knots[4:-1] - model.knots[1:-4]) / 3.0
    shortest = float(np.min(np.diff(places) / rest))
    if shortest >= 1.0 - 1e-12:
        return 0.0
    force = model.axial_stiffness * (1.0 - shortest)
    finest = np.pi * (model.n - bspline.DEGREE) / float(model.knots[-1])
    square = min(force / (2.0 * float(model.bending_stiffness.max()) + 1e-300), finest**2)
    return float(np.sqrt(0.5 * force * square / density))


def _unstable(cable: Cable) -> bool:
    """Whether the stiffness of what is free has a negative eigenvalue."""
    cable.stiffness()
    if cable.loads.size and cable.loads[:, 3:6].any():
        cable.add_moment_stiffness()
    unknowns = np.zeros(cable.model.n * len(cable.model.axes))
    return cable.solve_held(unknowns) > 0


def coiling_warning(scene: Scene, cable: Cable) -> str:
    """One line if the twisting moment exceeds the buckling moment of a straight cable, else empty.

    A straight cable of length L without tension coils under a moment of 2 pi EI / L (Greenhill
    1883, ends free to turn); tension T raises it to 2 sqrt(EI (T + (pi / L)^2 EI)). The moment is
    GJ times the mean of theta'. T is EA times the strain of the chord, zero for a slack cable.
    Always empty if twist acts on the shape.
    """
    model, material = cable.model, scene.cable
    if not model.twist or model.has(TORSION) or model.has(BISHOP):
        return ""
    theta, points = cable.x[-1], cable.x[:-1]
    moment = abs(theta[-1] - theta[0]) * material.GJ / material.length
    stretched = math.dist(points[:, 0], points[:, -1]) / material.length
    tension = material.EA * max(stretched - 1.0, 0.0)
    limit = 2.0 * math.sqrt(
        material.EI * (tension + (math.pi / material.length) ** 2 * material.EI)
    )
    if moment <= limit:
        return ""
    return (
        f"twisting moment of {moment:.3g} N m: a straight cable would coil from {limit:.3g} N m, "
        f"which only twist that acts on the shape shows; set terms.twist to auto, or turn the ends "
        f"less"
    )
