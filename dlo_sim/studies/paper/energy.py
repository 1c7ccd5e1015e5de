"""Energy: error, drift, and growth of position errors."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np

from dlo_sim.scene.description import Scene
from dlo_sim.simulation.recording import Recording
from dlo_sim.simulation.simulator import Simulator
from dlo_sim.studies.paper import published
from dlo_sim.studies.paper.wires import COMPARED, Paper, scenario, softened
from dlo_sim.studies.report import Array, curves
from dlo_sim.studies.runs import at_method, distance, run

FINE = 8  # ratio of a method's step to that of the reference, real wire
OFF_STEP = 0.01037  # [s] between samples of energies: not a multiple of any step
EXPONENT = "exponent of position errors, regular wire, {}".format
ADDED = "energy added by the slope, regular wire, {}".format
SWING = "swing of the energy, regular wire, {}".format
LAST = "position error at the end, regular wire, {} [m]".format
LARGEST = "largest energy error, real wire, {}".format
BEHIND = "RK4 less accurate than Forest-Ruth at the same step from [s]"
REAL_EXPONENTS = tuple(f"{k} exponent of position errors, real wire" for k in ("least", "largest"))
HEADER = (
    "method | step [us] | largest energy error | slope [1/s] | swing | drifts? | "
    "position error [m] | exponent of its growth | run time [s]"
)
CAPTION = (
    "energy relative to the largest exchanged; swing: standard deviation about the linear fit; "
    "drifts: the fit changes by more than three times the swing"
)


@dataclass(frozen=True)
class Conservation:
    """Conservation in one run. Relative to the largest energy exchanged: largest energy error,
    change of the linear fit of the energy over the run, standard deviation about the fit. Also the
    largest position error [m] so far at every sample, and the exponent of time in its growth.
    """

    recording: Recording
    error: float
    added: float
    swing: float
    gap: Array
    exponent: float

    @property
    def row(self) -> list[Any]:
        """Row of a table with `HEADER`."""
        run, slope = self.recording, self.added / float(self.recording.time[-1])
        drifts = "yes" if abs(self.added) > 3.0 * self.swing else "no"
        energy = (self.error, slope, self.swing, drifts)
        return [run.method, run.step_s, *energy, float(self.gap[-1]), self.exponent, run.wall_s]


def add(paper: Paper) -> None:
    """Add energy and position errors of two wires."""
    paper.report.text(
        """Momenta are p = M v with the consistent mass matrix, as follows from the Lagrangian; the
        paper's p = J v (its eqs. 12-13) is the momentum per length of the continuous cable and not
        conjugate to a control point. On the real wire stability sets the step, and coupled modes
        make neighbouring trajectories diverge: the exponents of position errors do not distinguish
        symplectic methods from others. The textbook result appears on a wire with regular motion:
        four control points, softened until 2 ms is stable. Positions of `zhai` are those of
        `velocity_verlet`."""
    )
    _real(paper)
    _regular(paper)


def _compared(
    scene: Scene, steps: dict[str, float], finer: float, duration: float, every: float, start: float
) -> tuple[Recording, dict[str, Conservation]]:
    """A run of Forest-Ruth with a finer step [s], and methods with their steps beside it."""
    fine = run(at_method(scene, "forest_ruth", finer), duration, every)
    runs = {m: run(at_method(scene, m, step), duration, every) for m, step in steps.items()}
    return fine, {method: _conservation(one, fine, start) for method, one in runs.items()}


def _conservation(recording: Recording, fine: Recording, start: float) -> Conservation:
    time, error = recording.time, recording.energy - recording.energy[0]
    slope, offset = np.polyfit(time, error, 1)
    # Scale the recorded energies to the largest exchange, which only the energy account has.
    largest = recording.energy_error_max or 0.0
    scale = largest / max(float(np.abs(error).max()), 1e-300)
    swing = float(np.std(error - slope * time - offset)) * scale
    gap = np.maximum.accumulate(distance(recording, fine))
    late = (time >= start)[: len(gap)]
    exponent = float(np.polyfit(np.log(time[: len(gap)][late]), np.log(gap[late]), 1)[0])
    return Conservation(recording, largest, float(slope * scale * time[-1]), swing, gap, exponent)


def _real(paper: Paper) -> None:
    scene, duration = scenario(1), paper.comparison
    own = {method: Simulator(at_method(scene, method)).step for method in COMPARED}
    finer, start = own["forest_ruth"] / FINE, 0.1 * duration
    _, found = _compared(scene, own, finer, duration, OFF_STEP, start)
    caption = (
        f"The real wire, scenario 1, {duration:g} s, each method at 0.9 of its limit; {CAPTION}; "
        f"position against Forest-Ruth at 1/{FINE} of its step; exponent fitted from {start:g} s on"
    )
    _show(paper, "energy_real", found, caption)
    exponents = [one.exponent for one in found.values()]
    least, largest = REAL_EXPONENTS
    paper.found |= {least: min(exponents), largest: max(exponents)}
    for method in ("forest_ruth", "rk4"):
        paper.found[LARGEST(method)] = found[method].error


def _regular(paper: Paper) -> None:
    duration = 200.0 if paper.quick else 5000.0
    soft = softened(scenario(1), paper.factor)
    scene = soft.with_values({"discretization.control_points": 4})
    every = duration / (1000.0 if paper.quick else 5000.0)
    steps = dict.fromkeys(COMPARED, published.STEP)
    finer, start = published.STEP / 4, duration / 3.0
    fine, found = _compared(scene, steps, finer, duration, every, start)
    caption = (
        f"A regular wire for {duration:g} s at the paper's 2 ms: scenario 1 with n_u = 4 and "
        f"constants CHANGED: axial stiffness and springs / {paper.factor:.0f}; {CAPTION}; "
        f"exponent fitted over the last two thirds"
    )
    _show(paper, "energy_regular", found, caption)
    rows = curves(fine.time[1:], {method: one.gap[1:] for method, one in found.items()})
    header = "method | time [s] | largest position error so far [m]"
    caption = "Growth of the position error of a regular wire at 2 ms (constants CHANGED)"
    looks = {"zhai": {"linestyle": "--", "zorder": 5}}  # on the line of velocity_verlet
    paper.report.chart("error_growth", header, rows, caption, "xy", looks=looks)
    behind = np.flatnonzero(found["rk4"].gap[1:] > found["forest_ruth"].gap[1:])
    paper.found[BEHIND] = float(fine.time[1 + behind[0]]) if behind.size else float("inf")
    for method in ("forest_ruth", "rk4"):
        one = found[method]
        paper.found |= {ADDED(method): one.added, SWING(method): one.swing}
        paper.found |= {EXPONENT(method): one.exponent, LAST(method): float(one.gap[-1])}


def _show(paper: Paper, name: str, found: dict[str, Conservation], caption: str) -> None:
    """Add the table, and the energy over time in a panel for each method."""
    paper.report.table(name, HEADER, [one.row for one in found.values()], caption)
    rows = []
    for method, one in found.items():
        made = one.recording
        panel = f"{method}, step {1e6 * made.step_s:.4g} us"
        rows += curves(made.time, {method: made.energy - made.energy[0]}, panel)
    header, caption = "run | method | time [s] | energy error [J]", "Energy error over time"
    paper.report.chart(f"{name}_chart", header, rows, f"{caption}; mind the scales", linewidth=0.4)
