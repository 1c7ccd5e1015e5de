"""Energy: error, drift, growth of position errors; the Legendre transform."""

from __future__ import annotations

from dataclasses import dataclass
from itertools import product
from typing import Any

import numpy as np

from dlo_sim.core import bspline, hamiltonian, mass
from dlo_sim.simulation.recording import Recording
from dlo_sim.simulation.simulator import Simulator
from dlo_sim.studies.paper import published
from dlo_sim.studies.paper.wires import COMPARED, Paper, scenario, softened
from dlo_sim.studies.plotting import COLORS, draw, draw_band, new_figure
from dlo_sim.studies.runs import Array, at_method, distance, run

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
    largest position error [m] at every sample, and the exponent of time in its growth.
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
        return [run.method, run.step_s, *energy, float(self.gap.max()), self.exponent, run.wall_s]


def add(paper: Paper) -> None:
    """Add the check of the Legendre transform, and energy and position errors of two wires."""
    paper.report.text(
        """Momenta are p = M v with the consistent mass matrix, as follows from the Lagrangian; the
        paper's p = J v (its eqs. 12-13) is the momentum per length of the continuous cable and not
        conjugate to a control point. On the real wire stability sets the step, and coupled modes
        make neighbouring trajectories diverge: the exponents of position errors do not distinguish
        symplectic methods from others. The textbook result appears on a wire with regular motion:
        four control points, softened until 2 ms is stable. Positions of `zhai` are those of
        `velocity_verlet`."""
    )
    paper.found["largest |H(q, p) - (K + U)| / K along scenario 2"] = _legendre()
    _real(paper)
    _regular(paper)


def _legendre() -> float:
    """Largest relative difference of H(q, p) from K + U along a run."""
    scene = at_method(scenario(2), "rk4")
    simulator = Simulator(scene)
    knots = bspline.clamped_knots(scene.discretization.control_points, scene.cable.length)
    bands = np.stack([scene.cable.mu * mass.gram(knots)] * 3)
    worst = 0.0
    for _ in range(20):
        simulator.advance(0.01)
        energy = simulator.energy()
        p = hamiltonian.momenta(simulator.velocities[:, :3], bands)
        value = hamiltonian.hamiltonian(p, bands, energy.total - energy.kinetic)
        worst = max(worst, abs(value - energy.total) / energy.kinetic)
    return worst


def _conservation(recording: Recording, fine: Recording, start: float) -> Conservation:
    time, error = recording.time, recording.energy - recording.energy[0]
    slope, offset = np.polyfit(time, error, 1)
    # Scale the recorded energies to the largest exchange, which only the energy account has.
    largest = recording.energy_error_max or 0.0
    scale = largest / max(float(np.abs(error).max()), 1e-300)
    swing = float(np.std(error - slope * time - offset)) * scale
    gap = distance(recording, fine)
    late = (time >= start)[: len(gap)]
    grown = np.maximum.accumulate(gap)[late]
    exponent = float(np.polyfit(np.log(time[: len(gap)][late]), np.log(grown), 1)[0])
    added = float(slope * scale * time[-1])
    return Conservation(recording, largest, added, swing, gap, exponent)


def _real(paper: Paper) -> None:
    scene, duration = scenario(1), paper.comparison
    own = {method: Simulator(at_method(scene, method)).step for method in COMPARED}
    fine = run(at_method(scene, "forest_ruth", own["forest_ruth"] / FINE), duration, OFF_STEP)
    found = {}
    for method, share in product(COMPARED, (1.0, 0.5)):
        recording = run(at_method(scene, method, share * own[method]), duration, OFF_STEP)
        found[method, share] = _conservation(recording, fine, 0.1 * duration)
    caption = (
        f"The real wire, scenario 1, {duration:g} s, each method at 0.9 and 0.45 of its limit; "
        f"{CAPTION}; position against Forest-Ruth at 1/{FINE} of its step; exponent fitted from "
        f"{0.1 * duration:g} s on"
    )
    paper.report.table("energy_real", HEADER, [one.row for one in found.values()], caption)
    shown = {method: found[method, 1.0] for method in COMPARED}
    _energy_figure(paper, "energy_real_chart", "the real wire", shown)
    exponents = [one.exponent for one in found.values()]
    least, largest = REAL_EXPONENTS
    paper.found |= {least: min(exponents), largest: max(exponents)}
    for method in ("forest_ruth", "rk4"):
        paper.found[LARGEST(method)] = found[method, 1.0].error


def _regular(paper: Paper) -> None:
    duration = 200.0 if paper.quick else 5000.0
    soft = softened(scenario(1), paper.factor)
    scene = soft.with_values({"discretization.control_points": 4})
    every = duration / 5000.0
    fine = run(at_method(scene, "forest_ruth", published.STEP / 4), duration, every)
    found = {}
    for method in COMPARED:
        recording = run(at_method(scene, method, published.STEP), duration, every)
        found[method] = _conservation(recording, fine, duration / 3.0)
    caption = (
        f"A regular wire for {duration:g} s at the paper's 2 ms: scenario 1 with n_u = 4 and "
        f"constants CHANGED: axial stiffness and springs / {paper.factor:.0f}; {CAPTION}; "
        f"exponent fitted over the last two thirds"
    )
    paper.report.table("energy_regular", HEADER, [one.row for one in found.values()], caption)
    _energy_figure(paper, "energy_regular_chart", "the regular wire", found)
    gaps = {method: np.maximum.accumulate(one.gap) for method, one in found.items()}
    figure, (axes,) = new_figure(width=8.5, height=4.6)
    lines = {method: (fine.time[1:], gap[1:]) for method, gap in gaps.items()}
    looks = {"zhai": {"linestyle": "--", "zorder": 5, "label": "zhai (on velocity_verlet)"}}
    y = "largest position error so far [m]"
    draw(axes, lines, "time [s]", y, "xy", "Constants CHANGED", looks)
    data = {"time [s]": fine.time[1:]} | {f"{m} [m]": gap[1:] for m, gap in gaps.items()}
    caption = "Growth of the position error of a regular wire at 2 ms; exponents in the table"
    paper.report.figure("error_growth", figure, data, caption)
    behind = np.flatnonzero(gaps["rk4"][1:] > gaps["forest_ruth"][1:])
    since = float(fine.time[1 + behind[0]]) if behind.size else float("inf")
    paper.found[BEHIND] = since
    for method in ("forest_ruth", "rk4"):
        one = found[method]
        paper.found |= {ADDED(method): one.added, SWING(method): one.swing}
        paper.found |= {EXPONENT(method): one.exponent, LAST(method): float(one.gap.max())}


def _energy_figure(paper: Paper, name: str, wire: str, found: dict[str, Conservation]) -> None:
    data: dict[str, Array] = {}
    figure, panels = new_figure(2, 2, 10.0, 5.6)
    for axes, (method, one) in zip(panels, found.items(), strict=True):
        time = data["time [s]"] = one.recording.time
        error = data[f"{method} [J]"] = one.recording.energy - one.recording.energy[0]
        draw_band(axes, time, error, COLORS[method])
        axes.set_title(f"{method}, step {1e6 * one.recording.step_s:.4g} us")
        axes.set(xlabel="time [s]", ylabel="energy error [J]")
        axes.grid(alpha=0.3)
    caption = f"Energy of {wire}: error over time; band from least to largest, line: mean"
    paper.report.figure(name, figure, data, f"{caption}; mind the scales")
