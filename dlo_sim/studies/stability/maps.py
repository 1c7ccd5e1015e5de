"""Stability limits and energy errors over (n_u, tau), (E, tau) and (diameter, tau).

One aluminium wire of 2 m, clamped at one end, released straight. Under a thousandth of gravity it
vibrates by millimetres (linear); under gravity its end falls by more than its length (large). One
point of a map is one cable with one method; its limits and its energy errors over all steps are one
piece of work.
"""

from __future__ import annotations

import time
from dataclasses import dataclass, field
from typing import Any

import numpy as np

from dlo_sim.core.methods import IMPLICIT, METHODS
from dlo_sim.scene.description import Scene
from dlo_sim.scene.loading import SceneError, scene_from_values
from dlo_sim.simulation.simulator import Simulator
from dlo_sim.studies.stability.parts import ALUMINIUM, CANTILEVER

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
        values: of each axis. steps: tau [s]. duration: of the energy runs [s].
        trial, least_trial: time [s] and steps that a step has to survive to count as stable.
        tolerance: of observed limits. budget: time of one energy run [s].
    """

    values: dict[str, tuple[float, ...]] = field(hash=False)
    steps: tuple[float, ...]
    duration: float
    trial: float
    least_trial: int
    tolerance: float
    budget: float


FULL = Extent(
    {
        "n_u": (5, 9, 13, 19, 40),
        "E": (1e4, 1e6, 1e8, 1e10, 1e12),
        "diameter": (1e-4, 5e-4, 2e-3, 1e-2, 5e-2),
    },
    tuple(float(f"{10.0**e:.2g}") for e in np.arange(-5.0, -0.9, 0.5)),
    10.0,
    1.0,
    4000,
    0.01,
    20.0,
)
QUICK = Extent(
    {"n_u": (5, 13, 40), "E": (1e6, 1e9, 1e12), "diameter": (1e-4, 2e-3, 5e-2)},
    (1e-5, 1e-4, 1e-3, 1e-2, 1e-1),
    1.0,
    0.3,
    3000,
    0.02,
    3.0,
)


@dataclass(frozen=True)
class Point:
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
        predicted, observed: largest stable step [s]; None where the method was refused. An implicit
            method has the predicted limit inf; observed is then the largest step of the map up to
            which every run reached its end. Observed is 0 where no step was stable.
        below: then the smallest step [s] that was tried, which the limit is below.
        outcomes, errors: per step of the map: what became of the run, and its largest energy error
            as a share of the energy exchanged (inf unless it finished).
        wall: time of stepping [s] of the runs.
    """

    predicted: float | None
    observed: float | None
    outcomes: tuple[str, ...]
    errors: tuple[float, ...]
    wall: float
    reason: str = ""
    below: float | None = None


def points(extent: Extent) -> list[Point]:
    """All points of all maps, the most expensive first (more control points, explicit)."""
    found = [
        Point(axis, value, method, damping, motion, extent)
        for axis, values in extent.values.items()
        for value in reversed(values)
        for method in METHODS
        for damping in DAMPING
        for motion in GRAVITY
    ]
    return found


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
    """Limits and energy errors of one point."""
    steps = point.extent.steps
    try:
        predicted = Simulator(scene_of(point)).choice.limit
    except SceneError as refusal:
        return Limits(
            None, None, (REFUSED,) * len(steps), (np.inf,) * len(steps), 0.0, str(refusal)
        )
    runs = [_energy_run(point, step) for step in steps]
    outcomes = tuple(outcome for outcome, _, _ in runs)
    if METHODS[point.method].family == IMPLICIT:
        observed, below = _reached(steps, outcomes)
    else:
        observed, below = _observed(point, predicted)
    return Limits(
        predicted,
        observed,
        outcomes,
        tuple(error for _, error, _ in runs),
        sum(wall for _, _, wall in runs),
        below=below,
    )


def _energy_run(point: Point, step: float) -> tuple[str, float, float]:
    """Outcome, largest energy error and time of stepping [s]."""
    if METHODS[point.method].family == IMPLICIT and step < LEAST_IMPLICIT_STEP:
        return SKIPPED, np.inf, 0.0
    simulator = Simulator(scene_of(point, step), unchecked_step=True)
    steps = max(round(point.extent.duration / step), FEWEST_STEPS)
    piece = max(steps // 100, 1)
    wall = 0.0
    while simulator.steps < steps:
        began = time.perf_counter()
        report = simulator.advance_steps(min(piece, steps - simulator.steps))
        wall += time.perf_counter() - began
        if not report.status.ok:
            return STOPPED, np.inf, wall
        if wall > point.extent.budget:
            return SLOW, np.inf, wall
    return FINISHED, max(float(simulator.energy_error), 1e-16), wall


def _reached(steps: tuple[float, ...], outcomes: tuple[str, ...]) -> tuple[float, float | None]:
    """Largest step [s] before the first run that was stopped; without one, that run's step."""
    reached = 0.0
    for step, outcome in zip(steps, outcomes, strict=True):
        if outcome == STOPPED:
            return reached, None if reached else step
        reached = step if outcome == FINISHED else reached
    return reached, None


def _observed(point: Point, predicted: float) -> tuple[float, float | None]:
    """Largest step [s] at which a trial is not stopped, by bisection; inf if it is out of reach.

    It is looked for down to the smallest step of the map; if there is none: 0 and the last tried.
    """
    low = min(predicted / BELOW, MOST_STEP / GROWTH)
    if _survives(point, low):
        high = low * GROWTH
        while _survives(point, high):
            low, high = high, high * GROWTH
            if high > min(FARTHEST * predicted, MOST_STEP):
                return np.inf, None
    else:
        least = min(predicted / FARTHEST, point.extent.steps[0])
        low, high = low / GROWTH, low
        while not _survives(point, low):
            if low < least:
                return 0.0, low
            low, high = low / GROWTH, low
    while high / low > 1.0 + point.extent.tolerance:
        middle = float(np.sqrt(low * high))
        low, high = (middle, high) if _survives(point, middle) else (low, middle)
    return float(np.sqrt(low * high)), None


def _survives(point: Point, step: float) -> bool:
    steps = max(round(point.extent.trial / step), point.extent.least_trial)
    simulator = Simulator(scene_of(point, step), unchecked_step=True)
    return simulator.advance_steps(steps).status.ok
