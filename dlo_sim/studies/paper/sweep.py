"""Tables 5 to 8: cost over n_u and n_s beside the paper's, and what the cost follows."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from dlo_sim.core.methods import METHODS
from dlo_sim.simulation.simulator import Simulator
from dlo_sim.studies import plotting
from dlo_sim.studies.interpreted import Wire
from dlo_sim.studies.paper import published
from dlo_sim.studies.paper.runs import (
    SCENARIOS,
    Array,
    Settings,
    at_method,
    bending_alone,
    scenario,
    softened,
    softening,
    step_limit,
)
from dlo_sim.studies.report import Cell, Report
from dlo_sim.studies.stopwatch import least, step_cost

METHOD = "forest_ruth"
PRODUCT = "a + b n_u n_s"
STEPS = published.DURATION / published.SWEEP_STEP
SHAPE = (len(published.CONTROL_POINTS), len(published.SAMPLES))


@dataclass(frozen=True)
class Sweep:
    """Cost of a Forest-Ruth step over (n_u, n_s).

    Attributes:
        compiled, loop, arrays: [s] by scenario, shape (n_u, n_s). step: 0.9 of the limit [s].
        fits: rms relative error of each model of the compiled cost.
        needed: by n_u, factor by which axial stiffness and springs must fall for 0.8 ms.
    """

    compiled: dict[int, Array]
    loop: dict[int, Array]
    arrays: dict[int, Array]
    step: Array
    fits: dict[str, float]
    needed: dict[int, float]


def add(report: Report, settings: Settings) -> Sweep:
    """Measure every cell; Tables 5 to 8, run times at the stable step, fits."""
    report.section("Cost over n_u and n_s (Tables 5 to 8)")
    report.text(
        f"""The paper runs 10 s at 0.8 ms, {STEPS:.0f} steps, in every cell. What a step costs does
        not depend on its length, so each cell shows **paper / ours** for {STEPS:.0f} steps of
        Forest-Ruth, ours from the measured cost of one step. At 0.8 ms the real wire is unstable in
        every cell; after the four tables follow the run time of 10 s at a stable step, and what
        0.8 ms would need."""
    )
    measured = {number: _grid(number, settings) for number in SCENARIOS}
    compiled, loop, arrays = ({k: m[:, :, i] for k, m in measured.items()} for i in range(3))
    steps = measured[1][:, :, 3]
    matlab = "MATLAB / numpy sample by sample / numpy whole arrays"
    tables: dict[int, tuple[Array, tuple[Array, ...], str, int]] = {
        5: (published.SWEEP_MATLAB_1, (loop[1], arrays[1]), matlab, 1),
        6: (published.SWEEP_MATLAB_2, (loop[2], arrays[2]), matlab, 2),
        7: (published.SWEEP_CPP_1, (compiled[1],), "C++ / compiled", 1),
        8: (published.SWEEP_CPP_2, (compiled[2],), "C++ / compiled", 2),
    }
    for table, (paper, ours, what, number) in tables.items():
        rows: list[list[Cell]] = []
        for i, n in enumerate(published.CONTROL_POINTS):
            cells = [
                " / ".join([f"{paper[i, j]:.0f}", *(_short(STEPS * cost[i, j]) for cost in ours)])
                for j in range(SHAPE[1])
            ]
            rows.append([n, *cells])
        report.table(
            f"table_{table}",
            ["n_u \\ n_s", *map(str, published.SAMPLES)],
            rows,
            f"Table {table}. {what}, run time [s] of {STEPS:.0f} steps, {SCENARIOS[number]}",
        )
    _stable_table(report, compiled[1], steps)
    needed = _paper_step_table(report)
    fits = _fits(report, compiled, loop)
    _figure(report, compiled[1])
    return Sweep(compiled, loop, arrays, steps, fits, needed)


def _short(value: float) -> str:
    return f"{value:.3g}"


def _grid(number: int, settings: Settings) -> Array:
    """`_measure` of every cell, shape (n_u, n_s, 4); the least of rounds over the whole grid, so
    that a busy moment of the machine does not stay in a few cells."""
    grid: Array = np.full((*SHAPE, 4), np.inf)
    for _ in range(2 if settings.quick else 3):
        for i, n in enumerate(published.CONTROL_POINTS):
            for j, samples in enumerate(published.SAMPLES):
                grid[i, j] = np.minimum(grid[i, j], _measure(number, n, samples, settings))
    return grid


def _measure(number: int, n: int, samples: int, settings: Settings) -> tuple[float, ...]:
    """Cost of a step compiled, in numpy sample by sample, by whole arrays [s]; stable step [s]."""
    scene = at_method(
        scenario(number, discretization__control_points=n, discretization__samples=samples), METHOD
    )
    simulator = Simulator(scene)
    pieces = (0.0005, 10) if settings.quick else (0.003, 40)
    cost = step_cost(simulator, *pieces).best
    evaluations = METHODS[METHOD].force_evaluations
    interpreted = []
    for sample_by_sample in (True, False):
        wire = Wire(scene, sample_by_sample)
        x = wire.start().position
        repeats = (1 if settings.quick else 5) if sample_by_sample else 10
        one = least(lambda: wire.acceleration(x, 0.0), repeats)  # noqa: B023
        interpreted.append(evaluations * one.best)
    return cost, interpreted[0], interpreted[1], simulator.step


def _stable_table(report: Report, compiled: Array, steps: Array) -> None:
    rows: list[list[Cell]] = []
    for i, n in enumerate(published.CONTROL_POINTS):
        times = published.DURATION / steps[i] * compiled[i]
        rows.append([n, 1e6 * steps[i, 0], *(_short(t) for t in times)])
    report.table(
        "stable_sweep",
        ["n_u \\ n_s", "step [us]", *map(str, published.SAMPLES)],
        rows,
        "Run time [s] of 10 s of the real wire at 0.9 of the stability limit, compiled, scenario 1 "
        "(steps times cost of a step)",
    )


def _paper_step_table(report: Report) -> dict[int, float]:
    """Rows at 0.8 ms: limits, what would have to change, a run with that changed."""
    rows: list[list[Cell]] = []
    needed = {}
    for n in published.CONTROL_POINTS:
        scene = scenario(1, discretization__control_points=n)
        limit, bending = step_limit(scene), step_limit(bending_alone(scene))
        needed[n] = softening(scene, published.SWEEP_STEP)
        change, outcome = "nothing helps: bending alone forbids it", "-"
        if np.isfinite(needed[n]):
            change = f"**EA and springs / {needed[n]:.0f}**"
            soft = at_method(softened(scene, needed[n]), METHOD, published.SWEEP_STEP)
            simulator = Simulator(soft, unchecked_step=True)
            fine = simulator.advance(published.DURATION).status.ok
            outcome = f"{_short(STEPS * step_cost(simulator).best)} s" if fine else "stopped"
        ratio = published.SWEEP_STEP / limit
        rows.append([n, 1e6 * limit, ratio, 1e6 * bending, change, outcome])
    header = ["n_u", "limit of the real wire [us]", "0.8 ms / limit", "limit of bending alone [us]"]
    header += ["0.8 ms would need", "run time of 10 s so changed"]
    report.table(
        "paper_sweep_step",
        header,
        rows,
        f"Rows AT THE PAPER'S STEP of 0.8 ms, Forest-Ruth, scenario 1, n_s = "
        f"{published.SAMPLES[2]}; bold: constants that were CHANGED",
    )
    forbidden = [n for n, factor in needed.items() if not np.isfinite(factor)]
    if forbidden:
        report.text(
            f"""At n_u = {", ".join(map(str, forbidden))} no softening of the axial term helps: the
            bending stiffness that the paper prints is by itself too stiff for 0.8 ms, yet its
            Tables 5 to 8 have run times there."""
        )
    return needed


def models(costs: Array) -> dict[str, tuple[Array, float]]:
    """Least-squares fits of a cost over (n_u, n_s): name -> (coefficients, share unexplained)."""
    n, s = np.meshgrid(published.CONTROL_POINTS, published.SAMPLES, indexing="ij")
    spans = n - 3
    passes = np.ceil(spans / 8) * np.ceil(s / spans + 1.0)
    one = np.ones(costs.size)
    bases = {
        PRODUCT: [one, n * s],
        "a + b n_s + c n_u": [one, s, n],
        "a + b n_s + c n_u n_s": [one, s, n * s],
        "a + b n_u + c vector passes": [one, n, passes],
    }
    result = {}
    for name, columns in bases.items():
        matrix = np.stack([np.ravel(column) for column in columns], axis=1).astype(float)
        # Relative residuals: cheap cells count as much as dear ones.
        weight = 1.0 / costs.ravel()
        coefficients = np.linalg.lstsq(
            matrix * weight[:, None], costs.ravel() * weight, rcond=None
        )[0]
        off = (matrix @ coefficients) * weight - 1.0
        result[name] = (np.asarray(coefficients, dtype=float), float(np.sqrt(np.mean(off**2))))
    return result


def _fits(report: Report, compiled: dict[int, Array], loop: dict[int, Array]) -> dict[str, float]:
    """Fitted cost per step of the paper's tables and ours: the product, and what fits best.

    Returns the errors of all models of the compiled cost, scenario 1.
    """
    everything = {
        "paper, MATLAB (Table 5)": published.SWEEP_MATLAB_1 / STEPS,
        "paper, MATLAB (Table 6)": published.SWEEP_MATLAB_2 / STEPS,
        "paper, C++ (Table 7)": published.SWEEP_CPP_1 / STEPS,
        "paper, C++ (Table 8)": published.SWEEP_CPP_2 / STEPS,
        "ours, numpy sample by sample, scenario 1": loop[1],
        "ours, numpy sample by sample, scenario 2": loop[2],
        "ours, compiled, scenario 1": compiled[1],
        "ours, compiled, scenario 2": compiled[2],
    }
    rows: list[list[Cell]] = []
    for what, costs in everything.items():
        fitted = models(costs)
        others = {name: error for name, (_, error) in fitted.items() if name != PRODUCT}
        for name in (PRODUCT, min(others, key=lambda name: others[name])):
            coefficients, error = fitted[name]
            numbers = ", ".join(f"{value:.3g}" for value in 1e6 * coefficients)
            rows.append([what, name, numbers, f"{100 * error:.1f} %"])
    report.table(
        "cost_fits",
        ["cost of a step", "model", "coefficients [us]", "rms error"],
        rows,
        f"Fitted cost of a Forest-Ruth step, least squares of relative errors: {PRODUCT}, and of "
        f"{len(models(loop[1])) - 1} others the one that fits best",
    )
    report.text(
        """The paper's costs follow the product n_u n_s and, better, that and n_s. A compiled step
        does not: kernels work on eight knot spans at once, so their cost follows the number of
        *vector passes*, ceil((n_u - 3) / 8) blocks times the samples of the fullest span; n_u = 5
        has two spans in eight lanes and wastes six of them. The sample loop of numpy costs the same
        whatever n_u: every sample touches four control points."""
    )
    return {name: error for name, (_, error) in models(compiled[1]).items()}


def _figure(report: Report, compiled: Array) -> None:
    figure, (left, right) = plotting.new_figure(1, 2, width=11.0)
    columns = {
        "n_u": np.repeat(published.CONTROL_POINTS, SHAPE[1]),
        "n_s": np.tile(published.SAMPLES, SHAPE[0]),
        "compiled cost of a step [s]": compiled.ravel(),
        "paper C++ cost of a step [s]": (published.SWEEP_CPP_1 / STEPS).ravel(),
    }
    for axes, costs, unit, scale, title in (
        (left, published.SWEEP_CPP_1 / STEPS, "ms", 1e3, "the paper's C++"),
        (right, compiled, "us", 1e6, "compiled, this machine"),
    ):
        plotting.lines(
            axes,
            np.array(published.SAMPLES),
            scale * costs.T,
            [f"n_u = {n}" for n in published.CONTROL_POINTS],
        )
        axes.set_xlabel("samples n_s")
        axes.set_ylabel(f"cost of a Forest-Ruth step [{unit}]")
        axes.set_title(title)
        axes.set_ylim(0.0)
    report.figure("cost_over_size", figure, columns, "Cost of a step over n_s and n_u, scenario 1")
