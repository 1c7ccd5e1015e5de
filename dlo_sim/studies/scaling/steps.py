"""Time of a step against the number of control points, per method."""

from __future__ import annotations

import time
from collections.abc import Callable
from dataclasses import dataclass, field

import numpy as np

from dlo_sim.core.methods import IMPLICIT, METHODS
from dlo_sim.scene.description import Scene
from dlo_sim.scene.loading import SceneError
from dlo_sim.simulation.simulator import Simulator
from dlo_sim.studies import runs
from dlo_sim.studies.plotting import Panel, chart
from dlo_sim.studies.report import Cell, Column, Report, columns
from dlo_sim.studies.stopwatch import Cost

SCENE = "paper_wire"
SAMPLES_PER_SPAN = 3
IMPLICIT_STEP = 2e-3  # [s], the paper's
SPEED = 0.3  # [m/s] of mid-span, downwards, at the start
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
        step: [s]. steps: of a run; piece: of a timed piece of it.
        evaluations: of the force per step, of an implicit method iterations.
        times: of every run, of every piece, per step [s]. failure: why there are none, or empty.
    """

    method: str
    size: int
    simulator: Simulator | None = None
    failure: str = ""
    step: float = float("nan")
    steps: int = LEAST_STEPS
    piece: int = LEAST_STEPS
    evaluations: float = float("nan")
    times: list[list[float]] = field(default_factory=list)

    @property
    def cost(self) -> Cost:
        """Time per step [s], mean of the pieces, each the least and the median of the runs."""
        times = np.array(self.times or [[float("nan")]])
        return Cost(float(times.min(axis=0).mean()), float(np.median(times, axis=0).mean()))

    @property
    def per_evaluation(self) -> float:
        """Time [s] per force evaluation or iteration."""
        return self.cost.best / self.evaluations


def wire(control_points: int, method: str) -> Scene:
    """The wire with Gauss quadrature; explicit methods take the step chosen for them."""
    return runs.shipped(
        SCENE,
        discretization__control_points=control_points,
        discretization__quadrature="gauss",
        discretization__samples=SAMPLES_PER_SPAN,
        integrator__method=method,
        integrator__step=IMPLICIT_STEP if METHODS[method].family == IMPLICIT else 0.0,
    )


def moving(control_points: int, method: str) -> Simulator:
    """The straight wire, released with half a sine wave of downward velocity.

    Every method can start so, an inextensible one too, and each size has the same motion: a wire
    that starts at rest hardly moves in the short steps of a fine one, whose iterations would then
    have nothing to do.

    Raises:
        SceneError: the method cannot hold the wire at this size.
    """
    simulator = Simulator(wire(control_points, method))
    rates = np.zeros((control_points, 4))
    phase = np.pi * simulator.greville / simulator.scene.cable.length
    rates[1:-1, 2] = -SPEED * np.sin(phase[1:-1])
    simulator.start_from(simulator.control_points, rates)
    return simulator


def timed(quick: bool, progress: Callable[[float], None]) -> list[Run]:
    """Every method at every size, the sizes and methods in turn within each repeat."""
    found = [_prepared(method, size) for size in SIZES[quick] for method in METHODS_TIMED[quick]]
    for repeat in range(REPEATS[quick]):
        for run in found:
            if not run.failure:
                run.times.append(_run(run))
        progress((repeat + 1) / REPEATS[quick])
    for run in found:
        run.simulator = None
    return found


def _prepared(method: str, size: int) -> Run:
    """Build, find out how many steps are timed at once, and whether they go well."""
    run = Run(method, size)
    try:
        run.simulator = moving(size, method)
    except SceneError as refusal:
        run.failure = str(refusal)
        return run
    run.step = run.simulator.step
    implicit = METHODS[method].family == IMPLICIT
    if implicit:
        run.steps = run.piece = IMPLICIT_STEPS
    _run(run)
    (took,) = _run(run)
    if implicit:
        run.piece = next((k for k in IMPLICIT_PIECES if k * took >= PIECE), IMPLICIT_STEPS)
    else:
        run.steps = run.piece = LEAST_STEPS * max(1, round(PIECE / took / LEAST_STEPS))
    _run(run)
    return run


def _run(run: Run) -> list[float]:
    """Time [s] per step of every piece from the start; notes a failure and the evaluations."""
    assert run.simulator is not None
    run.simulator.reset()
    times, evaluations = [], 0
    for _ in range(run.steps // run.piece):
        began = time.perf_counter()
        report = run.simulator.advance_steps(run.piece)
        times.append((time.perf_counter() - began) / run.piece)
        evaluations += report.force_evaluations
        if not report.status.ok:
            run.failure = report.message
            break
    run.evaluations = evaluations / run.steps
    return times


def slope(sizes: list[int], values: list[float], least: int = 0) -> float:
    """Least-squares slope of log value over log size, sizes from `least` on; nan below two."""
    pairs = zip(sizes, values, strict=True)
    kept = [(size, value) for size, value in pairs if size >= least and np.isfinite(value)]
    if len(kept) < 2:
        return float("nan")
    x, y = np.log(np.array(kept, dtype=float)).T
    return float(np.polyfit(x, y, 1)[0])


def describe(report: Report, found: list[Run]) -> dict[str, str]:
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
    good = [run for run in found if not run.failure]
    report.table(
        "steps",
        [
            *("method | n_u | step [us] | time [us/step]", Column("spread", "%", ".0f")),
            "evaluations per step | time [us/evaluation] | time [ns/evaluation/sample]",
        ],
        [
            [
                *(run.method, run.size, run.step, run.cost.best, run.cost.spread),
                *(run.evaluations, run.per_evaluation),
                run.per_evaluation / (SAMPLES_PER_SPAN * (run.size - 3)),
            ]
            for run in good
        ],
        "Time of a step",
    )
    verdicts = _exponents(report, found)
    looks = {run.method: {"marker": "o"} for run in good}
    whole, step = "time of a step", "time of a step per control point"
    evaluation = "time of an evaluation per control point"
    chart(
        report,
        "time_of_a_step",
        columns(
            ("method", "n_u", "median", whole, step, evaluation),
            [
                (run.method, run.size, run.cost.median, run.cost.best, run.cost.best / run.size)
                + (run.per_evaluation / run.size,)
                for run in good
            ],
        ),
        [
            Panel("n_u", f"{name} [{unit}]", [name], by="method", log=log, looks=looks)
            for name, unit, log in ((whole, "us", "xy"), (step, "ns", "x"), (evaluation, "ns", "x"))
        ],
        "Time of a step, of a step per control point, and of an evaluation per control point",
        (16.0, 4.8),
    )
    failed = [run for run in found if run.failure]
    if failed:
        report.text("Runs that failed are neither in the tables nor in the fits:")
        report.items(f"`{run.method}`, n_u = {run.size}: {run.failure}" for run in failed)
    return verdicts


def _exponents(report: Report, found: list[Run]) -> dict[str, str]:
    """The fitted exponents of every method, over the sizes at which it ran."""
    rows: list[list[Cell]] = []
    verdicts = {}
    for method in dict.fromkeys(run.method for run in found):
        own = [run for run in found if run.method == method and not run.failure]
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
