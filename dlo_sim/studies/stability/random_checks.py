"""What becomes of a random scene: it is simulated for a bounded number of steps and judged.

ran      to its end, and every check holds
refused  by one line, before the first step
stopped  by the simulator with a status and one line; every check holds for the state it kept
wrong    anything else: a broken balance, a number that is not finite, another exception, or
         more time than its budget
"""

from __future__ import annotations

import time
from dataclasses import dataclass, replace

import numpy as np

from dlo_sim.core.end_motion import EndMotion
from dlo_sim.core.methods import IMPLICIT, METHODS, Method
from dlo_sim.kernels import layout
from dlo_sim.kernels.implicit import MAX_ITERATIONS
from dlo_sim.kernels.observe import DIVERGED_SHARE
from dlo_sim.scene.loading import SceneError, scene_from_values
from dlo_sim.simulation.report import Report
from dlo_sim.simulation.simulator import Simulator
from dlo_sim.studies.stability import random_balances
from dlo_sim.studies.stability.random_balances import (
    AngularImpulse,
    Balance,
    ConstantForces,
    EndWork,
    Impulse,
)
from dlo_sim.studies.stability.random_scenes import PIECES, Case, Move, Values, draw_case

RAN, REFUSED, STOPPED, WRONG = "ran", "refused", "stopped", "wrong"
# Shares of the energy exchanged that the balance may be open by.
CONSERVING_TOLERANCE = 1e-4
METHOD_TOLERANCE = DIVERGED_SHARE  # where the simulator stops by itself: no accuracy is asked
MOMENTUM_TOLERANCE = 1e-6  # of the impulse
# Of force times length times time. The first three keep the angular momentum; that of the impulse
# is known less well for methods with sub-steps, and generalised-alpha is not made to keep it.
ANGULAR_TOLERANCE = {
    "velocity_verlet": 1e-8,
    "implicit_midpoint": 1e-8,
    "energy_momentum": 1e-8,
    "energy_momentum_4": 1e-3,
    "forest_ruth": 1e-3,
    "rattle": 1e-3,
    "generalized_alpha": 1e-3,
}
# Not of explicit methods: near its limit velocity_verlet misses up to 1.1 of the energy by the mean
# of the reactions at two instants, where its account is off by 0.4.
WITH_END_WORK = (
    "implicit_midpoint",
    "energy_momentum",
    "energy_momentum_4",
)
OWN_BALANCES = {  # that the simulator's account has no part in: fields of Outcome
    "closed": "energy",
    "end_work": "work of the ends",
    "momentum": "momentum",
    "angular": "angular momentum",
}
BUDGET = 60.0  # [s] of the processor's time for a scene, its constructor and its steps
CALLS = 16  # of the stepping loop per piece, so that the budget can end it


@dataclass(frozen=True)
class Outcome:
    """What became of a case; `problem` is empty unless it is `wrong`.

    energy_error: largest so far, of the energy exchanged; tolerance: what it may be. closed,
    momentum, angular, end_work: the errors that were found without the simulator's own account,
    None where that cannot be. floor_share: energy that round-off leaves uncertain over the energy
    exchanged. setup, wall: processor time of the constructor, without the compiler, and of stepping
    [s]; it does not depend on what else runs.
    """

    seed: int
    kind: str
    method: str
    step: float
    control_points: int
    outcome: str = RAN
    reason: str = ""
    problem: str = ""
    steps: int = 0
    simulated: float = 0.0
    energy_error: float = 0.0
    tolerance: float = 0.0
    closed: float | None = None
    momentum: float | None = None
    angular: float | None = None
    end_work: float | None = None
    floor_share: float = 0.0
    force_evaluations: int = 0
    setup: float = 0.0
    wall: float = 0.0

    @property
    def moved(self) -> bool:
        """Whether more energy was exchanged than round-off leaves uncertain."""
        return self.floor_share <= 1.0


def run_seed(seed: int) -> Outcome:
    """Draw the case of a seed and run it; a function for workers."""
    return run_case(draw_case(seed))


def run_case(case: Case, budget: float = BUDGET) -> Outcome:
    """Simulate a case and judge it. Never raises for what a case does."""
    values = case.values
    blank = Outcome(
        seed=case.seed,
        kind=case.kind.name,
        method=values["integrator.method"],
        step=values["integrator.step"],
        control_points=values["discretization.control_points"],
    )
    try:
        simulator, setup = _build(values, budget)
    except Exception as error:
        return replace(blank, outcome=WRONG, problem=f"{type(error).__name__}: {error}")
    if isinstance(simulator, SceneError):
        refused = replace(blank, outcome=REFUSED, reason=str(simulator), setup=setup)
        if "\n" in refused.reason:
            return replace(refused, outcome=WRONG, problem=f"not one line: {refused.reason!r}")
        return replace(refused, outcome=WRONG, problem=_late(setup)) if setup > budget else refused
    watch = _Watch(simulator, case, budget, setup)
    try:
        watch.run()
    except Exception as error:
        watch.problem = f"{type(error).__name__}: {error}"
    return replace(
        blank,
        method=simulator.method,
        step=simulator.step,
        outcome=WRONG if watch.problem else STOPPED if watch.reason else RAN,
        reason=watch.reason,
        problem=watch.problem,
        steps=simulator.steps,
        simulated=simulator.time,
        energy_error=simulator.energy_error,
        tolerance=watch.tolerance,
        floor_share=random_balances.floor_share(simulator),
        force_evaluations=watch.evaluations,
        setup=setup,
        wall=watch.wall,
        closed=watch.errors.get("closed"),
        momentum=watch.errors.get("momentum"),
        angular=watch.errors.get("angular"),
        end_work=watch.errors.get("end_work"),
    )


def _build(values: Values, budget: float) -> tuple[Simulator | SceneError, float]:
    """The simulator of a scene, or why it is refused, and processor time [s] without the compiler.

    `compile_seconds` is the time of the step alone. The statics are compiled in the constructor
    too, once for a set of terms, so one that took too long is built again before it is judged.
    """
    for _ in range(2):
        began = time.process_time()
        built: Simulator | SceneError
        try:
            built = Simulator(scene_from_values(values))
        except SceneError as refusal:
            built = refusal
        compiled = 0.0 if isinstance(built, SceneError) else built.compile_seconds
        took = max(time.process_time() - began - compiled, 0.0)
        if took <= budget:
            break
    return built, took


def _late(seconds: float) -> str:
    return f"more time than its budget, {seconds:.1f} s"


class _Watch:
    """Runs one case and checks it, with balances of its own where these can be had.

    errors: the largest of each of these balances so far.
    """

    def __init__(self, simulator: Simulator, case: Case, budget: float, setup: float) -> None:
        method = METHODS[simulator.method]
        self.tolerance = CONSERVING_TOLERANCE if method.conserves_energy else METHOD_TOLERANCE
        self.problem = self.reason = ""
        self.errors: dict[str, float] = {}
        self.wall = 0.0
        self.evaluations = 0
        self._simulator = simulator
        self._case = case
        self._budget = budget
        self._setup = setup
        self._balances: dict[str, tuple[Balance, float]] = {}
        self._by_step: list[AngularImpulse | EndWork] = []
        self._lost = 0.0
        self._choose_balances(method)

    def _choose_balances(self, method: Method) -> None:
        sim = self._simulator
        conservative = random_balances.is_conservative(sim)
        driven = self._case.kind.driven
        if conservative and driven and method.name in WITH_END_WORK:
            work = EndWork(sim)
            self._balances["end_work"] = work, self.tolerance
            self._by_step.append(work)
        if conservative and not driven:
            self._balances["closed"] = ConstantForces(sim), 1.01 * self.tolerance + 1e-7
        if random_balances.flies_freely(sim):
            self._balances["momentum"] = Impulse(sim), MOMENTUM_TOLERANCE
            if not any(any(load.torque) for load in sim.scene.loads):
                angular = AngularImpulse(sim)
                self._balances["angular"] = angular, ANGULAR_TOLERANCE[method.name]
                self._by_step.append(angular)

    def run(self) -> None:
        """Steps and end motions, with the checks after each piece, until the first problem."""
        piece = max(self._case.steps // PIECES, 1)
        moves = list(self._case.moves)
        for k in range(PIECES):
            while moves and moves[0].piece <= k:
                _apply(self._simulator, moves.pop(0), piece * self._simulator.step)
            for balance in self._by_step:
                balance.begin()
            self._advance(piece)
            self.problem = self.problem or self._check()
            if self.problem or self.reason:
                return

    def _advance(self, steps: int) -> None:
        target = self._simulator.steps + steps
        most = 1 if self._by_step else max(steps // CALLS, 1)
        while self._simulator.steps < target and not self.reason:
            began = time.process_time()
            report = self._simulator.advance_steps(min(most, target - self._simulator.steps))
            self.wall += time.process_time() - began
            self.evaluations += report.force_evaluations
            if not report.status.ok:
                self.reason = report.message
                if not self.reason or "\n" in self.reason:
                    self.problem = f"stopped without a one-line reason: {self.reason!r}"
                return
            for balance in self._by_step:
                balance.add_step(in_pieces=self._in_pieces(report))
            if self._setup + self.wall > self._budget:
                self.problem = _late(self._setup + self.wall)
                return

    def _in_pieces(self, report: Report) -> bool:
        """Whether an implicit method did its latest step in smaller ones than it is made of.

        The length of the last of them tells, or more iterations than one attempt may take.
        """
        method, sim = METHODS[self._simulator.method], self._simulator
        if method.family != IMPLICIT:
            return False
        length = abs(float(sim._state.ledger[layout.LENGTH]))
        shorter = length < 0.999 * method.substeps[-1] * sim.step
        return shorter or report.force_evaluations > MAX_ITERATIONS * len(method.substeps)

    def _check(self) -> str:
        """What is wrong now, also with the state that a stopped run kept; empty if nothing."""
        sim = self._simulator
        parts = (sim.control_points, sim.velocities, *sim.reaction("start"), *sim.reaction("end"))
        if not all(np.isfinite(part).all() for part in parts):
            return "a number that is not finite"
        which = "kept state: " if self.reason else ""
        if not sim.energy_error <= self.tolerance:
            return f"{which}energy balance open by {sim.energy_error:.2e}"
        vacuous = random_balances.floor_share(sim) > 1.0  # it moved by round-off alone
        for name, (balance, tolerance) in self._balances.items():
            if name == "angular" and vacuous:
                continue
            error = balance.error()
            self.errors[name] = max(self.errors.get(name, 0.0), error)
            if not error <= tolerance:
                return f"{which}{OWN_BALANCES[name]} open by {error:.2e}, without the account"
        lost = float(sim._state.ledger[layout.DISSIPATED])
        if lost < self._lost - 1e-9 * random_balances.account_scale(sim):
            return f"{which}damping gave energy: {lost - self._lost:.2e} J"
        self._lost = lost
        return ""


def _apply(simulator: Simulator, move: Move, duration: float) -> None:
    position, orientation = simulator.end_pose(move.end)
    if move.turn is None:
        simulator.set_end(move.end, position=position + np.array(move.way))
        return
    motion = EndMotion(
        start=simulator.time,
        duration=duration,
        position=np.array([position, move.way, np.zeros(3)]),
        orientation=orientation,
        rotation=np.array([move.turn, np.zeros(3)]),
    )
    simulator.set_motion(move.end, motion)
