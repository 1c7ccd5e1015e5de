"""The first shape of a cable: straight, an arc, or in static equilibrium under its loads.

The search for an equilibrium follows a way: it starts where the ends are easy to reach, on a
sagging arc between ends not nearer than EASY of the length of cable between them, on the way from
the straight cable to where the scene has them. It then moves and turns the ends along that way, in
steps that adapt themselves, and the cable is at rest under its loads after every step. So where
there are several equilibria, it finds the one that grippers reach that move together from the
straight cable: from an arc at the end of the way, 16 of 130 everyday scenes ended in another one.

Where there are obstacles, the cable hangs above them in the shape that it has without them, and is
lowered in small steps: in a long one, it would go through what it should lie on. Where that does
not end well, it starts straight and above them, and its ends come together. On the way contact is
only as stiff as weight and bending ask for, since Newton's method is the slower the less a cable
sinks in; the last search has the contact of the scene. No step takes the cable farther than half of
what would bring it through the thinnest obstacle, and a cable that hangs beneath a box over which
it is held begins above that.

A lowered cable is guided: it hardly moves across the vertical plane of its ends. Where that plane
is one of symmetry, the shape in it counts, unless it topples much faster than a body falls by the
length of the cable; one that topples slowly does so in the simulation. All others are let go.

At each place of the way the cable descends from its first guess by backward Euler steps of a
gradient flow (`methods.relax_step`), whose pseudo-time grows as long as Newton's method converges,
so that the descent ends in Newton's method and does not stop at unstable shapes on the way. Twist
that acts on the shape is found at last, by the same steps for all unknowns.

A cable of constant length is first found as an elastic one, with the penalty factor of
`engine.tension` as EA, whose tension then is the multiplier that it starts with.
"""

from __future__ import annotations

import math
import warnings
from collections.abc import Callable
from dataclasses import replace
from itertools import pairwise

import numpy as np
from numpy.typing import NDArray

from dlo_sim.core import bspline, mass, rotations
from dlo_sim.core.end_motion import EndMotion
from dlo_sim.engine.arrays import (
    ANY_STRETCH,
    BISHOP,
    CONTACT,
    GRAVITY,
    MATERIAL,
    PLASTICITY,
)
from dlo_sim.engine.contact import EARTH, STIFFNESS
from dlo_sim.methods import relax_step
from dlo_sim.scene.description import Obstacle, Scene
from dlo_sim.scene.loading import SceneError
from dlo_sim.scene.needs import inextensible
from dlo_sim.simulation.cable import Cable
from dlo_sim.simulation.drawn_strands import drawn, first_points
from dlo_sim.simulation.ends import EndDrive
from dlo_sim.simulation.geometry import (
    LEVEL,
    Geometries,
    first_shape,
    held_places,
    laying_directions,
    straight_direction,
)
from dlo_sim.simulation.obstacles import PLACES, bend_radius, gaps, inside, thinnest
from dlo_sim.simulation.resolution import RADIUS, resolved
from dlo_sim.simulation.self_contact import nearest
from dlo_sim.simulation.soundness import leaves_clamp_backwards, unexplained_stretch

Array = NDArray[np.float64]
Lay = Callable[[], None]

EASY = 0.8  # distance of the ends, in lengths of the cable between them, where the search begins
STEPS = 2  # from there, unless more are needed
TOUCHING_STEPS = 20  # the same where there are obstacles
SINKS = 0.05  # diameters, into obstacles on the way
LAID = "plane", "box"  # obstacles on which a cable lies that is lowered
GUIDED = 1e3  # stiffness of the guide of a lowered cable, in its mass and gravity per length
TOPPLES = 100.0  # square of the rate at which a shape that counts may topple, in gravity per length
MOST_LIFTS = 200  # of the straight cable, to be clear of them
STRIDE = 0.5  # of half the thickness of the thinnest obstacle, move of a cable that may touch it
CLEAN = 0.1  # diameters, depth in an obstacle or in itself below which no other way is tried
ABOVE = -0.01  # diameters, gap of a cable that counts as above an obstacle
FLAT = 1e-9  # of the length, distance from a plane that counts as none
TINY = 1e-300
LEAST_STEP = 1e-3  # of the way
ROUGH = 1e-3  # of the length, movement that counts as rest on the way

MAX_STEPS = 400
FALLS = 4.0  # lengths, in strides, that a search may take beside these: a cable slips off an edge
TURNING_STEPS = 40  # of a search in which what holds the roll turns with the Bishop frame
TOLERANCE = 1e-10  # of the cable's length, movement of a step that counts as rest
ROUND_OFF = 1e-6  # the same where steps do not shrink any more
FAST, SLOW = 0.5, 0.9  # movement that counts as progress, relative to the least so far
PATIENCE = 6  # steps without progress after which they do not
NUDGE = 3e-5  # of the length; with 1e-6 slack falls on a plane to a side that depends on the knots
STEADY = 1e5  # pseudo-time of the stiffness that must be positive at rest, in `_Search.patient`
# Shares of the first step in which a cable only comes to its length, and falls as little as may be.
PROJECTING = 1e-4, 1e-3, 1e-2


class FirstShape:
    """The search for the first shape of one cable.

    Args:
        lay: aligns the natural shape with the material frames of the present shape and lets plastic
            flow follow; None if there is neither.
    """

    def __init__(self, ends: EndDrive, cable: Cable, lay: Lay | None) -> None:
        self._scene, self._geometries = cable.model.scene, cable.model.geometries
        self._ends, self._cable, self._lay = ends, cable, lay
        # After each step of a search for the shape alone.
        self._flow = self._align if cable.model.has(PLASTICITY) else None
        self._across: Array | None = None  # to where a guide keeps the cable from moving
        self._touching = cable.model.has(CONTACT)  # whether there are obstacles to follow
        self._thinnest = thinnest(cable.model.scene)  # half of what the cable may go through [m]

    def place(self, near: Array | None = None, continues: bool = False) -> bool:
        """Put the cable into the scene's first shape, at rest.

        Without equilibrium it is straight, or an arc where its ends are nearer than its length; or
        where the arc would leave a clamp backwards, the shape of grippers that moved together.
        Where the twist that a natural shape causes is not found, the cable is only placed close to
        rest, with a UserWarning.

        Args:
            near: control points (n, 4); where the first shape is an equilibrium, it is the one
                nearest to these. Default: the one that grippers reach which move together.
            continues: another shape will replace this one, so none is looked for, nor refused.

        Returns:
            Whether what presses it is to stay: in equilibrium, or until the other shape is there.

        Raises:
            SceneError: no equilibrium was found, a cable of constant length cannot reach both ends,
                or the cable begins in an obstacle.
        """
        scene, cable = self._scene, self._cable
        keeps_length = bool(cable.arrays.physics.keeps_length)
        cable.keep_length(False)
        points = np.zeros((cable.model.n, 4))
        points[:, :3] = first_points(cable.model)
        held = any(holder.held for holder in scene.holders.values())
        backwards = leaves_clamp_backwards(points, self._ends) is not None
        resting = _wants_equilibrium(scene, self._geometries)
        if scene.initial.shape == "auto" and scene.terms.twist != "frenet":
            # A straight cable that begins in an obstacle is none that somebody lays there.
            resting = resting or (held and self._inside(points[:, :3]) != "")
        searched = resting or backwards
        if near is not None and searched:
            points = near.copy()
        self._ends.put(points, 0.0, cable.held_twists(0.0), anew=True)
        cable.put(points, np.zeros_like(points), 0.0)
        self._align()
        if continues:
            cable.keep_length(keeps_length)
            return True
        if resting and scene.terms.twist == "frenet":
            raise SceneError(
                "initial.shape: no equilibrium is available with terms.twist frenet; use straight"
            )
        if near is not None and searched and self._touching:
            self._across = _Way(scene, self._geometries, cable.model.axes, None).across
        if near is not None and searched and self._rests(1.0):
            self._twist()
        elif resting:
            if not self._follow():
                raise SceneError(_cause(scene, cable))
            self._twist()
        elif backwards and scene.terms.twist != "frenet" and not self._follow():
            # An arc that is folded at a clamp would stay so, but no other shape was found.
            cable.put(points, np.zeros_like(points), 0.0)
            self._align()
        if keeps_length and not self._keep_length(resting):
            ends = cable.points[[0, -1], :3]
            raise SceneError(
                f"terms.stretch: off keeps the cable at its length, {scene.cable.length:.6g} m, in "
                f"no shape near that between its ends, {math.dist(*ends):.6g} m apart; set "
                "initial.shape to equilibrium, move the ends, or set terms.stretch to auto"
            )
        points = cable.points
        if wrong := self._inside(points[:, :3]):
            cure = "" if resting or not held else ", or set initial.shape to equilibrium"
            raise SceneError(f"{wrong}; move the obstacle or the cable's ends{cure}")
        cable.put(points, np.zeros_like(points))
        return resting

    def _align(self) -> None:
        """Align the natural shape with the present shape, with the plastic flow up to it."""
        if self._lay:
            self._lay()
            self._cable.flow()

    def _keep_length(self, resting: bool) -> bool:
        """Whether a cable of constant length came to that length, with `resting` to rest there,
        from the present shape of an elastic one with the penalty factor of `engine.tension` as EA.
        """
        cable = self._cable
        cable.take_tension(at_rest=resting)
        cable.keep_length(True)
        if resting:
            return self._rests(1.0)
        search = _Search(cable)
        done = any(search.step(share * search.first)[0] > 0 for share in PROJECTING)
        cable.take_tension(at_rest=False)
        return done

    def _inside(self, points: Array) -> str:
        """One line if the cable begins inside an obstacle (`obstacles.inside`), else empty."""
        scene = self._scene
        if not self._cable.model.has(CONTACT):
            return ""
        for part in self._cable.model.parts:
            u = np.linspace(0.0, part.length, PLACES)
            line = bspline.evaluate(points[part.here], part.model.knots, u) + part.model.origin
            thick = part.model.scene.cable.diameter
            found = (inside(body, thick, u, line) for body in scene.bodies)
            if wrong := next(filter(None, found), ""):
                return wrong
        return ""

    # -- along the way of the ends, for the twist as it is ----------------------------------------

    def _follow(self) -> bool:
        """Whether an extensible cable came into equilibrium for the twist as it is, in the shape
        that grippers reach that move together from the straight cable.

        Where there are obstacles, they come from where the cable is clear of them: hanging, or
        straight. The first shape counts that is in none of them and does not cross itself, or else
        the best one.
        """
        cable, scene, axes = self._cable, self._scene, self._cable.model.axes
        if cable.model.layout is not None:  # from where it is drawn
            return self._rests(1.0)
        way = _Way(scene, self._geometries, axes, None)
        if not cable.model.has(CONTACT):
            return self._follow_free(way)
        least, best = np.inf, (cable.state.copy(), self._across)
        directions = laying_directions(scene, self._geometries)
        straight = [_Way(scene, self._geometries, axes, direction) for direction in directions]
        lowered = way.u.size > 1 and all(body.shape in LAID for body in scene.bodies)
        for one in [way, *straight] if lowered else [*straight, way]:
            points, self._across = None, way.across if one is way else None
            if one is not way:
                one.begin_clear(cable.model.origin)
            elif (points := self._hung(way)) is None:
                continue
            if self._follow_from(one, 0.0, points):
                fault = self._fault()
                if fault < least:
                    least, best = fault, (cable.state.copy(), self._across)
                if fault < CLEAN:
                    break
        cable.state[:], self._across = best
        if CLEAN <= least < np.inf:
            warnings.warn(
                f"initial.shape: the best shape found is {least:.2g} diameters deep in an obstacle "
                "or in itself; raise discretization.control_points, or hold the cable elsewhere",
                stacklevel=2,
            )
        return least < np.inf

    def _follow_free(self, way: _Way) -> bool:
        """Whether the search on this way ended in equilibrium, where nothing touches."""
        return any(self._follow_from(way, begin) for begin in (way.easy, 0.0))

    def _hung(self, way: _Way) -> Array | None:
        """Control points of the shape without obstacles, above them, and the way down from there;
        None if it was not found.
        """
        cable, law = self._cable, self._cable.arrays.contact.law
        stiff = law[:, STIFFNESS].copy()
        law[:, STIFFNESS], self._touching = 0.0, False
        try:
            found = self._follow_free(way)
        finally:
            law[:, STIFFNESS], self._touching = stiff, True
        if not found:
            return None
        points = cable.points
        points[:, :3] += way.begin_above(self._line(points[:, :3]), cable.model.origin)
        return points

    def _fault(self) -> float:
        """How deep the cable is in obstacles or in itself, in diameters."""
        scene, model = self._scene, self._cable.model
        points, diameter = self._cable.points, scene.cable.diameter
        line = self._line(points[:, :3])
        found = [float(gaps(body, diameter, line).min()) for body in scene.bodies]
        return -min([*found, nearest(model, points).clearance]) / diameter

    def _line(self, points: Array) -> Array:
        """PLACES points of the cable in the world [m]."""
        model = self._cable.model
        u = np.linspace(0.0, self._scene.cable.length, PLACES)
        return np.asarray(bspline.evaluate(points, model.knots, u) + model.origin)

    def _follow_from(self, way: _Way, begin: float, points: Array | None = None) -> bool:
        """Whether the search from a share of the way on ended in equilibrium.

        Args:
            points: control points to begin with; default: straight, or an arc.
        """
        cable, steps = self._cable, TOUCHING_STEPS if self._touching else STEPS
        u = bspline.greville(cable.model.knots)
        if points is None:
            points = np.zeros((cable.model.n, 4))
            points[:, :3] = first_shape(self._scene, way.at(begin), cable.model.knots)
        self._put_on(way, begin, points, anew=True)
        share, step, rate = begin, (1.0 - begin) / steps, None  # of the shape in the last step
        if self._touching:
            stride = STRIDE * self._thinnest / max(np.abs(way.back).max(), TINY)
            step = min(step, max(stride, LEAST_STEP))
        found = self._rests(begin)
        while found and share < 1.0:
            there = share + step if share + step < 1.0 - LEAST_STEP else 1.0
            before, shape = cable.state.copy(), cable.points
            if rate is None or self._touching:
                rate = np.zeros_like(shape)
                for axis in range(3):
                    rate[:, axis] = -np.interp(u, way.u, way.back[:, axis])
            self._put_on(way, there, shape + (there - share) * rate)
            if self._rests(there):
                share, rate = there, (cable.points - shape) / (there - share)
                continue
            cable.state[:], rate = before, None
            step *= 0.4
            found = step >= LEAST_STEP
        if not found:
            self._place_ends(way, 1.0)
        return found

    def _place_ends(self, way: _Way, share: float) -> None:
        """Put what holds the cable at a share of the way."""
        for name, geometry in way.at(share).items():
            resting = EndMotion.resting(geometry.position, geometry.orientation)
            self._ends.go_on(name, resting)
        twists = self._cable.held_twists(0.0)
        self._cable.motion[:] = self._ends.motion
        self._cable.count_twists(0.0, enumerate(twists))
        self._cable.pull(0.0)
        self._cable.point_grasps(0.0)

    def _put_on(self, way: _Way, share: float, points: Array, anew: bool = False) -> None:
        """Put the cable at rest at a share of the way."""
        self._place_ends(way, share)
        self._ends.put(points, 0.0, self._cable.held_twists(0.0), anew)
        self._cable.put(points, np.zeros_like(points), 0.0, follow=self._lay is None)
        self._align()

    def _rests(self, share: float) -> bool:
        """Whether an equilibrium was found for the twist as it is, with plastic flow up to it at
        the end of the way, whose local stretch its tension explains. It is a rough one on the
        way, and where flow is found faster together with the twist that acts on the shape.
        """
        cable = self._cable
        _nudge(cable, self._across)
        at_end = share == 1.0 and self._touching == cable.model.has(CONTACT)
        more = not at_end or (self._flow is not None and cable.model.has(BISHOP))
        rest = ROUGH if more else TOLERANCE
        found = not self._touching or self._lies(at_end)
        if at_end:
            found = found and self._relax_with_flow(rest)
        elif not self._touching:
            found = relax(cable, rest=rest, across=self._across)
        return found and not unexplained_stretch(cable.model, cable.points, self._ends)

    def _lies(self, at_end: bool) -> bool:
        """Whether a rough equilibrium on softer obstacles was found. At the end of the way a guided
        cable is let go, unless its shape on the obstacles of the scene counts as it is.
        """
        cable, law = self._cable, self._cable.arrays.contact.law
        stiff = law[:, STIFFNESS].copy()
        soft = np.minimum(stiff, self._soft())
        try:
            law[:, STIFFNESS] = soft
            stride = STRIDE * self._thinnest
            found = relax(cable, rest=ROUGH, across=self._across, stride=stride)
            if not found or not at_end or self._across is None:
                return found
            before, law[:, STIFFNESS] = cable.state.copy(), stiff
            stays = relax(cable, rest=ROUGH, across=self._across, stride=stride)
            if stays and self._is_upright():
                return True
            cable.state[:], self._across = before, None
            law[:, STIFFNESS] = soft
            _nudge(cable)
            return relax(cable, rest=ROUGH, stride=stride)
        finally:
            law[:, STIFFNESS] = stiff

    def _soft(self) -> Array:
        """Stiffness [N/m^2] of obstacles into which the cable sinks by SINKS diameters under its
        weight, drawn round them, or where it is bent as by two grippers.
        """
        scene, cable = self._scene, self._scene.cable
        length, thick = cable.length, cable.diameter
        radii = np.array([max(bend_radius(scene, body), thick) for body in scene.bodies])
        radii[[body.shape == "plane" for body in scene.bodies]] = length
        bent = cable.EI * (RADIUS[True] / length) ** 3
        return np.asarray((cable.mu * EARTH * length / radii + bent) / (SINKS * thick))

    def _is_upright(self) -> bool:
        """Whether friction, which no search knows, may hold the cable: it lies in the plane in
        which it is guided, and topples slowly.
        """
        points, scene = self._cable.points[:, :3], self._scene
        if not any(scene.friction_of(body) for body in scene.bodies):
            return False
        aside = ((points - points[0]) * self._across).sum(axis=1)
        if np.abs(aside).max() > FLAT * scene.cable.length:
            return False
        pull = math.hypot(*scene.gravity)
        return _Search(self._cable).stable(scene.cable.length / (TOPPLES * pull))

    def _relax_with_flow(self, rest: float) -> bool:
        """`relax` with plastic flow. Where that fails, as for stiff wires, with the flow up to the
        first guess and a UserWarning.
        """
        begin = self._cable.state.copy()
        if relax(self._cable, self._flow, rest, across=self._across):
            return True
        self._cable.state[:] = begin
        if self._flow is None or not relax(self._cable, rest=rest, across=self._across):
            return False
        warnings.warn(
            "initial.shape: the search with plastic flow did not converge; the cable moves after "
            "the start: let it come to rest, or raise plasticity.hardening",
            stacklevel=2,
        )
        return True

    def _twist(self) -> None:
        """Bring shape and twist that acts on the shape into stable equilibrium together, or leave
        the cable close to rest, with a UserWarning.

        What holds the roll turns with the Bishop frame, so that it holds the cable at its twist
        angle whatever the shape. A natural shape may have no stable equilibrium of this kind; then
        what holds the roll keeps still from the shape without twist on.
        """
        cable, account = self._cable, self._cable.account
        before, twists = cable.state.copy(), cable.held_twists(0.0)
        for rolls in (True, False) if cable.model.has(BISHOP) else ():
            cable.state[:] = before
            if self._lay:
                self._lay()
            account.slip = 1.0  # all of the flow, and its part of the stiffness
            lay = self._lay if rolls else None
            found = relax(cable, lay, twist=True, rolls=rolls, across=self._across)
            account.slip = 0.0
            cable.flow()
            if rolls:
                cable.count_twists(0.0, enumerate(twists))
            if found:
                return
        if cable.model.has(BISHOP):
            what = "natural shape causes" if cable.model.has(MATERIAL) else "moments cause"
            warnings.warn(
                f"initial.shape: the search for the twist that the {what} did not converge; the "
                "cable moves after the start: let it come to rest, or check cable.shear_modulus",
                stacklevel=2,
            )


class _Way:
    """The way of everything that holds the cable, from where it is straight and unstressed (share
    0) to where the scene has it (share 1): positions move straight, tangents turn the shortest way.

    Args:
        direction: of the straight cable; None: from the first to the last held point; if they
            coincide, as the tangents do on average; if only one point is held, along gravity.

    Attributes:
        u: material coordinates of the held points [m], shape (places,). back: from where they are
            at share 1 to share 0 [m], shape (places, 3). direction: of the straight cable.
        easy: the largest share at which the ends are easy to reach. across: the horizontal unit
        vector across the direction, or None if that is vertical, or nothing is.
    """

    def __init__(
        self, scene: Scene, geometries: Geometries, axes: tuple[int, ...], direction: Array | None
    ) -> None:
        self._scene, self._geometries, self._axes = scene, geometries, axes
        self._places = held_places(scene, geometries)
        self.u = np.array([u for u, _ in self._places])
        direction = straight_direction(scene, self._places) if direction is None else direction
        self._at = at = np.array([geometry.attachment for _, geometry in self._places])
        line = np.outer(self.u, direction)
        self.direction = direction
        self.back = line - line.mean(axis=0) - (at - at.mean(axis=0))
        self._turns = {
            name: self._turn(
                direction,
                rotations.rotate(geometry.orientation, geometry.tangent),
                -1.0 if name == "end" else 1.0,
            )
            for name, geometry in geometries.items()
            if geometry.u is not None
        }
        self.easy = self._easy()
        across, pull = np.cross(scene.gravity, direction), math.hypot(*scene.gravity)
        size = math.hypot(*across)
        level = len(axes) < 3 or size <= LEVEL * pull
        self.across = None if level else across / size

    def begin_clear(self, origin: Array) -> None:
        """Begin with the straight cable above all obstacles, as low as that is possible."""
        u = np.linspace(0.0, self._scene.cable.length, PLACES)
        line = self._at[0] + self.back[0] + origin
        line = line + np.outer(u - self.u[0], self.direction)
        self.back = self.back + self._lift(line, origin)

    def begin_above(self, line: Array, origin: Array) -> Array:
        """Begin with the cable as at the end, at these points (PLACES, 3), moved up by what is
        returned, so that it is above all obstacles.
        """
        lift = self._lift(line, origin)
        self.back = np.zeros_like(self.back) + lift
        self._turns = {name: np.zeros(3) for name in self._turns}
        return lift

    def _lift(self, line: Array, origin: Array) -> Array:
        """How far up a cable at these points is clear of all obstacles, and above the boxes over
        which it is held, so that it does not begin beneath them.
        """
        scene, up = self._scene, -np.array(self._scene.gravity)
        up /= max(math.hypot(*up), TINY)
        diameter, height = scene.cable.diameter, 0.0
        u = np.linspace(self.u[0], self.u[-1], PLACES)
        held = np.stack([np.interp(u, self.u, one) for one in self._at.T], axis=1) + origin
        for body in scene.bodies:
            if body.shape == "box" and _height_over(body, diameter, held, up) <= diameter:
                height = max(height, _height_over(body, diameter, line, up))
        lift = height * up
        for _ in range(MOST_LIFTS):
            there = (float(gaps(body, diameter, line + lift).min()) for body in scene.bodies)
            gap = min(there, default=1.0)
            if gap > ABOVE * diameter:
                break
            lift = lift + max(-gap, 0.5 * diameter) * up
        return lift

    def at(self, share: float) -> Geometries:
        """What holds the cable at a share of the way."""
        moved = dict(self._geometries)
        back = {geometry.u: way for (_, geometry), way in zip(self._places, self.back, strict=True)}
        for name, turn in self._turns.items() if share < 1.0 else ():
            geo = self._geometries[name]
            turned = rotations.from_rotation_vector((share - 1.0) * turn)
            arm = rotations.rotate(turned, geo.attachment - geo.position)
            attachment = geo.attachment + (1.0 - share) * back.get(geo.u, np.zeros(3))
            orientation = rotations.multiply(turned, geo.orientation)
            moved[name] = replace(
                geo, position=attachment - arm, orientation=orientation, attachment=attachment
            )
        return moved

    def _easy(self) -> float:
        share = 1.0
        for k, ((begin, one), (end, other)) in enumerate(pairwise(self._places)):
            gap, back = other.attachment - one.attachment, self.back[k + 1] - self.back[k]
            # |gap + (1 - share) back| = EASY (end - begin)
            a, b = (back * back).sum(), (gap * back).sum()
            c = (gap * gap).sum() - (EASY * (end - begin)) ** 2
            if c < 0.0:
                share = min(share, 1.0 - float((np.sqrt(b * b - a * c) - b) / a))
        return share

    def _turn(self, direction: Array, tangent: Array, leaves: float) -> Array:
        """Rotation vector from the direction of the straight cable to a tangent. Opposite ones turn
        in the plane of the motion, or in the vertical one, and so that the cable hangs from what
        holds it: it `leaves` that (1) or comes to it (-1).
        """
        axis = np.cross(direction, tangent)
        angle = math.atan2(math.hypot(*axis), (direction * tangent).sum())
        if math.hypot(*axis) < 1e-9:
            missing = [k for k in range(3) if k not in self._axes]
            axis = np.eye(3)[missing[0]] if missing else np.cross(self._scene.gravity, direction)
            if math.hypot(*axis) < 1e-9:
                axis = np.cross(direction, np.eye(3)[np.argmin(np.abs(direction))])
            if leaves * (np.cross(axis, direction) * self._scene.gravity).sum() < 0.0:
                axis = -axis
        return np.asarray(axis * (angle / math.hypot(*axis)))


def _height_over(body: Obstacle, diameter: float, points: Array, up: Array) -> float:
    """How far [m] above their places points of a cable, shape (n, 3), touch a body first when they
    come down on it from above; 0 if they do not.
    """
    height = float(((np.array(body.position) - points) * up).sum(axis=1).max())
    height += math.hypot(*body.size) + diameter
    while height > 0.0:
        gap = float(gaps(body, diameter, points + height * up).min())
        if gap < -ABOVE * diameter:
            return height
        height -= max(gap, 0.5 * diameter)
    return 0.0


def _wants_equilibrium(scene: Scene, geometries: Geometries) -> bool:
    """Whether the first shape is the one at rest: as the scene says, or for a cable that is held at
    places which are nearer together or farther apart than it is long.
    """
    if scene.initial.shape != "auto":
        return scene.initial.shape == "equilibrium"
    if scene.is_net:
        strands = drawn(scene, geometries).values()
        return any(one.ring or _is_bent(one.scene, one.geometries) for one in strands)
    return _is_bent(scene, geometries)


def _is_bent(scene: Scene, geometries: Geometries) -> bool:
    """Whether a cable is held at places nearer together or farther apart than it is long."""
    for (begin, one), (end, other) in pairwise(held_places(scene, geometries)):
        gap = math.dist(other.attachment, one.attachment)
        if abs(gap - (end - begin)) > 1e-6 * (end - begin):
            return True
    return False


def _cause(scene: Scene, cable: Cable) -> str:
    """A line that says that no equilibrium was found, why, and what helps."""
    begin, model = "initial.shape: no equilibrium found", cable.model
    weight = scene.cable.mu * scene.cable.length + scene.start.mass + scene.end.mass
    pull = weight * np.array(scene.gravity) * model.has(GRAVITY)
    for load in scene.loads:
        pull = pull + np.array(load.force) * (load.signal == "constant")
    holders = [*scene.ends.values(), *(grasp for grasp in scene.grasps if grasp.taken)]
    for axis, name in enumerate("xyz"):
        if pull[axis] and not any(one.fixed[axis] or one.spring[axis] for one in holders):
            return (
                f"{begin}, since nothing holds the cable along {name}, where its weight and loads "
                f"pull with {pull[axis]:.3g} N; hold an end along {name} (end.fixed), or use "
                "straight"
            )
    if not model.has(ANY_STRETCH) and not inextensible(scene):
        return (
            f"{begin}, since nothing resists stretching; set terms.stretch to auto and give "
            "cable.axial_stiffness or cable.youngs_modulus"
        )
    wanted = resolved(scene.with_values({"discretization.control_points": 0}))[0]
    number = wanted.discretization.control_points
    if number > model.n:
        return (
            f"{begin} with {model.n} control points, too few for its bends; set "
            f"discretization.control_points to 0, which chooses {number}"
        )
    return f"{begin}; use straight, and let the cable come to rest"


def relax(
    cable: Cable,
    after_step: Callable[[], None] | None = None,
    rest: float = TOLERANCE,
    twist: bool = False,
    rolls: bool = False,
    across: Array | None = None,
    stride: float = np.inf,
) -> bool:
    """Move a cable to a nearby stable equilibrium at rest; true if it was reached.

    Damping plays no part, and sine loads are at their value at time zero. `after_step` may change
    the natural and plastic curvature after each step of the search, which then converges linearly.
    `rest` is the movement of a step [of the length, or rad] that counts as rest; `twist` and
    `rolls` are those of `relax_step`. `across` is a unit vector along which a guide hardly lets the
    cable move: there it is not in equilibrium. `stride` [m] is the longest move of a step.
    """
    cable.w[:] = 0.0
    search = _Search(cable, twist, rolls, across)
    pseudo = search.first
    least, stuck, ceiling, smooth, nudged = np.inf, 0, np.inf, 0, False
    progress = SLOW if after_step else FAST
    longest = MAX_STEPS + math.ceil(FALLS * cable.model.length / stride)
    for _ in range(TURNING_STEPS if rolls else longest):
        iterations, moved = search.step(pseudo, stride)
        if iterations == 0:
            ceiling, smooth = 0.7 * pseudo, 0
            pseudo *= 0.5
            continue
        if after_step:
            after_step()
        if pseudo >= search.patient:
            stuck = 0 if moved < progress * least else stuck + 1
            least = min(least, moved)
            rests = moved < rest or (moved < ROUND_OFF and stuck >= PATIENCE)
            if rests and search.stable():
                return True
            if rests and not nudged:  # a symmetric shape may be the top of a ridge
                _nudge(cable, across)
                nudged = True
        pseudo *= 10.0 if iterations <= 4 else 2.0 if iterations <= 7 else 0.7
        smooth += 1
        ceiling *= 1.2**smooth
        pseudo = min(pseudo, ceiling, 1e12 * search.patient)
    return False


def _nudge(cable: Cable, across: Array | None = None) -> None:
    """Move the spatial lines by a little that has no symmetry, and is the same for any knots: a
    cable that may buckle to either side goes to the same one whatever the resolution. Not along
    the unit vector `across`.
    """
    length, share = cable.model.length, cable.model.shares
    push = np.zeros_like(cable.x)
    for axis in range(len(cable.model.axes)):
        side = np.sin((2.0 + axis) * share + 0.7 * axis + 0.4)
        push[axis] = mass.multiply(cable.model.mass(0), side)
    if across is not None:
        push[: len(across)] -= across[:, None] * (across[:, None] * push[: len(across)]).sum(axis=0)
    way = cable.free_acceleration(push)
    cable.x[:] += NUDGE * length / max(np.abs(way).max(), 1e-300) * way


class _Search:
    """The steps of one search (`relax_step`) for the spatial lines, or with `twist` for all lines.

    Attributes:
        first: pseudo-time [s^2] in which the first guess moves by a percent of the length. patient:
            that of steps that see the whole stiffness, in which the cable falls by many times it.
    """

    def __init__(
        self, cable: Cable, twist: bool = False, rolls: bool = False, across: Array | None = None
    ) -> None:
        self._cable, model, dim = cable, cable.model, len(cable.model.axes)
        # At fixed twist the stiffness of a cable with a natural shape says little.
        self._unknown = model.has(MATERIAL) and not twist
        length, load = model.length, np.abs(cable.forces()[:dim])
        inertia = float(mass.multiply(model.mass(0), np.ones(model.n)).sum())
        fall = inertia * length / max(float((load * ~model.held_mask()[:dim]).sum()), TINY)
        self.first, self.patient = 0.01 * fall, 100.0 * fall
        guide = np.zeros((dim, dim))
        if across is not None:
            pull = math.hypot(*model.scene.gravity)
            guide += GUIDED * pull / length * np.outer(across, across)
        begun, anchors = cable.padded(cable.x), cable.anchors.copy()
        self._given = guide, begun, anchors, length, twist, rolls

    def step(self, pseudo: float, stride: float = np.inf) -> tuple[int, float]:
        """One backward Euler step in place; iterations (0: it did not converge, or went farther
        than the stride [m], and was undone) and the largest move.

        The move is a share of the length, or an angle [rad].
        """
        state = self._cable.state.copy()
        iterations, moved = self._cable.call(relax_step.relax_step, pseudo, *self._given)
        if moved * self._cable.model.length > stride:
            iterations = 0
        if iterations == 0:
            # The frames, too, which may hold no numbers where the correction was far too large.
            self._cable.state[:] = state
        return iterations, moved

    def stable(self, pseudo: float = 0.0) -> bool:
        """Whether the stiffness of the present shape is positive, up to round-off, or up to that of
        the mass over the pseudo-time [s^2].
        """
        given = pseudo or STEADY * self.patient, *self._given
        return self._unknown or bool(self._cable.call(relax_step.is_stable, *given))
