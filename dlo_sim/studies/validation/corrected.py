"""A prediction corrected by a random part of the markers, as seen by a camera."""

from __future__ import annotations

import numpy as np

from dlo_sim.core import bspline
from dlo_sim.identification.measurement import START_FRAMES, Recording
from dlo_sim.identification.prediction import begin
from dlo_sim.scene.computation import Measured
from dlo_sim.scene.description import Scene
from dlo_sim.session.observer import Observer, Points
from dlo_sim.session.time_base import SECOND
from dlo_sim.simulation.simulator import Simulator
from dlo_sim.studies.runs import Array

SEEN, RATE, NOISE = 0.3, 30.0, 0.005  # share of the markers, [Hz], [m] of each coordinate
_BEFORE = 2  # frames before a piece of motion, for its first velocities


def corrected(item: tuple[Scene, Recording]) -> Array:
    """Markers [m] predicted with correction, (F, M, 3): markers are seen at random and without
    identity. After a failed step the last valid state is repeated.
    """
    scene, recording = item
    poses = {end: (path[0, :3], path[0, 3:]) for end, path in recording.poses.items()}
    simulator = Simulator(scene, poses)
    u = recording.shares * scene.cable.length
    begin(simulator, recording, u, START_FRAMES)
    basis = bspline.evaluate(np.eye(simulator.model.n), simulator.model.knots, u)
    observer = Observer(Measured(noise=NOISE), lambda event, detail: None)
    rng, times = np.random.default_rng(0), recording.times
    looks = np.searchsorted(times, np.arange(1.0, times[-1] * RATE) / RATE - 1e-9)
    found, last = [basis @ simulator.control_points[:, :3]], 0
    for frame in np.unique([*looks, len(times) - 1]):
        part = slice(max(last - _BEFORE, 0), frame + 1)
        along = {end: path[part] for end, path in recording.poses.items()}
        report, shapes = simulator.follow(times[part], along, times[last + 1 : frame + 1])
        found += list(basis @ shapes[:, :, :3])
        if not report.status.ok:
            break
        seen = recording.markers[frame, rng.random(len(u)) < SEEN]
        seen = seen[np.isfinite(seen).all(axis=1)]
        if len(seen):
            stamp = round(times[frame] * SECOND)
            observer.add(Points(stamp, seen + rng.normal(0.0, NOISE, seen.shape)))
            observer.apply(stamp, SECOND, simulator)
            found[-1] = basis @ simulator.control_points[:, :3]
        last = frame
    return np.array(found + found[-1:] * (len(times) - len(found)))
