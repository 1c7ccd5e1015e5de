"""Settings run on every case, error and time from the same run, and the diagram of each case."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from itertools import groupby, product
from operator import attrgetter

import numpy as np
from matplotlib.axes import Axes
from matplotlib.ticker import NullFormatter

from dlo_sim.core.methods import CONSTRAINED, IMPLICIT, METHODS
from dlo_sim.scene.loading import SceneError
from dlo_sim.studies import plotting
from dlo_sim.studies.report import Cell, Report, columns
from dlo_sim.studies.work_precision.cases import Case, Run
from dlo_sim.studies.work_precision.references import Reference
from dlo_sim.tuning.setting import Setting, ways_to_resolve
from dlo_sim.tuning.trial import at_share, attempt

LEVELS = (0.1, 0.03, 0.01, 0.003, 0.001, 0.0003)  # of the case's scale
FASTEST = (
    "case | error at most [%] | setting | error [%] | s per simulated s | spread [%] {:.0f} | "
    "step [ms]"
)
BESIDE = (
    "case | simulator | elements | step [ms] | status | error [%] | s per simulated s | "
    "setting within that error | its error [%] | its s per simulated s | times faster"
)
COLUMNS = (
    "method | stretch | n_u | step [s] | status | setting | error | s per simulated s | spread | "
    "evaluations [1/s] | energy error"
)
COSTS = {
    "wall": "run time [s per simulated s]",
    "evaluations": "force evaluations (implicit: iterations) per simulated s",
}
METHODS_TRIED = {
    True: ("velocity_verlet", "energy_momentum"),
    False: (
        *("forest_ruth", "rk4", "velocity_verlet", "rattle"),
        *("implicit_midpoint", "energy_momentum", "energy_momentum_4", "generalized_alpha"),
    ),
}
CONTROL_POINTS = {True: (7, 11), False: (7, 8, 9, 11, 13, 17, 23)}
STEPS = {True: (5e-3, 2e-3), False: (4e-2, 2e-2, 1e-2, 4e-3, 2e-3, 1e-3, 5e-4)}  # [s], implicit
SHARES = {True: (1.0,), False: (1.0, 0.5)}  # of the own step, explicit
BUDGET = {True: 0.02, False: 0.1}  # [s] of repeats
# Also run with stretching by span and with graded knots.
BY_SPAN = ("energy_momentum", "energy_momentum_4", "generalized_alpha")
LOOSE = 1e-3  # tolerance that is tried beside the default one
PAPER_STEP = 2e-3  # [s], unstable with all explicit methods on the wire


def swept(
    case: Case, truth: Reference, quick: bool, progress: Callable[[float], None]
) -> list[Run]:
    """Run all settings on a case."""
    runs = []
    kinds = list(product(METHODS_TRIED[quick], CONTROL_POINTS[quick]))
    for k, kind in enumerate(kinds):
        runs += [tried(case, truth, one, BUDGET[quick]) for one in _settings(case, quick, *kind)]
        progress((k + 1) / len(kinds))
    return runs


def tried(case: Case, truth: Reference, setting: Setting, budget: float) -> Run:
    """Run a setting on a case, with its error."""
    trial = attempt(case.job, setting, budget=budget)
    way = f"by {setting.stretch}" + ", knots auto" * (setting.knots == "auto")
    if METHODS[setting.method].family == CONSTRAINED:
        way = "left out"
    what = (setting.method, way, setting.control_points, trial.step, trial.status, setting.words)
    if not trial.ok:
        return Run(*what)
    evaluations = trial.force_evaluations / (trial.steps * trial.step)
    times = (trial.wall, trial.spread, evaluations)
    return Run(*what, case.error(trial.points, truth.points), *times, trial.energy_error)


def _settings(case: Case, quick: bool, method: str, n_u: int) -> list[Setting]:
    family, first = METHODS[method].family, Setting(method, n_u)
    if family == IMPLICIT:
        ways = ways_to_resolve(case.scene, method)
        return [
            Setting(method, n_u, step, stretch=stretch, knots=knots, tolerance=tolerance)
            for stretch, knots in (ways if method in BY_SPAN else ways[:1])
            for step in STEPS[quick]
            for tolerance in ((None, LOOSE) if method == "energy_momentum" else (None,))
        ]
    shares = (*SHARES[quick], 0.25) if family == CONSTRAINED else SHARES[quick]
    try:
        found = [at_share(case.job, first, share) for share in shares]
    except SceneError:
        return [first]  # the attempt is refused for the same reason
    if method == "velocity_verlet" and n_u == CONTROL_POINTS[quick][0]:
        found.append(Setting(method, n_u, PAPER_STEP))
    return found


def fastest(runs: Sequence[Run], level: float) -> Run | None:
    """The fastest run with an error of at most `level`, relative to the scale."""
    good = [run for run in runs if run.ok and run.error <= level]
    return min(good, key=lambda run: run.wall) if good else None


def front(runs: Sequence[Run], cost: str) -> list[Run]:
    """Pareto front in error and cost (name of a field), by increasing cost."""
    found: list[Run] = []
    for run in sorted((run for run in runs if run.ok), key=attrgetter(cost)):
        if not found or run.error < found[-1].error:
            found.append(run)
    return found


def level_rows(case: Case, truth: Reference, runs: Sequence[Run]) -> list[list[Cell]]:
    """Rows of `FASTEST`: the fastest setting for every level of error."""
    rows: list[list[Cell]] = []
    for level in LEVELS:
        own: list[Cell] = ["none of those tried", None, None, None, None]
        if level < truth.own_error:
            own[0] = "below the reference's own error"
        elif found := fastest(runs, level):
            own = [found.words, found.error, found.wall, found.spread, found.step]
        rows.append([case.name, level, *own])
    return rows


def peer_rows(case: Case, runs: Sequence[Run], peers: Sequence[Run]) -> list[list[Cell]]:
    """Rows of `BESIDE`: every run of another simulator, and the fastest setting here whose error is
    not larger."""
    rows: list[list[Cell]] = []
    for peer in peers:
        measured = [value if np.isfinite(value) else None for value in (peer.error, peer.wall)]
        found = fastest(runs, peer.error)
        ours: list[Cell] = [None] * 4
        if found:
            ours = [found.words, found.error, found.wall, peer.wall / found.wall]
        rows.append([case.name, peer.who, peer.n_u, peer.step, peer.status, *measured, *ours])
    return rows


def diagram(
    report: Report, case: Case, truth: Reference, runs: list[Run], peers: list[Run]
) -> None:
    """Add the diagram of a case."""
    report.section(case.title, 3)
    figure, panels = plotting.new_figure(1, 2, width=13.0, height=5.4)
    for panel, (cost, label) in zip(panels, COSTS.items(), strict=True):
        _draw(panel, runs, cost)
        own_error = 100 * truth.own_error
        panel.axhline(own_error, color="0.5", linestyle=":", label="own error of the reference")
        panel.set(xscale="log", yscale="log", xlabel=label)
        panel.set_ylabel(f"error [% of {case.scale_words}]")
        for axis in (panel.xaxis, panel.yaxis):
            axis.set_minor_formatter(NullFormatter())
        panel.grid(alpha=0.3, which="both", linewidth=0.4)
    for name, marker in zip(dict.fromkeys(peer.who for peer in peers), "sD^v<>", strict=False):
        own = [peer for peer in peers if peer.who == name]
        x, y = [peer.wall for peer in own], [100 * peer.error for peer in own]
        panels[0].plot(x, y, marker, color="black", fillstyle="none", label=name)
    for n_u, group in groupby(front(runs, "wall"), attrgetter("n_u")):
        place = next((run.wall, 100 * run.error) for run in group)
        panels[0].annotate(f"{n_u}", place, (-4, -11), textcoords="offset points", fontsize=8)
    failed = sum(not run.ok for run in runs)
    panels[0].plot([], [], " ", label=f"{failed} of {len(runs)} failed or refused")
    shown = panels[0].get_legend_handles_labels()
    panels[1].legend(*shown, fontsize="small", loc="center left", bbox_to_anchor=(1.01, 0.5))
    report.figure(
        f"work_precision_{case.name}",
        figure,
        columns(COLUMNS.split(" | "), [*runs, *peers]),
        f"{case.title}: error against run time and against force evaluations. Lines: Pareto front "
        "of each method; dots: all runs; numbers: n_u on the Pareto front of all methods, where "
        "it changes",
    )


def _draw(axes: Axes, runs: Sequence[Run], cost: str) -> None:
    """Draw a method's runs as dots and its Pareto front as a line: dashed with stretching by span,
    dotted with graded knots too."""
    for name in dict.fromkeys(run.line for run in runs):
        own = [run for run in runs if run.line == name and run.ok]
        color = plotting.COLORS.get(name.partition(",")[0], "black")
        dash = ("-", "--", ":")[name.count(",")]
        dots, best = (
            ([getattr(run, cost) for run in some], [100 * run.error for run in some])
            for some in (own, front(own, cost))
        )
        axes.plot(*dots, ".", color=color, alpha=0.3)
        axes.plot(*best, f"o{dash}", color=color, markersize=4, label=name)
