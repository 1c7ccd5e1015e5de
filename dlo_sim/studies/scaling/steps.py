"""Time of a step against the number of control points, per method."""

from __future__ import annotations

import time
from collections.abc import Callable
from dataclasses import dataclass, field

import numpy as np
from matplotlib.axes import Axes
from matplotlib.ticker import ScalarFormatter

from dlo_sim.core.methods import CONSTRAINED, IMPLICIT, METHODS
from dlo_sim.scene.loading import SceneError
from dlo_sim.simulation import workspace
from dlo_sim.simulation.inextensible import new_chain
from dlo_sim.simulation.model import Model
from dlo_sim.simulation.simulator import Simulator
from dlo_sim.studies import plotting
from dlo_sim.studies.report import Cell, Report
from dlo_sim.studies.scaling.wire import moving
from dlo_sim.studies.stopwatch import Cost

METHODS_TIMED = (
    *("forest_ruth", "velocity_verlet", "rattle"),
    *("energy_momentum", "energy_momentum_4", "implicit_midpoint", "generalized_alpha"),
)
SIZES = {True: (9, 40, 100, 400, 2000), False: (9, 13, 19, 40, 80, 200, 500, 1000, 2000)}
REPEATS = {True: 7, False: 25}
FINE = 100  # control points from which the second exponent is fitted
PIECE = 0.004  # [s] of explicit steps timed at once
LEAST_STEPS = 64  # of a piece: a multiple of the steps between two looks at the energy
IMPLICIT_STEPS = 100  # the same motion at every size, 0.2 s, timed in pieces of so many steps:
IMPLICIT_PIECES = (1, 2, 5, 10, 20, 50, 100)


@dataclass
class Run:
    """One method at one size.

    Attributes:
        step: [s]. steps: of a run; piece: of a timed piece of it. iterations: per step, 0 for an
            explicit method, whose step has a fixed number of force evaluations.
        memory: bytes [B] of the arrays of a step.
        times: of every run, of every piece, per step [s]. failure: why there are none, or empty.
    """

    method: str
    size: int
    simulator: Simulator | None = None
    failure: str = ""
    step: float = float("nan")
    steps: int = 0
    piece: int = 0
    iterations: float = 0.0
    memory: int = 0
    times: list[list[float]] = field(default_factory=list)

    @property
    def cost(self) -> Cost:
        """Time per step [s], mean of the pieces, each the least and the median of the runs; nan if
        it failed."""
        times = np.array(self.times or [[float("nan")]])
        return Cost(float(times.min(axis=0).mean()), float(np.median(times, axis=0).mean()))

    @property
    def per_iteration(self) -> float:
        """Time [s] per iteration of an implicit method, nan for an explicit one."""
        return self.cost.best / self.iterations if self.iterations else float("nan")


@dataclass(frozen=True)
class Exponents:
    """Slopes of log time over log n_u: of a step over all sizes and over the fine ones, and of an
    iteration likewise; nan with fewer than two sizes."""

    everywhere: float
    fine: float
    iteration_everywhere: float
    iteration_fine: float


def timed(quick: bool, progress: Callable[[float], None]) -> list[Run]:
    """Every method at every size, the sizes and methods in turn within each repeat."""
    runs = [_prepared(method, size) for size in SIZES[quick] for method in METHODS_TIMED]
    repeats = REPEATS[quick]
    for repeat in range(repeats):
        for run in runs:
            if not run.failure:
                run.times.append(_run(run))
        progress((repeat + 1) / repeats)
    for run in runs:
        run.simulator = None
    return runs


def _prepared(method: str, size: int) -> Run:
    """Build, find out how many steps are timed at once, and whether they go well."""
    run = Run(method, size)
    try:
        simulator = moving(size, method)
    except SceneError as refusal:
        run.failure = str(refusal)
        return run
    run.simulator, run.step = simulator, simulator.step
    run.memory = array_bytes(simulator.model, method)
    implicit = METHODS[method].family == IMPLICIT
    run.steps = run.piece = IMPLICIT_STEPS if implicit else LEAST_STEPS
    _run(run)
    (took,) = _run(run)
    if implicit:
        run.piece = next((k for k in IMPLICIT_PIECES if k * took >= PIECE), IMPLICIT_STEPS)
    else:
        run.steps = run.piece = LEAST_STEPS * max(1, round(PIECE / took / LEAST_STEPS))
    _run(run)
    return run


def _run(run: Run) -> list[float]:
    """Time [s] per step of every piece from the start; notes a failure and the iterations."""
    assert run.simulator is not None
    run.simulator.reset()
    times = []
    evaluations = 0
    for _ in range(run.steps // run.piece):
        began = time.perf_counter()
        report = run.simulator.advance_steps(run.piece)
        times.append((time.perf_counter() - began) / run.piece)
        evaluations += report.force_evaluations
        if not report.status.ok:
            run.failure = report.message
            break
    if METHODS[run.method].family == IMPLICIT:
        run.iterations = evaluations / run.steps
    return times


def array_bytes(model: Model, method: str) -> int:
    """Size [B] of all arrays that a step of this method may touch."""
    groups: list[object] = [model.terms, workspace.new_state(model), workspace.new_work(model)]
    if METHODS[method].family == IMPLICIT:
        groups.append(workspace.new_solver(model))
    elif METHODS[method].family == CONSTRAINED:
        groups.append(new_chain(model))
    return sum(_bytes(group) for group in groups)


def _bytes(group: object) -> int:
    if isinstance(group, np.ndarray):
        return group.nbytes
    return sum(_bytes(one) for one in group) if isinstance(group, tuple) else 0


def slope(sizes: list[int], values: list[float], least: int = 0) -> float:
    """Least-squares slope of log value over log size, sizes from `least` on; nan below two."""
    kept = [
        (size, value)
        for size, value in zip(sizes, values, strict=True)
        if size >= least and np.isfinite(value)
    ]
    if len(kept) < 2:
        return float("nan")
    x, y = np.log(np.array(kept, dtype=float)).T
    return float(np.polyfit(x, y, 1)[0])


def exponents(runs: list[Run], method: str) -> Exponents:
    """The fitted exponents of one method, over the sizes at which it ran."""
    own = [run for run in runs if run.method == method and not run.failure]
    sizes = [run.size for run in own]
    steps = [run.cost.best for run in own]
    iterations = [run.per_iteration for run in own]
    return Exponents(
        slope(sizes, steps),
        slope(sizes, steps, FINE),
        slope(sizes, iterations),
        slope(sizes, iterations, FINE),
    )


def describe(report: Report, runs: list[Run], quick: bool) -> dict[str, str]:
    """Section, tables and figure; returns the verdicts."""
    sizes = SIZES[quick]
    report.section("Time of a step against the number of control points")
    report.text(
        f"""Compiled and warm, stepping only: the least of {REPEATS[quick]} repeats, sizes and
        methods in turn within each, and the spread (median over least, minus one). Steps are timed
        in pieces of about {1e3 * PIECE:g} ms, or {LEAST_STEPS} explicit steps if that is more,
        which run undisturbed now and then. Implicit methods make {IMPLICIT_STEPS} steps of 2 ms, so
        that every size goes through the same 0.2 s of motion: each piece of it has its own least
        time. The others take the step that is chosen for them. An explicit step has a fixed number
        of force evaluations; what an implicit step costs depends on its iterations, which depend on
        the motion, so the time of an iteration is given as well. `rattle` does not report the
        iterations of its constraints. *Arrays* is all that a step may touch: where it outgrows a
        cache, time per control point rises. Spans go through the vector lanes by eights, and a
        block that is not full costs what a full one costs: 13 control points have ten spans and
        take as long for their forces as 19 with sixteen."""
    )
    header = ["method", "n_u", "step [s]", "time [us/step]", "spread", "iterations per step"]
    header += ["time [us/iteration]", "time [ns/step/control point]", "arrays [KB]", "note"]
    report.table("steps", header, [_cells(run) for run in runs], "Time of a step")
    verdicts = _exponent_table(report, runs, sizes)
    _figure(report, runs, sizes)
    failed = [run for run in runs if run.failure]
    if failed:
        report.text("Runs that failed are not in the fits:")
        report.items(f"`{run.method}`, n_u = {run.size}: {run.failure}" for run in failed)
    return verdicts


def _finite(value: float) -> Cell:
    return value if np.isfinite(value) else None


def _cells(run: Run) -> list[Cell]:
    best = run.cost.best
    return [
        run.method,
        run.size,
        _finite(run.step),
        _finite(1e6 * best) if not run.failure else None,
        f"{100 * run.cost.spread:.0f} %" if not run.failure else None,
        run.iterations or None,
        _finite(1e6 * run.per_iteration),
        _finite(1e9 * best / run.size) if not run.failure else None,
        1e-3 * run.memory or None,
        "failed, see below" if run.failure else "",
    ]


def _exponent_table(report: Report, runs: list[Run], sizes: tuple[int, ...]) -> dict[str, str]:
    rows: list[list[Cell]] = []
    verdicts = {}
    for method in METHODS_TIMED:
        found = exponents(runs, method)
        good = [run.size for run in runs if run.method == method and not run.failure]
        values = [found.everywhere, found.fine, found.iteration_everywhere, found.iteration_fine]
        largest = max(good, default=0)
        rows.append([method, largest, *(_finite(value) for value in values)])
        words = f"exponent {found.everywhere:.2f} over {sizes[0]} to {largest} control points"
        if np.isfinite(found.fine):
            words += f", {found.fine:.2f} from {FINE} on"
        if np.isfinite(found.iteration_fine):
            words += f"; an iteration {found.iteration_fine:.2f}"
        verdicts[f"time of a step, {method}"] = words
    report.table(
        "exponents",
        [
            *("method", "largest n_u that ran", "step, all sizes", f"step, n_u >= {FINE}"),
            *("iteration, all sizes", f"iteration, n_u >= {FINE}"),
        ],
        rows,
        "Exponent p of time ~ n_u^p, least squares in the logarithms (1 is linear)",
    )
    return verdicts


def _figure(report: Report, runs: list[Run], sizes: tuple[int, ...]) -> None:
    figure, (whole, each, iteration) = plotting.new_figure(1, 3, width=15.0, height=4.6)
    good = [run for run in runs if not run.failure]
    for method in METHODS_TIMED:
        own = [run for run in good if run.method == method]
        _line(whole, method, own, [1e6 * run.cost.best for run in own])
        _line(each, method, own, [1e9 * run.cost.best / run.size for run in own])
        if METHODS[method].family == IMPLICIT:
            _line(iteration, method, own, [1e9 * run.per_iteration / run.size for run in own])
    ends = np.array([sizes[0], sizes[-1]], dtype=float)
    lowest = min(run.cost.best / run.size for run in good)
    whole.plot(ends, 0.6e6 * lowest * ends, "k--", linewidth=0.8, label="linear")
    whole.set(yscale="log", ylabel="time of a step [us]")
    each.set(yscale="log", ylabel="time of a step per control point [ns]")
    iteration.set(ylabel="time of an iteration per control point [ns]")
    iteration.set_ylim(0.0, 1.08 * iteration.get_ylim()[1])
    for axes in (whole, each, iteration):
        axes.set(xscale="log", xlabel="control points n_u [-]")
        axes.xaxis.set_major_formatter(ScalarFormatter())
        axes.grid(alpha=0.3, which="both")
    each.set_yticks([20, 50, 100, 200, 500, 1000])
    each.yaxis.set_major_formatter(ScalarFormatter())
    each.yaxis.set_minor_formatter("")
    whole.legend(fontsize="small")
    iteration.legend(fontsize="small", loc="lower right")
    report.figure(
        "time_of_a_step",
        figure,
        {
            "method": np.array([run.method for run in good]),
            "n_u": [run.size for run in good],
            "time [s/step]": [run.cost.best for run in good],
            "median [s/step]": [run.cost.median for run in good],
            "iterations per step": [run.iterations for run in good],
        },
        "Time against the number of control points: of a step, of a step per control point, and of "
        "an iteration per control point",
    )


def _line(axes: Axes, method: str, runs: list[Run], values: list[float]) -> None:
    sizes = [run.size for run in runs]
    axes.plot(sizes, values, "o-", markersize=4, color=plotting.COLORS.get(method), label=method)
