"""`dlo_sim study batch`: vector lanes against one by one, all cores against one."""

from __future__ import annotations

import time
from collections.abc import Callable, Mapping
from dataclasses import dataclass

import numpy as np

from dlo_sim.batch import simulate_batch
from dlo_sim.batch.lanes import LANES, new_lane, run_lanes
from dlo_sim.batch.workers import Here
from dlo_sim.scene.description import Scene
from dlo_sim.scene.loading import load_scene, shipped_scene
from dlo_sim.simulation.simulator import Simulator
from dlo_sim.studies import plotting
from dlo_sim.studies.catalogue import Request
from dlo_sim.studies.report import Cell, Report

ASKED_CONTROL_POINTS = 13
RESOLUTIONS = {True: (9, 13, 25), False: (7, 9, 11, 13, 17, 25, 41)}
REPEATS = {True: 15, False: 60}
PIECE = 512  # steps of one timed piece: some milliseconds, which run undisturbed now and then
# Many: shared machines give two processes anything from 1.5 to 2 times one.
CORE_REPEATS = {True: 3, False: 15}
CORE_SCENES = {True: 64, False: 128}
CORE_DURATION = 0.25  # [s]
VECTORS_ASKED, CORES_ASKED = 2.0, 1.8
KINDS: dict[str, tuple[str, dict[str, object]]] = {
    "paper_wire, forest_ruth": ("paper_wire", {"integrator.method": "forest_ruth"}),
    "paper_wire, velocity_verlet": ("paper_wire", {"integrator.method": "velocity_verlet"}),
    "paper_wire_force, forest_ruth": ("paper_wire_force", {"integrator.method": "forest_ruth"}),
}


@dataclass(frozen=True)
class Outcome:
    """What the study leaves behind; see `catalogue.Outcome`."""

    report: str
    figures: list[str]
    data: list[str]
    tables: dict[str, int]
    verdicts: dict[str, str]


@dataclass(frozen=True)
class Pair:
    """Two ways timed in turn [s]: the least of each, and the median of the ratios of neighbours."""

    first: float
    second: float
    median: float

    @property
    def ratio(self) -> float:
        """How many times the second is faster, by the least times."""
        return self.first / self.second


def run_study(request: Request) -> Outcome:
    """Run the study into a folder."""
    files = {name: shipped_scene(name) for name, _ in KINDS.values()}
    report = Report(request.folder, "Many cables at once", request.command, files)
    verdicts = _vectors(report, request) | _cores(report, request)
    lines = [f"- {asked}: **{answer}**" for asked, answer in verdicts.items()]
    path = report.write(["\n".join(lines)])
    request.progress(1.0)
    return Outcome(str(path), report.figures, report.data, report.tables, verdicts)


def scenes_of(name: str, changes: Mapping[str, object], n: int, count: int) -> list[Scene]:
    """Cables of rising diameter, Gauss quadrature with three points per span."""
    values = {
        "discretization.control_points": n,
        "discretization.quadrature": "gauss",
        "discretization.samples": 3,
        "integrator.step": 0.0,
        **changes,
    }
    return [
        load_scene(
            shipped_scene(name), values | {"cable.diameter": 0.002 * (1.0 + 0.2 * k / count)}
        )
        for k in range(count)
    ]


def _in_turn(first: Callable[[], None], second: Callable[[], None], repeats: int) -> Pair:
    """Time both alternately: what else the machine does hits both."""
    times = np.zeros((repeats, 2))
    first()
    second()
    for repeat in range(repeats):
        for way, work in enumerate((first, second)):
            began = time.perf_counter()
            work()
            times[repeat, way] = time.perf_counter() - began
    best = times.min(axis=0)
    return Pair(float(best[0]), float(best[1]), float(np.median(times[:, 0] / times[:, 1])))


def _one_vector(scenes: list[Scene], repeats: int) -> Pair:
    """Steps of LANES scenes one by one and on the lanes, on this core."""
    simulators = [Simulator(scene) for scene in scenes]
    step = min(simulator.step for simulator in simulators)
    lanes = [new_lane(simulator) for simulator in simulators]
    span = PIECE * step
    ends = np.array([0.0, span])

    def one_by_one() -> None:
        for simulator in simulators:
            simulator.reset()
            if not simulator.advance_steps(PIECE).status.ok:
                raise RuntimeError("timing a run that failed")

    def on_lanes() -> None:
        if not all(run.status.ok for run in run_lanes(lanes, step, span, ends)):
            raise RuntimeError("timing a run that failed")

    return _in_turn(one_by_one, on_lanes, repeats)


def _vectors(report: Report, request: Request) -> dict[str, str]:
    rows: list[list[Cell]] = []
    figure, (axes,) = plotting.new_figure()
    drawn: dict[str, list[float]] = {"n_u": []}
    least = np.inf
    for kind, (name, changes) in KINDS.items():
        numbers = RESOLUTIONS[request.quick]
        pairs = []
        for n in numbers:
            pair = _one_vector(scenes_of(name, changes, n, LANES), REPEATS[request.quick])
            each = 1e6 / (PIECE * LANES)
            pairs.append(pair)
            rows.append([kind, n, pair.first * each, pair.second * each, pair.ratio, pair.median])
            if n == ASKED_CONTROL_POINTS:
                least = min(least, pair.ratio)
        drawn["n_u"] = [float(n) for n in numbers]
        drawn[f"{kind}: times faster"] = [pair.ratio for pair in pairs]
        axes.plot(numbers, [pair.ratio for pair in pairs], "o-", label=kind)
        request.progress(0.6 * len(drawn) / (len(KINDS) + 1))
    axes.axhline(VECTORS_ASKED, color="black", linestyle="--", label="asked at 13 control points")
    axes.set_xlabel("control points n_u [-]")
    axes.set_ylabel("one by one / on lanes, time [-]")
    axes.set_ylim(bottom=0.0)
    axes.grid(alpha=0.3)
    axes.legend(fontsize="small")
    report.section("Eight scenes on the vector lanes of one core")
    report.text(
        f"""Each scene on a lane of its own against the same {LANES} scenes one by one, whose
        vector lanes are the knot spans of one cable. Same core, in turn, {PIECE} steps a piece,
        the least of the repeats; packing and unpacking the lanes is in their time. The last column
        is the median of the ratios of neighbouring pieces."""
    )
    header = ["scenes", "n_u", "one by one [us/step]", "lanes [us/step]", "times", "median times"]
    report.table("vectors", header, rows, "Time of a step of one scene")
    report.figure("gain", figure, drawn, "How many times faster the lanes are, per core")
    return {
        f"vector lanes >= {VECTORS_ASKED:g} times one by one at n_u = {ASKED_CONTROL_POINTS}": (
            f"{_reached(least >= VECTORS_ASKED)}: {least:.2f} times at least"
        )
    }


def _cores(report: Report, request: Request) -> dict[str, str]:
    asked = f"all cores >= {CORES_ASKED:g} times one"
    count = request.workers.count
    report.section("All workers against one")
    if count < 2:
        report.text("There is one worker only: nothing to compare.")
        return {asked: "not measured: one worker only"}
    name, changes = KINDS["paper_wire, forest_ruth"]
    scenes = scenes_of(name, changes, ASKED_CONTROL_POINTS, CORE_SCENES[request.quick])
    alone = Here()
    results = {}

    def one() -> None:
        results["one"] = simulate_batch(scenes, CORE_DURATION, workers=alone)

    def all_of_them() -> None:
        results["all"] = simulate_batch(scenes, CORE_DURATION, workers=request.workers)

    for _ in range(3):  # every worker has then loaded its machine code
        all_of_them()
    pair = _in_turn(one, all_of_them, CORE_REPEATS[request.quick])
    same = results["one"].control_points.tobytes() == results["all"].control_points.tobytes()
    report.text(
        f"""{len(scenes)} wires of {ASKED_CONTROL_POINTS} control points for {CORE_DURATION:g} s
        each by `simulate_batch`, from scenes to results, in turn in this process and on {count}
        workers that are already there. The numbers are
        {"equal to the last bit" if same else "**not equal**"}."""
    )
    header = ["workers", "one [s]", "all [s]", "times", "median times", "same bits"]
    row: list[Cell] = [count, pair.first, pair.second, pair.ratio, pair.median, str(same)]
    report.table("cores", header, [row], "Wall time of one batch")
    return {asked: f"{_reached(pair.ratio >= CORES_ASKED)}: {pair.ratio:.2f} times with {count}"}


def _reached(yes: bool) -> str:
    return "reached" if yes else "missed"
