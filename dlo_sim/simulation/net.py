"""Several cables in one set of arrays: the strands of a net, the bodies on them, what joins them.

The control points of the strands follow each other. Knot spans between the last control points of
one strand and the first of the next are void: without length, samples or stiffness, as the lanes
beyond the last span. So no loop of the compiled code needs to know of strands; constraint rows join
them (`engine.rows`, `engine.roll`).

A rigid body is four control points, its origin and the ends of three directors e1, e2, e3
(`engine.rigid_body`). Where a strand begins or ends in one, its first or last two control points
are the origin and the end of e1, so that r' there is e1, of unit length. Farther along a strand a
body is a block of four control points of its own, held by rows. A connector is such a body, and a
branch that a rigid or elastic joint holds across the line of its parent begins in one, of next to
no mass.

A joint holds r(u) of a strand at a place of another one. Rigid, it also holds the tangent r'(u)
there in the body in which the branch begins, and the roll; where both tangents are in line, they
are equal, and no body is needed.
"""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping
from dataclasses import replace
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from dlo_sim.core import bspline, rotations
from dlo_sim.scene.description import Scene
from dlo_sim.scene.nets import Connector, Strand
from dlo_sim.simulation.geometry import Geometries, Geometry
from dlo_sim.simulation.holding import Point, Row
from dlo_sim.simulation.model import Body, Join, Layout, Model, Part

Array = NDArray[np.float64]
OWN = 2  # control points that a body at the end of a strand has beside those of the strand
ALONE = 4  # of a body elsewhere
IN_LINE = 1e-9  # largest angle between tangents that are in line [rad], and share of a length


# -- what there is, and where -------------------------------------------------------------------


def local_geometries(strand: Strand, geometries: Geometries) -> Geometries:
    """What holds one strand, by the names in its own scene."""
    return {local: geometries[name] for local, name in names_of(strand).items()}


def names_of(strand: Strand) -> dict[str, str]:
    """What holds a strand: name in its own scene -> name in that of the net."""
    ends = {end: strand.holder(end) for end in ("start", "end")}
    return ends | {grasp.name: grasp.name for grasp in strand.scene.grasps}


def drawn_frame(strand: Strand, before: Mapping[str, Array], start: Geometry, main: Array) -> Array:
    """Frame of a strand when all are straight and untwisted, x along it, as columns in the frame of
    the main start's end effector.

    Args:
        before: those of the strands before it. start: what holds its start. main: orientation of
            the main start's end effector.
    """
    frame = before[strand.parent] if strand.parent else np.eye(3)
    along = np.array(strand.direction)
    if not strand.parent:
        turn = rotations.multiply(rotations.conjugate(main), start.orientation)
        along = rotations.rotate(turn, start.tangent)
    elif not along.any():
        along = frame[:, 0]
    return rotations.swung(frame, along)


def drawn_frames(scene: Scene, geometries: Geometries) -> dict[str, Array]:
    """`drawn_frame` of all strands."""
    frames: dict[str, Array] = {}
    for strand in scene.strands:
        start, main = geometries[strand.holder("start")], geometries["start"].orientation
        frames[strand.name] = drawn_frame(strand, frames, start, main)
    return frames


def joins_of(scene: Scene, frames: Mapping[str, Array]) -> tuple[Join, ...]:
    """All joints of a scene, with the frames in which its strands are drawn."""
    found = []
    lengths = {strand.name: strand.scene.cable.length for strand in scene.strands}
    for joint in scene.joints:
        in_line = 1 if joint.end != joint.at else -1
        if not joint.loop:
            cosine = float(frames[joint.strand][:, 0] @ frames[joint.other][:, 0])
            in_line = int(math.isclose(cosine, 1.0, rel_tol=0.0, abs_tol=IN_LINE))
        u, at = joint.end * lengths[joint.strand], joint.at * lengths[joint.other]
        stiffness = joint.stiffness if joint.kind == "elastic" else math.inf
        given = joint.kind != "hinged", stiffness, in_line
        found.append(Join(joint.strand, u, joint.other, at, *given))
    return tuple(found)


def cuts_of(scene: Scene) -> dict[str, list[float]]:
    """Where each strand may bend sharply [m], rising: amid it, at what turns it there."""
    found: dict[str, set[float]] = {strand.name: set() for strand in scene.strands}
    places = [(one.other, one.at) for one in scene.joints if one.kind != "hinged"]
    places += [(one.on, one.at) for one in scene.connectors if one.joint == "rigid"]
    lengths = {strand.name: strand.scene.cable.length for strand in scene.strands}
    for name, at in places:
        if 0.0 < at < 1.0:
            found[name].add(at * lengths[name])
    return {name: sorted(cuts) for name, cuts in found.items()}


def smooth_places(part: Part) -> Iterator[Point]:
    """r' behind each place where the knots are threefold, minus that before it: zero."""
    lengths = np.diff(bspline.breaks(part.model.knots))
    for k in np.flatnonzero(lengths == 0.0)[::2]:  # two empty spans
        before, after = 1.0 / lengths[k - 1], 1.0 / lengths[k + 2]
        yield Point(part.first + int(k) + 1, (before, -before - after, after, 0.0))


def layout_of(scene: Scene, geometries: Geometries, models: Mapping[str, Model]) -> Layout:
    """Where the strands, with these models, and the bodies of a scene are."""
    frames = drawn_frames(scene, geometries)
    joins = joins_of(scene, frames)
    wanted: dict[tuple[str, float], Connector | None] = {
        (one.strand, 0.0): None for one in joins if one.rigid and not one.in_line
    }
    hinged = [one for one in scene.connectors if one.joint == "hinged"]
    wanted |= {
        (one.on, one.at * float(models[one.on].knots[-1])): one
        for one in scene.connectors
        if one.joint == "rigid"
    }
    parts, bodies, at, grasp = {}, [], 0, 0
    for strand in scene.strands:
        name, model = strand.name, models[strand.name]
        length, spans = float(model.knots[-1]), np.diff(bspline.breaks(model.knots))
        begins, ends = (name, 0.0) in wanted, (name, length) in wanted
        first = at + OWN * begins
        part = Part(name, model, first, grasp, frames[name])
        parts[name] = part
        last = first + model.n - 1
        if begins:
            points = [first, first + 1, at, at + 1]
            given = wanted[name, 0.0], frames[name], float(spans[0]) / 3.0, at
            bodies.append(Body(name, 0.0, *given, points, False))
        if ends:
            points = [last, last - 1, last + 1, last + 2]
            given = wanted[name, length], frames[name], float(spans[-1]) / 3.0, last - 1
            bodies.append(Body(name, length, *given, points, False, (-1.0, 1.0, 1.0)))
        at = last + 1 + OWN * ends
        amid = [(u, one) for (on, u), one in wanted.items() if on == name and 0.0 < u < length]
        amid += [(one.at * length, one) for one in hinged if one.on == name]
        for u, connector in amid:
            points, size = [at, at + 1, at + 2, at + 3], float(spans.max()) / 3.0
            bodies.append(Body(name, u, connector, frames[name], size, at, points, True))
            at += ALONE
        grasp += len(names_of(strand))
    return Layout(parts, joins, tuple(bodies), at)


# -- what is held, and what joins ---------------------------------------------------------------


def place_at(part: Part, u: float, order: int = 0) -> Point:
    """Basis values, or derivatives, at a place of a strand, in the net."""
    column, values = bspline.active_basis(part.model.knots, [u], order)
    a, b, c, d = values[0].tolist()
    if order:  # derivatives: zero for equal control points, without round-off
        d = -a - b - c
    return Point(part.first + int(column[0]), (a, b, c, d))


def difference(one: Point, other: Point, sign: float = 1.0) -> Point:
    """The first minus `sign` times the second."""
    a, b, c, d = (-sign * weight for weight in other.weights)
    return replace(one, other=other.first, other_weights=(a, b, c, d))


class Roll(NamedTuple):
    """The twist angle at a place of a strand, which a body holds.

    Attributes:
        place: of the angle. body: its index. along, side: tangent there, and a direction across it,
            in the directors of the body. stiffness: [N m/rad].
    """

    place: Point
    body: int
    along: Array
    side: Array
    stiffness: float


def joining(layout: Layout, dim: int, twist: bool) -> Iterator[Row | Point]:
    """Points that joints and bodies hold together, each followed by its rows, whose `point` is left
    open; rows of infinite stiffness are rigid.
    """
    for join in layout.joins:
        part, other = layout.parts[join.strand], layout.parts[join.other]
        yield from rows_of(difference(place_at(part, join.u), place_at(other, join.at)), dim)
        if not join.rigid:
            continue
        slope = place_at(other, join.at, 1)
        if join.in_line:
            point = difference(place_at(part, join.u, 1), slope, join.in_line)
        else:
            body = layout.root(join.strand)
            tangent = body.frame.T @ other.drawn[:, 0]
            point = difference(slope, Point(body.first, body.weights(tangent)))
        yield from rows_of(point, dim, join.stiffness)
        if join.in_line and twist:
            here, there = (
                replace(place_at(*one), twist=True) for one in ((part, join.u), (other, join.at))
            )
            yield difference(here, there, join.in_line)
            yield Row(-1, -1, dim, stiffness=join.stiffness)
        if layout.is_seamless(join):
            bend = place_at(other, join.at, 2)
            yield from rows_of(difference(place_at(part, join.u, 2), bend), dim)
    for part in layout.parts.values():
        for point in smooth_places(part):
            yield from rows_of(point, dim)
    for body in layout.bodies:
        part = layout.parts[body.strand]
        if body.alone:
            origin = np.eye(4)[body.points[0] - body.first].tolist()
            middle = Point(body.first, (origin[0], origin[1], origin[2], origin[3]))
            yield from rows_of(difference(place_at(part, body.u), middle), dim)
            if body.is_hinged:
                continue
            along = Point(body.first, body.weights(np.eye(3)[0]))
            yield from rows_of(difference(place_at(part, body.u, 1), along), dim)


def rows_of(point: Point, dim: int, stiffness: float = math.inf) -> Iterator[Row | Point]:
    """A point and its rows in all directions."""
    yield point
    for line in range(dim):
        yield Row(-1, -1, line, stiffness=stiffness)


def rolls_of(layout: Layout) -> list[Roll]:
    """What holds the twist angles of strands on bodies, rigid ones first."""
    found = []
    for join in (one for one in layout.joins if one.rigid and not one.in_line):
        other, body = layout.parts[join.other], layout.root(join.strand)
        turned = body.frame.T @ other.drawn
        given = layout.bodies.index(body), turned[:, 0], turned[:, 1], join.stiffness
        found.append(Roll(place_at(other, join.at), *given))
    for number, body in enumerate(layout.bodies):
        if not body.is_hinged:
            here = place_at(layout.parts[body.strand], body.u)
            found.append(Roll(here, number, np.eye(3)[0], np.eye(3)[1], math.inf))
    return sorted(found, key=lambda one: math.isfinite(one.stiffness))
