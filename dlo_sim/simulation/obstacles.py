"""Obstacles as numbers of `engine.contact`: cores, contact laws, samples of the cable."""

from __future__ import annotations

import math
from collections.abc import Callable
from enum import StrEnum
from functools import lru_cache
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from dlo_sim.compiling.lanes import LANES
from dlo_sim.core import bspline, elimination, mass, quadrature, rotations
from dlo_sim.core.end_motion import EndMotion
from dlo_sim.core.strain import strain
from dlo_sim.engine import contact, shapes
from dlo_sim.engine.arrays import (
    BOXED,
    CONTACT,
    MARGIN,
    MESHED,
    MOTION_SIZE,
    ROUND,
    TUBED,
)
from dlo_sim.engine.arrays import Contact as ContactArrays
from dlo_sim.engine.grasps import FRAME, POSITION
from dlo_sim.scene.description import EARTH, Obstacle, Scene
from dlo_sim.simulation.cable import Cable
from dlo_sim.simulation.meshes import Field, field_of, triangles_of
from dlo_sim.simulation.model import Model

Array = NDArray[np.float64]
Pressure = tuple[Array, Array]
"""Places on the cable as shares of its length, rising, and force per length there [N/m]; linear
between them. Those on strand number k count from 2 k on."""
UNTOUCHED: Pressure = np.zeros(1), np.zeros(1)
ROUNDED = 1e-9  # diameters of overlap that are round-off
STRETCHED = 1.1  # lengths that a cable reaches
PLACES = 101  # of the cable that are checked for being inside obstacles
MOST_PIECES = 16  # groups of LANES samples of a knot span, that bodies touch, or guides
ACROSS, AROUND = 14, 24  # points of a drawn ring, across its wire and around it
PASSES, BISECTIONS = 8, 30  # looks at a knot span for a passage, and at a passage
# Distance of samples in reaches of the smallest obstacle. A stiff cable that is drawn through a
# guide touches only a few, between which its tension ripples: by 36 % with 1.0, by 2 % with 0.1. An
# edge between two samples sinks in unseen: by 7 % of the diameter with 1.0, by 2 % with 0.55.
APART, APART_AT_EDGES, APART_IN_GUIDES = 1.0, 0.55, 0.1
DEPTH = 1e-3  # penetration of a cable into an obstacle under its weight on earth, in diameters
PULLED_DEPTH = 0.02  # of a cable that is drawn round an obstacle
LANDING, LANDED_DEPTH = 2.0, 0.02  # [m/s], as after a fall by 0.2 m; in diameters
TIP = 40.0  # stiffness of contact at the tip, in that of the cable along itself
# Tension as usual: largest strain, force [N]; whether grippers pull the cable taut round something
# round. A band between them is stretched to four times its length.
USUAL = {False: (0.2, 50.0), True: (3.0, 100.0)}
# Penetration by the mass on a body alone of a cable thrown at inputs.max_speed, in half the
# thickness of the body. What flies on beside a small body pulls it in more than twice as deep.
THROWN_DEPTH = 0.2
TAUT = 1e-3  # strain of what is pulled as usual
OFF = 0.5  # of the radius of the cable: error of a mesh's field that is said
TOO_DEEP = 0.02  # penetration in diameters in a run above which a warning reports it
INSIDE = 0.1  # the same of overlap that decays
# Of half the thickness of a body: so deep is near its middle. Samples a reach apart can cross a
# thin body no deeper than half of it.
MIDDLE = 0.6
BRISTLES = 0.1  # stiffness of bristles, in that of the surface


GUIDES = "ring", "channel"  # shapes that a cable goes through
EDGED = "box", "mesh"  # shapes with edges

CANCELLED = 1e-9  # sum of forces, as a share of the sum of their sizes, that is round-off
ITSELF = "itself"  # the name of the cable among what it touches


class Core(NamedTuple):
    """What an obstacle is before it is grown by `reach` [m].

    Attributes:
        half: half its size by axis [m]; of a tube the radius, 0, and half the length; of a mesh
            half that of a box about its origin that contains it.
    """

    kind: int
    half: tuple[float, float, float]
    reach: float


def core_of(obstacle: Obstacle, radius: float) -> Core:
    """The core of an obstacle that a cable of this radius [m] touches."""
    x, y, z = (0.5 * size for size in obstacle.size)
    if obstacle.shape == "plane":
        return Core(shapes.HALF_SPACE, (0.0, 0.0, 0.0), radius)
    if obstacle.shape == "box":
        return Core(shapes.BOX, (x, y, z), radius)
    if obstacle.shape == "cylinder":
        return Core(shapes.CYLINDER, (x, x, z), radius)
    if obstacle.shape in GUIDES:
        length = z - y if obstacle.shape == "channel" else 0.0
        return Core(shapes.TUBE, (x + y, 0.0, length), y + radius)
    if obstacle.shape == "mesh":
        a, b, c = np.abs(triangles_of(obstacle)).max(axis=(0, 1)).tolist()
        return Core(shapes.MESH, (a, b, c), radius)
    length = max(z - x, 0.0) if obstacle.shape == "capsule" else 0.0
    return Core(shapes.BOX, (0.0, 0.0, length), x + radius)


# Bit of the code of a shape, which a plane does not need; shapes that markers bring.
_CODE = {"box": BOXED, "sphere": BOXED, "capsule": BOXED, "cylinder": ROUND, "mesh": MESHED}
_CODE |= {"ring": TUBED, "channel": TUBED}
_FROM_MARKERS = BOXED | ROUND | MESHED
SHAPES = _FROM_MARKERS | TUBED  # bits of the terms that obstacles alone decide


def terms_of(scene: Scene) -> int:
    """Bits of the shapes that the obstacles have or, from markers, may have."""
    found = _FROM_MARKERS if scene.contact.markers else 0
    for obstacle in scene.bodies:
        found |= _CODE.get(obstacle.shape, 0)
    return found


def surface(obstacle: Obstacle, plate: float = 0.0) -> Array:
    """Triangles [m] that show an obstacle, in its frame, shape (k, 3, 3); counter-clockwise seen
    from outside, of a mesh as in its file. Of a plane a square with sides `plate` [m].
    """
    if obstacle.shape == "mesh":
        return triangles_of(obstacle)
    if obstacle.shape in ("box", "plane"):
        corners = np.array(list(np.ndindex(2, 2, 2))) - 0.5
        faces = np.array(
            ((0, 1, 3, 2), (4, 6, 7, 5), (0, 4, 5, 1), (2, 3, 7, 6), (0, 2, 6, 4), (1, 5, 7, 3))
        )
        if obstacle.shape == "plane":
            corners, faces = corners * (plate, plate, 0.0), faces[-1:]
        else:
            corners = corners * obstacle.size
        return corners[faces[:, ((0, 1, 2), (2, 3, 0))].reshape(-1, 3)]
    kind, half, reach = core_of(obstacle, 0.0)
    upper = math.pi / (ACROSS // 2 - 1) * np.arange(ACROSS // 2)
    if kind == shapes.CYLINDER:
        return _revolved(np.array([0.0, half[0], half[0], 0.0]), half[2] * np.array([-1, -1, 1, 1]))
    if kind == shapes.TUBE:
        across = np.concatenate([upper, upper + math.pi])
        rho, straight = half[0] + reach * np.cos(across), np.repeat([1.0, -1.0], ACROSS // 2)
        return _revolved(rho, reach * np.sin(across) + half[2] * straight)
    rise = np.repeat([-1.0, 1.0], ACROSS // 2)
    across = np.linspace(-0.5 * math.pi, 0.5 * math.pi, len(rise))
    return _revolved(reach * np.abs(np.cos(across)), reach * np.sin(across) + half[2] * rise)


def _revolved(rho: Array, z: Array) -> Array:
    """Triangles of the surface that a closed line turns about the z axis."""
    around = 2.0 * math.pi / AROUND * np.arange(AROUND)
    turn = np.stack([np.cos(around), np.sin(around)], axis=1)
    points = np.empty((AROUND, len(rho), 3))
    points[..., :2], points[..., 2] = rho[:, None] * turn[:, None], z
    first, second = points, np.roll(points, -1, axis=0)
    up, beyond = (np.roll(one, -1, axis=1) for one in (first, second))
    halves = (np.stack(three, axis=2) for three in ((first, second, up), (second, beyond, up)))
    found = np.concatenate([half.reshape(-1, 3, 3) for half in halves])
    sides = np.cross(found[:, 1] - found[:, 0], found[:, 2] - found[:, 0])
    return found[np.linalg.norm(sides, axis=1) > 0.0]


def gaps(obstacle: Obstacle, diameter: float, points: Array) -> Array:
    """Gaps [m] between an obstacle at its place in the scene and a cable at points (..., 3)."""
    kind, half, reach = core_of(obstacle, 0.5 * diameter)
    turn = rotations.to_matrix(rotations.normalized(np.array(obstacle.orientation)))
    y = np.einsum("...i,ij->...j", points - np.array(obstacle.position), turn)
    if kind == shapes.HALF_SPACE:
        return np.asarray(y[..., 2] - reach)
    if kind == shapes.MESH:
        return field_of(obstacle, reach).distance(y) - reach
    over = np.abs(y) - np.array(half)
    if kind in (shapes.CYLINDER, shapes.TUBE):
        radial = np.hypot(y[..., 0], y[..., 1]) - half[0]
        radial = np.abs(radial) if kind == shapes.TUBE else radial
        over = np.stack((radial, over[..., 2]), axis=-1)
    outside = np.linalg.norm(np.maximum(over, 0.0), axis=-1)
    return np.asarray(outside + np.minimum(over.max(axis=-1), 0.0) - reach)


def inside(obstacle: Obstacle, diameter: float, u: Array, line: Array) -> str:
    """One line if a cable begins deeper in an obstacle than it is thick, so that it would be flung
    out; else empty.

    Args:
        line: points [m] of the cable at the material coordinates u [m], shape (len(u), 3).
    """
    depth = -gaps(obstacle, diameter, line) - 0.5 * diameter
    worst = int(np.argmax(depth))
    if depth[worst] <= diameter:
        return ""
    return (
        f"obstacles.{obstacle.name}.position: the cable begins {depth[worst]:.3g} m inside it, "
        f"at {u[worst]:.3g} m"
    )


def stiffness(scene: Scene, obstacle: Obstacle) -> float:
    """Contact force per length of cable and penetration [N/m^2]: as given, or the largest of
    mu g / (DEPTH D): its weight on earth presses the cable in by DEPTH diameters;
    T / (R PULLED_DEPTH D): the tension T that follows from the scene or is usual does so by
        PULLED_DEPTH diameters, round an edge or a body with the radius R; per rest length, a cable
        that is stretched by grippers is pressed by as much more;
    mu (v / (LANDED_DEPTH D))^2: landing at v = LANDING it gives way by LANDED_DEPTH diameters;
    TIP EA / (L r), but of rings and channels: its round tip, of the radius r, gives way by at most
        1 / TIP of what the cable gives way along itself;
    mu (v / (THROWN_DEPTH h))^2: a cable thrown at v = inputs.max_speed is not pressed through a
        body of half thickness h.
    """
    cable, radius = scene.cable, 0.5 * scene.cable.diameter
    if scene.contact.stiffness:
        return scene.contact.stiffness
    laid = cable.mu * EARTH / (DEPTH * cable.diameter)
    landed = cable.mu * (LANDING / (LANDED_DEPTH * cable.diameter)) ** 2
    pushed = TIP * cable.EA / (cable.length * radius) * (obstacle.shape not in GUIDES)
    if obstacle.shape == "plane":
        return max(laid, landed, pushed)
    _, half, reach = core_of(obstacle, radius)
    taut = held_twice(scene) and obstacle.shape not in EDGED
    usual = usual_pull(scene, taut)
    usual *= 1.0 + taut * usual / cable.EA
    pulled = max(cable.mu * EARTH * cable.length, declared_tension(scene), usual)
    bend = max(bend_radius(scene, obstacle), cable.diameter)
    drawn = pulled / (bend * PULLED_DEPTH * cable.diameter)
    thrown = cable.mu * (scene.inputs.max_speed / (THROWN_DEPTH * (min(half) + reach))) ** 2
    return max(laid, landed, pushed, drawn, thrown)


def held_twice(scene: Scene) -> bool:
    """Whether grippers may hold the cable at two places, and so can pull it taut."""
    held = [any(end.fixed) or any(end.spring) for end in scene.ends.values()]
    return sum(held) + len(scene.grasps) > 1


def usual_pull(scene: Scene, taut: bool) -> float:
    """Tension [N] with which grippers draw a cable; taut: two of them, against each other."""
    strain, force = USUAL[taut]
    return min(strain * scene.cable.EA, force)


def declared_tension(scene: Scene) -> float:
    """Tension [N] by the loads of a scene that are signals, of a sine by its amplitude, and by ends
    that are farther apart at first than the cable is long, up to a strain of TAUT.
    """
    pulls = sum(math.hypot(*load.force) for load in scene.loads if load.signal != "none")
    held = all(all(end.fixed) for end in scene.ends.values())
    apart = math.dist(scene.start.position, scene.end.position) if held else 0.0
    stretch = min(max(apart / scene.cable.length - 1.0, 0.0), TAUT)
    return float(pulls + scene.cable.EA * stretch)


def at_rest(scene: Scene, origin: Array) -> Array:
    """Places of the obstacles in the scene, relative to an origin, as motions (`engine.grasps`),
    shape (obstacles, MOTION_SIZE).
    """
    rows = np.zeros((len(scene.bodies), MOTION_SIZE))
    for row, obstacle in zip(rows, scene.bodies, strict=True):
        row[POSITION : POSITION + 3] = obstacle.position - origin
        turned = rotations.normalized(np.array(obstacle.orientation))
        row[FRAME : FRAME + 9] = rotations.to_matrix(turned).ravel()
    return rows


def leaves_plane(motion: EndMotion, axes: tuple[int, ...]) -> bool:
    """Whether a motion has a part out of the plane of these two axes."""
    across = [axis for axis in range(3) if axis not in axes]
    away = motion.position_coefficients[1:, across].any()
    return bool(across) and bool(away or motion.rotation_coefficients[:, list(axes)].any())


class Contact(NamedTuple):
    """What touches one obstacle, or the cable itself.

    Attributes:
        clearance: smallest gap between the surfaces [m], negative where the cable is pressed in.
        force: sum of the forces ON THE CABLE [N], world frame, shape (3,).
        pressure: largest force per length of cable [N/m].
        u: material coordinates of the samples that touch [m], shape (k,). points: there on the axis
            of the cable [m], shape (k, 3). forces: on the cable [N], shape (k, 3).
        passes: material coordinates [m] at which the cable, its first strand, goes through the
            middle of the opening of a ring or channel, rising; empty for other shapes.
        tensions: of the cable [N] one and a half knot spans before and behind what touches, shape
            (2,); empty if nothing does, or if its shape does not determine the tension; those of
            the first strand.
        deepest: so far in the run that the cable was pressed in [m], without overlap that decays.
            stiffness: force per length and penetration [N/m^2].
        strands: number of the strand of each of `u`, shape (k,).
    """

    clearance: float
    force: Array
    pressure: float
    u: Array
    points: Array
    forces: Array
    passes: Array
    tensions: Array
    deepest: float = 0.0
    stiffness: float = 0.0
    strands: NDArray[np.int64] = np.zeros(0, dtype=np.int64)

    @property
    def exerted(self) -> float:
        """Size of the sum of the forces [N]; `total` where they cancel but for round-off, as those
        of the cable on itself do, and those of a ring that holds it from all sides.
        """
        resultant = float(np.linalg.norm(self.force))
        return resultant if resultant > CANCELLED * self.total else self.total

    @property
    def total(self) -> float:
        """Sum of the sizes of the forces [N]."""
        return float(np.linalg.norm(self.forces, axis=1).sum())


def contact_with(cable: Cable, number: int, tension: Callable[[Array], Array] | None) -> Contact:
    """What of a cable touches an obstacle at the present configuration. Forces are
    those of pressure and bristles, with the mean force of the impulses in the last step.

    Args:
        number: of the obstacle. tension: [N] at material coordinates [m]; None = not known.
    """
    model, group = cable.model, cable.arrays.contact
    u, strands, weights, found, at = _samples(cable, number)
    touches = np.any(found[:, 1:] != 0.0, axis=1)
    forces = np.zeros((int(touches.sum()), 3))
    forces[:, list(model.axes)] = found[touches, 1 : 1 + len(model.axes)]
    own, lane = np.divmod(at[touches], LANES)
    columns = (group.first[own] - MARGIN)[:, None] + np.arange(bspline.ACTIVE)
    basis = np.asarray(group.basis)[own, :, lane]
    points = np.einsum("mk,mkd->md", basis, cable.points[columns, :3]) + model.origin
    sizes = np.linalg.norm(forces, axis=1) / weights[touches]
    main = u[touches & (strands == 0)]
    return Contact(
        clearance=float(found[:, 0].min()),
        force=forces.sum(axis=0),
        pressure=float(sizes.max(initial=0.0)),
        u=u[touches],
        points=points,
        forces=forces,
        passes=passes(cable, number),
        tensions=tensions_beside(model.knots, main, tension),
        deepest=float(cable.arrays.state.deepest[number]),
        stiffness=float(group.law[number, contact.STIFFNESS]),
        strands=strands[touches],
    )


class _Samples(NamedTuple):
    """Samples that may touch an obstacle: material coordinates [m], rising on each strand; numbers
    of the strands; weights [m]; gaps [m] and forces (`engine.contact.report`), shape (k, 4);
    numbers, LANES times the group plus the lane.
    """

    u: Array
    strands: NDArray[np.int64]
    weights: Array
    found: Array
    at: NDArray[np.int64]


def _samples(cable: Cable, number: int) -> _Samples:
    """All those of one obstacle."""
    group, branch = cable.arrays.contact, cable.arrays.mesh.branch
    reported = np.zeros((len(group.first), 4 * LANES))
    cable.call(contact.report, number, reported)
    own = slice(group.begin[number], group.end[number])
    place, weights = np.asarray(group.place)[own], np.asarray(group.weight)[own]
    there = weights != 0.0
    at = np.flatnonzero(there) + LANES * own.start
    strands = branch[group.first[at // LANES] - MARGIN]
    found = reported.reshape(-1, LANES, 4)[own][there]
    return _Samples(place[there], strands, weights[there], found, at)


def _along(cable: Cable, u: Array, strands: NDArray[np.int64]) -> Array:
    """Material coordinates [m] on strands as in `Pressure`."""
    return 2.0 * strands + u / cable.arrays.mesh.length[strands]


def pressure_by(cable: Cable, number: int) -> Pressure:
    """Pressure of an obstacle on the cable at rest in the present configuration."""
    u, strands, _, rows, at = _samples(cable, number)
    depth = np.maximum(-rows[:, 0] - _overlap(cable, number)[:, 1].ravel()[at], 0.0)
    stiff, along = cable.arrays.contact.law[number, contact.STIFFNESS], _along(cable, u, strands)
    order = np.argsort(along, kind="stable")
    return along[order], stiff * depth[order]


def _overlap(cable: Cable, number: int) -> Array:
    """`State.overlap` with an obstacle, a view of shape (groups, 3, LANES)."""
    return np.asarray(cable.arrays.state.overlap)[number]


def let_overlap(cable: Cable, number: int, kept: Pressure, let_be: float = 0.0) -> float:
    """Let an obstacle overlap the cable until it presses no place of it more than `kept`, so that
    what has changed stores no energy that would fling the cable out; returns by how much more at
    most [m].

    Args:
        let_be: pressure [N/m] up to which it may press, if the cable is SHALLOW inside.
    """
    u, strands, _, rows, at = _samples(cable, number)
    group, overlap = cable.arrays.contact, _overlap(cable, number)
    stiff, thick = group.law[number, contact.STIFFNESS], group.least_margin
    depth = -rows[:, 0] - np.interp(_along(cable, u, strands), *kept) / stiff
    least = max(min(let_be / stiff, contact.SHALLOW * thick), ROUNDED * thick)
    before = overlap[:, 1].ravel()[at]
    most = float(depth.max())
    now = most if most > least else 0.0  # everywhere, so that it grows back in its own shape
    group_, lane = np.divmod(at, LANES)
    overlap[group_, 0, lane] = overlap[group_, 1, lane] = now
    overlap[group_, 2, lane] = -rows[:, 0]
    if now > 0.0:
        cable.account.decaying = 1.0
    return float((now - before).max())


def tension_along(cable: Cable) -> Callable[[Array], Array] | None:
    """Tension [N] of the first strand by material coordinates [m], linear between the middles of
    its knot spans; None if its shape does not determine it.
    """
    scene, own, knots = cable.model.scene, cable.model.parts[0].here, cable.model.knots
    if scene.without_tension:
        return None
    ends = bspline.breaks(knots)
    middles = 0.5 * (ends[1:] + ends[:-1])
    shape, stiff = strain(knots, middles), scene.cable
    values = shape.tension(cable.points[own, :3], stiff.EA, stiff.EI)
    return lambda u: np.interp(u, middles, values)


def tensions_beside(knots: Array, u: Array, tension: Callable[[Array], Array] | None) -> Array:
    """`Contact.tensions` for samples at u that touch."""
    if tension is None or not len(u):
        return np.zeros(0)
    away = 1.5 * float(np.diff(bspline.breaks(knots)).max())
    return tension(np.clip([u.min() - away, u.max() + away], 0.0, knots[-1]))


def passes(cable: Cable, number: int) -> Array:
    """`Contact.passes` of an obstacle where it is now."""
    model, obstacle = cable.model, cable.model.scene.bodies[number]
    own, knots = model.parts[0].here, model.knots
    if obstacle.shape not in GUIDES:
        return np.zeros(0)
    opening, pose = 0.5 * obstacle.size[0], cable.arrays.state.pose[number]
    axes = [*model.axes, *({0, 1, 2} - {*model.axes})]  # as the pose has them (`contact.set_pose`)
    points = (cable.points[own, :3] - model.rest)[:, axes] - pose[9:12]

    def place(u: Array) -> Array:
        """Points of the cable in the frame of the obstacle."""
        return bspline.evaluate(points, knots, u) @ pose[:9].reshape(3, 3)

    u = np.linspace(0.0, knots[-1], PASSES * (len(points) - bspline.DEGREE) + 1)
    z = place(u)[:, 2]
    first = np.flatnonzero((z[1:] > 0.0) != (z[:-1] > 0.0))
    low, high, above = u[first], u[first + 1], z[first] > 0.0
    for _ in range(BISECTIONS):
        middle = 0.5 * (low + high)
        same = (place(middle)[:, 2] > 0.0) == above
        low, high = np.where(same, middle, low), np.where(same, high, middle)
    x, y, _ = place(low).T
    return np.asarray(low[np.hypot(x, y) < opening])


def thin_warning(model: Model) -> str:
    """One line if samples of the cable are further apart than an obstacle is thick, else empty."""
    scene, group = model.scene, model.arrays.contact
    if not model.has(CONTACT):
        return ""
    spans = model.n - bspline.DEGREE
    for obstacle in scene.bodies:
        count = group.guide_pieces if obstacle.shape in GUIDES else group.pieces
        apart = scene.cable.length / (spans * LANES * max(count, 1))
        _, half, reach = core_of(obstacle, 0.5 * scene.cable.diameter)
        if obstacle.shape != "plane" and apart > 2.0 * (min(half) + reach):
            needed = math.ceil(spans * apart / (2.0 * (min(half) + reach))) + bspline.DEGREE
            return (
                f"obstacles.{obstacle.name}: may pass between samples of the cable, which are "
                f"{apart:.3g} m apart; raise discretization.control_points to {needed} or more"
            )
    return ""


def mesh_warning(scene: Scene) -> str:
    """One line if the cable may sink into a mesh, or go through it, where its field is too coarse
    for walls or openings, else empty.
    """
    radius = 0.5 * scene.cable.diameter
    for obstacle in scene.bodies if scene.touches else ():
        if obstacle.shape != "mesh":
            continue
        field = field_of(obstacle, radius)
        if field.off > OFF * radius:
            cure = f"raise it to {field.cells(radius)}" if field.cell > radius else "raise it"
            return (
                f"obstacles.{obstacle.name}.mesh_cells: {field.cells(field.cell)} are too few for "
                "its thinnest walls and narrowest openings, where the cable may sink in by "
                f"{field.off:.3g} m or go through; {cure}, or split the mesh, or take boxes"
            )
    return ""


class Overlap(StrEnum):
    """How an obstacle came into the cable; the value is the warning that says so."""

    BEGAN = "the cable began {depth:.3g} m inside it; {yields}: move it, or the cable's ends"
    JUMPED = (
        "jumped into the cable {times}, by {depth:.3g} m at most; {yields}: move it by a motion or "
        "small steps"
    )
    CHANGED = (
        "changed parameters pressed the cable into it {times}, by {depth:.3g} m at most; {yields}: "
        "change them in small steps"
    )

    @property
    def notable(self) -> float:
        """Depth in diameters above which the warning is given: a cable may begin with its axis on
        a surface.
        """
        return 0.5 if self is Overlap.BEGAN else contact.SHALLOW


def overlap_warning(name: str, how: Overlap, count: int, depth: float) -> str:
    """One line about an obstacle that came into the cable."""
    times = "once" if count == 1 else f"{count} times"
    yields = f"it yields and pushes the cable out at {contact.RETURN:g} m/s"
    return f"obstacles.{name}: " + how.format(times=times, depth=depth, yields=yields)


def depth_warning(scene: Scene, count: float) -> str:
    """One line if samples were near the middle of an obstacle in `count` steps, else empty."""
    if not count:
        return ""
    return (
        "obstacles: the cable was pressed near the middle of one, and may have gone through it "
        f"({count:.0f} samples and steps); raise contact.stiffness, or inputs.max_speed "
        f"({scene.inputs.max_speed:g} m/s), for which it is chosen"
    )


def stiffness_needed(found: Contact, diameter: float) -> float:
    """Contact stiffness [N/m^2] with which an obstacle would not have pressed the cable in too deep
    in the run; 0 if it did not.
    """
    if found.deepest <= TOO_DEEP * diameter:
        return 0.0
    return found.stiffness * found.deepest / (0.5 * TOO_DEEP * diameter)


def press_warning(name: str, found: Contact, scene: Scene, cure: str) -> str:
    """One line if the cable is deep in an obstacle that presses it, or was in the run, else empty.
    cure: what to change (`remarks.cure`); empty if nothing helps but room.
    """
    diameter = scene.cable.diameter
    deepest, what = -found.clearance if len(found.u) else 0.0, "is"
    if deepest <= INSIDE * diameter:
        deepest, what = found.deepest, "was"
        if deepest <= TOO_DEEP * diameter:
            return ""
    cure = ", or ".join(filter(None, ("give it room", cure)))
    return (
        f"obstacles.{name}: the cable {what} pressed {deepest:.3g} m into it, "
        f"{deepest / diameter:.0%} of its diameter; {cure}"
    )


def out_of_reach(scene: Scene) -> dict[str, str]:
    """Obstacles that the cable cannot reach -> the reason, as in `Needs.left_out`."""
    if scene.is_net:
        return {}
    found = {f"obstacles.{one.name}": beyond_reach(scene, one) for one in scene.bodies}
    return {key: reason for key, reason in found.items() if reason}


def beyond_reach(scene: Scene, obstacle: Obstacle) -> str:
    """Why the cable cannot reach an obstacle from an end that holds it where it is; empty if it
    can.
    """
    for name, end in scene.ends.items():
        if end.driven or obstacle.driven or not all(end.fixed):
            continue
        gap = float(gaps(obstacle, scene.cable.diameter, np.add(end.position, end.offset)))
        if gap > STRETCHED * scene.cable.length:
            return f"{gap:.3g} m from the {name} of a cable of {scene.cable.length:.3g} m"
    return ""


def thinnest(scene: Scene) -> float:
    """Half the thickness [m] of the thinnest obstacle, with the cable's radius; infinite for planes
    alone.
    """
    cores = (core_of(one, 0.5 * scene.cable.diameter) for one in scene.bodies)
    bodies = (core for core in cores if core.kind != shapes.HALF_SPACE)
    return min((min(half) + reach for _, half, reach in bodies), default=math.inf)


def bend_radius(scene: Scene, obstacle: Obstacle) -> float:
    """Radius [m] of the bend of a soft cable that is drawn round an obstacle, or over its edge, on
    the axis of the cable.
    """
    radius = 0.5 * scene.cable.diameter
    if obstacle.shape in ("sphere", "cylinder", "capsule"):
        return 0.5 * obstacle.size[0] + radius
    if obstacle.shape in GUIDES:
        return core_of(obstacle, radius).reach
    return radius


def pieces_of(scene: Scene) -> tuple[int, int]:
    """Groups of LANES samples of a knot span that touch bodies, and those that touch rings and
    channels; none without obstacles.
    """
    if not scene.bodies:
        return 0, 0
    span = scene.cable.length / (scene.discretization.control_points - bspline.DEGREE)
    wanted, in_guides = 1, 0
    for obstacle in scene.bodies:
        if obstacle.shape == "plane":
            continue
        reach = core_of(obstacle, 0.5 * scene.cable.diameter).reach
        if obstacle.shape in GUIDES:
            closely = math.ceil(span / (APART_IN_GUIDES * LANES * reach))
            in_guides = max(in_guides, min(closely, MOST_PIECES))
        else:
            apart = APART_AT_EDGES if obstacle.shape in EDGED else APART
            wanted = max(wanted, min(math.ceil(span / (apart * LANES * reach)), MOST_PIECES))
    return wanted, in_guides


class Beside(NamedTuple):
    """Samples of surfaces beside the axis of a cable: the balls of its connectors.

    Attributes:
        first: control point with which each group of LANES begins, shape (groups,).
        values: of its samples, as in `samples_by_span`, shape (groups, LANES, 12).
    """

    first: NDArray[np.int64]
    values: Array


NONE_BESIDE = Beside(np.zeros(0, dtype=np.int64), np.zeros((0, LANES, 12)))


def fill(model: Model, radius: float, beside: Beside = NONE_BESIDE) -> None:
    """Constants of the contact with the obstacles of a scene.

    Args:
        radius: [m] of the thickest strand or connector, for which obstacles and the fields of
            meshes are made.
    """
    scene, group, parts = model.scene, model.arrays.contact, model.parts
    cables = [part.model.scene.cable for part in parts]
    group.count, group.extras = len(group.core), len(beside.first)
    group.still[:] = model.rest
    group.density, group.restitution = scene.cable.mu, scene.contact.restitution
    group.least_margin = min(cable.diameter for cable in cables)
    group.radius, group.leverage = radius, 1.0
    if group.extras:
        group.leverage = max(1.0, float(np.abs(beside.values[..., :4]).sum(axis=-1).max()))
    for k, obstacle in enumerate(scene.bodies[: group.count]):
        core = core_of(obstacle, radius)
        flat = core.kind == shapes.HALF_SPACE
        group.core[k], group.half[k], group.reach[k] = core
        stiff = max(stiffness(part.model.scene, obstacle) for part in parts)
        group.law[k] = stiff, BRISTLES * stiff, scene.friction_of(obstacle)
        group.middle[k] = math.inf if flat else MIDDLE * (min(core.half) + core.reach)
        if core.kind == shapes.MESH:
            _fill_field(obstacle, radius, group, k)
        # The cable is never further from what it touches.
        long = 2.0 * sum(cable.length for cable in cables)
        group.extent[k] = long if flat else math.hypot(*core.half)
    pieces = group.pieces, group.guide_pieces
    spans = model.n - bspline.DEGREE
    bodies, guides = (np.zeros((spans, count * LANES, 12)) for count in pieces)
    for part, cable in zip(parts, cables, strict=True):
        own = 0.5 * cable.diameter, 0.5 * cable.diameter - radius, cable.mu / scene.cable.mu
        here = part.spans
        bodies[here], guides[here] = samples_by_span(part.model.knots, pieces, *own)
    write_samples(group, bodies, guides, beside)


def _fill_field(obstacle: Obstacle, radius: float, group: ContactArrays, number: int) -> None:
    """Write the field of a mesh behind those of the obstacles before it."""
    field = field_of(obstacle, radius)
    first = int(sum(math.prod(shape[:3]) for shape in group.field_shape[:number].tolist()))
    group.field[number] = field.numbers
    group.field_shape[number] = [*field.values.shape, first]
    group.field_values[first : first + field.values.size] = field.coefficients.ravel()


def fields_of(scene: Scene, radius: float) -> tuple[Field, ...]:
    """The fields of all meshes, for a cable of this radius [m]."""
    return tuple(
        field_of(obstacle, radius) for obstacle in scene.bodies if obstacle.shape == "mesh"
    )


@lru_cache(maxsize=16)
def rule_of(knots: tuple[float, ...], pieces: int, radius: float) -> quadrature.Quadrature:
    """`sample_rule` with the round tips of a cable of this radius [m], which reach so far beyond
    its ends; kept, as a report needs it for each obstacle, and a search for weights takes a tenth
    of a millisecond.
    """
    rule = sample_rule(np.array(knots), pieces)
    weights = rule.weights.copy()
    for tip in (0, -1):
        weights.flat[tip] += radius
    return quadrature.Quadrature(rule.xi, weights)


def sample_rule(knots: Array, pieces: int) -> quadrature.Quadrature:
    """Trapezoidal rule of so many groups of samples of a span, those of the last span a little
    closer, up to its end.

    Its weights are changed as little as makes the integrals of all basis functions exact, so that
    a cable under its own weight lies evenly on a plane, ends included.
    """
    spans, count = len(knots) - 2 * bspline.DEGREE - 1, pieces * LANES
    xi = np.tile(2.0 * np.arange(count) / count - 1.0, (spans, 1))
    xi[-1] = np.linspace(-1.0, 1.0, count)
    places = quadrature.Quadrature(xi, np.ones(xi.shape)).places(bspline.breaks(knots))
    apart = np.diff(places.ravel())
    weights = (0.5 * (np.append(apart, 0.0) + np.append(0.0, apart))).reshape(xi.shape)
    weights[np.diff(bspline.breaks(knots)) == 0.0] = 0.0
    values = values_of_spans(knots, xi)
    lacking = (knots[bspline.ACTIVE :] - knots[: -bspline.ACTIVE]) / bspline.ACTIVE
    here = np.arange(len(xi))[:, None] + np.arange(bspline.ACTIVE)
    np.subtract.at(lacking, here, np.einsum("sm,smk->sk", weights, values))
    # Least squares by their normal equations; a single span has more basis functions than samples.
    band = mass.gram(knots, rule=quadrature.Quadrature(xi, np.ones(xi.shape)))
    band[0] *= 1.0 + 1e-13
    change, _ = elimination.solve(mass.dense(band), lacking, bspline.DEGREE)
    weights += np.einsum("smk,sk->sm", values, change[here])
    return quadrature.Quadrature(xi, weights)


def samples_by_span(
    knots: Array, pieces: tuple[int, int], radius: float, wider: float, heavier: float
) -> tuple[Array, Array]:
    """Basis functions (4), weight, their derivatives by the local coordinate (4), `place`, `wider`
    and `heavier` of `engine.arrays.Contact`, shape (spans, samples, 12), of samples that touch
    rings and channels, second, and of those that touch all else (`pieces_of`).
    """
    found = [np.zeros((len(bspline.breaks(knots)) - 1, 0, 12))] * 2
    for k, count in enumerate(pieces):
        if count:
            rule = rule_of(tuple(knots.tolist()), count, radius)
            values, slopes = (values_of_spans(knots, rule.xi, order) for order in (0, 1))
            places = rule.places(bspline.breaks(knots))
            same = [np.full(places.shape, one) for one in (wider, heavier)]
            rest = np.stack([places, *same], axis=-1)
            found[k] = np.concatenate([values, rule.weights[..., None], slopes, rest], axis=-1)
    return found[0], found[1]


def write_samples(group: ContactArrays, bodies: Array, guides: Array, beside: Beside) -> None:
    """Write `samples_by_span` as groups, and which of them touch each obstacle."""
    spans, is_guide = len(bodies), group.core == shapes.TUBE
    begin = spans * group.pieces
    group.begin[:] = np.where(is_guide, begin, 0)
    group.end[:] = np.where(is_guide, len(group.first), begin + group.extras)
    every = (one.reshape(-1, LANES, 12) for one in (bodies, beside.values, guides))
    values = np.concatenate(list(every))
    group.basis[:] = values[..., :4].swapaxes(1, 2)
    group.weight[:] = values[..., 4]
    group.slope[:] = values[..., 5:9].swapaxes(1, 2)
    group.place[:], group.wider[:] = values[..., 9], values[..., 10]
    group.heavier[:] = np.where(values[..., 11], values[..., 11], 1.0)  # is divided by
    own, in_guides = (np.repeat(np.arange(spans), k) for k in (group.pieces, group.guide_pieces))
    group.first[:] = MARGIN + np.concatenate([own, beside.first, in_guides])


def values_of_spans(knots: Array, xi: Array, order: int = 0) -> Array:
    """Basis functions of the spans at xi (spans, m), or their first derivatives by xi, shape
    (spans, m, 4).
    """
    power = np.arange(bspline.ACTIVE)
    powers = xi[..., None] ** np.maximum(power - order, 0) * (power if order else 1)
    return np.asarray(np.einsum("skp,smp->smk", bspline.span_polynomials(knots), powers))
