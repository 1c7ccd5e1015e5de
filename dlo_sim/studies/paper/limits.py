"""Largest stable steps, requirements of a step of 2 ms, and causes of divergence in scenario 2."""

from __future__ import annotations

from itertools import count, product
from typing import Any

import numpy as np

from dlo_sim.core.methods import METHODS
from dlo_sim.scene.description import Scene
from dlo_sim.scene.loading import SceneError
from dlo_sim.simulation.simulator import Simulator
from dlo_sim.studies.paper import published, wires
from dlo_sim.studies.paper.wires import COMPARED, NEGLIGIBLE, SCENARIOS, Paper, scenario
from dlo_sim.studies.runs import at_method, bisected, distance, each, reaches, run

STEPS = published.DURATION / published.STEP  # of the paper in its Tables 1 to 4
PIECE = 100  # steps between two energy checks
TOLERANCE = 2e-3  # relative, of the observed limit
LIMIT = "largest stable step, {}, scenario {} [us]".format
STOPPED = "softened wire, {}: {} stopped in scenario 2 at step (0: never)".format
RATIO = "2 ms / largest stable step of Forest-Ruth"
AT_2_MS = (
    "stopped at 2 ms, forest_ruth, scenario 1, at step (0: never)",
    "2 ms needs axial stiffness and springs divided by",
    "energy_momentum at 2 ms from a fine run [mm]",
)
Changes = dict[str, object]
PLAIN, TORSION, SOFT_TORSION = "no torsion", "torsion theta' - gamma", "the same, GJ softened too"


def add(paper: Paper) -> None:
    """Add the limits of the methods, the terms that cause them, runs at the paper's step, with and
    without torsion, and how near Zhai's positions are to Verlet's.
    """
    keys = list(product(SCENARIOS, COMPARED))
    predicted = [wires.step_limit(scenario(number), method) for number, method in keys]
    steps = 2000 if paper.quick else 20_000
    cases = [(*key, limit, steps) for key, limit in zip(keys, predicted, strict=True)]
    limits = each(paper.workers, _observed, cases).values()
    stops = each(paper.workers, stopped_at, [(scenario(k), m) for k, m in keys]).values()
    rows: list[list[Any]] = []
    for (number, name), limit, observed, stop in zip(keys, predicted, limits, stops, strict=True):
        method, outcome = METHODS[name], f"stopped at step {stop}" if stop else "reached 10 s"
        price = method.force_evaluations / method.stability_limit
        found = (method.stability_limit, limit, observed, price, published.STEP / observed)
        rows.append([number, name, *found, outcome])
        paper.found[LIMIT(name, number)] = 1e6 * observed
        if (number, name) == (1, "forest_ruth"):
            paper.found |= {RATIO: published.STEP / observed, AT_2_MS[0]: stop}
    paper.report.table(
        "stable_steps",
        "scenario | method | limit omega tau | predicted [us] | observed [us] | "
        "forces per omega tau at the limit | 2 ms / observed | **the paper's step, 2 ms**",
        rows,
        "Largest stable step of the real wire (n_u = 9, n_s = 101): predicted from the linearised "
        "wire, observed by bisection; last column: a run at the paper's 2 ms, nothing changed. "
        "Forces per omega tau: cost of simulated time if stability sets the step",
    )
    bending = wires.bending_alone(scenario(1))
    bars = [
        (method, 1e-6 * paper.found[LIMIT(method, 1)], wires.step_limit(bending, method))
        for method in COMPARED
    ]
    paper.report.bars(
        "stable_steps_chart",
        "method | largest stable step [us] | with bending alone, predicted [us]",
        bars,
        "Largest stable step of the paper's aluminium wire, n_u = 9, n_s = 101: its 2 ms would be "
        "stable with bending alone, but not with axial stiffness and springs",
    )
    _term_table(paper)
    _paper_rows(paper)
    _torsion_table(paper)
    duration = 0.5 if paper.quick else 1.0
    runs = [(at_method(scenario(2), m), duration, 0.01) for m in ("velocity_verlet", "zhai")]
    verlet, its = each(paper.workers, run, runs).values()
    paper.found["Zhai's positions from Verlet's [m]"] = float(distance(verlet, its).max())


def _observed(number: int, method: str, predicted: float, steps: int) -> float:
    """Largest step [s] at which a run of `steps` predicted steps is not stopped."""

    def fine(step: float) -> bool:
        return reaches(at_method(scenario(number), method, step), steps * predicted)

    return bisected(fine, 0.63 * predicted, 1.41 * predicted, TOLERANCE)


def stopped_at(scene: Scene, method: str) -> int:
    """Number of the step at which a run of 10 s at 2 ms is stopped, or its kinetic energy exceeds
    that of a fall by the wire's length; 0 if neither happens."""
    simulator = Simulator(at_method(scene, method, published.STEP), unchecked_step=True)
    fall = scene.cable.mu * scene.cable.length**2 * float(np.linalg.norm(scene.gravity))

    def fine(steps: int) -> bool:
        return simulator.advance_steps(steps).status.advanced and simulator.energy().kinetic < fall

    if all(fine(PIECE) for _ in range(round(STEPS / PIECE))):
        return 0
    simulator.reset()
    return next(number for number in count(1) if not fine(1))


def _term_table(paper: Paper) -> None:
    """Add the limits with one stiffness at a time."""
    scene = scenario(1)
    axial: Changes = {"cable.axial_stiffness": scene.cable.EA * NEGLIGIBLE}
    bending: Changes = {"cable.bending_stiffness": scene.cable.EI * NEGLIGIBLE}
    springs = wires.springs_over(scene, 1.0 / NEGLIGIBLE)
    variants: dict[str, Changes] = {
        "everything (as printed)": {},
        "axial stiffness alone": springs | bending,
        "end springs alone": axial | bending,
        "bending alone": axial | springs,
        "everything, lumped mass": {"discretization.mass": "lumped"},
    }
    rows: list[list[Any]] = []
    for name, changes in variants.items():
        limit = wires.step_limit(scene.with_values(changes))
        omega = METHODS["forest_ruth"].stability_limit / limit
        rows.append([name, omega, limit, published.STEP / limit])
    header = "terms | largest frequency [rad/s] | Forest-Ruth limit [us] | 2 ms / limit"
    caption = "Terms that limit the step (scenario 1, n_u = 9)"
    paper.report.table("limit_by_term", header, rows, caption)


def _paper_rows(paper: Paper) -> None:
    """Add runs at 2 ms, with constants changed until it is stable, or other methods."""
    scene, duration, factor = scenario(1), paper.comparison, paper.factor
    fine = run(at_method(scene, "forest_ruth"), duration, 0.01)
    soft, heavy = wires.softened(scene, factor), {"cable.linear_density": scene.cable.mu * factor}
    springs = f"{scene.start.spring[0] / factor:.3g} N/m"
    changed = f"**EA = {soft.cable.EA:.3g} N and springs {springs} (1/{factor:.0f})**"
    others = () if paper.quick else ("implicit_midpoint",)
    wanted = [
        ("forest_ruth", changed, soft),
        ("forest_ruth", f"**mass times {factor:.0f}**", scene.with_values(heavy)),
        *((f"{m}, scenario 2", changed, wires.softened(scenario(2), factor)) for m in COMPARED),
        *((f"{m}, real wire", "nothing", scene) for m in ("energy_momentum", *others)),
    ]
    first = ["forest_ruth, real wire", "nothing", "stopped, see above"]
    rows: list[list[Any]] = [[*first, None, None, None, None]]
    for name, change, wire in wanted:
        method, _, where = name.partition(", ")
        try:
            recording = run(at_method(wire, method, published.STEP), duration, 0.01, whole=False)
        except SceneError as refusal:
            reason = str(refusal).partition(";")[0].partition(" (")[0]
            rows.append([name, change, f"refused: {reason}", None, None, None, None])
            continue
        gap = float(distance(recording, fine).max()) if where != "scenario 2" else None
        sag = -float(recording.centerline[:, :, 2].min())
        outcome = f"{recording.simulated_s:g} s" if recording.ok else recording.status
        rows.append([name, change, outcome, recording.wall_s, recording.energy_error_max, gap, sag])
        if method == "energy_momentum" and gap is not None:
            paper.found[AT_2_MS[2]] = 1e3 * gap
    paper.report.table(
        "paper_step",
        "method | changed | reached | run time [s] | energy error | distance [mm] | sag [mm]",
        rows,
        f"Rows AT THE PAPER'S STEP of 2 ms, {duration:g} s; bold: constants that were changed; "
        f"distance: largest from the real wire at its own step, whose sag is "
        f"{-1e3 * float(fine.centerline[:, :, 2].min()):.3g} mm. With nothing changed, only "
        "implicit methods are stable at 2 ms",
    )


def _torsion_table(paper: Paper) -> None:
    twisted: Changes = {"terms.twist": "frenet"}
    soft = twisted | {"cable.torsional_stiffness": scenario(1).cable.GJ / paper.factor}
    changes: dict[str, Changes] = {PLAIN: {}, TORSION: twisted, SOFT_TORSION: soft}
    models = {
        (name, number): wires.softened(scenario(number).with_values(values), paper.factor)
        for (name, values), number in product(changes.items(), SCENARIOS)
    }
    ends = each(paper.workers, stopped_at, product(models.values(), COMPARED))
    rows: list[list[Any]] = []
    for (name, number), scene in models.items():
        steps = {method: ends[scene, method] for method in COMPARED}
        rows.append([name, number])
        rows[-1] += [f"stopped at step {s}" if s else "finishes" for s in steps.values()]
        if number == 2 and name != SOFT_TORSION:
            paper.found |= {STOPPED(name, method): step for method, step in steps.items()}
    paper.report.table(
        "torsion_at_paper_step",
        " | ".join(["model", "scenario", *COMPARED]),
        rows,
        f"AT THE PAPER'S STEP of 2 ms, {published.DURATION:g} s, constants CHANGED: EA and springs "
        f"/ {paper.factor:.0f}, in the last rows GJ as well. A wire that stays in a plane has "
        "gamma = 0 and is never twisted; torsional waves are too fast for 2 ms, and only a force "
        "out of the plane excites them",
    )
