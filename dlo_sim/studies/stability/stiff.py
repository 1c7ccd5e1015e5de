"""What the stiff methods must reach: the paper's wire at milliseconds, beside Forest-Ruth."""

from __future__ import annotations

import time
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from dlo_sim.kernels.implicit import MAX_ITERATIONS
from dlo_sim.scene.description import Scene
from dlo_sim.scene.loading import load_scene, shipped_scene
from dlo_sim.simulation.simulator import Simulator
from dlo_sim.studies.stopwatch import step_cost

Array = NDArray[np.float64]

STEPS = (2e-3, 5e-3, 1e-2)  # [s]
HARD_STEPS = (2e-2, 5e-2, 1e-1)  # [s]
COMPOSED_STEPS = (2e-3, 2.5e-3, 1e-2 / 3.0, 5e-3, 2e-2 / 3.0, 1e-2)  # [s] of five sub-steps each
ASKED_RATIO = {9: 20.0, 13: 30.0, 19: 60.0, 40: 200.0}
ASKED_ENERGY = 1e-8
ASKED_ERROR = 1.5
DURATION = 10.0  # [s]
COMPARED = 2.0  # [s] over which shapes are compared
EVERY = 0.02  # [s] between the shapes compared, a whole number of all steps
CONVERGED = 1e-4  # [s], the converged step: a twentieth of 2 ms, 1/400 of its error
REFERENCE = 80  # control points of the fine mesh


@dataclass(frozen=True)
class Stiff:
    """A method that keeps the energy, at one step, beside Forest-Ruth at its own.

    Attributes:
        energy_error: over 10 s, relative to the energy exchanged. outcome: empty if it reached its
            end. per_step: Newton iterations. retried: steps that took more iterations than one
            attempt may, so that at least one attempt failed and was done again in pieces.
        wall: least time of 10 s [s]; explicit_step: Forest-Ruth's own [s], explicit_wall: its time
            for 10 s [s], from the cost of a step measured in turns with the implicit runs.
        error: largest distance [m] over 2 s from the fine mesh; converged: the same with the
            converged step.
    """

    n: int
    step: float
    outcome: str
    energy_error: float
    per_step: float
    retried: int
    wall: float
    explicit_step: float
    explicit_wall: float
    error: float | None
    converged: float | None

    @property
    def ratio(self) -> float:
        """How many times faster than Forest-Ruth."""
        return self.explicit_wall / self.wall

    @property
    def error_ratio(self) -> float | None:
        """Error over that of the converged step."""
        if self.error is None or self.converged is None:
            return None
        return self.error / self.converged


def wire(n: int, method: str, step: float = 0.0, gauss: bool = False) -> Scene:
    """`paper_wire.yaml` with other control points, method and step."""
    values: dict[str, object] = {
        "discretization.control_points": n,
        "integrator.method": method,
        "integrator.step": step,
    }
    if gauss:
        values |= {"discretization.quadrature": "gauss", "discretization.samples": 3}
    return load_scene(shipped_scene("paper_wire"), values)


def measure(
    n: int,
    steps: tuple[float, ...],
    repeats: int = 3,
    method: str = "energy_momentum",
    gauss: bool = False,
) -> list[Stiff]:
    """All steps at one number of control points; errors only for the shipped quadrature."""
    explicit = Simulator(wire(n, "forest_ruth", gauss=gauss))
    costs, walls = [], dict.fromkeys(steps, np.inf)
    runs = {step: Simulator(wire(n, method, step, gauss)) for step in steps}
    counts: dict[float, tuple[str, float, float, int]] = {}
    for repeat in range(repeats):
        costs.append(step_cost(explicit, repeats=15).best)
        for step, simulator in runs.items():
            began = time.perf_counter()
            report = simulator.advance_steps(round(DURATION / step))
            walls[step] = min(walls[step], time.perf_counter() - began)
            if repeat == 0:
                done = max(simulator.steps, 1)
                per_step = report.force_evaluations / done
                counts[step] = (report.message, simulator.energy_error, per_step, 0)
            simulator.reset()
    shapes = (
        _shapes(wire(REFERENCE, "energy_momentum", CONVERGED, gauss=True)) if not gauss else None
    )
    found = []
    for step, simulator in runs.items():
        message, energy, per_step, _ = counts[step]
        error = converged = None
        if shapes is not None and step not in HARD_STEPS:
            error = _distance(_shapes(simulator.scene), shapes)
            converged = _distance(_shapes(wire(n, "energy_momentum", CONVERGED)), shapes)
        found.append(
            Stiff(
                n=n,
                step=step,
                outcome=message,
                energy_error=energy,
                per_step=per_step,
                retried=_retried(simulator),
                wall=walls[step],
                explicit_step=explicit.step,
                explicit_wall=min(costs) * DURATION / explicit.step,
                error=error,
                converged=converged,
            )
        )
    return found


def _retried(simulator: Simulator) -> int:
    """Steps of the run that took more iterations than one attempt may."""
    simulator.reset()
    count = 0
    for _ in range(round(DURATION / simulator.step)):
        report = simulator.advance_steps(1)
        if not report.status.ok:
            break
        count += report.force_evaluations > MAX_ITERATIONS
    simulator.reset()
    return count


def _shapes(scene: Scene) -> Array:
    """Centerlines [m] every hundredth of a second, shape (T, m, 3)."""
    simulator = Simulator(scene)
    u = np.linspace(0.0, scene.cable.length, 101)
    each = round(EVERY / simulator.step)
    shapes = [simulator.centerline(u)]
    for _ in range(round(COMPARED / EVERY)):
        simulator.advance_steps(each)
        shapes.append(simulator.centerline(u))
    return np.array(shapes)


def _distance(one: Array, other: Array) -> float:
    return float(np.linalg.norm(one - other, axis=2).max())


def reference_error() -> tuple[float, float]:
    """Distances [m] over 2 s: the converged step from Forest-Ruth at n_u = 9, another method; and
    the fine mesh from half as many control points."""
    mine = _shapes(wire(9, "energy_momentum", CONVERGED))
    simulator = Simulator(wire(9, "forest_ruth"))
    step = EVERY / np.ceil(EVERY / simulator.step)
    other = _shapes(wire(9, "forest_ruth", float(step)))
    fine = _shapes(wire(REFERENCE, "energy_momentum", CONVERGED, gauss=True))
    coarse = _shapes(wire(REFERENCE // 2, "energy_momentum", CONVERGED, gauss=True))
    return _distance(mine, other), _distance(fine, coarse)
