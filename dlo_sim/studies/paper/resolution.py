"""Error against the reference model (n_u = 19, n_s = 251): the paper's error figures."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from dlo_sim.batch.workers import Workers
from dlo_sim.core import bspline
from dlo_sim.simulation.recording import Recording
from dlo_sim.studies import plotting
from dlo_sim.studies.paper import published
from dlo_sim.studies.paper.runs import Array, Settings, at_method, each, run, scenario
from dlo_sim.studies.report import Cell, Report

METHOD = "velocity_verlet"
POINTS, INSTANTS = 10, 20
SHOWN = (9, 101)
FINER = (31, 409)


@dataclass(frozen=True)
class Resolution:
    """Errors [m] against the reference, shape (n_u, n_s, instants, points), and what they say.

    Attributes:
        reference_error: rms difference of the reference itself from a finer model [m].
        n_s_effect: relative change of the rms error over all n_s at fixed n_u, by n_u, without the
            reference's own; n_s_effect_81: the same over n_s from 81 up.
        by_control_points: rms error [m] at n_s = 101 by n_u.
        centre_shares: by n_u at n_s = 101, error of the two points beside the centre over the
            largest along the cable, each a mean over time; largest_at: where that is, as the
            distance from the nearer end [m].
        early, late: rms error of (9, 101) in the first and the last quarter of the run [m].
    """

    errors: Array
    reference_error: float
    n_s_effect: dict[int, float]
    n_s_effect_81: dict[int, float]
    by_control_points: dict[int, float]
    centre_shares: dict[int, float]
    largest_at: dict[int, float]
    early: float
    late: float
    duration: float


def add(report: Report, settings: Settings, workers: Workers) -> Resolution:
    """Run every resolution, compare at fixed points and instants, draw the four figures."""
    report.section("Error against the reference model")
    duration = settings.comparison
    length = scenario(1).cable.length
    u = (np.arange(POINTS) + 0.5) / POINTS * length
    time = np.arange(1, INSTANTS + 1) * np.float64(duration / INSTANTS)
    sizes = [published.REFERENCE, FINER]
    sizes += [(n, samples) for n in published.CONTROL_POINTS for samples in published.SAMPLES]
    tracks = each(workers, _track, [(*size, duration, u) for size in sizes])
    reference, finer, *others = tracks
    errors = np.array([_gap(track, reference) for track in others])
    errors = errors.reshape(len(published.CONTROL_POINTS), len(published.SAMPLES), INSTANTS, POINTS)
    own = _gap(reference, finer)
    shown = errors[published.CONTROL_POINTS.index(SHOWN[0]), published.SAMPLES.index(SHOWN[1])]
    rms = np.sqrt((errors**2).mean(axis=(2, 3))).astype(np.float64)
    quarter = INSTANTS // 4
    centre_shares, largest_at = _centre_shares(errors, u)
    result = Resolution(
        errors=errors,
        reference_error=_rms(own),
        n_s_effect=_change(rms),
        n_s_effect_81=_change(rms[:, 1:]),
        by_control_points=dict(
            zip(
                published.CONTROL_POINTS,
                rms[:, published.SAMPLES.index(SHOWN[1])].tolist(),
                strict=True,
            )
        ),
        centre_shares=centre_shares,
        largest_at=largest_at,
        early=_rms(shown[:quarter]),
        late=_rms(shown[-quarter:]),
        duration=duration,
    )
    report.text(
        f"""Scenario 1 for {duration:g} s with {METHOD} at each model's own stable step (its time
        error is far below the differences shown); reference n_u = {published.REFERENCE[0]},
        n_s = {published.REFERENCE[1]} (the text of the paper says 256, its tables end at 251). The
        error is the distance between the two centerlines at {POINTS} fixed material points and
        {INSTANTS} instants. The reference's own error, against n_u = {FINER[0]}, n_s = {FINER[1]},
        is {1e3 * result.reference_error:.3g} mm rms: smaller errors than that are not known."""
    )
    _table(report, rms, own)
    _figures(report, errors, shown, rms, u, time)
    return result


def _centre_shares(errors: Array, u: Array) -> tuple[dict[int, float], dict[int, float]]:
    column = published.SAMPLES.index(SHOWN[1])
    profiles = errors[:, column].mean(axis=1)
    middle = profiles[:, POINTS // 2 - 1 : POINTS // 2 + 1].mean(axis=1)
    shares = middle / profiles.max(axis=1)
    # Both halves see the same motion: where the error is largest is a distance from an end.
    half = POINTS // 2
    where = u[np.argmax(profiles[:, :half] + profiles[:, : half - 1 : -1], axis=1)]
    return (
        dict(zip(published.CONTROL_POINTS, shares.tolist(), strict=True)),
        dict(zip(published.CONTROL_POINTS, where.tolist(), strict=True)),
    )


def _change(rms: Array) -> dict[int, float]:
    """Largest minus smallest over smallest along n_s, by n_u; not for the reference's own n_u."""
    pairs = zip(published.CONTROL_POINTS, rms, strict=True)
    return {n: float(np.ptp(row) / row.min()) for n, row in pairs if n != published.REFERENCE[0]}


def _rms(errors: Array) -> float:
    return float(np.sqrt((errors**2).mean()))


def _track(n: int, samples: int, duration: float, u: Array) -> Array:
    """Centerline at the fixed points and instants, shape (INSTANTS, POINTS, 3)."""
    scene = scenario(1, discretization__control_points=n, discretization__samples=samples)
    recording: Recording = run(at_method(scene, METHOD), duration, duration / INSTANTS)
    knots = bspline.clamped_knots(n, scene.cable.length)
    basis = bspline.evaluate(np.eye(n), knots, u)
    return np.asarray(basis @ recording.control_points[1 : INSTANTS + 1, :, :3])


def _gap(one: Array, other: Array) -> Array:
    return np.asarray(np.linalg.norm(one - other, axis=2))


def _table(report: Report, rms: Array, own: Array) -> None:
    rows: list[list[Cell]] = [
        [n, *(f"{1e3 * value:.3g}" for value in rms[i])]
        for i, n in enumerate(published.CONTROL_POINTS)
    ]
    rows.append(["reference itself", *([None] * 5), f"{1e3 * _rms(own):.3g}"])
    report.table(
        "error_by_size",
        ["n_u \\ n_s", *map(str, published.SAMPLES)],
        rows,
        "Error against the reference model, rms over points and instants [mm], scenario 1",
    )


def _figures(
    report: Report, errors: Array, shown: Array, rms: Array, u: Array, time: Array
) -> None:
    figure, (axes,) = plotting.new_figure(width=8.0, height=4.5)
    image = axes.pcolormesh(u, time, 1e3 * shown, shading="nearest", cmap="magma")
    figure.colorbar(image, ax=axes, label="error [mm]")
    axes.set_xlabel("material coordinate u [m]")
    axes.set_ylabel("time [s]")
    axes.set_title(f"n_u = {SHOWN[0]}, n_s = {SHOWN[1]} against the reference")
    report.figure(
        "error_over_time_and_length",
        figure,
        {
            "time [s]": np.repeat(time, POINTS),
            "u [m]": np.tile(u, INSTANTS),
            "error [m]": shown.ravel(),
        },
        "Error over time and length",
    )
    figure, (axes,) = plotting.new_figure(width=8.0, height=4.5)
    names = [str(n) for n in published.CONTROL_POINTS], [str(s) for s in published.SAMPLES]
    plotting.heat_map(axes, 1e3 * rms, names[1], names[0], "rms error [mm]", colormap="magma")
    axes.set_xlabel("samples n_s")
    axes.set_ylabel("control points n_u")
    report.figure(
        "error_over_samples_and_points",
        figure,
        {
            "n_u": np.repeat(published.CONTROL_POINTS, len(published.SAMPLES)),
            "n_s": np.tile(published.SAMPLES, len(published.CONTROL_POINTS)),
            "rms error [m]": rms.ravel(),
        },
        "Error over n_s and n_u",
    )
    column = published.SAMPLES.index(SHOWN[1])
    labels = [f"n_u = {n}" for n in published.CONTROL_POINTS]
    for name, x, what, axis in (
        ("error_over_time", time, "time [s]", 2),
        ("error_over_length", u, "material coordinate u [m]", 1),
    ):
        values = np.sqrt((errors[:, column] ** 2).mean(axis=axis)).T
        figure, (axes,) = plotting.new_figure(width=8.5)
        plotting.lines(axes, x, 1e3 * values, labels)
        axes.set_yscale("log")
        axes.set_xlabel(what)
        over = "length" if axis == 2 else "time"
        axes.set_ylabel(f"error, rms over {over} [mm]")
        columns = {what: x} | {
            f"{label}, error [m]": values[:, i] for i, label in enumerate(labels)
        }
        report.figure(
            name,
            figure,
            columns,
            f"Error {name[6:].replace('_', ' ')} for each n_u, n_s = {SHOWN[1]}",
        )
