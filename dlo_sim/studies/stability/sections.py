"""The report's tables of stiff methods and extreme scenes."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from dlo_sim.studies.report import Cell, Report
from dlo_sim.studies.stability import random_checks, stiff
from dlo_sim.studies.stability.extremes import Finding
from dlo_sim.studies.stability.stiff import Stiff

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
    shortest = [row for row in rows if row.step == stiff.STEPS[0]]
    fourth = [row for row in composed if row.step == stiff.STEPS[0]]
    return [
        _energy_verdict([row for row in rows if row.step in stiff.STEPS]),
        *(_speed_verdict(row) for row in shortest),
        *(_error_verdict(row, "energy_momentum") for row in shortest),
        *(_error_verdict(row, "energy_momentum_4") for row in fourth),
        *(_both_verdict(n, (*rows, *composed)) for n in stiff.ASKED_RATIO),
        _recovery_verdict([row for row in rows if row.step in stiff.HARD_STEPS]),
    ]


def _energy_verdict(rows: Sequence[Stiff]) -> Verdict:
    worst = max(row.energy_error for row in rows)
    return Verdict(
        "energy at 2, 5 and 10 ms",
        f"below {stiff.ASKED_ENERGY:g} over 10 s",
        f"{worst:.1e}",
        worst < stiff.ASKED_ENERGY and not any(row.outcome for row in rows),
    )


def _speed_verdict(row: Stiff) -> Verdict:
    asked = stiff.ASKED_RATIO[row.n]
    return Verdict(
        f"speed at n_u = {row.n}, 2 ms",
        f"{asked:g} times Forest-Ruth",
        f"{row.ratio:.1f} times",
        row.ratio >= asked,
    )


def _error_verdict(row: Stiff, method: str) -> Verdict:
    ratio = row.error_ratio or np.inf
    return Verdict(
        f"error at n_u = {row.n}, 2 ms, {method}",
        f"at most {stiff.ASKED_ERROR:g} times that of the converged step",
        f"{ratio:.3g} times, {row.ratio:.3g} times faster than Forest-Ruth",
        ratio <= stiff.ASKED_ERROR,
    )


def _both_verdict(n: int, rows: Sequence[Stiff]) -> Verdict:
    """Speed of the fastest run whose error is small enough, of any method and step."""
    asked = stiff.ASKED_RATIO[n]
    exact = [row for row in rows if row.n == n and (row.error_ratio or np.inf) <= stiff.ASKED_ERROR]
    fastest = max(exact, key=lambda row: row.ratio)
    return Verdict(
        f"speed and error at n_u = {n}, any step",
        f"{asked:g} times Forest-Ruth with at most {stiff.ASKED_ERROR:g} times the error",
        f"{fastest.ratio:.3g} times with {fastest.error_ratio:.3g} times, at "
        f"{1e3 * fastest.step:.3g} ms",
        fastest.ratio >= asked,
    )


def _recovery_verdict(rows: Sequence[Stiff]) -> Verdict:
    stopped = [row for row in rows if row.outcome]
    worst = max(row.energy_error for row in rows)
    return Verdict(
        "20, 50 and 100 ms",
        "every failed step recovered by smaller ones, energy closed",
        f"{len(stopped)} of {len(rows)} runs stopped, energy error {worst:.1e}, "
        f"{max(row.per_step for row in rows):.0f} iterations per step at most",
        not stopped and worst < random_checks.CONSERVING_TOLERANCE,
    )


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
