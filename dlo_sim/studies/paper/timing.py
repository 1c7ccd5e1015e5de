"""Tables 1 to 4: run time against simulated time, interpreted and compiled, beside the paper's."""

from __future__ import annotations

import time
from dataclasses import dataclass

import numpy as np

from dlo_sim.core.methods import METHODS
from dlo_sim.scene.description import Scene
from dlo_sim.simulation.simulator import Simulator
from dlo_sim.studies import plotting
from dlo_sim.studies.interpreted import Wire
from dlo_sim.studies.paper import published
from dlo_sim.studies.paper.runs import (
    COMPARED,
    SCENARIOS,
    Array,
    Settings,
    at_method,
    scenario,
    softened,
)
from dlo_sim.studies.report import Cell, Report
from dlo_sim.studies.stopwatch import Cost, least, step_cost

LOOP, ARRAYS = "sample by sample", "whole arrays"
PAPER_NAMES = {"forest_ruth": "symplectic", "rk4": "Runge-Kutta", "zhai": "Zhai"}
QUICK_MARK = 0.5  # [s] up to which a quick study measures; later rows are extrapolated


@dataclass(frozen=True)
class MethodTiming:
    """Run time of one method in one scenario.

    Attributes:
        step: [s], 0.9 of the stability limit. cost: of one compiled step.
        wall: compiled run time [s] at `published.TIMES`; the first `measured` rows were run, the
            others are proportional to the last of them.
        at_paper_step: compiled run time [s] of 10 s at the paper's 2 ms of the softened wire.
        interpreted: cost of one step in numpy, by way of writing the force.
        deviation: largest distance [m] between the interpreted and the compiled run, after
            `compared` steps.
    """

    step: float
    cost: Cost
    wall: Array
    measured: int
    at_paper_step: float
    interpreted: dict[str, Cost]
    deviation: float
    compared: int

    def interpreted_run(self, way: str) -> Array:
        """Interpreted run time [s] at `published.TIMES`, cost per step times steps."""
        return np.asarray(self.interpreted[way].best * published.TIMES / self.step)


Timings = dict[int, dict[str, MethodTiming]]


def add(report: Report, settings: Settings, factor: float) -> Timings:
    """Measure all methods in both scenarios; Tables 1 to 4 and what they say.

    Args:
        factor: by which axial stiffness and springs fall in the rows at the paper's step.
    """
    timings = {
        number: {
            method: _measure(scenario(number), method, settings, factor) for method in COMPARED
        }
        for number in SCENARIOS
    }
    report.section("Run time against simulated time (Tables 1 to 4)")
    report.text(
        """Every method runs at 0.9 of its own stability limit for the real wire, because the
        paper's 2 ms is not stable for any of them (see below). Interpreted numpy stands for
        MATLAB, in two ways of writing: *sample by sample*, a loop over the quadrature points with a
        linear solve per force evaluation as the paper describes it, and *whole arrays*, one numpy
        call per operation. Compiled kernels stand for C++. Interpreted run times are the measured
        cost of a step times the number of steps; compiled ones were run.""",
        f"""**The paper's columns are for its step of 2 ms,
        {published.STEP / timings[1]["forest_ruth"].step:.0f} times as long as ours with
        Forest-Ruth:** compare them by the cost of a step, in the table after the four, or by the
        last row of each table. That row is at the paper's own step, which needs constants that the
        paper does not have: axial stiffness and end springs divided by {factor:.0f} (why, in the
        next section).""",
    )
    if settings.quick:
        report.text(
            f"Quick study: rows beyond {QUICK_MARK:g} s are extrapolated from the row at "
            f"{QUICK_MARK:g} s."
        )
    mark = f"**10, at 2 ms; EA and springs CHANGED: / {factor:.0f}**"
    for number, table in ((1, 1), (2, 2)):
        _interpreted_table(report, timings[number], number, table, mark)
    for number, table in ((1, 3), (2, 4)):
        _compiled_table(report, timings[number], number, table, mark)
    _cost_table(report, timings)
    _figure(report, timings)
    return timings


def _measure(wire: Scene, method: str, settings: Settings, factor: float) -> MethodTiming:
    scene = at_method(wire, method)
    simulator = Simulator(scene)
    cost = step_cost(simulator)
    simulator.reset()
    wall, total = [], 0.0
    last = QUICK_MARK if settings.quick else published.TIMES[-1]
    for mark in published.TIMES[published.TIMES <= last]:
        began = time.perf_counter()
        report = simulator.advance(float(mark) - simulator.time)
        total += time.perf_counter() - began
        if not report.status.ok:
            raise RuntimeError(f"a timed run failed: {report.message}")
        wall.append(total)
    rest = published.TIMES[len(wall) :] * (wall[-1] / published.TIMES[len(wall) - 1])
    tau, steps = simulator.step, 20
    simulator.reset()
    simulator.advance_steps(steps)
    interpreted, deviation = {}, 0.0
    for way in (LOOP, ARRAYS):
        twin = Wire(scene, way == LOOP)
        reached = twin.run(method, tau, steps if way == ARRAYS else 3)
        if way == ARRAYS:
            gap = reached.position - simulator.control_points[:, :3]
            deviation = float(np.abs(gap).max())
        state = twin.start()
        repeats = (3 if settings.quick else 10) if way == LOOP else 100
        interpreted[way] = least(lambda: twin.step(state, method, 0.0, tau), repeats)  # noqa: B023
    return MethodTiming(
        step=tau,
        cost=cost,
        wall=np.concatenate((wall, rest)),
        measured=len(wall),
        at_paper_step=_at_paper_step(softened(wire, factor), method),
        interpreted=interpreted,
        deviation=deviation,
        compared=steps,
    )


def _at_paper_step(soft: Scene, method: str) -> float:
    """Run time [s] of 10 s at 2 ms, the least of twenty; infinite if the run fails."""
    simulator = Simulator(at_method(soft, method, published.STEP), unchecked_step=True)
    best = float("inf")
    for _ in range(20):
        simulator.reset()
        began = time.perf_counter()
        fine = simulator.advance(published.DURATION).status.ok
        best = min(best, time.perf_counter() - began) if fine else float("inf")
    return best


def _interpreted_table(
    report: Report, timings: dict[str, MethodTiming], number: int, table: int, mark: str
) -> None:
    paper = published.MATLAB_1 if number == 1 else published.MATLAB_2
    header = ["simulated [s]"]
    header += [f"paper, MATLAB: {name}" for name in PAPER_NAMES.values()]
    header += [f"numpy {way}: {method}" for way in (LOOP, ARRAYS) for method in PAPER_NAMES]
    columns: list[list[Cell]] = [[*map(float, published.TIMES), mark]]
    for method in PAPER_NAMES:
        printed = list(paper[method]) if method in paper else ["Unstable"] * 19
        columns.append([*printed, printed[-1]])
    steps = published.DURATION / published.STEP
    for way in (LOOP, ARRAYS):
        for method in PAPER_NAMES:
            at_paper_step = steps * timings[method].interpreted[way].best
            columns.append([*timings[method].interpreted_run(way), at_paper_step])
    report.table(
        f"table_{table}",
        header,
        list(zip(*columns, strict=True)),
        f"Table {table}. Interpreted run time [s], {SCENARIOS[number]}",
    )


def _compiled_table(
    report: Report, timings: dict[str, MethodTiming], number: int, table: int, mark: str
) -> None:
    paper = published.CPP_1 if number == 1 else published.CPP_2
    header = ["simulated [s]", *(f"paper, C++: {PAPER_NAMES[method]}" for method in paper)]
    header += ["paper RK / symplectic", *(f"compiled: {method}" for method in COMPARED)]
    header += ["ours RK4 / Forest-Ruth"]
    columns: list[list[Cell]] = [[*map(float, published.TIMES), mark]]
    printed = {method: np.append(times, times[-1]) for method, times in paper.items()}
    ours = {
        method: np.append(timings[method].wall, timings[method].at_paper_step)
        for method in COMPARED
    }
    columns += [list(times) for times in printed.values()]
    columns.append(list(printed["rk4"] / printed["forest_ruth"]))
    columns += [list(times) for times in ours.values()]
    columns.append(list(ours["rk4"] / ours["forest_ruth"]))
    report.table(
        f"table_{table}",
        header,
        list(zip(*columns, strict=True)),
        f"Table {table}. Compiled run time [s], {SCENARIOS[number]}",
    )


def _cost_table(report: Report, timings: Timings) -> None:
    rows: list[list[Cell]] = []
    steps = published.DURATION / published.STEP
    for number in SCENARIOS:
        matlab = published.MATLAB_1 if number == 1 else published.MATLAB_2
        cpp = published.CPP_1 if number == 1 else published.CPP_2
        for method in COMPARED:
            timing = timings[number][method]
            loop, arrays = (timing.interpreted[way].best for way in (LOOP, ARRAYS))
            rows.append(
                [
                    number,
                    method,
                    METHODS[method].force_evaluations,
                    1e6 * timing.step,
                    1e3 * matlab[method][-1] / steps if method in matlab else None,
                    1e3 * cpp[method][-1] / steps if method in cpp else None,
                    1e3 * loop,
                    1e3 * arrays,
                    1e6 * timing.cost.best,
                    f"{100 * timing.cost.spread:.0f} %",
                    loop / timing.cost.best,
                    arrays / timing.cost.best,
                    timing.wall[-1] / published.TIMES[-1],
                ]
            )
    header = ["scenario", "method", "forces/step", "our step [us]"]
    header += ["paper MATLAB [ms/step]", "paper C++ [ms/step]"]
    header += [f"numpy {LOOP} [ms/step]", f"numpy {ARRAYS} [ms/step]"]
    header += ["compiled [us/step]", "spread", f"{LOOP} / compiled", f"{ARRAYS} / compiled"]
    header += ["compiled, s per simulated s"]
    report.table(
        "cost_per_step",
        header,
        rows,
        "Cost of a step: the least of 40 short pieces, and how far the median lies above it",
    )
    worst = max(t.deviation for group in timings.values() for t in group.values())
    report.text(
        f"""The interpreted twin shares no code with the kernels but the spline and the methods'
        tables; after {timings[1]["rk4"].compared} steps it is within {worst:.1e} m of the compiled
        run in every method and scenario."""
    )


def _figure(report: Report, timings: Timings) -> None:
    figure, (axes,) = plotting.new_figure(width=9.0, height=5.0)
    columns: dict[str, Array] = {"simulated time [s]": published.TIMES}
    for method in COMPARED:
        timing, color = timings[1][method], plotting.COLORS[method]
        curves = {f"compiled, {method} [s]": (timing.wall, "-")}
        curves[f"numpy {ARRAYS}, {method} [s]"] = (timing.interpreted_run(ARRAYS), "--")
        if method in published.CPP_1:
            curves[f"paper C++ at 2 ms, {PAPER_NAMES[method]} [s]"] = (published.CPP_1[method], ":")
        for label, (values, style) in curves.items():
            columns[label] = values
            axes.loglog(
                published.TIMES, values, style, color=color, label=label.removesuffix(" [s]")
            )
    axes.plot(published.TIMES, published.TIMES, color="black", linewidth=0.8, label="real time")
    axes.set_xlabel("simulated time [s]")
    axes.set_ylabel("run time [s]")
    axes.grid(alpha=0.3, which="both")
    axes.legend(fontsize="small", loc="center left", bbox_to_anchor=(1.01, 0.5))
    report.figure(
        "run_time",
        figure,
        columns,
        "Run time over simulated time, scenario 1; below the black line is faster than real time",
    )
