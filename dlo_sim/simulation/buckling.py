"""Buckling: what lets a cable leave the line or the plane in which it lies, and what is not shown.

Where a cable lies exactly on a line or in a plane, and nothing acts across it, it stays there for
ever, also where that is unstable: a straight cable under any compression (Euler), and a bent one
that would fall over sideways. A real one leaves as soon as it can. So the dynamics look at fixed
steps, whatever part of a run they belong to: at the same steps in a node, a replay and after a
restart. Where the stiffness has a direction of negative curvature across the line or plane, all
control points get velocities across it: so small that they move the cable by PUSH of the accuracy
asked for in the time in which the fastest mode grows e-fold, and without momentum, so that they do
not show in the reactions. Their energy counts as work of the loads.

Nothing in the scene decides to which side the cable falls. The push is a fixed function of the
material coordinate, so all discretisations of a scene fall to the same one.

Whether it is stable is asked as in the search for an equilibrium (`methods.relax_step`), with the
twist that acts on the shape. Nothing is pushed where the stiffness does not tell: of a bent cable
under moments, which are not conservative, it is not symmetric.

Nets are looked at like cables that are bent in a plane. Their rigid bodies have points beside it,
so that only those of the strands tell whether a net lies in a plane, and a mode is not kept from
moving along the plane, since bodies that turn out of it do. So a net that is unstable only within
its plane is pushed, too, which does not show.

Under torsion a straight cable coils, with twist that acts on the shape; for other models of twist
there is a warning.
"""

from __future__ import annotations

import math

import numpy as np
from numba import boolean, float64, int64
from numpy.typing import NDArray

from dlo_sim.compiling.kernels import ARRAY, ARRAY_2D, STRIDED, inline, kernel
from dlo_sim.core import mass
from dlo_sim.engine.arrays import ANY_STRETCH, BISHOP
from dlo_sim.methods import between_steps, relax_step
from dlo_sim.simulation.cable import Cable

Array = NDArray[np.float64]
PLANE_LOOKS = 256  # looks at a straight cable per look at one that is bent in a plane
BENT = 1e-3  # of the length, distance from line or plane beyond which none will be in it soon
EXACT = 1e-9  # of the length, distance from line or plane that counts as none
EXACT_NET = 1e-5  # the same of a net: bodies leave 4e-7, from the tolerance of Newton's method
PUSH = 0.05  # of the accuracy asked for, or of BENT lengths: how far it goes before it grows
SLOWEST = 0.25  # [1/s] growth that counts
ROUNDING = 1e-13  # of the largest entry of K, eigenvalue that counts as none
WAVES = 6  # of the push along the cable


def look_due(cable: Cable) -> int:
    """Every how many looks at a straight cable this one is looked at: 1 if it is nearly straight,
    PLANE_LOOKS if it is nearly plane or a net, 0 (never soon) otherwise.
    """
    lying = len(_extent(cable, BENT))
    straight = lying == 1 and cable.model.layout is None
    return 1 if straight else PLANE_LOOKS if lying < len(cable.model.axes) else 0


def release(cable: Cable) -> Array | None:
    """Push a cable that lies on a line or in a plane, where that is unstable.

    Returns:
        The projection (dim, dim) onto the directions in which it was pushed; None if it was not.
    """
    free = _across(cable)
    if free is None:
        return None
    rate = growth(cable, free)
    if rate == 0.0:
        return None
    dim = len(cable.model.axes)
    push = np.zeros_like(cable.x)
    push[:dim] = np.einsum("de,en->dn", free, _pattern(cable))
    push = _without_momentum(cable, cable.free_acceleration(push))
    largest = np.abs(push[:dim]).max()
    if largest == 0.0:
        return None
    before = cable.kinetic()
    way = PUSH * min(cable.model.scene.accuracy.target, BENT * float(cable.model.knots[-1]))
    cable.w[:dim] += way * rate / largest * push[:dim]
    cable.account.load_work += cable.kinetic() - before
    return free


def side_note(cable: Cable, since: float, free: Array) -> str:
    """One line if a cable that could fall to either side at a time [s] has left its line or plane.

    Args:
        free: projection (3, 3) onto the directions across it.
    """
    away = np.einsum("de,ne->nd", free, cable.points[:, :3] - cable.points[0, :3])
    if np.abs(away).max() <= cable.model.scene.accuracy.target:
        return ""
    return (
        f"the cable left at {since:.3g} s the line or plane in which everything lay, and the scene "
        "leaves open to which side; finer runs fall to the same one"
    )


def plane_warning(cable: Cable) -> str:
    """One line if a cable, in space as terms.out_of_plane off keeps it in its plane, would leave
    that, else empty.
    """
    free = _across(cable)
    if free is None or not growth(cable, free):
        return ""
    return (
        "terms.out_of_plane: off, so the cable stays in its plane, where this shape is unstable: "
        "in space it would fall over sideways; set it to auto"
    )


@inline
def extending(x: Array, lines: int, least: float, found: Array) -> int:
    """Number of orthonormal directions in which five control points extend by more than `least`
    [m], and these into the rows of `found`; x: lines of control points.
    """
    n = x.shape[1]
    ways = np.empty((4, 3))
    for row, k in enumerate((n // 4, n // 2, 3 * n // 4, n - 1)):
        for axis in range(lines):
            ways[row, axis] = x[axis, k] - x[axis, 0]
    for count in range(lines):
        largest, farthest = 0.0, 0
        for row in range(4):
            square = 0.0
            for axis in range(lines):
                square += ways[row, axis] ** 2
            if square > largest:
                largest, farthest = square, row
        size = np.sqrt(largest)
        if size <= least:
            return count
        for axis in range(lines):
            found[count, axis] = ways[farthest, axis] / size
        for row in range(4):
            reach = 0.0
            for axis in range(lines):
                reach += ways[row, axis] * found[count, axis]
            for axis in range(lines):
                ways[row, axis] -= reach * found[count, axis]
    return lines


@kernel(int64, STRIDED, int64, float64, ARRAY_2D)
def extent(x: Array, lines: int, least: float, found: Array) -> int:
    """`extending`."""
    return extending(x, lines, least, found)


@kernel(int64, STRIDED, int64, float64, ARRAY, boolean, ARRAY_2D)
def lies_in(x: Array, lines: int, least: float, knots: Array, pressed: bool, free: Array) -> int:
    """1 if all control points lie on a line, somewhere compressed, 2 if in a plane, to `least` [m],
    and the projection onto the directions across it into `free`, else 0. `pressed`: whether it may
    be unstable although no span is compressed. In compiled code it takes 1 us, not 30, at every
    look at a straight cable.
    """
    within = np.empty((3, 3))
    count = extending(x, lines, least, within)
    if count == 0 or count == lines:
        return 0
    for a in range(lines):
        for b in range(lines):
            free[a, b] = 1.0 if a == b else 0.0
            for k in range(count):
                free[a, b] -= within[k, a] * within[k, b]
    compressed = pressed or count > 1
    for i in range(1, x.shape[1]):
        edge = 0.0
        for a in range(lines):
            away = 0.0
            for b in range(lines):
                away += free[a, b] * (x[b, i] - x[b, 0])
            if not abs(away) <= least:
                return 0
            edge += within[0, a] * (x[a, i] - x[a, i - 1])
        if not compressed:  # of a net there are no such knots
            compressed = 3.0 * abs(edge) < (1.0 - 1e-12) * (knots[i + 3] - knots[i])
    return count if compressed else 0


def _extent(cable: Cable, tolerance: float) -> Array:
    """Directions in which a cable extends by more than a tolerance [of the length], rows."""
    dim, found = len(cable.model.axes), np.empty((3, 3))
    least = tolerance * float(cable.model.knots[-1])
    return found[: extent(_lying(cable), dim, least, found), :dim]


def _lying(cable: Cable) -> Array:
    """Lines of the control points that lie in a plane with the cable: not those of bodies alone."""
    if cable.model.layout is None:
        return cable.x
    return np.concatenate([cable.x[:, part.here] for part in cable.model.parts], axis=1)


def _across(cable: Cable) -> Array | None:
    """Projection (dim, dim) onto the directions across the line or plane in which all control
    points lie; None if there is none, if its stability is not known, or if the cable is straight,
    nowhere compressed, and not twisted by Greenhill's moment of one that is hinged, 2 pi EI / L.
    """
    dim, knots = len(cable.model.axes), cable.model.knots
    if not cable.model.has(ANY_STRETCH):
        return None
    free = np.empty((dim, dim))
    tension = cable.arrays.state.tension  # of a cable of constant length, which does not shorten
    pressed = bool(cable.arrays.physics.keeps_length and np.min(tension) < 0.0)
    pressed = pressed or cable.model.layout is not None  # by its bodies, or branches
    if cable.model.has(BISHOP):
        rod = cable.model.scene.cable
        pressed = pressed or float(np.ptp(cable.x[dim])) * rod.GJ > 2.0 * math.pi * rod.EI
    least = (EXACT if cable.model.layout is None else EXACT_NET) * float(knots[-1])
    lying = lies_in(_lying(cable), dim, least, knots, pressed, free)
    moments = lying == 2 and cable.loads.size and cable.loads[:, 3:6].any()
    return None if lying == 0 or moments else free


def _pattern(cable: Cable) -> Array:
    """Forces (dim, n) of the accelerations sum_k sin(k pi u / L + 0.7 axis + 0.4) / k, along every
    axis: without symmetry, and strong in the long waves, which compression excites first.
    """
    share = np.pi * cable.model.shares
    for body in cable.model.bodies:  # which moves as one
        length = next(one.length for one in cable.model.parts if one.name == body.strand)
        share[body.points] = np.pi * body.u / length
    inertia = cable.model.mass(0)
    waves, none = range(1, WAVES + 1), np.zeros(cable.model.n)
    fields = (
        sum((np.sin(k * share + 0.7 * axis + 0.4) / k for k in waves), none)
        for axis in cable.model.axes
    )
    return np.stack([mass.multiply(inertia, field) for field in fields])


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


def growth(cable: Cable, free: Array) -> float:
    """Rate [1/s], within a factor of 1.5, at which the fastest mode across grows; 0 if none does.

    Args:
        free: projection (dim, dim) onto the directions across the line or plane.
    """
    band = cable.stiffness(moments=True).copy()
    if cable.call(between_steps.solve_held, np.zeros((1, len(band))), False) == 0:
        return 0.0  # stable in all directions, which costs the least to know
    largest = float(np.abs(band).max() / cable.model.mass(0).max())
    rate, guide = max(SLOWEST, math.sqrt(ROUNDING * largest)), largest * (np.eye(len(free)) - free)
    if cable.model.layout is not None:  # its bodies turn out of the plane by moving points along it
        guide = np.zeros_like(guide)
    if not grows(cable, guide, rate):
        return 0.0
    while grows(cable, guide, 2.0 * rate):
        rate *= 2.0
    return math.sqrt(2.0) * rate


def grows(cable: Cable, guide: Array, rate: float) -> bool:
    """Whether a mode grows faster than with a rate r [1/s]: K + r^2 M has a negative eigenvalue,
    with the twist that acts on the shape.

    Args:
        guide: stiffness (dim, dim) in M [1/s^2], which holds motions within the line or plane.
    """
    length, twist = float(cable.model.knots[-1]), cable.model.has(BISHOP)
    given = guide, cable.padded(cable.x), cable.anchors, length, twist, False
    return not cable.call(relax_step.is_stable, 1.0 / rate**2, *given)
