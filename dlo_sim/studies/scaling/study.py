"""`dlo_sim study scaling`: time of a step against the number of control points, and memory."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field
from itertools import product

import numpy as np

from dlo_sim.core.methods import IMPLICIT, METHODS
from dlo_sim.scene.loading import SceneError, shipped_scene
from dlo_sim.simulation.simulator import Simulator
from dlo_sim.studies.catalogue import Outcome, Request
from dlo_sim.studies.plotting import Panel, chart
from dlo_sim.studies.report import Cell, Report, columns
from dlo_sim.studies.runs import Cost, timed
from dlo_sim.studies.scaling import memory
from dlo_sim.studies.scaling.memory import SAMPLES_PER_SPAN, SCENE, moving

METHODS_TIMED = {
    True: ("forest_ruth", "rattle", "energy_momentum"),
    False: (
        *("forest_ruth", "velocity_verlet", "rattle"),
        *("energy_momentum", "energy_momentum_4", "implicit_midpoint", "generalized_alpha"),
    ),
}
SIZES = {True: (9, 40, 100, 400), False: (9, 13, 19, 40, 80, 200, 500, 1000, 2000)}
REPEATS = {True: 7, False: 25}
FINE = 100  # control points from which the second exponent is fitted
PIECE = 0.004  # [s] of steps timed at once
LEAST_STEPS = 64  # of an explicit piece: a multiple of the steps between two looks at the energy
IMPLICIT_STEPS = 100  # the same motion at every size, 0.2 s, timed in pieces of so many steps:
IMPLICIT_PIECES = (1, 2, 5, 10, 20, 50, 100)


@dataclass
class Run:
    """One method at one size.

    Attributes:
        steps: of a run; piece: of a timed piece of it.
        evaluations: of the force per step, of an implicit method iterations.
        times: of every run, of every piece, per step [s]. failure: why there are none, or empty.
    """

    method: str
    size: int
    simulator: Simulator
    steps: int = LEAST_STEPS
    piece: int = LEAST_STEPS
    evaluations: float = float("nan")
    times: list[list[float]] = field(default_factory=list)
    failure: str = ""

    @property
    def cost(self) -> Cost:
        """Time per step [s], mean of the pieces, each the least and the median of the runs."""
        times = np.array(self.times)
        return Cost(float(times.min(axis=0).mean()), float(np.median(times, axis=0).mean()))

    @property
    def per_evaluation(self) -> float:
        """Time [s] per force evaluation or iteration."""
        return self.cost.best / self.evaluations

    def go(self) -> None:
        """Run and time every piece from the start; note a failure and the evaluations."""
        self.simulator.reset()
        times, evaluations = [], 0
        for _ in range(self.steps // self.piece):
            took, report = timed(self.simulator, self.piece)
            times.append(took / self.piece)
            evaluations += report.force_evaluations
            self.failure = self.failure or report.message
        self.evaluations = evaluations / self.steps
        self.times.append(times)


def run_study(request: Request) -> Outcome:
    """Run the study into a folder."""
    title, files = "Cost and memory as the cable gets finer", {SCENE: shipped_scene(SCENE)}
    report = Report(request.folder, title, request.command, files)
    report.text(
        """The scene is `paper_wire` with Gauss quadrature, three points per span, straight at first
        and moving downwards with half a sine wave of 0.3 m/s. Everything here is a time or a memory
        of this machine, so all of it ran here, in one process: `--scheduler` has nothing to give
        away."""
    )
    # Memory first: what the timed simulators leave to the allocator would blur it.
    grown = memory.measured(request.quick, request.part(0.0, 0.3))
    found, failed = measured(request.quick, request.part(0.3, 1.0))
    verdicts = describe(report, found, failed) | memory.describe(report, grown)
    return report.outcome(verdicts)


def measured(quick: bool, progress: Callable[[float], None]) -> tuple[list[Run], list[str]]:
    """Every method at every size, the sizes and methods in turn within each repeat; and lines about
    those that were refused or failed.
    """
    found, failed = [], []
    for size, method in product(SIZES[quick], METHODS_TIMED[quick]):
        try:
            found.append(_prepared(method, size))
        except SceneError as refusal:
            failed.append(f"`{method}`, n_u = {size}: {refusal}")
    for repeat in range(REPEATS[quick]):
        for run in found:
            if not run.failure:
                run.go()
        progress((repeat + 1) / REPEATS[quick])
    failed += [f"`{run.method}`, n_u = {run.size}: {run.failure}" for run in found if run.failure]
    return [run for run in found if not run.failure], failed


def _prepared(method: str, size: int) -> Run:
    """Build, find out how many steps are timed at once, and whether they go well."""
    run = Run(method, size, moving(size, method))
    implicit = METHODS[method].family == IMPLICIT
    if implicit:
        run.steps = run.piece = IMPLICIT_STEPS
    run.go()
    run.go()
    _, (took,) = run.times
    if implicit:
        run.piece = next((k for k in IMPLICIT_PIECES if k * took >= PIECE), IMPLICIT_STEPS)
    else:
        run.steps = run.piece = LEAST_STEPS * max(1, round(PIECE / took / LEAST_STEPS))
    run.go()
    run.times.clear()
    return run


def slope(sizes: list[int], values: list[float], least: int = 0) -> float:
    """Least-squares slope of log value over log size, sizes from `least` on; nan below two."""
    pairs = zip(sizes, values, strict=True)
    kept = [(size, value) for size, value in pairs if size >= least and np.isfinite(value)]
    if len(kept) < 2:
        return float("nan")
    x, y = np.log(np.array(kept, dtype=float)).T
    return float(np.polyfit(x, y, 1)[0])


def describe(report: Report, found: list[Run], failed: list[str]) -> dict[str, str]:
    """Section, tables and figure; returns the verdicts."""
    report.section("Time of a step against the number of control points")
    report.text(
        """Compiled and warm, stepping only: the least of the repeats, sizes and methods in turn
        within each, and the spread (median over least, minus one). Steps are timed in pieces of
        some milliseconds, which run undisturbed now and then. Implicit methods make 100 steps of 2
        ms, so that every size goes through the same 0.2 s of motion; the others take the step that
        is chosen for them. An evaluation is one of the force, of an implicit method an iteration of
        Newton's method, of `rattle` its step. Spans go through the vector lanes by eights, and a
        block that is not full costs what a full one costs."""
    )
    rows, data = [], []
    for run in found:
        cost, each = run.cost, run.per_evaluation
        names = (run.method, run.size)
        per_sample = each / (SAMPLES_PER_SPAN * (run.size - 3))
        times = (run.simulator.step, cost.best, cost.spread)
        rows.append((*names, *times, run.evaluations, each, per_sample))
        data.append((*names, cost.median, cost.best, cost.best / run.size, each / run.size))
    report.table(
        "steps",
        "method | n_u | step [us] | time [us/step] | spread [%] {:.0f} | evaluations per step | "
        "time [us/evaluation] | time [ns/evaluation/sample]",
        rows,
        "Time of a step",
    )
    verdicts = _exponents(report, found)
    whole, step = "time of a step", "time of a step per control point"
    evaluation = "time of an evaluation per control point"
    panels = [
        Panel("n_u", f"{name} [{unit}]", [name], by="method", log=log, marker="o")
        for name, unit, log in ((whole, "us", "xy"), (step, "ns", "x"), (evaluation, "ns", "x"))
    ]
    header = ("method", "n_u", "median", whole, step, evaluation)
    caption = "Time of a step, of a step per control point, and of an evaluation per control point"
    chart(report, "time_of_a_step", columns(header, data), panels, caption, (16.0, 4.8))
    if failed:
        report.text("Runs that failed are neither in the tables nor in the fits:")
        report.items(failed)
    return verdicts


def _exponents(report: Report, found: list[Run]) -> dict[str, str]:
    """The fitted exponents of every method, over the sizes at which it ran."""
    rows: list[list[Cell]] = []
    verdicts = {}
    for method in dict.fromkeys(run.method for run in found):
        own = [run for run in found if run.method == method]
        sizes = [run.size for run in own]
        fits = [
            slope(sizes, values, least)
            for values in ([run.cost.best for run in own], [run.per_evaluation for run in own])
            for least in (0, FINE)
        ]
        rows.append([method, max(sizes, default=0), *fits])
        verdicts[f"time of a step, {method}"] = (
            f"exponent {fits[0]:.2f}, from {FINE} control points on {fits[1]:.2f}"
        )
    report.table(
        "exponents",
        f"method | largest n_u that ran | step, all sizes | step, n_u >= {FINE} | "
        f"evaluation, all sizes | evaluation, n_u >= {FINE}",
        rows,
        "Exponent p of time ~ n_u^p, least squares in the logarithms (1 is linear)",
    )
    return verdicts
