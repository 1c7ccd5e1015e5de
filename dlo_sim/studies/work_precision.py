"""`dlo_sim study work-precision`: error against run time of methods, resolutions and steps.

A case is a cable, its motion, and how its error is measured. Each case has a converged reference,
checked by a method of another family; all settings run on it; its error in space and its error in
time are also measured alone.
"""

from __future__ import annotations

import contextlib
from collections.abc import Iterable, Sequence
from dataclasses import dataclass, replace
from itertools import product
from operator import attrgetter
from typing import Any, NamedTuple

import numpy as np

from dlo_sim.batch.workers import Workers
from dlo_sim.core.end_motion import EndMotion
from dlo_sim.core.methods import IMPLICIT, METHODS
from dlo_sim.scene.description import Scene
from dlo_sim.scene.loading import SceneError, load_scene, scene_from_values, shipped_scene
from dlo_sim.simulation.simulator import Simulator
from dlo_sim.studies import Outcome, Request
from dlo_sim.studies.report import COLORS, Array, Report, draw, new_figure
from dlo_sim.studies.runs import each
from dlo_sim.tuning.setting import Setting, ways_to_resolve
from dlo_sim.tuning.trial import Job, Trial, at_share, attempt, error

# The cases: cables and motions.

CLOSED = 0.2  # [m] by which the gripper of the soft cable closes
CLOSING = 2.0  # [s], duration of this motion: half of it accelerating, half decelerating


@dataclass(frozen=True, eq=False)
class Case:
    """A job and how its error is measured.

    Attributes:
        name: for files. hold: how the ends are held, in a word.
        components: world axes of the error. scale: length [m] that errors are relative to.
        fine: n_u of the two reference runs.
    """

    name: str
    title: str
    job: Job
    hold: str
    components: tuple[int, ...] = (0, 2)
    scale: float = 1.0
    scale_words: str = "the length"
    fine: tuple[int, int] = (33, 41)

    @property
    def scene(self) -> Scene:
        """The scene of the job."""
        return self.job.scene

    def error(self, points: Array, truth: Array) -> float:
        """Error of positions (T, m, 3) as a share of the scale; see `trial.error`."""
        return error(points, truth, self.components) / self.scale

    def shortened(self, duration: float, fine: tuple[int, int]) -> Case:
        """The same case for a shorter time [s], with coarser references."""
        return replace(self, job=replace(self.job, duration=duration), fine=fine)


def wire(number: int) -> Case:
    """Scenario 1 or 2 of Khalifa & Palli, the middle of the wire over 2 s."""
    name, title, axes = {
        1: ("paper_wire", "Scenario 1: wire, gravity", (2,)),
        2: ("paper_wire_force", "Scenario 2: wire, gravity and a force", (1, 2)),
    }[number]
    job = Job(load_scene(shipped_scene(name)), 2.0, (0.5,))
    fine = {"discretization.control_points": 41, "initial.shape": "equilibrium"}
    sag = -Simulator(job.scene.with_values(fine)).centerline([0.5 * job.scene.cable.length])[0, 2]
    return Case(f"scenario_{number}", title, job, "pinned", axes, sag, "the static sag")


def soft_cable() -> Case:
    """A soft cable between two clamps 1 m apart, one of which moves 0.2 m closer within 2 s."""
    far = {"end.fixed": [True] * 3, "end.clamped": True, "end.tangent": [1.0, 0.0, 0.0]}
    scene = _clamped(1.0, 0.006, 1200.0, 1e7, **{"damping.mass": 2.0}, **far)
    job = Job(scene, 4.0, (0.5,), 2e-3, closing())
    return Case("soft_grippers", "Soft cable, one gripper moving", job, "clamped", fine=(49, 65))


def closing() -> tuple[tuple[str, EndMotion], ...]:
    """Motion of the soft cable's gripper: it speeds up and slows down, at rest before and after."""
    half = 0.5 * CLOSING
    pull = np.array([CLOSED / half**2, 0.0, 0.0])  # [m/s^2]
    first = EndMotion.resting((1.0, 0.0, 0.0)).then(half, acceleration=-pull)
    return ("end", first), ("end", first.then(half, acceleration=pull))


def cantilever() -> Case:
    """A rubber cord clamped at one end, released straight: its tip falls by 0.9 of the length."""
    job, title = Job(_clamped(0.3, 0.005, 1100.0, 5e6), 1.0, (1.0,)), "Cantilever, large deflection"
    return Case("cantilever", title, job, "cantilever", scale=0.3, fine=(49, 65))


def steel() -> Case:
    """A steel wire, 0.5 m by 1 mm, clamped at one end and released straight."""
    steel_wire = _clamped(0.5, 0.001, 7850.0, 2.1e11, **{"cable.shear_modulus": 8e10})
    job = Job(steel_wire, 1.0, (1.0,))
    return Case("steel_wire", "Stiff steel wire", job, "cantilever", scale=0.5, fine=(25, 33))


def chain() -> Case:
    """A hanging rope, released at 30 degrees, with negligible bending stiffness."""
    angle = np.radians(30.0)
    scene = scene_from_values(
        {
            "cable.length": 1.0,
            "cable.linear_density": 0.1,
            "cable.axial_stiffness": 1.0e4,
            "cable.bending_stiffness": 1.0e-4,
            "end.position": [float(np.sin(angle)), 0.0, -float(np.cos(angle))],
            "initial.shape": "straight",
            "terms.twist": "off",
            "terms.out_of_plane": "off",
        }
    )
    job = Job(scene, 2.0, (0.5, 1.0))
    return Case("hanging_chain", "Hanging chain", job, "hanging", fine=(49, 65))


def all_cases(quick: bool) -> list[Case]:
    """The six cases; a quick study has four for a quarter of the time, on coarser references."""
    if not quick:
        return [wire(1), wire(2), soft_cable(), cantilever(), chain(), steel()]
    cases = [wire(1), soft_cable(), cantilever(), steel()]
    return [case.shortened(0.25 * case.job.duration, (17, 21)) for case in cases]


def _clamped(
    length: float, diameter: float, density: float, modulus: float, **more: object
) -> Scene:
    """A straight round cable along x, clamped at its start, that is kept in the xz plane."""
    values = {
        "cable.length": length,
        "cable.diameter": diameter,
        "cable.density": density,
        "cable.youngs_modulus": modulus,
        "cable.shear_modulus": modulus / 3.0,
        "initial.shape": "straight",
        "start.clamped": True,
        "start.tangent": [1.0, 0.0, 0.0],
        "end.position": [length, 0.0, 0.0],
        "terms.twist": "off",
        "terms.out_of_plane": "off",
    }
    return scene_from_values(values | more)


# What is run, by `quick`.

COMPARED = {
    True: ("velocity_verlet", "energy_momentum"),
    False: (
        *("forest_ruth", "rk4", "velocity_verlet"),
        *("implicit_midpoint", "energy_momentum", "energy_momentum_4"),
    ),
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
# Of the reference: valid with mass damping; its time error at such steps is negligible.
REFERENCE = "velocity_verlet"
CHECK, CHECK_STEP = "energy_momentum_4", 2.5e-4  # [s]
CHECK_DAMPED = "rk4"  # at its own step: damping is unstable in negative sub-steps of compositions
# Of the error in space alone, and in time alone:
RESOLUTIONS = {True: (5, 7, 9, 13), False: (5, 7, 9, 11, 13, 17, 21, 25, 29)}
CABLES = {
    "stretching": Setting(REFERENCE, 0),
    "stretching by span": Setting(REFERENCE, 0, stretch="span"),
}
FIXED = {True: 7, False: 11}  # n_u
TIME_STEPS = {True: (4e-3, 2e-3), False: (8e-3, 4e-3, 2e-3, 1e-3, 5e-4, 2.5e-4)}
TIME_SHARES = {True: (1.0, 0.5), False: (1.0, 0.5, 0.25)}
FINEST = 0.25  # factor from the smallest step, or share, to that of the reference

SHOWN_LEVEL = 0.01  # error, relative to the scale, for the verdict on the fastest setting
LEVELS = (0.1, 0.03, 0.01, 0.003, 0.001, 0.0003)  # of the case's scale
COSTS = {
    "wall": "run time [s per simulated s]",
    "evaluations": "force evaluations (implicit: iterations) per simulated s",
}
RUNS = (
    "method | stretch | n_u | step [s] | status | setting | error | s per simulated s | spread | "
    "evaluations [1/s] | energy error"
)


def run_study(request: Request) -> Outcome:
    """Run the study into a folder."""
    files = {name: shipped_scene(name) for name in ("paper_wire", "paper_wire_force")}
    report, quick = Report(request, "Error against run time", files), request.quick
    cases = all_cases(quick)
    truths = references(cases, request.workers)
    request.progress(0.2)
    _add_references(report, cases, truths)
    report.section("Error against run time, case by case")
    report.text(
        """Error and run time of a setting, least of the repeats, are from the same simulator.
        Implicit methods run at given steps, energy_momentum also with a tolerance of 1e-3 of the
        energy exchanged; explicit ones at shares of their own step. Gauss quadrature with three
        points per span."""
    )
    levels: list[list[Any]] = []
    verdicts: dict[str, str] = {}
    for k, case in enumerate(cases):
        truth = truths[case.name]
        runs = swept(case, truth, quick)
        _diagram(report, case, truth, runs)
        levels += _level_rows(case, truth, runs)
        found = fastest(runs, SHOWN_LEVEL)
        words = f"{found.words}: {found.wall:.2g} s" if found else "no setting tried"
        verdicts[f"{case.name}, a simulated second within 1 %"] = words
        request.progress(0.2 + 0.6 * (k + 1) / len(cases))
    report.section("The fastest settings")
    header = "case | error at most [%] | setting | error [%] | s per simulated s | "
    header += "spread [%] {:.0f} | step [ms]"
    report.table("fastest", header, levels, "The fastest setting for each error")
    report.section("Error in space and in time, separately")
    _add_space(report, request, cases, truths)
    _add_time(report, request, cases)
    request.progress(1.0)
    return report.outcome(verdicts)


# Converged references.


@dataclass(frozen=True, eq=False)
class Reference:
    """A converged motion; differences are relative to the case's scale.

    Attributes:
        space: difference between the two finest resolutions. time: effect of half the step at the
            coarser one. check: setting of another method on the coarser mesh, with its step.
        disagreement: between that method and the run at half the step on the same mesh.
    """

    run: Trial
    space: float
    time: float
    check: Setting
    disagreement: float

    @property
    def points(self) -> Array:
        """Positions [m] at the job's times and coordinates, shape (T, m, 3)."""
        return self.run.points

    @property
    def own_error(self) -> float:
        """Sum of the errors in space and time, an upper bound while the error falls with n_u."""
        return self.space + self.time


def references(cases: list[Case], workers: Workers) -> dict[str, Reference]:
    """The references of cases by name; four runs each.

    Raises:
        RuntimeError: a run failed.
    """
    asked = {}
    for case in cases:
        coarse, fine = case.fine
        own = ((coarse, 1.0), (fine, 1.0), (coarse, 0.5))
        other = (Setting(CHECK, coarse, CHECK_STEP), 0.0)
        if case.scene.damping.mass:
            other = (Setting(CHECK_DAMPED, coarse), 1.0)
        settings = [*((Setting(REFERENCE, n), share) for n, share in own), other]
        asked[case.name] = [(case.job, *one) for one in settings]
    trials = each(workers, untimed, [one for some in asked.values() for one in some])
    found = {}
    for case in cases:
        coarse_run, fine_run, half, check = own_runs = [trials[one] for one in asked[case.name]]
        for trial in own_runs:
            if not trial.ok:
                raise RuntimeError(f"a reference run of {case.name} failed: {trial.message}")
        pairs = ((coarse_run, fine_run), (half, coarse_run), (check, half))
        errors = [case.error(one.points, truth.points) for one, truth in pairs]
        space, in_time, disagreement = errors
        found[case.name] = Reference(fine_run, space, in_time, check.setting, disagreement)
    return found


def untimed(job: Job, setting: Setting, share: float) -> Trial:
    """An untimed run at a share of the method's own step, or for share 0 at the setting's step; for
    workers. A refused scene gives a trial with the message.
    """
    with contextlib.suppress(SceneError):  # the attempt is refused for the same reason
        setting = at_share(job, setting, share) if share else setting
    return attempt(job, setting, timed=False)


def _add_references(report: Report, cases: list[Case], truths: dict[str, Reference]) -> None:
    """Add the cases, the errors of their references, and the differences from another method."""
    report.section("Cases and references")
    report.text(
        """Error: rms over time of the worst axis at the material coordinates, in % of the case's
        scale. Reference: velocity_verlet on the finer of two meshes. Own error in space: its
        distance from the coarser mesh; in time: the effect of half the step there. Because the
        method is among those compared, one of another family is also run on the coarser mesh; its
        distance from velocity_verlet at half the step contains the time errors of both."""
    )
    compared, sure = [], []
    for case in cases:
        truth = truths[case.name]
        axes = "".join("xyz"[axis] for axis in case.components)
        at = ", ".join(f"{u:g}" for u in case.job.u)
        compared.append((case.name, case.job.duration, axes, at, case.scale_words, case.scale))
        own = (truth.run.setting.control_points, truth.run.step, truth.space, truth.time)
        check = (truth.check.method, truth.check.control_points, truth.check.step)
        sure.append((case.name, *own, *check, truth.disagreement))
    header = "case | duration [s] | axes | at [L] | scale | length of the scale [mm]"
    report.table("cases", header, compared, "Cases")
    report.table(
        "references",
        "case | n_u | step [us] | own error in space [%] | own error in time [%] | checked by | "
        "at n_u | with step [us] | distance [%]",
        sure,
        "References, their own errors, and their distance from another method",
    )


# All settings on all cases.


class Tried(NamedTuple):
    """A run of a case with a setting or by another simulator: a row of the diagram's data.

    Attributes:
        who: method, or simulator. stretch: evaluation of stretching; empty for other simulators.
        n_u: control points, or elements. step: [s]. status: `ok`, or why there is no result.
        words: the setting as text. error: relative to the case's scale; nan without a result.
        wall: least run time of the repeats [s per simulated s], nan for a failed run.
        spread: (median - least) / least.
        evaluations: of the force, or Newton iterations, per simulated second.
    """

    who: str
    stretch: str
    n_u: int
    step: float
    status: str
    words: str
    error: float = np.nan
    wall: float = np.nan
    spread: float = np.nan
    evaluations: float = np.nan
    energy_error: float = np.nan

    @property
    def ok(self) -> bool:
        """Whether there is a result."""
        return self.status == "ok"

    @property
    def line(self) -> str:
        """Label of its line in the diagram."""
        by_span = self.stretch.startswith("by span")
        return f"{self.who}, stretch {self.stretch}" if by_span else self.who


def swept(case: Case, truth: Reference, quick: bool) -> list[Tried]:
    """Run all settings on a case."""
    kinds = product(COMPARED[quick], CONTROL_POINTS[quick])
    settings = [one for kind in kinds for one in _settings(case, quick, *kind)]
    return [tried(case, truth, one, BUDGET[quick]) for one in settings]


def tried(case: Case, truth: Reference, setting: Setting, budget: float) -> Tried:
    """Run a setting on a case, with its error."""
    trial = attempt(case.job, setting, budget=budget)
    way = f"by {setting.stretch}" + ", knots auto" * (setting.knots == "auto")
    what = (setting.method, way, setting.control_points, trial.step, trial.status, setting.words)
    if not trial.ok:
        return Tried(*what)
    evaluations = trial.force_evaluations / (trial.steps * trial.step)
    times = (trial.wall, trial.spread, evaluations)
    return Tried(*what, case.error(trial.points, truth.points), *times, trial.energy_error)


def _settings(case: Case, quick: bool, method: str, n_u: int) -> list[Setting]:
    """The settings of a method and a resolution that are tried on a case."""
    family, first = METHODS[method].family, Setting(method, n_u)
    if family == IMPLICIT:
        ways = ways_to_resolve(case.scene, method)
        return [
            Setting(method, n_u, step, stretch=stretch, knots=knots, tolerance=tolerance)
            for stretch, knots in (ways if method in BY_SPAN else ways[:1])
            for step in STEPS[quick]
            for tolerance in ((None, LOOSE) if method == "energy_momentum" else (None,))
        ]
    try:
        found = [at_share(case.job, first, share) for share in SHARES[quick]]
    except SceneError:
        return [first]  # the attempt is refused for the same reason
    if method == "velocity_verlet" and n_u == CONTROL_POINTS[quick][0]:
        found.append(Setting(method, n_u, PAPER_STEP))
    return found


def fastest(runs: Sequence[Tried], level: float) -> Tried | None:
    """The fastest run with an error of at most `level`, relative to the scale."""
    good = [run for run in runs if run.ok and run.error <= level]
    return min(good, key=attrgetter("wall")) if good else None


def front(runs: Iterable[Tried], cost: str) -> list[Tried]:
    """Pareto front in error and cost (name of a field), by increasing cost."""
    found: list[Tried] = []
    for run in sorted((run for run in runs if run.ok), key=attrgetter(cost)):
        if not found or run.error < found[-1].error:
            found.append(run)
    return found


def _level_rows(case: Case, truth: Reference, runs: Sequence[Tried]) -> list[list[Any]]:
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


def _diagram(report: Report, case: Case, truth: Reference, runs: list[Tried]) -> None:
    """Add the diagram of a case: all runs as dots, the Pareto front of each method as a line,
    dashed with stretching by span, dotted with graded knots too.
    """
    report.section(case.title, 3)
    good = [run for run in runs if run.ok]
    names = list(dict.fromkeys(run.line for run in good))
    looks: dict[str, dict[str, Any]] = {
        name: {
            "color": COLORS.get(name.partition(",")[0], "black"),
            "linestyle": ("-", "--", ":")[name.count(",")],
        }
        for name in names
    }
    looks["own error of the reference"] = {"color": "0.5", "linestyle": ":", "marker": ""}
    figure, panels = new_figure(1, 2, width=15.0, height=5.4)
    for panel, (cost, label) in zip(panels, COSTS.items(), strict=True):

        def place(run: Tried, cost: str = cost) -> tuple[float, float]:
            return getattr(run, cost), 100 * run.error

        lines = {
            name: [place(run) for run in front((r for r in good if r.line == name), cost)]
            for name in names
        }
        costs = [getattr(run, cost) for run in good]
        own_error = 100 * truth.own_error
        lines["own error of the reference"] = [(min(costs), own_error), (max(costs), own_error)]
        for run in good:
            panel.plot(*place(run), ".", color=looks[run.line]["color"], alpha=0.3)
        draw(panel, lines, label, f"error [% of {case.scale_words}]", "xy", "", looks, marker="o")
    report.figure(
        f"work_precision_{case.name}",
        figure,
        f"{case.title}: error against run time and against force evaluations. Lines: Pareto front "
        f"of each method; dots: all runs; {len(runs) - len(good)} of {len(runs)} failed or refused",
        RUNS,
        runs,
    )


# The parts of the error; nothing is timed here.


def _add_space(
    report: Report, request: Request, cases: list[Case], truths: dict[str, Reference]
) -> None:
    """Add the error against the number of control points, with time resolved."""
    resolutions = RESOLUTIONS[request.quick]
    pieces = {
        (case, cable, n): (case.job, replace(CABLES[cable], control_points=n), 0.5)
        for case, cable, n in product(cases, CABLES, resolutions)
    }
    trials = each(request.workers, untimed, pieces.values())
    rows = [
        (case.name, cable, n, _off(case, trials[piece], truths[case.name].points))
        for (case, cable, n), piece in pieces.items()
    ]
    rows += [
        (case.name, "own error of the reference", n, truths[case.name].own_error)
        for case, n in product(cases, (resolutions[0], resolutions[-1]))
    ]
    report.chart(
        "space",
        "case | cable | n_u | error [%]",
        rows,
        f"Error against resolution at half the own step of {REFERENCE} (stretching at every "
        "sample, or by its mean over a span), as a share of the case's scale",
        "y",
        marker="o",
    )


def _add_time(report: Report, request: Request, cases: list[Case]) -> None:
    """Add the error against the step, at a fixed number of control points."""
    quick, pieces = request.quick, {}
    for case, method in product(cases, COMPARED[request.quick]):
        setting, implicit = Setting(method, FIXED[quick]), METHODS[method].family == IMPLICIT
        values = (TIME_STEPS if implicit else TIME_SHARES)[quick]
        pieces[case, method] = [
            (case.job, replace(setting, step=value), 0.0)
            if implicit
            else (case.job, setting, value)
            for value in (*values, FINEST * values[-1])  # the last one is the reference
        ]
    trials = each(request.workers, untimed, [one for some in pieces.values() for one in some])
    rows = []
    for (case, method), some in pieces.items():
        *tries, truth = (trials[one] for one in some)
        rows += order_rows(case, method, tries, truth)
    caption = (
        f"Error in time at n_u = {FIXED[quick]}: against the same method and resolution at "
        "a quarter of the smallest step"
    )
    note = "order from the step before; failed runs are left out"
    header = "case | method | step [ms] | error [%]"
    report.table("order_in_time", f"{header} | order", rows, f"{caption}; {note}")
    report.chart("time", header, [row[:4] for row in rows], caption, "xy", marker="o")


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
