"""The maps as pictures and tables."""

from __future__ import annotations

import math
from collections.abc import Mapping

import numpy as np
from matplotlib.axes import Axes
from matplotlib.colors import LogNorm
from matplotlib.image import AxesImage

from dlo_sim.core.methods import METHODS
from dlo_sim.studies import plotting
from dlo_sim.studies.report import Cell, Report
from dlo_sim.studies.stability.maps import (
    DAMPING,
    FINISHED,
    GRAVITY,
    REFUSED,
    SKIPPED,
    SLOW,
    STOPPED,
    Extent,
    Limits,
    Point,
)

NAMES = {"n_u": "n_u [-]", "E": "E [Pa]", "diameter": "diameter [m]"}
SCALE = (1e-14, 1.0)  # of the energy errors shown
SIGNS = {STOPPED: "x", SLOW: "?", SKIPPED: "", REFUSED: ""}
Results = Mapping[Point, Limits]


def add(report: Report, extent: Extent, results: Results) -> None:
    """Six figures, a table of the limits."""
    report.section("Stability limits and energy errors")
    report.text(
        f"""An aluminium wire (2 m, 2 mm, n_u = 9, 3 Gauss points per span), clamped at one end and
        released straight: under {GRAVITY["linear"]:g} m/s^2 it vibrates by millimetres (linear),
        under {GRAVITY["large"]:g} m/s^2 it falls into a large motion; one of n_u, E and diameter
        varies. Damped: damping.mass = {DAMPING["damped"]:g} 1/s. Predicted limits come from the
        largest frequency of the wire at its start, observed ones from bisection: the largest step
        at which a trial of {extent.trial:g} s (at least {extent.least_trial} steps) is not stopped,
        looked for down to {extent.steps[0]:g} s; "below" where even that was stopped.
        Energy errors are of runs over {extent.duration:g} s, relative to the largest energy
        exchanged."""
    )
    for axis in NAMES:
        for damping in DAMPING:
            _figure(report, extent, results, axis, damping)
    _table(report, results)


def _figure(report: Report, extent: Extent, results: Results, axis: str, damping: str) -> None:
    figure, axes = plotting.new_figure(len(GRAVITY), len(METHODS), width=19.0, height=7.4)
    image = None
    panels = iter(axes)
    for motion in GRAVITY:
        for method in METHODS:
            column = {
                point.value: found
                for point, found in results.items()
                if (point.axis, point.damping, point.motion, point.method)
                == (axis, damping, motion, method)
            }
            panel = next(panels)
            image = _panel(panel, extent, dict(sorted(column.items()))) or image
            panel.set_title(f"{method}\n{motion}", fontsize="small")
            panel.set_xlabel(NAMES[axis])
            if method == next(iter(METHODS)):
                panel.set_ylabel("step tau [s]")
            else:
                panel.set_yticklabels([])
    if image is not None:
        label = f"energy error over {extent.duration:g} s, relative [-]"
        figure.colorbar(image, ax=axes, label=label, shrink=0.8)
    figure.suptitle(
        f"{damping}: black line predicted limit, red circle observed limit (triangle: below that), "
        "x stopped, "
        "? more than its budget of time, grey not run or refused"
    )
    report.figure(
        f"map_{axis}_{damping}",
        figure,
        _columns(extent, results, axis, damping),
        f"Limits and energy errors over {NAMES[axis]} and the step, {damping}",
    )


def _panel(axes: Axes, extent: Extent, column: dict[float, Limits]) -> AxesImage | None:
    steps = extent.steps
    axes.set_facecolor("lightgray")
    axes.set_xticks(range(len(column)), [f"{value:g}" for value in column], rotation=45)
    axes.set_xlim(-0.5, len(column) - 0.5)
    axes.set_yticks(range(len(steps)), [f"{step:.0e}" for step in steps])
    axes.set_ylim(-1.5, len(steps) - 0.5)
    errors = np.array([found.errors for found in column.values()]).T
    outcomes = [found.outcomes for found in column.values()]
    shown = np.where(np.isfinite(errors), np.clip(errors, *SCALE), np.nan)
    image = axes.imshow(
        shown, origin="lower", aspect="auto", cmap="viridis", norm=LogNorm(*SCALE), zorder=1
    )
    for x, outcome in enumerate(outcomes):
        for y, what in enumerate(outcome):
            if what in SIGNS:
                axes.text(x, y, SIGNS[what], ha="center", va="center", color="dimgray")
    if all(what == REFUSED for outcome in outcomes for what in outcome):
        axes.text(0.5, 0.5, "refused", ha="center", va="center", transform=axes.transAxes)
    for x, found in enumerate(column.values()):
        _limits(axes, x, found, steps)
    return image if np.isfinite(shown).any() else None


def _limits(axes: Axes, x: int, found: Limits, steps: tuple[float, ...]) -> None:
    """Marks of one cable's limits, at their place between the rows."""

    def place(step: float) -> float:
        ratio = math.log(steps[1] / steps[0])
        return math.log(step / steps[0]) / ratio

    if found.predicted is not None and math.isfinite(found.predicted):
        y = place(found.predicted)
        axes.hlines(y, x - 0.5, x + 0.5, color="black", linewidth=2.0, zorder=3)
    if found.observed and math.isfinite(found.observed):
        axes.plot(x, place(found.observed), "o", color="red", markersize=5, zorder=4, mfc="none")
    if found.below is not None:
        lowest = axes.get_ylim()[0] + 0.3  # smaller steps than the map's are marked at its edge
        y = max(place(found.below), lowest)
        axes.plot(x, y, "v", color="red", markersize=5, zorder=4, mfc="none")


def _columns(
    extent: Extent, results: Results, axis: str, damping: str
) -> dict[str, list[float] | list[str]]:
    """One row per cell of the figure."""
    rows: list[tuple[str, str, float, float, float, float, float, str, float]] = []
    for point, found in results.items():
        if (point.axis, point.damping) != (axis, damping):
            continue
        predicted = np.nan if found.predicted is None else found.predicted
        observed = found.observed or np.nan
        below = np.nan if found.below is None else found.below
        for step, outcome, error in zip(extent.steps, found.outcomes, found.errors, strict=True):
            share = error if outcome == FINISHED else np.nan
            rows.append(
                (
                    point.method,
                    point.motion,
                    point.value,
                    predicted,
                    observed,
                    below,
                    step,
                    outcome,
                    share,
                )
            )
    header = ["method", "motion", NAMES[axis], "predicted limit [s]", "observed limit [s]"]
    header += ["observed below [s]", "step [s]", "outcome", "energy error"]
    columns: dict[str, list[float] | list[str]] = {}
    for name, column in zip(header, zip(*rows, strict=True), strict=True):
        columns[name] = list(column)
    return columns


def _table(report: Report, results: Results) -> None:
    """Predicted and observed limits over n_u, and over all maps how far they are apart."""
    rows: list[list[Cell]] = []
    for method in METHODS:
        for damping in DAMPING:
            for motion in GRAVITY:
                mine = [
                    found
                    for point, found in results.items()
                    if (point.method, point.damping, point.motion) == (method, damping, motion)
                ]
                rows.append([method, damping, motion, *_summary(mine)])
    header = ["method", "damping", "motion", "points", "observed / predicted, least", "largest"]
    header += ["runs finished", "stopped", "over budget", "largest energy error of the finished"]
    report.table(
        "limits",
        header,
        rows,
        "All maps: observed against predicted limits, and what became of the energy runs",
    )
    _wild(report, results)
    report.text(
        """Implicit methods have no predicted limit; their circle is the largest step of the map up
        to which every run reached its end. generalized_alpha books what it dissipates as
        dissipated, so only energy that it adds counts as an error."""
    )


def _summary(found: list[Limits]) -> list[Cell]:
    ratios = [
        one.observed / one.predicted
        for one in found
        if one.predicted and one.observed and math.isfinite(one.predicted)
    ]
    least: Cell = min(ratios) if ratios else None
    lost = [one for one in found if one.below is not None]
    if lost:
        smallest = max(one.below or 0.0 for one in lost)
        least = f"none found at {len(lost)} points: below {smallest:.2g} s"
    outcomes = [outcome for one in found for outcome in one.outcomes]
    errors = [error for one in found for error in one.errors if math.isfinite(error)]
    return [
        len(found),
        least,
        max(ratios) if ratios else None,
        outcomes.count(FINISHED),
        outcomes.count(STOPPED),
        outcomes.count(SLOW),
        max(errors) if errors else None,
    ]


def _wild(report: Report, results: Results) -> None:
    """Runs that finished although their energy is off by more than what was exchanged."""
    rows: list[list[Cell]] = [
        [point.method, point.damping, point.motion, point.axis, point.value, step, error]
        for point, found in results.items()
        for step, outcome, error in zip(
            point.extent.steps, found.outcomes, found.errors, strict=True
        )
        if outcome == FINISHED and error > 0.5
    ]
    header = ["method", "damping", "motion", "axis", "value", "step [s]", "energy error"]
    report.table(
        "finished_and_wrong",
        header,
        rows,
        "Runs that reached their end although the energy is off by more than half of what was "
        "exchanged",
    )
