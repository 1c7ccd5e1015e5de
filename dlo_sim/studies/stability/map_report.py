"""The maps as pictures and tables."""

from __future__ import annotations

import math
from collections.abc import Mapping
from itertools import product

import numpy as np
from matplotlib.axes import Axes
from matplotlib.cm import ScalarMappable
from matplotlib.colors import LogNorm

from dlo_sim.studies import plotting
from dlo_sim.studies.report import Cell, Report, columns
from dlo_sim.studies.stability import maps
from dlo_sim.studies.stability.maps import DAMPING, GRAVITY, Extent, Limits, Point

UNITS = {"n_u": "-", "E": "Pa", "diameter": "m"}
SCALE = LogNorm(1e-14, 1.0)  # of the energy errors shown
SIGNS = {maps.STOPPED: "x", maps.SLOW: "?"}
Results = Mapping[Point, Limits]


def add(report: Report, extent: Extent, results: Results) -> None:
    """Six figures and two tables."""
    report.section("Stability limits and energy errors")
    report.text(
        """An aluminium wire (2 m, 2 mm, n_u = 9, 3 Gauss points per span), clamped at one end and
        released straight; one of n_u, E and diameter varies. Under 0.01 m/s^2 it vibrates by
        millimetres (linear), under 9.81 m/s^2 it falls into a large motion. Damped: damping.mass =
        2 1/s. Predicted limits come from the largest frequency of the wire at its start, observed
        ones from bisection: the largest step at which a trial is not stopped. Implicit methods have
        no predicted limit; theirs is the largest step of the map up to which every run reached its
        end. Energy errors are relative to the largest energy exchanged; generalized_alpha books
        what it dissipates as dissipated, so only energy that it adds counts."""
    )
    for axis, damping in product(maps.KEYS, DAMPING):
        _figure(report, extent, results, axis, damping)
    _tables(report, extent, results)


def _figure(report: Report, extent: Extent, results: Results, axis: str, damping: str) -> None:
    mine = {p: r for p, r in results.items() if (p.axis, p.damping) == (axis, damping)}
    count, label = len(extent.methods), f"{axis} [{UNITS[axis]}]"
    figure, axes = plotting.new_figure(len(GRAVITY), count, 2.0 + 2.2 * count, 7.4)
    for panel, (motion, method) in zip(axes, product(GRAVITY, extent.methods), strict=True):
        own = {p.value: r for p, r in mine.items() if (p.motion, p.method) == (motion, method)}
        _panel(panel, extent, dict(sorted(own.items())))
        panel.set(xlabel=label, ylabel="step [s]")
        panel.set_title(f"{method}\n{motion}", fontsize="medium")
        panel.label_outer()
    colors = ScalarMappable(SCALE, "viridis")
    figure.colorbar(colors, ax=axes, label="energy error, relative [-]", shrink=0.8)
    figure.suptitle(damping)
    rows = [
        (p.method, p.motion, p.value, r.predicted, r.observed, r.below, *run)
        for p, r in mine.items()
        for run in zip(extent.steps, r.outcomes, r.errors, strict=True)
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


def _panel(axes: Axes, extent: Extent, column: dict[float, Limits]) -> None:
    steps, found = extent.steps, list(column.values())
    axes.set_facecolor("lightgray")
    errors = np.array([one.errors for one in found]).T
    axes.imshow(errors, origin="lower", aspect="auto", cmap="viridis", norm=SCALE)
    axes.set_xticks(range(len(column)), [f"{value:g}" for value in column], rotation=45)
    axes.set_yticks(range(len(steps)), [f"{step:.0e}" for step in steps])
    axes.set_ylim(-1.5, len(steps) - 0.5)
    if all(what == maps.REFUSED for one in found for what in one.outcomes):
        axes.text(0.5, 0.5, "refused", ha="center", va="center", transform=axes.transAxes)
    for x, one in enumerate(found):
        for y, what in enumerate(one.outcomes):
            axes.text(x, y, SIGNS.get(what, ""), ha="center", va="center", color="dimgray")
        _mark(axes, x, one, steps)


def _mark(axes: Axes, x: int, found: Limits, steps: tuple[float, ...]) -> None:
    """Marks of one cable's limits, at their place between the rows; too small ones at the edge."""

    def place(step: float) -> float:
        return max(math.log(step / steps[0]) / math.log(steps[1] / steps[0]), -1.2)

    if math.isfinite(found.predicted):
        axes.hlines(place(found.predicted), x - 0.5, x + 0.5, color="black", linewidth=2.0)
    for limit, marker in ((found.observed, "o"), (found.below, "v")):
        if math.isfinite(limit):
            axes.plot(x, place(limit), marker, color="red", markersize=6, mfc="none")


def _tables(report: Report, extent: Extent, results: Results) -> None:
    """Over all maps: how far the limits are apart, and the runs that were wrong unnoticed."""
    rows = []
    for method, damping, motion in product(extent.methods, DAMPING, GRAVITY):
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
        f"{extent.trial:g} s), and what became of the energy runs of {extent.duration:g} s",
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
        "Runs that reached their end although the energy is off by more than half of what was "
        "exchanged",
    )


def _summary(found: list[Limits]) -> list[Cell]:
    ratios = [one.observed / one.predicted for one in found if math.isfinite(one.predicted)]
    ratios = [ratio for ratio in ratios if not math.isnan(ratio)]
    below = [one.below for one in found if math.isfinite(one.below)]
    outcomes = [outcome for one in found for outcome in one.outcomes]
    counts = [outcomes.count(what) for what in (maps.FINISHED, maps.STOPPED, maps.SLOW)]
    errors = [error for one in found for error in one.errors if math.isfinite(error)]
    limits = [min(ratios, default=None), max(ratios, default=None)]
    below_all = [len(below), max(below, default=None)]
    return [len(found), *limits, *below_all, *counts, max(errors, default=None)]
