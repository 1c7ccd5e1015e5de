"""The parts of the error: in space with time resolved, in time at a fixed resolution, and of static
shapes against closed forms or numerical solutions.
"""

from __future__ import annotations

from dataclasses import replace
from itertools import product
from typing import Any

import numpy as np

from dlo_sim.core.methods import IMPLICIT, METHODS
from dlo_sim.scene.description import Scene
from dlo_sim.scene.loading import scene_from_values
from dlo_sim.simulation.simulator import Simulator
from dlo_sim.studies import Request, analytic
from dlo_sim.studies.plotting import curves, draw, new_figure
from dlo_sim.studies.report import Report, columns
from dlo_sim.studies.runs import Array, each
from dlo_sim.studies.stability.scenes import ends
from dlo_sim.studies.work_precision.cases import CLOSED, Case, cantilever, rod_of, soft_cable, wire
from dlo_sim.studies.work_precision.references import METHOD, Reference, run
from dlo_sim.tuning.setting import Setting
from dlo_sim.tuning.trial import Trial

METHODS_TRIED = {
    True: ("velocity_verlet", "energy_momentum"),
    False: (
        *("forest_ruth", "rk4", "velocity_verlet", "rattle"),
        *("implicit_midpoint", "energy_momentum", "energy_momentum_4"),
    ),
}
RESOLUTIONS = {True: (5, 7, 9, 13), False: (5, 7, 9, 11, 13, 17, 21, 25, 29)}
FIXED = {True: 7, False: 11}  # n_u for the error in time
STEPS = {True: (4e-3, 2e-3), False: (8e-3, 4e-3, 2e-3, 1e-3, 5e-4, 2.5e-4)}
SHARES = {True: (1.0, 0.5), False: (1.0, 0.5, 0.25)}
FINEST = 0.25  # factor from the smallest step, or share, compared to that of the reference
STATIC_RESOLUTIONS = {True: (7, 13), False: (7, 9, 13, 19, 27, 39)}
CABLES = {
    "stretching": Setting(METHOD, 0),
    "stretching by span": Setting(METHOD, 0, stretch="span"),
    "inextensible": Setting("rattle", 0),
}
Known = tuple[Scene, float, Array, float]  # scene, u / L, its x and z there [m], scale [m]


def add(report: Report, request: Request, cases: list[Case], truths: dict[str, Reference]) -> None:
    """Add the errors in space and in time, computed by workers; nothing is timed here."""
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
    figure, panels = new_figure(2, len(cases) // 2, 13.0, 8.0)
    for axes, case in zip(panels, cases, strict=True):
        own = 100 * truths[case.name].own_error
        axes.axhline(own, color="gray", linestyle=":", label="reference")
        lines = curves([row for row in rows if row[0] == case.name], 1, 2, 3, 100.0)
        draw(axes, lines, "n_u", "error [%]", "y", case.title, marker="o")
    report.figure(
        "space",
        figure,
        columns(("case", "cable", "n_u", "error"), rows),
        f"Error against resolution at half the own step of {METHOD} (stretching at every sample, "
        "or by its mean over a span) and rattle (inextensible), as a share of the case's scale; "
        "dotted: own error of the reference",
    )


def _time(report: Report, request: Request, cases: list[Case]) -> None:
    quick, kinds = request.quick, list(product(cases, METHODS_TRIED[request.quick]))
    pieces: dict[Any, list[Any]] = {}
    for case, method in kinds:
        setting, implicit = Setting(method, FIXED[quick]), METHODS[method].family == IMPLICIT
        values = (STEPS if implicit else SHARES)[quick]
        pieces[case, method] = [
            (case.job, replace(setting, step=value), 0.0)
            if implicit
            else (case.job, setting, value)
            for value in (*values, FINEST * values[-1])  # the last one is the reference
        ]
    trials = each(request.workers, run, [one for some in pieces.values() for one in some])
    rows = []
    for (case, method), some in pieces.items():
        *tried, truth = (trials[one] for one in some)
        rows += order_rows(case, method, tried, truth)
    report.table(
        "order_in_time",
        "case | method | step [ms] | error [%] | order",
        rows,
        f"Error in time at n_u = {FIXED[quick]}: against the same method and resolution at "
        "a quarter of the smallest step; order from the step before; failed runs are left out",
    )
    figure, panels = new_figure(2, len(cases) // 2, 13.0, 8.0)
    for axes, case in zip(panels, cases, strict=True):
        lines = curves([row for row in rows if row[0] == case.name], 1, 2, 3, 100.0)
        draw(axes, lines, "step [s]", "error [%]", "xy", case.title, marker="o")
    data = columns(("case", "method", "step [s]", "error"), [row[:4] for row in rows])
    report.figure("time", figure, data, "Error in time alone")


def order_rows(case: Case, method: str, tried: list[Trial], truth: Trial) -> list[tuple[Any, ...]]:
    """Case, method, step [s], error, and order from the previous row; failed and refused runs are
    left out."""
    rows: list[tuple[Any, ...]] = []
    for trial in tried:
        off, order = _off(case, trial, truth.points), None
        if np.isnan(off):
            continue
        if rows:
            _, _, step, before, _ = rows[-1]
            order = float(np.log(before / off) / np.log(step / trial.step))
        rows.append((case.name, method, trial.step, off, order))
    return rows


def _off(case: Case, trial: Trial, truth: Array) -> float:
    """Error relative to the case's scale; nan if the run or its reference failed."""
    off = case.error(trial.points, truth)
    return off if trial.ok and np.isfinite(off) else float("nan")


def add_static(report: Report, quick: bool) -> None:
    """Add a table and a figure of the errors of static shapes against n_u."""
    report.section("Against analytic results")
    report.text(
        """Compared with the heavy elastica, solved by collocation, with curvature per deformed
        length as in the simulator (per rest length the cantilever's tip would differ by 0.02 % of
        the length): cantilever, the tip of the rubber cord; clamped, the middle of the soft cable
        with its grippers 0.8 m apart; wire, its sag on its springs. Catenary: the middle of a cable
        without bending stiffness, closed form. Errors are relative to the length, for the wire to
        its sag."""
    )
    shapes, rows = known_shapes(), []
    for (name, (scene, u, truth, scale)), n_u in product(shapes.items(), STATIC_RESOLUTIONS[quick]):
        place = Simulator(at_rest(scene, n_u)).centerline([u * scene.cable.length])[0, [0, 2]]
        rows.append((name, n_u, float(np.abs(place - truth).max()) / scale))
    report.table(
        "analytic",
        ["n_u", *(f"{name} [%]" for name in shapes)],
        [[n, *(row[2] for row in rows if row[1] == n)] for n in STATIC_RESOLUTIONS[quick]],
        "Errors of equilibria",
    )
    figure, (axes,) = new_figure(width=8.5, height=4.6)
    draw(axes, curves(rows, 0, 1, 2, 100.0), "n_u", "error [%]", "y", marker="o")
    data = columns(("what", "n_u", "error"), rows)
    report.figure("analytic_errors", figure, data, "Equilibria against analytic results")


def at_rest(scene: Scene, n_u: int) -> Scene:
    """The scene at rest with this resolution."""
    return scene.with_values(
        {
            "discretization.control_points": n_u,
            "discretization.quadrature": "gauss",
            "discretization.samples": 3,
            "integrator.method": "energy_momentum",
            "integrator.step": 1e-3,
            "initial.shape": "equilibrium",
        }
    )


def known_shapes() -> dict[str, Known]:
    """Static shapes with known solutions, by name."""
    cord, thin, gap = cantilever().scene, wire(1).scene, 1.0 - CLOSED
    soft = soft_cable().scene.with_values({"end.position": [gap, 0.0, 0.0]})
    tip = analytic.cantilever_tip(rod_of(cord, True), cord.cable.length)
    length = thin.cable.length
    sag = analytic.sag(rod_of(thin, True), length, length, thin.start.spring[0])
    low = analytic.sag(rod_of(soft, True), soft.cable.length, gap)
    cable = {"cable.linear_density": 0.1, "cable.axial_stiffness": 1.0e4, "terms.bend": "off"}
    limp = scene_from_values({**cable, **ends(0.0, gap)})
    length = limp.cable.length
    (x,), (z,) = analytic.catenary(np.array([0.5 * length]), length, gap, 0.1 * 9.81, 1.0e4)
    return {
        "cantilever": (cord, 1.0, np.array(tip), cord.cable.length),
        "clamped": (soft, 0.5, np.array([0.5 * gap, -low]), soft.cable.length),
        "wire": (thin, 0.5, np.array([0.5 * thin.cable.length, -sag]), sag),
        "catenary": (limp, 0.5, np.array([x, z]), length),
    }
