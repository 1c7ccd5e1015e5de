"""The report's part on random scenes: what became of them, how far their balances are open."""

from __future__ import annotations

from collections import Counter
from collections.abc import Sequence

import numpy as np

from dlo_sim.studies import plotting
from dlo_sim.studies.report import Cell, Report
from dlo_sim.studies.stability import random_checks
from dlo_sim.studies.stability.random_checks import (
    OWN_BALANCES,
    RAN,
    REFUSED,
    STOPPED,
    WRONG,
    Outcome,
)
from dlo_sim.studies.stability.sections import Verdict

MOST_REASONS = 12  # shown
SHARP = 0.1  # of the energy exchanged: a run whose balance is further open has large errors


def add_random(report: Report, outcomes: Sequence[Outcome]) -> list[Verdict]:
    """The random scenes: counts, errors, reasons, and what is wrong."""
    report.section("Random scenes")
    ran = [one for one in outcomes if one.outcome == RAN]
    still = sum(not one.moved for one in ran)
    report.text(
        f"""{len(outcomes)} scenes drawn from the seeds 0 to {len(outcomes) - 1}: E 1e4 to 1e12 Pa,
        diameter 1e-5 to 5e-2 m, length 1e-3 to 1e3 m, n_u 4 to 200, random ends, loads, damping,
        end motions, methods and steps. Each runs for 50 to 1000 steps. With energy_momentum the
        balance of energy has to be closed to {random_checks.CONSERVING_TOLERANCE:g} of the energy
        exchanged. With methods that do not conserve energy it may be open by
        {random_checks.METHOD_TOLERANCE:g}, which is no more than that the simulator's own guard
        against divergence, at the same share, has worked; how many are open by more than
        {SHARP:g} is in the table. The state that a stopped run keeps is judged like any other. A
        scene may take {random_checks.BUDGET:g} s of processor time, its constructor included. In
        {still} of the {len(ran)} scenes that ran less energy was exchanged than round-off leaves
        uncertain: their balance says nothing, and they are counted as not moved."""
    )
    _outcome_table(report, outcomes)
    _balance_table(report, outcomes)
    _figure(report, outcomes)
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
    slowest = max(one.setup + one.wall for one in outcomes)
    return [
        Verdict(
            f"{len(outcomes)} random scenes",
            "each runs with its balance closed, or is refused or stopped with a reason",
            f"{len(wrong)} wrong, {still} of {len(ran)} did not move, slowest {slowest:.1f} s",
            not wrong,
        )
    ]


def _kind_of(reason: str) -> str:
    """A reason without its numbers."""
    return reason.partition(" (")[0].partition(";")[0].rstrip("0123456789.e+- ")[:100]


def _outcome_table(report: Report, outcomes: Sequence[Outcome]) -> None:
    rows: list[list[Cell]] = []
    for method in sorted({one.method for one in outcomes}):
        mine = [one for one in outcomes if one.method == method]
        counts = Counter(one.outcome for one in mine)
        ran = [one for one in mine if one.outcome == RAN]
        errors = [one.energy_error for one in ran]
        spread = np.quantile(errors, (0.5, 0.9, 1.0)).tolist() if errors else [None] * 3
        large = sum(error > SHARP for error in errors)
        share = f"{large} ({large / len(errors):.1%})" if errors else "-"
        cells = [counts[what] for what in (RAN, REFUSED, STOPPED, WRONG)]
        still = sum(not one.moved for one in ran)
        slowest = [max(one.setup for one in mine), max(one.wall for one in mine)]
        rows.append([method, len(mine), *cells, still, *spread, share, *slowest])
    header = ["method", "scenes", RAN, REFUSED, STOPPED, WRONG, "ran, not moved"]
    header += ["median energy error", "90 %", "largest", f"above {SHARP:g}"]
    header += ["slowest constructor [s]", "slowest steps [s]"]
    report.table("random", header, rows, "Random scenes by method (auto: refused before a choice)")


def _balance_table(report: Report, outcomes: Sequence[Outcome]) -> None:
    """Balances that the simulator's account has no part in, of the scenes that ran."""
    rows: list[list[Cell]] = []
    for method in sorted({one.method for one in outcomes}):
        cells: list[Cell] = []
        for name in OWN_BALANCES:
            errors = [
                error
                for one in outcomes
                if (one.method, one.outcome) == (method, RAN)
                and (error := getattr(one, name)) is not None
            ]
            cells += [len(errors), max(errors) if errors else None]
        rows.append([method, *cells])
    header = ["method"]
    for name in OWN_BALANCES.values():
        header += [f"{name}: scenes", f"{name}: largest error"]
    report.table(
        "random_balances",
        header,
        rows,
        "Balances without the simulator's account, where they can be had: energy where only "
        "constant forces do work, energy against the work of the ends' reactions (both: of the "
        "energy exchanged, to the same bound), momentum (of the impulse, to "
        f"{random_checks.MOMENTUM_TOLERANCE:g}) and angular momentum (of force times length times "
        f"time, to {min(random_checks.ANGULAR_TOLERANCE.values()):g} with methods that keep it "
        f"within every step, else {max(random_checks.ANGULAR_TOLERANCE.values()):g}) in free "
        "flight",
    )


def _figure(report: Report, outcomes: Sequence[Outcome]) -> None:
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
        "floor / exchanged": [one.floor_share for one in ran],
        "time of stepping [s]": [one.wall for one in ran],
        "outcome": [one.outcome for one in ran],
    }
    report.figure(
        "random_energy",
        figure,
        columns,
        "Largest energy error of the random scenes that ran (below 1e-17: at 1e-17)",
    )
