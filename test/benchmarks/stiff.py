"""The paper's wire at steps of milliseconds: energy-conserving methods against Forest-Ruth.

    python test/benchmarks/stiff.py FOLDER [--quick]

writes a report into the folder.
"""

from __future__ import annotations

import sys
from functools import cache
from itertools import product
from pathlib import Path
from typing import Any

import numpy as np

from dlo_sim.batch.workers import HERE
from dlo_sim.scene.description import Scene
from dlo_sim.simulation.recording import Recording
from dlo_sim.simulation.simulator import Simulator
from dlo_sim.studies import Request
from dlo_sim.studies.report import Report
from dlo_sim.studies.runs import advance, distance, run, shipped, step_cost

# The benchmark measures the method, not the tolerance of its solver.
TIGHT = {"integrator.tolerance": 1e-10}
SIZES = {True: (9, 19), False: (9, 13, 19, 40)}  # control points
STEPS = (2e-3, 5e-3, 1e-2)  # [s]
HARD_STEPS = (2e-2, 5e-2, 1e-1)  # [s]
COMPOSED_STEPS = (2e-3, 2.5e-3, 1e-2 / 3.0, 5e-3, 2e-2 / 3.0, 1e-2)  # [s] of five sub-steps each
KINDS = {  # method and Gauss points per span (0: the shipped 101 samples) -> steps
    ("energy_momentum", 0): (*STEPS, *HARD_STEPS),
    ("energy_momentum", 3): (*STEPS, *HARD_STEPS),
    ("energy_momentum_4", 0): COMPOSED_STEPS,
}
DURATION = 10.0  # [s]
COMPARED = 2.0  # [s] over which shapes are compared
EVERY = 0.02  # [s] between the shapes compared, a multiple of all steps
CONVERGED = 1e-4  # [s], the converged step: a twentieth of 2 ms, 1/400 of its error
REFERENCE = 80  # control points of the fine mesh
HEADER = (
    "method | quadrature | n_u | step [ms] | outcome | energy error | iterations per step | "
    "most in a step | run time [s] | forest_ruth's step [us] | its run time [s] | times faster | "
    "error [mm] | at the converged step [mm]"
)


def wire(n: int, method: str, step: float = 0.0, gauss: int = 0) -> Scene:
    """`paper_wire.yaml` with other control points, method, step and quadrature."""
    values = TIGHT | {"integrator.method": method, "integrator.step": step}
    if gauss:
        values |= {"discretization.quadrature": "gauss", "discretization.samples": gauss}
    return shipped("paper_wire", **values, **{"discretization.control_points": n})


def measured(quick: bool) -> list[list[Any]]:
    """Rows of `HEADER`: every kind at every size."""
    rows: list[list[Any]] = []
    for (method, gauss), n in product(KINDS, SIZES[quick]):
        rows += _measure(n, method, gauss, 2 if quick else 5)
    return rows


def _measure(n: int, method: str, gauss: int, repeats: int) -> list[list[Any]]:
    """Rows for all steps of a kind, with the run time of Forest-Ruth for the same duration, from
    its cost of a step, timed in turn with the implicit runs. Errors: shipped quadrature only.
    """
    explicit = Simulator(wire(n, "forest_ruth", gauss=gauss))
    simulators = [Simulator(wire(n, method, step, gauss)) for step in KINDS[method, gauss]]
    costs, walls, rows = [], np.full((repeats, len(simulators)), np.inf), []
    for repeat in range(repeats):
        costs.append(step_cost(explicit, repeats=15).best)
        for k, simulator in enumerate(simulators):
            simulator.reset()
            walls[repeat, k] = advance(simulator, round(DURATION / simulator.step))
    explicit_wall = min(costs) * DURATION / explicit.step
    for simulator, wall in zip(simulators, walls.min(axis=0).tolist(), strict=True):
        step = simulator.step
        simulator.reset()
        report = simulator.advance_steps(round(DURATION / step))
        row: list[Any] = [method, f"gauss {gauss}" if gauss else "shipped", n, step]
        row += [report.message or "ok", simulator.energy_error]
        row += [report.force_evaluations / max(report.steps, 1), _most_iterations(simulator)]
        row += [wall, explicit.step, explicit_wall, explicit_wall / wall, None, None]
        if not gauss and step not in HARD_STEPS:
            row[-2:] = _off(n, method, step), _off(n, "energy_momentum", CONVERGED)
        rows.append(row)
    return rows


def _most_iterations(simulator: Simulator) -> int:
    """Largest number of Newton iterations in a step."""
    simulator.reset()
    steps = range(round(DURATION / simulator.step))
    return max(simulator.advance_steps(1).force_evaluations for _ in steps)


@cache
def _shapes(n: int, method: str, step: float, gauss: int = 0) -> Recording:
    return run(wire(n, method, step, gauss), COMPARED, EVERY)


@cache
def _off(n: int, method: str, step: float) -> float:
    """Largest distance [m] from the fine mesh."""
    fine = _shapes(REFERENCE, "energy_momentum", CONVERGED, 3)
    return float(distance(_shapes(n, method, step), fine).max())


def references() -> dict[str, float]:
    """Uncertainty of the references [m]: comparison -> largest distance."""
    own = Simulator(wire(9, "forest_ruth")).step
    other = _shapes(9, "forest_ruth", float(EVERY / np.ceil(EVERY / own)))
    mine = _shapes(9, "energy_momentum", CONVERGED)
    meshes = (REFERENCE // 2, REFERENCE)
    coarse, fine = (_shapes(n, "energy_momentum", CONVERGED, 3) for n in meshes)
    return {
        "converged step against forest_ruth, n_u 9": float(distance(mine, other).max()),
        f"fine mesh against n_u {REFERENCE // 2}": float(distance(fine, coarse).max()),
    }


def describe(report: Report, rows: list[list[Any]]) -> dict[str, str]:
    """Add section and tables; returns the verdicts."""
    report.section("The paper's wire at steps of milliseconds")
    report.text(
        """`paper_wire.yaml` with other n_u, methods, steps and quadrature (Gauss points per span,
        or the shipped 101 samples), compared with forest_ruth at its own step with the same
        quadrature, timed in turn. Errors are largest distances over the first 2 s from a fine mesh;
        the converged step is on the mesh of the run. energy_momentum_4 takes five sub-steps in a
        step, one of them backwards in time; its iterations are those of all five. Steps with many
        more iterations than usual did not converge at first and were subdivided."""
    )
    caption = "Energy-conserving methods at steps of milliseconds, compared with Forest-Ruth"
    report.table("stiff", HEADER, rows, caption)
    certainty = references().items()
    report.table("references", "reference | distance [mm]", certainty, "Uncertainty of the errors")
    verdicts = {}
    energies: dict[str, list[tuple[float, bool]]] = {"up to 10 ms": [], "20 to 100 ms": []}
    for method, _, n, step, outcome, energy, *_, ratio, error, converged in rows:
        if step == STEPS[0] and error and converged:
            verdicts[f"{method} at 2 ms, n_u {n}"] = (
                f"{ratio:.3g} times faster than forest_ruth, error {error / converged:.3g} times "
                "that of the converged step"
            )
        part = "20 to 100 ms" if step in HARD_STEPS else "up to 10 ms"
        energies[part].append((energy, outcome != "ok"))
    for name, found in energies.items():
        worst, stopped = max(energy for energy, _ in found), sum(stop for _, stop in found)
        verdicts[f"energy, {name}"] = (
            f"error {worst:.1e} at most, {stopped} of {len(found)} runs stopped"
        )
    return verdicts


if __name__ == "__main__":
    quick = "--quick" in sys.argv
    request = Request(Path(sys.argv[1]), quick, "python test/benchmarks/stiff.py", HERE)
    written = Report(request, "Energy-conserving methods at steps of milliseconds", {})
    verdicts = describe(written, measured(quick))
    written.outcome(verdicts)
    for name, verdict in verdicts.items():
        print(f"{name}: {verdict}")
