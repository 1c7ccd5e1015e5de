"""The cable and itself: the numbers of `engine.self_contact`, and how near it comes to itself."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator, Sequence
from functools import lru_cache
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from dlo_sim.core import bspline
from dlo_sim.engine.arrays import CONTACT, SELF, CableArrays
from dlo_sim.engine.contact import RETURN
from dlo_sim.engine.self_contact import LONGEST
from dlo_sim.scene.description import EARTH, Scene
from dlo_sim.scene.loading import SceneError
from dlo_sim.simulation.arrays import to_blocks
from dlo_sim.simulation.cable import Cable
from dlo_sim.simulation.model import Model
from dlo_sim.simulation.obstacles import (
    ITSELF,
    Contact,
    contact_with,
    tension_along,
    tensions_beside,
    values_of_spans,
)

Array = NDArray[np.float64]
SEGMENT = 0.5  # length of a segment in diameters, of the longest span
# Penetration by the weight of the whole cable on one segment, in diameters: less than into
# obstacles, since the Newton matrix, which contains the couplings, makes stiff contact no dearer.
HUNG_DEPTH = 0.0025
# Damping of bristles, which are as stiff as the surface, in sqrt(k_t mu): with less, a strand that
# is pulled suddenly slips before it sticks.
BRISTLE_DAMPED = 8.0
THROWN_DEPTH = 0.4  # penetration of a cable thrown at inputs.max_speed, in diameters
MOST_SEGMENTS = 16  # of a span
APART = 1.6  # along the cable, in diameters: half the smallest ring that a round cable can form


def segments_of(scene: Scene, knots: Array) -> int:
    """Segments of a knot span."""
    longest = float(np.diff(bspline.breaks(knots)).max())
    return min(math.ceil(longest / (SEGMENT * scene.cable.diameter)), MOST_SEGMENTS)


def stiffness(scene: Scene, segment: float) -> float:
    """Contact force per length of cable and penetration [N/m^2]: as given, or such that neither the
    weight of the whole cable on one segment nor a throw presses the cable in far.
    """
    if scene.contact.stiffness:
        return scene.contact.stiffness
    cable = scene.cable
    hung = cable.mu * EARTH * cable.length / (segment * HUNG_DEPTH * cable.diameter)
    thrown = cable.mu * (scene.inputs.max_speed / (THROWN_DEPTH * cable.diameter)) ** 2
    return max(hung, thrown)


def fill(scene: Scene, arrays: CableArrays, knots: Array) -> None:
    """Constants of the contact of the cable of a scene with itself."""
    chain, diameter = arrays.chain, scene.cable.diameter
    chain.segments = count = arrays.sizes["segments"]
    ends = bspline.breaks(knots)
    lengths = np.diff(ends)
    xi = np.tile(2.0 * np.arange(count + 1) / count - 1.0, (len(lengths), 1))
    chain.basis[:] = to_blocks(values_of_spans(knots, xi))
    chain.arc[: len(lengths)], chain.length[: len(lengths)] = ends[:-1], lengths / count
    chain.diameter, chain.apart = diameter, APART * diameter
    k, mu = stiffness(scene, float(lengths.max()) / count), scene.cable.mu
    damping = 2.0 * scene.contact.damping * math.sqrt(k * mu)
    chain.law[:] = k, damping, k, BRISTLE_DAMPED * math.sqrt(k * mu), scene.contact.friction


# -- how near it comes to itself -----------------------------------------------------------------

EVERY = 0.01  # [s] between two looks
STRAIGHT = 0.7  # of the length between two places, above which their distance says nothing
TURNED = 0.5  # cosine by which the cable has to turn between two spans that are compared
PLACES = 9  # of a span, that are compared before the nearest is refined
TRIED = 8  # nearest pairs of spans that are refined
# Shortest edges by which control points may move until all is looked at again: the cable has to
# turn by 60 degrees before spans are compared, and by 180 before they touch.
MOVED = 1.0
_XI = np.linspace(-1.0, 1.0, PLACES)
DEEP = 0.5  # diameters, inside itself, in which no cable may be held when it begins
PRESSED = 0.01  # diameters that strands are inside each other, above which a warning reports it


class Nearest(NamedTuple):
    """Where two places of a cable that are apart along it come nearest.

    Attributes:
        clearance: gap between the surfaces [m], negative where they overlap. u: material
            coordinates of both places [m]. room: by which control points may move along an axis
            [m] until strands can overlap; not above 0 if they do.
    """

    clearance: float
    u: tuple[float, float]
    room: float = 0.0


class _Spans(NamedTuple):
    """Of the spans of a cable: powers of xi by control point, shape (spans, 4, 4), both ends [m],
    numbers of their control points, shape (spans, 4), rest lengths of the edges between control
    points [m], those that are as long as spans, entries below the diagonal of a matrix of edges,
    and of one of spans those that are far enough apart along the cable to touch.
    """

    polynomials: Array
    ends: Array
    points: NDArray[np.int64]
    rest: Array
    whole: slice
    below: NDArray[np.bool_]
    far: NDArray[np.bool_]


@lru_cache(maxsize=8)
def _spans(knots: bytes, apart: float) -> _Spans:
    vector = np.frombuffer(knots)
    ends = bspline.breaks(vector)
    sides = np.stack((ends[:-1], ends[1:]), axis=1)
    rest = (vector[4:-1] - vector[1:-4]) / 3.0
    below = np.tri(len(rest), k=-1, dtype=bool)
    far = np.triu(ends[1:] - ends[:-1, None] > apart)
    number = np.arange(len(sides))[:, None] + np.arange(bspline.ACTIVE)
    whole = slice(2, -2) if len(rest) > 4 else slice(None)  # edges at clamped ends are shorter
    return _Spans(bspline.span_polynomials(vector), sides, number, rest, whole, below, far)


_POWERS = _XI[:, None] ** np.arange(bspline.ACTIVE)


def nearest(model: Model, points: Array, limit: float = math.inf) -> Nearest:
    """Where a cable at control points (n, 3 or 4) is nearest to itself, to a hundredth of its
    diameter, but for neighbouring places and those with a nearly straight cable between them;
    infinitely far if there are no others, or if all clearances exceed `limit`.
    """
    diameter = model.scene.cable.diameter
    apart = APART * diameter
    spans = _spans(model.knots.tobytes(), apart)
    ends, nowhere = spans.ends, (0.0, float(spans.ends[-1, 1]))
    edges = points[1:, :3] - points[:-1, :3]
    chord = points[-1, :3] - points[0, :3]
    # The tangent is a mean of edges over their rest lengths: where all of these advance along the
    # chord, no two places are nearer than STRAIGHT of what is between them. Found in 10 us, not 30.
    if (edges @ chord > STRAIGHT * math.sqrt(chord @ chord) * spans.rest).all():
        room = MOVED * float(spans.rest[spans.whole].min()) / math.sqrt(3.0)
        return Nearest(math.inf, nowhere, room)
    lengths = np.sqrt(np.einsum("kd,kd->k", edges, edges)) + 1e-300
    edges /= lengths[:, None]
    # Of every edge the least cosine to those from it on: what turns less advances along it.
    cosines = edges @ edges.T
    cosines[spans.below] = 1.0
    np.minimum.accumulate(cosines, axis=1, out=cosines)
    hulls = points[:, :3].take(spans.points, axis=0)
    middle = 0.25 * np.einsum("skd->sd", hulls)
    from_middle = hulls - middle[:, None]
    size = np.sqrt(np.einsum("skd,skd->sk", from_middle, from_middle).max(axis=1))
    squares = np.einsum("sd,sd->s", middle, middle)
    between = squares[:, None] + squares - 2.0 * (middle @ middle.T)
    gaps = np.sqrt(np.maximum(between, 0.0)) - size[:, None] - size
    gaps[(cosines[:-2, 2:] >= TURNED) | ~spans.far] = math.inf
    possible = gaps < limit + diameter
    others = float(gaps[~possible].min(initial=math.inf)) - diameter

    def room_for(clearance: float) -> float:
        longest = MOVED * float(lengths[spans.whole].min())
        return min(0.5 * clearance, 0.5 * others, longest) / math.sqrt(3.0)

    first, second = np.nonzero(possible)
    if not len(first):
        return Nearest(math.inf, nowhere, room_for(math.inf))
    shapes = np.einsum("skp,skd->spd", spans.polynomials, hulls)
    line, u = _POWERS @ shapes, 0.5 * (ends @ np.stack((1.0 - _XI, 1.0 + _XI)))
    far = _distances(line[first], line[second], u[first], u[second], apart)
    # Two thirds of the search are the refinement; it moves both places by less than their spacing.
    spacing = 2.0 * float((ends[:, 1] - ends[:, 0]).max()) / (PLACES - 1)  # stretched to twice
    if far.min() == math.inf or far.min() > (limit + diameter + spacing) ** 2:
        return Nearest(math.inf, nowhere, room_for(limit))
    tried = np.argsort(far.min(axis=(1, 2)))[:TRIED]
    both, step = np.stack((first[tried], second[tried])), 2.0 / (PLACES - 1)
    far = far[tried]
    best = _XI[np.stack(_least(far))]
    while step * (ends[both[0], 1] - ends[both[0], 0]).max() > 0.02 * diameter:
        xi = np.clip(best[..., None] + np.linspace(-step, step, PLACES), -1.0, 1.0)
        lines = (xi[..., None] ** np.arange(bspline.ACTIVE)) @ shapes[both]
        at = 0.5 * (ends[both, :1] * (1.0 - xi) + ends[both, 1:] * (1.0 + xi))
        far = _distances(lines[0], lines[1], at[0], at[1], apart)
        best = np.take_along_axis(xi, np.stack(_least(far))[..., None], axis=2)[..., 0]
        step /= 3.0
    k = int(np.argmin(far.min(axis=(1, 2))))
    shares = 0.5 * (1.0 + best[:, k])
    places = ends[both[:, k], 0] * (1.0 - shares) + ends[both[:, k], 1] * shares
    clearance = math.sqrt(far[k].min()) - diameter
    return Nearest(clearance, (float(places[0]), float(places[1])), room_for(clearance))


def _least(far: Array) -> tuple[NDArray[np.int64], NDArray[np.int64]]:
    """Row and column of the smallest entry of each of these matrices (k, p, p)."""
    return np.divmod(far.reshape(len(far), -1).argmin(axis=1), far.shape[2])


def _distances(one: Array, other: Array, u: Array, v: Array, apart: float) -> Array:
    """Squared distances of places (k, p, 3) at coordinates u, v (k, p), shape (k, p, p); infinite
    where these are nearer than `apart`, or the cable between them is nearly straight.
    """
    squares = np.sum(one * one, axis=2)[:, :, None] + np.sum(other * other, axis=2)[:, None]
    far = np.maximum(squares - 2.0 * one @ np.swapaxes(other, 1, 2), 0.0)
    between = np.abs(u[:, :, None] - v[:, None])
    return np.where((between < apart) | (far > (STRAIGHT * between) ** 2), math.inf, far)


class Watch:
    """Counts how often a cable without contact with itself is nearer to itself than it is thick."""

    def __init__(self) -> None:
        self.reset()

    def reset(self) -> None:
        """Begin at time 0."""
        self.looks = self.close = 0
        self.since = -math.inf  # time of the last look [s]
        self.first = 0.0  # time at which it was close first [s]
        self._seen, self._room = np.zeros((0, 0)), 0.0  # control points of a look, and its `room`
        self.least = Nearest(math.inf, (0.0, 0.0))

    def look(self, model: Model, x: Array, time: float) -> None:
        """Look at control points, a line of shape (n,) by axis of the motion, if it is time to."""
        if time < self.since + EVERY:
            return
        self.since = time
        self.looks += 1
        if self._seen.shape == x.shape and np.abs(x - self._seen).max() < self._room:
            return
        points = np.zeros((model.n, 3))
        points[:, : len(x)] = x.T
        found = nearest(
            model, points, limit=model.scene.cable.diameter
        )  # so that `room` is not tiny
        self._seen, self._room = x.copy(), found.room
        if found.clearance < 0.0:
            self.first = self.first if self.close else time
            self.close += 1
        if found.clearance < self.least.clearance:
            self.least = found

    @property
    def warning(self) -> str:
        """One line if it was, else empty."""
        if not self.close:
            return ""
        least, (a, b), _ = self.least
        return (
            f"contact.self: off, so the cable passes through itself: first at {self.first:.3g} s, "
            f"in {self.close} of {self.looks} looks, up to {-least:.2g} m deep (at {a:.3g} m and "
            f"{b:.3g} m); set it to on"
        )


def warnings(cable: Cable, found: Contact | None, finer: str) -> Iterator[str]:
    """Lines about what the contact of a cable with itself cannot bear.

    Args:
        found: what touches now, None if it does not touch itself. finer: what gives the control
            points that bends need; empty if there are enough.
    """
    if found is None:
        return
    account, diameter = cable.account, cable.model.scene.cable.diameter
    lines = []
    if account.crossed:
        lines.append(f"it passed through itself in {account.crossed:.0f} steps")
    if account.pairs_lost:
        lines.append(f"{account.pairs_lost:.0f} pairs of segments were left out")
    if lines:
        yield f"contact.self: {' and '.join(lines)}; use a smaller integrator.step"
    segment = float(cable.arrays.chain.length.max())
    if segment > LONGEST * diameter:
        spans = (cable.model.n - bspline.DEGREE) * segment
        needed = math.ceil(spans / (LONGEST * diameter)) + bspline.DEGREE
        yield (
            f"contact.self: its segments of {segment:.2g} m are coarse for a diameter of "
            f"{diameter:.2g} m; raise discretization.control_points to {needed}, or the diameter"
        )
    if account.overlap:
        side = ", maybe to the wrong side" if account.overlap > DEEP * diameter else ""
        yield (
            f"contact.self: the cable began up to {account.overlap:.3g} m inside itself, or came "
            f"there by changed parameters, and is pushed out at {RETURN:g} m/s{side}; begin with "
            "its strands apart, or change them in small steps"
        )
    # Between segments: where they bend, the surface of the cable is further in (METHODS.md).
    deep = -float(cable.strands()[:, 0].min(initial=0.0)) - account.pair_overlap
    if deep > PRESSED * diameter:
        yield (
            f"contact.self: strands are pressed {deep:.2g} m into each other, {deep / diameter:.1%}"
            f" of the diameter, by up to {found.pressure:.3g} N/m; raise contact.stiffness to "
            f"{found.pressure / (0.5 * PRESSED * diameter):.2g}"
            + (f" and {finer}" if finer else "")
        )


def check_start(cable: Cable, held: Sequence[float]) -> None:
    """Refuse a cable that begins inside itself where it is held, and so cannot be pushed out.

    Args:
        held: material coordinates of what is held [m].

    Raises:
        SceneError: naming the key and the cure.
    """
    diameter = cable.model.scene.cable.diameter
    if not (cable.model.has(SELF) and len(held)):
        return
    found = nearest(cable.model, cable.points)
    away = max(float(np.abs(np.array(held) - u).min()) for u in found.u)
    if found.clearance < -DEEP * diameter and away < APART * diameter:
        raise SceneError(
            f"contact.self: the cable begins {-found.clearance:.3g} m inside itself, at "
            f"{found.u[0]:.3g} m and {found.u[1]:.3g} m, where it is held; move its ends or grasps "
            "apart, or set it to off"
        )


def contacts_of(cable: Cable) -> dict[str, Contact]:
    """What of a cable touches now: each obstacle by name, and itself under ITSELF, with which it
    may be in contact.
    """
    model, tension = cable.model, tension_along(cable)
    bodies = model.scene.bodies if model.has(CONTACT) else ()
    found = {one.name: contact_with(cable, k, tension) for k, one in enumerate(bodies)}
    return found | ({ITSELF: _with_itself(cable, tension)} if model.has(SELF) else {})


def _with_itself(cable: Cable, tension: Callable[[Array], Array] | None) -> Contact:
    """Where a cable touches itself at the present configuration, each place on the first of the two
    strands. `force` is half the sum of the sizes of all forces, in no direction: those on both
    strands cancel. The friction is that of the bristles, without their damping. tension: as for
    `contact_with`.
    """
    model, rows = cable.model, cable.strands()
    rows = rows[rows[:, 1] > 0.0]
    forces, u = np.zeros((len(rows), 3)), rows[:, 2]
    forces[:, list(model.axes)] = rows[:, 3 : 3 + len(model.axes)]
    points = bspline.evaluate(cable.points[:, :3], model.knots, u) + model.origin
    sizes = np.linalg.norm(forces, axis=1)
    return Contact(
        clearance=nearest(model, cable.points).clearance,
        force=np.zeros(3),
        pressure=float((sizes / np.maximum(rows[:, 1], 1e-300)).max(initial=0.0)),
        u=u,
        points=points,
        forces=forces,
        passes=np.zeros(0),
        tensions=tensions_beside(model.knots, u, tension),
    )
