"""How large a step may be: predicted and observed limits, and what the paper's step would need."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from dlo_sim.batch.workers import Workers
from dlo_sim.core.methods import METHODS
from dlo_sim.scene.description import Scene
from dlo_sim.scene.loading import SceneError
from dlo_sim.simulation.recording import Recording, record
from dlo_sim.simulation.simulator import Simulator
from dlo_sim.studies import plotting
from dlo_sim.studies.paper import published
from dlo_sim.studies.paper.runs import (
    COMPARED,
    NEGLIGIBLE,
    SCENARIOS,
    Settings,
    at_method,
    bending_alone,
    distance,
    each,
    highest_frequency,
    run,
    scenario,
    softened,
    step_limit,
)
from dlo_sim.studies.report import Cell, Report

TOLERANCE = 2e-3  # of the observed limit


@dataclass(frozen=True)
class Limits:
    """Largest stable steps of the real wire.

    Attributes:
        predicted, observed: [s] by scenario and method.
        failure: time [s] and steps until a run at the paper's 2 ms is stopped, likewise.
        softening: factor by which axial stiffness and end springs have to fall for 2 ms.
        soft_ok: methods that finish scenario 2 at 2 ms with the constants so changed.
        implicit_wall: run time [s] of energy_momentum at 2 ms on the real wire, its largest
            distance [m] from a fine run.
    """

    predicted: dict[int, dict[str, float]]
    observed: dict[int, dict[str, float]]
    failure: dict[int, dict[str, tuple[float, int]]]
    softening: float
    soft_ok: dict[str, bool]
    implicit_wall: float
    implicit_distance: float


def add(report: Report, settings: Settings, workers: Workers, factor: float) -> Limits:
    """Limits of the methods, terms that cause them, rows at the paper's step.

    Args:
        factor: by which axial stiffness and springs must fall for 2 ms.
    """
    report.section("The largest stable step, and what 2 ms would need")
    predicted = {k: {m: step_limit(scenario(k), m) for m in COMPARED} for k in SCENARIOS}
    pairs = [(k, m) for k in SCENARIOS for m in COMPARED]
    sought = [(scenario(k), m, predicted[k][m], settings) for k, m in pairs]
    limits = iter(each(workers, _observed, sought))
    observed = {k: {m: next(limits) for m in COMPARED} for k in SCENARIOS}
    ends = iter(each(workers, stopped_at, [(scenario(k), m) for k, m in pairs]))
    failure = {k: {m: next(ends) for m in COMPARED} for k in SCENARIOS}
    _limit_table(report, predicted, observed, failure)
    _limit_figure(report, predicted, observed)
    _term_table(report)
    soft_ok, implicit = _paper_rows(report, settings, factor)
    return Limits(predicted, observed, failure, factor, soft_ok, *implicit)


def _survives(scene: Scene, method: str, step: float, duration: float) -> bool:
    simulator = Simulator(at_method(scene, method, step), unchecked_step=True)
    return simulator.advance(duration).status.ok


def _observed(scene: Scene, method: str, predicted: float, settings: Settings) -> float:
    """Largest step [s] at which a run of some thousand steps is not stopped, by bisection."""
    duration = (2000 if settings.quick else 20_000) * predicted
    low, high = 0.63 * predicted, 1.41 * predicted
    while high / low > 1.0 + TOLERANCE:
        middle = 0.5 * (low + high)
        low, high = (middle, high) if _survives(scene, method, middle, duration) else (low, middle)
    return low


def stopped_at(
    scene: Scene, method: str, duration: float = published.DURATION
) -> tuple[float, int]:
    """Time [s] and steps at the paper's step until the kinetic energy exceeds that of a fall
    through the wire's own length, or the run fails; (inf, 0) if neither happens."""
    simulator = Simulator(at_method(scene, method, published.STEP), unchecked_step=True)
    fall = scene.cable.mu * scene.cable.length**2 * float(np.linalg.norm(scene.gravity))
    for step in range(1, round(duration / published.STEP) + 1):
        report = simulator.advance_steps(1)
        if not (report.status.ok and simulator.energy().kinetic < fall):
            return step * published.STEP, step
    return float("inf"), 0


def _limit_table(
    report: Report,
    predicted: dict[int, dict[str, float]],
    observed: dict[int, dict[str, float]],
    failure: dict[int, dict[str, tuple[float, int]]],
) -> None:
    rows: list[list[Cell]] = []
    for number in SCENARIOS:
        for method in COMPARED:
            limit = METHODS[method].stability_limit
            evaluations = METHODS[method].force_evaluations
            rows.append(
                [
                    number,
                    method,
                    limit,
                    1e6 * predicted[number][method],
                    1e6 * observed[number][method],
                    evaluations / limit,
                    published.STEP / observed[number][method],
                    f"stopped at {1e3 * failure[number][method][0]:.3g} ms "
                    f"(step {failure[number][method][1]})"
                    if failure[number][method][1]
                    else "reached 10 s",
                ]
            )
    header = ["scenario", "method", "limit omega tau", "predicted [us]", "observed [us]"]
    header += ["forces per omega tau at the limit", "2 ms / observed", "**the paper's step, 2 ms**"]
    report.table(
        "stable_steps",
        header,
        rows,
        "Largest stable step of the real wire (n_u = 9, n_s = 101): predicted from the linearised "
        "wire, observed by bisection; last column: a run at the paper's 2 ms, nothing changed",
    )
    report.text(
        """*Forces per omega tau* is the price of simulated time where stability sets the step: the
        smaller the better. Forest-Ruth pays the most."""
    )


def _limit_figure(
    report: Report, predicted: dict[int, dict[str, float]], observed: dict[int, dict[str, float]]
) -> None:
    soft = {m: step_limit(bending_alone(scenario(1)), m) for m in COMPARED}
    bars = {
        "as the paper prints it (observed)": [observed[1][m] for m in COMPARED],
        "bending alone, no axial stiffness or springs (predicted)": [soft[m] for m in COMPARED],
    }
    figure, (axes,) = plotting.new_figure(height=4.6)
    places = np.arange(len(COMPARED))
    for shift, color, (label, steps) in zip(
        (-0.2, 0.2), ("tab:blue", "lightgray"), bars.items(), strict=True
    ):
        shown = axes.bar(places + shift, [1e6 * s for s in steps], 0.38, color=color, label=label)
        axes.bar_label(shown, [_step_text(s) for s in steps], fontsize="small", padding=2)
    axes.axhline(1e6 * published.STEP, color="tab:red", linestyle="--", label="the paper's 2 ms")
    axes.set_yscale("log")
    axes.set_ylim(5.0, 200_000.0)
    axes.set_xticks(places, COMPARED)
    axes.set_ylabel("largest stable step [us]")
    axes.set_title("Largest stable step of the paper's aluminium wire, n_u = 9, n_s = 101")
    axes.legend(fontsize="small", loc="upper left")
    columns: dict[str, list[float] | list[str]] = {"method": list(COMPARED)}
    columns["predicted [s]"] = [predicted[1][m] for m in COMPARED]
    for number in SCENARIOS:
        columns[f"observed, scenario {number} [s]"] = [observed[number][m] for m in COMPARED]
    columns["bending alone, predicted [s]"] = [soft[m] for m in COMPARED]
    report.figure(
        "stable_steps_chart",
        figure,
        columns,
        "Largest stable steps: bending alone would bear the paper's 2 ms, its axial stiffness "
        "and end springs do not",
    )


def _step_text(step: float) -> str:
    return f"{1e6 * step:.3g} us" if step < 1e-3 else f"{1e3 * step:.2g} ms"


def _term_table(report: Report) -> None:
    """Which constant sets the limit: one stiffness at a time."""
    scene = scenario(1)
    tiny: dict[str, dict[str, object]] = {
        "axial": {"cable.axial_stiffness": scene.cable.EA * NEGLIGIBLE},
        "springs": {
            f"{name}.spring": [value * NEGLIGIBLE for value in end.spring]
            for name, end in scene.ends.items()
        },
        "bending": {"cable.bending_stiffness": scene.cable.EI * NEGLIGIBLE},
    }
    variants: dict[str, dict[str, object]] = {
        "everything (as printed)": {},
        "axial stiffness alone": tiny["springs"] | tiny["bending"],
        "end springs alone": tiny["axial"] | tiny["bending"],
        "bending alone": tiny["axial"] | tiny["springs"],
        "everything, lumped mass": {"discretization.mass": "lumped"},
        "torsion alone": {"terms.twist": "on"} | tiny["axial"] | tiny["springs"] | tiny["bending"],
    }
    rows: list[list[Cell]] = []
    for name, changes in variants.items():
        omega = highest_frequency(scene.with_values(changes))
        limit = METHODS["forest_ruth"].stability_limit / omega
        rows.append([name, omega, 1e6 * limit, published.STEP / limit])
    report.table(
        "limit_by_term",
        ["what is there", "largest frequency [rad/s]", "Forest-Ruth limit [us]", "2 ms / limit"],
        rows,
        "Which term forbids 2 ms (scenario 1, n_u = 9)",
    )


def _paper_rows(
    report: Report, settings: Settings, factor: float
) -> tuple[dict[str, bool], tuple[float, float]]:
    """Runs at 2 ms: constants changed until it is stable; other methods with nothing changed."""
    duration = settings.comparison
    scene = scenario(1)
    fine = run(at_method(scene, "forest_ruth"), duration, 0.01)
    rows: list[list[Cell]] = []

    def row(what: str, changed: str, recording: Recording | str, compare: bool = True) -> None:
        if isinstance(recording, str):
            rows.append([what, changed, recording, None, None, None])
            return
        gap = float(distance(recording, fine).max()) if compare else None
        outcome = f"{recording.simulated_s:g} s" if recording.ok else recording.status
        cells: list[Cell] = [outcome, recording.wall_s, recording.energy_error_max, gap]
        rows.append([what, changed, *cells])

    soft = softened(scene, factor)
    stiffness = f"EA = {soft.cable.EA:.3g} N and springs {1e4 / factor:.3g} N/m (1/{factor:.0f})"
    row("forest_ruth, real wire", "nothing", "stopped, see above")
    row("forest_ruth", f"**{stiffness}**", _at_paper_step(soft, "forest_ruth", duration))
    heavy = scene.with_values({"cable.linear_density": scene.cable.mu * factor})
    loaded = _at_paper_step(heavy, "forest_ruth", duration)
    row("forest_ruth", f"**mass times {factor:.0f}**", loaded)
    soft_ok = {}
    for method in COMPARED:
        recording = _at_paper_step(softened(scenario(2), factor), method, duration)
        soft_ok[method] = not isinstance(recording, str) and recording.ok
        row(f"{method}, scenario 2", f"**{stiffness}**", recording, compare=False)
    implicit = _at_paper_step(scene, "energy_momentum", duration)
    row("energy_momentum, real wire", "nothing", implicit)
    row(
        "implicit_midpoint, real wire",
        "nothing",
        _at_paper_step(scene, "implicit_midpoint", duration),
    )
    row("rattle (inextensible), real wire", "nothing", _at_paper_step(scene, "rattle", duration))
    report.table(
        "paper_step",
        ["method", "changed", "reached", "run time [s]", "energy error", "distance [m]"],
        rows,
        f"Rows AT THE PAPER'S STEP of 2 ms, {duration:g} s; bold: constants that were changed; "
        f"distance: largest from the real wire computed at {fine.step_s * 1e6:.3g} us",
    )
    survived = not isinstance(loaded, str) and loaded.ok
    weighed = "and reaches the end of" if survived else "but is stopped in"
    report.text(
        f"""Nothing that is printed in the paper makes 2 ms stable. Its axial stiffness *and* its
        end springs would have to be {factor:.0f} times softer, which is another wire: it sags by
        {-1e3 * _deepest(soft):.0f} mm instead of
        {-1e3 * float(fine.centerline[:, :, 2].min()):.2g} mm. (A wire that is as many times heavier
        has the same limit for small motions {weighed} its run above, stretched by its own weight.)
        Bending alone would allow 2 ms. What does work with nothing changed is an implicit
        method."""
    )
    if isinstance(implicit, str):
        return soft_ok, (float("nan"), float("nan"))
    return soft_ok, (implicit.wall_s, float(distance(implicit, fine).max()))


def _deepest(scene: Scene) -> float:
    recording = run(at_method(scene, "forest_ruth"), 1.0, 0.01)
    return float(recording.centerline[:, :, 2].min())


def _at_paper_step(scene: Scene, method: str, duration: float) -> Recording | str:
    try:
        return record(at_method(scene, method, published.STEP), duration, 0.01)
    except SceneError as refusal:
        return f"refused: {str(refusal).partition(';')[0].partition(' (')[0]}"
