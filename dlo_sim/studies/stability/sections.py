"""The report's tables of stiff methods, extreme scenes and random scenes."""

from __future__ import annotations

from collections import Counter
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from dlo_sim.studies import plotting
from dlo_sim.studies.report import Cell, Report
from dlo_sim.studies.stability import random_checks, stiff
from dlo_sim.studies.stability.extremes import Finding
from dlo_sim.studies.stability.random_checks import RAN, REFUSED, STOPPED, WRONG, Outcome
from dlo_sim.studies.stability.stiff import Stiff

MOST_REASONS = 12  # shown of the random scenes
AS_FAST = 1.1  # ratio of run times


@dataclass(frozen=True)
class Verdict:
    """Something that was asked, and what was measured."""

    name: str
    asked: str
    measured: str
    holds: bool

    @property
    def answer(self) -> str:
        """In a few words."""
        return "holds" if self.holds else "falls short"


def add_stiff(
    report: Report,
    rows: Sequence[Stiff],
    gauss: Sequence[Stiff],
    composed: Sequence[Stiff],
    reference: tuple[float, float],
) -> list[Verdict]:
    """The paper's wire at milliseconds beside Forest-Ruth."""
    report.section("The paper's wire at milliseconds")
    report.text(
        f"""`paper_wire.yaml` with nothing changed but n_u, method and step: energy_momentum beside
        forest_ruth at its own step, {stiff.DURATION:g} s each. Both are timed in turns; the time of
        Forest-Ruth is the cost of a step times their number. Errors are largest distances over the
        first {stiff.COMPARED:g} s from a mesh of {stiff.REFERENCE} control points (3 Gauss points)
        at {stiff.CONVERGED:g} s, which is {reference[1]:.1e} m from one of half as many; the
        converged step is that step on the same mesh, {reference[0]:.1e} m from forest_ruth at n_u =
        9."""
    )
    header = ["n_u", "step [ms]", "energy error", "iterations per step", "steps retried smaller"]
    header += ["run time [s]", "forest_ruth step [us]", "its run time [s]", "times faster"]
    header += ["asked", "error [m]", "error of the converged step [m]", "ratio (asked 1.5)"]
    cells = [_stiff_row(row) for row in rows]
    report.table("stiff", header, cells, "Energy-momentum at milliseconds beside Forest-Ruth")
    own = {row.n: row.explicit_wall for row in rows}
    report.table(
        "stiff_gauss",
        [*header[:10], "times faster than forest_ruth as shipped"],
        [[*_stiff_row(row)[:10], own[row.n] / row.wall] for row in gauss],
        "The same with 3 Gauss points per span, both methods; last column: beside forest_ruth with "
        "the shipped 101 samples",
    )
    report.text(
        """A step is counted as retried where it took more iterations than one attempt may: then at
        least one attempt failed, and the step was done in halves or smaller pieces. The wire moves
        by some 36 mm; the method is of second order, so its error in time does not depend on the
        mesh and exceeds that of a fine mesh. The composition of order 4 does five sub-steps per
        step, one of them back in time, and errs less for the same run time."""
    )
    report.table(
        "stiff_composed",
        header,
        [_stiff_row(row) for row in composed],
        "energy_momentum_4, five sub-steps of energy_momentum a step; iterations of all five",
    )
    return _stiff_verdicts(rows, composed)


def _stiff_row(row: Stiff) -> list[Cell]:
    asked = stiff.ASKED_RATIO[row.n] if row.step == stiff.STEPS[0] else None
    return [
        row.n,
        1e3 * row.step,
        row.outcome or row.energy_error,
        row.per_step,
        row.retried,
        row.wall,
        1e6 * row.explicit_step,
        row.explicit_wall,
        row.ratio,
        asked,
        row.error,
        row.converged,
        row.error_ratio,
    ]


def _stiff_verdicts(rows: Sequence[Stiff], composed: Sequence[Stiff]) -> list[Verdict]:
    soft = [row for row in rows if row.step in stiff.STEPS]
    hard = [row for row in rows if row.step in stiff.HARD_STEPS]
    least = [row for row in soft if row.step == stiff.STEPS[0]]
    worst = max(row.energy_error for row in soft)
    found = [
        Verdict(
            "energy at 2, 5 and 10 ms",
            f"below {stiff.ASKED_ENERGY:g} over 10 s",
            f"{worst:.1e}",
            worst < stiff.ASKED_ENERGY and not any(row.outcome for row in soft),
        )
    ]
    for row in least:
        found.append(
            Verdict(
                f"speed at n_u = {row.n}, 2 ms",
                f"{stiff.ASKED_RATIO[row.n]:g} times Forest-Ruth",
                f"{row.ratio:.1f} times",
                row.ratio >= stiff.ASKED_RATIO[row.n],
            )
        )
    fourth = [row for row in composed if row.step == stiff.STEPS[0]]
    names = ["energy_momentum"] * len(least) + ["energy_momentum_4"] * len(fourth)
    for name, row in zip(names, [*least, *fourth], strict=True):
        ratio = row.error_ratio or np.inf
        found.append(
            Verdict(
                f"error at n_u = {row.n}, 2 ms, {name}",
                f"at most {stiff.ASKED_ERROR:g} times that of the converged step",
                f"{ratio:.3g} times, {row.ratio:.3g} times faster than Forest-Ruth",
                ratio <= stiff.ASKED_ERROR,
            )
        )
    for n, asked in stiff.ASKED_RATIO.items():
        exact = [
            row
            for row in (*rows, *composed)
            if row.n == n and (row.error_ratio or np.inf) <= stiff.ASKED_ERROR
        ]
        fastest = max(exact, key=lambda row: row.ratio)
        found.append(
            Verdict(
                f"speed and error at n_u = {n}, any step",
                f"{asked:g} times Forest-Ruth with at most {stiff.ASKED_ERROR:g} times the error",
                f"{fastest.ratio:.3g} times with {fastest.error_ratio:.3g} times, at "
                f"{1e3 * fastest.step:.3g} ms",
                fastest.ratio >= asked,
            )
        )
    stopped = [row for row in hard if row.outcome]
    worst = max(row.energy_error for row in hard)
    found.append(
        Verdict(
            "20, 50 and 100 ms",
            "every failed step recovered by smaller ones, energy closed",
            f"{len(stopped)} of {len(hard)} runs stopped, energy error {worst:.1e}, "
            f"{max(row.per_step for row in hard):.0f} iterations per step at most",
            not stopped and worst < random_checks.CONSERVING_TOLERANCE,
        )
    )
    return found


def add_extremes(report: Report, findings: Sequence[Finding], steel_ratio: float) -> list[Verdict]:
    """The extreme scenes; `steel_ratio` is the run time of steel over that of aluminium."""
    report.section("Extreme cables")
    header = ["scene", "what", "outcome", "right", "error", "bound", "of what", "energy error"]
    header += ["step [s]", "steps", "iterations per step", "run time [s]"]
    rows: list[list[Cell]] = [
        [
            one.name,
            one.what,
            one.outcome,
            "yes" if one.right else "**no**",
            one.error,
            one.bound,
            one.measure,
            one.energy_error,
            one.step,
            one.steps,
            one.iterations / one.steps if one.steps else None,
            one.wall,
        ]
        for one in findings
    ]
    report.table("extremes", header, rows, "Extreme scenes, energy_momentum")
    reasons = [f"{one.name}: {one.outcome}, {one.reason}" for one in findings if one.reason]
    if reasons:
        report.text("Not run to their end:")
        report.items(reasons)
    steel = Verdict(
        "steel",
        "as fast as aluminium",
        f"{steel_ratio:.2f} times its run time",
        steel_ratio <= AS_FAST,
    )
    return [steel, *(_extreme_verdict(one) for one in findings)]


def _extreme_verdict(one: Finding) -> Verdict:
    measured = one.outcome if one.error is None else f"{one.error:.1e} in {one.wall:.3f} s"
    asked = f"{one.measure}: at most {one.bound:g}, within {one.budget:g} s"
    return Verdict(one.name, asked, measured, one.right)


def add_random(report: Report, outcomes: Sequence[Outcome]) -> list[Verdict]:
    """The random scenes: counts, errors, reasons, and what is wrong."""
    report.section("Random scenes")
    report.text(
        f"""{len(outcomes)} scenes drawn from the seeds 0 to {len(outcomes) - 1}: E 1e4 to 1e12 Pa,
        diameter 1e-5 to 5e-2 m, length 1e-3 to 1e3 m, n_u 4 to 200, random ends, loads, damping,
        end motions, methods and steps. Each runs for 50 to 1000 steps. The balance of energy has to
        be closed to {random_checks.CONSERVING_TOLERANCE:g} of the energy exchanged with
        energy_momentum, and to {random_checks.METHOD_TOLERANCE:g} with methods that do not conserve
        it, whose largest errors at a step near the stability limit are in the table; where only
        constant forces do work it is checked without the simulator's account as well, and in free
        flight the momentum against the impulse to {random_checks.MOMENTUM_TOLERANCE:g}. A scene may
        take {random_checks.BUDGET:g} s."""
    )
    _random_table(report, outcomes)
    _random_figure(report, outcomes)
    reasons = Counter(
        (one.outcome, _kind_of(one.reason)) for one in outcomes if one.outcome in (REFUSED, STOPPED)
    )
    rows: list[list[Cell]] = [
        [what, reason, count] for (what, reason), count in reasons.most_common(MOST_REASONS)
    ]
    report.table(
        "random_reasons",
        ["outcome", "reason", "scenes"],
        rows,
        "Why scenes were refused or stopped",
    )
    wrong: list[list[Cell]] = [
        [one.seed, one.kind, one.method, one.control_points, one.step, one.steps, one.problem]
        for one in outcomes
        if one.outcome == WRONG
    ]
    header = ["seed", "kind", "method", "n_u", "step [s]", "steps", "problem"]
    report.table("random_wrong", header, wrong, "Scenes that went wrong")
    return [
        Verdict(
            f"{len(outcomes)} random scenes",
            "each runs with its balance closed, or is refused or stopped with a reason",
            f"{len(wrong)} wrong, slowest {max(one.wall for one in outcomes):.1f} s",
            not wrong,
        )
    ]


def _kind_of(reason: str) -> str:
    """A reason without its numbers."""
    return reason.partition(" (")[0].partition(";")[0].rstrip("0123456789.e+- ")[:100]


def _random_table(report: Report, outcomes: Sequence[Outcome]) -> None:
    rows: list[list[Cell]] = []
    for method in sorted({one.method for one in outcomes}):
        mine = [one for one in outcomes if one.method == method]
        counts = Counter(one.outcome for one in mine)
        errors = [one.energy_error for one in mine if one.outcome == RAN]
        spread = np.quantile(errors, (0.5, 0.9, 1.0)).tolist() if errors else [None] * 3
        slowest = max(one.wall for one in mine)
        cells = [counts[what] for what in (RAN, REFUSED, STOPPED, WRONG)]
        kept = sum(one.outcome == STOPPED and one.energy_error > one.tolerance for one in mine)
        rows.append([method, len(mine), *cells, kept, *spread, slowest])
    header = ["method", "scenes", RAN, REFUSED, STOPPED, WRONG, "stopped beyond the bound"]
    header += ["median energy error", "90 %", "largest", "slowest [s]"]
    report.table("random", header, rows, "Random scenes by method (auto: refused before a choice)")


def _random_figure(report: Report, outcomes: Sequence[Outcome]) -> None:
    """Energy error of every scene that ran over its step."""
    ran = [one for one in outcomes if one.outcome in (RAN, WRONG) and one.steps]
    figure, (axes,) = plotting.new_figure(width=9.0, height=5.0)
    for method in sorted({one.method for one in ran}):
        mine = [one for one in ran if one.method == method]
        axes.loglog(
            [one.step for one in mine],
            [max(one.energy_error, 1e-17) for one in mine],
            "o",
            markersize=4,
            alpha=0.6,
            color=plotting.COLORS.get(method, "black"),
            label=method,
        )
    bounds = (random_checks.CONSERVING_TOLERANCE, random_checks.METHOD_TOLERANCE)
    for bound, whose in zip(bounds, ("energy_momentum", "other methods"), strict=True):
        axes.axhline(bound, color="black", linestyle="--", linewidth=0.8)
        axes.text(1.1e-1, bound, f"bound of {whose}", fontsize="small", ha="right", va="bottom")
    axes.set_xlabel("step tau [s]")
    axes.set_ylabel("largest energy error, relative [-]")
    axes.grid(alpha=0.3)
    axes.legend(fontsize="small", loc="center left", bbox_to_anchor=(1.01, 0.5))
    columns: dict[str, list[float] | list[str] | list[int]] = {
        "seed": [one.seed for one in ran],
        "kind": [one.kind for one in ran],
        "method": [one.method for one in ran],
        "n_u": [one.control_points for one in ran],
        "step [s]": [one.step for one in ran],
        "energy error": [one.energy_error for one in ran],
        "time of stepping [s]": [one.wall for one in ran],
        "outcome": [one.outcome for one in ran],
    }
    report.figure(
        "random_energy",
        figure,
        columns,
        "Largest energy error of the random scenes that ran (below 1e-17: at 1e-17)",
    )
