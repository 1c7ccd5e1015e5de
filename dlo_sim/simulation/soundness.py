"""Whether the local stretch of a shape is what its tension explains: one check, for every run.

A span stretches by what its tension causes, evenly or, at the ends of the cable, linearly: that is
the projected strain of `engine.elastic`. Where |r'| differs from it by more than BOUND somewhere,
the span is folded, or has a cusp, or is held at places between which it cannot reach: such a shape
is none of a cable, and its forces are meaningless. A clamped end whose first span points backwards
is folded, too. (With `discretization.stretch: sample` any local stretch has its tension.)

The bound is no measure of accuracy, which the error estimate is for. Coarse but sensible shapes
stay below it: of 60 cables at rest between grippers (`terms.span_guard`) with 13 control points the
worst deviates by 0.31, with an error of 5 % of the length. Shapes with cusps deviate by 0.6 and
more.
"""

from __future__ import annotations

from functools import lru_cache
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from dlo_sim.core import bspline
from dlo_sim.engine import layout
from dlo_sim.simulation.ends import EndDrive
from dlo_sim.simulation.model import Model
from dlo_sim.simulation.recorder import Recorder
from dlo_sim.simulation.report import Report, Status

Array = NDArray[np.float64]
BOUND = 0.5  # of the rest length
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
    if not model.has(layout.ANY_STRETCH):
        return ""
    places = _places(model.knots.tobytes())
    lengths, explained = places.stretch(points[..., :3])
    if not model.has(layout.SPAN_STRETCH):
        explained = lengths
    off = np.abs(lengths - explained)
    worst = np.unravel_index(int(np.argmax(off)), off.shape)
    if off[worst] > BOUND:
        return _line(model, places.u[worst[-2:]], lengths[worst], explained[worst])
    if ends is None:
        return ""
    for name in ends.clamped:
        at, edge = (0, points[1] - points[0]) if name == "start" else (-1, points[-1] - points[-2])
        along = float(edge[:3] @ ends.tangent(name, time))
        if along <= 0.0:
            k = 0 if name == "start" else -1
            return _line(model, places.u[at, k], -lengths[at, k], explained[at, k])
    return ""


def judged(report: Report, recorder: Recorder) -> Report:
    """The report of a run, with the status UNRESOLVED if a recorded shape is none of a cable."""
    if not report.status.advanced or not recorder.count:
        return report
    wrong = unexplained_stretch(recorder.model, recorder.points)
    return report._replace(status=Status.UNRESOLVED, message=wrong) if wrong else report


def _line(model: Model, u: float, length: float, explained: float) -> str:
    finer = 2 * (model.n - bspline.DEGREE) + bspline.DEGREE
    return (
        f"at u = {u:.3g} m the cable has {length:.2f} of its rest length where its tension "
        f"explains {explained:.2f}: a fold or cusp that knot spans of "
        f"{model.knots[-1] / (model.n - bspline.DEGREE):.2g} m cannot resolve; "
        f"raise discretization.control_points from {model.n} to {finer}, or check that what moves "
        "the cable leaves it its length"
    )


class _Places(NamedTuple):
    """Gauss points and both ends of every span.

    Attributes:
        u: material coordinates [m], shape (spans, places).
        slopes: matrix from control points to r', shape (spans places, n).
        projection: from |r'| of a span to its projected strain plus 1, shape (2, places, places);
            that of the first and the last span second.
    """

    u: Array
    slopes: Array
    projection: Array

    def stretch(self, points: Array) -> tuple[Array, Array]:
        """|r'|, and what the tension explains of it, shape (..., spans, places) each."""
        t = self.slopes @ points
        lengths = np.sqrt((t * t).sum(axis=-1)).reshape(*points.shape[:-2], *self.u.shape)
        explained = lengths @ self.projection[0].T
        explained[..., [0, -1], :] = lengths[..., [0, -1], :] @ self.projection[1].T
        return lengths, explained


@lru_cache(16)
def _places(knots: bytes) -> _Places:
    known = np.frombuffer(knots)
    ends = bspline.breaks(known)
    xi, weights = np.polynomial.legendre.leggauss(_GAUSS_POINTS)
    xi, weights = np.array([-_INSIDE, *xi, _INSIDE]), np.array([0.0, *weights, 0.0])
    u = 0.5 * (ends[1:] + ends[:-1])[:, None] + 0.5 * np.diff(ends)[:, None] * xi
    slopes = bspline.evaluate(np.eye(len(known) - bspline.ACTIVE), known, u.ravel(), 1)
    mean = np.broadcast_to(0.5 * weights, (len(xi), len(xi)))
    linear = 1.5 * np.outer(xi, weights * xi)
    return _Places(u, slopes, np.stack((mean, mean + linear)))
