"""Known answers: what the tests of study contact measure beside exact values, and their cables."""

from __future__ import annotations

import warnings
from collections.abc import Mapping
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from dlo_sim.core import bspline
from dlo_sim.scene.loading import flat_keys, scene_from_values
from dlo_sim.simulation.simulator import Simulator
from dlo_sim.studies.runs import Timed

Array = NDArray[np.float64]
Values = dict[str, object]
CLAMPED: Values = {"fixed": [True] * 3, "clamped": True, "tangent": [1.0, 0.0, 0.0]}


class Answer(NamedTuple):
    """A measured quantity beside its exact value, and the error that is allowed, relative unless
    the exact value is 0.
    """

    quantity: str
    exact: float
    value: float
    allowed: float

    @property
    def error(self) -> float:
        """Relative error, or the value where it should be 0."""
        return self.value / self.exact - 1.0 if self.exact else self.value

    @property
    def meets(self) -> bool:
        """Whether the error is at most the allowed one."""
        return abs(self.error) <= self.allowed

    @property
    def words(self) -> str:
        """The error beside the allowed one."""
        if self.exact:
            return (
                f"{self.quantity} off by {100.0 * abs(self.error):.2g} %, "
                f"allowed {100.0 * self.allowed:.2g} %"
            )
        return f"{self.quantity} {abs(self.error):.2g}, allowed {self.allowed:.2g}"


class Answers(NamedTuple):
    """Answers of a test, the processor time [s] of its steps, its last simulator; of knots the rows
    of LOOPS.
    """

    answers: tuple[Answer, ...]
    seconds: float
    simulator: Simulator | None
    loops: tuple[tuple[object, ...], ...] = ()


def answered(sims: Timed | list[Timed], *answers: Answer) -> Answers:
    """Answers of one or several simulators."""
    every = [sims] if isinstance(sims, Timed) else sims
    return Answers(answers, sum(one.seconds for one in every), every[-1])


def simulator(*values: Mapping[str, object], step: float) -> Timed:
    """A simulator of merged values, nested or not, with energy_momentum."""
    merged: Values = {"integrator.method": "energy_momentum", "integrator.step": step}
    for one in values:
        merged |= flat_keys(one)
    return Timed(scene_from_values(merged))


def laid_along(path: Array, points: int) -> tuple[float, Array]:
    """Length of a path of dense points (m, 3), and control points of a cable along it."""
    s = np.append(0.0, np.cumsum(np.linalg.norm(np.diff(path, axis=0), axis=1)))
    u = np.linspace(0.0, s[-1], 20 * points)
    basis = bspline.evaluate(np.eye(points), bspline.clamped_knots(points, s[-1]), u)
    dense = np.stack([np.interp(u, s, path[:, axis]) for axis in range(3)], axis=1)
    return float(s[-1]), np.asarray(np.linalg.lstsq(basis, dense, rcond=None)[0])


def with_tails(path: Array, length: float) -> Array:
    """A path of dense points (m, 3) that goes on straight at both ends for a length [m]."""
    tail = np.linspace(0.0, length, 200)[1:, None]
    before, after = path[0] - path[1], path[-1] - path[-2]
    first = path[0] + tail[::-1] * before / np.linalg.norm(before)
    return np.vstack((first, path, path[-1] + tail * after / np.linalg.norm(after)))


def along(
    place: Array, length: float, step: float, *values: Values, velocities: Array | None = None
) -> Timed:
    """A cable with these control points (n, 3) and this length [m], straight without strain, and
    with these velocities [m/s].
    """
    ends: Values = {"start.position": place[0].tolist(), "end.position": place[-1].tolist()}
    size: Values = {"cable.length": length, "discretization.control_points": len(place)}
    sim = simulator(size, ends, *values, step=step)
    theta = np.zeros((len(place), 1))
    rates = None if velocities is None else np.hstack([velocities, theta])
    with warnings.catch_warnings():  # a clamp moves what is beside it by a nanometre
        warnings.filterwarnings("ignore", message="control points: those held")
        sim.start_from(np.hstack([place, theta]), rates)
    return sim
