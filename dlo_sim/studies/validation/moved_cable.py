"""Cables moved by a robot arm: reaction and tip compared with force sensor and camera."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np

from dlo_sim.batch.workers import Workers
from dlo_sim.core import rotations
from dlo_sim.identification.fit import Fit
from dlo_sim.identification.identify import identify
from dlo_sim.identification.measurement import Recording
from dlo_sim.identification.prediction import COMPUTATION, Sensor, interpolated, predict
from dlo_sim.identification.problem import DELAY
from dlo_sim.identification.readers import read_recordings
from dlo_sim.identification.scores import reaction
from dlo_sim.scene.description import Scene
from dlo_sim.studies.runs import Array

SMOOTHING = 0.2  # [s], half the smoothing window of the poses; latency does not matter here
SLOW = 0.02  # [m/s], speed below which a gripper counts as at rest
SAMPLES = 200  # of the camera's shape
EXPLANATION = f"""Published: the parameters of the authors. Fitted: stiffness, damping and drag
identified from the reaction in the same run; natural curvature and masses as published. Delays: of
the sensor's axes relative to the poses; the second row uses the median of the delays identified in
the other runs, so that only the offset (tare) of the sensor is from the run itself. At rest: while
the gripper moves slower than {SLOW:g} m/s. Faster than the poses: the part of the measured force
that smoothing over {SMOOTHING:g} s to either side, as applied to the poses, removes: shocks of the
arm between two poses, which no prediction from these poses can contain."""
HEADER = (
    "cable | numbers | Fx correlation | Fx rms error [N] | Fx rms error at rest [N] | "
    "Fx faster than the poses [N] | Fz correlation | Fz rms error [N] | Fz bias [N] | "
    "tip rms error [cm]"
)


def recorded(bag: Path, scene: Scene) -> Recording:
    """Poses and forces of a bag, and the tip, if the authors' table of the run is there."""
    recording = _smoothed(read_recordings(bag)[0], scene)
    table = bag.parents[1] / "dyn_ft" / bag.name / "state_and_input.csv"
    if not table.is_file():
        return recording
    times, tips = _tips(table, scene.cable.length)
    markers = interpolated(recording.times, times, tips[:, None])
    return replace(recording, markers=markers, shares=np.ones(1))


def _smoothed(recording: Recording, scene: Scene) -> Recording:
    return recording.smoothed(scene.with_values({"start.pose_smoothing": SMOOTHING}))


def _tips(table: Path, length: float) -> tuple[Array, Array]:
    """Times [s] and tips [m] from the authors' shapes, whose angle is Theta0 v + Theta1 v^2 / 2."""
    given = np.genfromtxt(table, delimiter=",", names=True)
    v = (np.arange(SAMPLES) + 0.5) / SAMPLES
    angle = np.outer(given["Theta0"], v) + np.outer(given["Theta1"], 0.5 * v**2)
    zero = np.zeros(len(given))
    own = [-length * np.sin(angle).mean(axis=1), zero, -length * np.cos(angle).mean(axis=1)]
    turns = rotations.from_rotation_vector(np.stack([zero, given["Phi"], zero], axis=-1))
    base = np.stack([given["X"], zero, given["Z"]], axis=-1)
    return given["ts"] - given["ts"][0], base + rotations.rotate(turns, np.stack(own, axis=-1))


def fitted(scene: Scene, recording: Recording, workers: Workers) -> Fit:
    """Fit of the parameters to the forces of a run."""
    bare = replace(recording, markers=recording.markers[:, :0], shares=np.zeros(0))
    plain = scene.with_values({"start.pose_smoothing": 0.0})  # the poses are smooth already
    found = identify(
        plain, {}, [bare], workers, (), 0.0, 1.0, lambda share: None, lambda line: None
    )
    return found.fit


def rows(name: str, scene: Scene, recording: Recording, fits: Mapping[str, Fit]) -> list[list[Any]]:
    """Rows of `HEADER`: published parameters, these with the delays identified in the other runs,
    and the fit to the run itself; `fits`: name of the run -> fit.
    """
    scene = scene.with_values(COMPUTATION)
    found = [_row(name, "published", scene, recording, Sensor())]
    if name not in fits:
        return found
    own, others = fits[name], [fit for run, fit in fits.items() if run != name]
    timed = replace(own.sensor, delay=[_delay(others, axis) for axis in range(3)])
    found.append(_row(name, "published, delays of the other runs", scene, recording, timed))
    values = {
        one.unknown.key: one.value
        for one in own.numbers
        if one.unknown.key.startswith(("cable.", "damping."))
    }
    found.append(_row(name, "fitted", scene.with_values(values), recording, own.sensor))
    return found


def _delay(fits: Sequence[Fit], axis: int) -> float:
    """Median of the delays [s] of an axis in these fits; 0 if there is none."""
    label = f"{DELAY}[{axis}]"
    told = [one.value for fit in fits for one in fit.numbers if one.unknown.label == label]
    return float(np.median(told)) if told else 0.0


def _row(name: str, words: str, scene: Scene, recording: Recording, sensor: Sensor) -> list[Any]:
    made = predict(scene, recording, sensor=sensor)
    if recording.forces is None:
        raise ValueError(f"{name}: holds no forces")
    x, _, z = reaction(recording, made)
    velocity = np.gradient(recording.poses["start"][:, :3], recording.times, axis=0)
    still = np.linalg.norm(velocity, axis=1) < SLOW
    apart = (made.forces - recording.forces)[still, 0]
    turns = recording.poses["start"][:, 3:]
    as_poses = replace(recording, poses={"start": np.hstack([recording.forces, turns])})
    fast = (_smoothed(as_poses, scene).poses["start"] - as_poses.poses["start"])[:, 0]
    tip = np.linalg.norm(made.markers - recording.markers, axis=-1)
    return [
        *(name, words, x.correlation, x.rms_error, _rms(apart), _rms(fast)),
        *(z.correlation, z.rms_error, z.bias),
        _rms(tip) if tip.size else None,
    ]


def _rms(values: Array) -> float:
    return float(np.sqrt(np.mean(values**2)))
