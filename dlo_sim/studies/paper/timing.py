"""Tables 1 to 8: run time against simulated time, and over n_u and n_s, interpreted and compiled,
compared with the paper's.
"""

from __future__ import annotations

from dataclasses import dataclass
from itertools import product
from typing import Any

import numpy as np

from dlo_sim.core.methods import METHODS
from dlo_sim.scene.description import Scene
from dlo_sim.simulation.simulator import Simulator
from dlo_sim.studies.paper import published, wires
from dlo_sim.studies.paper.interpreted import Wire
from dlo_sim.studies.paper.published import CONTROL_POINTS, SAMPLES
from dlo_sim.studies.paper.wires import COMPARED, SCENARIOS, Paper, scenario
from dlo_sim.studies.report import COLORS, Array, curves
from dlo_sim.studies.runs import Cost, advance, at_method, least, step_cost

PAPER_NAMES = {"forest_ruth": "symplectic", "rk4": "Runge-Kutta", "zhai": "Zhai"}
MATLAB = {1: published.MATLAB_1, 2: published.MATLAB_2}
CPP = {1: published.CPP_1, 2: published.CPP_2}
TIME = "run time of 10 s at its own step, {} [s]".format
COST = "cost of a compiled step, {} [us]".format
RATIO = "interpreted / compiled time of a step"
STEPS = published.DURATION / published.STEP  # of the paper in its Tables 1 to 4
QUICK_MARK = 0.5  # [s] up to which a quick study measures; later rows are extrapolated
SIZED = "forest_ruth"  # the method of Tables 5 to 8
SWEEP_STEPS = published.DURATION / published.SWEEP_STEP
SIZE_COST = "cost of a compiled step, n_u = {} [us]".format
RUN = "run time of 10 s at the stable step, n_u = {} [s]".format
SAMPLES_COST, POINTS_COST = "least cost of 251 samples / 51", "least cost of the next n_u / one"
SHAPE = (len(CONTROL_POINTS), len(SAMPLES))
SIZES = " | ".join(map(str, SAMPLES))
SWEEPS = {  # table -> scenario, published numbers, label, index in `_cell`
    5: (1, published.SWEEP_MATLAB_1, "MATLAB / numpy", 1),
    6: (2, published.SWEEP_MATLAB_2, "MATLAB / numpy", 1),
    7: (1, published.SWEEP_CPP_1, "C++ / compiled", 0),
    8: (2, published.SWEEP_CPP_2, "C++ / compiled", 0),
}


@dataclass(frozen=True)
class Timing:
    """Run time of one method in one scenario.

    Attributes:
        step: [s], 0.9 of the stability limit. cost: of one compiled step.
        wall: compiled run time [s] at `published.TIMES`, then of 10 s of the softened wire at 2 ms.
        numpy: time of one interpreted step [s].
    """

    step: float
    cost: Cost
    wall: Array
    numpy: float

    @property
    def interpreted(self) -> Array:
        """Interpreted run times [s] as in `wall`."""
        return self.numpy * np.append(published.TIMES / self.step, STEPS)


def add(paper: Paper) -> None:
    """Time all methods in both scenarios; add Tables 1 to 4 and the cost of a step."""
    timings = {(n, m): _measure(scenario(n), m, paper) for n, m in product(SCENARIOS, COMPARED)}
    paper.report.text(
        """Methods run at 0.9 of their stability limits for the real wire: the paper's 2 ms is not
        stable for any of them (next section). Interpreted numpy, one call per operation on whole
        arrays, is the counterpart of MATLAB; its run times are the measured cost of a step times
        the number of steps. Compiled functions are the counterpart of C++. The paper's step is more
        than a hundred times as long as ours: compare the cost of a step, in the fifth table, or the
        last row of each table, at 2 ms with axial stiffness and end springs divided by a factor
        that makes it stable."""
    )
    if paper.quick:
        paper.report.text(f"Quick study: compiled rows beyond {QUICK_MARK:g} s are extrapolated.")
    for number in SCENARIOS:
        _tables(paper, {method: timings[number, method] for method in COMPARED}, number)
    _cost_table(paper, timings)
    first = {method: timings[1, method] for method in COMPARED}
    lines = {"real time": published.TIMES}
    looks: dict[str, dict[str, Any]] = {"real time": {"color": "black", "linewidth": 0.8}}
    for method, one in first.items():
        times = {"compiled": one.wall, "numpy": one.interpreted}
        if method in published.CPP_1:
            times["paper C++ at 2 ms"] = published.CPP_1[method]
        for (who, line), style in zip(times.items(), ("-", "--", ":"), strict=False):
            lines[f"{who}, {method}"] = line
            looks[f"{who}, {method}"] = {"color": COLORS[method], "linestyle": style}
        paper.found[TIME(method)] = float(one.wall[-2])
        paper.found[COST(method)] = 1e6 * one.cost.best
    header = "what | simulated time [s] | run time [s]"
    caption = "Run time over simulated time, scenario 1; below *real time*: faster than that"
    rows = curves(published.TIMES, lines)
    paper.report.chart("run_time", header, rows, caption, "xy", looks=looks)
    paper.found[RATIO] = first["forest_ruth"].numpy / first["forest_ruth"].cost.best
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
    soft = at_method(wires.softened(wire, paper.factor), method, published.STEP)
    wall = np.array([*walls, *rest, _at_paper_step(soft, 3 if paper.quick else 20)])
    return Timing(step, cost, wall, interpreted_step(scene, 100))


def _at_paper_step(soft: Scene, repeats: int) -> float:
    """Least run time [s] of 10 s of a scene; infinite if it is stopped."""
    simulator = Simulator(soft, unchecked_step=True)

    def whole() -> None:
        simulator.reset()
        simulator.advance(published.DURATION)

    best = least(whole, repeats)
    return best if simulator.time >= 0.999 * published.DURATION else float("inf")


def interpreted_step(scene: Scene, repeats: int) -> float:
    """Least time [s] of the force evaluations of a step in numpy; the rest of it is negligible."""
    wire = Wire(scene)
    x = wire.start()
    evaluations = METHODS[scene.integrator.method].force_evaluations
    return evaluations * least(lambda: wire.acceleration(x, 0.0), repeats)


def _deviation(scene: Scene, steps: int = 20) -> float:
    """Distance [m] of a compiled run of velocity Verlet from the Stoermer recursion in numpy."""
    simulator, wire = Simulator(at_method(scene, "velocity_verlet")), Wire(scene)
    simulator.advance_steps(steps)
    tau, before = simulator.step, wire.start()
    x = before + 0.5 * tau**2 * wire.acceleration(before, 0.0)
    for step in range(1, steps):
        x, before = 2.0 * x - before + tau**2 * wire.acceleration(x, step * tau), x
    return float(np.abs(x - simulator.control_points[:, :3]).max())


def _tables(paper: Paper, own: dict[str, Timing], number: int) -> None:
    """Add the tables of interpreted and compiled run times of a scenario, the last row at 2 ms."""
    changed = f"**10, at 2 ms; EA and springs CHANGED: / {paper.factor:.0f}**"
    matlab, cpp = (
        {method: np.append(times, times[-1]) for method, times in printed[number].items()}
        for printed in (MATLAB, CPP)
    )
    unstable = np.full(len(published.TIMES) + 1, "Unstable")
    interpreted = {
        f"paper, MATLAB: {name}": matlab.get(m, unstable) for m, name in PAPER_NAMES.items()
    }
    interpreted |= {f"numpy: {method}": own[method].interpreted for method in PAPER_NAMES}
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
        paper.report.table(f"table_{table}", " | ".join(columns), rows, caption)


def _cost_table(paper: Paper, timings: dict[tuple[int, str], Timing]) -> None:
    rows: list[list[Any]] = []
    for (number, method), one in timings.items():
        row: list[Any] = [number, method, METHODS[method].force_evaluations, one.step]
        for printed in (MATLAB[number], CPP[number]):
            row.append(float(printed[method][-1]) / STEPS if method in printed else None)
        row += [one.numpy, one.cost.best, one.cost.spread, one.numpy / one.cost.best]
        rows.append([*row, float(one.wall[-2]) / published.DURATION])
    paper.report.table(
        "cost_per_step",
        "scenario | method | forces/step | our step [us] | paper MATLAB [ms/step] | "
        "paper C++ [ms/step] | numpy [ms/step] | compiled [us/step] | spread [%] {:.0f} | "
        "numpy / compiled | compiled, s per simulated s",
        rows,
        "Cost of a step: the least of 40 short pieces, and the excess of the median over it",
    )


def add_sizes(paper: Paper) -> None:
    """Time all cells; add Tables 5 to 8, and run times at the stable step."""
    report = paper.report
    report.text(
        """The paper runs 10 s at 0.8 ms in every cell. The cost of a step does not depend on its
        length: each cell shows *paper / ours* for the same 12500 steps of Forest-Ruth, ours from
        the measured cost of one. At 0.8 ms the real wire is unstable in every cell; the next tables
        show the run time of 10 s at a stable step, and the changes that 0.8 ms would require."""
    )
    grids = {number: _grid(number, paper.quick) for number in SCENARIOS}
    for table, (number, printed, what, kind) in SWEEPS.items():
        times = SWEEP_STEPS * grids[number][:, :, kind]
        rows: list[list[Any]] = []
        for n, paper_row, our_row in zip(CONTROL_POINTS, printed, times, strict=True):
            pairs = zip(paper_row, our_row, strict=True)
            rows.append([n, *(f"{theirs:.0f} / {ours:.3g}" for theirs, ours in pairs)])
        caption = f"Table {table}. {what}, run time [s] of 12500 steps, {SCENARIOS[number]}"
        report.table(f"table_{table}", f"n_u \\ n_s | {SIZES}", rows, caption)
    compiled, step = grids[1][:, :, 0], grids[1][:, 0, 2]
    times = published.DURATION / grids[1][:, :, 2] * compiled
    report.table(
        "stable_sweep",
        f"n_u \\ n_s | step [us] {{:.4g}} | {SIZES}",
        [[n, step[i], *times[i]] for i, n in enumerate(CONTROL_POINTS)],
        "Run time [s] of 10 s of the real wire at 0.9 of the stability limit, compiled, scenario 1 "
        "(steps times cost of a step)",
        form=".3g",
    )
    _paper_step_table(paper)
    both = {"the paper's C++": published.SWEEP_CPP_1 / SWEEP_STEPS, "compiled, here": compiled}
    rows = []
    for who, costs in both.items():
        by_size = zip(CONTROL_POINTS, costs, strict=True)
        rows += curves(SAMPLES, {f"n_u = {n}": line for n, line in by_size}, who)
    header, caption = "who | n_u | n_s | cost of a Forest-Ruth step [us]", "Cost of a step"
    report.chart("cost_over_size", header, rows, f"{caption} over n_s and n_u, scenario 1")
    column = SAMPLES.index(101)
    for n, cost, time in zip(CONTROL_POINTS, compiled[:, column], times[:, column], strict=True):
        paper.found[SIZE_COST(n)] = 1e6 * float(cost)
        paper.found[RUN(n)] = float(time)
    paper.found[SAMPLES_COST] = float((compiled[:, -1] / compiled[:, 0]).min())
    paper.found[POINTS_COST] = float((compiled[1:] / compiled[:-1]).min())


def _grid(number: int, quick: bool) -> Array:
    """All cells, shape (n_u, n_s, 3): least of several rounds over the whole grid, so that a short
    load on the machine does not distort a few cells."""
    grid: Array = np.full((*SHAPE, 3), np.inf)
    for _ in range(1 if quick else 3):
        for i, n in enumerate(CONTROL_POINTS):
            for j, samples in enumerate(SAMPLES):
                grid[i, j] = np.minimum(grid[i, j], _cell(number, n, samples, quick))
    return grid


def _cell(number: int, n: int, samples: int, quick: bool) -> tuple[float, ...]:
    """Cost of a step [s], compiled and in numpy; stable step [s]."""
    size = {"discretization__control_points": n, "discretization__samples": samples}
    scene = at_method(scenario(number, **size), SIZED)
    simulator = Simulator(scene)
    cost = step_cost(simulator, *((0.0005, 20) if quick else (0.003, 40))).best
    return cost, interpreted_step(scene, 10), simulator.step


def _paper_step_table(paper: Paper) -> None:
    """Add the rows at 0.8 ms: limits, required change, and a run with it."""
    rows: list[list[Any]] = []
    for n in CONTROL_POINTS:
        scene = scenario(1, discretization__control_points=n)
        limit, factor = wires.step_limit(scene), wires.softening(scene, published.SWEEP_STEP)
        change, outcome = "impossible: unstable with bending alone", "-"
        if np.isfinite(factor):
            change = f"**EA and springs / {factor:.0f}**"
            soft = at_method(wires.softened(scene, factor), SIZED, published.SWEEP_STEP)
            simulator = Simulator(soft, unchecked_step=True)
            fine = simulator.advance(published.DURATION).status.advanced
            outcome = f"{SWEEP_STEPS * step_cost(simulator).best:.3g} s" if fine else "stopped"
        bending = wires.step_limit(wires.bending_alone(scene))
        rows.append([n, limit, published.SWEEP_STEP / limit, bending, change, outcome])
    paper.report.table(
        "paper_sweep_step",
        "n_u | limit of the real wire [us] | 0.8 ms / limit | limit of bending alone [us] | "
        "0.8 ms would need | run time of 10 s so changed",
        rows,
        "Rows AT THE PAPER'S STEP of 0.8 ms, Forest-Ruth, scenario 1, n_s = 101; bold: constants "
        "that were CHANGED. Where bending alone is too stiff, no softening of the axial term helps",
    )
