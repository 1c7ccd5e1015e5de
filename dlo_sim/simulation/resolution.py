"""How many control points a scene is computed with, where its knots lie, and why: the one place
that decides it.

The lengths over which the curvature of a cable changes decide. Beside a clamp that is
lambda = sqrt(EI / T), over which a cable under the tension T turns from the clamp's direction into
that of the pull. Elsewhere it is the radius l of the sharpest curvature, 1 / l = 1 / r + kappa,
with the natural curvature kappa and r the smaller of

- (EI / w)^(1/3), the radius to which a cable of weight w per length closes between two grippers,
- a sixth of the length, the radius of a ring; a twelfth with both ends held, that of the S or the
  loop that grippers force a stiff cable into.

An obstacle within reach bends the cable to its radius with the cable's, at an edge of a box or a
mesh to that of the cable alone, and another strand of the cable to its diameter; or to lambda if
that is larger. Spans are at most ROUND times that, but IN_CHANNEL times lambda in a channel, which
holds the direction as a clamp does: the friction of half a turn round a cylinder is then right to
1.5 % (coefficients up to 1), and the tensions on both sides of a guide without friction are equal
to 2 to 5 %. Edges alone do not ask for more than MOST_FOR_EDGES control points.

A cable that is held at two places can be pulled taut through a ring, a channel or a knot, and round
a peg: lambda is there that of the pull obstacles.USUAL, or of the strain obstacles.TAUT, if the
tension known from the scene is smaller. How hard grippers pull it over edges is not known before
the run. Where a cable is found to bend by more than SHARP within a span that is TOO_LONG times what
the tension found there asks for, `shortfalls` tells how many control points are enough. Spans that
are too long exaggerate the tension, so that a run with this number asks for no more.

Errors of the position [m] found with knot spans of length h:

- beside a clamp CLAMP * pi / 2 * lambda (h / lambda)^5 (it may turn by pi / 2),
- elsewhere MIDDLE * l (h / l)^4.

The constants are from the cables of test/simulation/corpus.py, whose errors they exceed 2
to 10 times. What depends on the motion (waves, tension by acceleration) is not in them: the error
estimate tells.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass, replace
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from dlo_sim.core import bspline
from dlo_sim.core.methods import IMPLICIT
from dlo_sim.engine.contact_law import TINY
from dlo_sim.scene.description import PARAMETERS, Obstacle, Scene
from dlo_sim.simulation.model import Model
from dlo_sim.simulation.obstacles import (
    EDGED,
    ITSELF,
    TAUT,
    Contact,
    bend_radius,
    beyond_reach,
    held_twice,
    usual_pull,
)
from dlo_sim.simulation.selection import method_of

Array = NDArray[np.float64]

CLAMP, MIDDLE = 0.05, 0.05  # of the errors above
# Lengths of spans per radius of a bend, or per lambda; and per lambda in a channel.
ROUND, IN_CHANNEL = 0.8, 0.4
TURN = 0.5 * np.pi  # [rad] between a clamp and the pull
LONGEST = 1.5  # spans per length are not longer than this, whatever the target
# Lengths of a cable per radius of its sharpest bend: that of a ring, and that of the S or the loop
# that two grippers force it into; whether both ends are held.
RADIUS = {False: 6.0, True: 12.0}
REACH = 2.8  # lambda over which the density of knots decays; by the errors of ten cables
MOST_FOR_EDGES = 60  # control points, as most cables lie on flat sides
FEWEST, MOST = 9, 250  # control points that are chosen; with 250, steps still keep up
LEAST_STRETCHED_BY_SPAN = 5  # control points, of the strands of a net
SHARP, TOO_LONG = 0.8, 1.25  # [rad] and spans wanted, above which `shortfalls` reports a bend
MOST_CONTROL_POINTS = next(
    int(row.high or 0) for row in PARAMETERS if row.key == "discretization.control_points"
)


@dataclass(frozen=True)
class _Spans:
    """Lengths of knot spans [m] that keep the error below accuracy.target.

    bend: beside clamps and other things that bend the cable sharply; infinite without any. middle:
    elsewhere. reach: length beside a clamp over which one becomes the other. round_: what the cable
    bends round that decides `middle`, or empty.
    """

    bend: float
    middle: float
    reach: float
    round_: str = ""


def resolved(scene: Scene) -> tuple[Scene, str]:
    """The scene with the number of control points and the knots that it leaves open, and why.

    What is chosen depends on the scene alone. A scene that leaves nothing open stays as it is.
    """
    if scene.is_net:
        return _resolved_net(scene)
    asked, spans = scene.discretization, _wanted_spans(scene)
    grading = _grading(scene, spans)
    number, limited = _number(scene, spans, grading)
    span = scene.cable.length / (number - bspline.DEGREE)
    if asked.knots == "auto" and grading != bspline.EQUAL and (asked.control_points or limited):
        # Fewer than wanted, perhaps: a bend that is narrower than a span has knots, too.
        grading = grading._replace(reach=max(grading.reach, 0.5 * span))
    if asked.control_points:
        closer = "" if grading == bspline.EQUAL else ", closer knots at clamps"
        return _with(scene, number, grading), f"{number} control points as the scene asks{closer}"
    lengths = f"of {_length(span)}"
    if grading != bspline.EQUAL:
        shortest = min(spans.bend, spans.middle)
        lengths = f"from {_length(shortest)} at clamps to {_length(spans.middle)}"
    reason = limited or f"spans {lengths} for {_aim(scene, spans)}"
    return _with(scene, number, grading), f"{number} control points: {reason}"


def _resolved_net(scene: Scene) -> tuple[Scene, str]:
    """`resolved` of a net: each strand as if it were alone, with equal spans."""
    values: dict[str, object] = {"discretization.knots": "uniform"}
    reasons, fewest = [], MOST
    for strand in scene.strands:
        equal = replace(strand.scene.discretization, knots="uniform")
        alone, reason = resolved(replace(strand.scene, discretization=equal))
        reasons.append(f"{strand.name}: {reason}")
        key = strand.key_of("discretization.control_points")
        values[key] = alone.discretization.control_points
        fewest = min(fewest, alone.discretization.control_points)
    choice = scene.discretization
    if choice.stretch == "auto":  # the same for all strands
        by_span = choice.quadrature == "gauss" and fewest >= LEAST_STRETCHED_BY_SPAN
        values["discretization.stretch"] = "span" if by_span else "sample"
    return scene.with_values(values), "; ".join(reasons)


def continued(scene: Scene, before: Scene) -> Scene:
    """A scene with the number of control points and the knots of the one that is being simulated,
    as far as it leaves them open: they do not change while a cable moves.
    """
    if scene.is_net:
        fixed = {
            strand.key_of("discretization.control_points"): one.scene.discretization.control_points
            for strand, one in zip(scene.strands, before.strands, strict=True)
            if not strand.scene.discretization.control_points
        }
        kept: dict[str, object] = {"discretization.knots": "uniform", **fixed}
        if scene.discretization.stretch == "auto":
            kept["discretization.stretch"] = before.discretization.stretch
        return scene.with_values(kept)
    asked, present = scene.discretization, before.discretization
    number = asked.control_points or present.control_points
    if asked.knots != "auto" or number != present.control_points:
        return scene.with_values({"discretization.control_points": number})
    return _with(scene, number, knot_grading(before))


def knot_grading(scene: Scene) -> bspline.Grading:
    """Grading of the knots of a scene that leaves nothing open."""
    chosen = scene.discretization
    return bspline.Grading(*chosen.grading) if chosen.knots == "graded" else bspline.EQUAL


def _with(scene: Scene, number: int, grading: bspline.Grading) -> Scene:
    """The scene with this number of control points and, where it says auto, this grading."""
    values: dict[str, object] = {}
    if scene.discretization.control_points != number:
        values["discretization.control_points"] = number
    if scene.discretization.knots == "auto":
        values["discretization.knots"] = "uniform" if grading == bspline.EQUAL else "graded"
        if grading != bspline.EQUAL:
            values["discretization.grading"] = list(grading)
    return scene.with_values(values) if values else scene


def _wanted_spans(scene: Scene) -> _Spans:
    cable, ends, target = scene.cable, scene.ends.values(), scene.accuracy.target
    held = [any(end.fixed) or any(end.spring) for end in ends]
    gravity = math.hypot(*scene.gravity) * (scene.terms.gravity != "off")
    bending = cable.EI * (scene.terms.bend != "off")
    bodies = sum(end.mass for end, holds in zip(ends, held, strict=True) if not holds)
    weight = cable.mu * gravity
    pulled = sum(math.hypot(*load.force) for load in scene.loads)
    tension = (weight * cable.length + bodies * gravity + pulled) / max(sum(held), 1)
    radius = cable.length / RADIUS[all(held)]
    if weight and bending:
        radius = min(radius, (bending / weight) ** (1.0 / 3.0))
    natural = max(map(abs, (*cable.rest_curvature, *cable.rest_curvature_2)))
    middle = _span(1.0 / (1.0 / radius + natural), MIDDLE, 4, target)
    bend = math.inf if bending else 0.0
    if tension:
        bend = math.sqrt(bending / tension)
    pull = max(TAUT * cable.EA, usual_pull(scene, taut=True))
    taut = math.sqrt(bending / pull) if held_twice(scene) else math.inf
    middle, around = min([(middle, ""), *_round_spans(scene, bend, min(bend, taut))])
    if not (tension and bending):
        return _Spans(math.inf, middle, 1.0, around)
    reach = REACH * bend + max(end.jaw for end in ends)
    sharp = any(end.clamped for end in ends) or _bent_between(scene)
    clamped = _span(bend, CLAMP * TURN, 5, target) if sharp else math.inf
    return _Spans(clamped, middle, reach, around)


def _round_spans(scene: Scene, bend: float, taut: float) -> list[tuple[float, str]]:
    """Longest spans [m] to bend round obstacles within reach and the cable itself, and what these
    are.

    Args:
        bend: length over which the tension bends the cable [m]. taut: the same where it may be
            pulled taut, round all but edges [m].
    """
    found = []
    if scene.touches_itself:
        found.append((_span_round(scene, None, taut), "another strand"))
    if not scene.touches:
        return found
    least = scene.cable.length / (MOST_FOR_EDGES - bspline.DEGREE)
    for one in scene.bodies:
        if one.shape != "plane" and not beyond_reach(scene, one):
            span = _span_round(scene, one, bend if one.shape in EDGED else taut)
            found.append((max(span, least * (one.shape in EDGED)), f"obstacles.{one.name}"))
    return found


def _span_round(scene: Scene, body: Obstacle | None, bend: float) -> float:
    """The longest span [m] to bend round an obstacle, or the cable itself, under a tension that
    bends the cable over the length `bend` [m].
    """
    if body is None:
        return ROUND * max(scene.cable.diameter, bend)
    over = IN_CHANNEL if body.shape == "channel" else ROUND
    return max(ROUND * bend_radius(scene, body), over * bend)


class Shortfall(NamedTuple):
    """A bend that the knot spans of a cable are too long to follow.

    Attributes:
        needed: number of control points that follow it. turn: of the cable within a span [rad]. u:
            where it is [m].
    """

    needed: int
    turn: float
    u: float

    def warning(self, name: str, cure: str) -> str:
        """One line; name: of the obstacle, or ITSELF. cure: `raised`."""
        what, around = f"obstacles.{name}", "it"
        if name == ITSELF:
            what, around = "contact.self_contact", "itself"
        return (
            f"{what}: the cable bends round {around} by {self.turn:.2g} rad in a knot span at "
            f"{self.u:.3g} m, so forces there may be some 10 % off or more; {cure}"
        )


def raised(scene: Scene, number: int, implicit: bool) -> str:
    """What to change for so many control points, in words; implicit: whether the method is."""
    cure, samples = (
        f"raise discretization.control_points to {number}",
        2 * (number - bspline.DEGREE),
    )
    if scene.discretization.quadrature == "uniform" and scene.discretization.samples < samples:
        cure += f" and discretization.samples to {samples}"
    if scene.integrator.step and not implicit:
        cure += " and set integrator.step to 0"  # a shorter one is stable
    return cure


def shortfalls(model: Model, points: Array, found: Mapping[str, Contact]) -> dict[str, Shortfall]:
    """Bends of a cable round what it touches that its knot spans cannot follow, by the names of the
    obstacles, ITSELF included.

    Args:
        points: control points [m], shape (n, 3 or 4). found: what touches, by the same names.
    """
    scene = model.scene
    bodies, bends = {one.name: one for one in scene.bodies if one.shape != "plane"}, {}
    breaks = bspline.breaks(model.knots)
    spans, bending = np.diff(breaks), scene.cable.EI * (scene.terms.bend != "off")
    for name, one in found.items():
        if not len(one.u) or (name != ITSELF and name not in bodies):
            continue
        pulled = one.tensions.max(initial=TINY) if len(one.tensions) else math.inf
        wanted = _span_round(scene, bodies.get(name), math.sqrt(bending / pulled))
        here = spans[np.searchsorted(breaks, one.u, side="right").clip(1, len(spans)) - 1]
        sides = (one.u + 0.5 * sign * here for sign in (-1.0, 1.0))
        before, after = (
            bspline.evaluate(points[:, :3], model.knots, u.clip(0.0, breaks[-1]), 1) for u in sides
        )
        across = np.linalg.norm(np.cross(before, after), axis=1)
        turns = np.arctan2(across, np.sum(before * after, axis=1))
        turns[here <= TOO_LONG * wanted] = 0.0
        worst = int(np.argmax(turns))
        in_channel = name != ITSELF and bodies[name].shape == "channel"
        if turns[worst] > SHARP * (IN_CHANNEL / ROUND if in_channel else 1.0):
            needed = math.ceil(len(spans) * here[worst] / wanted - 1e-6) + bspline.DEGREE
            needed = min(needed, MOST_CONTROL_POINTS)
            bends[name] = Shortfall(needed, float(turns[worst]), float(one.u[worst]))
    return bends


def _span(length: float, factor: float, order: int, target: float) -> float:
    """The longest span h [m] with factor length (h / length)^order <= target."""
    return length * min((target / (factor * length)) ** (1.0 / order), LONGEST)


def _grading(scene: Scene, spans: _Spans) -> bspline.Grading:
    """Closer knots at clamped ends: what the scene says, or, with `auto`, what the spans are to be.

    Spans stay equal with uniform quadrature; with a lumped mass, which is of first order on unequal
    ones; where something bends the cable between its ends; and with explicit steps, which the
    shortest span limits.
    """
    choice, excess = scene.discretization, max(spans.middle / spans.bend - 1.0, 0.0)
    if choice.knots != "auto":
        return knot_grading(scene)
    ends = [excess * end.clamped for end in scene.ends.values()]
    plain = choice.quadrature == "gauss" and choice.mass != "lumped" and not _bent_between(scene)
    grading = bspline.Grading(ends[0], ends[1], spans.reach)
    if not (any(ends) and plain):
        return bspline.EQUAL
    number, _ = _number(scene, spans, grading)
    method = method_of(_with(scene, number, grading))[0]
    return grading if method.family == IMPLICIT else bspline.EQUAL


def _bent_between(scene: Scene) -> bool:
    """Whether something acts on the cable at a place between its ends."""
    return bool(scene.grasps) or any(0.0 < load.position < 1.0 for load in scene.loads)


def _number(scene: Scene, spans: _Spans, grading: bspline.Grading) -> tuple[int, str]:
    """The number of control points: what the scene asks for, else what is wanted within limits; and
    if the limit is below what is wanted, a line that says so.
    """
    asked = scene.discretization
    if asked.control_points:
        return asked.control_points, ""
    wanted, most, limit = _wanted(scene, spans, grading), MOST, "are chosen"
    if asked.quadrature == "uniform" and asked.samples // 2 + bspline.DEGREE < most:
        most, limit = asked.samples // 2 + bspline.DEGREE, "discretization.samples allow"
    if wanted <= most:
        return max(wanted, FEWEST), ""
    return (
        most,
        f"the most that {limit}, {_aim(scene, spans)} wants {wanted}",
    )


def _wanted(scene: Scene, spans: _Spans, grading: bspline.Grading) -> int:
    """Control points with which no span is longer than wanted."""
    (start, end, reach), length = grading, scene.cable.length
    span = min(spans.middle, spans.bend * (1.0 + max(start, end)))  # where the density is 1
    share = length - (start + end) * reach * math.expm1(-length / reach)
    return math.ceil(min(share / span, 1e6) - 1e-9) + bspline.DEGREE


def _aim(scene: Scene, spans: _Spans) -> str:
    """What decides the spans."""
    if spans.round_:
        return f"the bend round {spans.round_}"
    return f"accuracy.target {scene.accuracy.target:g} m"


def _length(metres: float) -> str:
    return f"{1e3 * metres:.2g} mm" if metres < 0.1 else f"{metres:.2g} m"
