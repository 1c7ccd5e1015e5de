"""The cable and itself: the numbers of `engine.self_contact`, and how near it comes to itself."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator, Sequence
from typing import NamedTuple

import numpy as np
from numba import float64
from numpy.typing import NDArray

from dlo_sim.compiling.kernels import ARRAY_2D, ARRAY_3D, inline, kernel
from dlo_sim.core import bspline
from dlo_sim.core.bspline import ACTIVE
from dlo_sim.engine.arrays import CONTACT, SELF
from dlo_sim.engine.contact import RETURN
from dlo_sim.engine.self_contact import LONGEST, STIFFNESS
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


class Joined(NamedTuple):
    """Two strands that do not touch each other near a joint.

    Attributes:
        one, other: number of a strand and material coordinate on it [m]. beside: distance along
            both up to which they do not touch [m]; 0 = APART diameters of the thicker one.
    """

    one: tuple[int, float]
    other: tuple[int, float]
    beside: float = 0.0


def fill(model: Model, joints: Sequence[Joined] = ()) -> None:
    """Where spans of strands are along them, how thick they are, and what joins the strands."""
    chain, parts = model.arrays.chain, [part.model for part in model.parts]
    for k, (one, other, beside) in enumerate(joints):
        thick = max(parts[one[0]].scene.cable.diameter, parts[other[0]].scene.cable.diameter)
        chain.joints[k] = *one, *other, beside or APART * thick
    if not model.has(SELF):
        return
    count = chain.segments
    basis = np.zeros((model.n - bspline.DEGREE, count + 1, bspline.ACTIVE))
    laws = []
    for strand in model.parts:
        scene, knots, here = strand.model.scene, strand.model.knots, strand.spans
        ends = bspline.breaks(knots)
        lengths = np.diff(ends)
        xi = np.tile(2.0 * np.arange(count + 1) / count - 1.0, (len(lengths), 1))
        basis[here] = values_of_spans(knots, xi)
        chain.arc[here], chain.length[here] = ends[:-1], lengths / count
        chain.radius[here] = 0.5 * scene.cable.diameter * (lengths > 0.0)
        chain.apart[here] = APART * scene.cable.diameter
        laws.append((stiffness(scene, float(lengths.max()) / count), scene.cable.mu))
    chain.basis[:] = to_blocks(basis)
    chain.diameter = 2.0 * float(chain.radius.max())
    # As stiff as the heaviest strand asks for, and damped as the lightest one bears.
    stiff, mu, law = max(laws)[0], min(mu for _, mu in laws), model.scene.contact
    damping = 2.0 * law.damping * math.sqrt(stiff * mu)
    chain.law[:] = stiff, damping, stiff, BRISTLE_DAMPED * math.sqrt(stiff * mu), law.friction


# -- how near it comes to itself -----------------------------------------------------------------

EVERY = 0.01  # [s] between two looks
STRAIGHT = 0.7  # of the length between two places, above which their distance says nothing
TURNED = 0.5  # cosine by which the cable has to turn between two spans that are compared
PLACES = 9  # of each of two spans, that are compared at a time
CLOSER = 3.0  # times as close are the places that are compared next
FOUND = 0.01  # diameters between neighbouring places, where the search ends
DEEP = 0.5  # diameters, inside itself, in which no cable may be held when it begins
PRESSED = 0.01  # diameters that strands are inside each other, above which a warning reports it


class Nearest(NamedTuple):
    """Where two places that are apart along a cable, or on two strands, come nearest.

    Attributes:
        clearance: gap between the surfaces [m], negative where they overlap. u: material
            coordinates of both places [m]. strands: numbers of their strands.
    """

    clearance: float
    u: tuple[float, float]
    strands: tuple[int, int] = (0, 0)


def nearest(model: Model, points: Array, limit: float = math.inf) -> Nearest:
    """Where strands at control points (n, 3 or 4) are nearest to each other or to themselves, to a
    hundredth of the thickest one's diameter, but near their joints, for neighbouring places of one
    strand and those with a nearly straight cable between them; infinitely far if there are no
    others, or if all clearances exceed `limit`.
    """
    spans = np.zeros((model.n - bspline.DEGREE, 4))
    shapes = np.zeros((len(spans), bspline.ACTIVE, bspline.ACTIVE))
    for k, part in enumerate(model.parts):
        here, ends = part.spans, bspline.breaks(part.model.knots)
        spans[here, 0], spans[here, 1], spans[here, 3] = ends[:-1], ends[1:], k
        spans[here, 2] = 0.5 * part.model.scene.cable.diameter * (np.diff(ends) > 0.0)
        shapes[here] = bspline.span_polynomials(part.model.knots)
    place, joints = np.ascontiguousarray(points[:, :3]), model.arrays.chain.joints
    clearance, u, v, i, j = nearest_places(place, shapes, spans, joints, limit)
    found = clearance if clearance <= limit else math.inf
    return Nearest(found, (u, v), (int(spans[int(i), 3]), int(spans[int(j), 3])))


BEGIN, END, RADIUS, STRAND = range(4)  # of a span, as `nearest_places` takes them


FIVE = (float64,) * 5


@kernel(FIVE, ARRAY_2D, ARRAY_3D, ARRAY_2D, ARRAY_2D, float64)
def nearest_places(
    points: Array, polynomials: Array, ends: Array, joints: Array, limit: float
) -> tuple[float, float, float, float, float]:
    """Gap between the surfaces at the nearest places, their material coordinates [m] and spans;
    places with larger gaps than `limit` may be left out.

    Args:
        polynomials: powers of xi by control point, shape (spans, 4, 4). ends: of the spans, BEGIN
            to STRAND. joints: as in `engine.arrays.Chain`.
    """
    spans = len(ends)
    shapes, edges = np.zeros((spans, ACTIVE, 3)), np.empty((spans + 2, 3))
    middle, size = np.zeros((spans, 3)), np.zeros(spans)
    for i in range(spans + 2):
        square = 0.0
        for d in range(3):
            edges[i, d] = points[i + 1, d] - points[i, d]
            square += edges[i, d] ** 2
        edges[i] /= np.sqrt(square) + 1e-300
    for s in range(spans):
        for k in range(ACTIVE):
            for d in range(3):
                middle[s, d] += 0.25 * points[s + k, d]
                for p in range(ACTIVE):
                    shapes[s, p, d] += polynomials[s, k, p] * points[s + k, d]
        for k in range(ACTIVE):
            size[s] = max(size[s], apart_by(points[s + k], middle[s]))
    least, u, v, first, second = np.inf, 0.0, ends[-1, END], 0, spans - 1
    for i in range(spans):
        turned = 1.0  # the least cosine of an edge of those from here on to the first
        if ends[i, RADIUS] == 0.0:
            continue
        for j in range(i, spans):
            thick = ends[i, RADIUS] + ends[j, RADIUS]
            if ends[j, RADIUS] == 0.0:
                continue
            if ends[i, STRAND] == ends[j, STRAND]:
                for c in (j, j + 1, j + 2):
                    cosine = 0.0
                    for d in range(3):
                        cosine += edges[i, d] * edges[c, d]
                    turned = min(turned, cosine)
                if turned >= TURNED or ends[j, END] - ends[i, BEGIN] <= APART * thick:
                    continue
            most = min(least, limit) + thick
            if apart_by(middle[i], middle[j]) - size[i] - size[j] >= most:
                continue
            long = max(ends[i, END] - ends[i, BEGIN], ends[j, END] - ends[j, BEGIN])
            best, a, b, width = 0.0, 0.0, 0.0, 1.0
            while True:
                best, a, b = closest(shapes, ends, joints, i, j, a, b, width)
                spacing = width * long / (PLACES - 1)
                # Both may be nearer by their spacing, of a cable stretched to twice its length.
                if best == np.inf or best > most + 2.0 * spacing:
                    break
                if spacing <= FOUND * thick:
                    break
                width /= CLOSER
            if best - thick < least:
                least, first, second = best - thick, i, j
                u = ends[i, BEGIN] + 0.5 * (1.0 + a) * (ends[i, END] - ends[i, BEGIN])
                v = ends[j, BEGIN] + 0.5 * (1.0 + b) * (ends[j, END] - ends[j, BEGIN])
    return least, u, v, float(first), float(second)


@inline
def near_joint(joints: Array, one: float, u: float, other: float, v: float) -> bool:
    """Whether the places u and v of two strands are both near a joint of them."""
    for k in range(len(joints)):
        a, at, b, there, far = joints[k]
        if a == one and b == other and abs(u - at) < far and abs(v - there) < far:
            return True
        if a == other and b == one and abs(v - at) < far and abs(u - there) < far:
            return True
    return False


@inline
def apart_by(a: Array, b: Array) -> float:
    """Distance of two points (3,)."""
    return float(np.sqrt((a[0] - b[0]) ** 2 + (a[1] - b[1]) ** 2 + (a[2] - b[2]) ** 2))


@inline
def closest(
    shapes: Array, ends: Array, joints: Array, i: int, j: int, a: float, b: float, width: float
) -> tuple[float, float, float]:
    """Distance and local coordinates of the nearest of PLACES of each of two spans, near a and b;
    infinite where all are near each other along a strand, or it is nearly straight there, or near
    a joint.
    """
    one, other = ends[i, STRAND], ends[j, STRAND]
    apart = APART * (ends[i, RADIUS] + ends[j, RADIUS])
    there, u = np.empty((2, PLACES, 3)), np.empty((2, PLACES))
    xi = np.empty((2, PLACES))
    for side in range(2):
        s, middle = (i, a) if side == 0 else (j, b)
        for k in range(PLACES):
            x = min(max(middle + width * (2.0 * k / (PLACES - 1) - 1.0), -1.0), 1.0)
            xi[side, k] = x
            u[side, k] = ends[s, BEGIN] + 0.5 * (1.0 + x) * (ends[s, END] - ends[s, BEGIN])
            for d in range(3):
                c = shapes[s, :, d]
                there[side, k, d] = c[0] + x * (c[1] + x * (c[2] + x * c[3]))
    least, x, y = np.inf, 0.0, 0.0
    for k in range(PLACES):
        for m in range(PLACES):
            between = abs(u[1, m] - u[0, k])
            far = apart_by(there[0, k], there[1, m])
            if one == other and not (apart <= between and far <= STRAIGHT * between):
                continue
            if far < least and not near_joint(joints, one, u[0, k], other, u[1, m]):
                least, x, y = far, xi[0, k], xi[1, m]
    return least, x, y


class Watch:
    """Counts how often a cable without contact with itself is nearer to itself than it is thick."""

    def __init__(self) -> None:
        self.reset()

    def reset(self) -> None:
        """Begin at time 0."""
        self.looks = self.close = 0
        self.since = -math.inf  # time of the last look [s]
        self.first = 0.0  # time at which it was close first [s]
        self.least = Nearest(math.inf, (0.0, 0.0))

    def look(self, model: Model, x: Array, time: float) -> None:
        """Look at control points, a line of shape (n,) by axis of the motion, if it is time to."""
        if time < self.since + EVERY:
            return
        self.since = time
        self.looks += 1
        points = np.zeros((model.n, 3))
        points[:, : len(x)] = x.T
        found = nearest(model, points, limit=0.0)
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
            "contact.self_contact: off, so the cable passes through itself: "
            f"first at {self.first:.3g} s, in {self.close} of {self.looks} looks, up to "
            f"{-least:.2g} m deep (at {a:.3g} m and {b:.3g} m); set it to on"
        )


def stiffness_needed(cable: Cable) -> float:
    """Contact stiffness [N/m^2] with which strands would not be pressed too deep into each other; 0
    if they are not.
    """
    deep, most = cable.strand_depth, PRESSED * _thinnest(cable)
    return float(cable.arrays.chain.law[STIFFNESS]) * deep / (0.5 * most) if deep > most else 0.0


def _thinnest(cable: Cable) -> float:
    """Diameter [m] of the thinnest strand."""
    radius = cable.arrays.chain.radius
    return 2.0 * float(radius[radius > 0.0].min())


def warnings(cable: Cable, found: Contact | None, cure: str) -> Iterator[str]:
    """Lines about what the contact of a cable with itself cannot bear.

    Args:
        found: what touches now, None if it does not touch itself. cure: what to change where
            strands are pressed too deep (`remarks.cure`).
    """
    if found is None:
        return
    account, chain = cable.account, cable.arrays.chain
    lines = []
    if account.crossed:
        lines.append(f"it passed through itself in {account.crossed:.0f} steps")
    if account.pairs_lost:
        lines.append(f"{account.pairs_lost:.0f} pairs of segments were left out")
    if lines:
        yield f"contact.self_contact: {' and '.join(lines)}; use a smaller integrator.step"
    worst = int(np.argmax(chain.length / np.maximum(chain.radius, 1e-300)))
    segment, diameter = float(chain.length[worst]), 2.0 * float(chain.radius[worst])
    if segment > LONGEST * diameter:
        own = np.ptp(cable.arrays.mesh.strand[cable.arrays.mesh.branch[worst]])
        spans = (own - bspline.DEGREE) * segment
        needed = math.ceil(spans / (LONGEST * diameter)) + bspline.DEGREE
        yield (
            f"contact.self_contact: its segments of {segment:.2g} m are coarse for a diameter of "
            f"{diameter:.2g} m; raise discretization.control_points to {needed}, or the diameter"
        )
    diameter = _thinnest(cable)
    if account.overlap:
        side = ", maybe to the wrong side" if account.overlap > DEEP * diameter else ""
        yield (
            f"contact.self_contact: the cable began up to {account.overlap:.3g} m inside itself, "
            f"or came there by changed parameters, and is pushed out at {RETURN:g} m/s{side}; "
            "begin with its strands apart, or change them in small steps"
        )
    deep = cable.strand_depth
    if deep > PRESSED * diameter:
        yield (
            f"contact.self_contact: strands are pressed {deep:.2g} m into each other, "
            f"{deep / diameter:.1%} of the diameter, by up to {found.pressure:.3g} N/m; {cure}"
        )


def check_start(cable: Cable, held: Sequence[Sequence[float]]) -> None:
    """Refuse a cable that begins inside itself where it is held, and so cannot be pushed out.

    Args:
        held: material coordinates of what is held [m] on each strand.

    Raises:
        SceneError: naming the key and the cure.
    """
    if not (cable.model.has(SELF) and any(held)):
        return
    diameter, found = cable.arrays.chain.diameter, nearest(cable.model, cable.points)
    away = 0.0
    for k, u in zip(found.strands, found.u, strict=True):
        away = max([away, *([min(abs(one - u) for one in held[k])] if held[k] else [math.inf])])
    if found.clearance < -DEEP * diameter and away < APART * diameter:
        raise SceneError(
            f"contact.self_contact: the cable begins {-found.clearance:.3g} m inside itself, at "
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
    forces, u, strands = np.zeros((len(rows), 3)), rows[:, 2], rows[:, 6].astype(int)
    forces[:, list(model.axes)] = rows[:, 3 : 3 + len(model.axes)]
    points = np.zeros((len(rows), 3))
    for k in set(strands.tolist()):
        part, here = model.parts[k], strands == k
        line = cable.points[part.here, :3]
        points[here] = bspline.evaluate(line, part.model.knots, u[here])
    points += model.origin
    sizes = np.linalg.norm(forces, axis=1)
    return Contact(
        clearance=nearest(model, cable.points).clearance,
        force=np.zeros(3),
        pressure=float((sizes / np.maximum(rows[:, 1], 1e-300)).max(initial=0.0)),
        u=u,
        points=points,
        forces=forces,
        passes=np.zeros(0),
        tensions=tensions_beside(model.knots, u[strands == 0], tension),
        stiffness=float(cable.arrays.chain.law[STIFFNESS]),
        strands=strands,
    )
