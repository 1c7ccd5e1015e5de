"""Whether and why Runge-Kutta and Zhai could be stuck in scenario 2: parameters, torsion."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from dlo_sim.batch.workers import Workers
from dlo_sim.core import zhai
from dlo_sim.core.amplification import stability_limit
from dlo_sim.core.methods import METHODS
from dlo_sim.scene.description import Scene
from dlo_sim.studies import plotting
from dlo_sim.studies.paper import published
from dlo_sim.studies.paper.runs import (
    COMPARED,
    SCENARIOS,
    Array,
    Settings,
    at_method,
    distance,
    each,
    run,
    scenario,
    softened,
    step_limit,
)
from dlo_sim.studies.paper.stability import stopped_at
from dlo_sim.studies.report import Cell, Report

PLAIN, TORSION, SOFT_TORSION = "no torsion", "torsion theta' - gamma", "the same, GJ softened too"


@dataclass(frozen=True)
class Stuck:
    """What can stop a method.

    Attributes:
        pair: best psi, phi of Zhai's method and its limit omega tau, from the search.
        verlet: largest distance [m] of Zhai's positions with the best pair from Verlet's.
        stopped: by model, scenario and method the step at which a run at 2 ms is stopped, 0 if it
            is not.
        duration: of those runs [s].
    """

    pair: tuple[float, float, float]
    verlet: float
    stopped: dict[str, dict[int, dict[str, int]]]
    duration: float


def add(report: Report, settings: Settings, workers: Workers, factor: float) -> Stuck:
    """Zhai's parameters over the plane; runs at 2 ms with and without torsion.

    Args:
        factor: by which axial stiffness and springs are divided so that 2 ms is stable.
    """
    report.section("Zhai's parameters, and what could stop a method in scenario 2")
    pair, verlet = _zhai_map(report, settings)
    names = (PLAIN, TORSION, SOFT_TORSION)
    wires = [model(number, name, factor) for name in names for number in SCENARIOS]
    ends = iter(each(workers, stopped_at, [(wire, m) for wire in wires for m in COMPARED]))
    stopped = {
        name: {number: {m: next(ends)[1] for m in COMPARED} for number in SCENARIOS}
        for name in names
    }
    _torsion_table(report, stopped, factor)
    return Stuck(pair, verlet, stopped, published.DURATION)


def model(number: int, name: str, factor: float) -> Scene:
    """A softened scenario without torsion, with the paper's, with a softened one."""
    if name == PLAIN:
        return softened(scenario(number), factor)
    scene = softened(scenario(number, terms__twist="frenet"), factor)
    if name == TORSION:
        return scene
    return scene.with_values({"cable.torsional_stiffness": scene.cable.GJ / factor})


def _torsion_table(
    report: Report, stopped: dict[str, dict[int, dict[str, int]]], factor: float
) -> None:
    rows: list[list[Cell]] = []
    for name, by_scenario in stopped.items():
        for number, by_method in by_scenario.items():
            outcomes = (f"stopped at step {s}" if s else "finishes" for s in by_method.values())
            rows.append([name, number, *outcomes])
    report.table(
        "torsion_at_paper_step",
        ["model", "scenario", *COMPARED],
        rows,
        f"AT THE PAPER'S STEP of 2 ms, {published.DURATION:g} s, constants CHANGED: EA and springs "
        f"/ {factor:.0f}, in the last rows GJ as well",
    )
    plain, torsion = stopped[PLAIN], stopped[TORSION]
    limit = step_limit(softened(scenario(1, terms__twist="on"), factor))
    untouched = not any(s for one in (plain[1], plain[2], torsion[1]) for s in one.values())
    if untouched and all(torsion[2].values()):
        report.text(
            f"""The paper's model has a torsion strain, and that is one thing that scenario 2 has
            and scenario 1 has not: a wire that stays in a plane has gamma = 0 and is never
            twisted, so the torsional waves, which are {published.STEP / limit:.0f} times too fast
            for 2 ms, do not stir. A force out of the plane twists it, and the run is stopped at
            once, with every method.
            That would make runs of scenario 2 "stuck" while scenario 1 runs, but it spares the
            symplectic method no more than the others. Whether it is what the authors met cannot
            be known from the text."""
        )


def _zhai_map(report: Report, settings: Settings) -> tuple[tuple[float, float, float], float]:
    """Stability of Zhai's method over its two parameters; best pair, distance from Verlet."""
    psi, phi, limit = zhai.best_pair()
    values = np.round(np.linspace(0.0, 1.0, 11), 2)
    table: Array = np.array(
        [[stability_limit(METHODS["zhai"], float(a), float(b)) for b in values] for a in values]
    )
    figure, (axes,) = plotting.new_figure(width=8.5, height=5.5)
    names = [f"{value:g}" for value in values]
    plotting.heat_map(axes, table, names, names, "largest stable omega tau [-]", "{:.2f}")
    axes.set_xlabel("phi [-]")
    axes.set_ylabel("psi [-]")
    axes.set_title("Zhai's method on an undamped oscillator")
    report.figure(
        "zhai_map",
        figure,
        {
            "psi [-]": np.repeat(values, len(values)),
            "phi [-]": np.tile(values, len(values)),
            "largest stable omega tau [-]": table.ravel(),
        },
        f"Stability limit of Zhai's method; the search finds psi = {psi:.3f}, phi = {phi:.3f} with "
        f"{limit:.3f}",
    )
    verlet, its = (
        run(at_method(scenario(2), method), settings.short, 0.01)
        for method in ("velocity_verlet", "zhai")
    )
    gap = float(distance(verlet, its).max())
    report.text(
        f"""With psi = phi = 1/2 the recursion of the positions is exactly that of the
        Stoermer-Verlet method (in {settings.short:g} s of scenario 2 they are at most {gap:.1e} m
        apart): one force evaluation per step and the largest limit of all pairs. With phi below
        1/2, or psi below 1/2 at phi = 1/2, no step at all is stable, and next to the best pair the
        limit falls to half: a hand-tuned pair can easily be a bad one."""
    )
    return (psi, phi, limit), gap
