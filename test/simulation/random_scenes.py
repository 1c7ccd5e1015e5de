"""Runs random scenes and judges what becomes of them.

    python test/simulation/random_scenes.py COUNT [SEED]

runs COUNT scenes from SEED (default 0) on, prints how each method fared and every scene that went
wrong, and ends with status 1 if one did.

ran      to its end, and every check holds
refused  by one line, before the first step
stopped  by the simulator with a status and one line; the state it kept is finite and its account
         closed, and with methods that conserve energy every check holds
wrong    anything else: a broken balance, a number that is not finite, another exception, or
         more time than its budget
"""

import sys
import time
from collections import Counter
from collections.abc import Callable
from dataclasses import dataclass, field, replace

import closed_forms
import numpy as np
from scene_generator import PIECES, Case, Move, draw_case

from dlo_sim.batch.workers import open_workers
from dlo_sim.core.end_motion import EndMotion
from dlo_sim.core.methods import IMPLICIT, METHODS
from dlo_sim.scene.loading import SceneError, scene_from_values
from dlo_sim.simulation.simulator import Simulator

RAN, REFUSED, STOPPED, WRONG = "ran", "refused", "stopped", "wrong"
# Shares of the energy exchanged that the balance may be open by.
CONSERVING_TOLERANCE = 1e-4
METHOD_TOLERANCE = 0.5  # where the simulator stops by itself: no accuracy is asked for
# Of the momentum, as a share of the impulse or of what a thrown cable has. What Newton's method
# leaves adds up, by 3e-6 where it takes 160 iterations a step, and by 1.1e-5 in a cable four
# times as thick as long; thrown cables are kept less well by methods with sub-steps, some of
# them backwards, by 1.2e-3.
MOMENTUM_TOLERANCE = {"explicit": 1e-6, "implicit": 2e-5, "composed": 5e-3}
BUDGET = 60.0  # [s] of the processor's time for a scene, its constructor and its steps
CALLS = 16  # of the stepping loop per piece, so that the budget can end it
EPSILON = np.finfo(float).eps
CREEP = 1e-6  # of the length per second: motion slower than that is round-off
ENDS = ("start", "end")


@dataclass(frozen=True)
class Outcome:
    """What became of a case; `problem` is empty unless it is `wrong`.

    energy_error: largest so far, of the energy exchanged; tolerance: what it may be. errors: what
    was found without the simulator's account, by balance. moved: whether more energy was exchanged
    than round-off leaves uncertain. wall: processor time of constructor and steps [s].
    """

    seed: int
    kind: str
    method: str
    outcome: str = RAN
    reason: str = ""
    problem: str = ""
    steps: int = 0
    energy_error: float = 0.0
    tolerance: float = 0.0
    errors: dict[str, float] = field(default_factory=dict)
    moved: bool = False
    wall: float = 0.0


class Exchanged:
    """Largest kinetic energy, or change of one potential, so far [J].

    `floor` is what round-off leaves uncertain: motion of `CREEP`, and a million times the effect of
    rounded coordinates on strain (over a span) and curvature (over its square).
    """

    def __init__(self, sim: Simulator) -> None:
        cable, parts = sim.scene.cable, np.abs(energies(sim))
        self._sim, self._first, self.largest = sim, energies(sim), parts[0]
        span = cable.length / (len(sim.greville) - 3)
        reach = np.abs(sim.control_points[:, :3]).max()
        strain = EPSILON * (1.0 + reach / span)
        off = np.array([strain, strain / span])
        stiffness = np.array([cable.EA, cable.EI]) * cable.length
        noise = np.sum(np.sqrt(2.0 * parts[1:3] * stiffness) * off + stiffness * off**2)
        weight = cable.mu * cable.length * np.linalg.norm(sim.scene.gravity)
        noise += EPSILON * (parts.sum() + weight * reach)
        creep = 0.5 * cable.mu * cable.length * (CREEP * cable.length) ** 2
        self.floor = max(creep, 1e6 * noise)

    def look(self) -> None:
        """Take in the present state, unless it is not finite, which is checked elsewhere."""
        now = energies(self._sim)
        if np.isfinite(now).all():
            changes = np.abs(now[1:] - self._first[1:])
            self.largest = max(self.largest, now[0], changes.max())

    @property
    def scale(self) -> float:
        """Energy that errors are shares of [J]."""
        return float(max(self.largest, self.floor))


def energies(sim: Simulator) -> np.ndarray:
    """Kinetic energy, then the potentials of stretch, bend, twist, gravity and springs [J]."""
    now = sim.energy()
    return np.array([now.kinetic, now.stretch, now.bend, now.twist, now.gravity, now.spring])


def constant_forces(sim: Simulator, exchanged: Exchanged) -> Callable[[], float]:
    """How far energy less the work of constant forces is from what it was, as a share of the energy
    exchanged; damping may lower it."""
    loses = "damping" in sim.active_terms

    def energy_and_work() -> np.ndarray:
        places = sim.centerline([load.position * sim.scene.cable.length for load in loads])
        work = sum(np.dot(load.force, r) for load, r in zip(loads, places, strict=True))
        return np.array([sim.energy().total, work])

    loads = sim.scene.loads
    first = energy_and_work()

    def error() -> float:
        energy, work = energy_and_work() - first
        off = max(energy - work, 0.0) if loses else abs(energy - work)
        return float(off / max(exchanged.scale, abs(work)))

    return error


def free_flight(sim: Simulator) -> Callable[[], float]:
    """How far the momentum is from what it was and the impulse of constant forces, as a share; of a
    cable without forces the angular momentum likewise."""
    cable, loads = sim.scene.cable, sim.scene.loads
    force = np.sum([load.force for load in loads], axis=0) if loads else np.zeros(3)
    centre = sim.control_points[:, :3].mean(axis=0)
    speed = np.linalg.norm(sim.velocities[:, :3], axis=1).max()

    def momenta() -> np.ndarray:
        momentum, angular = closed_forms.momenta(sim)
        return np.array([momentum, (angular - np.cross(centre, momentum)) / cable.length])

    first = momenta()

    def error() -> float:
        impulse = force * sim.time
        scale = max(cable.mu * cable.length * speed, np.linalg.norm(impulse), 1e-300)
        off, turned = np.abs(momenta() - first - [impulse, np.zeros(3)]).max(axis=1) / scale
        return float(off if loads else max(off, turned))

    return error


def last_reaction(sim: Simulator, end: str) -> np.ndarray:
    """Force [N] of an end, of an implicit method the mean over the last step alone, (3,)."""
    account = sim.cable.account
    known = account.reactions
    account.reactions = min(known, 1.0)
    force = sim.reaction(end)[0]
    account.reactions = known
    return force


class EndWork:
    """Energy of an undamped cable against reaction times way of its ends, step by step.

    An implicit method's reaction is the mean over two steps, of which the last one is taken; an
    explicit one's is that of an instant, and near its limit the mean of two is not the work. Steps
    in which a motion begins or ends are left out: the velocity of an end jumps there, and no finite
    reaction does that work. So are those of a turning clamp, whose moment changes its arm within a
    step.
    """

    def __init__(self, sim: Simulator, exchanged: Exchanged) -> None:
        self._sim, self._exchanged = sim, exchanged
        self._known: tuple[float, np.ndarray, np.ndarray] | None = None
        self._open = self._latest = 0.0  # [J] of all steps before the latest, and of that
        self._largest = 0.0  # [J] work of a step

    def begin(self) -> None:
        """The ends are given other motions now."""
        self._known, self._latest = None, 0.0

    def add_step(self) -> None:
        """Take in the step that was just done."""
        sim = self._sim
        poses = [sim.end_pose(end) for end in ENDS]
        places, turns = (np.array(part) for part in zip(*poses, strict=True))
        now = sim.energy().total, places, turns
        self._open, self._latest = self._open + self._latest, 0.0
        if self._known is not None:
            energy, old_places, old_turns = self._known
            clamped = [getattr(sim.scene, end).clamped for end in ENDS]
            if not (turns != old_turns)[clamped].any():
                forces = np.array([last_reaction(sim, end) for end in ENDS])
                work = float((forces * (places - old_places)).sum())
                self._latest = now[0] - energy - work
                self._largest = max(self._largest, abs(work))
        self._known = now

    def error(self) -> float:
        """What is open of it, as a share of the energy exchanged."""
        return abs(self._open) / max(self._exchanged.scale, self._largest)


class Watch:
    """Runs one case and checks it, with balances of its own where these can be had."""

    def __init__(self, sim: Simulator, case: Case, left: float) -> None:
        """`left`: processor time for the steps [s]."""
        self._sim, self._case, self._left = sim, case, left
        conserving = METHODS[sim.method].conserves_energy
        self.tolerance = CONSERVING_TOLERANCE if conserving else METHOD_TOLERANCE
        self.problem = self.reason = ""
        self.wall = 0.0
        self.errors: dict[str, float] = {}
        self.exchanged = Exchanged(sim)
        self._work: EndWork | None = None
        self._balances: dict[str, tuple[Callable[[], float], float]] = {}
        self._choose_balances()

    def _choose_balances(self) -> None:
        sim, method = self._sim, METHODS[self._sim.method]
        loads, scene = sim.scene.loads, sim.scene
        steady = all(load.signal == "constant" for load in loads)
        damped = "damping" in sim.active_terms
        twice = 2.0 * self.tolerance  # the energy exchanged is seen less often than by the account
        if self._case.kind.driven:
            if not damped and method.family == IMPLICIT:
                self._work = EndWork(sim, self.exchanged)
                self._balances["work of the ends"] = self._work.error, twice
        elif steady and not any(any(load.torque) for load in loads):
            self._balances["energy"] = constant_forces(sim, self.exchanged), twice
        if steady and not (damped or any(scene.gravity) or scene.start.held or scene.end.held):
            sort = "implicit" if method.family == IMPLICIT else "explicit"
            sort = "composed" if len(method.substeps) > 1 and not loads else sort
            self._balances["momentum"] = free_flight(sim), MOMENTUM_TOLERANCE[sort]

    def run(self) -> None:
        """Steps and end motions, with the checks after each piece, until the first problem."""
        piece = max(self._case.steps // PIECES, 1)
        moves = list(self._case.moves)
        for k in range(PIECES):
            while moves and moves[0].piece <= k:
                _apply(self._sim, moves.pop(0), piece * self._sim.step)
            if self._work:
                self._work.begin()
            self._advance(piece)
            self.problem = self.problem or self._check()
            if self.problem or self.reason:
                return

    def _advance(self, steps: int) -> None:
        target = self._sim.steps + steps
        most = 1 if self._work else max(steps // CALLS, 1)
        while self._sim.steps < target:
            began = time.process_time()
            report = self._sim.advance_steps(min(most, target - self._sim.steps))
            self.wall += time.process_time() - began
            if not report.status.ok:
                self.reason = report.message
                if not self.reason or "\n" in self.reason:
                    self.problem = f"stopped without a one-line reason: {self.reason!r}"
                return
            self.exchanged.look()
            if self._work:
                self._work.add_step()
            if self.wall > self._left:
                self.problem = f"more time than its budget: {self.wall:.1f} s of steps"
                return

    def _check(self) -> str:
        """What is wrong now, also with the state that a stopped run kept; empty if nothing."""
        sim = self._sim
        parts = (sim.control_points, sim.velocities, *sim.reaction("start"), *sim.reaction("end"))
        if not all(np.isfinite(part).all() for part in parts):
            return "a number that is not finite"
        which = "kept state: " if self.reason else ""
        if not sim.energy_error <= self.tolerance:
            return f"{which}energy balance open by {sim.energy_error:.2e}"
        if self.reason and not METHODS[sim.method].conserves_energy:
            return ""  # its energy is a share of what Newton's method left uncertain, unknown here
        self.exchanged.look()
        for name, (balance, tolerance) in self._balances.items():
            self.errors[name] = error = max(self.errors.get(name, 0.0), balance())
            if not error <= tolerance:
                return f"{which}{name} open by {error:.2e}, without the account"
        return ""


def run_seed(seed: int) -> Outcome:
    """Draw the case of a seed and run it; a function for workers."""
    return run_case(draw_case(seed))


def run_case(case: Case, budget: float = BUDGET) -> Outcome:
    """Simulate a case and judge it. Never raises for what a case does."""
    blank = Outcome(case.seed, case.kind.name, case.values["integrator.method"])
    began = time.process_time()
    try:
        sim = Simulator(scene_from_values(case.values))
        # What is compiled in the constructor is done once per kind of scene, and not judged.
        setup = max(time.process_time() - began - sim.compile_seconds, 0.0)
        if case.throw:
            sim.start_from(sim.control_points, _rates(sim, case.throw))
        watch = Watch(sim, case, budget - setup)
        watch.run()
    except SceneError as refusal:
        if len(str(refusal).splitlines()) == 1:
            return replace(blank, outcome=REFUSED, reason=str(refusal))
        return replace(blank, outcome=WRONG, problem=f"refused by other than a line: {refusal}")
    except Exception as error:
        return replace(blank, outcome=WRONG, problem=f"{type(error).__name__}: {error}")
    return replace(
        blank,
        method=sim.method,
        outcome=WRONG if watch.problem else STOPPED if watch.reason else RAN,
        reason=watch.reason,
        problem=watch.problem,
        steps=sim.steps,
        energy_error=sim.energy_error,
        tolerance=watch.tolerance,
        errors=watch.errors,
        moved=bool(watch.exchanged.largest > watch.exchanged.floor),
        wall=setup + watch.wall,
    )


def _rates(sim: Simulator, throw: tuple[tuple[float, ...], ...]) -> np.ndarray:
    """Velocities (n, 4): the same everywhere, and across the straight cable a turn and a bend."""
    speed, turn, bend = np.array(throw)
    points = sim.control_points[:, :3]
    along = points[-1] - points[0]
    along /= np.linalg.norm(along)
    share = 2.0 * sim.greville[:, None] / sim.scene.cable.length - 1.0
    across = share * turn + (share**2 - 1.0 / 3.0) * bend
    rates = np.zeros_like(sim.control_points)
    rates[:, :3] = speed + across - np.outer(across @ along, along)
    return rates


def _apply(sim: Simulator, move: Move, duration: float) -> None:
    position, orientation = sim.end_pose(move.end)
    if move.turn is None:
        sim.set_end(move.end, position=position + np.array(move.way))
        return
    sim.set_motion(
        move.end,
        EndMotion(
            start=sim.time,
            duration=duration,
            position=position,
            orientation=orientation,
            velocity=move.way,
            angular_velocity=move.turn,
        ),
    )


def main(count: int, first: int = 0) -> int:
    """Run so many scenes on all cores and print what became of them; the exit status."""
    with open_workers() as workers:
        outcomes = list(workers.map(run_seed, range(first, first + count)))
    kinds = (RAN, REFUSED, STOPPED, WRONG)
    print(f"{'method':20}{''.join(f'{kind:>9}' for kind in kinds)}{'moved':>9}  largest error")
    for method in sorted({one.method for one in outcomes}):
        mine = [one for one in outcomes if one.method == method]
        counts = Counter(one.outcome for one in mine)
        ran = [one for one in mine if one.outcome == RAN]
        cells = [*(counts[kind] for kind in kinds), sum(one.moved for one in ran)]
        largest = max((one.energy_error for one in ran), default=0.0)
        print(f"{method:20}{''.join(f'{cell:9}' for cell in cells)}  {largest:.1e}")
    wrong = [one for one in outcomes if one.outcome == WRONG]
    for one in wrong:
        print(f"seed {one.seed}, {one.kind}, {one.method}, step {one.steps}: {one.problem}")
    return 1 if wrong else 0


if __name__ == "__main__":
    sys.exit(main(*(int(argument) for argument in sys.argv[1:3])))
