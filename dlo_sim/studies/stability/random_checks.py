"""What becomes of a random scene: it is simulated for a bounded number of steps and judged.

ran      to its end, and every check holds
refused  by one line, before the first step
stopped  by the simulator with a status and one line; the state is the last good one
wrong    anything else: a broken balance, a number that is not finite, another exception, or
         more time than its budget
"""

from __future__ import annotations

import time
from dataclasses import dataclass, replace

import numpy as np

from dlo_sim.core.end_motion import EndMotion
from dlo_sim.core.methods import METHODS
from dlo_sim.kernels import layout
from dlo_sim.scene.loading import SceneError, scene_from_values
from dlo_sim.simulation.simulator import Simulator
from dlo_sim.studies.stability import truths
from dlo_sim.studies.stability.random_scenes import PIECES, Case, Move, draw_case

RAN, REFUSED, STOPPED, WRONG = "ran", "refused", "stopped", "wrong"
# Shares of the energy exchanged that the balance may be open by.
CONSERVING_TOLERANCE = 1e-4
METHOD_TOLERANCE = 0.5
MOMENTUM_TOLERANCE = 1e-6  # of the impulse
BUDGET = 60.0  # [s] of the processor's time for the steps of a scene
CALLS = 16  # of the stepping loop per piece, so that the budget can end it


@dataclass(frozen=True)
class Outcome:
    """What became of a case; `problem` is empty unless it is `wrong`.

    energy_error: largest so far, of the energy exchanged; tolerance: what it may be. closed,
    momentum: the errors that were found without the simulator's own account, where that can be.
    wall: processor time of stepping [s], which does not depend on what else runs.
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
    closed: float = 0.0
    momentum: float = 0.0
    force_evaluations: int = 0
    wall: float = 0.0


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
        simulator = Simulator(scene_from_values(values))
    except SceneError as refusal:
        if "\n" in str(refusal):
            return replace(blank, outcome=WRONG, problem=f"not one line: {str(refusal)!r}")
        return replace(blank, outcome=REFUSED, reason=str(refusal))
    except Exception as error:
        return replace(blank, outcome=WRONG, problem=f"{type(error).__name__}: {error}")
    watch = _Watch(simulator, case, budget)
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
        closed=watch.open,
        momentum=watch.momentum_error,
        force_evaluations=watch.evaluations,
        wall=watch.wall,
    )


class _Watch:
    """Runs one case and checks it independently of the simulator.

    Besides the simulator's own account, constant forces give a second one without it: their work is
    force times displacement. In free flight the momentum is the impulse of the loads.
    """

    def __init__(self, simulator: Simulator, case: Case, budget: float) -> None:
        conserving = METHODS[simulator.method].conserves_energy
        self.tolerance = CONSERVING_TOLERANCE if conserving else METHOD_TOLERANCE
        self.problem = self.reason = ""
        self.open = self.momentum_error = self.wall = 0.0
        self.evaluations = 0
        self._simulator = simulator
        self._case = case
        self._budget = budget
        self._first = self._conservative_energy() if self._closed() else 0.0
        self._lost = 0.0

    def run(self) -> None:
        """Steps and end motions, with the checks after each piece, until the first problem."""
        piece = max(self._case.steps // PIECES, 1)
        moves = list(self._case.moves)
        for k in range(PIECES):
            while moves and moves[0].piece <= k:
                _apply(self._simulator, moves.pop(0), piece * self._simulator.step)
            self._advance(piece)
            self.problem = self.problem or self._check()
            if self.problem or self.reason:
                return

    def _advance(self, steps: int) -> None:
        target = self._simulator.steps + steps
        while self._simulator.steps < target and not self.reason:
            began = time.process_time()
            report = self._simulator.advance_steps(
                min(max(steps // CALLS, 1), target - self._simulator.steps)
            )
            self.wall += time.process_time() - began
            self.evaluations += report.force_evaluations
            if not report.status.ok:
                self.reason = report.message
                if not self.reason or "\n" in self.reason:
                    self.problem = f"stopped without a one-line reason: {self.reason!r}"
                return
            if self.wall > self._budget:
                self.problem = f"more than its budget of {self._budget:g} s"
                return

    def _check(self) -> str:
        """What is wrong now; empty if nothing."""
        sim = self._simulator
        parts = (sim.control_points, sim.velocities, *sim.reaction("start"), *sim.reaction("end"))
        if not all(np.isfinite(part).all() for part in parts):
            return "a number that is not finite"
        if self.reason:
            return ""  # it has said that something is wrong; the report counts what it kept
        ledger = sim._state.ledger  # what the public energy_error is a quotient of
        scale = max(ledger[layout.EXCHANGED], ledger[layout.FLOOR])
        if not sim.energy_error <= self.tolerance:
            return f"energy balance open by {sim.energy_error:.2e}"
        if self._closed():
            error = float(abs(self._conservative_energy() - self._first) / scale)
            self.open = max(self.open, error)
            if not error <= 1.01 * self.tolerance + 1e-7:
                return f"energy without the account open by {error:.2e}"
        lost = float(ledger[layout.DISSIPATED])
        if lost < self._lost - 1e-9 * scale:
            return f"damping gave energy: {lost - self._lost:.2e} J"
        self._lost = lost
        return self._momentum_problem()

    def _closed(self) -> bool:
        """Whether nothing but constant forces does work, and nothing takes energy."""
        sim = self._simulator
        loads = sim.scene.loads
        constant = all(load.signal == "constant" and not any(load.torque) for load in loads)
        damped = "damping" in sim.active_terms or sim.method == "generalized_alpha"
        return constant and not damped and not self._case.kind.driven

    def _conservative_energy(self) -> float:
        sim = self._simulator
        work = sum(
            float(np.dot(load.force, sim.centerline([load.position * sim.scene.cable.length])[0]))
            for load in sim.scene.loads
        )
        return sim.energy().total - work

    def _momentum_problem(self) -> str:
        sim = self._simulator
        scene = sim.scene
        steady = all(load.signal == "constant" for load in scene.loads)
        if scene.start.held or scene.end.held or not steady:
            return ""
        impulse = sum((np.array(load.force) for load in scene.loads), np.zeros(3)) * sim.time
        momentum, _ = truths.momenta(sim)
        size = max(float(np.linalg.norm(impulse)), 1e-300)
        error = float(np.abs(momentum - impulse).max()) / size
        self.momentum_error = error
        return f"momentum wrong by {error:.2e}" if not error <= MOMENTUM_TOLERANCE else ""


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
