"""Random scenes: whatever a user may ask for either runs with its energy balance closed, or says
why not.

A case is drawn from its seed alone: a kind decides which terms exist (each set of terms is one
compiled step, so there are few), everything else is drawn freely over ranges that no single
application spans. `run_case` simulates it for a bounded number of steps and judges the outcome:

    ran      to its end, and every check holds
    refused  by one line, before the first step
    stopped  by the simulator with a status and one line; the state is the last good one
    wrong    anything else: a broken balance, a number that is not finite, another exception
"""

from __future__ import annotations

import time
from collections.abc import Callable
from dataclasses import dataclass, field
from typing import Any

import numpy as np

from dlo_sim.core.end_motion import EndMotion
from dlo_sim.core.methods import IMPLICIT, METHODS
from dlo_sim.kernels import layout
from dlo_sim.scene.loading import SceneError, scene_from_values
from dlo_sim.simulation.simulator import Simulator

RAN, REFUSED, STOPPED, WRONG = "ran", "refused", "stopped", "wrong"
PIECES = 8  # advances per case; checks happen after each
"""Share of the energy exchanged that the balance may be open by."""
CONSERVING_TOLERANCE = 1e-5
METHOD_TOLERANCE = 0.5


@dataclass(frozen=True)
class Kind:
    """One set of terms: what is drawn for it, and the methods that may be asked for."""

    name: str
    draw: Callable[[np.random.Generator, dict[str, Any]], None]
    methods: tuple[str, ...]
    driven: bool = False


@dataclass(frozen=True)
class Case:
    """One random scene: flat scene values, steps to do, and a script of end motions."""

    seed: int
    kind: Kind
    values: dict[str, Any]
    steps: int
    moves: tuple[tuple[int, str, str, tuple[float, ...]], ...] = ()


@dataclass(frozen=True)
class Outcome:
    """What became of a case; `problem` is empty unless it is `wrong`."""

    seed: int
    kind: str
    outcome: str
    reason: str
    problem: str
    method: str
    step: float
    steps: int
    simulated: float
    energy_error: float
    tolerance: float
    force_evaluations: int
    wall: float
    notes: dict[str, float] = field(default_factory=dict)


def log_uniform(rng: np.random.Generator, low: float, high: float) -> float:
    """A number whose logarithm is uniform."""
    return float(np.exp(rng.uniform(np.log(low), np.log(high))))


def direction(rng: np.random.Generator) -> np.ndarray:
    """A random unit vector."""
    v = rng.standard_normal(3)
    return np.asarray(v / np.linalg.norm(v))


def weight(values: dict[str, Any]) -> float:
    """Weight of the cable on earth [N]."""
    area = np.pi * values["cable.diameter"] ** 2 / 4.0
    return float(9.81 * values["cable.density"] * area * values["cable.length"])


def _place_end(rng: np.random.Generator, values: dict[str, Any], low: float, high: float) -> None:
    """Distance of the ends as a share of the length, any direction."""
    gap = values["cable.length"] * rng.uniform(low, high)
    start = direction(rng) * values["cable.length"] * rng.uniform(0.0, 3.0)
    values["start.position"] = start.tolist()
    values["end.position"] = (start + gap * direction(rng)).tolist()


def _gravity(rng: np.random.Generator, values: dict[str, Any]) -> None:
    values["gravity"] = (direction(rng) * log_uniform(rng, 0.1, 100.0)).tolist()


def _add_load(
    rng: np.random.Generator, values: dict[str, Any], name: str, torque: bool = False
) -> None:
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


def _plane_springs(rng: np.random.Generator, values: dict[str, Any]) -> None:
    """In the xz plane, ends guided along x on springs."""
    values["end.position"] = [values["cable.length"] * rng.uniform(0.3, 1.2), 0.0, 0.0]
    for end in ("start", "end"):
        values[f"{end}.fixed"] = [False, True, True]
        values[f"{end}.spring"] = [log_uniform(rng, 1e-3, 1e8), 0.0, 0.0]
    values["gravity"] = [0.0, 0.0, -log_uniform(rng, 0.1, 100.0)]
    values["initial.shape"] = str(rng.choice(["auto", "straight"]))


def _hanging(rng: np.random.Generator, values: dict[str, Any]) -> None:
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


def _free_flight(rng: np.random.Generator, values: dict[str, Any]) -> None:
    """Nothing held, no gravity, two wrenches."""
    _spatial(values)
    _place_end(rng, values, 0.5, 1.0)
    values["gravity"] = [0.0, 0.0, 0.0]
    values["start.fixed"] = [False] * 3
    values["end.fixed"] = [False] * 3
    _add_load(rng, values, "left", torque=True)
    _add_load(rng, values, "right")


def _grippers(rng: np.random.Generator, values: dict[str, Any]) -> None:
    """Two grippers that move and turn, twist, all damping."""
    _spatial(values, twist="on")
    _place_end(rng, values, 0.2, 1.0)
    _gravity(rng, values)
    for end in ("start", "end"):
        values[f"{end}.fixed"] = [True] * 3
        values[f"{end}.clamped"] = bool(rng.integers(2))
        values[f"{end}.pose_topic"] = f"/{end}"
    values["damping.mass"] = log_uniform(rng, 1e-3, 1e3)
    values["damping.stiffness"] = log_uniform(rng, 1e-6, 1e1)
    values["damping.air_drag"] = log_uniform(rng, 1e-6, 1e1)


def _damped(rng: np.random.Generator, values: dict[str, Any]) -> None:
    """Springs, natural curvature, twist, mass damping, a wrench."""
    _spatial(values, twist="on")
    _place_end(rng, values, 0.2, 1.5)
    _gravity(rng, values)
    values["end.fixed"] = [False, False, bool(rng.integers(2))]
    values["end.spring"] = [log_uniform(rng, 1e-3, 1e8), log_uniform(rng, 1e-3, 1e8), 0.0]
    values["cable.rest_curvature"] = (
        rng.uniform(-6.0, 6.0, size=rng.integers(1, 4)) / values["cable.length"]
    ).tolist()
    values["cable.rest_curvature_axis"] = direction(rng).tolist()
    values["damping.mass"] = log_uniform(rng, 1e-3, 1e3)
    _add_load(rng, values, "push", torque=True)


def _pulled(rng: np.random.Generator, values: dict[str, Any]) -> None:
    """Both ends held and moved about, undamped."""
    _spatial(values)
    _place_end(rng, values, 0.2, 1.0)
    _gravity(rng, values)
    for end in ("start", "end"):
        values[f"{end}.clamped"] = bool(rng.integers(2))
        values[f"{end}.fixed"] = [True] * 3
        values[f"{end}.pose_topic"] = f"/{end}"


def _spatial(values: dict[str, Any], twist: str = "off") -> None:
    values["terms.out_of_plane"] = "on"
    values["terms.twist"] = twist


EVERY = tuple(METHODS)
KINDS = (
    Kind("plane springs", _plane_springs, EVERY),
    Kind("hanging", _hanging, EVERY),
    Kind("free flight", _free_flight, ("velocity_verlet", "forest_ruth", "energy_momentum")),
    Kind("grippers", _grippers, ("velocity_verlet", "energy_momentum"), driven=True),
    Kind("damped", _damped, ("velocity_verlet", "rk4", "implicit_midpoint", "energy_momentum")),
    Kind(
        "pulled", _pulled, ("velocity_verlet", "implicit_midpoint", "energy_momentum"), driven=True
    ),
)


def draw_case(seed: int, kinds: tuple[Kind, ...] = KINDS) -> Case:
    """The case of a seed."""
    rng = np.random.default_rng(seed)
    kind = kinds[int(rng.integers(len(kinds)))]
    values: dict[str, Any] = {
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
    values["integrator.method"] = str(rng.choice(["auto", *kind.methods]))
    values["integrator.step"] = 0.0 if rng.uniform() < 0.4 else log_uniform(rng, 1e-6, 1e-1)
    n = values["discretization.control_points"]
    steps = int(min(max(4e4 / n, 50), 1000))
    moves = _draw_moves(rng, values, steps) if kind.driven else ()
    return Case(seed, kind, values, steps, moves)


def _draw_moves(
    rng: np.random.Generator, values: dict[str, Any], steps: int
) -> tuple[tuple[int, str, str, tuple[float, ...]], ...]:
    """End motions: at a piece, an end starts to move with some speed and turn rate, or jumps."""
    moves = []
    for piece in sorted(rng.integers(0, PIECES - 1, size=3).tolist()):
        end = str(rng.choice(["start", "end"]))
        if rng.uniform() < 0.25:
            jump = direction(rng) * values["cable.length"] * log_uniform(rng, 1e-3, 1.0)
            moves.append((piece, end, "jump", tuple(jump.tolist())))
        else:
            speed = direction(rng) * log_uniform(rng, 1e-3, 10.0)
            turn = direction(rng) * log_uniform(rng, 1e-2, 10.0)
            moves.append((piece, end, "move", (*speed.tolist(), *turn.tolist())))
    return tuple(moves)


def _apply(
    simulator: Simulator, move: tuple[int, str, str, tuple[float, ...]], pieces: float
) -> None:
    _, end, what, numbers = move
    position, orientation = simulator.end_pose(end)
    if what == "jump":
        simulator.set_end(end, position=position + np.array(numbers))
        return
    motion = EndMotion(
        start=simulator.time,
        duration=pieces,
        position=np.array([position, numbers[:3], np.zeros(3)]),
        orientation=orientation,
        rotation=np.array([numbers[3:], np.zeros(3)]),
    )
    simulator.set_motion(end, motion)


def run_case(case: Case) -> Outcome:
    """Simulate a case and judge it. Never raises for what a case does."""
    began = time.perf_counter()
    blank = {"seed": case.seed, "kind": case.kind.name, "method": case.values["integrator.method"]}

    def outcome(what: str, reason: str = "", problem: str = "", **more: Any) -> Outcome:
        numbers: dict[str, Any] = {
            "step": case.values["integrator.step"],
            "steps": 0,
            "simulated": 0.0,
            "energy_error": 0.0,
            "tolerance": 0.0,
            "force_evaluations": 0,
        }
        wall = time.perf_counter() - began
        return Outcome(
            outcome=what, reason=reason, problem=problem, wall=wall, **{**numbers, **blank, **more}
        )

    try:
        simulator = Simulator(scene_from_values(case.values))
    except SceneError as refusal:
        one_line = "\n" not in str(refusal)
        return outcome(
            REFUSED if one_line else WRONG, str(refusal), "" if one_line else "not one line"
        )
    except Exception as error:
        return outcome(WRONG, problem=f"{type(error).__name__}: {error}")
    blank["method"] = simulator.method
    evaluations = 0
    problem = reason = ""
    watch = _Watch(simulator, case)
    piece = max(case.steps // PIECES, 1)
    moves = list(case.moves)
    try:
        for k in range(PIECES):
            while moves and moves[0][0] <= k:
                _apply(simulator, moves.pop(0), piece * simulator.step)
            report = simulator.advance_steps(piece)
            evaluations += report.force_evaluations
            problem = watch.problem()
            if not report.status.ok:
                reason = report.message
                if not reason or "\n" in reason:
                    problem = problem or f"stopped without a one-line reason: {reason!r}"
            if problem or reason:
                break
    except Exception as error:
        problem = f"{type(error).__name__}: {error}"
    return outcome(
        WRONG if problem else STOPPED if reason else RAN,
        reason,
        problem,
        step=simulator.step,
        steps=simulator.steps,
        simulated=simulator.time,
        energy_error=simulator.energy_error,
        tolerance=watch.tolerance,
        force_evaluations=evaluations,
        notes=watch.notes,
    )


class _Watch:
    """Independent checks of one running simulator.

    Besides the simulator's own account, constant forces give a second one without it: their work is
    force times displacement. In free flight the momentum is the impulse of the loads.
    """

    def __init__(self, simulator: Simulator, case: Case) -> None:
        self.simulator = simulator
        self.case = case
        conserving = METHODS[simulator.method].conserves_energy
        self.tolerance = CONSERVING_TOLERANCE if conserving else METHOD_TOLERANCE
        self.notes: dict[str, float] = {}
        self._potential = self._conservative_energy() if self._closed() else 0.0
        self._lost = 0.0
        self._momentum = self._free_momentum()

    def problem(self) -> str:
        """What is wrong now; empty if nothing."""
        sim = self.simulator
        parts = (sim.control_points, sim.velocities, *sim.reaction("start"), *sim.reaction("end"))
        if not all(np.isfinite(part).all() for part in parts):
            return "a number that is not finite"
        ledger = sim._state.ledger
        scale = max(ledger[layout.EXCHANGED], ledger[layout.FLOOR])
        if not sim.energy_error <= self.tolerance:
            return f"energy balance open by {sim.energy_error:.2e}"
        if self._closed():
            error = abs(self._conservative_energy() - self._potential) / scale
            self.notes["closed"] = max(self.notes.get("closed", 0.0), error)
            if not error <= 1.01 * self.tolerance + 1e-7:
                return f"energy without the account open by {error:.2e}"
        lost = float(ledger[layout.DISSIPATED])
        if lost < self._lost - 1e-9 * scale:
            return f"damping gave energy: {lost - self._lost:.2e} J"
        self._lost = lost
        return self._momentum_problem()

    def _closed(self) -> bool:
        """Whether nothing but constant forces does work."""
        scene = self.simulator.scene
        loads = all(load.signal == "constant" and not any(load.torque) for load in scene.loads)
        damped = "damping" in self.simulator.active_terms
        return loads and not damped and not self.case.kind.driven

    def _conservative_energy(self) -> float:
        sim = self.simulator
        work = sum(
            float(np.dot(load.force, sim.centerline([load.position * sim.scene.cable.length])[0]))
            for load in sim.scene.loads
        )
        return sim.energy().total - work

    def _free_momentum(self) -> np.ndarray:
        sim = self.simulator
        n = sim.model.n
        rates = np.zeros_like(sim._state.w)
        rates[:, :n] = sim.model.to_rows(sim.velocities)
        from dlo_sim.core import mass

        return np.array(
            [
                mass.multiply(band, rates[d, :n]).sum()
                for d, band in enumerate(sim.model.terms.mass.band)
            ]
        )

    def _momentum_problem(self) -> str:
        sim = self.simulator
        scene = sim.scene
        if (
            scene.start.held
            or scene.end.held
            or any(load.signal != "constant" for load in scene.loads)
        ):
            return ""
        impulse = sum((np.array(load.force) for load in scene.loads), np.zeros(3)) * sim.time
        got = self._free_momentum()[:3] - self._momentum[:3]
        error = float(np.abs(got - impulse).max())
        size = max(float(np.linalg.norm(impulse)), 1e-300)
        self.notes["momentum"] = error / size
        return f"momentum wrong by {error / size:.2e}" if error > 1e-6 * size else ""


__all__ = ["IMPLICIT", "Case", "Kind", "Outcome", "draw_case", "run_case"]
