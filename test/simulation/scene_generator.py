"""Random scenes: whatever a user may ask for, drawn from a seed alone.

A kind decides which terms exist (each set of terms is compiled once, so there are few); everything
else is drawn over ranges that no single application spans. Only methods that are valid with the
damping drawn are drawn. `random_scenes` runs the scenes and judges what came out.
"""

import math
from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

import numpy as np

from dlo_sim.core.methods import METHODS
from dlo_sim.scene.terms import EXPLICIT

Values = dict[str, Any]
Rng = np.random.Generator

PIECES = 8  # of a run; end motions begin, and checks happen, between them
DAMPING = {"mass": (1e-3, 1e3), "stiffness": (1e-6, 1e1), "air_drag": (1e-6, 1e1)}  # ranges


@dataclass(frozen=True)
class Kind:
    """One set of terms: what is drawn for it, and the methods that may be asked for.

    Attributes:
        driven: whether its ends are moved.
        damping: kinds of damping that it may have, each with the probability `damped`; without
            `undamped` it always has one of them.
    """

    name: str
    draw: Callable[[Rng, Values], None]
    methods: tuple[str, ...] = tuple(METHODS)
    driven: bool = False
    damping: tuple[str, ...] = ()
    damped: float = 0.5
    undamped: bool = True


@dataclass(frozen=True)
class Move:
    """From a piece of the run on, an end moves and turns at constant rates, or jumps.

    way: velocity [m/s], or the jump [m]. turn: rate [rad/s]; None for a jump.
    """

    piece: int
    end: str
    way: tuple[float, ...]
    turn: tuple[float, ...] | None


@dataclass(frozen=True)
class Case:
    """One random scene: flat scene values, steps to do, and what happens to it.

    throw: velocity [m/s] of a free cable at its start, and amplitudes across it of a turn and of a
        bend; empty = at rest.
    """

    seed: int
    kind: Kind
    values: Values
    steps: int
    moves: tuple[Move, ...] = ()
    throw: tuple[tuple[float, ...], ...] = ()


def log_uniform(rng: Rng, low: float, high: float) -> float:
    """A number whose logarithm is uniform."""
    return float(np.exp(rng.uniform(np.log(low), np.log(high))))


def direction(rng: Rng) -> np.ndarray:
    """A random unit vector."""
    v = rng.standard_normal(3)
    return v / math.hypot(*v)


def weight(values: Values) -> float:
    """Weight of the cable on earth [N]."""
    area = np.pi * values["cable.diameter"] ** 2 / 4.0
    return float(9.81 * values["cable.density"] * area * values["cable.length"])


def _in_space(rng: Rng, values: Values, low: float, high: float) -> None:
    """The ends apart by a share of the length, in any direction; gravity in another."""
    gap = values["cable.length"] * rng.uniform(low, high)
    start = direction(rng) * values["cable.length"] * rng.uniform(0.0, 3.0)
    values["start.position"] = start.tolist()
    values["end.position"] = (start + gap * direction(rng)).tolist()
    values["gravity"] = (direction(rng) * log_uniform(rng, 0.1, 100.0)).tolist()
    values |= {"terms.out_of_plane": "on", "terms.twist": "off"}


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
    values |= {"gravity": [0.0] * 3, "start.fixed": [False] * 3, "end.fixed": [False] * 3}
    if rng.integers(2):
        return
    _add_load(rng, values, "left", torque=bool(rng.integers(2)))
    _add_load(rng, values, "right")
    if rng.integers(2):
        for name in ("left", "right"):
            values[f"loads.{name}.signal"] = "constant"  # known impulses


def _pulled(rng: Rng, values: Values) -> None:
    """Both ends held and moved about."""
    _in_space(rng, values, 0.2, 1.0)
    for end in ("start", "end"):
        values[f"{end}.fixed"] = [True] * 3
        values[f"{end}.clamped"] = bool(rng.integers(2))
        values[f"{end}.pose_topic"] = f"/{end}"


def _damped(rng: Rng, values: Values) -> None:
    """Springs, a force or a wrench, and with implicit methods natural curvature."""
    _in_space(rng, values, 0.2, 1.5)
    values["end.fixed"] = [False, False, bool(rng.integers(2))]
    values["end.spring"] = [log_uniform(rng, 1e-3, 1e8), log_uniform(rng, 1e-3, 1e8), 0.0]
    bends = rng.uniform(-6.0, 6.0, size=rng.integers(1, 4)) / values["cable.length"]
    values["cable.rest_curvature"] = bends.tolist()
    values["cable.rest_curvature_axis"] = direction(rng).tolist()
    _add_load(rng, values, "push", torque=bool(rng.integers(2)))


def _all_but(*names: str) -> tuple[str, ...]:
    return tuple(name for name in METHODS if name not in names)


KINDS = (
    Kind("plane springs", _plane_springs),
    Kind("hanging", _hanging),
    Kind("free flight", _free_flight, _all_but("rk4", "zhai")),
    Kind("grippers", _pulled, _all_but("rk4", "zhai", "rattle"), True, tuple(DAMPING)),
    Kind("damped", _damped, damping=tuple(DAMPING), undamped=False),
    Kind("pulled", _pulled, driven=True),
)


def draw_case(seed: int, kinds: tuple[Kind, ...] = KINDS) -> Case:
    """The case of a seed."""
    rng = np.random.default_rng(seed)
    kind = kinds[int(rng.integers(len(kinds)))]
    modulus = log_uniform(rng, 1e4, 1e12)
    values: Values = {
        "cable.length": log_uniform(rng, 1e-3, 1e3),
        "cable.diameter": log_uniform(rng, 1e-5, 5e-2),
        "cable.density": log_uniform(rng, 3.0, 2e4),
        "cable.youngs_modulus": modulus,
        "cable.shear_modulus": modulus / rng.uniform(2.0, 3.0),
        "discretization.control_points": round(log_uniform(rng, 4.0, 200.0)),
        "discretization.mass": str(rng.choice(["consistent", "consistent", "lumped"])),
        "discretization.samples": int(rng.integers(2, 6)),
    }
    kind.draw(rng, values)
    _draw_damping(rng, kind, values)
    values["integrator.method"] = str(rng.choice(["auto", *_valid_methods(kind, values)]))
    if values["integrator.method"] in EXPLICIT:
        values.pop("cable.rest_curvature", None)
    values["integrator.step"] = 0.0 if rng.uniform() < 0.4 else log_uniform(rng, 1e-6, 1e-1)
    steps = int(min(max(4e4 / values["discretization.control_points"], 50), 1000))
    moves = _draw_moves(rng, values) if kind.driven else ()
    throw: tuple[tuple[float, ...], ...] = ()
    if kind.draw is _free_flight and "loads.names" not in values:
        speeds = (direction(rng) * log_uniform(rng, 1e-3, 10.0) for _ in range(3))
        throw = tuple(tuple(speed.tolist()) for speed in speeds)
    return Case(seed, kind, values, steps, moves, throw)


def _draw_damping(rng: Rng, kind: Kind, values: Values) -> None:
    chosen = [name for name in kind.damping if rng.uniform() < kind.damped]
    if not chosen and not kind.undamped:
        chosen = [str(rng.choice(kind.damping))]
    for name in chosen:
        values[f"damping.{name}"] = log_uniform(rng, *DAMPING[name])


def _valid_methods(kind: Kind, values: Values) -> tuple[str, ...]:
    """The methods of a kind that are valid with the damping of its values."""
    by_mass = "damping.mass" in values or "damping.air_drag" in values
    by_stiffness = "damping.stiffness" in values
    return tuple(
        name
        for name in kind.methods
        if (METHODS[name].mass_damping or not by_mass)
        and (METHODS[name].stiffness_damping or not by_stiffness)
    )


def _draw_moves(rng: Rng, values: Values) -> tuple[Move, ...]:
    """Three moves in order, one in four of them a jump."""
    moves = []
    for piece in sorted(rng.integers(0, PIECES - 1, size=3).tolist()):
        end = str(rng.choice(["start", "end"]))
        if rng.uniform() < 0.25:
            jump = direction(rng) * values["cable.length"] * log_uniform(rng, 1e-3, 1.0)
            moves.append(Move(piece, end, tuple(jump.tolist()), None))
        else:
            speed = direction(rng) * log_uniform(rng, 1e-3, 10.0)
            turn = direction(rng) * log_uniform(rng, 1e-2, 10.0)
            moves.append(Move(piece, end, tuple(speed.tolist()), tuple(turn.tolist())))
    return tuple(moves)
