"""Cables that hang from a robot arm with a force-torque sensor: shapes at rest, and reactions."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from dlo_sim.core import rotations
from dlo_sim.replay.replay import replay_bag
from dlo_sim.scene.description import Scene
from dlo_sim.scene.loading import load_scene
from dlo_sim.simulation.following import follow
from dlo_sim.simulation.simulator import Simulator
from dlo_sim.studies.catalogue import Request
from dlo_sim.studies.report import Column, Header, Report

Array = NDArray[np.float64]
TURN, REST = 0.7, 1.6  # [s] from one clamp angle to the next, and there
STILL = 6.0  # 1/s, damping that brings the cable to rest
FACTORS = (1.0, 0.85)  # of the published bending stiffness
RESTING: Header = [
    "cable",
    Column("EI", "published", ".2f"),
    Column("tip error", "cm", ".2f"),
    Column("from below", "cm", ".2f"),
    Column("from above", "cm", ".2f"),
    "angles with two shapes",
]
MOVING: Header = [
    "cable",
    Column("Fx correlation", "", ".2f"),
    Column("Fx rms error", "N", ".2f"),
    Column("Fz correlation", "", ".2f"),
    Column("Fz rms error", "N", ".2f"),
    Column("Fz bias", "N", ".2f"),
]


@dataclass(frozen=True)
class Set:
    """Recordings of one cable: a table of shapes at rest, or a bag."""

    name: str
    path: Path
    values: dict[str, object]

    @property
    def scene(self) -> Scene:
        """The hanging cable with the published parameters."""
        return load_scene("hanging_cable", self.values)


def sets_of(folder: Path) -> list[Set]:
    """What the folder holds of it, where the parameters are there too."""
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
    """Tables of shapes at rest and of reactions; verdicts."""
    resting: list[list[Any]] = []
    moving: list[list[Any]] = []
    for number, one in enumerate(sets):
        if one.path.is_file():
            resting += [_resting(one, factor) for factor in FACTORS]
        else:
            moving.append(_moving(one))
        request.progress(0.8 + 0.2 * (number + 1) / len(sets))
    if resting or moving:
        report.section("Cables on a robot arm")
    if resting:
        report.text(
            "The clamp is turned slowly through all angles, upwards and downwards; where the two "
            "shapes differ, the cable can snap over, and the nearer one counts."
        )
        report.table("resting", RESTING, resting, "Tip at rest, mean distance over the angles")
    if moving:
        report.table("moving", MOVING, moving, "Reaction at the gripper against the sensor")
    verdicts = {}
    for name, stiffness, tip, *_ in resting:
        verdicts[f"{name} at rest, EI x {stiffness}"] = f"tip {1e2 * tip:.2f} cm off"
    for name, x, x_rms, _, z_rms, _ in moving:
        words = f"Fx correlation {x:.2f}, rms {x_rms:.2f} N; Fz rms {z_rms:.2f} N"
        verdicts[f"{name} moving"] = words
    return verdicts


def _resting(one: Set, factor: float) -> list[Any]:
    table = np.genfromtxt(one.path, delimiter=",", names=True)
    order = np.argsort(table["Gamma"])
    angles = table["Gamma"][order]
    measured = np.stack([table["X_end"], np.zeros(len(angles)), table["Z_end"]], axis=-1)[order]
    scene = one.scene
    scene = scene.with_values(
        {
            "cable.bending_stiffness": factor * scene.cable.EI,
            "damping.mass": STILL,
            "integrator.method": "energy_momentum",
            "integrator.step": 0.005,
            "start.position": [0.0, 0.0, 0.0],
            "end.position": [0.0, 0.0, -scene.cable.length],
        }
    )
    up, down = tips(scene, angles), tips(scene, angles[::-1])[::-1]
    errors = np.linalg.norm(np.stack([up, down]) - measured, axis=-1)
    two = int(np.sum(np.linalg.norm(up - down, axis=-1) > 0.01 * scene.cable.length))
    below, above = errors.mean(axis=1).tolist()
    return [one.name, factor, float(errors.min(axis=0).mean()), below, above, two]


def tips(scene: Scene, angles: Array) -> Array:
    """Tip [m] at rest at clamp angles (K,) that are visited one after the other, shape (K, 3)."""
    count = len(angles)
    knots = np.arange(count) * (TURN + REST)
    times = np.arange(0.0, knots[-1] + REST, 0.05)
    angle = np.interp(times, np.sort(np.append(knots, knots + REST)), np.repeat(angles, 2))
    turns = rotations.from_rotation_vector(np.outer(-angle, [0.0, 1.0, 0.0]))
    poses = np.hstack([np.zeros((len(times), 3)), turns])
    simulator = Simulator(scene, {"start": (poses[0, :3], poses[0, 3:])})
    _, points = follow(simulator, times, {"start": poses}, knots + 0.98 * REST)
    return np.asarray(points[:, -1, :3])


def _moving(one: Set) -> list[Any]:
    summary = replay_bag(one.path, one.scene, None, compare={"start": "/ft_compensated"})
    x, _, z = summary.comparison["start"]
    return [one.name, x.correlation, x.rms_error, z.correlation, z.rms_error, z.bias]
