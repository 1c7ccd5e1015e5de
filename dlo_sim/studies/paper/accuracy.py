"""Measured order of every method on a nonlinear scene, and accuracy against run time."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from matplotlib.ticker import NullFormatter

from dlo_sim.batch.workers import Workers
from dlo_sim.core.methods import METHODS
from dlo_sim.scene.description import Scene
from dlo_sim.scene.loading import scene_from_values
from dlo_sim.simulation.simulator import Simulator
from dlo_sim.studies import plotting
from dlo_sim.studies.paper.runs import (
    COMPARED,
    SHARE,
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
from dlo_sim.studies.report import Cell, Report
from dlo_sim.studies.stopwatch import step_cost

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


@dataclass(frozen=True)
class Accuracy:
    """Measured orders, and at equal error the run time over that of Forest-Ruth, by method."""

    orders: dict[str, float]
    softened_ratio: dict[str, float]
    equal_step_ratio: float
    equal_step_error: float


def add(report: Report, settings: Settings, workers: Workers, factor: float) -> Accuracy:
    """Order table, work-precision of the real and of the softened wire."""
    report.section("Order and accuracy for the time spent")
    orders = _orders(report, workers)
    ratios, step_ratio, error_ratio = _work_precision(report, settings, workers, factor)
    return Accuracy(orders, ratios, step_ratio, error_ratio)


def _strip_end(method: str, steps: int) -> Array:
    scene = at_method(scene_from_values(STRIP), method, DURATION / steps)
    simulator = Simulator(scene)
    simulator.advance_steps(steps)
    return simulator.control_points[:, :3]


def _orders(report: Report, workers: Workers) -> dict[str, float]:
    wanted = [("forest_ruth", FINE), ("rk4", FINE)]
    wanted += [(method, n) for method in COMPARED for n in STEPS]
    ends = dict(zip(wanted, each(workers, _strip_end, wanted), strict=True))
    rows: list[list[Cell]] = []
    orders = {}
    for method in COMPARED:
        reference = ends["forest_ruth" if method == "rk4" else "rk4", FINE]
        errors = [float(np.abs(ends[method, n] - reference).max()) for n in STEPS]
        orders[method] = -float(np.polyfit(np.log(STEPS), np.log(errors), 1)[0])
        rows.append([method, METHODS[method].order, orders[method], *errors])
    header = ["method", "order", "measured", *(f"error [m], {n} steps" for n in STEPS)]
    report.table(
        "orders",
        header,
        rows,
        f"Order on a nonlinear scene: a soft strip swung by a force and a moment for "
        f"{DURATION:g} s, against the other fourth-order method with {FINE} steps",
    )
    return orders


@dataclass(frozen=True)
class Wire:
    """A wire whose accuracy is compared with run time.

    Attributes:
        title: for people. scene: it. shares: divisors of the largest step that are tried.
        grid: [s]; every step divides it, so that samples are at ends of steps.
    """

    title: str
    scene: Scene
    shares: tuple[int, ...]
    grid: float


@dataclass(frozen=True)
class Curve:
    """Of one method: steps [s], run times [s] of the whole run, largest position errors [m]."""

    steps: Array
    times: Array
    errors: Array


def _work_precision(
    report: Report, settings: Settings, workers: Workers, factor: float
) -> tuple[dict[str, float], float, float]:
    """Error against run time; run time at equal error over Forest-Ruth's, on the softened wire."""
    changed = f"constants CHANGED: axial and springs / {factor:.0f}"
    wires = {
        "real": Wire("real wire", scenario(1), (1, 2, 4), 2e-5),
        "softened": Wire(changed, softened(scenario(1), factor), (1, 2, 4, 8), 4e-3),
    }
    curves = {name: _curves(wire, settings.comparison, workers) for name, wire in wires.items()}
    _work_precision_figure(report, wires, curves, settings.comparison)
    soft = curves["softened"]
    ratios = {m: _time_at(soft[m], soft) / _time_at(soft["forest_ruth"], soft) for m in COMPARED}
    rows: list[list[Cell]] = [[m, ratios[m]] for m in COMPARED]
    report.table(
        "time_at_equal_error",
        ["method", "run time / Forest-Ruth's"],
        rows,
        "Run time for the same position error (the geometric middle of what both fourth-order "
        "methods reach), softened wire",
    )
    step_ratio, error_ratio = _equal_step(report, settings, workers)
    return ratios, step_ratio, error_ratio


def _curves(wire: Wire, duration: float, workers: Workers) -> dict[str, Curve]:
    """Errors from runs by workers, cost of a step from this machine."""
    every = _every(wire.grid, duration)
    steps = {
        method: _divisor(wire.scene, method, wire.grid) / np.array(wire.shares, dtype=float)
        for method in COMPARED
    }
    finest = _divisor(wire.scene, "forest_ruth", wire.grid) / 16
    wanted = [("forest_ruth", finest), *((m, float(s)) for m in COMPARED for s in steps[m])]
    runs = [(at_method(wire.scene, *one), duration, every) for one in wanted]
    fine, *found = each(workers, run, runs)
    errors = iter([float(distance(recording, fine).max()) for recording in found])
    curves = {}
    for method in COMPARED:
        simulator = Simulator(at_method(wire.scene, method, float(steps[method][0])))
        times = step_cost(simulator).best * duration / steps[method]
        off = np.array([next(errors) for _ in steps[method]])
        curves[method] = Curve(steps[method], times, off)
    return curves


def _work_precision_figure(
    report: Report,
    wires: dict[str, Wire],
    curves: dict[str, dict[str, Curve]],
    duration: float,
) -> None:
    figure, all_axes = plotting.new_figure(1, 2, width=11.0, height=4.6)
    for axes, (name, wire) in zip(all_axes, wires.items(), strict=True):
        for method, curve in curves[name].items():
            style = {"color": plotting.COLORS[method], "marker": plotting.MARKERS[method]}
            axes.loglog(curve.times, curve.errors, label=method, **style)
        axes.set_xlabel(f"run time of {duration:g} s [s] (steps times cost of a step)")
        axes.set_ylabel("largest position error [m]")
        axes.set_title(wire.title)
        axes.grid(alpha=0.3, which="both")
        axes.xaxis.set_minor_formatter(NullFormatter())
        axes.legend()
    drawn = [(name, m, curve) for name, own in curves.items() for m, curve in own.items()]
    report.figure(
        "work_precision",
        figure,
        {
            "wire": np.repeat([name for name, _, _ in drawn], [len(c.steps) for _, _, c in drawn]),
            "method": np.repeat([m for _, m, _ in drawn], [len(c.steps) for _, _, c in drawn]),
            "step [s]": np.concatenate([curve.steps for _, _, curve in drawn]),
            "run time [s]": np.concatenate([curve.times for _, _, curve in drawn]),
            "error [m]": np.concatenate([curve.errors for _, _, curve in drawn]),
        },
        "Accuracy for the time spent, scenario 1; the left ends are at 0.9 of the stability limits",
    )


def _divisor(scene: Scene, method: str, grid: float) -> float:
    """Largest step [s] below the method's own that divides the sampling grid."""
    step = SHARE * step_limit(scene, method)
    return grid / float(np.ceil(grid / step * (1.0 + 1e-9)))


def _every(grid: float, duration: float) -> float:
    """Sampling interval [s]: some 200 samples on multiples of the grid."""
    return grid * max(1, round(duration / 200 / grid))


def _time_at(curve: Curve, curves: dict[str, Curve]) -> float:
    """Run time at the middle of the errors that Forest-Ruth and RK4 reach, on the log-log curve."""
    reached = [curves[m].errors for m in ("forest_ruth", "rk4")]
    goal = np.exp(
        np.mean([np.log(max(e.min() for e in reached)), np.log(min(e.max() for e in reached))])
    )
    return float(np.exp(_interpolate(np.log(goal), np.log(curve.errors), np.log(curve.times))))


def _interpolate(x: float, xs: Array, ys: Array) -> float:
    """Piecewise linear through falling xs, continued straight beyond both ends."""
    order = np.argsort(xs)
    xs, ys = xs[order], ys[order]
    i = int(np.clip(np.searchsorted(xs, x), 1, len(xs) - 1))
    return float(ys[i - 1] + (x - xs[i - 1]) * (ys[i] - ys[i - 1]) / (xs[i] - xs[i - 1]))


def _equal_step(report: Report, settings: Settings, workers: Workers) -> tuple[float, float]:
    """Forest-Ruth over RK4 at the same step: cost of a step, position error."""
    scene = scenario(1)
    step = Simulator(at_method(scene, "forest_ruth")).step
    both = [at_method(scene, method, step) for method in ("forest_ruth", "rk4")]
    runs = [(at, settings.comparison, 0.01) for at in (at_method(scene, "rk4", step / 8), *both)]
    fine, *recordings = each(workers, run, runs)
    costs = [step_cost(Simulator(at)).best for at in both]
    errors = [float(distance(recording, fine).max()) for recording in recordings]
    report.text(
        f"""At the same step ({1e6 * step:.4g} us, real wire) Forest-Ruth takes
        {100 * (1 - costs[0] / costs[1]):.0f} % less time than RK4 (three force evaluations against
        four: 25 %), and its position error is {errors[0] / errors[1]:.2g} times as large."""
    )
    return costs[0] / costs[1], errors[0] / errors[1]
