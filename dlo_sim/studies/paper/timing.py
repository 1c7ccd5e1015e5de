"""Tables 1 to 4: run time against simulated time, interpreted and compiled, beside the paper's."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from dlo_sim.core.methods import METHODS
from dlo_sim.scene.description import Scene
from dlo_sim.simulation.simulator import Simulator
from dlo_sim.studies.paper import published
from dlo_sim.studies.paper.interpreted import Wire
from dlo_sim.studies.paper.wires import COMPARED, SCENARIOS, Paper, scenario, softened
from dlo_sim.studies.plotting import COLORS, Panel, chart
from dlo_sim.studies.report import Cell
from dlo_sim.studies.runs import Array, Cost, advance, at_method, least, step_cost

LOOP, ARRAYS = "sample by sample", "whole arrays"
PAPER_NAMES = {"forest_ruth": "symplectic", "rk4": "Runge-Kutta", "zhai": "Zhai"}
MATLAB = {1: published.MATLAB_1, 2: published.MATLAB_2}
CPP = {1: published.CPP_1, 2: published.CPP_2}
TIME = "run time of 10 s at its own step, {} [s]".format
COST = "cost of a compiled step, {} [us]".format
RATIOS = {way: f"interpreted / compiled time of a step, {way}" for way in (LOOP, ARRAYS)}
STEPS = published.DURATION / published.STEP  # of the paper in its Tables 1 to 4
QUICK_MARK = 0.5  # [s] up to which a quick study measures; later rows are extrapolated


@dataclass(frozen=True)
class Timing:
    """Run time of one method in one scenario.

    Attributes:
        step: [s], 0.9 of the stability limit. cost: of one compiled step.
        wall: compiled run time [s] at `published.TIMES`, then that of 10 s at the paper's 2 ms of
            the softened wire.
        numpy: way of writing the force -> least time of one interpreted step [s].
    """

    step: float
    cost: Cost
    wall: Array
    numpy: dict[str, float]

    def interpreted(self, way: str) -> Array:
        """Run times [s] as in `wall`."""
        return self.numpy[way] * np.append(published.TIMES / self.step, STEPS)


def add(paper: Paper) -> None:
    """Measure all methods in both scenarios; Tables 1 to 4 and the cost of a step."""
    timings = {
        (number, method): _measure(scenario(number), method, paper)
        for number in SCENARIOS
        for method in COMPARED
    }
    paper.report.text(
        """Every method runs at 0.9 of its own stability limit for the real wire, because the
        paper's 2 ms is not stable for any of them (next section). Interpreted numpy stands for
        MATLAB, written in two ways: *sample by sample*, a loop over the quadrature points with a
        linear solve per force evaluation as the paper describes it, and *whole arrays*, one numpy
        call per operation; its run times are the measured cost of a step times the number of steps.
        Compiled functions stand for C++. The paper's columns are for its step of 2 ms, more than a
        hundred times as long as ours: compare them by the cost of a step, in the table after the
        four, or by the last row of each table, which is at 2 ms with axial stiffness and end
        springs divided by a factor so that 2 ms is stable."""
    )
    if paper.quick:
        paper.report.text(f"Quick study: compiled rows beyond {QUICK_MARK:g} s are extrapolated.")
    for number in SCENARIOS:
        _tables(paper, {method: timings[number, method] for method in COMPARED}, number)
    _cost_table(paper, timings)
    first = {method: timings[1, method] for method in COMPARED}
    _figure(paper, first)
    for method, one in first.items():
        paper.found[TIME(method)] = float(one.wall[-2])
        paper.found[COST(method)] = 1e6 * one.cost.best
    symplectic = first["forest_ruth"]
    for way, name in RATIOS.items():
        paper.found[name] = symplectic.numpy[way] / symplectic.cost.best
    paper.found["interpreted from compiled run after 20 steps [m]"] = max(
        _deviation(scenario(number)) for number in SCENARIOS
    )


def _measure(wire: Scene, method: str, paper: Paper) -> Timing:
    scene = at_method(wire, method)
    simulator = Simulator(scene)
    cost, step = step_cost(simulator), simulator.step
    marks = published.TIMES[published.TIMES <= (QUICK_MARK if paper.quick else published.DURATION)]
    walls = np.cumsum([advance(simulator, round(t / step) - simulator.steps) for t in marks])
    rest = published.TIMES[len(marks) :] * walls[-1] / marks[-1]
    soft = at_method(softened(wire, paper.factor), method, published.STEP)
    wall = np.array([*walls, *rest, _at_paper_step(soft, 3 if paper.quick else 20)])
    repeats = {LOOP: 2 if paper.quick else 10, ARRAYS: 100}
    numpy = {way: interpreted_step(scene, way, count) for way, count in repeats.items()}
    return Timing(step, cost, wall, numpy)


def _at_paper_step(soft: Scene, repeats: int) -> float:
    """Least run time [s] of 10 s of a scene; infinite if it is stopped."""
    simulator = Simulator(soft, unchecked_step=True)

    def whole() -> None:
        simulator.reset()
        simulator.advance(published.DURATION)

    best = least(whole, repeats)
    return best if simulator.time >= 0.999 * published.DURATION else float("inf")


def interpreted_step(scene: Scene, way: str, repeats: int) -> float:
    """Least time [s] of the force evaluations of a step in numpy; the rest of it is negligible."""
    wire = Wire(scene, way == LOOP)
    x = wire.start()
    evaluations = METHODS[scene.integrator.method].force_evaluations
    return evaluations * least(lambda: wire.acceleration(x, 0.0), repeats)


def _deviation(scene: Scene, steps: int = 20) -> float:
    """Distance [m] of a compiled run of velocity Verlet from the Stoermer recursion in numpy."""
    simulator, wire = Simulator(at_method(scene, "velocity_verlet")), Wire(scene, False)
    simulator.advance_steps(steps)
    tau, before = simulator.step, wire.start()
    x = before + 0.5 * tau**2 * wire.acceleration(before, 0.0)
    for step in range(1, steps):
        x, before = 2.0 * x - before + tau**2 * wire.acceleration(x, step * tau), x
    return float(np.abs(x - simulator.control_points[:, :3]).max())


def _tables(paper: Paper, own: dict[str, Timing], number: int) -> None:
    """Interpreted and compiled run times of a scenario, the last row at 2 ms."""
    changed = f"**10, at 2 ms; EA and springs CHANGED: / {paper.factor:.0f}**"
    matlab, cpp = (
        {method: np.append(times, times[-1]) for method, times in printed[number].items()}
        for printed in (MATLAB, CPP)
    )
    unstable = np.full(len(published.TIMES) + 1, "Unstable")
    interpreted = {
        f"paper, MATLAB: {name}": matlab.get(m, unstable) for m, name in PAPER_NAMES.items()
    }
    for way in (LOOP, ARRAYS):
        for method in PAPER_NAMES:
            interpreted[f"numpy {way}: {method}"] = own[method].interpreted(way)
    compiled = {f"paper, C++: {PAPER_NAMES[method]}": times for method, times in cpp.items()}
    compiled["paper RK / symplectic"] = cpp["rk4"] / cpp["forest_ruth"]
    compiled |= {f"compiled: {method}": one.wall for method, one in own.items()}
    compiled["ours RK4 / Forest-Ruth"] = own["rk4"].wall / own["forest_ruth"].wall
    for table, what, shown in (
        (number, "Interpreted", interpreted),
        (number + 2, "Compiled", compiled),
    ):
        columns = {"simulated [s]": [*published.TIMES, changed], **shown}
        caption = f"Table {table}. {what} run time [s], {SCENARIOS[number]}"
        rows = zip(*columns.values(), strict=True)
        paper.report.table(f"table_{table}", list(columns), rows, caption)


def _cost_table(paper: Paper, timings: dict[tuple[int, str], Timing]) -> None:
    rows: list[list[Cell]] = []
    for (number, method), one in timings.items():
        row: list[Cell] = [number, method, METHODS[method].force_evaluations, one.step]
        for printed in (MATLAB[number], CPP[number]):
            row.append(float(printed[method][-1]) / STEPS if method in printed else None)
        row += [one.numpy[LOOP], one.numpy[ARRAYS], one.cost.best, one.cost.spread]
        row += [one.numpy[way] / one.cost.best for way in (LOOP, ARRAYS)]
        rows.append([*row, float(one.wall[-2]) / published.DURATION])
    paper.report.table(
        "cost_per_step",
        "scenario | method | forces/step | our step [us] | paper MATLAB [ms/step] | "
        f"paper C++ [ms/step] | numpy {LOOP} [ms/step] | numpy {ARRAYS} [ms/step] | "
        f"compiled [us/step] | spread [%] {{:.0f}} | {LOOP} / compiled | {ARRAYS} / compiled | "
        "compiled, s per simulated s",
        rows,
        "Cost of a step: the least of 40 short pieces, and how far the median lies above it",
    )


def _figure(paper: Paper, own: dict[str, Timing]) -> None:
    data: dict[str, Array] = {"simulated time [s]": published.TIMES}
    looks: dict[str, dict[str, object]] = {}
    for method, one in own.items():
        curves = {f"compiled, {method} [s]": (one.wall[:-1], "-")}
        curves[f"numpy {ARRAYS}, {method} [s]"] = (one.interpreted(ARRAYS)[:-1], "--")
        if method in published.CPP_1:
            curves[f"paper C++ at 2 ms, {PAPER_NAMES[method]} [s]"] = (published.CPP_1[method], ":")
        for name, (times, style) in curves.items():
            data[name], looks[name] = times, {"color": COLORS[method], "linestyle": style}
    data["real time [s]"] = published.TIMES
    looks["real time [s]"] = {"color": "black", "linewidth": 0.8}
    lines = list(data)[1:]
    panel = Panel("simulated time [s]", "run time [s]", lines, log="xy", looks=looks)
    caption = "Run time over simulated time, scenario 1; below the black line: faster than real"
    chart(paper.report, "run_time", data, [panel], caption, (9.0, 5.0))
