"""Cables hanging from a robot arm with a force-torque sensor: static shapes, and reactions."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from scipy.optimize import least_squares

from dlo_sim.core import rotations
from dlo_sim.identification.fit import Fit
from dlo_sim.scene.description import Scene
from dlo_sim.scene.loading import load_scene
from dlo_sim.simulation.simulator import Simulator
from dlo_sim.studies import Request
from dlo_sim.studies.report import Report
from dlo_sim.studies.runs import Array
from dlo_sim.studies.validation import moved_cable

TURN, REST = 0.7, 1.6  # [s], rotation from one clamp angle to the next, and waiting there
STILL = 6.0  # [1/s], damping that brings the cable to rest
TWO = 0.01  # [m], distance from which two shapes count as different
FACTORS = (1.0, 0.85)  # of the published bending stiffness
RESTING = (
    "cable | bending stiffness, of the published | tip error [cm] | from below [cm] | "
    "from above [cm] | angles with two shapes"
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
    moved = {name: moved_cable.recorded(one.path, one.scene) for name, one in runs.items()}
    fits: dict[str, Fit] = {}
    for number, one in enumerate(sets):
        if one.path.is_file():
            resting += _resting(one, not request.quick)
        elif not request.quick:
            fits[one.name] = moved_cable.fitted(one.scene, moved[one.name], request.workers)
        request.progress(0.8 + 0.2 * (number + 1) / len(sets))
    moving: list[list[Any]] = []
    for name, one in runs.items():
        moving += moved_cable.rows(name, one.scene, moved[name], fits)
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
        report.text(moved_cable.EXPLANATION)
        caption = "Reaction and tip of moved cables"
        report.table("moving", moved_cable.HEADER, moving, caption, ".2f")
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
