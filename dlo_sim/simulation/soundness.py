"""Whether the local stretch of a shape is what its tension explains: one check, for every run.

A span stretches by what its tension causes, evenly or, at the ends of the cable, linearly: that is
the projected strain of `engine.elastic`. Where |r'| differs from it by more than BOUND somewhere,
the span is folded, or has a cusp, or is held at places between which it cannot reach: such a shape
is no cable's, and its forces are meaningless. A clamped end whose first span points backwards
is folded, too. No tension explains less than LEAST: a cable buckles long before, but the linear
strain of an end span would explain a fold at a clamp. (With `discretization.stretch: sample` any
local stretch has its tension.)

The bound is no measure of accuracy, which the error estimate is for. Coarse but sensible shapes
stay below it: of 60 cables at rest between grippers (`engine.span_guard`) with 13 control points,
the worst deviates by 0.31, with an error of 5 % of the length. Shapes with cusps deviate by 0.6 and
more.
"""

from __future__ import annotations

from functools import lru_cache
from typing import NamedTuple

import numpy as np
from numba import boolean, float64, int64
from numpy.typing import NDArray

from dlo_sim.compiling.kernels import ARRAY_3D, inline, kernel
from dlo_sim.core import bspline
from dlo_sim.core.bspline import ACTIVE
from dlo_sim.engine.arrays import ANY_STRETCH, MARGIN, SPAN_STRETCH, cable_at
from dlo_sim.engine.grasps import component, direction_at
from dlo_sim.simulation.cable import Cable
from dlo_sim.simulation.ends import EndDrive, Tip
from dlo_sim.simulation.model import MAIN, Model, Part
from dlo_sim.simulation.recorder import Recorder
from dlo_sim.simulation.report import Report, Status

Array = NDArray[np.float64]
BOUND = 0.5  # of the rest length
LEAST = 0.75  # of the rest length, that a tension explains
_GAUSS_POINTS = 5  # of a span, for its mean strain; both ends are places, too
_INSIDE = 1.0 - 1e-12  # keeps the ends of a span inside it


def unexplained_stretch(
    model: Model, points: Array, ends: EndDrive | None = None, time: float = 0.0
) -> str:
    """One line about the place where local stretch and tension differ most; "" if all is well.

    Args:
        points: control points of one shape or of several [m], shape (..., n, 3 or 4).
        ends: for one shape, where to look up the directions of clamped ends at this time [s].
    """
    if not model.has(ANY_STRETCH):
        return ""
    if tip := leaves_clamp_backwards(points, ends, time) if ends else None:
        part = next(one for one in model.parts if tip.outer in range(*one.here.indices(model.n)))
        u = 0.0 if tip.inner > tip.outer else part.length
        return _line(part, u, "the cable leaves its clamp backwards: a fold")
    for part in model.parts:
        places = _places(part.model.knots.tobytes())
        own = points[..., part.here, :3]
        shapes = np.ascontiguousarray(own).reshape(-1, part.model.n, 3)
        given = places.slopes, places.projection, model.has(SPAN_STRETCH)
        span, place, length, explained = worst_stretch(shapes, *given)
        if abs(length - explained) > BOUND:
            what = (
                f"the cable has {length:.2f} of its rest length where its tension explains "
                f"{explained:.2f}: a fold or cusp"
            )
            return _line(part, places.u[int(span), int(place)], what)
    return ""


def sound_now(cable: Cable, ends: EndDrive, time: float) -> str:
    """`unexplained_stretch` of a cable at the present time [s]: microseconds where all is well."""
    model = cable.model
    if not model.has(ANY_STRETCH):
        return ""
    for part in model.parts:
        places = _places(part.model.knots.tobytes())
        clamped = ends.clamped_rows(part.grasp)
        given = time, part.first, part.model.n, *clamped, places.slopes, places.projection
        if not cable.call(is_sound, *given):
            return unexplained_stretch(model, cable.points, ends, time)
    return ""


def leaves_clamp_backwards(points: Array, ends: EndDrive, time: float = 0.0) -> Tip | None:
    """A clamped end whose first edge points against its clamp at a time [s]; None if there is
    none.
    """
    for tip in ends.tips:
        if tip.end.clamped:
            edge = points[max(tip.outer, tip.inner)] - points[min(tip.outer, tip.inner)]
            if (edge[:3] * ends.tangent(tip.name, time)).sum() <= 0.0:
                return tip
    return None


@kernel(boolean, int64, float64, *[int64] * 4, ARRAY_3D, ARRAY_3D)
def is_sound(
    address: int,
    t: float,
    first: int,
    number: int,
    start: int,
    end: int,
    slopes: Array,
    projection: Array,
) -> bool:
    """Whether `unexplained_stretch` has nothing to say of a strand at time t.

    Args:
        first, number: its control points. start, end: rows of the grasps that clamp its ends, -1
            without (`EndDrive.clamped_rows`).
    """
    cable = cable_at(address)
    shape, by_span = np.zeros((1, number, 3)), cable.terms & SPAN_STRETCH != 0
    for axis in range(cable.dim):
        for i in range(number):
            shape[0, i, cable.axes[axis]] = cable.state.x[axis, MARGIN + first + i]
    for end_number in range(2):
        row = end if end_number == 1 else start
        if row >= 0:
            d = direction_at(cable.inputs.motion[row], t)
            i, along = end_number * (number - 2), 0.0
            for axis in range(3):
                along += (shape[0, i + 1, axis] - shape[0, i, axis]) * component(d, axis)
            if along <= 0.0:
                return False
    _, _, length, explained = stretched_most(shape, slopes, projection, by_span)
    return abs(length - explained) <= BOUND


@kernel((float64, float64, float64, float64), ARRAY_3D, ARRAY_3D, ARRAY_3D, boolean)
def worst_stretch(
    shapes: Array, slopes: Array, projection: Array, by_span: bool
) -> tuple[float, float, float, float]:
    """`stretched_most` for Python."""
    return stretched_most(shapes, slopes, projection, by_span)


@inline
def stretched_most(
    shapes: Array, slopes: Array, projection: Array, by_span: bool
) -> tuple[float, float, float, float]:
    """Span, place in it, |r'| and what the tension explains of it where these differ most.

    Without `by_span` any |r'| has its tension, unless it is no number.
    """
    spans, places = slopes.shape[0], slopes.shape[1]
    lengths = np.empty(places)
    worst, found = -1.0, (0.0, 0.0, 1.0, 1.0)
    for shape in shapes:
        for span in range(spans):
            empty = True  # between equal knots
            for k in range(ACTIVE):
                empty = empty and slopes[span, 0, k] == 0.0
            if empty:
                continue
            for place in range(places):
                square = 0.0
                for axis in range(3):
                    slope = 0.0
                    for k in range(ACTIVE):
                        slope += slopes[span, place, k] * shape[span + k, axis]
                    square += slope * slope
                lengths[place] = np.sqrt(square)
            at_end = 1 if span in (0, spans - 1) else 0
            for place in range(places):
                explained = lengths[place]
                if by_span:
                    explained = 0.0
                    for k in range(places):
                        explained += projection[at_end, place, k] * lengths[k]
                off = abs(lengths[place] - explained)
                if by_span and LEAST - lengths[place] > off:
                    off, explained = LEAST - lengths[place], LEAST
                if off > worst:
                    worst, found = off, (float(span), float(place), lengths[place], explained)
    return found


def judged(report: Report, recorder: Recorder) -> Report:
    """The report of a run, with the status UNRESOLVED if a recorded shape is no cable's."""
    if not report.status.advanced or not recorder.count:
        return report
    wrong = unexplained_stretch(recorder.model, recorder.points)
    return report._replace(status=Status.UNRESOLVED, message=wrong) if wrong else report


def _line(part: Part, u: float, what: str) -> str:
    model = part.model
    finer = 2 * (model.n - bspline.DEGREE) + bspline.DEGREE
    where = f"at u = {round(u, 9):.3g} m" + f" of {part.name}" * (part.name != MAIN)
    return (
        f"{where} {what} that knot spans of "
        f"{part.length / (model.n - bspline.DEGREE):.2g} m cannot resolve; "
        f"raise discretization.control_points from {model.n} to {finer}, or check that what moves "
        "the cable leaves it its length"
    )


class _Places(NamedTuple):
    """Gauss points and both ends of every span.

    Attributes:
        u: material coordinates [m], shape (spans, places).
        slopes: from the control points of a span to r', shape (spans, places, 4).
        projection: from |r'| of a span to its projected strain plus 1, shape (2, places, places);
            that of the first and the last span second.
    """

    u: Array
    slopes: Array
    projection: Array


@lru_cache(16)
def _places(knots: bytes) -> _Places:
    known = np.frombuffer(knots)
    ends = bspline.breaks(known)
    xi, weights = np.polynomial.legendre.leggauss(_GAUSS_POINTS)
    xi, weights = np.array([-_INSIDE, *xi, _INSIDE]), np.array([0.0, *weights, 0.0])
    u = 0.5 * (ends[1:] + ends[:-1])[:, None] + 0.5 * np.diff(ends)[:, None] * xi
    n = len(known) - bspline.ACTIVE
    slopes = bspline.evaluate(np.eye(n), known, u.ravel(), 1).reshape(*u.shape, n)
    slopes[np.diff(ends) == 0.0] = 0.0
    local = [slopes[span, :, span : span + bspline.ACTIVE] for span in range(len(u))]
    mean = np.broadcast_to(0.5 * weights, (len(xi), len(xi)))
    linear = 1.5 * np.outer(xi, weights * xi)
    return _Places(u, np.array(local), np.stack((mean, mean + linear)))
