"""How large a step may be, what 2 ms would need, and what could stop a method in scenario 2."""

from __future__ import annotations

from itertools import count, product

import numpy as np

from dlo_sim.core import zhai
from dlo_sim.core.amplification import stability_limit
from dlo_sim.core.methods import METHODS
from dlo_sim.scene.description import Scene
from dlo_sim.scene.loading import SceneError
from dlo_sim.simulation.recording import Recording, record
from dlo_sim.simulation.simulator import Simulator
from dlo_sim.studies import plotting
from dlo_sim.studies.paper import published
from dlo_sim.studies.paper.wires import (
    COMPARED,
    NEGLIGIBLE,
    SCENARIOS,
    Array,
    Paper,
    bending_alone,
    scenario,
    softened,
    step_limit,
)
from dlo_sim.studies.report import Cell
from dlo_sim.studies.runs import at_method, bisected, distance, each, run, survives

STEPS = published.DURATION / published.STEP  # of the paper in its Tables 1 to 4
PIECE = 100  # steps between two looks at the energy
TOLERANCE = 2e-3  # of the observed limit
LIMIT = "largest stable step, {}, scenario {} [us]".format
STOPPED = "softened wire, {}: {} stopped in scenario 2 at step (0: never)".format
Limits = dict[tuple[int, str], float]
PLAIN, TORSION, SOFT_TORSION = "no torsion", "torsion theta' - gamma", "the same, GJ softened too"


def add(paper: Paper) -> None:
    """Limits of the methods, terms that cause them, rows at the paper's step, torsion, Zhai."""
    predicted: Limits = {
        (number, method): step_limit(scenario(number), method)
        for number, method in product(SCENARIOS, COMPARED)
    }
    steps = 2000 if paper.quick else 20_000
    found = each(paper.workers, _observed, [(*k, limit, steps) for k, limit in predicted.items()])
    observed = {case[:2]: limit for case, limit in found.items()}
    ends = each(paper.workers, stopped_at, [(scenario(k), m) for k, m in predicted])
    stopped = dict(zip(predicted, ends.values(), strict=True))
    _limit_table(paper, predicted, observed, stopped)
    _limit_figure(paper, observed)
    _term_table(paper)
    _paper_rows(paper)
    _torsion_table(paper)
    _zhai_map(paper)
    for (number, method), limit in observed.items():
        paper.found[LIMIT(method, number)] = 1e6 * limit
    paper.found["stopped at 2 ms, forest_ruth, scenario 1, at step (0: never)"] = stopped[
        1, "forest_ruth"
    ]


def _observed(number: int, method: str, predicted: float, steps: int) -> float:
    """Largest step [s] at which a run of so many steps is not stopped."""
    scene = scenario(number)

    def fine(step: float) -> bool:
        return survives(at_method(scene, method, step), steps * predicted)

    return bisected(fine, 0.63 * predicted, 1.41 * predicted, TOLERANCE)


def stopped_at(scene: Scene, method: str) -> int:
    """Step at which a run of 10 s at 2 ms is stopped, or its kinetic energy exceeds that of a fall
    through the wire's own length; 0 if neither happens."""
    simulator = Simulator(at_method(scene, method, published.STEP), unchecked_step=True)
    fall = scene.cable.mu * scene.cable.length**2 * float(np.linalg.norm(scene.gravity))

    def fine(steps: int) -> bool:
        return simulator.advance_steps(steps).status.ok and simulator.energy().kinetic < fall

    if all(fine(PIECE) for _ in range(round(STEPS / PIECE))):
        return 0
    simulator.reset()
    return next(number for number in count(1) if not fine(1))


def _limit_table(
    paper: Paper, predicted: Limits, observed: Limits, stopped: dict[tuple[int, str], int]
) -> None:
    rows: list[list[Cell]] = [
        [
            *(*key, METHODS[key[1]].stability_limit, predicted[key], limit),
            METHODS[key[1]].force_evaluations / METHODS[key[1]].stability_limit,
            published.STEP / limit,
            f"stopped at step {stopped[key]}" if stopped[key] else "reached 10 s",
        ]
        for key, limit in observed.items()
    ]
    paper.report.table(
        "stable_steps",
        "scenario | method | limit omega tau | predicted [us] | observed [us] | "
        "forces per omega tau at the limit | 2 ms / observed | **the paper's step, 2 ms**",
        rows,
        "Largest stable step of the real wire (n_u = 9, n_s = 101): predicted from the linearised "
        "wire, observed by bisection; last column: a run at the paper's 2 ms, nothing changed. "
        "Forces per omega tau: the price of simulated time where stability sets the step",
    )


def _limit_figure(paper: Paper, observed: Limits) -> None:
    real = [1e6 * observed[1, method] for method in COMPARED]
    soft = [1e6 * step_limit(bending_alone(scenario(1)), method) for method in COMPARED]
    figure, (axes,) = plotting.new_figure(height=4.6)
    places = np.arange(len(COMPARED))
    for shift, label, steps in (
        (-0.2, "as the paper prints it (observed)", real),
        (0.2, "bending alone, no axial stiffness or springs (predicted)", soft),
    ):
        bars = axes.bar(places + shift, steps, 0.38, label=label)
        axes.bar_label(bars, [f"{step:.0f}" for step in steps], fontsize="small", padding=2)
    axes.axhline(1e6 * published.STEP, color="tab:red", linestyle="--", label="the paper's 2 ms")
    axes.set(yscale="log", ylim=(5.0, 200_000.0), ylabel="largest stable step [us]")
    axes.set_xticks(places, COMPARED)
    axes.set_title("Largest stable step of the paper's aluminium wire, n_u = 9, n_s = 101")
    axes.legend(fontsize="small", loc="upper left")
    data = {"method": np.array(COMPARED), "observed [us]": np.array(real)}
    caption = "Bending alone would bear the paper's 2 ms; its axial stiffness and springs do not"
    data["bending alone [us]"] = np.array(soft)
    paper.report.figure("stable_steps_chart", figure, data, caption)


def _term_table(paper: Paper) -> None:
    """Which constant sets the limit: one stiffness at a time."""
    scene = scenario(1)
    axial: dict[str, object] = {"cable.axial_stiffness": scene.cable.EA * NEGLIGIBLE}
    bending: dict[str, object] = {"cable.bending_stiffness": scene.cable.EI * NEGLIGIBLE}
    springs: dict[str, object] = {
        f"{name}.spring": [value * NEGLIGIBLE for value in end.spring]
        for name, end in scene.ends.items()
    }
    variants: dict[str, dict[str, object]] = {
        "everything (as printed)": {},
        "axial stiffness alone": springs | bending,
        "end springs alone": axial | bending,
        "bending alone": axial | springs,
        "everything, lumped mass": {"discretization.mass": "lumped"},
        "torsion alone": {"terms.twist": "on"} | axial | springs | bending,
    }
    rows: list[list[Cell]] = []
    for name, changes in variants.items():
        limit = step_limit(scene.with_values(changes))
        omega = METHODS["forest_ruth"].stability_limit / limit
        rows.append([name, omega, limit, published.STEP / limit])
    header = "what is there | largest frequency [rad/s] | Forest-Ruth limit [us] | 2 ms / limit"
    caption = "Which term forbids 2 ms (scenario 1, n_u = 9)"
    paper.report.table("limit_by_term", header, rows, caption)


def _paper_rows(paper: Paper) -> None:
    """Runs at 2 ms: constants changed until it is stable; other methods with nothing changed."""
    scene, duration, factor = scenario(1), paper.comparison, paper.factor
    fine = run(at_method(scene, "forest_ruth"), duration, 0.01)
    soft, heavy = softened(scene, factor), {"cable.linear_density": scene.cable.mu * factor}
    springs = f"{scene.start.spring[0] / factor:.3g} N/m"
    changed = f"**EA = {soft.cable.EA:.3g} N and springs {springs} (1/{factor:.0f})**"
    others = () if paper.quick else ("implicit_midpoint", "rattle")
    wanted = [
        ("forest_ruth", changed, soft),
        ("forest_ruth", f"**mass times {factor:.0f}**", scene.with_values(heavy)),
        *((f"{m}, scenario 2", changed, softened(scenario(2), factor)) for m in COMPARED),
        *((f"{m}, real wire", "nothing", scene) for m in ("energy_momentum", *others)),
    ]
    rows: list[list[Cell]] = [["forest_ruth, real wire", "nothing", "stopped, see above"]]
    rows[0] += [None] * 4
    for name, change, wire in wanted:
        method, _, where = name.partition(", ")
        recording = _at_paper_step(wire, method, duration)
        if isinstance(recording, str):
            rows.append([name, change, recording, None, None, None, None])
            continue
        gap = float(distance(recording, fine).max()) if where != "scenario 2" else None
        sag = -float(recording.centerline[:, :, 2].min())
        outcome = f"{recording.simulated_s:g} s" if recording.ok else recording.status
        rows.append([name, change, outcome, recording.wall_s, recording.energy_error_max, gap, sag])
        if method == "energy_momentum" and gap is not None:
            paper.found["energy_momentum at 2 ms from a fine run [mm]"] = 1e3 * gap
    paper.report.table(
        "paper_step",
        "method | changed | reached | run time [s] | energy error | distance [mm] | sag [mm]",
        rows,
        f"Rows AT THE PAPER'S STEP of 2 ms, {duration:g} s; bold: constants that were changed; "
        f"distance: largest from the real wire at its own step, whose sag is "
        f"{-1e3 * float(fine.centerline[:, :, 2].min()):.3g} mm. Only an implicit method takes "
        "2 ms with nothing changed",
    )


def _at_paper_step(scene: Scene, method: str, duration: float) -> Recording | str:
    try:
        return record(at_method(scene, method, published.STEP), duration, 0.01)
    except SceneError as refusal:
        return f"refused: {str(refusal).partition(';')[0].partition(' (')[0]}"


def _torsion_table(paper: Paper) -> None:
    twisted: dict[str, object] = {"terms.twist": "frenet"}
    soft = twisted | {"cable.torsional_stiffness": scenario(1).cable.GJ / paper.factor}
    changes: dict[str, dict[str, object]] = {PLAIN: {}, TORSION: twisted, SOFT_TORSION: soft}
    models = list(product(changes, SCENARIOS))
    cases = {
        (name, k, m): (softened(scenario(k).with_values(changes[name]), paper.factor), m)
        for (name, k), m in product(models, COMPARED)
    }
    ends = each(paper.workers, stopped_at, cases.values())
    stopped = {key: ends[case] for key, case in cases.items()}
    for (name, number, method), step in stopped.items():
        if number == 2 and name != SOFT_TORSION:
            paper.found[STOPPED(name, method)] = step
    rows: list[list[Cell]] = []
    for name, number in models:
        steps = [stopped[name, number, method] for method in COMPARED]
        rows.append([name, number, *(f"stopped at step {s}" if s else "finishes" for s in steps)])
    paper.report.table(
        "torsion_at_paper_step",
        ["model", "scenario", *COMPARED],
        rows,
        f"AT THE PAPER'S STEP of 2 ms, {published.DURATION:g} s, constants CHANGED: EA and springs "
        f"/ {paper.factor:.0f}, in the last rows GJ as well. A wire that stays in a plane has "
        "gamma = 0 and is never twisted; torsional waves are too fast for 2 ms, and only a force "
        "out of the plane stirs them",
    )


def _zhai_map(paper: Paper) -> None:
    """Stability of Zhai's method over its two parameters; best pair, distance from Verlet."""
    psi, phi, limit = zhai.best_pair(4 if paper.quick else 9)
    values = np.round(np.linspace(0.0, 1.0, 11), 2)
    table: Array = np.array(
        [[stability_limit(METHODS["zhai"], float(a), float(b)) for b in values] for a in values]
    )
    figure, (axes,) = plotting.new_figure(width=8.5, height=5.5)
    names = [f"{value:g}" for value in values]
    label = "largest stable omega tau [-]"
    plotting.heat_map(axes, table, names, names, label, ".2f")
    axes.set(xlabel="phi [-]", ylabel="psi [-]", title="Zhai's method on an undamped oscillator")
    data = {
        "psi [-]": np.repeat(values, len(values)),
        "phi [-]": np.tile(values, len(values)),
        label: table.ravel(),
    }
    caption = "Stability limit of Zhai's method; psi = phi = 1/2, Verlet's positions, has the "
    paper.report.figure("zhai_map", figure, data, f"{caption} largest of all pairs")
    paper.found |= {"Zhai's best psi": psi, "Zhai's best phi": phi, "Zhai's best omega tau": limit}
    duration = 0.5 if paper.quick else 1.0
    runs = [(at_method(scenario(2), m), duration, 0.01) for m in ("velocity_verlet", "zhai")]
    verlet, its = each(paper.workers, run, runs).values()
    paper.found["Zhai's positions from Verlet's [m]"] = float(distance(verlet, its).max())
