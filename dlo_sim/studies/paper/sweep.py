"""Tables 5 to 8: cost over n_u and n_s beside the paper's."""

from __future__ import annotations

import numpy as np

from dlo_sim.simulation.simulator import Simulator
from dlo_sim.studies.paper import published, timing, wires
from dlo_sim.studies.paper.published import CONTROL_POINTS, SAMPLES
from dlo_sim.studies.paper.timing import interpreted_step
from dlo_sim.studies.paper.wires import SCENARIOS, Paper, scenario
from dlo_sim.studies.plotting import Panel, chart
from dlo_sim.studies.report import Cell
from dlo_sim.studies.runs import Array, at_method, step_cost

METHOD = "forest_ruth"
STEPS = published.DURATION / published.SWEEP_STEP
SIZE_COST = "cost of a compiled step, n_u = {} [us]".format
RUN = "run time of 10 s at the stable step, n_u = {} [s]".format
SAMPLES_COST, POINTS_COST = "least cost of 251 samples / 51", "least cost of the next n_u / one"
SHAPE = (len(CONTROL_POINTS), len(SAMPLES))
SIZES = ["n_u \\ n_s", *map(str, SAMPLES)]
PRINTED = {5: published.SWEEP_MATLAB_1, 6: published.SWEEP_MATLAB_2}
PRINTED |= {7: published.SWEEP_CPP_1, 8: published.SWEEP_CPP_2}
COMPILED, LOOP, ARRAYS, STEP = range(4)  # of a cell
THREE = "{:.3g}".format


def add(paper: Paper) -> None:
    """Measure every cell; Tables 5 to 8, run times at the stable step."""
    report = paper.report
    report.text(
        """The paper runs 10 s at 0.8 ms, 12500 steps, in every cell. What a step costs does not
        depend on its length, so each cell shows *paper / ours* for as many steps of Forest-Ruth,
        ours from the measured cost of one step. At 0.8 ms the real wire is unstable in every cell;
        after the four tables follow the run time of 10 s at a stable step, and what 0.8 ms would
        need."""
    )
    grids = {number: _grid(number, paper.quick) for number in SCENARIOS}
    for table, printed in PRINTED.items():
        number = 2 - table % 2
        kinds, what = [LOOP, ARRAYS], "MATLAB / numpy sample by sample / numpy whole arrays"
        if table > 6:
            kinds, what = [COMPILED], "C++ / compiled"
        times = STEPS * grids[number][:, :, kinds]
        rows: list[list[Cell]] = []
        for n, paper_row, our_row in zip(CONTROL_POINTS, printed, times, strict=True):
            cells = zip(paper_row, our_row, strict=True)
            rows.append([n, *(" / ".join([f"{p:.0f}", *map(THREE, own)]) for p, own in cells)])
        caption = f"Table {table}. {what}, run time [s] of 12500 steps, {SCENARIOS[number]}"
        report.table(f"table_{table}", SIZES, rows, caption)
    _stable_table(paper, grids[1])
    _paper_step_table(paper)
    _figure(paper, grids[1][:, :, COMPILED])


def _grid(number: int, quick: bool) -> Array:
    """Every cell, shape (n_u, n_s, 4); the least of rounds over the whole grid, so that a busy
    moment of the machine does not stay in a few cells."""
    grid: Array = np.full((*SHAPE, 4), np.inf)
    for _ in range(1 if quick else 3):
        for i, n in enumerate(CONTROL_POINTS):
            for j, samples in enumerate(SAMPLES):
                grid[i, j] = np.minimum(grid[i, j], _cell(number, n, samples, quick))
    return grid


def _cell(number: int, n: int, samples: int, quick: bool) -> tuple[float, ...]:
    """Cost of a step compiled, in numpy sample by sample, by whole arrays [s]; stable step [s]."""
    size = {"discretization__control_points": n, "discretization__samples": samples}
    scene = at_method(scenario(number, **size), METHOD)
    simulator = Simulator(scene)
    cost = step_cost(simulator, *((0.0005, 20) if quick else (0.003, 40))).best
    loop = interpreted_step(scene, timing.LOOP, 1 if quick else 5)
    return cost, loop, interpreted_step(scene, timing.ARRAYS, 10), simulator.step


def _stable_table(paper: Paper, grid: Array) -> None:
    times = published.DURATION / grid[:, :, STEP] * grid[:, :, COMPILED]
    rows = [[n, grid[i, 0, STEP], *times[i]] for i, n in enumerate(CONTROL_POINTS)]
    paper.report.table(
        "stable_sweep",
        [SIZES[0], "step [us] {:.4g}", *SIZES[1:]],
        rows,
        "Run time [s] of 10 s of the real wire at 0.9 of the stability limit, compiled, scenario 1 "
        "(steps times cost of a step)",
        form=".3g",
    )
    for n, time in zip(CONTROL_POINTS, times[:, SAMPLES.index(101)], strict=True):
        paper.found[RUN(n)] = float(time)


def _paper_step_table(paper: Paper) -> None:
    """Rows at 0.8 ms: limits, what would have to change, a run with that changed."""
    rows: list[list[Cell]] = []
    for n in CONTROL_POINTS:
        scene = scenario(1, discretization__control_points=n)
        limit, factor = wires.step_limit(scene), wires.softening(scene, published.SWEEP_STEP)
        change, outcome = "nothing helps: bending alone forbids it", "-"
        if np.isfinite(factor):
            change = f"**EA and springs / {factor:.0f}**"
            soft = at_method(wires.softened(scene, factor), METHOD, published.SWEEP_STEP)
            simulator = Simulator(soft, unchecked_step=True)
            fine = simulator.advance(published.DURATION).status.ok
            outcome = f"{STEPS * step_cost(simulator).best:.3g} s" if fine else "stopped"
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


def _figure(paper: Paper, compiled: Array) -> None:
    printed, ours = "paper C++ cost of a step [s]", "compiled cost of a step [s]"
    data = {
        "n_u": np.repeat([f"n_u = {n}" for n in CONTROL_POINTS], SHAPE[1]),
        "n_s": np.tile(SAMPLES, SHAPE[0]),
        ours: compiled.ravel(),
        printed: (published.SWEEP_CPP_1 / STEPS).ravel(),
    }
    panels = [
        Panel("n_s", "cost of a Forest-Ruth step [ms]", [printed], "the paper's C++", by="n_u"),
        Panel("n_s", "cost of a Forest-Ruth step [us]", [ours], "compiled, this machine", by="n_u"),
    ]
    caption = "Cost of a step over n_s and n_u, scenario 1"
    chart(paper.report, "cost_over_size", data, panels, caption, (12.0, 4.4))
    for n, cost in zip(CONTROL_POINTS, compiled[:, SAMPLES.index(101)], strict=True):
        paper.found[SIZE_COST(n)] = 1e6 * float(cost)
    paper.found[SAMPLES_COST] = float((compiled[:, -1] / compiled[:, 0]).min())
    paper.found[POINTS_COST] = float((compiled[1:] / compiled[:-1]).min())
