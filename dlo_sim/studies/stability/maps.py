"""Stability limits and energy errors over (n_u, tau), (E, tau) and (diameter, tau).

One aluminium wire of 2 m, clamped at one end, released straight. Under a thousandth of gravity it
vibrates by millimetres (linear); under gravity its end falls by more than its length (large). One
point of a map is one cable with one method; its limits and its energy errors over all steps are one
piece of work.
"""

from __future__ import annotations

import time
from dataclasses import dataclass, field
from itertools import product
from typing import Any, NamedTuple

import numpy as np

from dlo_sim.core.methods import IMPLICIT, METHODS
from dlo_sim.scene.description import Scene
from dlo_sim.scene.loading import SceneError, scene_from_values
from dlo_sim.simulation.simulator import Simulator
from dlo_sim.studies.runs import bisected
from dlo_sim.studies.stability.scenes import ALUMINIUM, CANTILEVER

KEYS = {
    "n_u": "discretization.control_points",
    "E": "cable.youngs_modulus",
    "diameter": "cable.diameter",
}
GRAVITY = {"linear": 0.01, "large": 9.81}  # [m/s^2]
DAMPING = {"undamped": 0.0, "damped": 2.0}  # damping.mass [1/s]
GROWTH = 2.0**0.5  # of the brackets of an observed limit
BELOW = 1.13  # they start so far below the predicted one
FEWEST_STEPS = 64  # of an energy run: explicit methods look at the energy every 16 steps
MOST_STEP = 1.0  # [s] that a scene may have
FARTHEST = 16.0  # an observed limit is looked for so far from the predicted one, at least
LEAST_IMPLICIT_STEP = 9e-5  # [s]; implicit methods are not meant for smaller ones

FINISHED, STOPPED, SLOW, SKIPPED, REFUSED = "finished", "stopped", "slow", "not run", "refused"


@dataclass(frozen=True)
class Extent:
    """How much is computed.

    Attributes:
        methods: compared. values: of each axis. steps: tau [s].
        duration, budget: of the energy runs: simulated time [s], most time of stepping [s].
        trial, least_trial: time [s] and steps that a step has to survive to count as stable.
        tolerance: of observed limits.
    """

    methods: tuple[str, ...]
    values: dict[str, tuple[float, ...]] = field(hash=False)
    steps: tuple[float, ...]
    duration: float
    trial: float
    least_trial: int
    tolerance: float
    budget: float

    @property
    def points(self) -> list[Point]:
        """All points of all maps, the most expensive first (more control points)."""
        return [
            Point(axis, value, method, damping, motion, self)
            for axis, values in self.values.items()
            for value, method, damping, motion in product(
                reversed(values), self.methods, DAMPING, GRAVITY
            )
        ]


FULL = Extent(
    tuple(METHODS),
    {
        "n_u": (5, 9, 13, 19, 40),
        "E": (1e4, 1e6, 1e8, 1e10, 1e12),
        "diameter": (1e-4, 5e-4, 2e-3, 1e-2, 5e-2),
    },
    tuple(float(f"{10.0**e:.2g}") for e in np.arange(-5.0, -0.9, 0.5)),
    duration=10.0,
    trial=1.0,
    least_trial=4000,
    tolerance=0.01,
    budget=20.0,
)
QUICK = Extent(
    ("forest_ruth", "velocity_verlet", "energy_momentum"),
    {"n_u": (5, 13, 40), "E": (1e6, 1e9, 1e12), "diameter": (1e-4, 2e-3, 5e-2)},
    (1e-5, 1e-4, 1e-3, 1e-2, 1e-1),
    duration=1.0,
    trial=0.3,
    least_trial=3000,
    tolerance=0.02,
    budget=3.0,
)


class Point(NamedTuple):
    """One cable and one method; `value` is of the `axis` n_u, E [Pa] or diameter [m]."""

    axis: str
    value: float
    method: str
    damping: str
    motion: str
    extent: Extent


@dataclass(frozen=True)
class Limits:
    """What became of a point.

    Attributes:
        outcomes, errors: per step of the map: what became of the run, and its largest energy error
            as a share of the energy exchanged (nan unless it finished).
        predicted, observed: largest stable step [s]; nan where the method was refused. An implicit
            method has the predicted limit inf; observed is then the largest step of the map up to
            which every run reached its end. Both are nan where no step was stable.
        below: then the smallest step [s] that was tried, which the limit is below; else nan.
    """

    outcomes: tuple[str, ...]
    errors: tuple[float, ...]
    predicted: float = np.nan
    observed: float = np.nan
    below: float = np.nan


def scene_of(point: Point, step: float = 0.0) -> Scene:
    """The scene of a point with a step [s]; 0 = its own."""
    values: dict[str, Any] = {
        **ALUMINIUM,
        **CANTILEVER,
        "end.position": [2.0, 0.0, 0.0],
        "discretization.control_points": 9,
        "terms.twist": "off",
        "gravity": [0.0, 0.0, -GRAVITY[point.motion]],
        "damping.mass": DAMPING[point.damping],
        "initial.shape": "straight",
        "integrator.method": point.method,
        "integrator.step": step,
    }
    values[KEYS[point.axis]] = int(point.value) if point.axis == "n_u" else point.value
    return scene_from_values(values)


def examine(point: Point) -> Limits:
    """Limits and energy errors of one point; a function for workers."""
    steps = point.extent.steps
    try:
        predicted = Simulator(scene_of(point)).choice.limit
    except SceneError:
        nothing = (np.nan,) * len(steps)
        return Limits((REFUSED,) * len(steps), nothing)
    outcomes, errors = zip(*(_energy_run(point, step) for step in steps), strict=True)
    if METHODS[point.method].family == IMPLICIT:
        observed, below = _reached(steps, outcomes)
    else:
        observed, below = _observed(point, predicted)
    return Limits(outcomes, errors, predicted, observed, below)


def _energy_run(point: Point, step: float) -> tuple[str, float]:
    """Outcome and largest energy error."""
    if METHODS[point.method].family == IMPLICIT and step < LEAST_IMPLICIT_STEP:
        return SKIPPED, np.nan
    simulator = Simulator(scene_of(point, step), unchecked_step=True)
    steps = max(round(point.extent.duration / step), FEWEST_STEPS)
    piece = max(steps // 100, 1)
    until = time.perf_counter() + point.extent.budget
    while simulator.steps < steps:
        if not simulator.advance_steps(min(piece, steps - simulator.steps)).status.ok:
            return STOPPED, np.nan
        if time.perf_counter() > until:
            return SLOW, np.nan
    return FINISHED, max(float(simulator.energy_error), 1e-16)


def _reached(steps: tuple[float, ...], outcomes: tuple[str, ...]) -> tuple[float, float]:
    """Largest step [s] before the first run that was stopped; without one, that run's step."""
    reached = np.nan
    for step, outcome in zip(steps, outcomes, strict=True):
        if outcome == STOPPED:
            return reached, step if np.isnan(reached) else np.nan
        reached = step if outcome == FINISHED else reached
    return reached, np.nan


def _observed(point: Point, predicted: float) -> tuple[float, float]:
    """Largest step [s] at which a trial is not stopped, by bisection; inf if it is out of reach.

    It is looked for down to the smallest step of the map; if there is none: nan, and the last
    tried.
    """
    low = min(predicted / BELOW, MOST_STEP / GROWTH)
    if _survives(point, low):
        high = low * GROWTH
        while _survives(point, high):
            low, high = high, high * GROWTH
            if high > min(FARTHEST * predicted, MOST_STEP):
                return np.inf, np.nan
    else:
        least = min(predicted / FARTHEST, point.extent.steps[0])
        low, high = low / GROWTH, low
        while not _survives(point, low):
            if low < least:
                return np.nan, low
            low, high = low / GROWTH, low
    tolerance = point.extent.tolerance
    return bisected(lambda step: _survives(point, step), low, high, tolerance), np.nan


def _survives(point: Point, step: float) -> bool:
    steps = max(round(point.extent.trial / step), point.extent.least_trial)
    simulator = Simulator(scene_of(point, step), unchecked_step=True)
    return simulator.advance_steps(steps).status.ok
