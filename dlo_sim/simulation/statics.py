"""The first shape of a cable: straight, an arc, or in static equilibrium under its loads.

`place` is the entry. The search for an equilibrium follows a way: it starts where the ends are easy
to reach, on a sagging arc between ends not nearer than EASY of the length of cable between them, on
the way from the straight cable to where the scene has them. It then moves and turns the ends along
that way, in steps that adapt themselves, and the cable is at rest under its loads after every step.
So where there are several equilibria, it finds the one that grippers reach that move together from
the straight cable: from an arc at the end of the way, 16 of 130 everyday scenes ended in another
one.

At each place of the way the cable descends from its first guess by backward Euler steps of the
gradient flow (`relax`),
    M (q1 - q0) / s = f(q1),
whose pseudo-time s grows as long as Newton's method converges, so that the descent ends in Newton's
method and does not stop at unstable shapes on the way.

A thin cable is up to a billion times stiffer along itself than across. A correction that turns it
stretches it in second order, and the tension which that seems to cause dwarfs all other forces: the
plain Newton method then crawls. So the tension of the tangent matrix is not that of the present
shape but that which the linear system itself predicted (the mixed iteration of Magisano, Leonetti &
Garcea 2017, Int. J. Numer. Meth. Eng. 109, 1237-1262): the same equations and the same solution,
found in a handful of iterations whatever the stiffness. (The guard of knot spans,
`engine.span_guard`, needs no such treatment: 700 everyday scenes took as many iterations.)

Twist and shape are solved for in turn. Where that fails, and for inextensible cables, dynamic
relaxation finds the equilibrium: steps in time with kinetic damping (Cundall 1976).
"""

from __future__ import annotations

import warnings
from collections.abc import Callable
from dataclasses import replace
from itertools import pairwise

import numpy as np
from numpy.typing import NDArray

from dlo_sim.core import bspline, mass, rotations
from dlo_sim.core.methods import METHODS
from dlo_sim.engine.arrays import (
    ANY_STRETCH,
    BISHOP,
    CONTACT,
    CURVED,
    GRAVITY,
    MATERIAL,
    PLASTICITY,
    SPAN_STRETCH,
)
from dlo_sim.methods import rattle
from dlo_sim.scene.description import Scene
from dlo_sim.scene.loading import SceneError
from dlo_sim.scene.needs import inextensible, needs_of
from dlo_sim.simulation.build_model import build_model
from dlo_sim.simulation.cable import Cable
from dlo_sim.simulation.ends import EndDrive
from dlo_sim.simulation.frequency import largest_frequency
from dlo_sim.simulation.geometry import Geometries, first_shape, held_places
from dlo_sim.simulation.obstacles import PLACES, check_outside
from dlo_sim.simulation.resolution import resolved
from dlo_sim.simulation.soundness import leaves_clamp_backwards, unexplained_stretch
from dlo_sim.simulation.stepper import Stepper

Array = NDArray[np.float64]
Lay = Callable[[], None]


EASY = 0.8  # distance of the ends, in lengths of the cable between them, where the search begins
STEPS = 2  # from there, unless more are needed
LEAST_STEP = 1e-3  # of the way
ROUGH = 1e-3  # of the length, movement that counts as rest on the way

MAX_STEPS = 400
MAX_ITERATIONS = 12
TOLERANCE = 1e-10  # of the cable's length, movement of a step that counts as rest
ROUND_OFF = 1e-6  # the same where steps do not shrink any more
FAST, SLOW = 0.5, 0.9  # movement that counts as progress, relative to the least so far
PATIENCE = 6  # steps without progress after which they do not
NUDGE = 1e-6  # of the length
STEADY = 1e5  # pseudo-time of the stiffness that must be positive at rest, in `_Search.patient`
CONVERGED = 1e-4  # last correction of a step, as a share of the step

MAX_ALTERNATIONS = 80
CONTRACTION = 0.7  # of the movement by one alternation, or the next ones turn half as far
DAMPED = 0.98  # of the movement by one of those, or the next ones turn half as far again
LEAST_SHARE = 0.03  # of the twist that the present shape asks for
TWIST_NUDGE = 1e-3  # [rad]
SETTLED = 1e-9  # movement by an alternation, relative to the length or 1 rad
NEAR = 1e-2  # of the twist, in radians, below which the search for the shape is a short one
RETURNED = 1e-2  # of the movement by the first alternation after a nudge

SHARE_OF_TIME = 0.01  # step of the dynamic relaxation, relative to `_time_scale`
LONGEST = 1.0  # [s], time scale of a cable without weight or stiffness
EXTENSIBLE = 1e-8, 5_000  # tolerance and most steps of the dynamic relaxation
INEXTENSIBLE = 1e-7, 40_000
RESTS = 3  # stops in a row within the tolerance
FREQUENCY = 6  # row of a load, after force and moment


def place(
    scene: Scene,
    geometries: Geometries,
    ends: EndDrive,
    cable: Cable,
    lay: Lay | None = None,
    near: Array | None = None,
) -> None:
    """Put a cable into the scene's first shape, at rest.

    Without equilibrium it is straight, or an arc where its ends are nearer than its length; or
    where the arc would leave a clamp backwards, the shape of grippers that moved together. Where
    the twist that a natural shape causes is not found, the cable is only placed close to rest, with
    a UserWarning.

    Args:
        lay: aligns the natural shape with the material frames of the present shape and lets plastic
            flow follow; None if there is neither.
        near: control points (n, 4); where the first shape is an equilibrium, it is the one nearest
            to these. Default: the one that grippers reach which move together.

    Raises:
        SceneError: no equilibrium was found, an inextensible cable cannot reach both ends, or the
            cable begins in an obstacle.
    """
    _FirstShape(scene, geometries, ends, cable, lay).place(near)


class _FirstShape:
    """The search for the first shape of one cable."""

    def __init__(
        self, scene: Scene, geometries: Geometries, ends: EndDrive, cable: Cable, lay: Lay | None
    ) -> None:
        self._scene, self._geometries = scene, geometries
        self._ends, self._cable, self._lay = ends, cable, lay
        self._flow = lay if cable.model.has(PLASTICITY) else None  # after each step of a search

    def place(self, near: Array | None) -> None:
        """See the function `place`."""
        scene, cable = self._scene, self._cable
        points = np.zeros((cable.model.n, 4))
        points[:, :3] = first_shape(scene, self._geometries, cable.model.knots)
        backwards = leaves_clamp_backwards(points, self._ends)
        resting = _wants_equilibrium(scene, self._geometries)
        searched = resting or backwards
        if near is not None and searched:
            points = near.copy()
        self._ends.put(points, 0.0, anew=True)
        cable.put(points, np.zeros_like(points), 0.0)
        if self._lay:
            self._lay()
        if resting and scene.terms.twist == "frenet":
            raise SceneError(
                "initial.shape: no equilibrium is available with terms.twist frenet; use straight"
            )
        if inextensible(scene):
            self._place_inextensible(resting)
        elif near is not None and searched and self._rests(1.0):
            self._twist()
        elif resting:
            self._find()
        elif backwards and scene.terms.twist != "frenet" and not self._follow():
            # An arc that is folded at a clamp would stay so, but no other shape was found.
            cable.put(points, np.zeros_like(points), 0.0)
        if self._lay:
            self._lay()
        points = cable.points
        self._check_obstacles(points[:, :3])
        cable.put(points, np.zeros_like(points))

    def _find(self) -> None:
        """Put an extensible cable into equilibrium, with its twist.

        Where the twist is not found, the cable is only placed close to rest, with a UserWarning.

        Raises:
            SceneError: none was found.
        """
        if not self._follow():
            raise SceneError(_cause(self._scene, self._cable))
        self._twist()

    def _twist(self) -> None:
        """Let the twist come into equilibrium, too, or warn."""
        cable = self._cable
        if not cable.model.has(BISHOP):
            relax_twist(cable)
        elif not self._with_twist():
            what = "natural shape causes" if cable.model.has(MATERIAL) else "moments cause"
            warnings.warn(
                f"initial.shape: the search for the twist that the {what} did not converge; the "
                "cable moves after the start: let it come to rest, or check cable.shear_modulus",
                stacklevel=2,
            )

    def _place_inextensible(self, resting: bool) -> None:
        """Bring a cable of constant length to that length, and with `resting` into equilibrium."""
        scene, cable = self._scene, self._cable
        if resting:
            self._relax_elastic_twin()
        if not cable.call(rattle.to_rest_length):
            apart = float(np.linalg.norm(cable.points[-1, :3] - cable.points[0, :3]))
            raise SceneError(
                "integrator.method: rattle keeps the cable at its length, "
                f"{scene.cable.length:.6g} m, which does not fit between its ends, {apart:.6g} m "
                "apart; move the ends or use energy_momentum and terms.stretch auto"
            )
        if resting:
            step = min(0.5 / max(largest_frequency(scene, cable), 1e-3), 5e-3)
            if not self._relax_in_time("rattle", step, *INEXTENSIBLE):
                raise SceneError(_cause(scene, cable))

    def _relax_elastic_twin(self) -> None:
        """Take over the equilibrium with the true axial stiffness, which is close to that of the
        inextensible cable.
        """
        cable = self._cable
        elastic = self._scene.with_values(
            {"integrator.method": "energy_momentum", "terms.stretch": "auto"}
        )
        origin = cable.model.origin
        twin = Cable(build_model(elastic, needs_of(elastic), self._geometries, origin))
        twin.inputs[:] = cable.inputs
        twin.point_grasps(0.0)
        if twin.anchors.size:
            twin.anchors[:] = cable.anchors
        points = cable.points
        twin.put(points, np.zeros_like(points))
        if twin.model.has(CURVED):
            twin.natural = cable.natural
        relax(twin)
        relax_twist(twin)
        cable.x[:] = twin.x
        cable.open_frame()

    def _check_obstacles(self, points: Array) -> None:
        """Refuse a cable that begins deeper in an obstacle than it is thick: it would be flung
        out.
        """
        scene, model = self._scene, self._cable.model
        if not model.has(CONTACT):
            return
        u = np.linspace(0.0, scene.cable.length, PLACES)
        line = bspline.evaluate(points, model.knots, u) + model.origin
        for obstacle in scene.bodies:
            check_outside(obstacle, scene.cable.diameter, u, line)

    # -- along the way of the ends, for the twist as it is ----------------------------------------

    def _follow(self) -> bool:
        """Whether an extensible cable came into equilibrium for the twist as it is, in the shape
        that grippers reach that move together from the straight cable.
        """
        way = _Way(self._scene, self._geometries, self._cable.model.axes)
        return any(self._follow_from(way, begin) for begin in (way.easy, 0.0))

    def _follow_from(self, way: _Way, begin: float) -> bool:
        """Whether the search from a share of the way on ended in equilibrium."""
        cable = self._cable
        points = np.zeros((cable.model.n, 4))
        points[:, :3] = first_shape(self._scene, way.at(begin), cable.model.knots)
        self._put_on(way, begin, points, anew=True)
        if not self._rests(begin):
            self._place_ends(way, 1.0)
            return False
        share, step = begin, (1.0 - begin) / STEPS
        shape = cable.points
        last: tuple[Array, float] | None = None  # changes of shape and share by the last step
        while share < 1.0:
            there = share + step if share + step < 1.0 - LEAST_STEP else 1.0
            guess = shape.copy()
            if last is None:
                u = bspline.greville(cable.model.knots)
                for axis in range(3):
                    guess[:, axis] -= (there - share) * np.interp(u, way.u, way.back[:, axis])
            else:
                guess += (there - share) / last[1] * last[0]
            before = cable.state.copy()
            self._put_on(way, there, guess)
            if self._rests(there):
                last = cable.points - shape, there - share
                share, shape = there, cable.points
                continue
            cable.state[:] = before
            last, step = None, 0.4 * step
            if step < LEAST_STEP:
                self._place_ends(way, 1.0)
                return False
        return True

    def _place_ends(self, way: _Way, share: float) -> None:
        """Put what holds the cable at a share of the way."""
        for name, geometry in way.at(share).items():
            self._ends.rest_at(name, geometry.position, geometry.orientation)
        self._cable.motion[:] = self._ends.motion
        self._ends.pull_springs(self._cable, 0.0)
        self._cable.point_grasps(0.0)

    def _put_on(self, way: _Way, share: float, points: Array, anew: bool = False) -> None:
        """Put the cable at rest at a share of the way."""
        self._place_ends(way, share)
        self._ends.put(points, 0.0, anew)
        self._cable.put(points, np.zeros_like(points), 0.0, follow=self._lay is None)
        if self._lay:
            self._lay()

    def _rests(self, share: float) -> bool:
        """Whether an equilibrium was found for the twist as it is, with plastic flow up to it at
        the end of the way, whose local stretch its tension explains.
        """
        cable = self._cable
        _nudge(cable)
        found = relax(cable, rest=ROUGH) if share < 1.0 else self._relax_with_flow()
        return found and not unexplained_stretch(cable.model, cable.points, self._ends)

    def _relax_with_flow(self) -> bool:
        """`relax` with plastic flow. Where that fails, as for stiff wires, with the flow up to the
        first guess and a UserWarning.
        """
        begin = self._cable.state.copy()
        if relax(self._cable, self._flow):
            return True
        self._cable.state[:] = begin
        if self._flow is None or not relax(self._cable):
            return False
        warnings.warn(
            "initial.shape: the search with plastic flow did not converge; the cable moves after "
            "the start: let it come to rest, or raise plasticity.hardening",
            stacklevel=2,
        )
        return True

    # -- with the twist that acts on the shape ----------------------------------------------------

    def _with_twist(self) -> bool:
        """Whether shape and twist that acts on the shape are in stable equilibrium together: found
        by solving for them in turn, or else by steps in time. Where both fail, the cable has the
        shape of the last search that succeeded.
        """
        cable = self._cable
        before = cable.state.copy()
        if self._in_turn():
            return True
        alternated = cable.state.copy()
        cable.state[:] = before
        _nudge_twist(cable)
        self._stop()
        step = SHARE_OF_TIME * _time_scale(self._scene)
        if self._relax_in_time("energy_momentum", step, *EXTENSIBLE):
            return True
        cable.state[:] = alternated
        return False

    def _in_turn(self) -> bool:
        """Solve in turn for the twist and for the shape; whether that converged. The state is that
        of the last search that succeeded.

        A cable whose natural shape turns it about its own axis may be at the top of a ridge, which
        is not seen in the stiffness at fixed twist: it is nudged once, and must come near the shape
        before, which is then taken, or find another one.
        """
        cable = self._cable
        last, found, share = np.inf, cable.state.copy(), 1.0
        nudged, at_rest, first = not cable.model.has(MATERIAL), None, 0.0
        for _ in range(MAX_ALTERNATIONS):
            before = cable.x.copy()
            if not relax_twist(cable):
                return self._lay is None
            if self._lay is None and _relative_movement(cable, before) < SETTLED:
                return True
            cable.x[-1] = before[-1] + share * (cable.x[-1] - before[-1])
            near = _relative_movement(cable, before) < NEAR
            self._stop()
            if not relax(cable, self._flow, near=near):
                break
            moved = _relative_movement(cable, before) / share
            if moved < SETTLED and nudged:
                return True
            if moved < SETTLED:
                nudged, last, found = True, np.inf, cable.state.copy()
                at_rest, rest = found, cable.x.copy()
                _nudge_twist(cable)
                self._stop()
                continue
            if at_rest is not None:  # nudged
                first = first or moved
                shrinking = moved < min(CONTRACTION * last, RETURNED * first)
                if shrinking and _relative_movement(cable, rest) < first:
                    cable.state[:] = at_rest
                    return True
            if moved > (CONTRACTION if share == 1.0 else DAMPED) * last:
                share *= 0.5
                if share < LEAST_SHARE:
                    break
            last, found = moved, cable.state.copy()
        cable.state[:] = found
        return False

    def _stop(self) -> None:
        """Take the velocity away, with the ends where they are held."""
        points = self._cable.points
        self._ends.put(points, 0.0)
        self._cable.put(points, np.zeros_like(points))
        if self._lay:
            self._lay()

    # -- by steps in time -------------------------------------------------------------------------

    def _relax_in_time(self, method: str, step: float, tolerance: float, max_steps: int) -> bool:
        """Let the cable come to rest from its present shape; whether it did. Sine loads are left
        out.

        Whenever the kinetic energy falls, the velocity is taken away, until the cable moves by less
        than `tolerance` [of the length, or of 1 rad] between two stops RESTS times in a row. Where
        it does not within `max_steps` steps of `step` [s], it is left as it was.
        """
        cable = self._cable
        stepper = Stepper(self._scene, cable, METHODS[method], step)
        state, inputs = cable.state.copy(), cable.inputs.copy()
        peak, still = 0.0, 0
        try:
            if cable.loads.size:
                cable.loads[cable.loads[:, FREQUENCY] > 0.0, :FREQUENCY] = 0.0
            self._stop()
            cable.open_account(self._scene)
            resting = cable.x.copy()
            for _ in range(max_steps):
                if not stepper.run(0, 1).status.ok:
                    break
                kinetic = cable.kinetic()
                if kinetic > peak:
                    peak = kinetic
                    continue
                self._stop()
                cable.open_account(self._scene)
                still = still + 1 if _relative_movement(cable, resting) < tolerance else 0
                if still == RESTS:
                    return True
                resting[:] = cable.x
                peak = 0.0
        finally:
            cable.inputs[:] = inputs
        cable.state[:] = state
        return False


class _Way:
    """The way of everything that holds the cable, from where it is straight and unstressed (share
    0) to where the scene has it (share 1): positions move straight, tangents turn the shortest way.

    The straight cable points from the first to the last held point; if they coincide, as the
    tangents do on average; if only one point is held, along gravity.

    Attributes:
        u: material coordinates of the held points [m], shape (places,). back: from where they are
            at share 1 to share 0 [m], shape (places, 3).
        easy: the largest share at which the ends are easy to reach.
    """

    def __init__(self, scene: Scene, geometries: Geometries, axes: tuple[int, ...]) -> None:
        self._scene, self._geometries, self._axes = scene, geometries, axes
        self._places = held_places(scene, geometries)
        self.u = np.array([u for u, _ in self._places])
        direction = self._direction()
        at = np.array([geometry.attachment for _, geometry in self._places])
        line = np.outer(self.u, direction)
        self.back = line - line.mean(axis=0) - (at - at.mean(axis=0))
        self._turns = {
            name: self._turn(direction, rotations.rotate(geometry.orientation, geometry.tangent))
            for name, geometry in geometries.items()
            if geometry.u is not None
        }
        self.easy = self._easy()

    def at(self, share: float) -> Geometries:
        """What holds the cable at a share of the way."""
        moved = dict(self._geometries)
        back = {geometry.u: way for (_, geometry), way in zip(self._places, self.back, strict=True)}
        for name, turn in self._turns.items() if share < 1.0 else ():
            geo = self._geometries[name]
            orientation = rotations.multiply(
                rotations.from_rotation_vector((share - 1.0) * turn), geo.orientation
            )
            shift = (1.0 - share) * back.get(geo.u, np.zeros(3))
            arm = rotations.rotate(
                rotations.conjugate(geo.orientation), geo.attachment - geo.position
            )
            attachment = geo.attachment + shift
            position = attachment - rotations.rotate(orientation, arm)
            moved[name] = replace(
                geo, position=position, orientation=orientation, attachment=attachment
            )
        return moved

    def _easy(self) -> float:
        share = 1.0
        for k, ((begin, one), (end, other)) in enumerate(pairwise(self._places)):
            gap, back = other.attachment - one.attachment, self.back[k + 1] - self.back[k]
            # |gap + (1 - share) back| = EASY (end - begin)
            a, b = back @ back, gap @ back
            c = gap @ gap - (EASY * (end - begin)) ** 2
            if c < 0.0:
                share = min(share, 1.0 - float((np.sqrt(b * b - a * c) - b) / a))
        return share

    def _direction(self) -> Array:
        length, (_, first), (_, last) = self._scene.cable.length, self._places[0], self._places[-1]
        along = [rotations.rotate(geo.orientation, geo.tangent) for _, geo in self._places]
        tangents = np.sum(along, axis=0)
        gravity = np.array(self._scene.gravity)
        choices = [last.attachment - first.attachment, tangents, gravity, np.array([1.0, 0.0, 0.0])]
        if len(self._places) == 1:
            choices = choices[2:1:-1] + choices[1:2]
        for choice in choices:
            size = float(np.linalg.norm(choice))
            if size > 1e-6 * length:
                return np.asarray(choice / size)
        return choices[-1]

    def _turn(self, direction: Array, tangent: Array) -> Array:
        """Rotation vector from the direction of the straight cable to a tangent. Opposite ones turn
        in the plane of the motion, or in the vertical one.
        """
        axis = np.cross(direction, tangent)
        angle = float(np.arctan2(np.linalg.norm(axis), direction @ tangent))
        if np.linalg.norm(axis) < 1e-9:
            missing = [k for k in range(3) if k not in self._axes]
            axis = np.eye(3)[missing[0]] if missing else np.cross(self._scene.gravity, direction)
            if np.linalg.norm(axis) < 1e-9:
                axis = np.cross(direction, np.eye(3)[np.argmin(np.abs(direction))])
        return np.asarray(axis * (angle / np.linalg.norm(axis)))


def _wants_equilibrium(scene: Scene, geometries: Geometries) -> bool:
    """Whether the first shape is the one at rest: as the scene says, or for a cable that is held at
    places which are nearer together or farther apart than it is long.
    """
    if scene.initial.shape != "auto":
        return scene.initial.shape == "equilibrium"
    for (begin, one), (end, other) in pairwise(held_places(scene, geometries)):
        gap = float(np.linalg.norm(other.attachment - one.attachment))
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
    near: bool = False,
) -> bool:
    """Move a cable to a nearby stable equilibrium at rest; true if it was reached.

    Damping plays no part, and sine loads are at their value at time zero. The twist stays as
    it is: `relax_twist` solves for it. `after_step` may change the natural and plastic curvature
    after each step of the search, which then converges linearly.
    `rest` is the movement of a step [of the length] that counts as rest; `near` says that the cable
    is almost there, so that the first steps may be long.
    """
    search = _Search(cable)
    cable.w[:] = 0.0
    pseudo = search.first_step()
    if near:
        pseudo = search.patient
    least, stuck, ceiling, smooth, rests, nudged = np.inf, 0, np.inf, 0, False, False
    progress = SLOW if after_step else FAST
    for _ in range(MAX_STEPS):
        iterations, moved = search.step(pseudo)
        if iterations == 0:
            ceiling, smooth = 0.5 * pseudo, 0
            pseudo *= 0.25
            continue
        if after_step:
            after_step()
        rests = False
        if pseudo >= search.patient:
            stuck = 0 if moved < progress * least else stuck + 1
            least = min(least, moved)
            rests = moved < rest or (moved < ROUND_OFF and stuck >= PATIENCE)
            if rests and search.stable():
                return True
            if rests and not nudged:  # a symmetric shape may be the top of a ridge
                _nudge(cable)
                nudged = True
        pseudo *= 10.0 if iterations <= 4 else 2.0 if iterations <= 7 else 0.7
        smooth += 1
        ceiling *= 1.2**smooth
        pseudo = min(pseudo, ceiling, 1e12 * search.patient)
    return rests


def relax_twist(cable: Cable) -> bool:
    """One linear solution for the twist line at the present shape; false where nothing holds the
    twist: the cable keeps the one it has. With a natural shape in the material frame it is a step
    of a fixed-point iteration.
    """
    model = cable.model
    if not model.twist:
        return False
    free = ~model.held_mask()[-1]
    if free.all() and not model.holding.roll_springs:
        return False
    stiffness = mass.dense(model.twisting_stiffness)[np.ix_(free, free)]
    cable.x[-1][free] += np.linalg.solve(stiffness, cable.forces()[-1][free])
    return True


def _nudge(cable: Cable) -> None:
    """Move the spatial lines by a little that has no symmetry, and is the same for any knots: a
    cable that may buckle to either side goes to the same one whatever the resolution.
    """
    length = float(cable.model.knots[-1])
    share = bspline.greville(cable.model.knots) / length
    push = np.zeros_like(cable.x)
    for axis in range(len(cable.model.axes)):
        side = np.sin((2.0 + axis) * share + 0.7 * axis + 0.4)
        push[axis] = mass.multiply(cable.model.mass(0), side)
    way = cable.free_acceleration(push)
    cable.x[:] += NUDGE * length / max(np.abs(way).max(), 1e-300) * way


def _nudge_twist(cable: Cable) -> None:
    """Turn a cable whose natural shape is in the material frame by up to TWIST_NUDGE about its own
    axis, by a different angle everywhere.
    """
    if not cable.model.has(MATERIAL):
        return
    free = ~cable.model.held_mask()[-1]
    along = bspline.greville(cable.model.knots) / cable.model.knots[-1]
    cable.x[-1][free] += TWIST_NUDGE * np.sin(2.0 * along + 0.5)[free]


def _relative_movement(cable: Cable, before: Array) -> float:
    """Largest movement from configuration `before`, relative to the length or 1 rad."""
    moved = np.abs(cable.x - before).max(axis=1)
    dim = len(cable.model.axes)
    return float(max(moved[:dim].max() / cable.model.knots[-1], moved[dim:].max(initial=0.0)))


def _time_scale(scene: Scene) -> float:
    """1 / hypot of the rates sqrt(g / L) and sqrt(EI / mu) / L^2 [s], at most LONGEST."""
    cable = scene.cable
    bending = np.sqrt(cable.EI / cable.mu) / cable.length**2
    swinging = np.sqrt(float(np.linalg.norm(scene.gravity)) / cable.length)
    return 1.0 / max(float(np.hypot(bending, swinging)), 1.0 / LONGEST)


class _Search:
    """The spatial rows of one search.

    Attributes:
        patient: pseudo-time [s^2] of steps that see the whole stiffness: the cable falls by many
            times its length meanwhile.
    """

    def __init__(self, cable: Cable) -> None:
        self._cable, model = cable, cable.model
        self._dim = len(model.axes)
        self._length = float(model.knots[-1])
        self._spans = np.arange(model.n - bspline.DEGREE)[:, None] + np.arange(bspline.ACTIVE)
        spans = np.diff(bspline.breaks(model.knots))[:, None]
        self._xi, self._shares = model.rule.xi, model.rule.weights / spans
        derivative = bspline.span_polynomials(model.knots)[:, :, 1:] * np.array([1.0, 2.0, 3.0])
        derivative *= (2.0 / spans)[..., None]
        powers = self._xi[..., None] ** np.arange(3)
        self._slopes = np.einsum("skp,sjp->sjk", derivative, powers)  # r' = slopes points
        self._dyads = np.einsum("sja,sjb->sjab", self._slopes, self._slopes)
        self._by_span = model.has(SPAN_STRETCH)
        self._linear = np.zeros((len(spans), 1))
        self._linear[[0, -1]] = 3.0
        axial = model.axial_stiffness if model.has(ANY_STRETCH) else 0.0
        self._half_stiffness = 0.5 * axial * model.rule.weights
        self.patient = 0.0

    def first_step(self) -> float:
        """Pseudo-time [s^2] in which the first guess moves by a percent of the length."""
        model = self._cable.model
        free = ~model.held_mask()[: self._dim]
        pull = float(np.abs(self._cable.forces()[: self._dim] * free).sum())
        inertia = float(mass.multiply(model.mass(0), np.ones(model.n)).sum())
        fall = inertia * self._length / max(pull, 1e-300)
        self.patient = 100.0 * fall
        return 0.01 * fall

    def step(self, pseudo: float) -> tuple[int, float]:
        """One backward Euler step in place; iterations (0: not converged) and the largest move.

        The move is a share of the length.
        """
        dim = self._dim
        x, state = self._cable.x, self._cable.state.copy()
        before = x.copy()
        tangents = self._tangents()
        stress = lead = self._stress(tangents)
        for iteration in range(1, MAX_ITERATIONS + 1):
            change = self._correction(before, pseudo, lead - stress)
            if change is None:
                break
            x[:dim] += change
            moved = np.abs(x[:dim] - before[:dim]).max()
            largest = np.abs(change).max()
            if not moved < 1e3 * self._length:
                break
            before_it, tangents = tangents, self._tangents()
            lead = stress + self._predicted(before_it, tangents - before_it)
            stress = self._stress(tangents)
            if largest <= CONVERGED * moved or largest < 1e-12 * self._length:
                return iteration, float(moved / self._length)
        # The frames, too, which may hold no numbers where the correction was far too large.
        self._cable.state[:] = state
        return 0, 0.0

    def stable(self) -> bool:
        """Whether the stiffness of the present shape is positive, up to round-off. That of a cable
        with a natural shape at fixed twist says little: `_in_turn` tries it.
        """
        if self._cable.model.has(MATERIAL):
            return True
        nothing = np.zeros(self._dyads.shape[:2])
        return self._correction(self._cable.x, STEADY * self.patient, nothing) is not None

    def _tangents(self) -> Array:
        """r' at the samples of every span, shape (spans, samples, dim)."""
        return np.einsum("sjk,dsk->sjd", self._slopes, self._cable.x[: self._dim][:, self._spans])

    def _stress(self, tangents: Array) -> Array:
        """Half the tension over |r'|, w EA/2 eps / |r'|, at every sample, shape (spans, samples):
        the derivative of the energy by r' . r'.
        """
        size = np.sqrt(np.einsum("sjd,sjd->sj", tangents, tangents))
        return self._half_stiffness * self._counted(size - 1.0) / size

    def _predicted(self, tangents: Array, moved: Array) -> Array:
        """Change of the stress with that of the tangents, to first order."""
        size = np.sqrt(np.einsum("sjd,sjd->sj", tangents, tangents))
        strained = np.einsum("sjd,sjd->sj", tangents, moved) / size
        change = self._counted(strained) - self._counted(size - 1.0) * strained / size
        return self._half_stiffness * change / size

    def _counted(self, strain: Array) -> Array:
        """The strain that counts at the samples: itself or its projection of `span_stretch`."""
        if not self._by_span:
            return strain
        mean = (self._shares * strain).sum(axis=1, keepdims=True)
        slope = (self._shares * self._xi * strain).sum(axis=1, keepdims=True)
        return np.asarray(mean + self._linear * self._xi * slope)

    def _correction(self, before: Array, pseudo: float, extra: Array) -> Array | None:
        """Newton correction of the spatial lines, shape (dim, n); None where it leads uphill."""
        cable, dim = self._cable, self._dim
        n, x = cable.model.n, cable.x
        cable.follow()
        cable.open_frame()  # the shape is found without twist
        force = cable.forces()
        band = cable.stiffness()
        if cable.loads.size and cable.loads[:, 3:6].any():
            cable.add_moment_stiffness()
        half = 4 * dim - 1
        blocks = 2.0 * np.einsum("sj,sjab->sab", extra, self._dyads)
        inertia = cable.model.mass(0)
        moved = np.stack([mass.multiply(inertia, x[d] - before[d]) for d in range(dim)], axis=1)
        unknowns = (force[:dim].T - moved / pseudo).ravel()
        # Row i dim + d of the matrix belongs to coordinate d of control point i.
        by_point = band.reshape(n, dim, -1)
        for i in range(4):
            for k in range(4):
                by_point[i : i + n - 3, :, half + (k - i) * dim] += blocks[:, i, k, None]
        for k in range(4):
            diagonal = inertia[k, : n - k, None] / pseudo
            by_point[: n - k, :, half + k * dim] += diagonal
            if k:
                by_point[k:, :, half - k * dim] += diagonal
        if cable.solve_held(unknowns) != 0 or not np.isfinite(unknowns).all():
            return None
        return unknowns.reshape(n, dim).T
