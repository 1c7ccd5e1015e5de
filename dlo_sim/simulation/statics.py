"""Static equilibrium of a scene, for its first shape.

`find` starts where the ends are easy to reach: on a sagging arc between ends not nearer than EASY
of the length of cable between them, on the way from the straight cable to where the scene has them.
It then moves and turns the ends along that way, in steps that adapt themselves. So the shape is the
one that grippers reach that move together from the straight cable, where there are several: from
an arc at the end of the way, 16 of 130 everyday scenes ended in another one. The cable is at rest
under its loads after every step of the way.

The cable descends from its first guess by backward Euler steps of the gradient flow,
    M (q1 - q0) / s = f(q1),
whose pseudo-time s grows as long as Newton's method converges, so that the descent ends in Newton's
method and does not stop at unstable shapes on the way.

A thin cable is up to a billion times stiffer along itself than across. A correction that turns it
stretches it in second order, and the tension which that seems to cause dwarfs all other forces: the
plain Newton method then crawls. So the tension of the tangent matrix, and the stress of the guard
of knot spans (`terms.span_guard`), are not those of the present shape but those that the linear
system itself predicted (the mixed iteration of Magisano, Leonetti & Garcea 2017, Int. J. Numer.
Meth. Eng. 109, 1237-1262): the same equations and the same solution, found in a handful of
iterations whatever the stiffness.

Twist and shape are solved for in turn, or else by steps in time (`dynamic_relaxation`), as are the
shapes of inextensible cables.
"""

from __future__ import annotations

import warnings
from collections.abc import Callable, Iterator
from dataclasses import replace
from itertools import pairwise

import numpy as np
from numpy.typing import NDArray

from dlo_sim.core import bspline, mass, rotations
from dlo_sim.core.methods import METHODS
from dlo_sim.engine.arrays import (
    ANY_STRETCH,
    BISHOP,
    GRAVITY,
    MATERIAL,
    PLASTICITY,
    SPAN_STRETCH,
)
from dlo_sim.scene.description import Scene
from dlo_sim.scene.loading import SceneError
from dlo_sim.scene.needs import inextensible
from dlo_sim.simulation.cable import Cable
from dlo_sim.simulation.dynamic_relaxation import relative_movement, relax_in_time
from dlo_sim.simulation.ends import EndDrive
from dlo_sim.simulation.frequency import largest_frequency
from dlo_sim.simulation.geometry import Geometries, first_shape, held_places
from dlo_sim.simulation.resolution import resolved
from dlo_sim.simulation.soundness import unexplained_stretch
from dlo_sim.simulation.stepper import Stepper
from dlo_sim.terms import span_guard

Array = NDArray[np.float64]
FORMS = np.array(span_guard.FORMS)[:, [0, 1, 2, 1, 3, 4, 2, 4, 5]].reshape(-1, 3, 3)
WEIGHTS = np.array(span_guard.WEIGHTS)
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

SHARE_OF_TIME = 0.01  # step of the relaxation in time, relative to `_time_scale`
LONGEST = 1.0  # [s], time scale of a cable without weight or stiffness
EXTENSIBLE = 1e-8, 5_000  # tolerance and most steps of `relax_in_time`
INEXTENSIBLE = 1e-7, 40_000
MAX_ALTERNATIONS = 80
CONTRACTION = 0.7  # of the movement by one alternation, or the next ones turn half as far
DAMPED = 0.98  # of the movement by one of those, or the next ones turn half as far again
LEAST_SHARE = 0.03  # of the twist that the present shape asks for
TWIST_NUDGE = 1e-3  # [rad]
SETTLED = 1e-9  # movement by an alternation, relative to the length or 1 rad


def find(
    scene: Scene, geometries: Geometries, ends: EndDrive, cable: Cable, lay: Lay | None
) -> None:
    """Put an extensible cable into equilibrium, with its twist. `lay` aligns the natural shape with
    the present shape and lets plastic flow follow; None if there is neither.

    Where the twist is not found, the cable is only placed close to rest, with a UserWarning.

    Raises:
        SceneError: none was found.
    """
    if not follow(scene, geometries, ends, cable, lay):
        raise SceneError(cause(scene, cable))
    if not cable.model.has(BISHOP):
        relax_twist(cable)
    elif not _with_twist(scene, ends, cable, lay):
        what = "natural shape causes" if cable.model.has(MATERIAL) else "moments cause"
        warnings.warn(
            f"initial.shape: the search for the twist that the {what} did not converge; the cable "
            "moves after the start: let it come to rest, or check cable.shear_modulus",
            stacklevel=2,
        )


def follow(
    scene: Scene, geometries: Geometries, ends: EndDrive, cable: Cable, lay: Lay | None
) -> bool:
    """Whether an extensible cable came into equilibrium for the twist as it is, in the shape that
    grippers reach that move together from the straight cable.
    """
    way = _Way(scene, geometries, ends, cable, lay)
    return any(way.follow(begin) for begin in way.beginnings())


def find_inextensible(scene: Scene, ends: EndDrive, cable: Cable, lay: Lay | None) -> bool:
    """Whether a cable of constant length came to rest by steps in time."""
    step = min(0.5 / max(largest_frequency(scene, cable), 1e-3), 5e-3)
    steps = Stepper(scene, cable, METHODS["rattle"], step)
    return relax_in_time(cable, steps, lambda: _stop(scene, ends, cable, lay), *INEXTENSIBLE)


class _Way:
    """The way of everything that holds the cable, from where it is straight and unstressed (share
    0) to where the scene has it (share 1): positions move straight, tangents turn the shortest way.

    The straight cable points from the first to the last held point; if they coincide, as the
    tangents do on average; if only one point is held, along gravity.
    """

    def __init__(
        self, scene: Scene, geometries: Geometries, ends: EndDrive, cable: Cable, lay: Lay | None
    ) -> None:
        self._scene, self._ends, self._cable, self._lay = scene, ends, cable, lay
        self._geometries = geometries
        self._places = held_places(scene, geometries)
        self._u = np.array([u for u, _ in self._places])
        held = {name: geo for name, geo in geometries.items() if geo.u is not None}
        direction = self._direction()
        at = np.array([geo.attachment for _, geo in self._places])
        line = np.outer(self._u, direction)
        self._back = line - line.mean(axis=0) - (at - at.mean(axis=0))  # from share 1 to share 0
        self._turns = {
            name: self._turn(direction, rotations.rotate(geo.orientation, geo.tangent))
            for name, geo in held.items()
        }

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
            missing = [k for k in range(3) if k not in self._cable.model.axes]
            least = np.eye(3)[np.argmin(np.abs(direction))]
            axis = np.eye(3)[missing[0]] if missing else np.cross(self._scene.gravity, direction)
            if np.linalg.norm(axis) < 1e-9:
                axis = np.cross(direction, least)
        return np.asarray(axis * (angle / np.linalg.norm(axis)))

    def beginnings(self) -> Iterator[float]:
        """Shares of the way from which to search: the farthest that is easy, then the straight
        cable.
        """
        share = 1.0
        for k, ((begin, one), (end, other)) in enumerate(pairwise(self._places)):
            gap, back = other.attachment - one.attachment, self._back[k + 1] - self._back[k]
            # |gap + (1 - share) back| = EASY (end - begin)
            a, b = back @ back, gap @ back
            c = gap @ gap - (EASY * (end - begin)) ** 2
            if c < 0.0:
                share = min(share, 1.0 - float((np.sqrt(b * b - a * c) - b) / a))
        yield share
        yield 0.0

    def follow(self, begin: float) -> bool:
        """Whether the search from a share of the way on ended in equilibrium."""
        points = np.zeros((self._cable.model.n, 4))
        knots = self._cable.model.knots
        points[:, :3] = first_shape(self._scene, self._at(begin), knots)
        self._put(points, begin, anew=True)
        if not self._rests(begin):
            self._place(1.0)
            return False
        share, step = begin, (1.0 - begin) / STEPS
        path = [(share, self._cable.points)]
        while share < 1.0:
            there = share + step if share + step < 1.0 - LEAST_STEP else 1.0
            before = self._cable.state.copy()
            self._put(self._predicted(path, there), there)
            if self._rests(there):
                path = [path[-1], (there, self._cable.points)]
                share = there
                continue
            self._cable.state[:] = before
            path, step = path[-1:], 0.4 * step
            if step < LEAST_STEP:
                self._place(1.0)
                return False
        return True

    def _predicted(self, path: list[tuple[float, Array]], share: float) -> Array:
        """Control points at a share of the way: a line through the last two, or the last shape with
        the displacement of the held points interpolated along the cable.
        """
        (last, shape), (former, earlier) = path[-1], path[0]
        points = shape.copy()
        if former < last:
            points += (share - last) / (last - former) * (shape - earlier)
        else:
            u = bspline.greville(self._cable.model.knots)
            for axis in range(3):
                points[:, axis] -= (share - last) * np.interp(u, self._u, self._back[:, axis])
        return points

    def _at(self, share: float) -> Geometries:
        """What holds the cable at a share of the way."""
        moved = dict(self._geometries)
        back = {geo.u: way for (_, geo), way in zip(self._places, self._back, strict=True)}
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

    def _place(self, share: float) -> None:
        """Put what holds the cable at a share of the way."""
        for name, geometry in self._at(share).items():
            self._ends.rest_at(name, geometry.position, geometry.orientation)
        self._cable.motion[:] = self._ends.motion
        self._ends.pull_springs(self._cable, 0.0)
        self._cable.point_grasps(0.0)

    def _put(self, points: Array, share: float, anew: bool = False) -> None:
        """Put the cable at rest at a share of the way."""
        self._place(share)
        self._ends.put(points, 0.0, anew)
        self._cable.put(points, np.zeros_like(points), 0.0, follow=self._lay is None)
        if self._lay:
            self._lay()

    def _rests(self, share: float) -> bool:
        """Whether an equilibrium was found for the twist as it is, with plastic flow up to it
        (`_relax_with_flow`) at the end of the way, whose local stretch its tension explains.
        """
        _nudge(self._cable)
        if share < 1.0:
            found = relax(self._cable, rest=ROUGH)
        else:
            found = _relax_with_flow(self._cable, self._lay)
        return found and not unexplained_stretch(self._cable.model, self._cable.points, self._ends)


def cause(scene: Scene, cable: Cable) -> str:
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


def _relax_with_flow(cable: Cable, lay: Lay | None) -> bool:
    """Whether an equilibrium was found for the twist as it is, with plastic flow up to it. Where
    the search with flow fails, as for stiff wires, with the flow up to the first guess and a
    UserWarning.
    """
    begin = cable.state.copy()
    flow = _flow(cable, lay)
    if relax(cable, flow):
        return True
    cable.state[:] = begin
    if flow is None or not relax(cable):
        return False
    warnings.warn(
        "initial.shape: the search with plastic flow did not converge; the cable moves after the "
        "start: let it come to rest, or raise plasticity.hardening",
        stacklevel=2,
    )
    return True


def relax(
    cable: Cable, after_step: Callable[[], None] | None = None, rest: float = TOLERANCE
) -> bool:
    """Move a cable to a nearby stable equilibrium at rest; true if it was reached.

    Damping plays no part, and sine loads are at their value at time zero. The twist stays as
    it is: `relax_twist` solves for it. `after_step` may change the natural and plastic curvature
    after each step of the search, which then converges linearly.
    `rest` is the movement of a step [of the length] that counts as rest.
    """
    search = _Search(cable)
    cable.w[:] = 0.0
    pseudo = search.first_step()
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
    if free.all() and not any(spring.point.twist for spring in model.holding.springs):
        return False
    stiffness = mass.dense(model.twisting_stiffness)[np.ix_(free, free)]
    cable.x[-1][free] += np.linalg.solve(stiffness, cable.forces()[-1][free])
    return True


def _with_twist(scene: Scene, ends: EndDrive, cable: Cable, lay: Lay | None) -> bool:
    """Whether shape and twist that acts on the shape are in stable equilibrium together: found by
    solving for them in turn, or else by steps in time. Where both fail, the cable has the shape of
    the last search that succeeded.
    """
    before = cable.state.copy()
    if _in_turn(ends, cable, lay):
        return True
    alternated = cable.state.copy()
    cable.state[:] = before
    _nudge_twist(cable)
    _put(ends, cable, lay)
    step = SHARE_OF_TIME * _time_scale(scene)
    steps = Stepper(scene, cable, METHODS["energy_momentum"], step)
    if relax_in_time(cable, steps, lambda: _stop(scene, ends, cable, lay), *EXTENSIBLE):
        return True
    cable.state[:] = alternated
    return False


def _in_turn(ends: EndDrive, cable: Cable, lay: Lay | None) -> bool:
    """Solve in turn for the twist and for the shape; whether that converged. The state is that of
    the last search that succeeded.

    A cable whose natural shape turns it about its own axis may be at the top of a ridge, which is
    not seen in the stiffness at fixed twist: it is nudged once, and must come back or find another
    shape.
    """
    last, found, share = np.inf, cable.state.copy(), 1.0
    nudged = not cable.model.has(MATERIAL)
    for _ in range(MAX_ALTERNATIONS):
        before = cable.x.copy()
        if not relax_twist(cable):
            return lay is None
        if lay is None and relative_movement(cable, before) < SETTLED:
            return True
        cable.x[-1] = before[-1] + share * (cable.x[-1] - before[-1])
        _put(ends, cable, lay)
        if not relax(cable, _flow(cable, lay)):
            break
        moved = relative_movement(cable, before) / share
        if moved < SETTLED and nudged:
            return True
        if moved < SETTLED:
            nudged, last, found = True, np.inf, cable.state.copy()
            _nudge_twist(cable)
            _put(ends, cable, lay)
            continue
        if moved > (CONTRACTION if share == 1.0 else DAMPED) * last:
            share *= 0.5
            if share < LEAST_SHARE:
                break
        last, found = moved, cable.state.copy()
    cable.state[:] = found
    return False


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


def _flow(cable: Cable, lay: Lay | None) -> Lay | None:
    """What a search does after each step."""
    return lay if cable.model.has(PLASTICITY) else None


def _put(ends: EndDrive, cable: Cable, lay: Lay | None) -> None:
    """Put the cable at rest, with its ends where they are held."""
    points = cable.points
    ends.put(points, 0.0)
    cable.put(points, np.zeros_like(points))
    if lay:
        lay()


def _stop(scene: Scene, ends: EndDrive, cable: Cable, lay: Lay | None) -> None:
    """Take the velocity away, and open a new energy account."""
    _put(ends, cable, lay)
    cable.open_account(scene)


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
        self._ends = bspline.breaks(model.knots)
        self._xi, self._weights = model.rule.xi, model.rule.weights
        spans = len(self._ends) - 1
        self._spans = np.arange(spans)[:, None] + np.arange(4)
        polynomials = bspline.span_polynomials(model.knots)
        powers = self._xi[..., None] ** np.arange(3)
        own = polynomials[:, :, 1:] * np.array([1.0, 2.0, 3.0])
        self._own = own * (2.0 / np.diff(self._ends))[:, None, None]  # r' = sum q own (1, xi, xi^2)
        self._slopes = np.einsum("skp,sjp->sjk", self._own, powers)
        self._by_span = model.has(SPAN_STRETCH)
        self._linear = np.zeros((spans, 1))
        self._linear[[0, -1]] = 3.0
        axial = model.axial_stiffness if model.has(ANY_STRETCH) else 0.0
        self._half_stiffness = 0.5 * axial * self._weights
        strengths = span_guard.STRENGTH * self._by_span, span_guard.LENGTH_STRENGTH
        self._guard = axial * np.outer(np.diff(self._ends), strengths)
        dyads = [
            np.einsum("sja,sjb->sjab", self._slopes, self._slopes),
            np.einsum("sak,fkl,sbl->sfab", self._own, FORMS, self._own),
        ]
        self._dyads = np.concatenate(dyads, axis=1).reshape(spans, -1, 16)
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
        place = self._place()
        stress = self._stress(*place)
        lead = stress
        for iteration in range(1, MAX_ITERATIONS + 1):
            change = self._correction(before, pseudo, lead - stress)
            if change is None:
                break
            x[:dim] += change
            moved = np.abs(x[:dim] - before[:dim]).max()
            largest = np.abs(change).max()
            if not moved < 1e3 * self._length:
                break
            new = self._place()
            moves = (after - old for after, old in zip(new, place, strict=True))
            lead = stress + self._predicted(*place, *moves)
            place = new
            stress = self._stress(*place)
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
        nothing = np.zeros((len(self._ends) - 1, self._dyads.shape[1]))
        return self._correction(self._cable.x, STEADY * self.patient, nothing) is not None

    def _place(self) -> tuple[Array, Array]:
        """r' at the samples of every span, shape (spans, samples, dim), and its coefficients A, B,
        C of 1, xi and xi^2, shape (spans, 3, dim).
        """
        points = self._cable.x[: self._dim][:, self._spans]
        return (
            np.einsum("sjk,dsk->sjd", self._slopes, points),
            np.einsum("skp,dsk->spd", self._own, points),
        )

    def _stress(self, tangents: Array, coefficients: Array) -> Array:
        """Derivatives of the energies by quadratic forms of the control points of a span: psi = w
        EA/2 eps / |r'|, half the tension over |r'|, by r' . r' at every sample, with the strain
        that counts; and those of the guard by `span_guard.FORMS`. Shape (spans, samples + 7).
        """
        size = np.sqrt(np.einsum("sjd,sjd->sj", tangents, tangents))
        psi = self._half_stiffness * self._counted(size - 1.0) / size
        value, excess, short = self._guarded(coefficients)
        uneven = 2.0 * (self._guard[:, :1] * excess) * WEIGHTS * value[:, :4]
        return np.concatenate([psi, uneven, self._guard[:, 1:] * short], axis=1)

    def _predicted(
        self, tangents: Array, coefficients: Array, moved: Array, changed: Array
    ) -> Array:
        """Change of the stress with that of the tangents and coefficients, to first order."""
        size = np.sqrt(np.einsum("sjd,sjd->sj", tangents, tangents))
        strained = np.einsum("sjd,sjd->sj", tangents, moved) / size
        psi = self._counted(strained) - self._counted(size - 1.0) * strained / size
        value, excess, short = self._guarded(coefficients)
        change = 2.0 * _forms(coefficients, changed)
        uneven = 2.0 * WEIGHTS * value[:, :4]
        growth = (uneven * change[:, :4]).sum(axis=1, keepdims=True) * (excess > 0.0)
        uneven = growth * uneven + 2.0 * excess * WEIGHTS * change[:, :4]
        return np.concatenate(
            [
                self._half_stiffness * psi / size,
                self._guard[:, :1] * uneven,
                self._guard[:, 1:] * change[:, 4:] * (short < 0.0),
            ],
            axis=1,
        )

    def _guarded(self, coefficients: Array) -> tuple[Array, Array, Array]:
        """Values of `span_guard.FORMS`, shape (spans, 7), v - v0 where positive, shape (spans, 1),
        and c - c0 where negative, shape (spans, 3).
        """
        value = _forms(coefficients, coefficients)
        excess = (WEIGHTS * value[:, :4] ** 2).sum(axis=1, keepdims=True) - span_guard.EVEN
        return value, np.maximum(excess, 0.0), np.minimum(value[:, 4:] - span_guard.LEAST, 0.0)

    def _counted(self, strain: Array) -> Array:
        """The strain that counts at the samples: itself or its projection of `span_stretch`."""
        if not self._by_span:
            return strain
        share = self._weights / np.diff(self._ends)[:, None]
        mean = (share * strain).sum(axis=1, keepdims=True)
        slope = (share * self._xi * strain).sum(axis=1, keepdims=True)
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
        blocks = 2.0 * (extra[:, None] @ self._dyads).reshape(-1, 4, 4)
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


def _forms(one: Array, other: Array) -> Array:
    """`span_guard.FORMS` of two sets of coefficients (spans, 3, dim), shape (spans, 7)."""
    return (one @ other.transpose(0, 2, 1)).reshape(-1, 9) @ FORMS.reshape(-1, 9).T
