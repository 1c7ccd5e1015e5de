"""Order on a nonlinear scene, accuracy against run time, error against the reference model."""

from __future__ import annotations

from itertools import product
from typing import Any

import numpy as np

from dlo_sim.core import bspline
from dlo_sim.core.methods import METHODS
from dlo_sim.scene.description import Scene
from dlo_sim.scene.loading import scene_from_values
from dlo_sim.simulation.simulator import Simulator
from dlo_sim.studies.paper.published import CONTROL_POINTS, REFERENCE, SAMPLES
from dlo_sim.studies.paper.wires import COMPARED, Paper, scenario, softened
from dlo_sim.studies.plotting import Curves, curves, draw, heat_map, new_figure
from dlo_sim.studies.report import columns
from dlo_sim.studies.runs import Array, at_method, distance, each, run, step_cost

# A soft strip, clamped, with a swinging force and moment at its free end: large bending.
STRIP = {
    "cable.length": 0.5,
    "cable.diameter": 0.02,
    "cable.youngs_modulus": 1.0e5,
    "discretization.control_points": 6,
    "start.clamped": True,
    "end.position": [0.5, 0.0, 0.0],
    "loads.names": ["tip"],
    "loads.tip.signal": "sine",
    "loads.tip.force": [0.0, 0.6, 0.2],
    "loads.tip.torque": [0.0, 0.01, 0.0],
    "loads.tip.frequency": 4.0,
    "terms.twist": "off",
}
DURATION = 0.08
STEPS = (400, 566, 800, 1131)
FINE = 6400
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


def _strip_end(method: str, steps: int) -> Array:
    simulator = Simulator(at_method(scene_from_values(STRIP), method, DURATION / steps))
    simulator.advance_steps(steps)
    return simulator.control_points[:, :3]


def add(paper: Paper) -> None:
    """Add the table of orders, and work-precision diagrams of the real and the softened wire."""
    wanted = [("forest_ruth", FINE), ("rk4", FINE)]
    wanted += [(method, n) for method in COMPARED for n in STEPS]
    ends = each(paper.workers, _strip_end, wanted)
    rows: list[list[Any]] = []
    for method in COMPARED:
        reference = ends["forest_ruth" if method == "rk4" else "rk4", FINE]
        errors = [float(np.abs(ends[method, n] - reference).max()) for n in STEPS]
        order = -float(np.polyfit(np.log(STEPS), np.log(errors), 1)[0])
        rows.append([method, METHODS[method].order, order, *errors])
    paper.report.table(
        "orders",
        ["method", "order", "measured", *(f"error [m], {n} steps" for n in STEPS)],
        rows,
        f"Order on a nonlinear scene: a soft strip swung by a force and a moment for "
        f"{DURATION:g} s, against the other fourth-order method with {FINE} steps",
    )
    _work_precision(paper)
    _equal_step(paper)


def _work_precision(paper: Paper) -> None:
    """Add error against run time, and the ratios of run times at equal error, softened wire."""
    real, changed = scenario(1), f"EA and springs CHANGED: / {paper.factor:.0f}"
    wires = {"real wire": (real, *REAL), changed: (softened(real, paper.factor), *SOFT)}
    rows = [row for name, wire in wires.items() for row in _curves(paper, name, *wire)]
    looks = {m: {"marker": mark} for m, mark in zip(COMPARED, "osx^", strict=True)}
    x, y = f"run time of {SPAN[paper.quick]:g} s [s]", "largest position error [m]"
    figure, panels = new_figure(1, 2, 11.0, 4.6)
    for axes, name in zip(panels, wires, strict=True):
        lines = curves([row for row in rows if row[0] == name], 1, 3, 4)
        draw(axes, lines, x, y, "xy", name, looks)
    data = columns(("wire", "method", "step [s]", "run time [s]", "error [m]"), rows)
    caption = "Accuracy against run time, scenario 1; left ends: 0.9 of the stability limits"
    paper.report.figure("work_precision", figure, data, caption)
    ratios = _time_ratios(lines)
    paper.report.table(
        "time_at_equal_error",
        ["method", "run time / Forest-Ruth's"],
        [[method, ratio] for method, ratio in ratios.items()],
        "Run time for the same position error (the geometric mean of the range that both "
        "fourth-order methods reach), softened wire; none: not reached at any step tried",
    )
    paper.found[BESIDE_RK4[2]] = ratios["rk4"]


def _curves(
    paper: Paper, name: str, scene: Scene, shares: tuple[int, ...], grid: float
) -> list[tuple[str, str, float, float, float]]:
    """Rows of the figure's data; errors by workers, cost of a step timed in this process."""
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
        (name, method, step, cost[method] * duration / step, float(distance(one, fine).max()))
        for (method, step), one in zip(steps, recordings, strict=True)
    ]


def _time_ratios(lines: Curves) -> dict[str, float]:
    """Run time relative to Forest-Ruth's at the middle of the range of errors that it and RK4
    reach; infinite for a method that does not reach it."""
    found = {method: (np.array(time), np.array(error)) for method, (time, error) in lines.items()}
    reached = [found[method][1] for method in ("forest_ruth", "rk4")]
    goal = np.log([max(e.min() for e in reached), min(e.max() for e in reached)]).mean()
    times = {}
    for method, (time, error) in found.items():
        order = np.argsort(error)
        logs = np.log(error[order]), np.log(time[order])
        times[method] = np.exp(np.interp(goal, *logs, left=np.inf))
    return {method: float(time / times["forest_ruth"]) for method, time in times.items()}


def _equal_step(paper: Paper) -> None:
    """Forest-Ruth against RK4 at the same step: cost of a step, position error."""
    scene = scenario(1)
    step = Simulator(at_method(scene, "forest_ruth")).step
    both = [at_method(scene, method, step) for method in ("forest_ruth", "rk4")]
    runs = [(at, SPAN[paper.quick], 0.01) for at in (at_method(scene, "rk4", step / 8), *both)]
    fine, *recordings = each(paper.workers, run, runs).values()
    costs = [step_cost(Simulator(at)).best for at in both]
    errors = [float(distance(recording, fine).max()) for recording in recordings]
    paper.found |= {BESIDE_RK4[0]: costs[0] / costs[1], BESIDE_RK4[1]: errors[0] / errors[1]}


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
    _table(paper, errors, _rms(own))
    _figures(paper, errors, np.linspace(0.0, duration, INSTANTS + 1)[1:])
    _findings(paper, errors)
    paper.found["rms error of the reference itself [mm]"] = 1e3 * float(_rms(own))


def track(n: int, samples: int, duration: float) -> Array:
    """Centreline at the fixed points and times, shape (INSTANTS, POINTS, 3)."""
    scene = scenario(1, discretization__control_points=n, discretization__samples=samples)
    recording = run(at_method(scene, METHOD), duration, duration / INSTANTS)
    basis = bspline.evaluate(np.eye(n), bspline.clamped_knots(n, scene.cable.length), U)
    return np.asarray(basis @ recording.control_points[1 : INSTANTS + 1, :, :3])


def _rms(errors: Array, axis: int | tuple[int, ...] | None = None) -> Array:
    return np.asarray(np.sqrt((errors**2).mean(axis=axis)))


def _table(paper: Paper, errors: Array, own: Array) -> None:
    # In mm, as in the caption, because the headers are numbers of samples without a unit.
    rms = 1e3 * _rms(errors, (2, 3))
    rows: list[list[Any]] = [[n, *row] for n, row in zip(CONTROL_POINTS, rms, strict=True)]
    rows.append(["reference itself", *([None] * (len(SAMPLES) - 1)), 1e3 * float(own)])
    paper.report.table(
        "error_by_size",
        ["n_u \\ n_s", *map(str, SAMPLES)],
        rows,
        "Error against the reference model, rms over points and instants [mm], scenario 1",
        form=".3g",
    )


def _figures(paper: Paper, errors: Array, time: Array) -> None:
    report, shown = paper.report, errors[NINE, COLUMN]
    figure, (axes,) = new_figure(width=8.0, height=4.5)
    image = axes.pcolormesh(U, time, 1e3 * shown, shading="nearest", cmap="magma")
    figure.colorbar(image, ax=axes, label="error [mm]")
    axes.set(xlabel="material coordinate u [m]", ylabel="time [s]", title="n_u = 9, n_s = 101")
    grid = {"time [s]": np.repeat(time, POINTS), "u [m]": np.tile(U, INSTANTS)}
    data = grid | {"error [m]": shown.ravel()}
    report.figure("error_over_time_and_length", figure, data, "Error over time and length")
    n_u, n_s = np.array(list(product(CONTROL_POINTS, SAMPLES))).T
    rms = _rms(errors, (2, 3))
    figure = heat_map(CONTROL_POINTS, SAMPLES, 1e3 * rms, "rms error [mm]", ".3g")
    figure.axes[0].set(xlabel="n_s", ylabel="n_u")
    data = {"n_u": n_u, "n_s": n_s, "rms error [m]": rms.ravel()}
    report.figure("error_over_samples_and_points", figure, data, "Error over n_s and n_u")
    for what, over, name, x, axis in (
        ("time", "length", "time [s]", time, 2),
        ("length", "time", "material coordinate u [m]", U, 1),
    ):
        values = _rms(errors[:, COLUMN], axis)
        lines = {f"n_u = {n}": row for n, row in zip(CONTROL_POINTS, values, strict=True)}
        figure, (axes,) = new_figure(width=8.5, height=4.6)
        shown_lines = {label: (x, 1e3 * row) for label, row in lines.items()}
        draw(axes, shown_lines, name, f"error, rms over {over} [mm]", "y")
        caption = f"Error over {what} for each n_u, n_s = 101"
        report.figure(f"error_over_{what}", figure, {name: x} | lines, caption)


def _findings(paper: Paper, errors: Array) -> None:
    found, rms = paper.found, _rms(errors, (2, 3))
    profiles = errors[:, COLUMN].mean(axis=1)
    middle = profiles[:, POINTS // 2 - 1 : POINTS // 2 + 1].mean(axis=1)
    shares = middle / profiles.max(axis=1)
    for n, row, share in zip(CONTROL_POINTS[:-1], rms, shares, strict=False):
        found[ERROR(n)], found[CENTRE(n)] = 1e3 * float(row[COLUMN]), float(share)
        for first, part in ((51, row), (81, row[1:])):
            found[CHANGE(first, n)] = float(100 * np.ptp(part) / part.min())
    quarter = INSTANTS // 4
    found[EARLY] = 1e3 * float(_rms(errors[NINE, COLUMN, :quarter]))
    found[LATE] = 1e3 * float(_rms(errors[NINE, COLUMN, -quarter:]))
