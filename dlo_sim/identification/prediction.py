"""Prediction of a recording by a scene, and its distance from the recording."""

from __future__ import annotations

import time
from collections.abc import Sequence
from copy import deepcopy
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from dlo_sim.batch.workers import Workers
from dlo_sim.core import bspline, mass
from dlo_sim.identification.measurement import START_FRAMES, Measurement, rolled
from dlo_sim.replay.comparison import AxisComparison, compare_reaction
from dlo_sim.scene.description import Scene
from dlo_sim.scene.nets import MAIN
from dlo_sim.scene.refusal import SceneError
from dlo_sim.simulation.arrays import without_margins
from dlo_sim.simulation.error_estimate import POINTS, error_along
from dlo_sim.simulation.report import DiscretizationError
from dlo_sim.simulation.simulator import Simulator

Array = NDArray[np.float64]
SLOW = 0.5  # [s], error that lasts longer is slow
ROLLS = 2  # of grippers, to be without twist to 0.01 rad
STEP = 0.01  # [s], where the scene chooses; half of it moves 12 markers by 0.1 mm
# Default settings for the simulation of recordings; the start comes from the markers.
COMPUTATION: dict[str, object] = {
    "discretization.control_points": 17,
    "discretization.stretch": "span",
    "discretization.knots": "uniform",
    "integrator.method": "energy_momentum",
    "integrator.step": STEP,
    "terms.out_of_plane": "on",
    "initial.shape": "straight",
}


@dataclass(frozen=True)
class Sensor:
    """A force sensor, axis by axis, shape (3,): delay [s] of its reading, and its offset [N]."""

    delay: Sequence[float] = (0.0, 0.0, 0.0)
    offset: Sequence[float] = (0.0, 0.0, 0.0)


@dataclass(frozen=True)
class Prediction:
    """The prediction of one recording.

    Attributes:
        markers: [m], shape (F, M, 3). forces: as the sensor reads them [N], shape (F, 3).
        failure: why and when the scene failed, from where its last good state is kept; or empty.
        seconds: wall-clock time of the simulation and the markers, without building the simulator.
    """

    markers: Array
    forces: Array
    failure: str
    seconds: float


def predict(scene: Scene, recording: Measurement, sensor: Sensor | None = None) -> Prediction:
    """The prediction of a scene from the start and the poses of a recording.

    It starts from the first frames of the markers, or from the equilibrium at the first pose.
    """
    times = recording.times
    if recording.forces is not None:
        scene = scene.with_values({"initial.shape": "equilibrium"})
    simulator = Simulator(scene, recording.ends_at(0))
    samples = times[1:]
    if recording.forces is None:
        recording = begin(simulator, recording, slice(START_FRAMES))
    else:
        steps = np.arange(1, int(times[-1] / simulator.step + 1e-9) + 1)
        samples = np.minimum(steps * simulator.step, times[-1])
    first = simulator.control_points[None, :, :3]
    began = time.perf_counter()
    report, points = simulator.follow(times, recording.poses, samples)
    path = np.concatenate([first, points[:, :, :3]])
    kept = np.repeat(path[-1:], len(samples) + 1 - len(path), axis=0)
    path = np.concatenate([path, kept])
    basis = marker_basis(simulator, recording)
    forces = np.zeros((len(times), 0))
    if recording.forces is not None:
        grid = np.concatenate([[0.0], samples])
        load = load_on_robot(simulator, grid, path)
        sensor = sensor or Sensor()
        forces = interpolated(times[:, None] - sensor.delay, grid, load) + sensor.offset
        path = interpolated(times, grid, path)
    return Prediction(basis @ path, forces, report.message, time.perf_counter() - began)


def load_on_robot(simulator: Simulator, times: Array, path: Array) -> Array:
    """Load of the cable on its end effectors together [N], shape (K, 3): W - dP/dt + D.

    W is the weight, P the momentum and D the sum of the external damping forces, with point masses.

    Args:
        times: evenly rising [s], shape (K,). path: control points at these [m], shape (K, n, 3).
    """
    cable, model = deepcopy(simulator.cable), simulator.model
    axes = list(model.axes)
    step, masses = times[1] - times[0], mass.multiply(model.mass(0), np.ones(model.n))
    # The mean of both steps at an instant, as the steps' own equations have it.
    rate = np.diff(np.einsum("n,knd->kd", masses, path), 2, axis=0) / step**2
    load = -np.concatenate([rate[:1], rate, rate[-1:]])
    load[:, axes] += without_margins(model.arrays.linear.weight, model.n).sum(axis=1)
    local, rates = path - model.origin, np.gradient(path, step, axis=0)
    lines = np.zeros((model.lines, model.n))
    for k in range(len(path)):
        cable.x[: len(axes)], lines[: len(axes)] = local[k].T[axes], rates[k].T[axes]
        load[k, axes] += cable.damping_forces(lines)[: len(axes)].sum(axis=1)
    return load


def interpolated(times: Array, grid: Array, rows: Array) -> Array:
    """Rows (K, ...) of a grid (K,), linearly at other times (T,), or (T, C) of C columns."""
    flat = rows.reshape(len(grid), -1)
    each = times if times.ndim == 2 else np.repeat(times[:, None], flat.shape[1], axis=1)
    columns = [np.interp(at, grid, column) for at, column in zip(each.T, flat.T, strict=True)]
    return np.stack(columns, axis=-1).reshape(len(times), *rows.shape[1:])


def predicted_of(
    scene: Scene, recordings: Sequence[Measurement], workers: Workers, sensor: Sensor | None = None
) -> list[Prediction]:
    """`predict` of several recordings."""
    return list(workers.map(_predict, [(scene, one, sensor) for one in recordings]))


def position_error(
    scene: Scene,
    recordings: Sequence[Measurement],
    predicted: Sequence[Prediction],
    workers: Workers,
    sensor: Sensor | None = None,
) -> tuple[DiscretizationError, str]:
    """Largest estimated discretisation error of the predicted markers (of forces, of points along
    the cable) of all recordings, and the cure if it is above accuracy.target.
    """
    if recordings[0].forces is not None:
        shares = np.linspace(0.0, 1.0, POINTS)
        recordings = [replace(one, shares=shares) for one in recordings]
        predicted = predicted_of(scene, recordings, workers, sensor)

    def places(predictions: Sequence[Prediction]) -> Array:
        return np.concatenate([one.markers.reshape(-1, 1, 3) for one in predictions])

    def with_another(finer: Scene) -> Array:
        predictions = predicted_of(finer, recordings, workers, sensor)
        if failure := next((one.failure for one in predictions if one.failure), ""):
            raise SceneError(failure)
        return places(predictions)

    simulator = Simulator(scene, recordings[0].ends_at(0))
    return error_along(simulator, places(predicted), with_another)


def _predict(item: tuple[Scene, Measurement, Sensor | None]) -> Prediction:
    return predict(*item)


def marker_basis(simulator: Simulator, recording: Measurement) -> Array:
    """Values of the basis at the markers, shape (M, n): times control points, their places."""
    basis = np.zeros((len(recording.shares), simulator.model.n))
    for part in simulator.model.parts:
        here, own = recording.on(part.name), np.eye(part.model.n)
        u = recording.shares[here] * part.length
        basis[here, part.here] = bspline.evaluate(own, part.model.knots, u)
    return basis


def begin(simulator: Simulator, recording: Measurement, frames: slice) -> Measurement:
    """Start from the markers and the end effectors in these frames. Returns the recording with end
    effectors that are rolled so that branches leave the main cable as their markers say: the roll
    of those of a harness is not measured.
    """
    _begin(simulator, recording, frames)
    main = simulator.model.parts[0]
    at = [join.at for join in simulator.model.joins if join.other == MAIN and join.u == 0.0]
    if not at:
        return recording
    names = [*simulator.scene.holders]
    where = {"start": 0.0, **recording.held_at}
    # Between the outermost branches and the ends there is no twist then.
    places = np.clip(np.array([*where.values()]) * main.length, min(at), max(at))
    for _ in range(ROLLS):
        held = simulator.cable.held_twists(0.0)
        twist = bspline.evaluate(simulator.control_points[main.here, 3:], main.model.knots, places)
        angles = {
            end: angle - (float(held[names.index(end)]) if end in recording.poses else 0.0)
            for end, angle in zip(where, twist[:, 0].tolist(), strict=True)
        }
        for end, angle in angles.items():
            turned = rolled(simulator.end_pose(end)[1][None], angle)[0]
            simulator.set_end(end, orientation=turned)
        recording = recording.rolled(angles)
        _begin(simulator, recording, frames)
    return recording


def _begin(simulator: Simulator, recording: Measurement, frames: slice) -> None:
    points: dict[str, Array] = {}
    coordinates: dict[str, Array] = {}
    for part in simulator.model.parts:
        here = recording.on(part.name)
        points[part.name] = recording.markers[frames, here]
        coordinates[part.name] = recording.shares[here] * part.length
    held = [path[frames, None, :3] for path in recording.poses.values()]
    at = np.array([*recording.held_at.values()]) * simulator.scene.cable.length
    u = np.concatenate([coordinates[MAIN], at])
    order = np.argsort(u, kind="stable")
    points[MAIN] = np.concatenate([points[MAIN], *held], axis=1)[:, order]
    coordinates[MAIN] = u[order]
    simulator.start_from_points(points, recording.times[frames], coordinates)


@dataclass(frozen=True)
class Score:
    """The error of one prediction, in metres.

    Attributes:
        l1: mean |error| of coordinates, summed over the frames after the first two, divided by the
            number of all frames; markers on the grippers count with no error.
        distance: mean distance of the free markers. bias: of their mean errors from zero.
        slow, fast: `l1` of the error averaged over SLOW, and of the rest.
    """

    l1: float
    distance: float
    bias: float
    slow: float
    fast: float


def score(recording: Measurement, predicted: Array) -> Score:
    """Score of predicted markers, shape (F, M, 3), frames 2 and later."""
    error = (predicted - recording.markers)[2:]
    slow = _averaged(error, max(1, round(SLOW / float(np.median(np.diff(recording.times))))))
    return Score(
        _l1(recording, error),
        float(np.nanmean(np.linalg.norm(error, axis=-1))),
        float(np.nanmean(np.linalg.norm(np.nanmean(error, axis=0), axis=-1))),
        _l1(recording, slow),
        _l1(recording, error - slow),
    )


def reaction(recording: Measurement, predicted: Prediction) -> list[AxisComparison]:
    """Predicted against measured forces, axis by axis; empty where none were measured."""
    if recording.forces is None:
        return []
    times, known = recording.times, np.isfinite(recording.forces).all(axis=1)
    return compare_reaction(
        times, predicted.forces, times[known], recording.forces[known], sign=1.0
    )


def mean_score(scores: Sequence[Score]) -> Score:
    """The mean of several."""
    rows = np.array([(one.l1, one.distance, one.bias, one.slow, one.fast) for one in scores])
    return Score(*rows.mean(axis=0).tolist())


def _l1(recording: Measurement, error: Array) -> float:
    markers = error.shape[1]
    fraction = markers / (markers + recording.counted) * len(error) / len(recording.times)
    return float(np.nanmean(np.abs(error)) * fraction)


def _averaged(error: Array, window: int) -> Array:
    """Running mean over so many steps between frames, fewer at both ends."""

    def sums(rows: Array) -> Array:
        every = np.apply_along_axis(np.convolve, 0, rows, np.ones(window + 1))
        return np.asarray(every[window - window // 2 :][: len(rows)])

    known = np.isfinite(error)
    means = sums(np.nan_to_num(error)) / np.maximum(sums(known.astype(float)), 1.0)
    return np.where(known, means, np.nan)
