"""The two parts of the error: space with time resolved, and time at a fixed resolution."""

from __future__ import annotations

from dataclasses import dataclass, replace
from itertools import product

import numpy as np
from matplotlib.ticker import NullFormatter, NullLocator
from numpy.typing import NDArray

from dlo_sim.core.methods import IMPLICIT, METHODS
from dlo_sim.scene.loading import SceneError
from dlo_sim.studies import plotting
from dlo_sim.studies.catalogue import Request
from dlo_sim.studies.report import Cell, Report
from dlo_sim.studies.work_precision.cases import Case
from dlo_sim.studies.work_precision.references import METHOD, Reference
from dlo_sim.tuning.setting import Setting
from dlo_sim.tuning.trial import Trial, at_share, attempt, error

Array = NDArray[np.float64]
RESOLUTIONS = {True: (5, 7, 9, 13), False: (5, 7, 9, 11, 13, 17, 21, 25, 29)}
FIXED = {True: 7, False: 11}  # n_u at which time is looked at
STEPS = {True: (4e-3, 2e-3), False: (8e-3, 4e-3, 2e-3, 1e-3, 5e-4, 2.5e-4)}
SHARES = {True: (1.0, 0.5), False: (1.0, 0.5, 0.25)}
# Kinds of cable that are compared in space: setting and colour.
CABLES = {
    "stretching": (Setting(METHOD, 0), "tab:green"),
    "stretching by span": (Setting(METHOD, 0, stretch="span"), "tab:purple"),
    "inextensible": (Setting("rattle", 0), "tab:gray"),
}
FINEST = 0.25  # of the smallest step, or share, compared: where time is resolved
METHODS_OF_TIME = {
    True: ("velocity_verlet", "rattle", "energy_momentum"),
    False: (
        *("forest_ruth", "rk4", "velocity_verlet", "rattle"),
        *("implicit_midpoint", "energy_momentum", "energy_momentum_4", "generalized_alpha"),
    ),
}


@dataclass(frozen=True, eq=False)
class _Piece:
    """A case's run for one point of a figure; share 0 = the step of the setting."""

    case: Case
    setting: Setting
    share: float


def add(report: Report, request: Request, cases: list[Case], truths: dict[str, Reference]) -> None:
    """Both figures and their tables, by workers: nothing is timed here."""
    report.section("Error in space and in time, separately")
    _space(report, request, cases, truths)
    _time(report, request, cases)


def _space(
    report: Report, request: Request, cases: list[Case], truths: dict[str, Reference]
) -> None:
    of_cases = list(product(cases, CABLES, RESOLUTIONS[request.quick]))
    pieces = [
        _Piece(case, replace(CABLES[cable][0], control_points=n_u), 0.5)
        for case, cable, n_u in of_cases
    ]
    rows: list[list[Cell]] = []
    trials = request.workers.map(_run, pieces)
    for (case, cable, n_u), trial in zip(of_cases, trials, strict=True):
        off = error(trial.points, truths[case.name].points, case.components)
        rows.append([case.name, cable, n_u, 100 * off / case.scale if trial.ok else np.inf])
    figure, panels = plotting.new_figure(2, 3, width=12.0, height=7.0)
    for panel, case in zip(panels, cases, strict=True):
        for cable, (_, color) in CABLES.items():
            shown = [row for row in rows if row[0] == case.name and row[1] == cable]
            shown = [row for row in shown if np.isfinite(_number(row[3]))]
            x, y = [row[2] for row in shown], [row[3] for row in shown]
            panel.loglog(x, y, "o-", color=color, label=cable)
        panel.axhline(100 * truths[case.name].own_error, color="0.5", linestyle=":")
        panel.set(title=case.title, xlabel="control points n_u [-]")
        panel.set_xticks(RESOLUTIONS[request.quick], [str(n) for n in RESOLUTIONS[request.quick]])
        panel.xaxis.set_minor_locator(NullLocator())
        panel.yaxis.set_minor_formatter(NullFormatter())
        panel.set_ylabel(f"error [% of {case.scale_words}]")
        panel.grid(alpha=0.3, which="both", linewidth=0.4)
    panels[0].legend(fontsize="small")
    report.figure(
        "space",
        figure,
        {
            "case": np.array([row[0] for row in rows]),
            "cable": np.array([row[1] for row in rows]),
            "n_u": [_number(row[2]) for row in rows],
            "error [%]": [_number(row[3]) for row in rows],
        },
        f"Error against resolution at half the own step of {METHOD} (stretching at every sample, "
        "or by its mean over a span) and rattle (inextensible); dotted: own error of the "
        "reference. What an inextensible cable leaves out shows where its curve levels off above "
        "the dots; one that fails has no point",
    )


def _time(report: Report, request: Request, cases: list[Case]) -> None:
    pieces: list[_Piece] = []
    n_u = FIXED[request.quick]
    for case in cases:
        for method in METHODS_OF_TIME[request.quick]:
            implicit = METHODS[method].family == IMPLICIT
            if method == "forest_ruth" and case.damped:
                continue
            steps, shares = STEPS[request.quick], SHARES[request.quick]
            finest = FINEST * (steps[-1] if implicit else shares[-1])
            for value in (*(steps if implicit else shares), finest):
                step, share = (value, 0.0) if implicit else (0.0, value)
                pieces.append(_Piece(case, Setting(method, n_u, step), share))
    trials = list(request.workers.map(_run, pieces))
    rows: list[list[Cell]] = []
    groups: dict[tuple[str, str], list[Trial]] = {}
    for piece, trial in zip(pieces, trials, strict=True):
        groups.setdefault((piece.case.name, piece.setting.method), []).append(trial)
    by_name = {case.name: case for case in cases}
    for (name, method), group in groups.items():
        case, truth = by_name[name], group[-1]
        errors = [error(t.points, truth.points, case.components) / case.scale for t in group[:-1]]
        for k, (trial, off) in enumerate(zip(group, errors, strict=False)):
            good = trial.ok and truth.ok
            order = None
            if good and k and group[k - 1].ok and min(off, errors[k - 1]) > 0.0:
                ratio = np.log(errors[k - 1] / off)
                order = float(ratio / np.log(group[k - 1].step / trial.step))
            rows.append([name, method, 1e3 * trial.step, 100 * off if good else None, order])
    report.table(
        "order_in_time",
        ["case", "method", "step [ms]", "error [%]", "order"],
        rows,
        f"Error in time at n_u = {n_u}: against the same method and resolution at a quarter of the "
        "smallest step; order from the step before; a dash: failed",
    )
    figure, panels = plotting.new_figure(2, 3, width=12.0, height=7.0)
    for panel, case in zip(panels, cases, strict=True):
        for method in METHODS_OF_TIME[request.quick]:
            shown = [r for r in rows if r[0] == case.name and r[1] == method and r[3] is not None]
            color = plotting.COLORS.get(method, "black")
            panel.loglog(
                [r[2] for r in shown], [r[3] for r in shown], "o-", color=color, label=method
            )
        panel.set(title=case.title, xlabel="step [ms]")
        panel.xaxis.set_minor_formatter(NullFormatter())
        panel.set_ylabel(f"error [% of {case.scale_words}]")
        panel.grid(alpha=0.3, which="both", linewidth=0.4)
    panels[0].legend(fontsize="x-small")
    report.figure(
        "time",
        figure,
        {
            "case": np.array([row[0] for row in rows]),
            "method": np.array([row[1] for row in rows]),
            "step [ms]": [_number(row[2]) for row in rows],
            "error [%]": [np.inf if row[3] is None else _number(row[3]) for row in rows],
        },
        f"Error in time alone, n_u = {n_u}",
    )


def _run(piece: _Piece) -> Trial:
    setting = piece.setting
    if piece.share:
        try:
            setting = at_share(piece.case.job, setting, piece.share)
        except SceneError:
            pass  # the attempt below is refused for the same reason
    return attempt(piece.case.job, setting, timed=False)


def _number(cell: Cell) -> float:
    assert isinstance(cell, int | float)
    return float(cell)
