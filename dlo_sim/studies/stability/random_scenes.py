"""Random scenes: whatever a user may ask for, drawn from a seed alone.

A kind decides which terms exist (each set of terms is one compiled step, so there are few);
everything else is drawn freely over ranges that no single application spans. Damping is drawn
before the method, and only methods that are valid with it are drawn. What becomes of a scene is
judged in `random_checks`.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

import numpy as np

from dlo_sim.core.methods import METHODS

Values = dict[str, Any]

PIECES = 8  # of a case; end motions begin, and checks happen, between them


@dataclass(frozen=True)
class Kind:
    """One set of terms: what is drawn for it, and the methods that may be asked for.

    Attributes:
        damping: kinds of damping that it may have, each with the probability `damped`; without
            `undamped` it always has one of them.
        driven: whether its ends are moved.
    """

    name: str
    draw: Callable[[np.random.Generator, Values], None]
    methods: tuple[str, ...]
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
    """One random scene: flat scene values, steps to do, and a script of end motions."""

    seed: int
    kind: Kind
    values: Values
    steps: int
    moves: tuple[Move, ...] = ()


def log_uniform(rng: np.random.Generator, low: float, high: float) -> float:
    """A number whose logarithm is uniform."""
    return float(np.exp(rng.uniform(np.log(low), np.log(high))))


def direction(rng: np.random.Generator) -> np.ndarray:
    """A random unit vector."""
    v = rng.standard_normal(3)
    return np.asarray(v / np.linalg.norm(v))


def weight(values: Values) -> float:
    """Weight of the cable on earth [N]."""
    area = np.pi * values["cable.diameter"] ** 2 / 4.0
    return float(9.81 * values["cable.density"] * area * values["cable.length"])


def _place_end(rng: np.random.Generator, values: Values, low: float, high: float) -> None:
    """Distance of the ends as a share of the length, any direction."""
    gap = values["cable.length"] * rng.uniform(low, high)
    start = direction(rng) * values["cable.length"] * rng.uniform(0.0, 3.0)
    values["start.position"] = start.tolist()
    values["end.position"] = (start + gap * direction(rng)).tolist()


def _gravity(rng: np.random.Generator, values: Values) -> None:
    values["gravity"] = (direction(rng) * log_uniform(rng, 0.1, 100.0)).tolist()


def _add_load(rng: np.random.Generator, values: Values, name: str, torque: bool = False) -> None:
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


def _plane_springs(rng: np.random.Generator, values: Values) -> None:
    """In the xz plane, ends guided along x on springs; released straight, or shaken at rest."""
    values["end.position"] = [values["cable.length"] * rng.uniform(0.3, 1.2), 0.0, 0.0]
    for end in ("start", "end"):
        values[f"{end}.fixed"] = [False, True, True]
        values[f"{end}.spring"] = [log_uniform(rng, 1e-3, 1e8), 0.0, 0.0]
    values["gravity"] = [0.0, 0.0, -log_uniform(rng, 0.1, 100.0)]
    _add_load(rng, values, "push")
    x, _, z = values["loads.push.force"]
    values["loads.push.force"] = [x, 0.0, z]
    released = rng.uniform() < 0.75
    values["initial.shape"] = "straight" if released else "auto"
    # a constant load is part of the equilibrium that "auto" starts from: nothing would happen
    values["loads.push.signal"] = "constant" if released else "sine"


def _hanging(rng: np.random.Generator, values: Values) -> None:
    """One end held, the other free, forces."""
    _spatial(values)
    _place_end(rng, values, 0.5, 1.0)
    _gravity(rng, values)
    values["end.fixed"] = [False] * 3
    values["end.mass"] = float(
        rng.choice([0.0, weight(values) / 9.81 * log_uniform(rng, 0.01, 10)])
    )
    values["start.clamped"] = bool(rng.integers(2))
    _add_load(rng, values, "push")


def _free_flight(rng: np.random.Generator, values: Values) -> None:
    """Nothing held, no gravity, two forces, one of them with or without a torque."""
    _spatial(values)
    _place_end(rng, values, 0.5, 1.0)
    values["gravity"] = [0.0, 0.0, 0.0]
    values["start.fixed"] = [False] * 3
    values["end.fixed"] = [False] * 3
    _add_load(rng, values, "left", torque=bool(rng.integers(2)))
    _add_load(rng, values, "right")
    if rng.integers(2):
        for name in ("left", "right"):
            values[f"loads.{name}.signal"] = "constant"  # known impulses


def _grippers(rng: np.random.Generator, values: Values) -> None:
    """Two grippers that move and turn, twist, any damping."""
    _spatial(values, twist="on")
    _place_end(rng, values, 0.2, 1.0)
    _gravity(rng, values)
    _hold_grippers(rng, values)


def _damped(rng: np.random.Generator, values: Values) -> None:
    """Springs, natural curvature, twist, some damping, a wrench."""
    _spatial(values, twist="on")
    _place_end(rng, values, 0.2, 1.5)
    _gravity(rng, values)
    values["end.fixed"] = [False, False, bool(rng.integers(2))]
    values["end.spring"] = [log_uniform(rng, 1e-3, 1e8), log_uniform(rng, 1e-3, 1e8), 0.0]
    values["cable.rest_curvature"] = (
        rng.uniform(-6.0, 6.0, size=rng.integers(1, 4)) / values["cable.length"]
    ).tolist()
    values["cable.rest_curvature_axis"] = direction(rng).tolist()
    _add_load(rng, values, "push", torque=True)


def _pulled(rng: np.random.Generator, values: Values) -> None:
    """Both ends held and moved about, undamped."""
    _spatial(values)
    _place_end(rng, values, 0.2, 1.0)
    _gravity(rng, values)
    _hold_grippers(rng, values)


def _hold_grippers(rng: np.random.Generator, values: Values) -> None:
    for end in ("start", "end"):
        values[f"{end}.fixed"] = [True] * 3
        values[f"{end}.clamped"] = bool(rng.integers(2))
        values[f"{end}.pose_topic"] = f"/{end}"


def _spatial(values: Values, twist: str = "off") -> None:
    values["terms.out_of_plane"] = "on"
    values["terms.twist"] = twist


EVERY = tuple(METHODS)
DAMPING = {"mass": (1e-3, 1e3), "stiffness": (1e-6, 1e1), "air_drag": (1e-6, 1e1)}  # ranges
KINDS = (
    Kind("plane springs", _plane_springs, EVERY),
    Kind("hanging", _hanging, EVERY),
    Kind(
        "free flight",
        _free_flight,
        tuple(name for name in EVERY if name not in ("rk4", "zhai")),
    ),
    Kind(
        "grippers",
        _grippers,
        tuple(name for name in EVERY if name not in ("rk4", "zhai", "rattle")),
        driven=True,
        damping=tuple(DAMPING),
    ),
    Kind("damped", _damped, EVERY, damping=tuple(DAMPING), undamped=False),
    Kind("pulled", _pulled, EVERY, driven=True),
)


def draw_case(seed: int, kinds: tuple[Kind, ...] = KINDS) -> Case:
    """The case of a seed."""
    rng = np.random.default_rng(seed)
    kind = kinds[int(rng.integers(len(kinds)))]
    values: Values = {
        "cable.length": log_uniform(rng, 1e-3, 1e3),
        "cable.diameter": log_uniform(rng, 1e-5, 5e-2),
        "cable.density": log_uniform(rng, 3.0, 2e4),
        "cable.youngs_modulus": log_uniform(rng, 1e4, 1e12),
        "discretization.control_points": round(log_uniform(rng, 4.0, 200.0)),
        "discretization.mass": str(rng.choice(["consistent", "consistent", "lumped"])),
        "discretization.samples": int(rng.integers(2, 6)),
    }
    values["cable.shear_modulus"] = values["cable.youngs_modulus"] / rng.uniform(2.0, 3.0)
    kind.draw(rng, values)
    _draw_damping(rng, kind, values)
    values["integrator.method"] = str(rng.choice(["auto", *_valid_methods(kind, values)]))
    values["integrator.step"] = 0.0 if rng.uniform() < 0.4 else log_uniform(rng, 1e-6, 1e-1)
    n = values["discretization.control_points"]
    steps = int(min(max(4e4 / n, 50), 1000))
    moves = _draw_moves(rng, values) if kind.driven else ()
    return Case(seed, kind, values, steps, moves)


def _draw_damping(rng: np.random.Generator, kind: Kind, values: Values) -> None:
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


def _draw_moves(rng: np.random.Generator, values: Values) -> tuple[Move, ...]:
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
