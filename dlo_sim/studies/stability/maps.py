"""Stability limits and energy errors over (n_u, tau), (E, tau) and (diameter, tau).

An aluminium wire of 2 m, clamped at one end, released straight. Under a thousandth of gravity it
vibrates by millimetres (linear); under gravity its end falls by more than its length (large). A
point of a map with all its steps is one task for a worker.
"""

from __future__ import annotations

import math
import time
from collections.abc import Mapping
from dataclasses import dataclass
from itertools import product
from typing import Any, NamedTuple

import numpy as np
from matplotlib.axes import Axes
from matplotlib.cm import ScalarMappable
from matplotlib.colors import LogNorm

from dlo_sim.core.methods import IMPLICIT, METHODS
from dlo_sim.scene.description import Scene
from dlo_sim.scene.loading import SceneError, scene_from_values
from dlo_sim.simulation.simulator import Simulator
from dlo_sim.studies import plotting
from dlo_sim.studies.report import Report, columns
from dlo_sim.studies.runs import bisected
from dlo_sim.studies.stability.scenes import ALUMINIUM, CANTILEVER

KEYS = {
    "n_u": "discretization.control_points",
    "E": "cable.youngs_modulus",
    "diameter": "cable.diameter",
}
GRAVITY = {"linear": 0.01, "large": 9.81}  # [m/s^2]
DAMPING = {"undamped": 0.0, "damped": 2.0}  # damping.mass [1/s]
GROWTH = 2.0**0.5  # ratio of the brackets of an observed limit
BELOW = 1.13  # ratio of the predicted limit to the first bracket
FEWEST_STEPS = 64  # of an energy run: explicit methods check the energy every 16 steps
MOST_STEP = 1.0  # [s], upper bound on the step of a scene
FARTHEST = 16.0  # least factor about the predicted limit within which the observed one is searched
LEAST_IMPLICIT_STEP = 9e-5  # [s]; smaller steps are not run with implicit methods

FINISHED, STOPPED, SLOW, SKIPPED, REFUSED = "finished", "stopped", "slow", "not run", "refused"
UNITS = {"n_u": "-", "E": "Pa", "diameter": "m"}
SCALE = LogNorm(1e-14, 1.0)  # of the energy errors shown
SIGNS = {STOPPED: "x", SLOW: "?"}
QUICK_METHODS = ("forest_ruth", "velocity_verlet", "energy_momentum")
METHODS_COMPARED = {True: QUICK_METHODS, False: tuple(METHODS)}
VALUES: dict[bool, dict[str, tuple[float, ...]]] = {  # of each axis
    True: {"n_u": (5, 13, 40), "E": (1e6, 1e9, 1e12), "diameter": (1e-4, 2e-3, 5e-2)},
    False: {
        "n_u": (5, 9, 13, 19, 40),
        "E": (1e4, 1e6, 1e8, 1e10, 1e12),
        "diameter": (1e-4, 5e-4, 2e-3, 1e-2, 5e-2),
    },
}
STEPS = {  # tau [s]
    True: (1e-5, 1e-4, 1e-3, 1e-2, 1e-1),
    False: tuple(float(f"{10.0**e:.2g}") for e in np.arange(-5.0, -0.9, 0.5)),
}
DURATION = {True: 1.0, False: 10.0}  # [s], simulated, of the energy runs
BUDGET = {True: 3.0, False: 20.0}  # [s], largest run time of each
TRIAL = {True: 0.3, False: 1.0}  # [s], duration of a trial of a step,
LEAST_TRIAL = {True: 3000, False: 4000}  # and its least number of steps
TOLERANCE = {True: 0.02, False: 0.01}  # of observed limits


class Point(NamedTuple):
    """One cable and one method; `value` is of the `axis` n_u, E [Pa] or diameter [m]."""

    axis: str
    value: float
    method: str
    damping: str
    motion: str
    quick: bool


def points(quick: bool) -> list[Point]:
    """All points of all maps, the most expensive first (more control points)."""
    return [
        Point(axis, value, method, damping, motion, quick)
        for axis, values in VALUES[quick].items()
        for value, method, damping, motion in product(
            reversed(values), METHODS_COMPARED[quick], DAMPING, GRAVITY
        )
    ]


@dataclass(frozen=True)
class Limits:
    """Results of a point.

    Attributes:
        outcomes, errors: per step of the map: outcome of the run, and its largest energy error as a
            share of the energy exchanged (nan unless it finished).
        predicted, observed: largest stable step [s], nan for a refused method; for an implicit one
            inf, and the largest step of the map up to which every run reached its end.
        below: the smallest step [s] tried, if none was stable and observed is nan; else nan.
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
    steps = STEPS[point.quick]
    try:
        predicted = Simulator(scene_of(point)).choice.limit
    except SceneError:
        return Limits((REFUSED,) * len(steps), (np.nan,) * len(steps))
    outcomes, errors = zip(*(_energy_run(point, step) for step in steps), strict=True)
    if METHODS[point.method].family == IMPLICIT:
        observed, below = _reached(steps, outcomes)
    else:
        observed, below = _observed(point, predicted)
    return Limits(outcomes, errors, predicted, observed, below)


def _energy_run(point: Point, step: float) -> tuple[str, float]:
    """Outcome and largest energy error of a run with this step."""
    if METHODS[point.method].family == IMPLICIT and step < LEAST_IMPLICIT_STEP:
        return SKIPPED, np.nan
    simulator = Simulator(scene_of(point, step), unchecked_step=True)
    steps = max(round(DURATION[point.quick] / step), FEWEST_STEPS)
    piece = max(steps // 100, 1)
    until = time.perf_counter() + BUDGET[point.quick]
    while simulator.steps < steps:
        if not simulator.advance_steps(min(piece, steps - simulator.steps)).status.advanced:
            return STOPPED, np.nan
        if time.perf_counter() > until:
            return SLOW, np.nan
    return FINISHED, max(float(simulator.energy_error), 1e-16)


def _reached(steps: tuple[float, ...], outcomes: tuple[str, ...]) -> tuple[float, float]:
    """`observed` and `below` of an implicit method, from the runs at the steps of the map."""
    reached = np.nan
    for step, outcome in zip(steps, outcomes, strict=True):
        if outcome == STOPPED:
            return reached, step if np.isnan(reached) else np.nan
        reached = step if outcome == FINISHED else reached
    return reached, np.nan


def _observed(point: Point, predicted: float) -> tuple[float, float]:
    """`observed` and `below` of an explicit method: largest step [s] at which a trial is not
    stopped, by bisection; inf if it is beyond the range of the search.
    """
    low = min(predicted / BELOW, MOST_STEP / GROWTH)
    if _survives(point, low):
        high = low * GROWTH
        while _survives(point, high):
            low, high = high, high * GROWTH
            if high > min(FARTHEST * predicted, MOST_STEP):
                return np.inf, np.nan
    else:
        least = min(predicted / FARTHEST, STEPS[point.quick][0])
        low, high = low / GROWTH, low
        while not _survives(point, low):
            if low < least:
                return np.nan, low
            low, high = low / GROWTH, low
    tolerance = TOLERANCE[point.quick]
    return bisected(lambda step: _survives(point, step), low, high, tolerance), np.nan


def _survives(point: Point, step: float) -> bool:
    steps = max(round(TRIAL[point.quick] / step), LEAST_TRIAL[point.quick])
    simulator = Simulator(scene_of(point, step), unchecked_step=True)
    return simulator.advance_steps(steps).status.advanced


def add(report: Report, quick: bool, results: Mapping[Point, Limits]) -> None:
    """Add six figures and two tables."""
    report.section("Stability limits and energy errors")
    report.text(
        """An aluminium wire (2 m, 2 mm, n_u = 9, 3 Gauss points per span), clamped at one end and
        released straight; one of n_u, E and diameter varies. Under 0.01 m/s^2 it vibrates by
        millimetres (linear), under 9.81 m/s^2 it falls (large). Damped: damping.mass = 2 1/s.
        Limits: predicted from the largest frequency at the start; observed by bisection as the
        largest step at which a trial is not stopped, for implicit methods as the largest step of
        the map up to which every run reached its end. Energy errors are relative to the largest
        energy exchanged."""
    )
    for axis, damping in product(KEYS, DAMPING):
        _figure(report, quick, results, axis, damping)
    _tables(report, quick, results)


def _figure(
    report: Report, quick: bool, results: Mapping[Point, Limits], axis: str, damping: str
) -> None:
    mine = {p: r for p, r in results.items() if (p.axis, p.damping) == (axis, damping)}
    methods, label = METHODS_COMPARED[quick], f"{axis} [{UNITS[axis]}]"
    count = len(methods)
    figure, axes = plotting.new_figure(len(GRAVITY), count, 2.0 + 2.2 * count, 7.4)
    for panel, (motion, method) in zip(
        axes, product(GRAVITY, METHODS_COMPARED[quick]), strict=True
    ):
        own = {p.value: r for p, r in mine.items() if (p.motion, p.method) == (motion, method)}
        _panel(panel, STEPS[quick], dict(sorted(own.items())))
        panel.set(xlabel=label, ylabel="step [s]")
        panel.set_title(f"{method}\n{motion}", fontsize="medium")
        panel.label_outer()
    colors = ScalarMappable(SCALE, "viridis")
    figure.colorbar(colors, ax=axes, label="energy error, relative [-]", shrink=0.8)
    figure.suptitle(damping)
    rows = [
        (p.method, p.motion, p.value, r.predicted, r.observed, r.below, *run)
        for p, r in mine.items()
        for run in zip(STEPS[quick], r.outcomes, r.errors, strict=True)
    ]
    header = f"method | motion | {label} | predicted limit [s] | observed limit [s] | "
    header += "observed below [s] | step [s] | outcome | energy error"
    report.figure(
        f"map_{axis}_{damping}",
        figure,
        columns(header.split(" | "), rows),
        f"Limits and energy errors over {axis} and the step, {damping}. Black line: predicted; "
        "red circle: observed, triangle: below that; x: stopped, ?: over its budget of time, grey: "
        "not run or refused",
    )


def _panel(axes: Axes, steps: tuple[float, ...], column: dict[float, Limits]) -> None:
    found = list(column.values())
    axes.set_facecolor("lightgray")
    errors = np.array([one.errors for one in found]).T
    axes.imshow(errors, origin="lower", aspect="auto", cmap="viridis", norm=SCALE)
    axes.set_xticks(range(len(column)), [f"{value:g}" for value in column], rotation=45)
    axes.set_yticks(range(len(steps)), [f"{step:.0e}" for step in steps])
    axes.set_ylim(-1.5, len(steps) - 0.5)
    if all(what == REFUSED for one in found for what in one.outcomes):
        axes.text(0.5, 0.5, "refused", ha="center", va="center", transform=axes.transAxes)
    for x, one in enumerate(found):
        for y, what in enumerate(one.outcomes):
            axes.text(x, y, SIGNS.get(what, ""), ha="center", va="center", color="dimgray")
        _mark(axes, x, one, steps)


def _mark(axes: Axes, x: int, found: Limits, steps: tuple[float, ...]) -> None:
    """Mark one cable's limits at their positions between the rows; small ones at the edge."""

    def place(step: float) -> float:
        return max(math.log(step / steps[0]) / math.log(steps[1] / steps[0]), -1.2)

    if math.isfinite(found.predicted):
        axes.hlines(place(found.predicted), x - 0.5, x + 0.5, color="black", linewidth=2.0)
    for limit, marker in ((found.observed, "o"), (found.below, "v")):
        if math.isfinite(limit):
            axes.plot(x, place(limit), marker, color="red", markersize=6, mfc="none")


def _tables(report: Report, quick: bool, results: Mapping[Point, Limits]) -> None:
    """Add the tables over all maps: ratios of limits, and finished runs with large errors."""
    rows = []
    for method, damping, motion in product(METHODS_COMPARED[quick], DAMPING, GRAVITY):
        key = (method, damping, motion)
        mine = [r for p, r in results.items() if (p.method, p.damping, p.motion) == key]
        rows.append([*key, *_summary(mine)])
    report.table(
        "limits",
        "method | damping | motion | points | observed / predicted, least | largest | none found | "
        "all below [s] | runs finished | stopped | over budget | "
        "largest energy error of the finished",
        rows,
        "All maps: observed against predicted limits (trials of "
        f"{TRIAL[quick]:g} s), and outcomes of the energy runs of {DURATION[quick]:g} s",
    )
    report.table(
        "finished_and_wrong",
        "method | damping | motion | axis | value | step [ms] | energy error",
        [
            [p.method, p.damping, p.motion, p.axis, p.value, step, error]
            for p, r in results.items()
            for step, error in zip(STEPS[quick], r.errors, strict=True)
            if error > 0.5
        ],
        "Runs that reached their end with an energy error of more than half of the energy "
        "exchanged",
    )


def _summary(found: list[Limits]) -> list[Any]:
    ratios = [one.observed / one.predicted for one in found if math.isfinite(one.predicted)]
    ratios = [ratio for ratio in ratios if not math.isnan(ratio)]
    below = [one.below for one in found if math.isfinite(one.below)]
    outcomes = [outcome for one in found for outcome in one.outcomes]
    counts = [outcomes.count(what) for what in (FINISHED, STOPPED, SLOW)]
    errors = [error for one in found for error in one.errors if math.isfinite(error)]
    limits = [min(ratios, default=None), max(ratios, default=None)]
    below_all = [len(below), max(below, default=None)]
    return [len(found), *limits, *below_all, *counts, max(errors, default=None)]
