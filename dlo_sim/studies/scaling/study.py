"""`dlo_sim study scaling`: time of a step against the number of control points, and memory."""

from __future__ import annotations

import gc
import os
import sys
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field, replace
from itertools import product
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from dlo_sim.core.methods import IMPLICIT, METHODS
from dlo_sim.scene.loading import SceneError, shipped_scene
from dlo_sim.simulation.simulator import Simulator
from dlo_sim.studies.catalogue import Outcome, Request
from dlo_sim.studies.plotting import Panel, chart
from dlo_sim.studies.report import Cell, Report, columns
from dlo_sim.studies.runs import Cost, advance, shipped, timed

SCENE = "paper_wire"
SAMPLES_PER_SPAN = 3
IMPLICIT_STEP = 2e-3  # [s], the paper's
SPEED = 0.3  # [m/s] of mid-span, downwards, at the start
SIZE = 9  # control points of the runs whose memory is measured
WATCHED = {
    True: {"forest_ruth": 1_000_000, "energy_momentum": 100_000},
    False: {"forest_ruth": 10_000_000, "energy_momentum": 2_000_000},
}
LOOKS = 100
WARM = 10  # samples of the warm-up
CALLS = 2000
ROUNDS, WARM_ROUNDS = 7, 5
Counts = NDArray[np.int64]
Grown = tuple[str, Counts, Counts, int]  # method, steps and memory [B] of the samples, blocks left
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
LEAST_STEPS = 64  # of an explicit piece: a multiple of the steps between two energy checks
IMPLICIT_STEPS = 100  # 0.2 s, the same motion at every size, timed in pieces of this length:
IMPLICIT_PIECES = (1, 2, 5, 10, 20, 50, 100)


@dataclass
class Run:
    """One method at one size: steps of a run and of a timed piece of it, force evaluations per step
    (iterations for implicit methods), time per step [s] of every piece of every run, and a failure.
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
        """Time per step [s]: least and median over the runs of each piece, averaged over pieces."""
        times = np.array(self.times)
        return Cost(float(times.min(axis=0).mean()), float(np.median(times, axis=0).mean()))

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
        """The scene is `paper_wire` with Gauss quadrature, three points per span, initially
        straight, with half a sine wave of 0.3 m/s as downward velocity. Everything ran on this
        machine in one process, whatever `--scheduler` is."""
    )
    # Memory first: memory freed by the timed simulators would distort it.
    grown = watch(request.quick, request.part(0.0, 0.3))
    found, failed = measured(request.quick, request.part(0.3, 1.0))
    verdicts = describe(report, found, failed) | describe_memory(report, grown)
    return report.outcome(verdicts)


def measured(quick: bool, progress: Callable[[float], None]) -> tuple[list[Run], list[str]]:
    """Time every method at every size, in turn within each repeat; also messages of those that were
    refused or failed.
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
    """Build the simulator, choose the number of steps timed at once, and check for failures."""
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


def slope(sizes: Sequence[int], values: Sequence[float], least: int = 0) -> float:
    """Least-squares slope of log value over log size, sizes from `least` on; nan below two."""
    pairs = zip(sizes, values, strict=True)
    kept = [(size, value) for size, value in pairs if size >= least and np.isfinite(value)]
    if len(kept) < 2:
        return float("nan")
    x, y = np.log(np.array(kept, dtype=float)).T
    return float(np.polyfit(x, y, 1)[0])


def describe(report: Report, found: list[Run], failed: list[str]) -> dict[str, str]:
    """Add section, tables and figure; returns the verdicts."""
    report.section("Time of a step against the number of control points")
    report.text(
        """Compiled, stepping only, in pieces of some milliseconds: least of the repeats, with sizes
        and methods in turn within each, and the spread (median over least, minus one). Implicit
        methods take 100 steps of 2 ms, so that every size covers the same 0.2 s of motion; the
        others use their automatic step. An evaluation is one of the force, for implicit methods an
        iteration of Newton's method, for `rattle` a step. Vector lanes process eight spans at a
        time, and an incomplete block costs as much as a full one."""
    )
    rows, data = [], []
    for run in found:
        cost = run.cost
        each = cost.best / run.evaluations
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
    verdicts = _exponents(report, rows)
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
        report.text("Runs that failed are neither in the tables nor in the fits:", *failed)
    return verdicts


def _exponents(report: Report, timed_rows: list[tuple[Any, ...]]) -> dict[str, str]:
    """Add the table of fitted exponents of every method, over the sizes at which it ran."""
    rows: list[list[Cell]] = []
    verdicts = {}
    for method in dict.fromkeys(row[0] for row in timed_rows):
        own = [row for row in timed_rows if row[0] == method]
        _, sizes, _, steps, _, _, evaluations, _ = zip(*own, strict=True)
        fits = [slope(sizes, y, least) for y in (steps, evaluations) for least in (0, FINE)]
        rows.append([method, max(sizes), *fits])
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


def moving(control_points: int, method: str) -> Simulator:
    """The straight wire with half a sine wave of downward velocity.

    This initial state is valid for every method, including inextensible ones, and needs iterations
    even in the short steps of a fine wire. Explicit methods use their automatic step.

    Raises:
        SceneError: the method does not support the wire at this size.
    """
    wire = shipped(
        SCENE,
        discretization__control_points=control_points,
        discretization__quadrature="gauss",
        discretization__samples=SAMPLES_PER_SPAN,
        integrator__method=method,
        integrator__step=IMPLICIT_STEP if METHODS[method].family == IMPLICIT else 0.0,
    )
    simulator = Simulator(wire)
    rates = np.zeros((control_points, 4))
    phase = np.pi * simulator.greville / simulator.scene.cable.length
    rates[1:-1, 2] = -SPEED * np.sin(phase[1:-1])
    simulator.start_from(simulator.control_points, rates)
    return simulator


def resident_bytes() -> int:
    """Resident memory of this process [B], in whole pages (Linux).

    Raises:
        OSError: the system has no /proc.
    """
    pages = Path("/proc/self/statm").read_text(encoding="ascii").split()[1]
    return int(pages) * os.sysconf("SC_PAGE_SIZE")


def watched(simulator: Simulator, steps: int, looks: int = LOOKS) -> tuple[Counts, Counts]:
    """Resident memory [B] before the first step and at `looks` times of a run: (steps, bytes)."""
    piece, resident = steps // looks, np.zeros(looks + 1, dtype=np.int64)
    for _ in range(500):  # the first hundred readings themselves allocate a few pages
        resident[0] = resident_bytes()
    for look in range(1, looks + 1):
        advance(simulator, piece)
        resident[look] = resident_bytes()
    return piece * np.arange(looks + 1), resident


def blocks_left(simulator: Simulator, calls: int, steps: int = 1) -> int:
    """Allocated blocks of Python that `calls` calls of `advance_steps` leave: the median of a few
    rounds, because a progress bar or a late release changes the count in some. The first rounds, in
    which the interpreter fills its free lists, do not count.
    """
    counts = np.zeros(WARM_ROUNDS + ROUNDS, dtype=np.int64)  # holds no Python objects
    for k in range(len(counts)):
        for _ in range(calls):
            advance(simulator, steps)
        gc.collect()
        counts[k] = sys.getallocatedblocks()
    return int(np.median(np.diff(counts[WARM_ROUNDS - 1 :])))


def watch(quick: bool, progress: Callable[[float], None]) -> list[Grown]:
    """Measure the memory of one run of each method."""
    found = []
    for k, (method, steps) in enumerate(WATCHED[quick].items()):
        simulator = moving(SIZE, method)
        seen = watched(simulator, steps)
        found.append((method, *seen, blocks_left(simulator, CALLS)))
        progress((k + 1) / len(WATCHED[quick]))
    return found


def describe_memory(report: Report, found: list[Grown]) -> dict[str, str]:
    """Add section, table and figure; returns the verdicts."""
    report.section("Memory over many steps")
    report.text(
        """Resident memory of the process (9 control points), sampled a hundred times in a run; the
        first ten samples are the warm-up. Its resolution is a page, and it includes the pages of
        the interpreter. Separately, the blocks of Python's allocator that remain after two thousand
        calls of one step each. A call allocates its report and one test for finite numbers, which
        are released."""
    )
    rows, curves, verdicts, looks = [], [], {}, {}
    for k, (method, steps, resident, blocks) in enumerate(found):
        beyond, last = (resident - resident[WARM]).tolist(), int(steps[-1])
        grown = beyond[-1]
        rows.append([method, last, int(resident[WARM]), grown, max(beyond[WARM:]), blocks])
        curves += [
            (method, done / last, more / 1024.0) for done, more in zip(steps, beyond, strict=True)
        ]
        looks[method] = {"linewidth": 4.0 / (k + 1)}  # equal lines stay visible below each other
        verdicts[f"memory, {method}"] = (
            f"{grown} bytes more after {last:.3g} steps than after {steps[WARM]:.3g}; {CALLS} "
            f"calls leave {blocks} blocks"
        )
    report.table(
        "memory",
        "method | steps | resident after warm-up [KB] | growth after it [B] | most above it [B] | "
        "blocks left by calls",
        rows,
        "Memory: growth over a run, and blocks left by calls",
    )
    share, change = "share of the run's steps", "change [KiB]"
    panel = Panel(share, f"resident memory, {change}", [change], by="method", looks=looks)
    page, warm = {"one page": os.sysconf("SC_PAGE_SIZE") / 1024.0}, {"end of warm-up": WARM / LOOKS}
    panel = replace(panel, levels=page, uprights=warm)
    data = columns(("method", share, change), curves)
    caption = "Change of resident memory after the warm-up"
    chart(report, "resident_memory", data, [panel], caption, (8.5, 3.8))
    return verdicts
