"""Scenes by kind, which `judge` judges; everyday motions are compared with a converged run.

    python test/simulation/corpus.py random 2000 [SEED]  # whatever a user may ask for
    python test/simulation/corpus.py rest 2000 [SEED]    # everyday cables that start at rest
    python test/simulation/corpus.py table 2000 [SEED]   # the same above a table
    python test/simulation/corpus.py extremes            # stiff, thin, long or short cables
    python test/simulation/corpus.py swings [METHOD]     # ninety undamped swings of 10 s
    python test/simulation/corpus.py motions [40]        # thirty motions of robots, and forty drawn

Each prints what became of the scenes and every one that went wrong, and ends with status 1 if one
did.
"""

from __future__ import annotations

import math
import re
import sys
import warnings
from collections import Counter
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field, replace
from functools import partial
from typing import Any

import judge
import numpy as np
from judge import PIECES, Action, Case, Vector
from numpy.typing import NDArray

from dlo_sim.batch.workers import open_workers
from dlo_sim.core import bspline, rotations
from dlo_sim.core.end_motion import EndMotion
from dlo_sim.core.methods import METHODS
from dlo_sim.scene.description import Scene
from dlo_sim.scene.loading import SceneError, scene_from_values
from dlo_sim.simulation.error_estimate import ErrorEstimate, error_along
from dlo_sim.simulation.forecast import Plan
from dlo_sim.simulation.play import Watcher, play
from dlo_sim.simulation.recorder import Recorder
from dlo_sim.simulation.report import DiscretizationError
from dlo_sim.simulation.simulator import Simulator

Array = NDArray[np.float64]
Values = dict[str, Any]
Rng = np.random.Generator

DOWN, ALONG = [0.0, 0.0, -1.0], [1.0, 0.0, 0.0]
FREE_ENDS: Values = {"start.fixed": [False] * 3, "end.fixed": [False] * 3}
FLAT: Values = {"gravity": [0.0] * 3}
STRAIGHT: Values = {"initial.shape": "straight"}
AT_REST: Values = {"initial.shape": "equilibrium"}


@dataclass(frozen=True)
class Shift:
    """An end moves and turns at constant rates from now on, or jumps.

    way: velocity [m/s], or the jump [m]; turn: rate [rad/s], None for a jump; duration [s], or 0:
    that of `steps` steps.
    """

    end: str
    way: Vector
    turn: Vector | None = None
    duration: float = 0.0
    steps: int = 0

    def __call__(self, sim: Simulator) -> None:
        position, orientation = sim.end_pose(self.end)
        if self.turn is None:
            sim.set_end(self.end, position=position + np.array(self.way))
            return
        motion = EndMotion(
            start=sim.time,
            duration=self.duration or self.steps * sim.step,
            position=position,
            orientation=orientation,
            velocity=self.way,
            angular_velocity=self.turn,
        )
        sim.set_motion(self.end, motion)


def log_uniform(rng: Rng, low: float, high: float) -> float:
    """A number whose logarithm is uniform."""
    return float(np.exp(rng.uniform(np.log(low), np.log(high))))


def direction(rng: Rng) -> Array:
    """A random unit vector."""
    v = rng.standard_normal(3)
    return v / math.hypot(*v)


def turned(rng: Rng, along: Array, angle: float) -> Array:
    """A unit vector at an angle to `along`, towards a random side."""
    side = np.cross(along, direction(rng))
    return np.cos(angle) * along + np.sin(angle) * side / math.hypot(*side)


def solid(length: float, diameter: float, density: float, modulus: float, shear: float) -> Values:
    """A round cable, elastic moduli in Pa."""
    return {
        "cable.length": length,
        "cable.diameter": diameter,
        "cable.density": density,
        "cable.youngs_modulus": modulus,
        "cable.shear_modulus": shear,
    }


# -- whatever a user may ask for ------------------------------------------------------------------
# A kind decides which terms exist; everything else is drawn over ranges that no single application
# spans. Only methods that are valid with the damping drawn are drawn.

DAMPING = {"mass": (1e-3, 1e3), "stiffness": (1e-6, 1e1), "air_drag": (1e-6, 1e1)}  # ranges
IMPLICIT = ("energy_momentum", "energy_momentum_4", "implicit_midpoint")
ALL = (*IMPLICIT, "forest_ruth", "velocity_verlet", "rk4", "zhai")


@dataclass(frozen=True)
class Kind:
    """One set of terms: what is drawn for it, the methods that may be asked for, whether its ends
    are moved, and kinds of damping that it may have, each with the probability `damped`; without
    `undamped` it always has one of them.
    """

    name: str
    draw: Callable[[Rng, Values], None]
    methods: tuple[str, ...] = ALL
    driven: bool = False
    damping: tuple[str, ...] = ()
    damped: float = 0.5
    undamped: bool = True


def weight(values: Values) -> float:
    """Weight of the cable on earth [N]."""
    area = np.pi * values["cable.diameter"] ** 2 / 4.0
    return float(9.81 * values["cable.density"] * area * values["cable.length"])


def _in_space(rng: Rng, values: Values, low: float, high: float, twist: str = "off") -> None:
    """The ends apart by a share of the length, in any direction; gravity in another."""
    gap = values["cable.length"] * rng.uniform(low, high)
    start = direction(rng) * values["cable.length"] * rng.uniform(0.0, 3.0)
    values["start.position"] = start.tolist()
    values["end.position"] = (start + gap * direction(rng)).tolist()
    values["gravity"] = (direction(rng) * log_uniform(rng, 0.1, 100.0)).tolist()
    values |= {"terms.out_of_plane": "on", "terms.twist": twist}


def _add_load(rng: Rng, values: Values, name: str, torque: bool = False) -> None:
    """A constant or sine load of any size from a thousandth to a thousand weights."""
    key = f"loads.{name}"
    values["loads.names"] = [*values.get("loads.names", []), name]
    size = log_uniform(rng, 1e-3, 1e3) * weight(values)
    values[f"{key}.type"] = "wrench" if torque else "force"
    values[f"{key}.position"] = float(rng.choice([0.0, 0.5, 1.0, rng.uniform()]))
    values[f"{key}.signal"] = str(rng.choice(["constant", "sine"]))
    values[f"{key}.force"] = (size * direction(rng)).tolist()
    values[f"{key}.frequency"] = log_uniform(rng, 0.01, 1e3)
    if torque:
        arm = values["cable.length"] * log_uniform(rng, 1e-3, 1.0)
        values[f"{key}.torque"] = (size * arm * direction(rng)).tolist()


def _plane_springs(rng: Rng, values: Values) -> None:
    """In the xz plane, ends guided along x on springs; released straight, or shaken at rest."""
    values["end.position"] = [values["cable.length"] * rng.uniform(0.3, 1.2), 0.0, 0.0]
    for end in ("start", "end"):
        values[f"{end}.fixed"] = [False, True, True]
        values[f"{end}.spring"] = [log_uniform(rng, 1e-3, 1e8), 0.0, 0.0]
    values["gravity"] = [0.0, 0.0, -log_uniform(rng, 0.1, 100.0)]
    _add_load(rng, values, "push")
    values["loads.push.force"][1] = 0.0
    released = rng.uniform() < 0.75
    values["initial.shape"] = "straight" if released else "auto"
    # A constant load is part of the equilibrium that "auto" starts from: nothing would happen.
    values["loads.push.signal"] = "constant" if released else "sine"


def _hanging(rng: Rng, values: Values) -> None:
    """One end held, the other free, perhaps with a mass, and a force."""
    _in_space(rng, values, 0.5, 1.0)
    values["end.fixed"] = [False] * 3
    mass = weight(values) / 9.81 * log_uniform(rng, 0.01, 10)
    values["end.mass"] = float(rng.choice([0.0, mass]))
    values["start.clamped"] = bool(rng.integers(2))
    _add_load(rng, values, "push")


def _free_flight(rng: Rng, values: Values) -> None:
    """Nothing held, no gravity; thrown, or pushed by two loads, one perhaps with a torque."""
    _in_space(rng, values, 0.5, 1.0)
    values |= FLAT | FREE_ENDS
    if rng.integers(2):
        return
    _add_load(rng, values, "left", torque=bool(rng.integers(2)))
    _add_load(rng, values, "right")
    if rng.integers(2):
        for name in ("left", "right"):
            values[f"loads.{name}.signal"] = "constant"  # known impulses


def _pulled(rng: Rng, values: Values, twist: str = "off") -> None:
    """Both ends held and moved about."""
    _in_space(rng, values, 0.2, 1.0, twist)
    for end in ("start", "end"):
        values[f"{end}.fixed"] = [True] * 3
        values[f"{end}.clamped"] = bool(rng.integers(2))
        values[f"{end}.pose_topic"] = f"/{end}"


def _grippers(rng: Rng, values: Values) -> None:
    """Two grippers that move and turn, twist."""
    _pulled(rng, values, twist="quasistatic")


def _damped(rng: Rng, values: Values) -> None:
    """Springs, natural curvature, a force or a wrench."""
    _in_space(rng, values, 0.2, 1.5)
    values["end.fixed"] = [False, False, bool(rng.integers(2))]
    values["end.spring"] = [log_uniform(rng, 1e-3, 1e8), log_uniform(rng, 1e-3, 1e8), 0.0]
    bends = rng.uniform(-6.0, 6.0, size=rng.integers(1, 4)) / values["cable.length"]
    values["cable.rest_curvature"] = bends.tolist()
    values["cable.rest_curvature_axis"] = direction(rng).tolist()
    _add_load(rng, values, "push", torque=bool(rng.integers(2)))


KINDS = (
    Kind("plane springs", _plane_springs),
    Kind("hanging", _hanging),
    Kind("free flight", _free_flight, (*IMPLICIT, "forest_ruth", "velocity_verlet")),
    Kind("grippers", _grippers, IMPLICIT, True, tuple(DAMPING)),
    Kind("damped", _damped, IMPLICIT, damping=tuple(DAMPING), undamped=False),
    Kind("pulled", _pulled, driven=True),
)


def draw_random(seed: int, kinds: tuple[Kind, ...] = KINDS) -> Case:
    """The random case of a seed."""
    rng = np.random.default_rng(seed)
    kind = kinds[int(rng.integers(len(kinds)))]
    modulus = log_uniform(rng, 1e4, 1e12)
    size = log_uniform(rng, 1e-3, 1e3), log_uniform(rng, 1e-5, 5e-2), log_uniform(rng, 3.0, 2e4)
    values = solid(*size, modulus, modulus / rng.uniform(2.0, 3.0)) | {
        "discretization.control_points": round(log_uniform(rng, 4.0, 200.0)),
        "discretization.mass": str(rng.choice(["consistent", "consistent", "lumped"])),
        "discretization.samples": int(rng.integers(2, 6)),
    }
    kind.draw(rng, values)
    chosen = [name for name in kind.damping if rng.uniform() < kind.damped]
    if not chosen and not kind.undamped:
        chosen = [str(rng.choice(kind.damping))]
    for name in chosen:
        values[f"damping.{name}"] = log_uniform(rng, *DAMPING[name])
    methods = [name for name in kind.methods if _can_damp(name, chosen)]
    values["integrator.method"] = str(rng.choice(["auto", *methods]))
    values["integrator.step"] = 0.0 if rng.uniform() < 0.4 else log_uniform(rng, 1e-6, 1e-1)
    steps = int(min(max(4e4 / values["discretization.control_points"], 50), 1000))
    events = _draw_shifts(rng, values, steps // PIECES) if kind.driven else ()
    throw: Throw = ()
    if kind.draw is _free_flight and "loads.names" not in values:
        speeds = (direction(rng) * log_uniform(rng, 1e-3, 10.0) for _ in range(3))
        throw = tuple(tuple(speed.tolist()) for speed in speeds)
    return random_case(kind.name, values, steps, seed, events, throw)


Events = tuple[tuple[float, Action], ...]
Throw = tuple[Vector, ...]


def random_case(
    name: str, values: Values, steps: int, seed: int, events: Events = (), throw: Throw = ()
) -> Case:
    """A case that may be refused or stop, but must be balanced."""
    whole = steps // PIECES * PIECES
    more: Values = {"must_run": False, "balanced": True, "seed": seed}
    return Case(name, values, steps=whole, events=events, throw=throw, **more)


def _can_damp(name: str, damping: list[str]) -> bool:
    method = METHODS[name]
    by_mass = method.mass_damping or not {"mass", "air_drag"} & set(damping)
    return by_mass and (method.stiffness_damping or "stiffness" not in damping)


def _draw_shifts(rng: Rng, values: Values, steps: int) -> tuple[tuple[float, Action], ...]:
    """Three motions in order, each for so many steps, one in four of them a jump."""
    events = []
    for piece in sorted(rng.integers(0, PIECES - 1, size=3).tolist()):
        end = str(rng.choice(["start", "end"]))
        if rng.uniform() < 0.25:
            jump = direction(rng) * values["cable.length"] * log_uniform(rng, 1e-3, 1.0)
            shift = Shift(end, tuple(jump.tolist()))
        else:
            speed = direction(rng) * log_uniform(rng, 1e-3, 10.0)
            turn = direction(rng) * log_uniform(rng, 1e-2, 10.0)
            shift = Shift(end, tuple(speed.tolist()), tuple(turn.tolist()), steps=steps)
        events.append((piece / PIECES, shift))
    return tuple(events)


# Scenes that went wrong once, about as they were drawn then.
_IN_FLIGHT = FLAT | FREE_ENDS | {"terms.out_of_plane": "on", "terms.twist": "off"}
_IN_FLIGHT |= {"loads.names": ["left", "right"], "loads.left.type": "wrench"}
_IN_FLIGHT |= {"loads.left.signal": "constant", "loads.right.signal": "constant"}
_TORN = solid(6.909, 1.533e-5, 428.6, 7.985e11, 3.665e11) | {
    "discretization.control_points": 35,
    "start.position": [-0.02319, 0.2727, -0.09089],
    "end.position": [0.08496, 5.419, 2.226],
    "loads.left.position": 0.0,
    "loads.left.force": [-4.044e-4, 1.491e-3, -1.031e-3],
    "loads.left.torque": [-1.636e-5, 3.814e-6, 7.692e-6],
    "loads.right.position": 0.5,
    "loads.right.force": [-6.752e-10, -5.038e-8, 1.151e-7],
    "integrator.method": "energy_momentum_4",
    "integrator.step": 7.878e-3,
}
_LONG = solid(115.3, 0.03394, 3.401, 4.182e10, 1.589e10) | {
    "discretization.control_points": 9,
    "discretization.samples": 4,
    "start.position": [-44.63, -45.85, -244.5],
    "end.position": [-58.0, -102.5, -329.7],
    "loads.left.position": 0.5,
    "loads.left.force": [2.669e-3, 2.738e-2, 4.792e-3],
    "loads.left.torque": [-5.209e-3, -1.379e-3, -2.291e-3],
    "loads.right.force": [-3.195e-3, -1.865e-3, 9.581e-4],
    "integrator.step": 1.249e-6,
}
_FOLDING = solid(35.96, 2.094e-4, 7106.0, 7.307e10, 3.107e10) | {
    "discretization.control_points": 8,
    "discretization.samples": 2,
    "terms.out_of_plane": "on",
    "terms.twist": "off",
    "start.position": [-18.11, -19.84, -12.57],
    "start.fixed": [True] * 3,
    "start.pose_topic": "/start",
    "end.position": [7.115, -28.68, -7.13],
    "end.fixed": [True] * 3,
    "end.clamped": True,
    "end.pose_topic": "/end",
    "gravity": [18.98, 51.66, -22.1],
}
_FOLDS = (
    (0.0, Shift("end", (-0.2481, -2.66, 0.2791))),
    (0.0, Shift("end", (3.505, -4.878, -1.887), (0.0134, -0.3676, 0.1225), steps=125)),
    (0.25, Shift("end", (1.458, -1.611, 4.690), (0.0192, 0.0236, -0.0030), steps=125)),
)
ONCE_WRONG = {
    # Every step took seconds.
    "torn": random_case("torn", _IN_FLIGHT | _TORN, 1000, 1508),
    # Rounded coordinates lost the momentum.
    "long": random_case("long", _IN_FLIGHT | _LONG, 1000, 1712),
    # It folds at the clamp; jumps were booked as mean force times way: 0.63 of the energy.
    "folding": random_case("folding", _FOLDING, 1000, 1866, _FOLDS),
}

# -- everyday scenes that start at rest -----------------------------------------------------------

# Young's modulus [Pa], shear modulus [Pa], density [kg/m^3], EI as a share of the solid section's.
MATERIALS = {
    "rope": (1e9, 3e8, 1100.0, 1e-3),
    "soft cable": (2e6, 7e5, 1150.0, 1.0),
    "hose": (1e7, 3.5e6, 1200.0, 0.6),
    "cable": (1.2e8, 4e7, 2500.0, 1.0),
    "nylon": (2.5e9, 9e8, 1150.0, 1.0),
    "steel wire": (2e11, 7.9e10, 7800.0, 1.0),
}


def _everyday(material: str, length: float, diameter: float) -> Values:
    modulus, shear, density, share = MATERIALS[material]
    return solid(length, diameter, density, modulus, shear) | {
        "initial.shape": "equilibrium",
        "cable.bending_stiffness": share * modulus * np.pi * diameter**4 / 64.0,
        "cable.torsional_stiffness": share * shear * np.pi * diameter**4 / 32.0,
    }


def draw_at_rest(seed: int) -> Case:
    """A free cable between one or two grippers."""
    rng = np.random.default_rng(seed)
    material = str(rng.choice(list(MATERIALS)))
    length = 100.0 if rng.uniform() < 0.04 else log_uniform(rng, 0.1, 3.0)
    diameter = min(log_uniform(rng, 1e-3, 3e-2), length / 20.0)
    values = _everyday(material, length, diameter) | {"discretization.control_points": 13}
    values["start.clamped"] = bool(rng.uniform() < 0.9)
    if rng.uniform() < 0.2:
        values["gravity"] = (9.81 * direction(rng)).tolist()
    heavy, start = weight(values), rng.uniform(-1.0, 1.0, 3)
    if rng.uniform() < 0.15:
        start = start + direction(rng) * log_uniform(rng, 1e3, 5e6)
    way = direction(rng)
    if rng.uniform() < 0.5:
        way[2] = 0.1 * way[2]
        way /= math.hypot(*way)
    most = 0.5 if rng.uniform() < 0.8 else np.pi
    values["start.position"] = start.tolist()
    values["start.tangent"] = turned(rng, way, rng.uniform(0.0, most)).tolist()
    grippers = 1 if rng.uniform() < 0.2 else 2
    span = rng.uniform(0.02, 1.0)
    if rng.uniform() < 0.04:
        span = rng.uniform(1.0, 1.002)
    values["end.position"] = (start + span * length * way).tolist()
    if grippers == 1:
        values |= {"end.fixed": [False] * 3, "start.clamped": True}
        if rng.uniform() < 0.5:
            values["end.mass"] = log_uniform(rng, 0.03, 30.0) * heavy / 9.81
    else:
        values |= {"end.fixed": [True] * 3, "end.clamped": bool(rng.uniform() < 0.9)}
        values["end.tangent"] = turned(rng, way, rng.uniform(0.0, most)).tolist()
    if rng.uniform() < 0.1:
        values |= {"loads.names": ["push"], "loads.push.signal": "constant"}
        values["loads.push.position"] = rng.uniform()
        values["loads.push.force"] = (rng.uniform(0.0, 3.0) * heavy * direction(rng)).tolist()
    if grippers == 2 and not values["end.clamped"] and rng.uniform() < 0.3:
        values |= {"end.fixed": [False] * 3, "end.spring": [log_uniform(rng, 10.0, 1e4)] * 3}
    if grippers == 2 and rng.uniform() < 0.05:
        share = rng.uniform(0.2, 0.8)
        place = start + share * span * length * way + 0.1 * (1.0 - span) * length * direction(rng)
        values |= {"grasps.names": ["hand"], "grasps.hand.at": share}
        values["grasps.hand.position"] = place.tolist()
    if rng.uniform() < 0.15:
        values["cable.rest_curvature"] = [rng.uniform(-2.0, 2.0) / length]
    name = f"{grippers} {material} {'turned' if most > 0.5 else 'core'}"
    return Case(name, values, check=judge.right_at_rest, seed=seed)


def draw_above_table(seed: int) -> Case:
    """Above a table of height 0: drag chains, slack between grippers, a box below it, one gripper
    that points down or ahead with a cable longer than its height.
    """
    rng = np.random.default_rng(seed)
    material = str(rng.choice(list(MATERIALS)))
    length = log_uniform(rng, 0.3, 3.0)
    diameter = min(log_uniform(rng, 2e-3, 2e-2), length / 40.0)
    values = _everyday(material, length, diameter) | {
        "start.clamped": True,
        "obstacles.names": ["table"],
        "obstacles.table.shape": "plane",
        "damping.mass": 2.0,
    }
    kind = str(rng.choice(["drag chain", "slack", "end on table", "box", "down", "ahead"]))
    aside = 0.0 if rng.uniform() < 0.5 else rng.uniform(-0.1, 0.1) * length
    low, high = 0.5 * diameter, rng.uniform(0.1, 0.3) * length
    ends: Values = {"end.fixed": [True] * 3, "end.clamped": True}
    tilt = rng.uniform(-0.3, 0.3)
    if kind == "drag chain":
        begin, end = [0.0, 0.0, low], [rng.uniform(0.1, 0.5) * length, aside, high]
        tangents = [1.0, 0.0, 0.0], [-np.cos(tilt), np.sin(tilt) * (aside != 0.0), 0.0]
    elif kind == "end on table":
        begin, end = [0.0, 0.0, low], [rng.uniform(0.4, 0.8) * length, aside, high]
        tangents = [1.0, 0.0, 0.0], [abs(np.sin(tilt)), 0.0, np.cos(tilt)]
    elif kind in ("slack", "box"):
        begin = [0.0, 0.0, high]
        end = [rng.uniform(0.4, 0.9) * length, aside, high * rng.uniform(0.5, 1.5)]
        down = rng.uniform(-1.5, 0.3, 2)
        tangents = [np.cos(down[0]), 0.0, np.sin(down[0])], [np.cos(down[1]), 0.0, -np.sin(down[1])]
    else:
        begin, end = [0.0, 0.0, high + 0.2 * length], [0.0, 0.0, high - 0.8 * length]
        ends = {"end.fixed": [False] * 3}
        angle = tilt if kind == "down" else rng.uniform(1.0, 1.7)
        tangents = [np.sin(angle), 0.0, -np.cos(angle)], [0.0, 0.0, 0.0]
    if kind == "box":
        top = 0.5 * min(begin[2], end[2])
        values |= {"obstacles.names": ["table", "box"], "obstacles.box.shape": "box"}
        values["obstacles.box.size"] = [0.2 * end[0], length, top]
        values["obstacles.box.position"] = [rng.uniform(0.3, 0.7) * end[0], 0.0, 0.5 * top]
    values |= {"start.position": begin, "start.tangent": tangents[0], "end.position": end, **ends}
    if "end.clamped" in ends:
        values["end.tangent"] = tangents[1]
    return Case(f"{kind}, {material}", values, check=judge.right_at_rest, seed=seed)


# -- everyday motions, as robots make them --------------------------------------------------------


@dataclass(frozen=True)
class Move:
    """A gripper's motion from rest to rest with the least jerk, then a rest.

    by: displacement [m]; over: raised in the middle of the way by this [m]; turn: rotation vector
    [rad]; within: its duration [s].
    """

    by: Vector = (0.0, 0.0, 0.0)
    over: Vector = (0.0, 0.0, 0.0)
    turn: Vector = (0.0, 0.0, 0.0)
    within: float = 1.0

    def poses(self, times: Array, position: Array) -> Array:
        """Positions and quaternions x, y, z, w, shape (T, 7)."""
        s = np.clip(times / self.within, 0.0, 1.0)
        share = s**3 * (10.0 - 15.0 * s + 6.0 * s**2)
        bump = 16.0 * (share * (1.0 - share)) ** 2
        place = position + np.outer(share, self.by) + np.outer(bump, self.over)
        return np.hstack([place, rotations.from_rotation_vector(np.outer(share, self.turn))])


@dataclass(frozen=True)
class Everyday:
    """A scene, what its grippers do, and for how long [s]."""

    name: str
    values: Values
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
    heavy = 9.81e-3 * grams_per_m * length
    return {
        "cable.length": length,
        "cable.diameter": 1e-3 * diameter_mm,
        "cable.linear_density": 1e-3 * grams_per_m,
        "cable.bending_stiffness": bending,
        "cable.torsional_stiffness": 0.8 * bending,
        "cable.axial_stiffness": axial or 1e3 * max(heavy, 0.5),
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
    values = AT_REST | {
        "start.position": [0.0, 0.0, 1.0],
        "end.position": [gap, 0.0, 1.0 + height],
        "end.fixed": [True] * 3,
    }
    for end, tangent, clamp in zip(("start", "end"), tangents, clamped, strict=True):
        values |= {f"{end}.clamped": clamp, f"{end}.pose_topic": f"~/{end}/pose"}
        values |= {f"{end}.tangent": tangent} if clamp else {}
    return values


def _hangs(length: float, tangent: list[float] = DOWN) -> Values:
    """Held at its start alone."""
    return AT_REST | {
        "start.position": [0.0, 0.0, 2.0],
        "start.clamped": True,
        "start.tangent": tangent,
        "start.pose_topic": "~/start/pose",
        "end.position": [0.0, 0.0, 2.0 - length],
    }


def _released(clamped: bool, end: list[float]) -> Values:
    """Held at its start, straight to its end."""
    clamp = {"start.clamped": True, "start.tangent": ALONG} if clamped else {}
    return STRAIGHT | clamp | {"start.position": [0.0, 0.0, 2.0], "end.position": end}


def _start(*by: float, **more: Any) -> dict[str, Move]:
    return {"start": Move(by, **more)}


def _end(*by: float, **more: Any) -> dict[str, Move]:
    return {"end": Move(by, **more)}


SOFT_CABLE = _cable(1.0, 6.0, 32.5, 1.27e-4, 0.01, drag=0.005)  # two_grippers
ROPE = _cable(2.0, 12.0, 90.0, 2e-3)
CLIMBING = _cable(3.0, 10.0, 65.0, 8e-4)
TUBE = _cable(0.6, 8.0, 45.0, 1.5e-4)
USB = _cable(0.8, 4.0, 30.0, 5.9e-4)
HOSE = _cable(1.5, 25.0, 400.0, 0.071)
CORD = _cable(1.2, 8.0, 90.0, 6e-3)
NETWORK = _cable(1.0, 6.0, 42.0, 4e-3)
HARNESS = _cable(1.8, 15.0, 250.0, 0.03)
STRING = _cable(0.3, 1.5, 1.8, 1.5e-6, 0.01, drag=0.001)
STEEL_WIRE = _cable(1.0, 1.5, 14.0, 0.05, 0.002)
LEAD = _cable(0.5, 3.0, 14.0, 6e-5)
# 20 mm thick, E 1.2e11 Pa, 7000 kg/m^3
LONG_CABLE = _cable(100.0, 20.0, 2199.0, 942.0, 0.005, axial=3.77e7)
WIND: Values = {"loads.names": ["wind"], "loads.wind.type": "force", "loads.wind.position": 0.5}
WIND |= {"loads.wind.signal": "sine", "loads.wind.frequency": 1.0}
WIND |= {"loads.wind.force": [0.0, 0.05, 0.0]}
BENT: Values = {"cable.rest_curvature": [4.0], "cable.rest_curvature_axis": [0.0, 1.0, 0.0]}
_ROUND: Values = {"over": (0.0, 0.0, 0.15), "turn": (1.2, 0.4, -0.5), "within": 4.0}
_TWO = _start(0.25, 0.0, 0.0, within=2.0) | _end(0.0, 0.2, 0.1, within=2.0)
_CORD: Values = {"over": (0.0, 0.0, 0.1), "turn": (0.3, 0.0, 0.8), "within": 2.0}
_BOTH = _start(0.1, 0.0, 0.1, within=1.5) | _end(-0.1, 0.2, 0.0, **_CORD)
_U_SHAPE = _between(0.5, 0.0, (DOWN, [0.0, 0.0, 1.0]))
_PINNED = _between(0.7, clamped=(True, False))
_ROWS: tuple[tuple[str, Values, float, dict[str, Move]], ...] = (
    ("soft, approach", SOFT_CABLE | _between(0.8), 4.0, _end(-0.3, 0.0, 0.0, within=2.0)),
    ("soft, lift", SOFT_CABLE | _between(0.7), 4.0, _end(0.0, 0.2, 0.25, within=2.0)),
    ("soft, turn in space", SOFT_CABLE | _between(0.8), 6.0, _end(-0.3, 0.2, 0.15, **_ROUND)),
    ("rope, sideways", ROPE | _hangs(2.0), 4.0, _start(0.4, 0.0, 0.0, within=1.5)),
    ("rope, level clamp", ROPE | _hangs(2.0, ALONG), 4.0, _start(0.0, 0.0, 0.3, within=1.5)),
    ("rope, two grippers", ROPE | _between(1.6), 4.0, _TWO),
    ("rope, two grippers downwards", ROPE | _U_SHAPE, 4.0, _end(0.4, 0.0, 0.2, within=2.0)),
    ("climbing, between", CLIMBING | _between(2.2, 0.3), 5.0, _end(-0.5, 0.3, 0.0, within=2.5)),
    ("climbing, hanging", CLIMBING | _hangs(3.0), 5.0, _start(0.0, 0.5, 0.2, within=2.0)),
    ("tube, level clamp", TUBE | _hangs(0.6, ALONG), 3.0, _start(0.25, 0.0, 0.1, within=1.0)),
    ("tube, between", TUBE | _between(0.45), 3.0, _end(-0.2, 0.1, 0.0, within=1.5)),
    (
        "tube, turned gripper",
        TUBE | _between(0.45),
        3.0,
        _end(-0.1, 0.0, 0.05, turn=(0.0, 0.9, 0.3), within=1.5),
    ),
    (
        "USB, plug in",
        USB | _between(0.5),
        3.0,
        _end(0.1, 0.15, -0.2, turn=(0.0, 0.6, 0.0), within=1.5),
    ),
    ("USB, level clamp", USB | _hangs(0.8, ALONG), 3.0, _start(0.3, 0.2, 0.0, within=1.2)),
    ("USB, close grippers", USB | _between(0.3), 3.0, _end(0.05, 0.1, 0.1, within=1.5)),
    ("hose, between", HOSE | _between(1.2), 4.0, _end(-0.3, 0.2, 0.2, within=2.0)),
    ("hose, hanging", HOSE | _hangs(1.5), 4.0, _start(0.4, 0.0, 0.0, within=1.0)),
    ("cord, between", CORD | _between(0.9), 4.0, _BOTH),
    (
        "cord, wave",
        CORD | _hangs(1.2),
        4.0,
        _start(0.0, 0.0, 0.0, over=(0.3, 0.0, 0.1), within=1.2),
    ),
    ("network cable, pinned", NETWORK | _PINNED, 4.0, _end(-0.2, 0.2, 0.1, within=1.5)),
    (
        "network cable, twist",
        NETWORK | _between(0.8),
        4.0,
        _end(-0.1, 0.0, 0.0, turn=(1.5, 0.0, 0.0), within=2.0),
    ),
    ("harness, between", HARNESS | _between(1.3, -0.2), 4.0, _end(0.2, 0.3, 0.1, within=2.0)),
    ("harness, hanging", HARNESS | _hangs(1.8, ALONG), 4.0, _start(0.3, 0.0, 0.2, within=1.5)),
    ("string, between", STRING | _between(0.22), 3.0, _end(-0.1, 0.05, 0.05, within=1.5)),
    ("steel wire, let go", STEEL_WIRE | _released(True, [1.0, 0.0, 2.0]), 2.0, {}),
    ("lead, swing", LEAD | _released(False, [0.3, 0.0, 1.6]), 3.0, {}),
    ("soft, sway", SOFT_CABLE | _between(0.8) | WIND, 3.0, {}),
    (
        "rope, tip load",
        ROPE | _hangs(2.0) | {"end.mass": 0.3},
        4.0,
        _start(0.4, 0.2, 0.0, within=1.5),
    ),
    ("natural curvature", CORD | _between(0.8) | BENT, 4.0, _end(-0.1, 0.1, 0.1, within=2.0)),
    (
        "long cable",
        LONG_CABLE | _between(95.0) | {"start.pose_topic": ""},
        4.0,
        _end(-1.0, 0.0, 0.5, within=3.0),
    ),
)
EVERYDAY = {row[0]: Everyday(*row) for row in _ROWS}


def draw_motion(seed: int) -> Everyday:
    """A cable between a rope and a hose, held by one or two grippers that move by chance."""
    rng = np.random.default_rng(seed)
    length, heavy = log_uniform(rng, 0.3, 3.0), log_uniform(rng, 15.0, 300.0)  # [m], [g/m]
    # Under its own weight it bends over 1 to 10 % of its length.
    bend = length * log_uniform(rng, 0.012, 0.12)
    stiffness = 9.81e-3 * heavy * length * bend**2
    values = _cable(length, 8.0, heavy, stiffness, rng.choice([0.005, 0.02, 0.05]))
    turn = tuple(rng.uniform(-0.6, 0.6, 3) * rng.integers(0, 2))
    within = float(rng.uniform(1.0, 2.5))
    by = tuple(rng.uniform(-1.0, 1.0, 3) * min(0.25 * length, 0.35))
    over = (0.0, 0.0, float(rng.uniform(0.0, 0.1)))
    if rng.random() < 0.4:
        values |= _hangs(length, DOWN if rng.random() < 0.5 else ALONG)
        if rng.random() < 0.3:
            values["end.mass"] = 1e-3 * heavy * length * float(rng.uniform(0.2, 2.0))
        moves = {"start": Move(by, over, turn, within)}
    else:
        values |= _between(length * float(rng.uniform(0.45, 0.7)), 0.1 * length * rng.normal())
        moves = {"end": Move(tuple(0.6 * np.array(by)), over, turn, within)}
    return Everyday(f"drawn, seed {seed}", values, 4.0, moves)


def draw_swing(seed: int, method: str = "auto") -> Case:
    """A cable between soft rubber and hard plastic, let go from a straight line, undamped."""
    rng = np.random.default_rng(seed)
    length, diameter = log_uniform(rng, 0.3, 3.0), log_uniform(rng, 0.002, 0.012)
    modulus = float(10.0 ** rng.uniform(5.0, 9.0))
    angle = float(rng.uniform(-1.2, 0.9)) if rng.random() < 0.5 else 0.0
    values = solid(length, diameter, 1200.0, modulus, modulus / 3.0) | {
        "start.clamped": bool(rng.random() < 0.5),
        "end.position": [length * math.cos(angle), 0.0, length * math.sin(angle)],
        "integrator.method": method,
    }
    auto = method == "auto"
    check = judge.closed if auto else judge.closed_or_told
    return Case(f"swing, {method}", values, 10.0, check=check, must_run=auto, seed=seed)


# -- extreme scenes, ordinary for users of stiff, thin, long or short cables ----------------------


def at(step: float, n: int = 13) -> Values:
    """energy_momentum with a step [s] and n control points."""
    values = {"integrator.step": step, "discretization.control_points": n}
    return values | {"integrator.method": "energy_momentum", "terms.twist": "off"}


def material(length: float, diameter: float, density: float, modulus: float) -> Values:
    """A round cable of an isotropic material with Poisson's ratio 0.3."""
    return solid(length, diameter, density, modulus, modulus / 2.6)


def damped(mass: float = 2.0, stiffness: float = 1e-3) -> Values:
    """Damping by mass [1/s] and by stiffness [s]."""
    return {"damping.mass": mass, "damping.stiffness": stiffness}


def ends(start: float, end: float) -> Values:
    """Both ends held on the x axis [m]."""
    places = {"start.position": [start, 0.0, 0.0], "end.position": [end, 0.0, 0.0]}
    return places | {"start.fixed": [True] * 3, "end.fixed": [True] * 3}


def load(name: str, position: float, force: Vector, signal: str) -> Values:
    """A force at a share of the length; with signal `none` it is zero until it is set."""
    row = {"type": "force", "position": position, "signal": signal, "force": list(force)}
    return {f"loads.{name}.{key}": value for key, value in row.items()}


def push(name: str, *force: float) -> Action:
    """Set the force [N] of a load."""
    return lambda sim: sim.set_load(name, force=force)


def turn_end(sim: Simulator) -> None:
    """Turn the end about x at once."""
    half = 0.5 * judge.TURN
    sim.set_end("end", orientation=(np.sin(half), 0.0, 0.0, np.cos(half)))


def soften(modulus: float) -> Action:
    """Change Young's modulus, which must not change the shape."""

    def change(sim: Simulator) -> Simulator:
        other = sim.reconfigured(sim.scene.with_values({"cable.youngs_modulus": modulus}))
        if not np.array_equal(sim.control_points, other.control_points):
            raise RuntimeError("reconfiguring changed the shape")
        return other

    return change


PLANE: Values = {"terms.out_of_plane": "off"}
SPACE: Values = {"terms.out_of_plane": "on"}
CANTILEVER: Values = {"start.clamped": True, "end.fixed": [False] * 3}
DRIVEN: Values = {"start.pose_topic": "/start", "end.pose_topic": "/end"}
GUIDED: Values = {  # the paper's wire
    "start.fixed": [False, True, True],
    "end.fixed": [False, True, True],
    "start.spring": [1e4, 0.0, 0.0],
    "end.spring": [1e4, 0.0, 0.0],
    "end.position": [2.0, 0.0, 0.0],
}
ALUMINIUM = material(2.0, 2e-3, 2700.0, 69e9)
STEEL = material(2.0, 2e-3, 7850.0, 200e9)
NYLON = material(1.0, 2e-3, 1150.0, 2e9)
SOFT = material(1.0, 5e-3, 1200.0, 1e7)
LIGHT, HEAVY = 3.0, 1300.0  # density of the suture [kg/m^3]


def wire(metal: Values, step: float = 2e-3) -> Values:
    """The paper's wire."""
    return at(step) | PLANE | metal | GUIDED | STRAIGHT


def suture(density: float, signal: str) -> Values:
    """The collagen suture of 10 cm, held at both ends and pulled at the middle with 1 N."""
    pull = load("pull", 0.5, (0.0, 1.0, 0.0), signal) | {"loads.names": ["pull"]}
    pull["loads.pull.frequency"] = 0.125  # [Hz]: peak after 2 s
    cable = material(0.1, 4e-4, density, 750e6) | ends(0.0, 0.1)
    return at(1e-3, 40) | SPACE | FLAT | cable | pull | STRAIGHT


def pinned_line(length: float, diameter: float, density: float, modulus: float, n: int) -> Values:
    """A cable pinned at both ends 0.9 lengths apart, at rest.

    Its bending stiffness is a hundredth of a solid rod's, as for a stranded line: the catenary that
    it is compared with has none.
    """
    bending = 0.01 * modulus * np.pi * diameter**4 / 64.0
    cable = material(length, diameter, density, modulus) | {"cable.bending_stiffness": bending}
    return at(2e-3, n) | PLANE | cable | ends(0.0, 0.9 * length)


def thrown(cable: Values, step: float, *names: str) -> Values:
    """A free cable with loads that are zero until they are set."""
    places = {"left": 0.0, "right": 1.0, "pull": 0.5}
    values: Values = {"loads.names": list(names)} | FREE_ENDS
    for name in names:
        values |= load(name, places[name], (0.0, 0.0, 0.0), "none")
    return at(step) | SPACE | FLAT | cable | values


def column(share: float, side: float = 1e-5) -> Values:
    """Pinned column under a share of its Euler load, with `side` of it across the middle."""
    modulus, diameter = 1e9, 5e-3
    euler = np.pi**2 * modulus * np.pi * diameter**4 / 64.0
    press = load("press", 1.0, (-share * euler, 0.0, 0.0), "constant")
    press |= load("side", 0.5, (0.0, 0.0, side * euler), "constant")
    press |= {"loads.names": ["press", "side"], "end.fixed": [False, True, True]}
    cable = material(1.0, diameter, 1200.0, modulus)
    return at(1e-3, 40) | PLANE | FLAT | cable | press | AT_REST


AUTO: Values = {"integrator.method": "auto", "integrator.step": 0.0}
VISCOUS: Values = {"damping.stiffness": 1e-3}
GRIPPED = at(2e-3) | PLANE | SOFT | DRIVEN
THICK_HOSE = at(5e-3) | PLANE | material(2.0, 0.05, 1100.0, 5e6) | CANTILEVER | damped(2.0, 0.05)
SLACK = at(5e-4) | PLANE | NYLON | DRIVEN | ends(0.0, 0.9) | damped()
SLACK["gravity"] = [0.0, 0.0, -0.01]
SWINGING = at(1e-3) | PLANE | material(1.0, 5e-3, 1200.0, 1e6) | ends(0.0, 0.9) | STRAIGHT
TWISTED = at(1e-3) | SPACE | FLAT | SOFT | DRIVEN | ends(0.0, 1.0) | damped()
TWISTED |= {"start.clamped": True, "end.clamped": True, "terms.twist": "quasistatic"}
RING = at(1e-3, 40) | PLANE | FLAT | SOFT | CANTILEVER | AT_REST
RING["cable.rest_curvature"] = [2.0 * np.pi]
FIBRE = at(2e-3) | PLANE | material(0.05, 125e-6, 2200.0, 72e9) | CANTILEVER | AT_REST
LINE = pinned_line(100.0, 0.02, 2700.0, 70e9, 400)
MANY: Values = {"discretization.control_points": 1000}
HANGING = pinned_line(1.0, 5e-3, 1200.0, 1e7, 13)
SETTLING, STIFF_AIR = HANGING | damped(20.0) | STRAIGHT, HANGING | damped(1e4, 1.0) | AT_REST
KILOMETRE = pinned_line(1e3, 0.03, 7850.0, 200e9, 100)
MEET = (0.0, Shift("start", (0.9, 0.0, 0.0), (0.0,) * 3, 0.5))
MEET_TOO = (0.0, Shift("end", (-0.9, 0.0, 0.0), (0.0,) * 3, 0.5))
PULSES = tuple((0.0, push(name, *force)) for name, force in judge.PULSES.items())
PULSES += tuple((judge.PULSE / 5.0, push(name, 0.0, 0.0, 0.0)) for name in judge.PULSES)
BLOW = (
    (0.0, push("pull", 0.0, 0.0, judge.BLOW[0])),
    (judge.BLOW[1] / 0.01, push("pull", 0.0, 0.0, 0.0)),
)
# Name -> scene, duration [s], error of the result and its bound, and what happens.
_EXTREMES: dict[str, tuple[Any, ...]] = {
    "aluminium wire": (wire(ALUMINIUM), 10.0, judge.energy, 1e-8),
    "steel wire": (wire(STEEL), 10.0, judge.energy, 1e-8),
    "aluminium wire, automatic": (wire(ALUMINIUM) | AUTO, 10.0, judge.energy, 1e-8),
    "n_u = 4": (
        wire(ALUMINIUM) | {"discretization.control_points": 4},
        10.0,
        judge.energy,
        1e-7,
    ),
    **{
        f"step of {tau * 1e3:g} ms": (wire(ALUMINIUM, tau), seconds, judge.energy, 1e-7)
        for tau, seconds in ((1e-6, 2e-3), (1e-5, 0.02), (1e-4, 0.2), (1e-2, 10.0), (1e-1, 10.0))
    },
    "light suture": (suture(LIGHT, "sine"), 2.0, judge.follows_string, 5e-3),
    "suture": (suture(HEAVY, "sine"), 2.0, judge.follows_string, 5e-3),
    "suture, automatic": (suture(HEAVY, "sine") | AUTO, 2.0, judge.follows_string, 5e-3),
    "light suture, sudden": (suture(LIGHT, "constant"), 2.0, judge.swings, 1e-6),
    "suture, sudden": (suture(HEAVY, "constant"), 2.0, judge.swings, 1e-6),
    "viscous light suture": (suture(LIGHT, "constant") | VISCOUS, 2.0, judge.swings, 1e-6),
    "viscous suture": (suture(HEAVY, "constant") | VISCOUS, 2.0, judge.swings, 1e-6),
    "suture at rest": (suture(HEAVY, "constant") | AT_REST, 0.0, judge.pulls_as_string, 5e-3),
    "glass fibre": (FIBRE, 1.0, judge.sags_as_cantilever, 1e-3),
    "rubber hose": (THICK_HOSE, 10.0, judge.weighs_its_weight, 1e-4),
    "rubber hose, automatic": (THICK_HOSE | AUTO, 10.0, judge.weighs_its_weight, 1e-4),
    "overhead line": (LINE, 1.0, judge.hangs_as_catenary, 1e-5),
    "n_u = 1000": (LINE | MANY, 0.01, judge.hangs_as_catenary, 1e-5),
    "cable of 1 mm": (pinned_line(1e-3, 1e-5, 1200.0, 1e6, 13), 0.1, judge.lasting, 1e-5),
    "cable of 1 km": (KILOMETRE, 10.0, judge.hangs_as_catenary, 1e-4),
    "slack cable snapped taut": (
        *(SLACK, 4.0, judge.is_taut, 1e-3),
        ((0.0, Shift("end", (2.0, 0.0, 0.0), (0.0,) * 3, 0.055)),),
    ),
    "pulse of 1e6 N for 1 ms": (
        *(thrown(NYLON, 1e-4, "pull"), 0.01, judge.carries_impulse, 1e-9),
        BLOW,
    ),
    "free flight": (
        *(thrown(SOFT, 1e-3, "left", "right"), 5.0, judge.keeps_momentum, 1e-9),
        PULSES,
    ),
    "ends that meet": (
        *(GRIPPED | ends(-0.45, 0.45) | damped(), 1.5, judge.mirrors, 1e-6),
        (MEET, MEET_TOO),
    ),
    "pose jump of 1 m in one tick": (
        *(GRIPPED | ends(0.0, 0.8), 0.4, judge.energy, 1e-5),
        ((0.25, Shift("end", (-1.0, 0.0, 0.0))),),
    ),
    "stiffness times 1e6 at run time": (
        *(SWINGING, 0.7, judge.energy, 1e-6),
        ((2 / 7, soften(1e12)), (4 / 7, soften(1e6))),
    ),
    "straight under twist": (TWISTED, 5.0, judge.turns_as_rod, 1e-6, ((0.0, turn_end),)),
    "straight under compression": (column(0.4, 0.0) | STRAIGHT, 0.1, judge.stays_straight, 1e-7),
    "column below its buckling load": (column(0.9), 0.0, judge.amplifies_as_column, 1e-3),
    "column above its buckling load": (column(1.1), 0.0, judge.buckles_as_elastica, 1e-3),
    "ring": (RING, 0.1, judge.closes_ring, 1e-4),
    "catenary settled by damping": (SETTLING, 10.0, judge.rests_as_undamped, 1e-6),
    "catenary at rest, large damping": (STIFF_AIR, 1.0, judge.rests_as_undamped, 1e-6),
}


def _extreme(
    name: str,
    values: Values,
    duration: float,
    error: judge.Error,
    bound: float,
    events: tuple[tuple[float, Action], ...] = (),
) -> Case:
    # The method is measured, not the tolerance of its solver.
    tight = {"integrator.tolerance": 1e-10} | values
    return Case(name, tight, duration, events=events, check=judge.within(error, bound))


EXTREMES = {name: _extreme(name, *row) for name, row in _EXTREMES.items()}
# Without damping it may stop, and says so.
EXTREMES["suture, sudden"] = replace(EXTREMES["suture, sudden"], must_run=False)


# -- how far off everyday motions are -------------------------------------------------------------

EVERY = 0.05  # [s] between two shapes that are compared
REFERENCE = {
    "discretization.control_points": 161,
    "discretization.knots": "uniform",
    "discretization.stretch": "span",
    "integrator.method": "energy_momentum",
}


def _shapes(everyday: Everyday, scene: Scene) -> Array:
    """Points of the centerline every 0.05 s, shape (T, 50, 3)."""
    simulator = everyday.simulator(scene)
    if everyday.moves:
        found = simulator.forecast(everyday.plan(), EVERY)
        assert found.report.status.ok, found.report.message
        return found.centerline
    return _watched(simulator, (), everyday.seconds)


def _estimated(everyday: Everyday, scene: Scene) -> tuple[Array, DiscretizationError, str]:
    """Shapes, the estimated errors and the advice."""
    simulator = everyday.simulator(scene)
    if everyday.moves:
        places = _shapes(everyday, scene)
        return places, *error_along(simulator, places, partial(_shapes, everyday))
    estimate = ErrorEstimate(simulator)
    places = _watched(simulator, (estimate,), everyday.seconds)
    return places, estimate.largest, estimate.advice(estimate.largest)


def _converged(everyday: Everyday) -> Array:
    """Shapes of other settings: equal spans, far more, a quarter of the step."""
    scene = everyday.scene(REFERENCE)
    if scene.cable.length > 10.0:
        scene = scene.with_values({"discretization.control_points": 401})
    step = everyday.simulator(scene).step
    return _shapes(everyday, scene.with_values({"integrator.step": step / 4.0}))


def _watched(simulator: Simulator, watchers: tuple[Watcher, ...], seconds: float) -> Array:
    """Shapes of a simulator whose run is watched."""
    times = np.arange(1, round(seconds / EVERY) + 1, dtype=np.float64) * EVERY
    recorder = Recorder(simulator.model, np.asarray(times, dtype=np.float64))
    until = simulator.steps + math.ceil(seconds / simulator.step - 1e-9)
    report = play(simulator, until, recorder, watchers=watchers)
    assert report.status.ok, report.message
    u = np.linspace(0.0, simulator.scene.cable.length, 50)
    basis = bspline.evaluate(np.eye(simulator.model.n), simulator.model.knots, u)
    return np.asarray(basis @ recorder.control_points[:, :, :3])


@dataclass(frozen=True)
class Checked:
    """What came of an everyday motion, distances in metres.

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
        return (self.true <= self.target or bool(self.advice)) and self.after <= self.target


def checked(everyday: Everyday, changes: Mapping[str, object] | None = None) -> Checked:
    """Compute a scene with default settings (or changes), follow the advice, and compare."""
    reference, scene = _converged(everyday), everyday.scene(changes)
    places, error, advice = _estimated(everyday, scene)
    after = 0.0
    if advice:
        found = {key: re.search(rf"{re.escape(key)} to ([-+.e0-9]+)", advice) for key in ADVISED}
        advised = {key: ADVISED[key](hit.group(1)) for key, hit in found.items() if hit}
        after = _apart(_shapes(everyday, scene.with_values(advised)), reference)
    true, target = _apart(places, reference), scene.accuracy.target
    return Checked(true, error.total, advice, after, target, everyday.simulator(scene).resolution)


ADVISED: dict[str, Callable[[str], object]] = {
    "discretization.control_points": int,
    "discretization.samples": int,
    "integrator.step": float,
}


def _apart(one: Array, other: Array) -> float:
    return float(np.linalg.norm(one - other, axis=-1).max())


# -- as a program ---------------------------------------------------------------------------------

DRAWN: dict[str, Callable[[int], Case]] = {
    "random": draw_random,
    "rest": draw_at_rest,
    "table": draw_above_table,
    "extremes": lambda number: list(EXTREMES.values())[number],
    "swings": draw_swing,
}


def _judge_drawn(kind: str, number: int) -> judge.Outcome:
    if kind in DRAWN:
        return judge.judged(DRAWN[kind](number))
    return judge.judged(draw_swing(number, kind))  # by this method


def judge_all(kind: str, count: int, first: int) -> int:
    """Judge so many cases on all cores and print what became of them; the number of wrong ones."""
    with open_workers() as workers:
        outcomes = list(workers.map(partial(_judge_drawn, kind), range(first, first + count)))
    outcome_names = (judge.RAN, judge.REFUSED, judge.STOPPED, judge.WRONG)
    print(f"{'method':20}{''.join(f'{name:>9}' for name in outcome_names)}    moved  largest error")
    for method in sorted({one.method for one in outcomes}):
        mine = [one for one in outcomes if one.method == method]
        counts = Counter(one.outcome for one in mine)
        ran = [one for one in mine if one.outcome == judge.RAN]
        cells = [*(counts[name] for name in outcome_names), sum(one.moved for one in ran)]
        largest = max((one.energy_error for one in ran), default=0.0)
        print(f"{method:20}{''.join(f'{cell:9}' for cell in cells)}  {largest:.1e}")
    wrong = [one for one in outcomes if one.outcome == judge.WRONG]
    for one in wrong:
        print(f"seed {one.seed}, {one.name}, {one.method}, step {one.steps}: {one.problem}")
    print(f"{len(wrong)} of {count} wrong; longest {max(one.wall for one in outcomes):.3f} s")
    return len(wrong)


def check_motions(more: int) -> int:
    """Check all everyday motions and so many drawn ones; the number of those that are not good."""
    warnings.simplefilter("ignore", UserWarning)
    bad = 0
    for everyday in (*EVERYDAY.values(), *map(draw_motion, range(more))):
        try:
            found = checked(everyday)
        except (SceneError, AssertionError) as failure:
            print(f"{everyday.name:30s} FAILED: {failure}", flush=True)
            bad += 1
            continue
        bad += not found.good
        numbers = f"true {1e3 * found.true:7.3f} mm, estimated {1e3 * found.estimated:7.3f} mm"
        after = f", after the advice {1e3 * found.after:.3f} mm: {found.advice}"
        verdict = after * bool(found.advice) + "  BAD" * (not found.good)
        print(f"{everyday.name:30s} {numbers}, {found.chosen}{verdict}", flush=True)
    print(f"{bad} of {len(EVERYDAY) + more} are wrong and nothing says so, or the advice fails")
    return bad


def main(kind: str, *given: str) -> int:
    """See the module; the exit status."""
    counts = [int(one) for one in given if one.isdigit()]
    if kind == "motions":
        return check_motions(*counts[:1] or [0]) > 0
    usual = {"extremes": len(EXTREMES), "swings": 90}.get(kind, 1000)
    count, first = [*counts, *[usual, 0][len(counts) :]]
    by_method = [one for one in given if not one.isdigit()]
    return judge_all(by_method[0] if by_method else kind, count, first) > 0


if __name__ == "__main__":
    sys.exit(main(*sys.argv[1:] or ["random"]))
