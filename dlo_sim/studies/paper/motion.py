"""The motion in both scenarios: the paper's figures of control points and shapes."""

from __future__ import annotations

import numpy as np
from matplotlib.cm import ScalarMappable
from matplotlib.collections import LineCollection
from matplotlib.colors import Normalize

from dlo_sim.simulation.recording import Recording
from dlo_sim.studies.paper.wires import SCENARIOS, Paper, scenario
from dlo_sim.studies.plotting import animate, draw, new_figure
from dlo_sim.studies.runs import Array, at_method, distance, each, run

DURATION = {True: 2.0, False: 10.0}  # [s]
EVERY = 0.005  # [s] between samples
SHAPES = 40  # shapes in a still
START = 1.0  # [s], start of the motion shown enlarged
OTHERS = ("rk4", "velocity_verlet")  # whose runs of scenario 2 are compared with Forest-Ruth's
APART = 1e-3  # [m]
PLANE = "largest |y| in scenario 1, computed in space [m]"
MIRRORED = "largest difference of mirrored z / sag, scenario 1"
COORDINATES = ((1, "x"), (1, "z"), (2, "x"), (2, "y"), (2, "z"))
SIDEWAYS = {1: (("z", 2),), 2: (("z", 2), ("y", 1))}


def add(paper: Paper) -> None:
    """Run both scenarios with Forest-Ruth and add their figures."""
    paper.report.text(
        """Forest-Ruth at its own step; x is drawn as the displacement from the start. Scenario 2 is
        chaotic: differences of the size of round-off between two fourth-order methods grow
        exponentially, so later positions are one of many equally valid motions, whatever the
        integrator; then mirrored control points diverge too."""
    )
    spatial = scenario(1, terms__out_of_plane="on")
    wanted = [(number, "forest_ruth") for number in SCENARIOS] + [(2, m) for m in OTHERS]
    cases = [(at_method(scenario(k), m), DURATION[paper.quick], EVERY) for k, m in wanted]
    cases.append((at_method(spatial, "forest_ruth"), START, EVERY))
    *found, in_space = each(paper.workers, run, cases).values()
    first, second, *others = found
    recordings = {1: first, 2: second}
    for number, name in COORDINATES:
        _coordinate(paper, recordings[number], number, name)
    for number, recording in recordings.items():
        _shapes(paper, recording, number)
        _animation(paper, recording, number)
    gaps = {m: distance(one, second) for m, one in zip(OTHERS, others, strict=True)}
    _parting(paper, second.time, gaps)
    z = first.control_points[:, :, 2]
    sag = -float(first.centerline[:, :, 2].min())
    paper.found["largest sag, scenario 1 [mm]"] = 1e3 * sag
    paper.found[MIRRORED] = float(np.abs(z - z[:, ::-1]).max() / sag)
    paper.found[PLANE] = float(np.abs(in_space.control_points[:, :, 1]).max())


def _parting(paper: Paper, time: Array, gaps: dict[str, Array]) -> None:
    """Add the divergence of runs of scenario 2: when they are APART, and the exponential rate."""
    figure, (axes,) = new_figure(width=8.5, height=4.6)
    axes.axhline(APART, color="gray", linestyle=":", label="1 mm")
    lines = {method: (time[1:], gap[1:]) for method, gap in gaps.items()}
    draw(axes, lines, "time [s]", "largest distance from forest_ruth [m]", "y")
    data = {"time [s]": time[1:]} | {method: gap[1:] for method, gap in gaps.items()}
    caption = "Two methods in scenario 2, each at 0.9 of its stability limit"
    paper.report.figure("scenario_2_parting", figure, data, caption)
    far = np.flatnonzero(gaps["rk4"] > APART)
    end = int(far[0]) if far.size else len(time)
    envelope = np.maximum.accumulate(gaps["rk4"])[1:end]
    rate = np.polyfit(time[1:end], np.log(envelope + 1e-18), 1)[0]
    paper.found["two methods 1 mm apart in scenario 2 from [s]"] = (
        float(time[end]) if far.size else float("inf")
    )
    paper.found["rate at which they part [1/s]"] = float(rate)


def _coordinate(paper: Paper, recording: Recording, number: int, name: str) -> None:
    values = recording.control_points[:, :, "xyz".index(name)]
    if name == "x":
        values = values - values[0]
    what = "displacement along x" if name == "x" else name
    figure, panels = new_figure(2, 1, 9.0, 6.0)
    for axes, until in zip(panels, (np.inf, START), strict=True):
        early = recording.time <= until
        lines = {
            f"{name} of q{i + 1}": (recording.time[early], 1e3 * row[early])
            for i, row in enumerate(values.T)
        }
        draw(axes, lines, "time [s]", f"{what} [mm]")
    data = {"time [s]": recording.time}
    data |= {f"{name} of q{i + 1} [m]": row for i, row in enumerate(values.T)}
    caption = f"{what} of every control point, {SCENARIOS[number]}; below: the first {START:g} s"
    if (number, name) == (1, "z"):
        caption += "; mirrored control points lie on one curve"
    paper.report.figure(f"scenario_{number}_{name}", figure, data, caption)


def _shapes(paper: Paper, recording: Recording, number: int) -> None:
    chosen = np.unique(np.linspace(0, len(recording.time) - 1, SHAPES).astype(int))
    views = SIDEWAYS[number]
    figure, all_axes = new_figure(len(views), 1, 9.0, 3.6 * len(views))
    scale = Normalize(0.0, float(recording.time[-1]))
    for axes, (name, axis) in zip(all_axes, views, strict=True):
        curves = recording.centerline[chosen][:, :, [0, axis]] * [1.0, 1e3]
        lines = LineCollection(list(curves), cmap="viridis", norm=scale, linewidths=1.0)
        lines.set_array(recording.time[chosen])
        axes.add_collection(lines)
        axes.autoscale()
        axes.set(xlabel="x [m]", ylabel=f"{name} [mm] (stretched scale)")
        axes.grid(alpha=0.3)
    figure.colorbar(ScalarMappable(scale, "viridis"), ax=all_axes, label="time [s]")
    caption = f"Sequence of shapes, {SCENARIOS[number]}, time as colour"
    data = _shape_data(recording, chosen)
    paper.report.figure(f"scenario_{number}_shapes", figure, data, caption)


def _shape_data(recording: Recording, chosen: Array) -> dict[str, Array]:
    points = recording.centerline[chosen]
    data = {
        "time [s]": np.repeat(recording.time[chosen], points.shape[1]),
        "u [m]": np.tile(recording.centerline_u, len(chosen)),
    }
    return data | {f"{name} [m]": points[:, :, i].ravel() for i, name in enumerate("xyz")}


def _animation(paper: Paper, recording: Recording, number: int) -> None:
    frames = 10 if paper.quick else 100
    chosen = np.linspace(0, len(recording.time) - 1, frames).astype(int)
    views = SIDEWAYS[number]
    figure, all_axes = new_figure(len(views), 1, 6.0, 2.6 * len(views))
    curves = []
    for axes, (name, axis) in zip(all_axes, views, strict=True):
        values = 1e3 * recording.centerline[:, :, axis]
        margin = 0.05 * float(np.ptp(values))
        axes.set(xlim=(-0.05, 2.05), ylim=(values.min() - margin, values.max() + margin))
        axes.set(xlabel="x [m]", ylabel=f"{name} [mm]")
        axes.grid(alpha=0.3)
        curves.append((axes.plot([], [], linewidth=2.0)[0], axis))

    def draw(frame: int) -> None:
        points = recording.centerline[chosen[frame]]
        for curve, axis in curves:
            curve.set_data(points[:, 0], 1e3 * points[:, axis])
        all_axes[0].set_title(f"{SCENARIOS[number]}, t = {recording.time[chosen[frame]]:.2f} s")

    file = f"scenario_{number}_animation.gif"
    animate(paper.report.folder / file, figure, draw, frames, 10)
    caption = f"Animation, {SCENARIOS[number]} (stretched scale)"
    paper.report.attach(file, _shape_data(recording, chosen), caption)
