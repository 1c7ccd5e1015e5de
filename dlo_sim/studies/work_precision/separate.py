"""The two parts of the error: in space with time resolved, and in time at a fixed resolution."""

from __future__ import annotations

from dataclasses import replace
from itertools import product

import numpy as np

from dlo_sim.core.methods import IMPLICIT, METHODS
from dlo_sim.studies import Request
from dlo_sim.studies.plotting import Panel, chart
from dlo_sim.studies.report import Report, columns
from dlo_sim.studies.runs import each
from dlo_sim.studies.work_precision.cases import Case
from dlo_sim.studies.work_precision.references import METHOD, Reference, run
from dlo_sim.studies.work_precision.sweep import METHODS_TRIED
from dlo_sim.tuning.setting import Setting
from dlo_sim.tuning.trial import Job, Trial

RESOLUTIONS = {True: (5, 7, 9, 13), False: (5, 7, 9, 11, 13, 17, 21, 25, 29)}
FIXED = {True: 7, False: 11}  # n_u for the error in time
STEPS = {True: (4e-3, 2e-3), False: (8e-3, 4e-3, 2e-3, 1e-3, 5e-4, 2.5e-4)}
SHARES = {True: (1.0, 0.5), False: (1.0, 0.5, 0.25)}
FINEST = 0.25  # factor from the smallest step, or share, compared to that of the reference
CABLES = {
    "stretching": Setting(METHOD, 0),
    "stretching by span": Setting(METHOD, 0, stretch="span"),
    "inextensible": Setting("rattle", 0),
}
SIZE = (13.0, 8.0)
Piece = tuple[Job, Setting, float]  # arguments of `references.run`
OrderRow = tuple[str, str, float, float, float | None]  # case, method, step, error, order


def add(report: Report, request: Request, cases: list[Case], truths: dict[str, Reference]) -> None:
    """Add both figures and a table, computed by workers; nothing is timed here."""
    report.section("Error in space and in time, separately")
    _space(report, request, cases, truths)
    _time(report, request, cases)


def _space(
    report: Report, request: Request, cases: list[Case], truths: dict[str, Reference]
) -> None:
    pieces = {
        (case, cable, n): (case.job, replace(CABLES[cable], control_points=n), 0.5)
        for case, cable, n in product(cases, CABLES, RESOLUTIONS[request.quick])
    }
    trials = each(request.workers, run, pieces.values())
    rows = [
        (case.name, cable, n, _off(case, trials[piece], truths[case.name].points))
        for (case, cable, n), piece in pieces.items()
    ]
    panel = Panel("n_u", "error [%]", ["error"], by="cable", log="y", marker="o")
    panels = _panels(panel, cases)
    own = {case.name: {"reference": truths[case.name].own_error} for case in cases}
    chart(
        report,
        "space",
        columns(("case", "cable", "n_u", "error"), rows),
        [replace(one, levels=own[case.name]) for one, case in zip(panels, cases, strict=True)],
        f"Error against resolution at half the own step of {METHOD} (stretching at every sample, "
        "or by its mean over a span) and rattle (inextensible), as a share of the case's scale; "
        "dotted: own error of the reference",
        SIZE,
        rows=2,
    )


def _panels(panel: Panel, cases: list[Case]) -> list[Panel]:
    return [replace(panel, title=case.title, where={"case": case.name}) for case in cases]


def _time(report: Report, request: Request, cases: list[Case]) -> None:
    kinds = product(cases, METHODS_TRIED[request.quick])
    pieces = {kind: _steps(*kind, request.quick) for kind in kinds}
    trials = each(request.workers, run, [one for some in pieces.values() for one in some])
    rows: list[OrderRow] = []
    for (case, method), some in pieces.items():
        *tried, truth = (trials[one] for one in some)
        rows += order_rows(case, method, tried, truth)
    report.table(
        "order_in_time",
        "case | method | step [ms] | error [%] | order",
        rows,
        f"Error in time at n_u = {FIXED[request.quick]}: against the same method and resolution at "
        "a quarter of the smallest step; order from the step before; failed runs are left out",
    )
    panel = Panel("step [s]", "error [%]", ["error"], by="method", log="xy", marker="o")
    data = columns(("case", "method", "step [s]", "error"), [row[:4] for row in rows])
    chart(report, "time", data, _panels(panel, cases), "Error in time alone", SIZE, rows=2)


def order_rows(case: Case, method: str, tried: list[Trial], truth: Trial) -> list[OrderRow]:
    """Step [s], error, and order from the previous row; failed and refused runs are left out."""
    rows: list[OrderRow] = []
    for trial in tried:
        off, order = _off(case, trial, truth.points), None
        if np.isnan(off):
            continue
        if rows:
            _, _, step, before, _ = rows[-1]
            order = float(np.log(before / off) / np.log(step / trial.step))
        rows.append((case.name, method, trial.step, off, order))
    return rows


def _steps(case: Case, method: str, quick: bool) -> list[Piece]:
    """Runs at decreasing steps, the last one for the reference."""
    setting, implicit = Setting(method, FIXED[quick]), METHODS[method].family == IMPLICIT
    values = (STEPS if implicit else SHARES)[quick]
    values = (*values, FINEST * values[-1])
    if implicit:
        return [(case.job, replace(setting, step=step), 0.0) for step in values]
    return [(case.job, setting, share) for share in values]


def _off(case: Case, trial: Trial, truth: np.ndarray) -> float:
    """Error relative to the case's scale; nan if the run or its reference failed."""
    off = case.error(trial.points, truth)
    return off if trial.ok and np.isfinite(off) else float("nan")
