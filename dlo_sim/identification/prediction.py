"""What a scene predicts of a recording: the same start, the same end effectors."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from dlo_sim.batch.workers import Workers
from dlo_sim.core import bspline
from dlo_sim.identification.measurement import START_FRAMES, Recording
from dlo_sim.scene.description import Scene
from dlo_sim.simulation.simulator import Simulator

Array = NDArray[np.float64]
STEP = 0.01  # [s], where the scene chooses; half of it moves 12 markers by 0.1 mm
# How recordings are simulated where nobody says otherwise; the start comes from the markers.
COMPUTATION: dict[str, object] = {
    "discretization.control_points": 17,
    "discretization.stretch": "span",
    "integrator.method": "energy_momentum",
    "integrator.step": STEP,
    "terms.out_of_plane": "on",
    "initial.shape": "straight",
}


def predict(scene: Scene, recording: Recording, start_frames: int = START_FRAMES) -> Array:
    """Markers [m] that the scene predicts from the first frames and the poses, shape (F, M, 3).

    After a failed step the last good state is kept.
    """
    poses = {end: (path[0, :3], path[0, 3:]) for end, path in recording.poses.items()}
    simulator = Simulator(scene, poses)
    u = recording.shares * scene.cable.length
    begin(simulator, recording, u, start_frames)
    first = bspline.evaluate(simulator.control_points[:, :3], simulator.model.knots, u)
    times = recording.times
    _, points = simulator.follow(times, recording.poses, times[1:])
    basis = bspline.evaluate(np.eye(simulator.model.n), simulator.model.knots, u)
    moved = basis @ points[:, :, :3]
    last = moved[-1] if len(moved) else first
    kept = np.repeat(last[None], len(times) - 1 - len(moved), axis=0)
    return np.concatenate([first[None], moved, kept])


def predicted_of(scene: Scene, recordings: Sequence[Recording], workers: Workers) -> list[Array]:
    """`predict` of several recordings."""
    return list(workers.map(_predict, [(scene, one) for one in recordings]))


def _predict(item: tuple[Scene, Recording]) -> Array:
    return predict(*item)


def begin(simulator: Simulator, recording: Recording, u: Array, frames: int) -> None:
    """Start from the first frames of the markers and the end effectors."""
    coordinates, points = [u], [recording.markers[:frames]]
    if "start" in recording.poses:
        coordinates.insert(0, np.zeros(1))
        points.insert(0, recording.poses["start"][:frames, None, :3])
    if "end" in recording.poses:
        coordinates.append(np.array([simulator.scene.cable.length]))
        points.append(recording.poses["end"][:frames, None, :3])
    simulator.start_from_points(
        np.concatenate(points, axis=1), recording.times[:frames], np.concatenate(coordinates)
    )
