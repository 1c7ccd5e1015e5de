"""Error against the reference model (n_u = 19, n_s = 251): the paper's error figures."""

from __future__ import annotations

from itertools import product

import numpy as np

from dlo_sim.core import bspline
from dlo_sim.studies.paper.published import CONTROL_POINTS, REFERENCE, SAMPLES
from dlo_sim.studies.paper.wires import Paper, scenario
from dlo_sim.studies.plotting import Panel, chart, heat_map, new_figure
from dlo_sim.studies.report import Cell
from dlo_sim.studies.runs import Array, at_method, each, run

METHOD = "velocity_verlet"
POINTS, INSTANTS = 10, 20
LENGTH = 2.0  # [m], of the wire
U = (np.arange(POINTS) + 0.5) / POINTS * LENGTH
NINE, COLUMN = CONTROL_POINTS.index(9), SAMPLES.index(101)  # the model that is shown
ERROR = "rms error, n_u = {} [mm]".format
CHANGE = "change of the error over n_s from {} up, n_u = {} [%]".format
CENTRE = "error beside the centre / largest, n_u = {}".format
EARLY, LATE = (f"rms error in the {when} quarter, (9, 101) [mm]" for when in ("first", "last"))
FINER = (31, 409)


def add(paper: Paper) -> None:
    """Run every resolution, compare at fixed points and instants, draw the four figures."""
    paper.report.text(
        """The error is the distance between the two centerlines at fixed material points and
        instants, scenario 1, `velocity_verlet` at each model's own stable step, whose time error is
        far below the differences shown. Reference: n_u = 19, n_s = 251 (the text of the paper says
        256, its tables end at 251); smaller errors than its own are not known."""
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
    """Centerline at the fixed points and instants, shape (INSTANTS, POINTS, 3)."""
    scene = scenario(1, discretization__control_points=n, discretization__samples=samples)
    recording = run(at_method(scene, METHOD), duration, duration / INSTANTS)
    basis = bspline.evaluate(np.eye(n), bspline.clamped_knots(n, scene.cable.length), U)
    return np.asarray(basis @ recording.control_points[1 : INSTANTS + 1, :, :3])


def _rms(errors: Array, axis: int | tuple[int, ...] | None = None) -> Array:
    return np.asarray(np.sqrt((errors**2).mean(axis=axis)))


def _table(paper: Paper, errors: Array, own: Array) -> None:
    # The caption has the unit, so that the headers are the sample counts; values in mm therefore.
    rms = 1e3 * _rms(errors, (2, 3))
    rows: list[list[Cell]] = [[n, *row] for n, row in zip(CONTROL_POINTS, rms, strict=True)]
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
    data = {"n_u": n_u, "n_s": n_s, "rms error [m]": _rms(errors, (2, 3)).ravel()}
    name, caption = "error_over_samples_and_points", "Error over n_s and n_u"
    heat_map(report, name, data, "rms error [mm]", caption, ".3g")
    for what, over, name, x, axis in (
        ("time", "length", "time [s]", time, 2),
        ("length", "time", "material coordinate u [m]", U, 1),
    ):
        values = _rms(errors[:, COLUMN], axis)
        lines = {f"n_u = {n}": row for n, row in zip(CONTROL_POINTS, values, strict=True)}
        panel = Panel(name, f"error, rms over {over} [mm]", list(lines), log="y")
        caption = f"Error over {what} for each n_u, n_s = 101"
        chart(report, f"error_over_{what}", {name: x} | lines, [panel], caption)


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
