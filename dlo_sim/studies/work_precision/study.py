"""`dlo_sim study work-precision`: error against run time of settings and of other simulators."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from itertools import groupby, product
from operator import attrgetter
from typing import Any

import numpy as np
from matplotlib.axes import Axes
from matplotlib.ticker import NullFormatter

from dlo_sim.core.methods import CONSTRAINED, IMPLICIT, METHODS
from dlo_sim.scene.loading import SceneError, shipped_scene
from dlo_sim.studies import Outcome, Request
from dlo_sim.studies.plotting import COLORS, new_figure
from dlo_sim.studies.report import Report, columns
from dlo_sim.studies.work_precision import references, separate
from dlo_sim.studies.work_precision.cases import Case, Run, all_cases
from dlo_sim.studies.work_precision.peers import peer_runs
from dlo_sim.studies.work_precision.references import Reference
from dlo_sim.studies.work_precision.separate import METHODS_TRIED
from dlo_sim.tuning.setting import Setting, ways_to_resolve
from dlo_sim.tuning.trial import at_share, attempt

SHOWN_LEVEL = 0.01  # error, relative to the scale, for the verdict on the fastest setting
LEVELS = (0.1, 0.03, 0.01, 0.003, 0.001, 0.0003)  # of the case's scale
COLUMNS = (
    "method | stretch | n_u | step [s] | status | setting | error | s per simulated s | spread | "
    "evaluations [1/s] | energy error"
)
COSTS = {
    "wall": "run time [s per simulated s]",
    "evaluations": "force evaluations (implicit: iterations) per simulated s",
}
CONTROL_POINTS = {True: (7, 11), False: (7, 8, 9, 11, 13, 15, 17, 23)}
STEPS = {  # [s], of implicit methods
    True: (5e-3, 2e-3),
    False: (4e-2, 2e-2, 1e-2, 5e-3, 4e-3, 3e-3, 2e-3, 1e-3, 5e-4),
}
SHARES = {True: (1.0,), False: (1.0, 0.5)}  # of the own step, explicit
BUDGET = {True: 0.02, False: 0.1}  # [s] of repeats
# Also run with stretching by span and with graded knots.
BY_SPAN = ("energy_momentum", "energy_momentum_4")
LOOSE = 1e-3  # tolerance that is tried beside the default one
PAPER_STEP = 2e-3  # [s], unstable with all explicit methods on the wire


def run_study(request: Request) -> Outcome:
    """Run the study into a folder."""
    files = {name: shipped_scene(name) for name in ("paper_wire", "paper_wire_force")}
    report = Report(request, "Error against run time", files)
    cases = all_cases(request.quick)
    truths = references.references(cases, request.workers)
    request.progress(0.2)
    references.add(report, cases, truths)
    report.section("Error against run time, case by case")
    report.text(
        """Error and run time of a setting, least of the repeats, are from the same simulator.
        Implicit methods run at given steps, energy_momentum also with a tolerance of 1e-3 of the
        energy exchanged; explicit ones at shares of their own step. Gauss quadrature with three
        points per span."""
    )
    levels: list[list[Any]] = []
    beside_us: list[list[Any]] = []
    absent: list[str] = []
    verdicts: dict[str, str] = {}
    for k, case in enumerate(cases):
        truth, low = truths[case.name], 0.2 + 0.6 * k / len(cases)
        runs = swept(case, truth, request.quick, request.part(low, low + 0.6 / len(cases)))
        peers = peer_runs(case, truth.points, request.quick, absent) if request.peers else []
        diagram(report, case, truth, runs, peers)
        levels += _level_rows(case, truth, runs)
        rows = [_peer_row(case, runs, peer) for peer in peers]
        beside_us += rows
        found = fastest(runs, SHOWN_LEVEL)
        words = f"{found.words}: {found.wall:.2g} s" if found else "no setting tried"
        verdicts[f"{case.name}, a simulated second within 1 %"] = words
        ratios = [row[-1] for row in rows if row[-1] is not None]
        if ratios:
            words = f"take {min(ratios):.3g} to {max(ratios):.3g} times as long"
            verdicts[f"{case.name}, others at their errors"] = words
    report.section("The fastest settings")
    header = "case | error at most [%] | setting | error [%] | s per simulated s | "
    header += "spread [%] {:.0f} | step [ms]"
    report.table("fastest", header, levels, "The fastest setting for each error")
    if request.peers:
        header = "case | simulator | elements | step [ms] | status | error [%] | "
        header += "s per simulated s | setting within that error | its error [%] | "
        header += "its s per simulated s | times faster"
        caption = "Other simulators, and the fastest dlo_sim setting whose error is not larger"
        report.table("peers", header, beside_us, caption)
        report.text(
            """The chain and MuJoCo 4 observe the same material point. MuJoCo's cables are
            inextensible; on the wire their end springs include its axial compliance."""
        )
    report.text(*(f"Not measured: {line}" for line in absent))
    separate.add(report, request, cases, truths)
    request.progress(0.95)
    separate.add_static(report, request.quick)
    request.progress(1.0)
    return report.outcome(verdicts)


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


def _level_rows(case: Case, truth: Reference, runs: Sequence[Run]) -> list[list[Any]]:
    """Rows of the table `fastest`: the fastest setting for every level of error."""
    rows: list[list[Any]] = []
    for level in LEVELS:
        own: list[Any] = ["none of those tried", None, None, None, None]
        if level < truth.own_error:
            own[0] = "below the reference's own error"
        elif found := fastest(runs, level):
            own = [found.words, found.error, found.wall, found.spread, found.step]
        rows.append([case.name, level, *own])
    return rows


def _peer_row(case: Case, runs: Sequence[Run], peer: Run) -> list[Any]:
    """Row of the table `peers`: another simulator's run, and the fastest setting here whose error
    is not larger."""
    measured = [value if np.isfinite(value) else None for value in (peer.error, peer.wall)]
    found = fastest(runs, peer.error)
    ours: list[Any] = [None] * 4
    if found:
        ours = [found.words, found.error, found.wall, peer.wall / found.wall]
    return [case.name, peer.who, peer.n_u, peer.step, peer.status, *measured, *ours]


def diagram(
    report: Report, case: Case, truth: Reference, runs: list[Run], peers: list[Run]
) -> None:
    """Add the diagram of a case."""
    report.section(case.title, 3)
    figure, panels = new_figure(1, 2, width=13.0, height=5.4)
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
        color = COLORS.get(name.partition(",")[0], "black")
        dash = ("-", "--", ":")[name.count(",")]
        dots, best = (
            ([getattr(run, cost) for run in some], [100 * run.error for run in some])
            for some in (own, front(own, cost))
        )
        axes.plot(*dots, ".", color=color, alpha=0.3)
        axes.plot(*best, f"o{dash}", color=color, markersize=4, label=name)
