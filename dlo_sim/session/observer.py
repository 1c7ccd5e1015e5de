"""An observer that corrects the prediction by points measured on the cable.

A measurement is used at the first step not before its stamp. Each point is assigned to the nearest
point of the predicted centerline and rejected beyond `measured.gate`. The gains are those of
`core.error_filter`. Repeated corrections are attributed to a force missing from the model, which
continues to act. The energy that a correction adds enters the energy balance.
"""

from __future__ import annotations

import math
from collections.abc import Iterator
from typing import TYPE_CHECKING, NamedTuple

import numpy as np
from numpy.typing import NDArray

from dlo_sim.core import bspline
from dlo_sim.core.error_filter import ErrorFilter
from dlo_sim.scene.description import Measured
from dlo_sim.session.diagnostics import Journal
from dlo_sim.session.waiting import Waiting

if TYPE_CHECKING:
    from dlo_sim.simulation.simulator import Simulator

Array = NDArray[np.float64]
_PLACES = 201  # points of the centerline that are searched for the nearest
# Missing acceleration that is learnt per metre of correction [1/s^2], and its decay time [s]. On
# recorded cables this reduces the error by 8 %; six times as much makes the lightest one swing.
_LEARNT, _LASTS = 45.0, 1.6


class Points(NamedTuple):
    """An accepted measurement: stamp in the time base [ns], points [m], shape (k, 3)."""

    stamp_ns: int
    points: Array


class Observer(Waiting[Points]):
    """Measured points that wait, and the corrections of a simulator by them.

    Args:
        measured: settings of the scene. journal: counts measurements that are lost or late.

    Attributes:
        used, rejected: numbers of points so far.
        work: energy added by corrections [J]; counted by the caller that applies them.
        innovation: rms distance of the points of the last measurement from the prediction [m].
    """

    def __init__(self, measured: Measured, journal: Journal) -> None:
        self.measured = measured
        self._note = journal.event
        self.used = self.rejected = 0
        self.work = self.innovation = 0.0
        super().__init__()

    def clear(self) -> None:
        """Discard the waiting measurements, and what was learnt from earlier ones."""
        super().clear()
        self._simulator: Simulator | None = None
        self._time, self._lacking = 0.0, np.zeros((0, 3))

    def add(self, message: Points) -> None:
        """Take an accepted measurement, as `Waiting.add`; a full queue loses its oldest."""
        most = self._pending.maxlen
        if len(self._pending) == most:
            self.rejected += len(self._pending[0].points)
            self._note("full", f"more than {most} measurements wait; the oldest is lost")
        super().add(message)

    def in_time(self, now_ns: int, step_ns: float) -> Iterator[Array]:
        """Remove the measurements up to a time [ns]; yield those at most a step [ns] late, oldest
        first.
        """
        for stamp_ns, points in self.due(now_ns):
            if now_ns - stamp_ns > step_ns:
                self.rejected += len(points)
                self._note(
                    "late", "measured points came after their time was simulated, and are not used"
                )
            else:
                yield points

    def values(self) -> list[tuple[str, str]]:
        """Keys and values for the diagnostics."""
        return [
            ("innovation [m]", f"{self.innovation:.3g}"),
            ("measured points used", str(self.used)),
            ("measured points rejected", str(self.rejected)),
            ("correction work [J]", f"{self.work:.3g}"),
        ]

    def correction(self, points: Array, simulator: Simulator) -> tuple[Array, Array] | None:
        """Shifts of the control points [m] and changes of their velocities [m/s], shape (n, 3)
        each, from points measured now; None if no point is near the cable.
        """
        if simulator is not self._simulator:
            self._begin(simulator)
        passed = simulator.time - self._time
        self._filter.advance(passed)
        self._time = simulator.time
        line = self._basis @ simulator.control_points[:, :3]
        nearest = nearest_of(line, points)
        near = np.linalg.norm(points - line[nearest], axis=-1) <= self.measured.gate
        self.rejected += int(np.sum(~near))
        if not near.any():
            return None
        self.used += int(np.sum(near))
        distances = points[near] - line[nearest[near]]
        self.innovation = float(np.sqrt(np.mean(np.sum(distances**2, axis=1))))
        shift, speed = self._filter.update(self._basis[nearest[near]], distances)
        # Repeated corrections are the effect of a force that the model lacks.
        self._lacking = math.exp(-passed / _LASTS) * self._lacking + _LEARNT * shift
        return shift, speed + min(passed, self.measured.alike_for) * self._lacking

    def _begin(self, simulator: Simulator) -> None:
        """Start with a new filter for this simulator."""
        knots, measured = simulator.model.knots, self.measured
        length = simulator.scene.cable.length
        n = simulator.model.n
        u = np.linspace(0.0, length, _PLACES)
        self._basis = bspline.evaluate(np.eye(n), knots, u)
        held = [point.values(n) for point in simulator.model.holding.rigid_points]
        self._filter = ErrorFilter(
            *(simulator.greville, np.reshape(held, (-1, n)), measured.error),
            *(measured.alike_along * length, measured.alike_for, measured.noise),
        )
        self._simulator, self._time = simulator, simulator.time
        self._lacking = np.zeros((n, 3))


def nearest_of(line: Array, points: Array) -> NDArray[np.int64]:
    """Index of the nearest of the places on a line (m, 3) to each point (k, 3)."""
    # |p - r|^2 without |p|^2, near the origin, where little is lost to rounding.
    middle = line.mean(axis=0)
    places = line - middle
    squares = np.einsum("ij,ij->i", places, places)
    return np.argmin(squares - 2.0 * ((points - middle) @ places.T), axis=1)
