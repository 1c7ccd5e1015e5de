"""Where the strands of a net are before any relaxation: the main cable as it is drawn alone
(`geometry.first_shape`), each branch from where it begins, in its direction there.

A branch leaves in the frame of its parent, carried along the parent without twist. It is straight,
or an arc to what holds its far end. A strand whose end is joined to its own start is a circle.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import replace
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from dlo_sim.core import bspline, rotations
from dlo_sim.scene.description import Scene
from dlo_sim.scene.parameter import ORIGIN
from dlo_sim.simulation.geometry import (
    Geometries,
    Geometry,
    Pose,
    first_line,
    first_shape,
    geometries_of,
)
from dlo_sim.simulation.model import Model, Part
from dlo_sim.simulation.net import drawn_frame, names_of

Array = NDArray[np.float64]
PLACES = 65  # along a strand, between which its frame is carried
X = np.array([1.0, 0.0, 0.0])
FIXED = (True, True, True)


class Drawn(NamedTuple):
    """A strand before any relaxation.

    Attributes:
        scene, geometries: of it alone, held where it is joined, too. frame: at its start in the
            world, x along it, as columns. ring: whether it ends where it begins.
    """

    scene: Scene
    geometries: dict[str, Geometry]
    frame: Array
    ring: bool = False

    def line(self, u: Array) -> Array:
        """Points [m] at material coordinates, shape (len(u), 3)."""
        if not self.ring:
            return first_line(self.scene, self.geometries, u)
        x, down = self.frame[:, 0], np.array(self.scene.gravity, dtype=float)
        down -= (down * x).sum() * x
        down = down / math.hypot(*down) if math.hypot(*down) > 1e-9 else self.frame[:, 1]
        radius = self.scene.cable.length / (2.0 * math.pi)
        turned = (u / radius)[:, None]
        way = np.sin(turned) * x + (1.0 - np.cos(turned)) * down
        return np.asarray(self.geometries["start"].attachment + radius * way)

    def at(self, share: float) -> tuple[Array, Array]:
        """Point [m] at a share of its length, and the frame carried along to it."""
        length = self.scene.cable.length
        places, step = np.linspace(0.0, share * length, PLACES), 1e-6 * length
        low = np.clip(places - 0.5 * step, 0.0, length - step)
        frame = self.frame
        for tangent in self.line(low + step) - self.line(low):
            frame = rotations.swung(frame, tangent)
        return self.line(places[-1:])[0], frame


def drawn(
    scene: Scene,
    geometries: Geometries | None = None,
    poses: Mapping[str, Pose] | None = None,
    before: Geometries | None = None,
) -> dict[str, Drawn]:
    """All strands.

    Args:
        geometries: what holds them; default: as the scene says, or these poses of end effectors,
            with tangents that the scene leaves open as `before` (`geometry.geometries_of`).
    """
    found: dict[str, Drawn] = {}
    frames: dict[str, Array] = {}
    main = None
    joined = {(one.strand, one.end): one for one in scene.joints}
    for strand in scene.strands:
        own, name, names, root, carried = strand.scene, strand.name, names_of(strand), None, None
        begins = joined.get((name, 0.0))
        if begins:
            root, carried = found[begins.other].at(begins.at)
            start = replace(own.start, position=tuple(root.tolist()), offset=ORIGIN, fixed=FIXED)
            own = replace(own, start=start)
        if geometries is not None:
            local = {one: geometries[other] for one, other in names.items()}
        else:
            given = poses or {}
            own_poses = {one: given[other] for one, other in names.items() if other in given}
            earlier = {one: before[other] for one, other in names.items()} if before else None
            local = geometries_of(own, own_poses, earlier)
        main = local["start"].orientation if main is None else main
        frames[name] = drawn_frame(strand, frames, local["start"], main)
        frame = rotations.to_matrix(main) @ frames[name]
        if strand.parent and root is not None and carried is not None:
            frame = carried @ frames[strand.parent].T @ frames[name]
            local["start"] = Geometry(root, rotations.from_matrix(frame), root, X, 0.0)
        elif root is not None:
            local["start"] = replace(local["start"], attachment=root)
        ends, ring = joined.get((name, 1.0)), False
        if ends:
            ring = (ends.other, ends.at) == (name, 0.0)
            if ends.other in found:
                there = found[ends.other].at(ends.at)[0]
                local["end"] = replace(local["end"], attachment=there)
                own = replace(own, end=replace(own.end, fixed=FIXED))
        one = Drawn(own, local, frame, ring)
        leaving = one.line(np.array([0.0, 1e-6 * own.cable.length]))
        found[name] = one._replace(frame=rotations.swung(frame, leaving[1] - leaving[0]))
    return found


def held_geometries(
    scene: Scene, poses: Mapping[str, Pose] | None = None, before: Geometries | None = None
) -> dict[str, Geometry]:
    """`geometry.geometries_of` of all strands."""
    if not scene.is_net:
        return geometries_of(scene, poses, before)
    strands = drawn(scene, None, poses, before)
    return {
        name: strands[strand.name].geometries[local]
        for strand in scene.strands
        for local, name in names_of(strand).items()
    }


def first_points(model: Model) -> Array:
    """Control points [m] of all strands and bodies before any relaxation, shape (n, 3)."""
    if model.layout is None:
        return first_shape(model.scene, model.geometries, model.knots)
    strands, points = drawn(model.scene, model.geometries), np.zeros((model.n, 3))
    for part in model.parts:
        line = strands[part.name].line(bspline.greville(part.model.knots))
        points[part.here] = bspline.interpolate(part.model.knots, line)
    return with_bodies(model, points, model.geometries["start"].orientation)


def frames_of(model: Model, points: Array, orientation: Array) -> dict[str, Array]:
    """Frame in which each strand begins at control points (n, 3), as columns, x along it.

    That of a branch is the frame in which it is drawn, turned so that x is its tangent and the
    drawn direction of its parent comes as near to the parent's tangent as that allows.

    Args:
        orientation: of the end effector at the start of the main cable.
    """
    frames = dict[str, Array]()
    for part in model.parts:
        tangent = _tangent(part, points, 0.0)
        frames[part.name] = rotations.swung(rotations.to_matrix(orientation) @ part.drawn, tangent)
        for join in model.joins:
            other = next(one for one in model.parts if one.name == join.other)
            if join.strand == part.name and join.u == 0.0 and not join.in_line:
                across = _tangent(other, points, join.at)
                frames[part.name] = _turned(part.drawn, other.drawn[:, 0], tangent, across)
    return frames


def with_bodies(model: Model, points: Array, orientation: Array) -> Array:
    """Control points (n, 3) with those of the bodies where the strands have them, in `frames_of`
    carried along.
    """
    out, frames = points.copy(), frames_of(model, points, orientation)
    for body in model.bodies:
        part = next(one for one in model.parts if one.name == body.strand)
        frame = _carried(frames[part.name], part, points, 0.0, body.u)
        directors = frame @ part.drawn.T @ body.frame
        place = bspline.evaluate(points[part.here], part.model.knots, [body.u])[0]
        out[body.points] = place
        out[body.points[1:]] += body.length * (np.array(body.signs) * directors).T
    return out


def twists_of(model: Model, points: Array, orientation: Array, held: Array) -> Array:
    """Twist angles [rad] of control points (n, 3) at which the branches leave as they do, linear
    between them and the clamps, shape (n,).

    Args:
        orientation: of the end effector at the start. held: by what holds it (`held_twists`).
    """
    out, frames = np.zeros(model.n), frames_of(model, points, orientation)
    parts = {part.name: part for part in model.parts}
    for part in model.parts:
        clamped = [end.clamped for end in part.model.scene.ends.values()]
        known = {0.0: float(held[part.grasp]) if clamped[0] else 0.0}
        frame, u, begin = frames[part.name], 0.0, known[0.0]
        for join in sorted(model.joins, key=lambda one: one.at):
            if join.other != part.name or join.u or join.in_line or not join.rigid:
                continue
            frame = _carried(frame, part, points, u, join.at)
            branch, u = parts[join.strand], join.at
            wanted = (frames[join.strand] @ branch.drawn.T @ part.drawn)[:, 1]
            angle = begin + math.atan2((frame[:, 2] * wanted).sum(), (frame[:, 1] * wanted).sum())
            before = [*known.values()][-1]
            known[u] = angle - 2.0 * math.pi * round((angle - before) / (2.0 * math.pi))
        if clamped[1]:
            known[part.length] = float(held[part.grasp + 1])
        greville = bspline.greville(part.model.knots)
        out[part.here] = np.interp(greville, [*known], [*known.values()])
    return out


def _tangent(part: Part, points: Array, u: float) -> Array:
    slope = bspline.evaluate(points[part.here], part.model.knots, [u], 1)[0]
    return np.asarray(slope / math.hypot(*slope))


def _carried(frame: Array, part: Part, points: Array, begin: float, end: float) -> Array:
    """A frame carried along a strand."""
    places = np.linspace(begin, end, PLACES if end > begin else 1)
    for slope in bspline.evaluate(points[part.here], part.model.knots, places, 1):
        frame = rotations.swung(frame, slope / math.hypot(*slope))
    return frame


def _turned(drawn: Array, other: Array, tangent: Array, across: Array) -> Array:
    """The drawn frame turned so that its first axis is `tangent`, and the drawn direction `other`
    as near to `across` as that allows.
    """
    before, after = (_orthonormal(a, b) for a, b in ((drawn[:, 0], other), (tangent, across)))
    return np.asarray(after @ before.T @ drawn)


def _orthonormal(x: Array, beside: Array) -> Array:
    """Frame with the first axis x and the second one towards another direction, as columns."""
    z = np.cross(x, beside)
    if math.hypot(*z) < 1e-9:
        z = np.cross(x, np.eye(3)[np.argmin(np.abs(x))])
    z = z / math.hypot(*z)
    return np.stack((x, np.cross(z, x), z), axis=1)
