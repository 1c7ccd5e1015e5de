"""What predictions of recordings are compared with: trivial ones without dynamics, a smooth cable
fitted to the markers, and a prediction corrected by a part of the markers, as seen by a camera.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from dlo_sim.core import bspline
from dlo_sim.identification.measurement import LEAST_FRAMES, START_FRAMES, Recording
from dlo_sim.identification.prediction import begin, interpolated
from dlo_sim.scene.computation import Measured
from dlo_sim.scene.description import Scene
from dlo_sim.scene.loading import SceneError
from dlo_sim.session.diagnostics import Journal
from dlo_sim.session.observer import Observer
from dlo_sim.simulation.simulator import Simulator
from dlo_sim.studies.runs import Array

EVERY = 25  # frames between two equilibria, and between two fitted splines


def held(recording: Recording) -> Array:
    """The first shape, held constant, (F, M, 3)."""
    return np.repeat(recording.markers[:1], len(recording.times), axis=0)


def moved(recording: Recording) -> Array:
    """The first shape moved with the grippers, blended along the cable, (F, M, 3)."""
    shift = {end: path[:, :3] - path[0, :3] for end, path in recording.poses.items()}
    start, end = shift["start"], shift.get("end", shift["start"])
    share = recording.shares[None, :, None]
    blended = (1.0 - share) * start[:, None] + share * end[:, None]
    return np.asarray(recording.markers[:1] + blended)


def resting(item: tuple[Scene, Recording]) -> Array:
    """Static equilibria at the poses of the grippers, of an elastic cable, (F, M, 3)."""
    scene, recording = item
    # What slips depends on the way there; the share of the stiffness that does not slip remains.
    share = scene.plasticity.hardening if scene.plasticity.yield_curvature else 1.0
    values = {"cable.bending_stiffness": share * scene.cable.EI, "plasticity.yield_curvature": 0.0}
    scene = scene.with_values({"initial.shape": "equilibrium", **values})
    frames = _frames(recording)
    shapes: list[Array] = []
    for frame in frames:
        try:
            simulator = Simulator(scene, _poses(recording, frame))
        except SceneError:  # no equilibrium found: repeat the previous one
            shapes.append(shapes[-1] if shapes else recording.markers[frame])
        else:
            shapes.append(simulator.centerline(recording.shares * scene.cable.length))
    return interpolated(recording.times, recording.times[frames], np.array(shapes))


def spline_distance(item: tuple[Scene, Recording]) -> float:
    """Mean distance [m] of the free markers from a spline of the recorded length fitted to them:
    noise, slip and the resolution of the spline.
    """
    scene, recording = item
    still = {f"{end}.offset": [0.0, 0.0, 0.0] for end in recording.poses}
    scene = scene.with_values({**still, "cable.length": recording.known["cable.length"]})
    u = recording.shares * scene.cable.length
    apart = []
    for frame in _frames(recording):
        simulator = Simulator(scene, _poses(recording, frame))
        still_frames = np.full(LEAST_FRAMES, frame)
        part = Recording(
            recording.name,
            recording.times[:LEAST_FRAMES],
            recording.markers[still_frames],
            {end: path[still_frames] for end, path in recording.poses.items()},
            recording.shares,
        )
        begin(simulator, part, u, 1)
        curve = bspline.evaluate(simulator.control_points[:, :3], simulator.model.knots, u)
        apart.append(np.linalg.norm(curve - part.markers[0], axis=1))
    return float(np.nanmean(apart))


def _frames(recording: Recording) -> NDArray[np.int64]:
    last = len(recording.times) - 1
    return np.unique(np.append(np.arange(0, last, EVERY), last))


def _poses(recording: Recording, frame: int) -> dict[str, tuple[Array, Array]]:
    return {end: (path[frame, :3], path[frame, 3:]) for end, path in recording.poses.items()}


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
    observer = Observer(Measured(noise=NOISE), Journal(()))
    rng, times = np.random.default_rng(0), recording.times
    looks = np.searchsorted(times, np.arange(1.0, times[-1] * RATE) / RATE - 1e-9)
    found, last = [basis @ simulator.control_points[:, :3]], 0
    for frame in np.unique([*looks, len(times) - 1]):
        part = slice(max(last - _BEFORE, 0), frame + 1)
        along = {end: path[part] for end, path in recording.poses.items()}
        report, shapes = simulator.follow(times[part], along, times[last + 1 : frame + 1])
        found += list(basis @ shapes[:, :, :3])
        if not report.status.advanced:
            break
        seen = recording.markers[frame, rng.random(len(u)) < SEEN]
        seen = seen[np.isfinite(seen).all(axis=1)]
        if len(seen):
            noisy = seen + rng.normal(0.0, NOISE, seen.shape)
            correction = observer.correction(noisy, simulator)
            if correction is not None:
                simulator.correct(*correction)
            found[-1] = basis @ simulator.control_points[:, :3]
        last = frame
    return np.array(found + found[-1:] * (len(times) - len(found)))
