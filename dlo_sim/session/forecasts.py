"""Forecasts of plans as messages: `~/forecast` and `~/forecast/ghosts`."""

from __future__ import annotations

import time
from typing import TYPE_CHECKING, NamedTuple

import numpy as np
from numpy.typing import NDArray

from dlo_sim.scene.description import Scene
from dlo_sim.session import cdr
from dlo_sim.session.cdr_markers import LINE_LIST, LineEncoder
from dlo_sim.session.cdr_points import PointCloudEncoder, needs_doubles
from dlo_sim.session.outputs import OutgoingMessage
from dlo_sim.session.plans import Planned
from dlo_sim.session.time_base import SECOND
from dlo_sim.session.topics import FORECAST, GHOSTS

if TYPE_CHECKING:
    from dlo_sim.simulation.forecast import Forecast

Array = NDArray[np.float64]
_GHOST_COLOR = (0.4, 0.8, 0.4, 0.3)


class Answer(NamedTuple):
    """Result of one plan.

    Attributes:
        messages: to be published. values: for the diagnostics.
        problem: why the cable could not be predicted to the end of the plan, one line; or empty.
    """

    messages: tuple[OutgoingMessage, ...] = ()
    values: tuple[tuple[str, str], ...] = ()
    problem: str = ""


def answer(planned: Planned) -> Answer:
    """Predict the cable along a plan and serialise the result."""
    began = time.perf_counter()
    scene, stamp_ns = planned.simulator.scene, planned.stamp_ns
    end = float(np.max(planned.plan.times))
    try:
        found = planned.simulator.forecast(planned.plan, min(scene.forecast.every, end))
    except (TypeError, ValueError) as refusal:
        return Answer(problem=str(refusal))
    if not len(found.times):
        return Answer(problem=found.report.message)
    cloud = _cloud(scene, found, planned.ahead).encode(stamp_ns)
    ghosts = _ghosts(scene, found, end - planned.ahead).encode(stamp_ns)
    messages = (
        OutgoingMessage(FORECAST, cdr.POINT_CLOUD, stamp_ns, cloud),
        OutgoingMessage(GHOSTS, cdr.MARKER, stamp_ns, ghosts),
    )
    peak = found.peak_tension
    values = (
        ("peak tension [N]", "unknown" if peak is None else f"{peak:.4g}"),
        ("largest curvature [1/m]", f"{found.largest_curvature:.4g}"),
        ("forecast time [ms]", f"{1e3 * (time.perf_counter() - began):.1f}"),
    )
    return Answer(messages, values, found.report.message)


def _cloud(scene: Scene, found: Forecast, ahead: float) -> PointCloudEncoder:
    """A cloud of the points of all shapes; its field t counts from the plan's stamp [s]."""
    fields = ["x", "y", "z", "u", "t"] + ["tension"] * (found.tension is not None)
    shapes, points, _ = found.centerline.shape
    doubles = needs_doubles(found.centerline)
    cloud = PointCloudEncoder(scene.frame_id, fields, shapes * points, doubles)
    rows = cloud.rows.reshape(shapes, points, len(fields))
    rows[..., :3], rows[..., 3] = found.centerline, found.u
    rows[..., 4] = (found.times - ahead)[:, None]
    if found.tension is not None:
        rows[..., 5] = found.tension
    return cloud


def _ghosts(scene: Scene, found: Forecast, lifetime: float) -> LineEncoder:
    """Lines of a few shapes including the last one, displayed for `lifetime` [s]."""
    count = len(found.times)
    chosen = np.unique(np.linspace(count - 1, -1, scene.forecast.ghosts, endpoint=False).round())
    # A list of lines: each point inside a shape ends one and begins the next.
    lines = np.repeat(found.centerline[chosen.astype(int)], 2, axis=1)[:, 1:-1].reshape(-1, 3)
    ghosts = LineEncoder(
        *(scene.frame_id, "forecast", len(lines), scene.cable.diameter, _GHOST_COLOR),
        round(max(lifetime, 0.1) * SECOND),
        kind=LINE_LIST,
    )
    ghosts.rows[:] = lines
    return ghosts
