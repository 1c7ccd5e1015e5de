"""Accuracy against run time, and the error against the reference model over n_u and n_s."""

from __future__ import annotations

from itertools import product
from typing import Any

import numpy as np

from dlo_sim.core import bspline
from dlo_sim.scene.description import Scene
from dlo_sim.simulation.simulator import Simulator
from dlo_sim.studies.paper.published import CONTROL_POINTS, REFERENCE, SAMPLES
from dlo_sim.studies.paper.wires import COMPARED, Paper, scenario, softened
from dlo_sim.studies.report import Array, curves
from dlo_sim.studies.runs import at_method, distance, each, run, step_cost

SPAN = {True: 0.25, False: 10.0}  # [s], of runs whose error is compared with their run time
# Divisors of the largest step, and a time [s] that is a multiple of every step, for the samples.
REAL, SOFT = ((1, 2, 4), 2e-5), ((1, 2, 4, 8), 4e-3)
BESIDE_RK4 = (
    "cost of a step, Forest-Ruth / RK4",
    "position error at the same step, Forest-Ruth / RK4",
    "run time for the same error, RK4 / Forest-Ruth",
)
METHOD = "velocity_verlet"
POINTS, INSTANTS = 10, 20
LENGTH = 2.0  # [m], of the wire
U = (np.arange(POINTS) + 0.5) / POINTS * LENGTH
NINE, COLUMN = CONTROL_POINTS.index(9), SAMPLES.index(101)  # the model in the figures
ERROR = "rms error, n_u = {} [mm]".format
CHANGE = "change of the error over n_s from {} up, n_u = {} [%]".format
CENTRE = "error beside the centre / largest, n_u = {}".format
EARLY, LATE = (f"rms error in the {when} quarter, (9, 101) [mm]" for when in ("first", "last"))
FINER = (31, 409)


def add(paper: Paper) -> None:
    """Add error against run time of the real and the softened wire, and Forest-Ruth against RK4:
    the ratio of run times at equal error, and cost and error of a step of the same size.
    """
    real, changed = scenario(1), f"EA and springs CHANGED: / {paper.factor:.0f}"
    wires = {"real wire": (real, *REAL), changed: (softened(real, paper.factor), *SOFT)}
    rows = [row for name, wire in wires.items() for row in _curves(paper, name, *wire)]
    paper.report.chart(
        "work_precision",
        "wire | method | run time [s] | largest position error [m]",
        rows,
        f"Accuracy against run time of {SPAN[paper.quick]:g} s, scenario 1; left ends: 0.9 of the "
        "stability limits",
        "xy",
        marker="o",
    )
    ratios = _time_ratios([row[1:] for row in rows if row[0] == changed])
    paper.report.table(
        "time_at_equal_error",
        "method | run time / Forest-Ruth's",
        ratios.items(),
        "Run time for the same position error (the geometric mean of the range that both "
        "fourth-order methods reach), softened wire; none: not reached at any step tried",
    )
    step = Simulator(at_method(real, "forest_ruth")).step
    both = [at_method(real, method, step) for method in ("forest_ruth", "rk4")]
    runs = [(at, SPAN[paper.quick], 0.01) for at in (at_method(real, "rk4", step / 8), *both)]
    fine, *recordings = each(paper.workers, run, runs).values()
    costs = [step_cost(Simulator(at)).best for at in both]
    errors = [float(distance(recording, fine).max()) for recording in recordings]
    found = (costs[0] / costs[1], errors[0] / errors[1], ratios["rk4"])
    paper.found |= dict(zip(BESIDE_RK4, found, strict=True))


def _curves(
    paper: Paper, name: str, scene: Scene, shares: tuple[int, ...], grid: float
) -> list[tuple[str, str, float, float]]:
    """Rows of the chart; errors by workers, cost of a step timed in this process."""
    duration = SPAN[paper.quick]
    every = grid * max(1, round(duration / 200 / grid))  # some 200 samples
    own = {method: Simulator(at_method(scene, method)).step for method in COMPARED}
    largest = {method: grid / float(np.ceil(grid / step)) for method, step in own.items()}
    steps = [(method, largest[method] / share) for method in COMPARED for share in shares]
    wanted = [("forest_ruth", largest["forest_ruth"] / 16), *steps]
    runs = [(at_method(scene, *one), duration, every) for one in wanted]
    fine, *recordings = each(paper.workers, run, runs).values()
    cost = {m: step_cost(Simulator(at_method(scene, m, largest[m]))).best for m in COMPARED}
    return [
        (name, method, cost[method] * duration / step, float(distance(one, fine).max()))
        for (method, step), one in zip(steps, recordings, strict=True)
    ]


def _time_ratios(rows: list[tuple[str, float, float]]) -> dict[str, float]:
    """Run time relative to Forest-Ruth's at the middle of the range of errors that it and RK4
    reach; infinite for a method that does not reach it. Rows: method, run time, error."""
    found = {m: np.array([row[1:] for row in rows if row[0] == m]).T for m in COMPARED}
    reached = [found[method][1] for method in ("forest_ruth", "rk4")]
    goal = np.log([max(e.min() for e in reached), min(e.max() for e in reached)]).mean()
    times = {}
    for method, (time, error) in found.items():
        order = np.argsort(error)
        logs = np.log(error[order]), np.log(time[order])
        times[method] = np.exp(np.interp(goal, *logs, left=np.inf))
    return {method: float(time / times["forest_ruth"]) for method, time in times.items()}


def add_resolution(paper: Paper) -> None:
    """Run all resolutions, compare them at fixed points and times, add the four figures."""
    paper.report.text(
        """The error is the distance between the two centerlines at fixed material points and
        times, scenario 1, `velocity_verlet` at each model's own stable step, whose time error is
        far below the differences shown. Reference: n_u = 19, n_s = 251 (the text of the paper says
        256, its tables end at 251); errors below its own error are not resolved."""
    )
    duration = paper.comparison
    grid = list(product(CONTROL_POINTS, SAMPLES))
    tracks = each(paper.workers, track, [(*size, duration) for size in [*grid, FINER]])
    reference = tracks[(*REFERENCE, duration)]
    *gaps, own = (np.linalg.norm(one - reference, axis=2) for one in tracks.values())
    errors = np.reshape(gaps, (len(CONTROL_POINTS), len(SAMPLES), INSTANTS, POINTS))
    rms = _rms(errors, (2, 3))
    # In mm, as in the caption, because the headers are numbers of samples without a unit.
    rows: list[list[Any]] = [[n, *row] for n, row in zip(CONTROL_POINTS, 1e3 * rms, strict=True)]
    rows.append(["reference itself", *([None] * (len(SAMPLES) - 1)), 1e3 * float(_rms(own))])
    header = " | ".join(["n_u \\ n_s", *map(str, SAMPLES)])
    caption = "Error against the reference model, rms over points and instants [mm], scenario 1"
    paper.report.table("error_by_size", header, rows, caption, form=".3g")
    _figures(paper, errors, np.linspace(0.0, duration, INSTANTS + 1)[1:])
    profiles = errors[:, COLUMN].mean(axis=1)
    middle = profiles[:, POINTS // 2 - 1 : POINTS // 2 + 1].mean(axis=1)
    shares = middle / profiles.max(axis=1)
    found = paper.found
    for n, row, share in zip(CONTROL_POINTS[:-1], rms, shares, strict=False):
        found[ERROR(n)], found[CENTRE(n)] = 1e3 * float(row[COLUMN]), float(share)
        for first, part in ((51, row), (81, row[1:])):
            found[CHANGE(first, n)] = float(100 * np.ptp(part) / part.min())
    quarter = INSTANTS // 4
    found[EARLY] = 1e3 * float(_rms(errors[NINE, COLUMN, :quarter]))
    found[LATE] = 1e3 * float(_rms(errors[NINE, COLUMN, -quarter:]))
    found["rms error of the reference itself [mm]"] = 1e3 * float(_rms(own))


def track(n: int, samples: int, duration: float) -> Array:
    """Centreline at the fixed points and times, shape (INSTANTS, POINTS, 3)."""
    scene = scenario(1, discretization__control_points=n, discretization__samples=samples)
    recording = run(at_method(scene, METHOD), duration, duration / INSTANTS)
    basis = bspline.evaluate(np.eye(n), bspline.clamped_knots(n, scene.cable.length), U)
    return np.asarray(basis @ recording.control_points[1 : INSTANTS + 1, :, :3])


def _rms(errors: Array, axis: int | tuple[int, ...] | None = None) -> Array:
    return np.asarray(np.sqrt((errors**2).mean(axis=axis)))


def _figures(paper: Paper, errors: Array, time: Array) -> None:
    """Add the paper's figures of the error: over time, length, n_s and n_u."""
    report, sizes = paper.report, product(CONTROL_POINTS, SAMPLES)
    places = [(t, u) for t in time.round(6).tolist() for u in U.tolist()]
    rows = [(*at, one) for at, one in zip(places, errors[NINE, COLUMN].ravel(), strict=True)]
    caption = "Error over time and length, n_u = 9, n_s = 101"
    header = "time [s] | material coordinate u [m] | error [mm]"
    report.heat_map("error_over_time_and_length", header, rows, caption)
    rows = [(*at, one) for at, one in zip(sizes, _rms(errors, (2, 3)).ravel(), strict=True)]
    header, caption = "n_u | n_s | rms error [mm] {:.3g}", "Error over n_s and n_u"
    report.heat_map("error_over_samples_and_points", header, rows, caption)
    for what, over, label, x, axis in (
        ("time", "length", "time [s]", time, 2),
        ("length", "time", "material coordinate u [m]", U, 1),
    ):
        values = zip(CONTROL_POINTS, _rms(errors[:, COLUMN], axis), strict=True)
        lines = curves(x, {f"n_u = {n}": row for n, row in values})
        header = f"n_u | {label} | error, rms over {over} [mm]"
        caption = f"Error over {what} for each n_u, n_s = 101"
        report.chart(f"error_over_{what}", header, lines, caption, "y")
