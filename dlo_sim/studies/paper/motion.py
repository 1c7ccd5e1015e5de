"""The motion of both scenarios: the paper's figures of control points and of shapes."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from matplotlib.cm import ScalarMappable
from matplotlib.collections import LineCollection
from matplotlib.colors import Normalize

from dlo_sim.batch.workers import Workers
from dlo_sim.scene.description import Scene
from dlo_sim.simulation.recording import Recording
from dlo_sim.studies import plotting
from dlo_sim.studies.paper.runs import (
    SCENARIOS,
    Array,
    Settings,
    at_method,
    distance,
    each,
    run,
    scenario,
)
from dlo_sim.studies.report import Report

EVERY = 0.005  # [s] between samples
SHAPES = 40  # shapes in a still
START = 1.0  # [s] shown larger
OTHERS = ("rk4", "velocity_verlet")  # whose runs of scenario 2 are compared with Forest-Ruth's
AXES = {"x": 0, "y": 1, "z": 2}


@dataclass(frozen=True)
class Motion:
    """What the claims need of the motion.

    Attributes:
        largest_y: largest |y| in scenario 1, computed with all three coordinates [m].
        asymmetry: largest difference of z between mirrored control points, as a share of the sag.
        sag: deepest point of the centerline in scenario 1 and 2 [m].
        parted: time [s] at which two methods' runs of scenario 2 are 1 mm apart; inf if never.
        rate: exponential growth of their distance before that [1/s].
    """

    largest_y: float
    asymmetry: float
    sag: dict[int, float]
    parted: float
    rate: float
    recordings: dict[int, Recording]


def add(report: Report, settings: Settings, workers: Workers) -> Motion:
    """Run both scenarios with Forest-Ruth and draw them."""
    report.section("The motion")
    spatial = at_method(scenario(1, terms__out_of_plane="on"), "forest_ruth")
    wanted: dict[int | str, tuple[Scene, str]]
    wanted = {number: (scenario(number), "forest_ruth") for number in SCENARIOS}
    wanted |= {method: (scenario(2), method) for method in OTHERS}
    runs = [(at_method(*one), settings.duration, EVERY) for one in wanted.values()]
    runs.append((spatial, min(settings.duration, 1.0), EVERY))
    *found, full = each(workers, run, runs)
    by_name = dict(zip(wanted, found, strict=True))
    recordings = {number: by_name[number] for number in SCENARIOS}
    z = recordings[1].control_points[:, :, 2]
    gaps = {method: distance(by_name[method], recordings[2]) for method in OTHERS}
    parted, rate = _parting(recordings[2].time, gaps["rk4"])
    sag = {k: float(-r.centerline[:, :, 2].min()) for k, r in recordings.items()}
    motion = Motion(
        largest_y=float(np.abs(full.control_points[:, :, 1]).max()),
        asymmetry=float(np.abs(z - z[:, ::-1]).max() / sag[1]),
        sag=sag,
        parted=parted,
        rate=rate,
        recordings=recordings,
    )
    report.text(
        f"""Forest-Ruth at {recordings[1].step_s * 1e6:.4g} us, {settings.duration:g} s. With the
        wire's real axial stiffness and springs of 10 kN/m the ends give way by
        {1e3 * _ends(recordings[1]):.2g} mm only, so the wire sags by {1e3 * sag[1]:.3g} mm in
        scenario 1: x is drawn as the displacement from the start, since the coordinates
        themselves would be straight lines."""
    )
    for number, names in ((1, "xz"), (2, "xyz")):
        for name in names:
            _coordinate(report, recordings[number], number, name)
    for number, recording in recordings.items():
        _shapes(report, recording, number)
        _animation(report, settings, recording, number)
    _chaos(report, motion, gaps)
    return motion


def _parting(time: Array, gap: Array) -> tuple[float, float]:
    """Time [s] at which a distance passes 1 mm, and its exponential rate before it [1/s]."""
    far = np.flatnonzero(gap > 1e-3)
    end = int(far[0]) if far.size else len(gap)
    envelope = np.maximum.accumulate(gap)
    chosen = np.arange(1, end)
    rate = np.polyfit(time[chosen], np.log(envelope[chosen] + 1e-18), 1)[0]
    return (float(time[end]) if far.size else float("inf")), float(rate)


def _chaos(report: Report, motion: Motion, gaps: dict[str, Array]) -> None:
    time = motion.recordings[2].time
    figure, (axes,) = plotting.new_figure()
    for method, gap in gaps.items():
        label = f"{method} from forest_ruth"
        axes.semilogy(time[1:], gap[1:], color=plotting.COLORS[method], label=label)
    axes.axhline(1e-3, color="gray", linestyle=":", label="1 mm")
    axes.set_xlabel("time [s]")
    axes.set_ylabel("largest distance between the runs [m]")
    axes.grid(alpha=0.3)
    axes.legend()
    report.figure(
        "scenario_2_parting",
        figure,
        {"time [s]": time} | {f"{method} from forest_ruth [m]": g for method, g in gaps.items()},
        "Two methods in scenario 2, each at 0.9 of its stability limit",
    )
    report.text(
        f"""Scenario 2 is chaotic: differences of rounding size between two fourth-order methods
        grow like exp({motion.rate:.2g} t) and reach 1 mm at {motion.parted:.3g} s. Later positions
        are one of many equally good motions, whatever the integrator; mirrored control points part
        then as well."""
        if np.isfinite(motion.parted)
        else f"""Up to {time[-1]:g} s the methods agree to {max(g.max() for g in gaps.values()):.1g}
        m."""
    )


def _ends(recording: Recording) -> float:
    """How far the ends move along x [m]."""
    x = recording.control_points[:, [0, -1], 0]
    return float(np.abs(x - x[0]).max())


def _coordinate(report: Report, recording: Recording, number: int, name: str) -> None:
    values = recording.control_points[:, :, AXES[name]]
    if name == "x":
        values = values - values[0]
    figure, (whole, start) = plotting.new_figure(2, 1, width=9.0, height=6.0)
    labels = [f"q{i + 1}" for i in range(values.shape[1])]
    what = "displacement along x" if name == "x" else name
    for axes, end in ((whole, recording.time[-1]), (start, START)):
        shown = recording.time <= end
        plotting.lines(axes, recording.time[shown], 1e3 * values[shown], labels)
        axes.set_xlim(0.0, end)
        axes.set_ylabel(f"{what} [mm]")
    start.set_xlabel("time [s]")
    whole.set_title(
        f"{what} of the control points, {SCENARIOS[number]}; below: the first {START:g} s"
    )
    columns = {"time [s]": recording.time}
    columns |= {f"{name} of {label} [m]": values[:, i] for i, label in enumerate(labels)}
    caption = f"{what} of every control point, {SCENARIOS[number]}"
    if number == 1 and name == "z":
        caption += "; mirrored control points lie on one curve"
    report.figure(f"scenario_{number}_{name}", figure, columns, caption)


def _sideways(number: int) -> tuple[tuple[str, int], ...]:
    return (("z", 2),) if number == 1 else (("z", 2), ("y", 1))


def _shapes(report: Report, recording: Recording, number: int) -> None:
    chosen = np.unique(np.linspace(0, len(recording.time) - 1, SHAPES).astype(int))
    views = _sideways(number)
    figure, all_axes = plotting.new_figure(len(views), 1, width=9.0, height=3.6 * len(views))
    scale = Normalize(0.0, float(recording.time[-1]))
    for axes, (name, axis) in zip(all_axes, views, strict=True):
        curves = recording.centerline[chosen][:, :, [0, axis]] * [1.0, 1e3]
        lines = LineCollection(list(curves), cmap=plotting.TIME_MAP, norm=scale, linewidths=1.0)
        lines.set_array(recording.time[chosen])
        axes.add_collection(lines)
        axes.autoscale()
        axes.set_xlabel("x [m]")
        axes.set_ylabel(f"{name} [mm] (stretched scale)")
        axes.grid(alpha=0.3)
    all_axes[0].set_title(f"{SCENARIOS[number]}: {len(chosen)} shapes")
    bar = ScalarMappable(scale, plotting.TIME_MAP)
    figure.colorbar(bar, ax=all_axes, label="time [s]")
    caption = f"Sequence of shapes, {SCENARIOS[number]}, time as colour"
    report.figure(f"scenario_{number}_shapes", figure, _shape_data(recording, chosen), caption)


def _shape_data(recording: Recording, chosen: Array) -> dict[str, Array]:
    points = recording.centerline[chosen]
    count = points.shape[1]
    return {
        "time [s]": np.repeat(recording.time[chosen], count),
        "u [m]": np.tile(recording.centerline_u, len(chosen)),
        "x [m]": points[:, :, 0].ravel(),
        "y [m]": points[:, :, 1].ravel(),
        "z [m]": points[:, :, 2].ravel(),
    }


def _animation(report: Report, settings: Settings, recording: Recording, number: int) -> None:
    frames = 20 if settings.quick else 100
    chosen = np.linspace(0, len(recording.time) - 1, frames).astype(int)
    views = _sideways(number)
    figure, all_axes = plotting.new_figure(len(views), 1, width=6.0, height=2.6 * len(views))
    curves = []
    for axes, (name, axis) in zip(all_axes, views, strict=True):
        values = 1e3 * recording.centerline[:, :, axis]
        margin = 0.05 * float(np.ptp(values))
        axes.set_ylim(float(values.min()) - margin, float(values.max()) + margin)
        axes.set_xlim(-0.05, 2.05)
        axes.set_ylabel(f"{name} [mm]")
        axes.grid(alpha=0.3)
        curves.append((axes.plot([], [], linewidth=2.0)[0], axis))
    all_axes[-1].set_xlabel("x [m]")

    def draw(frame: int) -> None:
        points = recording.centerline[chosen[frame]]
        for curve, axis in curves:
            curve.set_data(points[:, 0], 1e3 * points[:, axis])
        all_axes[0].set_title(f"{SCENARIOS[number]}, t = {recording.time[chosen[frame]]:.2f} s")

    name = f"scenario_{number}_animation"
    plotting.animate(report.folder / f"{name}.gif", figure, draw, frames, 10)
    report.attach(
        name, _shape_data(recording, chosen), f"Animation, {SCENARIOS[number]} (stretched scale)"
    )
