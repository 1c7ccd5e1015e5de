"""`dlo_sim study stability`: limits and energy errors over n_u, E or the diameter, and the step.

An aluminium wire of 2 m, clamped at one end, released straight. Under a thousandth of gravity it
vibrates by millimetres (linear); under gravity its end falls by more than its length (large). A
point of a map, that is one cable and one method with all steps, is one task for a worker.
"""

from __future__ import annotations

import math
import time
from collections.abc import Mapping
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
from dlo_sim.studies import Outcome, Request
from dlo_sim.studies.report import Report, new_figure
from dlo_sim.studies.runs import bisected, reaches

WIRE = {
    "cable.length": 2.0,
    "cable.diameter": 2e-3,
    "cable.density": 2700.0,
    "cable.youngs_modulus": 69e9,
    "cable.shear_modulus": 69e9 / 2.6,
    "start.clamped": True,
    "end.fixed": [False] * 3,
    "end.position": [2.0, 0.0, 0.0],
    "discretization.control_points": 9,
    "terms.twist": "off",
    "initial.shape": "straight",
}
AXES = {  # of the maps: key of the scene, label
    "n_u": ("discretization.control_points", "n_u [-]"),
    "E": ("cable.youngs_modulus", "E [Pa]"),
    "diameter": ("cable.diameter", "diameter [m]"),
}
GRAVITY = {"linear": 0.01, "large": 9.81}  # [m/s^2]
DAMPING = {"undamped": 0.0, "damped": 2.0}  # damping.mass [1/s]
NEAR, FAR = 1.2, 16.0  # factors about the predicted limit within which the observed one is searched
FEWEST_STEPS = 64  # of an energy run: explicit methods check the energy every 16 steps
MOST_STEP = 1.0  # [s], upper bound on the step of a scene
LEAST_IMPLICIT_STEP = 9e-5  # [s]; smaller steps are not run with implicit methods
FINISHED, STOPPED, SLOW, SKIPPED, REFUSED = "finished", "stopped", "slow", "not run", "refused"
SCALE = LogNorm(1e-14, 1.0)  # of the energy errors shown
SIGNS = {STOPPED: "x", SLOW: "?"}
HEADER = (
    "method | motion | {} | predicted limit [s] | observed limit [s] | observed below [s] | "
    "step [s] | outcome | energy error"
)


class Extent(NamedTuple):
    """How much is computed.

    Attributes:
        methods: compared. values: of each axis. steps: tau [s].
        duration: simulated time of the energy runs [s]. budget: largest run time of each [s].
        trial: duration of a trial of a step [s]. fewest: its least number of steps.
        tolerance: relative, of observed limits.
    """

    methods: tuple[str, ...]
    values: dict[str, tuple[float, ...]]
    steps: tuple[float, ...]
    duration: float
    budget: float
    trial: float
    fewest: int
    tolerance: float


EXTENTS = {  # by `quick`
    True: Extent(
        ("forest_ruth", "velocity_verlet", "energy_momentum"),
        {"n_u": (5, 13, 40), "E": (1e6, 1e9, 1e12), "diameter": (1e-4, 2e-3, 5e-2)},
        (1e-5, 1e-4, 1e-3, 1e-2, 1e-1),
        *(1.0, 3.0, 0.3, 3000, 0.02),
    ),
    False: Extent(
        tuple(METHODS),
        {
            "n_u": (5, 9, 13, 19, 40),
            "E": (1e4, 1e6, 1e8, 1e10, 1e12),
            "diameter": (1e-4, 5e-4, 2e-3, 1e-2, 5e-2),
        },
        tuple(float(f"{10.0**e:.2g}") for e in np.arange(-5.0, -0.9, 0.5)),
        *(10.0, 20.0, 1.0, 4000, 0.01),
    ),
}


class Point(NamedTuple):
    """One cable and one method; `value` is of the `axis` n_u, E [Pa] or diameter [m]."""

    axis: str
    value: float
    method: str
    damping: str
    motion: str
    quick: bool

    @property
    def extent(self) -> Extent:
        """How much is computed."""
        return EXTENTS[self.quick]

    def simulator(self, step: float = 0.0) -> Simulator:
        """The wire with a step [s]; 0 = its own.

        Raises:
            SceneError: the method does not allow the damping.
        """
        return Simulator(self.scene(step), unchecked_step=step > 0.0)

    def scene(self, step: float) -> Scene:
        """The wire of this point."""
        value = int(self.value) if self.axis == "n_u" else self.value
        return scene_from_values(
            {
                **WIRE,
                "gravity": [0.0, 0.0, -GRAVITY[self.motion]],
                "damping.mass": DAMPING[self.damping],
                "integrator.method": self.method,
                "integrator.step": step,
                AXES[self.axis][0]: value,
            }
        )


class Limits(NamedTuple):
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


def run_study(request: Request) -> Outcome:
    """Run the whole study into a folder."""
    report = Report(request, "Stability limits of the methods", {})
    extent, results = EXTENTS[request.quick], {}
    points = [  # the most expensive first (more control points)
        Point(axis, value, method, damping, motion, request.quick)
        for axis, values in extent.values.items()
        for value, method, damping, motion in product(
            reversed(values), extent.methods, DAMPING, GRAVITY
        )
    ]
    for point, limits in zip(points, request.workers.map(examine, points), strict=True):
        results[point] = limits
        request.progress(len(results) / len(points))
    report.text(
        """An aluminium wire (2 m, 2 mm, n_u = 9, 3 Gauss points per span), clamped at one end and
        released straight; one of n_u, E and diameter varies. Under 0.01 m/s^2 it vibrates by
        millimetres (linear), under 9.81 m/s^2 it falls (large). Damped: damping.mass = 2 1/s.
        Limits: predicted from the largest frequency at the start; observed by bisection as the
        largest step at which a trial is not stopped, for implicit methods as the largest step of
        the map up to which every run reached its end. Energy errors are relative to the largest
        energy exchanged."""
    )
    for axis, damping in product(AXES, DAMPING):
        mine = {p: r for p, r in results.items() if (p.axis, p.damping) == (axis, damping)}
        _figure(report, extent, mine, axis, damping)
    return report.outcome(_tables(report, extent, results))


def examine(point: Point) -> Limits:
    """Limits and energy errors of one point; a function for workers."""
    steps, implicit = point.extent.steps, METHODS[point.method].family == IMPLICIT
    try:
        predicted = point.simulator().choice.limit
    except SceneError:
        return Limits((REFUSED,) * len(steps), (np.nan,) * len(steps))
    outcomes, errors = zip(*(energy_run(point, step) for step in steps), strict=True)
    found = reached(steps, outcomes) if implicit else observed(point, predicted)
    return Limits(outcomes, errors, predicted, *found)


def energy_run(point: Point, step: float) -> tuple[str, float]:
    """Outcome and largest energy error of a run with this step."""
    if METHODS[point.method].family == IMPLICIT and step < LEAST_IMPLICIT_STEP:
        return SKIPPED, np.nan
    simulator, extent = point.simulator(step), point.extent
    steps = max(round(extent.duration / step), FEWEST_STEPS)
    piece = max(steps // 100, 1)
    until = time.perf_counter() + extent.budget
    while simulator.steps < steps:
        if not simulator.advance_steps(min(piece, steps - simulator.steps)).status.advanced:
            return STOPPED, np.nan
        if time.perf_counter() > until:
            return SLOW, np.nan
    return FINISHED, max(float(simulator.energy_error), 1e-16)


def reached(steps: tuple[float, ...], outcomes: tuple[str, ...]) -> tuple[float, float]:
    """`observed` and `below` of an implicit method, from the runs at the steps of the map."""
    largest = np.nan
    for step, outcome in zip(steps, outcomes, strict=True):
        if outcome == STOPPED:
            return largest, step if np.isnan(largest) else np.nan
        largest = step if outcome == FINISHED else largest
    return largest, np.nan


def observed(point: Point, predicted: float) -> tuple[float, float]:
    """`observed` and `below` of an explicit method: largest step [s] at which a trial is not
    stopped, by bisection near the predicted one, else in a wide range; inf if it is beyond that.
    """
    wide = (min(predicted / FAR, point.extent.steps[0] / NEAR), min(predicted * FAR, MOST_STEP))
    for low, high in ((predicted / NEAR, min(predicted * NEAR, MOST_STEP)), wide):
        if survives(point, low) and not survives(point, high):
            tolerance = point.extent.tolerance
            return bisected(lambda step: survives(point, step), low, high, tolerance), np.nan
    return (np.inf, np.nan) if survives(point, wide[1]) else (np.nan, wide[0])


def survives(point: Point, step: float) -> bool:
    """Whether a trial of a step [s] reaches its end."""
    steps = max(round(point.extent.trial / step), point.extent.fewest)
    return reaches(point.scene(step), steps * step)


def _figure(
    report: Report, extent: Extent, results: Mapping[Point, Limits], axis: str, damping: str
) -> None:
    """Add the map of an axis: energy errors as colours, a panel for each motion and method."""
    label, count = AXES[axis][1], len(extent.methods)
    figure, panels = new_figure(len(GRAVITY), count, 2.0 + 2.2 * count, 7.4)
    for panel, key in zip(panels, product(GRAVITY, extent.methods), strict=True):
        own = {p.value: r for p, r in results.items() if (p.motion, p.method) == key}
        _panel(panel, extent.steps, dict(sorted(own.items())))
        panel.set(xlabel=label, ylabel="step [s]")
        panel.set_title("\n".join(reversed(key)), fontsize="medium")
        panel.label_outer()
    colors = ScalarMappable(SCALE, "viridis")
    figure.colorbar(colors, ax=panels, label="energy error, relative [-]", shrink=0.8)
    figure.suptitle(damping)
    rows = [
        (p.method, p.motion, p.value, r.predicted, r.observed, r.below, *run)
        for p, r in results.items()
        for run in zip(extent.steps, r.outcomes, r.errors, strict=True)
    ]
    caption = (
        f"Limits and energy errors over {axis} and the step, {damping}. Black line: predicted; "
        "red circle: observed, triangle: below that; x: stopped, ?: over its budget of time, grey: "
        "not run or refused"
    )
    report.figure(f"map_{axis}_{damping}", figure, caption, HEADER.format(label), rows)


def _panel(axes: Axes, steps: tuple[float, ...], column: dict[float, Limits]) -> None:
    """Draw the errors and limits of the cables of a column, over the steps."""
    found = list(column.values())
    axes.set_facecolor("lightgray")
    errors = np.array([one.errors for one in found]).T
    axes.imshow(errors, origin="lower", aspect="auto", cmap="viridis", norm=SCALE)
    axes.set_xticks(range(len(column)), [f"{value:g}" for value in column], rotation=45)
    axes.set_yticks(range(len(steps)), [f"{step:.0e}" for step in steps])
    axes.set_ylim(-1.5, len(steps) - 0.5)

    def place(step: float) -> float:
        """Row of a step, between those of the map; small ones at the edge."""
        return max(math.log(step / steps[0]) / math.log(steps[1] / steps[0]), -1.2)

    if all(what == REFUSED for one in found for what in one.outcomes):
        axes.text(0.5, 0.5, REFUSED, ha="center", color="dimgray", transform=axes.transAxes)
    for x, one in enumerate(found):
        for y, what in enumerate(one.outcomes):
            axes.text(x, y, SIGNS.get(what, ""), ha="center", va="center", color="dimgray")
        if math.isfinite(one.predicted):
            axes.hlines(place(one.predicted), x - 0.5, x + 0.5, color="black", linewidth=2.0)
        for limit, marker in ((one.observed, "o"), (one.below, "v")):
            if math.isfinite(limit):
                axes.plot(x, place(limit), marker, color="red", markersize=6, mfc="none")


def _tables(report: Report, extent: Extent, results: Mapping[Point, Limits]) -> dict[str, str]:
    """Add ratios of limits, and finished runs with large errors; returns the verdicts."""
    rows: list[list[Any]] = []
    verdicts = {}
    for key in product(extent.methods, DAMPING, GRAVITY):
        rows.append([*key, *summary([r for p, r in results.items() if p[2:5] == key])])
        least, largest, *_, error = rows[-1][4:]
        if largest is not None:
            words = f"observed / predicted limit {least:.3g} to {largest:.3g}"
        elif error is not None:
            words = f"no limit, energy error at most {error:.1e}"
        else:
            words = "refused"
        verdicts[", ".join(key)] = words
    report.table(
        "limits",
        "method | damping | motion | points | observed / predicted, least | largest | none found | "
        "all below [s] | runs finished | stopped | over budget | "
        "largest energy error of the finished",
        rows,
        f"All maps: observed against predicted limits (trials of {extent.trial:g} s), and outcomes "
        f"of the energy runs of {extent.duration:g} s",
    )
    report.table(
        "finished_and_wrong",
        "method | damping | motion | axis | value | step [ms] | energy error",
        [
            [p.method, p.damping, p.motion, p.axis, p.value, step, error]
            for p, r in results.items()
            for step, error in zip(extent.steps, r.errors, strict=True)
            if error > 0.5
        ],
        "Runs that reached their end with an energy error of more than half of the energy "
        "exchanged",
    )
    return verdicts


def summary(found: list[Limits]) -> list[Any]:
    """Cells of the table `limits` from these points."""
    ratios = [one.observed / one.predicted for one in found if math.isfinite(one.predicted)]
    ratios = [ratio for ratio in ratios if not math.isnan(ratio)]
    below = [one.below for one in found if math.isfinite(one.below)]
    outcomes = [outcome for one in found for outcome in one.outcomes]
    counts = [outcomes.count(what) for what in (FINISHED, STOPPED, SLOW)]
    errors = [error for one in found for error in one.errors if math.isfinite(error)]
    limits = [min(ratios, default=None), max(ratios, default=None)]
    below_all = [len(below), max(below, default=None)]
    return [len(found), *limits, *below_all, *counts, max(errors, default=None)]
