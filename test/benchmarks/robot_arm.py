"""Cables on a robot arm with a force-torque sensor: at rest, hanging from a clamp at many angles,
and moved, with reaction and tip compared with force sensor and camera.

    python test/benchmarks/robot_arm.py RECORDINGS FOLDER [--quick]

writes a report into the folder. The recordings are `static/*/theta_equilibria.csv`, `bags/*` (poses
and a force), `dyn_ft/*/state_and_input.csv` (tips) and `params/*.txt` (the authors' parameters).
"""

from __future__ import annotations

import sys
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np
from scipy.optimize import least_squares

from dlo_sim.batch.workers import HERE, Workers
from dlo_sim.core import rotations
from dlo_sim.identification.fit import Fit
from dlo_sim.identification.identify import identify
from dlo_sim.identification.measurement import Measurement
from dlo_sim.identification.prediction import COMPUTATION, Sensor, interpolated, predict, reaction
from dlo_sim.identification.problem import DELAY
from dlo_sim.identification.readers import read_recordings
from dlo_sim.scene.description import Scene
from dlo_sim.scene.loading import load_scene
from dlo_sim.simulation.simulator import Simulator
from dlo_sim.studies import Request
from dlo_sim.studies.report import Array, Report

TURN, REST = 0.7, 1.6  # [s], rotation from one clamp angle to the next, and waiting there
STILL = 6.0  # [1/s], damping that brings the cable to rest
TWO = 0.01  # [m], distance from which two shapes count as different
FACTORS = (1.0, 0.85)  # of the published bending stiffness
RESTING = (
    "cable | bending stiffness, of the published | tip error [cm] | from below [cm] | "
    "from above [cm] | angles with two shapes"
)
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
MOVING = (
    "cable | numbers | Fx correlation | Fx rms error [N] | Fx rms error at rest [N] | "
    "Fx faster than the poses [N] | Fz correlation | Fz rms error [N] | Fz bias [N] | "
    "tip rms error [cm]"
)


@dataclass(frozen=True)
class Set:
    """Recordings of one cable: a table of static shapes, or a bag."""

    name: str
    path: Path
    values: dict[str, object]

    @property
    def scene(self) -> Scene:
        """The hanging cable with the published parameters."""
        return load_scene("hanging_cable", self.values)


def sets_of(folder: Path) -> list[Set]:
    """The recordings in a folder for which the published parameters are there too."""
    found = []
    paths = [
        *folder.rglob("theta_equilibria.csv"),
        *(p for p in folder.rglob("bags/*") if p.is_dir()),
    ]
    for path in sorted(paths):
        name = path.parent.name.removesuffix("_equilibria") if path.is_file() else path.name
        parameters = list(folder.rglob(f"params/{name}.txt"))
        if parameters:
            found.append(Set(name, path, published(parameters[0])))
    return found


def published(path: Path) -> dict[str, object]:
    """The authors' parameters of a cable as scene values; formulas: config/hanging_cable.yaml."""
    numbers = map(float, path.read_text(encoding="utf-8").split(","))
    mass, end_mass, length, diameter, k, theta0, theta1, beta = numbers
    return {
        "cable.length": length,
        "cable.diameter": diameter,
        "cable.linear_density": mass / length,
        "cable.bending_stiffness": k * length,
        "cable.rest_curvature": [theta0 / length, (theta0 + theta1) / length],
        "damping.stiffness": beta / k,
        "end.mass": end_mass,
        "end.position": [0.0, 0.0, 0.75 - length],
    }


def compare(report: Report, sets: list[Set], request: Request) -> dict[str, str]:
    """Add the tables of static shapes and of reactions; returns the verdicts."""
    resting: list[list[Any]] = []
    runs = {one.name: one for one in sets if one.path.is_dir()}
    moved = {name: recorded(one.path, one.scene) for name, one in runs.items()}
    fits: dict[str, Fit] = {}
    for one in sets:
        if one.path.is_file():
            resting += _resting(one, not request.quick)
        elif not request.quick:
            fits[one.name] = fit_to_forces(one.scene, moved[one.name], request.workers)
    moving: list[list[Any]] = []
    for name, one in runs.items():
        moving += moving_rows(name, one.scene, moved[name], fits)
    if resting or moving:
        report.section("Cables on a robot arm")
    if resting:
        report.text(
            "The clamp is rotated slowly through all angles, upwards and downwards; where the two "
            "shapes differ, the cable is bistable, and the nearer one counts."
        )
        caption = "Tip at rest, mean distance over the angles"
        report.table("resting", RESTING, resting, caption, ".2f")
    if moving:
        report.text(EXPLANATION)
        caption = "Reaction and tip of moved cables"
        report.table("moving", MOVING, moving, caption, ".2f")
    verdicts = {}
    for name, stiffness, tip, *_ in resting:
        verdicts[f"{name} at rest, EI x {stiffness}"] = f"tip error {1e2 * tip:.2f} cm"
    for name, run, x, x_rms, _, _, _, z_rms, *_ in moving:
        words = f"Fx correlation {x:.2f}, rms {x_rms:.2f} N; Fz rms {z_rms:.2f} N"
        verdicts[f"{name} moving, {run}"] = words
    return verdicts


def _resting(one: Set, fit: bool) -> list[list[Any]]:
    """Rows of the published stiffness, of a smaller one, and of a fit to every second angle,
    evaluated at the others.
    """
    table = np.genfromtxt(one.path, delimiter=",", names=True)
    table = table[np.argsort(table["Gamma"])]
    # The table gives the tip in the clamp's frame.
    turns = rotations.from_rotation_vector(np.outer(table["Gamma"], [0.0, 1.0, 0.0]))
    own = np.stack([table["X_end"], np.zeros(len(table)), table["Z_end"]], axis=-1)
    measured = rotations.rotate(turns, own)
    scene = one.scene.with_values(
        {
            "damping.mass": STILL,
            "integrator.method": "energy_momentum",
            "integrator.step": 0.005,
            "start.position": [0.0, 0.0, 0.0],
            "end.position": [0.0, 0.0, -float(one.values["cable.length"])],  # type: ignore[arg-type]
        }
    )

    def branches(numbers: Array) -> Array:
        """Predicted minus measured tips, upwards and downwards, (2, K, 3)."""
        changed = scene.with_values(
            {
                "cable.bending_stiffness": float(np.exp(numbers[0])) * scene.cable.EI,
                "cable.rest_curvature": numbers[1:].tolist(),
            }
        )
        up, down = tips(changed, turns), tips(changed, turns[::-1])[::-1]
        return np.stack([up, down]) - measured

    start = np.array([0.0, *scene.cable.rest_curvature])
    rows = []
    for factor in FACTORS:
        numbers = start + np.array([np.log(factor), 0.0, 0.0])
        rows.append(_row(one, f"{factor:g}", branches(numbers), slice(None)))
    if fit:
        numbers = _fitted(branches, start)
        curvature = ", ".join(f"{number:.2f}" for number in numbers[1:])
        label = f"{np.exp(numbers[0]):.2f}, natural curvature {curvature}"
        rows.append(_row(one, f"{label} /m, other angles", branches(numbers), slice(1, None, 2)))
    return rows


def _row(one: Set, words: str, apart: Array, chosen: slice) -> list[Any]:
    distance = np.linalg.norm(apart[:, chosen], axis=-1)
    two = int(np.sum(np.linalg.norm(apart[0] - apart[1], axis=-1)[chosen] > TWO))
    return [one.name, words, float(distance.min(axis=0).mean()), *distance.mean(axis=1), two]


def _fitted(branches: Callable[[Array], Array], start: Array) -> Array:
    """Log of the stiffness factor and natural curvature at equal distances, fit to every second
    angle: first with the curvature at both ends, then with that in the middle, too.
    """

    def nearest(numbers: Array) -> Array:
        apart = branches(numbers)[:, ::2]
        near = np.argmin(np.linalg.norm(apart, axis=-1), axis=0)
        return np.asarray(apart[near, np.arange(apart.shape[1])].ravel())

    def fit(start: Array) -> Array:
        found = least_squares(
            nearest, start, diff_step=1e-2, x_scale=[0.2] + [0.5] * (len(start) - 1),
            loss="soft_l1", f_scale=0.02, max_nfev=8,
        )  # fmt: skip
        return np.asarray(found.x)

    stiffness, begin, end = fit(start)
    return fit(np.array([stiffness, begin, 0.5 * (begin + end), end]))


def tips(scene: Scene, turns: Array) -> Array:
    """Tip at rest [m], shape (K, 3), at orientations (K, 4) that the clamp visits in turn."""
    knots = np.arange(len(turns)) * (TURN + REST)
    times = np.arange(0.0, knots[-1] + REST + 0.1, 0.05)
    k = np.minimum((times / (TURN + REST)).astype(int), len(turns) - 2)
    share = np.clip((times - knots[k] - REST) / TURN, 0.0, 1.0)
    poses = np.hstack([np.zeros((len(times), 3)), rotations.slerp(turns[k], turns[k + 1], share)])
    simulator = Simulator(scene, {"start": (poses[0, :3], poses[0, 3:])})
    _, points = simulator.follow(times, {"start": poses}, knots + 0.98 * REST)
    return np.asarray(points[:, -1, :3])


def recorded(bag: Path, scene: Scene) -> Measurement:
    """Poses and forces of a bag, and the tip, if the authors' table of the run is there."""
    recording = _smoothed(read_recordings(bag)[0], scene)
    table = bag.parents[1] / "dyn_ft" / bag.name / "state_and_input.csv"
    if not table.is_file():
        return recording
    times, tips = _tips(table, scene.cable.length)
    markers = interpolated(recording.times, times, tips[:, None])
    return replace(recording, markers=markers, shares=np.ones(1))


def _smoothed(recording: Measurement, scene: Scene) -> Measurement:
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


def fit_to_forces(scene: Scene, recording: Measurement, workers: Workers) -> Fit:
    """Fit of the parameters to the forces of a run."""
    bare = replace(recording, markers=recording.markers[:, :0], shares=np.zeros(0))
    plain = scene.with_values({"start.pose_smoothing": 0.0})  # the poses are smooth already
    found = identify(
        plain, {}, [bare], workers, (), 0.0, 1.0, lambda share: None, lambda line: None
    )
    return found.fit


def moving_rows(
    name: str, scene: Scene, recording: Measurement, fits: Mapping[str, Fit]
) -> list[list[Any]]:
    """Rows of `MOVING`: published parameters, these with the delays identified in the other runs,
    and the fit to the run itself; `fits`: name of the run -> fit.
    """
    scene = scene.with_values(COMPUTATION)
    found = [_moving_row(name, "published", scene, recording, Sensor())]
    if name not in fits:
        return found
    own, others = fits[name], [fit for run, fit in fits.items() if run != name]
    timed = replace(own.sensor, delay=[_delay(others, axis) for axis in range(3)])
    found.append(_moving_row(name, "published, delays of the other runs", scene, recording, timed))
    values = {
        one.unknown.key: one.value
        for one in own.numbers
        if one.unknown.key.startswith(("cable.", "damping."))
    }
    found.append(_moving_row(name, "fitted", scene.with_values(values), recording, own.sensor))
    return found


def _delay(fits: Sequence[Fit], axis: int) -> float:
    """Median of the delays [s] of an axis in these fits; 0 if there is none."""
    label = f"{DELAY}[{axis}]"
    told = [one.value for fit in fits for one in fit.numbers if one.unknown.label == label]
    return float(np.median(told)) if told else 0.0


def _moving_row(
    name: str, words: str, scene: Scene, recording: Measurement, sensor: Sensor
) -> list[Any]:
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


if __name__ == "__main__":
    command = "python test/benchmarks/robot_arm.py"
    asked = Request(Path(sys.argv[2]), "--quick" in sys.argv, command, HERE)
    written = Report(asked, "Cables on a robot arm", {})
    verdicts = compare(written, sets_of(Path(sys.argv[1])), asked)
    written.outcome(verdicts)
    for name, verdict in verdicts.items():
        print(f"{name}: {verdict}")
