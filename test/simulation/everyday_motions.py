"""Thirty everyday scenes with motions as robots make them, any number of others, and how far off
what is computed of them is.

As a program: computes all of them with default settings, compares each with a converged reference
of another discretisation, and tries the advice of the report where accuracy.target is missed.

    .venv/bin/python test/simulation/everyday_motions.py         # the thirty
    .venv/bin/python test/simulation/everyday_motions.py 40      # and forty drawn by chance
    .venv/bin/python test/simulation/everyday_motions.py swings  # ninety undamped swings of 10 s
    .venv/bin/python test/simulation/everyday_motions.py swings velocity_verlet  # by this method
"""

from __future__ import annotations

import math
import re
import sys
import warnings
from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Any

import numpy as np
from numpy.typing import NDArray

from dlo_sim.core import bspline, rotations
from dlo_sim.scene.description import Scene
from dlo_sim.scene.loading import SceneError, scene_from_values
from dlo_sim.simulation.error_estimate import ErrorEstimate, error_along
from dlo_sim.simulation.forecast import Plan
from dlo_sim.simulation.recorder import Recorder
from dlo_sim.simulation.report import MOST_OPEN, DiscretizationError
from dlo_sim.simulation.simulator import Simulator

Array = NDArray[np.float64]
Vector = tuple[float, float, float]
Values = dict[str, Any]
EVERY = 0.05  # [s] between two shapes that are compared
REFERENCE = {
    "discretization.control_points": 161,
    "discretization.knots": "uniform",
    "discretization.stretch": "span",
    "integrator.method": "energy_momentum",
}
LONG_REFERENCE = {"discretization.control_points": 401}  # of a cable of more than 10 m
DOWN = [0.0, 0.0, -1.0]
ALONG = [1.0, 0.0, 0.0]


@dataclass(frozen=True)
class Move:
    """A gripper's motion from rest to rest with the least jerk, then a rest.

    by: displacement [m]; over: raised in the middle of the way by this [m]; turn: rotation vector
    [rad]; within: its duration [s]; later: when it begins [s].
    """

    by: Vector = (0.0, 0.0, 0.0)
    over: Vector = (0.0, 0.0, 0.0)
    turn: Vector = (0.0, 0.0, 0.0)
    within: float = 1.0
    later: float = 0.0

    def poses(self, times: Array, position: Array) -> Array:
        """Positions and quaternions x, y, z, w, shape (T, 7)."""
        s = np.clip((times - self.later) / self.within, 0.0, 1.0)
        share = s**3 * (10.0 - 15.0 * s + 6.0 * s**2)
        bump = 16.0 * (share * (1.0 - share)) ** 2
        place = position + np.outer(share, self.by) + np.outer(bump, self.over)
        return np.hstack([place, rotations.from_rotation_vector(np.outer(share, self.turn))])


@dataclass(frozen=True)
class Everyday:
    """A scene, what its grippers do, and for how long [s]."""

    name: str
    values: dict[str, Any]
    seconds: float
    moves: dict[str, Move] = field(default_factory=dict)

    def plan(self) -> Plan:
        """The motion of the ends that move, with poses at 100 Hz."""
        times = np.linspace(0.0, self.seconds, round(100.0 * self.seconds) + 1)
        places = {end: np.array(self.values[f"{end}.position"]) for end in self.moves}
        poses = {end: move.poses(times, places[end]) for end, move in self.moves.items()}
        return Plan(times, poses)

    def scene(self, changes: Mapping[str, object] | None = None) -> Scene:
        """The scene with default settings, or with changes."""
        return scene_from_values(self.values | dict(changes or {}))

    def simulator(self, scene: Scene) -> Simulator:
        """At its first poses."""
        poses = {end: np.asarray(rows) for end, rows in self.plan().poses.items()}.items()
        return Simulator(scene, {end: (rows[0, :3], rows[0, 3:]) for end, rows in poses})

    def shapes(self, scene: Scene) -> Array:
        """Points of the centerline every 0.05 s, shape (T, 50, 3)."""
        simulator = self.simulator(scene)
        if self.moves:
            found = simulator.forecast(self.plan(), EVERY)
            assert found.report.status.ok, found.report.message
            return found.centerline
        return _watched(simulator, simulator, self.seconds)

    def estimated(self, scene: Scene) -> tuple[Array, DiscretizationError, str]:
        """`shapes`, the estimated errors and the advice."""
        simulator = self.simulator(scene)
        if self.moves:
            places = self.shapes(scene)
            return places, *error_along(simulator, places, self.shapes)
        estimate = ErrorEstimate(simulator)
        places = _watched(simulator, estimate, self.seconds)
        return places, estimate.largest, estimate.advice(estimate.largest)

    def reference(self) -> Array:
        """Converged shapes of other settings: equal spans, far more, a quarter of the step."""
        scene = self.scene(REFERENCE)
        if scene.cable.length > 10.0:
            scene = scene.with_values(LONG_REFERENCE)
        step = self.simulator(scene).step
        return self.shapes(scene.with_values({"integrator.step": step / 4.0}))


def _watched(simulator: Simulator, driven: Simulator | ErrorEstimate, seconds: float) -> Array:
    """Shapes of a simulator that is advanced by `driven`."""
    times = np.arange(1, round(seconds / EVERY) + 1, dtype=np.float64) * EVERY
    recorder = Recorder(simulator.model, np.asarray(times, dtype=np.float64))
    report = driven.advance_steps(math.ceil(seconds / simulator.step - 1e-9), recorder)
    assert report.status.ok, report.message
    u = np.linspace(0.0, simulator.scene.cable.length, 50)
    basis = bspline.evaluate(np.eye(simulator.model.n), simulator.model.knots, u)
    return np.asarray(basis @ recorder.control_points[:, :, :3])


@dataclass(frozen=True)
class Checked:
    """What came of an everyday scene with default settings, distances in metres.

    Attributes:
        true: largest distance from the reference. estimated: by the report. advice: its line.
        after: distance once the advice was followed; 0 without advice.
        target: accuracy.target. chosen: number of control points, and why.
    """

    true: float
    estimated: float
    advice: str
    after: float
    target: float
    chosen: str

    @property
    def good(self) -> bool:
        """Whether the target is met, or its being missed is told with advice that helps."""
        if self.true > self.target and not self.advice:
            return False
        return self.after <= self.target


def advised(advice: str) -> dict[str, object]:
    """The changes that a line of advice asks for."""
    keys = {
        "discretization.control_points": int,
        "discretization.samples": int,
        "integrator.step": float,
    }
    found = {key: re.search(rf"{re.escape(key)} to ([-+.e0-9]+)", advice) for key in keys}
    return {key: keys[key](hit.group(1)) for key, hit in found.items() if hit}


def checked(everyday: Everyday, changes: Mapping[str, object] | None = None) -> Checked:
    """Compute a scene with default settings (or changes), follow the advice, and compare."""
    reference, scene = everyday.reference(), everyday.scene(changes)
    places, error, advice = everyday.estimated(scene)
    after = 0.0
    if advice:
        after = _apart(everyday.shapes(scene.with_values(advised(advice))), reference)
    true, target = _apart(places, reference), scene.accuracy.target
    return Checked(true, error.total, advice, after, target, everyday.simulator(scene).resolution)


def _apart(one: Array, other: Array) -> float:
    return float(np.linalg.norm(one - other, axis=-1).max())


def _cable(
    length: float,
    diameter_mm: float,
    grams_per_m: float,
    bending: float,
    damping: float = 0.02,
    axial: float = 0.0,
    drag: float = 0.01,
) -> Values:
    """A cable of bending stiffness [N m^2]; stretched by its weight by 0.1 % at most."""
    weight = 9.81e-3 * grams_per_m * length
    return {
        "cable.length": length,
        "cable.diameter": 1e-3 * diameter_mm,
        "cable.linear_density": 1e-3 * grams_per_m,
        "cable.bending_stiffness": bending,
        "cable.torsional_stiffness": 0.8 * bending,
        "cable.axial_stiffness": axial or 1e3 * max(weight, 0.5),
        "damping.stiffness": damping,
        "damping.air_drag": drag,
    }


def _between(
    gap: float,
    height: float = 0.0,
    tangents: tuple[list[float], list[float]] = (ALONG, ALONG),
    clamped: tuple[bool, bool] = (True, True),
) -> Values:
    """Held by two grippers, the second so far along x and z from the first."""
    values: Values = {
        "start.position": [0.0, 0.0, 1.0],
        "end.position": [gap, 0.0, 1.0 + height],
        "end.fixed": [True] * 3,
        "initial.shape": "equilibrium",
    }
    for end, tangent, clamp in zip(("start", "end"), tangents, clamped, strict=True):
        values[f"{end}.clamped"] = clamp
        values[f"{end}.pose_topic"] = f"~/{end}/pose"
        if clamp:
            values[f"{end}.tangent"] = tangent
    return values


def _hanging(
    length: float,
    tangent: list[float] = DOWN,
    shape: str = "equilibrium",
    clamped: bool = True,
    driven: bool = True,
) -> Values:
    """Held at its start alone."""
    values: Values = {
        "start.position": [0.0, 0.0, 2.0],
        "start.clamped": clamped,
        "end.position": [0.0, 0.0, 2.0 - length],
        "initial.shape": shape,
    }
    if clamped:
        values["start.tangent"] = tangent
    if driven:
        values["start.pose_topic"] = "~/start/pose"
    return values


SOFT = _cable(1.0, 6.0, 32.5, 1.27e-4, 0.01, drag=0.005)  # two_grippers
ROPE = _cable(2.0, 12.0, 90.0, 2e-3)
CLIMBING = _cable(3.0, 10.0, 65.0, 8e-4)
TUBE = _cable(0.6, 8.0, 45.0, 1.5e-4)
USB = _cable(0.8, 4.0, 30.0, 5.9e-4)
HOSE = _cable(1.5, 25.0, 400.0, 0.071)
CORD = _cable(1.2, 8.0, 90.0, 6e-3)
NETWORK = _cable(1.0, 6.0, 42.0, 4e-3)
HARNESS = _cable(1.8, 15.0, 250.0, 0.03)
STRING = _cable(0.3, 1.5, 1.8, 1.5e-6, 0.01, drag=0.001)
STEEL = _cable(1.0, 1.5, 14.0, 0.05, 0.002)
LEAD = _cable(0.5, 3.0, 14.0, 6e-5)
# 20 mm thick, E 1.2e11 Pa, 7000 kg/m^3
LONG = _cable(100.0, 20.0, 2199.0, 942.0, 0.005, axial=3.77e7)

EVERYDAY = (
    Everyday(
        "soft, approach", SOFT | _between(0.8), 4.0, {"end": Move((-0.3, 0.0, 0.0), within=2.0)}
    ),
    Everyday("soft, lift", SOFT | _between(0.7), 4.0, {"end": Move((0.0, 0.2, 0.25), within=2.0)}),
    Everyday(
        "soft, turn in space",
        SOFT | _between(0.8),
        6.0,
        {"end": Move((-0.3, 0.2, 0.15), (0.0, 0.0, 0.15), (1.2, 0.4, -0.5), 4.0)},
    ),
    Everyday(
        "rope, sideways", ROPE | _hanging(2.0), 4.0, {"start": Move((0.4, 0.0, 0.0), within=1.5)}
    ),
    Everyday(
        "rope, level clamp",
        ROPE | _hanging(2.0, ALONG),
        4.0,
        {"start": Move((0.0, 0.0, 0.3), within=1.5)},
    ),
    Everyday(
        "rope, two grippers",
        ROPE | _between(1.6),
        4.0,
        {"start": Move((0.25, 0.0, 0.0), within=2.0), "end": Move((0.0, 0.2, 0.1), within=2.0)},
    ),
    Everyday(
        "rope, two grippers downwards",
        ROPE | _between(0.5, 0.0, (DOWN, [0.0, 0.0, 1.0])),
        4.0,
        {"end": Move((0.4, 0.0, 0.2), within=2.0)},
    ),
    Everyday(
        "climbing rope, between",
        CLIMBING | _between(2.2, 0.3),
        5.0,
        {"end": Move((-0.5, 0.3, 0.0), within=2.5)},
    ),
    Everyday(
        "climbing rope, hanging",
        CLIMBING | _hanging(3.0),
        5.0,
        {"start": Move((0.0, 0.5, 0.2), within=2.0)},
    ),
    Everyday(
        "tube, level clamp",
        TUBE | _hanging(0.6, ALONG),
        3.0,
        {"start": Move((0.25, 0.0, 0.1), within=1.0)},
    ),
    Everyday(
        "tube, between", TUBE | _between(0.45), 3.0, {"end": Move((-0.2, 0.1, 0.0), within=1.5)}
    ),
    Everyday(
        "tube, turned gripper",
        TUBE | _between(0.45),
        3.0,
        {"end": Move((-0.1, 0.0, 0.05), turn=(0.0, 0.9, 0.3), within=1.5)},
    ),
    Everyday(
        "USB, plug in",
        USB | _between(0.5),
        3.0,
        {"end": Move((0.1, 0.15, -0.2), turn=(0.0, 0.6, 0.0), within=1.5)},
    ),
    Everyday(
        "USB, level clamp",
        USB | _hanging(0.8, ALONG),
        3.0,
        {"start": Move((0.3, 0.2, 0.0), within=1.2)},
    ),
    Everyday(
        "USB, close grippers", USB | _between(0.3), 3.0, {"end": Move((0.05, 0.1, 0.1), within=1.5)}
    ),
    Everyday(
        "hose, between", HOSE | _between(1.2), 4.0, {"end": Move((-0.3, 0.2, 0.2), within=2.0)}
    ),
    Everyday(
        "hose, hanging", HOSE | _hanging(1.5), 4.0, {"start": Move((0.4, 0.0, 0.0), within=1.0)}
    ),
    Everyday(
        "cord, between",
        CORD | _between(0.9),
        4.0,
        {
            "start": Move((0.1, 0.0, 0.1), within=1.5),
            "end": Move((-0.1, 0.2, 0.0), (0.0, 0.0, 0.1), (0.3, 0.0, 0.8), 2.0),
        },
    ),
    Everyday(
        "cord, wave",
        CORD | _hanging(1.2),
        4.0,
        {"start": Move((0.0, 0.0, 0.0), (0.3, 0.0, 0.1), within=1.2)},
    ),
    Everyday(
        "network cable, pinned",
        NETWORK | _between(0.7, clamped=(True, False)),
        4.0,
        {"end": Move((-0.2, 0.2, 0.1), within=1.5)},
    ),
    Everyday(
        "network cable, twist",
        NETWORK | _between(0.8),
        4.0,
        {"end": Move((-0.1, 0.0, 0.0), turn=(1.5, 0.0, 0.0), within=2.0)},
    ),
    Everyday(
        "harness, between",
        HARNESS | _between(1.3, -0.2),
        4.0,
        {"end": Move((0.2, 0.3, 0.1), within=2.0)},
    ),
    Everyday(
        "harness, hanging",
        HARNESS | _hanging(1.8, ALONG),
        4.0,
        {"start": Move((0.3, 0.0, 0.2), within=1.5)},
    ),
    Everyday(
        "string, between",
        STRING | _between(0.22),
        3.0,
        {"end": Move((-0.1, 0.05, 0.05), within=1.5)},
    ),
    Everyday(
        "steel wire, let go",
        STEEL | _hanging(1.0, ALONG, "straight", driven=False) | {"end.position": [1.0, 0.0, 2.0]},
        2.0,
    ),
    Everyday(
        "lead, swing",
        LEAD
        | _hanging(0.5, [0.6, 0.0, -0.8], "straight", False)
        | {"end.position": [0.3, 0.0, 1.6]},
        3.0,
    ),
    Everyday(
        "soft, sway",
        SOFT
        | _between(0.8)
        | {
            "loads.names": ["wind"],
            "loads.wind.type": "force",
            "loads.wind.position": 0.5,
            "loads.wind.signal": "sine",
            "loads.wind.frequency": 1.0,
            "loads.wind.force": [0.0, 0.05, 0.0],
        },
        3.0,
    ),
    Everyday(
        "rope, tip load",
        ROPE | _hanging(2.0) | {"end.mass": 0.3},
        4.0,
        {"start": Move((0.4, 0.2, 0.0), within=1.5)},
    ),
    Everyday(
        "natural curvature",
        CORD
        | _between(0.8)
        | {"cable.rest_curvature": [4.0], "cable.rest_curvature_axis": [0.0, 1.0, 0.0]},
        4.0,
        {"end": Move((-0.1, 0.1, 0.1), within=2.0)},
    ),
    Everyday(
        "long cable",
        LONG | _between(95.0) | {"start.pose_topic": ""},
        4.0,
        {"end": Move((-1.0, 0.0, 0.5), within=3.0)},
    ),
)


def drawn(seed: int) -> Everyday:
    """A cable between a rope and a hose, held by one or two grippers that move by chance."""
    rng = np.random.default_rng(seed)
    length = float(np.exp(rng.uniform(np.log(0.3), np.log(3.0))))
    weight = float(np.exp(rng.uniform(np.log(15.0), np.log(300.0))))  # g/m
    # Under its own weight it bends over 1 to 10 % of its length.
    bend = length * float(np.exp(rng.uniform(np.log(0.012), np.log(0.12))))
    stiffness = 9.81e-3 * weight * length * bend**2
    values = _cable(length, 8.0, weight, stiffness, rng.choice([0.005, 0.02, 0.05]))
    turn = tuple(rng.uniform(-0.6, 0.6, 3) * rng.integers(0, 2))
    within = float(rng.uniform(1.0, 2.5))
    by = tuple(rng.uniform(-1.0, 1.0, 3) * min(0.25 * length, 0.35))
    over = (0.0, 0.0, float(rng.uniform(0.0, 0.1)))
    if rng.random() < 0.4:
        values |= _hanging(length, DOWN if rng.random() < 0.5 else ALONG)
        if rng.random() < 0.3:
            values["end.mass"] = 1e-3 * weight * length * float(rng.uniform(0.2, 2.0))
        moves = {"start": Move(by, over, turn, within)}
    else:
        values |= _between(length * float(rng.uniform(0.45, 0.7)), 0.1 * length * rng.normal())
        moves = {"end": Move(tuple(0.6 * np.array(by)), over, turn, within)}
    return Everyday(f"drawn, seed {seed}", values, 4.0, moves)


def swing(seed: int) -> Everyday:
    """A cable between soft rubber and hard plastic, let go from a straight line, undamped."""
    rng = np.random.default_rng(seed)
    length = float(np.exp(rng.uniform(np.log(0.3), np.log(3.0))))
    diameter = float(np.exp(rng.uniform(np.log(0.002), np.log(0.012))))
    modulus = float(10.0 ** rng.uniform(5.0, 9.0))
    angle = float(rng.uniform(-1.2, 0.9)) if rng.random() < 0.5 else 0.0
    values: Values = {
        "cable.length": length,
        "cable.diameter": diameter,
        "cable.youngs_modulus": modulus,
        "cable.shear_modulus": modulus / 3.0,
        "start.clamped": bool(rng.random() < 0.5),
        "end.position": [length * math.cos(angle), 0.0, length * math.sin(angle)],
    }
    return Everyday(f"swing, seed {seed}", values, 10.0)


SWINGS = 90
CLOSED = 1e-4  # largest energy error of a swing of the chosen method


def swings(method: str) -> int:
    """Compute all swings and print a line for each; how many are wrong without a word."""
    bad = 0
    for everyday in map(swing, range(SWINGS)):
        simulator = Simulator(everyday.scene({"integrator.method": method}))
        report = simulator.advance(everyday.seconds)
        if method == "auto":
            wrong = not (report.status.advanced and simulator.energy_error < CLOSED)
        else:
            silent = report.status.ok and not simulator.warnings
            wrong = silent and simulator.energy_error > MOST_OPEN
        bad += wrong
        found = f"{simulator.method}, {report.status.name}, energy error"
        print(f"{everyday.name:16s} {found} {simulator.energy_error:.1e}{'  BAD' * wrong}")
    print(f"{bad} of {SWINGS} diverge, or are wrong and nothing says so")
    return bad


def main(more: int) -> int:
    """Compute all and print a line for each; the number of scenes that are not good."""
    warnings.simplefilter("ignore", UserWarning)
    bad = 0
    for everyday in (*EVERYDAY, *map(drawn, range(more))):
        try:
            found = checked(everyday)
        except (SceneError, AssertionError) as failure:
            print(f"{everyday.name:30s} FAILED: {failure}", flush=True)
            bad += 1
            continue
        bad += not found.good
        numbers = f"true {1e3 * found.true:7.3f} mm, estimated {1e3 * found.estimated:7.3f} mm"
        after = f", after the advice {1e3 * found.after:.3f} mm: {found.advice}" * bool(
            found.advice
        )
        verdict = "" if found.good else "  BAD"
        print(f"{everyday.name:30s} {numbers}, {found.chosen}{after}{verdict}", flush=True)
    print(f"{bad} of {len(EVERYDAY) + more} are wrong and nothing says so, or the advice fails")
    return bad


if __name__ == "__main__":
    if sys.argv[1:2] == ["swings"]:
        sys.exit(swings([*sys.argv, "auto"][2]) > 0)
    sys.exit(main(int(sys.argv[1]) if len(sys.argv) > 1 else 0) > 0)
