"""`dlo_sim study batch`: speed-up by vector lanes, and by all cores."""

from __future__ import annotations

from collections.abc import Callable
from itertools import product

import numpy as np

from dlo_sim.batch import simulate_batch
from dlo_sim.batch.lanes import LANES, new_lane, run_lanes
from dlo_sim.batch.workers import HERE
from dlo_sim.scene.description import Scene
from dlo_sim.scene.loading import shipped_scene
from dlo_sim.simulation.simulator import Simulator
from dlo_sim.studies.catalogue import Outcome, Request
from dlo_sim.studies.plotting import Panel, chart
from dlo_sim.studies.report import Cell, Report, columns
from dlo_sim.studies.runs import advance, at_method, in_turn, shipped

RESOLUTIONS = {True: (9, 13, 25), False: (7, 9, 11, 13, 17, 25, 41)}
REPEATS = {True: 15, False: 60}
PIECE = 512  # steps of one timed piece: some milliseconds, short enough to run undisturbed at times
# Many, because on shared machines two processes run 1.5 to 2 times as fast as one.
CORE_REPEATS = {True: 3, False: 15}
CORE_SCENES = {True: 64, False: 128}
CORE_DURATION = 0.25  # [s]
CORE_CONTROL_POINTS = 13
KINDS = (  # scene and method
    "paper_wire, forest_ruth",
    "paper_wire, velocity_verlet",
    "paper_wire_force, forest_ruth",
)
TIMES = "times faster {:.2f} | median times {:.2f}"


def run_study(request: Request) -> Outcome:
    """Run the study into a folder."""
    files = {name: shipped_scene(name) for name in (kind.partition(",")[0] for kind in KINDS)}
    report = Report(request.folder, "Many cables at once", request.command, files)
    verdicts = _vectors(report, request) | _cores(report, request)
    request.progress(1.0)
    return report.outcome(verdicts)


def scenes_of(kind: str, n: int, count: int) -> list[Scene]:
    """Cables of increasing diameter, Gauss quadrature with three points per span."""
    name, method = kind.split(", ")
    rule = {"discretization__quadrature": "gauss", "discretization__samples": 3}
    base = at_method(shipped(name, discretization__control_points=n, **rule), method)
    diameters = (0.002 * (1.0 + 0.2 * k / count) for k in range(count))
    return [base.with_values({"cable.diameter": diameter}) for diameter in diameters]


def _compared(
    repeats: int, first: Callable[[], None], second: Callable[[], None]
) -> tuple[float, float, float, float]:
    """Least time of each [s], their ratio, and the median of the ratios of successive pairs."""
    times = in_turn(repeats, first, second)
    one, other = times.min(axis=0).tolist()
    return one, other, one / other, float(np.median(times[:, 0] / times[:, 1]))


def _one_vector(scenes: list[Scene], repeats: int) -> tuple[float, float, float, float]:
    """Time of a step per scene [s], one by one and on the lanes, and ratios (`_compared`)."""
    simulators = [Simulator(scene) for scene in scenes]
    step = min(simulator.step for simulator in simulators)
    lanes = [new_lane(simulator) for simulator in simulators]
    span = PIECE * step

    def one_by_one() -> None:
        for simulator in simulators:
            simulator.reset()
            advance(simulator, PIECE)

    def on_lanes() -> None:
        if not all(run.status.ok for run in run_lanes(lanes, step, span, np.array([0.0, span]))):
            raise RuntimeError("timing a run that failed")

    one, other, gain, median = _compared(repeats, one_by_one, on_lanes)
    return one / (PIECE * LANES), other / (PIECE * LANES), gain, median


def _vectors(report: Report, request: Request) -> dict[str, str]:
    pieces = list(product(KINDS, RESOLUTIONS[request.quick]))
    rows = []
    for kind, n in pieces:
        rows.append((kind, n, *_one_vector(scenes_of(kind, n, LANES), REPEATS[request.quick])))
        request.progress(0.6 * len(rows) / len(pieces))
    report.section("Eight scenes on the vector lanes of one core")
    report.text(
        """Eight scenes, one per lane, compared with the same scenes one by one, where the vector
        lanes are the knot spans of one cable. Same core, in turn, 512 steps per piece, least of the
        repeats; the time of the lanes includes packing and unpacking. The last column is the median
        of the ratios of successive pieces."""
    )
    header = f"scenes | n_u | one by one [us/step] | lanes [us/step] | {TIMES}"
    report.table("vectors", header, rows, "Time of a step of one scene")
    data = columns(("scenes", "n_u", "times faster"), [(*row[:2], row[4]) for row in rows])
    panel = Panel("n_u", "times faster", ["times faster"], by="scenes", marker="o")
    chart(report, "gain", data, [panel], "Speed-up by vector lanes, per core")
    gains = {kind: [row[4] for row in rows if row[0] == kind] for kind in KINDS}
    return {
        f"vector lanes, {kind}": f"{min(own):.2f} to {max(own):.2f} times as fast as one by one"
        for kind, own in gains.items()
    }


def _cores(report: Report, request: Request) -> dict[str, str]:
    count = request.workers.count
    report.section("All workers against one")
    if count < 2:
        report.text("There is only one worker: nothing to compare.")
        return {"all workers": "not measured: there is only one"}
    scenes = scenes_of("paper_wire, forest_ruth", CORE_CONTROL_POINTS, CORE_SCENES[request.quick])
    results = {}

    def one() -> None:
        results["one"] = simulate_batch(scenes, CORE_DURATION, workers=HERE)

    def all_of_them() -> None:
        results["all"] = simulate_batch(scenes, CORE_DURATION, workers=request.workers)

    for _ in range(3):  # so that every worker has loaded its machine code
        all_of_them()
    times = _compared(CORE_REPEATS[request.quick], one, all_of_them)
    same = results["one"].control_points.tobytes() == results["all"].control_points.tobytes()
    report.text(
        """Wires by `simulate_batch`, from scenes to results, in turn in this process and on workers
        that are already running; and whether the results are bitwise equal."""
    )
    header = f"workers | scenes | n_u | simulated [s] | one [s] | all [s] | {TIMES} | same bits"
    row: list[Cell] = [count, len(scenes), CORE_CONTROL_POINTS, CORE_DURATION, *times, str(same)]
    report.table("cores", header, [row], "Wall time of one batch")
    return {f"{count} workers": f"{times[2]:.2f} times as fast as one, same bits: {same}"}
