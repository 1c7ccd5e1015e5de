"""The judge of all scenes: runs a case and says what became of it.

ran      to its end, and every check holds
refused  by one line, before the first step
stopped  by the simulator with a status and one line; the state it kept is finite and its account
         closed, and with methods that conserve energy every check holds
wrong    anything else: a broken balance, a number that is not finite, an error beyond its bound,
         another exception, or more time than its budget
"""

from __future__ import annotations

import time
import warnings
from collections.abc import Callable
from dataclasses import dataclass, field, replace
from typing import Any

import closed_forms
import numpy as np
from numba.core.errors import NumbaWarning
from numpy.typing import ArrayLike, NDArray

from dlo_sim.core import bspline
from dlo_sim.core.methods import IMPLICIT, METHODS
from dlo_sim.methods import between_steps
from dlo_sim.scene.description import Scene
from dlo_sim.scene.loading import SceneError, scene_from_values
from dlo_sim.simulation.buckling import SLOWEST
from dlo_sim.simulation.obstacles import gaps
from dlo_sim.simulation.report import MOST_OPEN
from dlo_sim.simulation.self_contact import nearest
from dlo_sim.simulation.simulator import Simulator

Array = NDArray[np.float64]
Values = dict[str, Any]
Vector = tuple[float, ...]
Action = Callable[[Simulator], Simulator | None]

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
PIECES, CALLS = 8, 128  # of a run: checks between pieces, calls between which the budget can end it
EPSILON = np.finfo(float).eps
CREEP = 1e-6  # of the length per second: motion slower than that is round-off
ENDS = ("start", "end")


@dataclass(frozen=True)
class Case:
    """A scene, what happens to it, and what must come of it.

    Attributes:
        name, seed: its name, or its kind and the seed that it was drawn from.
        duration: of the run [s]; `steps`: or its number of steps.
        events: (share of the run, action), in order.
        throw: velocity [m/s] of a free cable, and amplitudes across it of a turn and a bend.
        check: what is wrong with a run that came to its end; None: nothing is asked.
        must_run: whether a refusal, a warning at the start or an early end is wrong, too.
        balanced: whether energy, momentum and work are also balanced without the account.
    """

    name: str
    values: Values
    duration: float = 0.0
    steps: int = 0
    events: tuple[tuple[float, Action], ...] = ()
    throw: tuple[Vector, ...] = ()
    check: Check | None = None
    must_run: bool = True
    balanced: bool = False
    seed: int = 0


@dataclass(frozen=True)
class Outcome:
    """What became of a case; `problem` is empty unless it is `wrong`.

    energy_error: largest so far, of the energy exchanged; tolerance: what it may be. errors: what
    was found without the simulator's account, by balance. moved: whether more energy was exchanged
    than round-off leaves uncertain. step [s]. wall: processor time of constructor and steps [s].
    """

    name: str
    seed: int = 0
    outcome: str = RAN
    reason: str = ""
    problem: str = ""
    method: str = ""
    step: float = 0.0
    steps: int = 0
    iterations: int = 0
    energy_error: float = 0.0
    tolerance: float = 0.0
    errors: dict[str, float] = field(default_factory=dict)
    moved: bool = False
    wall: float = 0.0


# -- balances without the simulator's account -----------------------------------------------------


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


def energies(sim: Simulator) -> Array:
    """Kinetic energy, then the potentials of stretch, bend, twist, gravity and springs [J]."""
    now = sim.energy()
    return np.array([now.kinetic, now.stretch, now.bend, now.twist, now.gravity, now.spring])


def constant_forces(sim: Simulator, exchanged: Exchanged) -> Callable[[], float]:
    """How far energy less the work of constant forces is from what it was, as a share of the energy
    exchanged; damping may lower it."""
    loses, loads = "damping" in sim.active_terms, sim.scene.loads

    def energy_and_work() -> Array:
        places = sim.centerline([load.position * sim.scene.cable.length for load in loads])
        work = sum(np.dot(load.force, r) for load, r in zip(loads, places, strict=True))
        return np.array([sim.energy().total, work])

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

    def momenta() -> Array:
        momentum, angular = closed_forms.momenta(sim)
        return np.array([momentum, (angular - np.cross(centre, momentum)) / cable.length])

    first = momenta()

    def error() -> float:
        impulse = force * sim.time
        scale = max(cable.mu * cable.length * speed, np.linalg.norm(impulse), 1e-300)
        off, turned = np.abs(momenta() - first - [impulse, np.zeros(3)]).max(axis=1) / scale
        return float(off if loads else max(off, turned))

    return error


def last_reaction(sim: Simulator, end: str) -> Array:
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
        self._known: tuple[float, Array, Array] | None = None
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


# -- runs -----------------------------------------------------------------------------------------


class Run:
    """A case in progress: its present simulator, the control points at its start (n, 4); over all
    simulators of the run, numbers of steps and iterations, the largest energy error, processor time
    of the steps [s], what is wrong, and why it ended early.
    """

    def __init__(self, sim: Simulator, case: Case, left: float) -> None:
        """`left`: processor time for the steps [s]."""
        self.simulator, self.case, self._left = sim, case, left
        self.first = sim.control_points
        self.steps = self.iterations = 0
        self.energy_error = self.wall = 0.0
        self.problem = self.reason = ""
        self.errors: dict[str, float] = {}
        conserving = METHODS[sim.method].conserves_energy
        self.tolerance = CONSERVING_TOLERANCE if conserving else METHOD_TOLERANCE
        self.exchanged = Exchanged(sim)
        self._work: EndWork | None = None
        self._balances: dict[str, tuple[Callable[[], float], float]] = {}
        if case.balanced:
            self._choose_balances()

    @property
    def scene(self) -> Scene:
        """The scene of the present simulator."""
        return self.simulator.scene

    def _choose_balances(self) -> None:
        sim, method = self.simulator, METHODS[self.simulator.method]
        loads, scene = sim.scene.loads, sim.scene
        steady = all(load.signal == "constant" for load in loads)
        damped = "damping" in sim.active_terms
        twice = 2.0 * self.tolerance  # the energy exchanged is seen less often than by the account
        if self.case.events:
            if not damped and method.family == IMPLICIT:
                self._work = EndWork(sim, self.exchanged)
                self._balances["work of the ends"] = self._work.error, twice
        elif steady and not any(any(load.torque) for load in loads):
            self._balances["energy"] = constant_forces(sim, self.exchanged), twice
        if steady and not (damped or any(scene.gravity) or scene.start.held or scene.end.held):
            sort = "implicit" if method.family == IMPLICIT else "explicit"
            sort = "composed" if len(method.substeps) > 1 and not loads else sort
            self._balances["momentum"] = free_flight(sim), MOMENTUM_TOLERANCE[sort]

    def go(self) -> None:
        """Steps and events, with the checks after each piece, until the first problem."""
        case = self.case
        total = case.steps or round(case.duration / self.simulator.step)
        stops: list[tuple[float, Action | None]] = [*case.events]
        stops += [(k / PIECES, None) for k in range(1, PIECES + 1)]
        for share, action in sorted(stops, key=lambda stop: stop[0]):
            self._advance(round(share * total), max(total // CALLS, 1))
            self.problem = self.problem or self._check()
            if self.problem or self.reason:
                return
            if action is not None:
                self.simulator = action(self.simulator) or self.simulator
            if self._work:
                self._work.begin()
        if case.check is not None:
            self.problem = case.check(self)

    def _advance(self, target: int, most: int) -> None:
        while self.steps < target:
            sim, began = self.simulator, time.process_time()
            report = sim.advance_steps(1 if self._work else min(most, target - self.steps))
            self.wall += time.process_time() - began
            self.steps += report.steps
            self.iterations += report.force_evaluations
            self.energy_error = max(self.energy_error, sim.energy_error)
            done = report.status.advanced if self.case.must_run else report.status.ok
            if not done:
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
        sim = self.simulator
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


def judged(case: Case, budget: float = BUDGET) -> Outcome:
    """Simulate a case and judge it. Never raises for what a case does."""
    blank = Outcome(case.name, case.seed, method=case.values.get("integrator.method", "auto"))
    began = time.process_time()
    try:
        with warnings.catch_warnings(record=True) as said:
            warnings.simplefilter("always")
            sim = Simulator(scene_from_values(case.values))
        # What is compiled in the constructor is done once per kind of scene, and not judged.
        setup = max(time.process_time() - began - sim.compile_seconds, 0.0)
        if case.throw:
            sim.start_from(sim.control_points, _rates(sim, case.throw))
        run = Run(sim, case, budget - setup)
        told = [str(one.message) for one in said if not issubclass(one.category, NumbaWarning)]
        run.problem = "; ".join(told) if case.must_run else ""
        if not run.problem:
            run.go()
    except SceneError as refusal:
        if len(str(refusal).splitlines()) != 1:
            return replace(blank, outcome=WRONG, problem=f"refused by other than a line: {refusal}")
        if case.must_run:
            return replace(blank, outcome=WRONG, problem=f"refused: {refusal}")
        return replace(blank, outcome=REFUSED, reason=str(refusal))
    except Exception as error:
        return replace(blank, outcome=WRONG, problem=f"{type(error).__name__}: {error}")
    if run.reason and case.must_run and not run.problem:
        run.problem = f"stopped: {run.reason}"
    return replace(
        blank,
        outcome=WRONG if run.problem else STOPPED if run.reason else RAN,
        reason=run.reason,
        problem=run.problem,
        method=sim.method,
        step=sim.step,
        steps=run.steps,
        iterations=run.iterations,
        energy_error=run.energy_error,
        tolerance=run.tolerance,
        errors=run.errors,
        moved=bool(run.exchanged.largest > run.exchanged.floor),
        wall=setup + run.wall,
    )


def _rates(sim: Simulator, throw: tuple[Vector, ...]) -> Array:
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


# -- checks of a run that came to its end: what is wrong, empty if nothing ------------------------

Check = Callable[[Run], str]
Error = Callable[[Run], float]


def within(error: Error, bound: float) -> Check:
    """Whether an error is at most a bound."""

    def check(run: Run) -> str:
        found = error(run)
        return "" if found <= bound else f"{error.__name__}: off by {found:.3g}, over {bound:g}"

    return check


def energy(run: Run) -> float:
    """Energy balance, share of the energy exchanged."""
    return run.energy_error


closed = within(energy, 1e-4)  # of an undamped swing


def closed_or_told(run: Run) -> str:
    """Whether an open energy balance is said."""
    return "" if run.simulator.warnings else within(energy, MOST_OPEN)(run)


DEEPEST = 0.1  # diameters that a cable may be in an obstacle or in itself
UNEXPLAINED = 0.4  # local stretch beyond that of the tension: no resolution of a bend causes it


def right_at_rest(run: Run) -> str:
    """A shape must be stable, at rest, stretched by its tension alone, which is computed from the
    reaction at the start and the weight, outside of obstacles and of itself.

    Where a bend is sharper than the cable is thick nothing is asked of the stretch: such a cable is
    none that grippers can hold.
    """
    sim, cable, scene = run.simulator, run.simulator.cable, run.scene
    length, diameter, lines = scene.cable.length, scene.cable.diameter, sim.model.lines
    correction = cable.forces().T.ravel()
    band = cable.stiffness(moments=True)
    if scene.bodies:  # a cable that is free to turn on a table grows slower than SLOWEST
        inertia = np.stack([sim.model.mass(line)[0] for line in range(lines)], axis=1)
        band[:, 4 * lines - 1] += SLOWEST**2 * inertia.ravel()
    negative = cable.call(between_steps.solve_held, correction.reshape(1, -1), False)
    if negative != 0:
        return f"unstable: {negative} negative pivots"
    moved, turned = np.split(np.abs(correction.reshape(-1, lines)), [len(sim.model.axes)], axis=1)
    if moved.max() > 1e-6 * length or turned.max(initial=0.0) > 1e-4:
        return f"not at rest: {moved.max():.2g} m, {turned.max(initial=0.0):.2g} rad off"
    u = np.linspace(0.0, length, 201)
    slope = bspline.evaluate(cable.points[:, :3], sim.model.knots, u, 1)
    stretch = np.linalg.norm(slope, axis=1)
    inside = sim.reaction("start")[0] + np.outer(u, scene.cable.mu * np.array(scene.gravity))
    tension = -(inside * slope).sum(axis=1) / stretch
    excess = stretch - 1.0 - tension / scene.cable.EA
    worst = int(np.argmax(np.abs(excess)))
    if abs(excess[worst]) > UNEXPLAINED and sim.curvature(u).max() * diameter < 1.0:
        return f"stretch {stretch[worst]:.3g} at {u[worst] / length:.2g} L, unexplained"
    line = sim.centerline(np.linspace(0.0, length, 1001))
    for body in scene.bodies:
        depth = -float(gaps(body, diameter, line).min()) / diameter
        if depth > DEEPEST:
            return f"{depth:.2g} diameters in {body.name}"
    near = nearest(sim.model, cable.points) if scene.bodies else None
    return "crosses itself" if near and near.clearance < -DEEPEST * diameter else ""


PULSE = 0.01  # [s]
PULSES = {"left": (3.0, 1.0, -2.0), "right": (-1.0, 0.5, 2.5)}  # [N] at u = 0 and u = L
TURN = 2.0  # [rad]
BLOW = (1e6, 1e-3)  # [N], [s]


def lasting(run: Run) -> float:
    """Displacement, share of L; energy balance."""
    return max(_moved(run), run.energy_error)


def hangs_as_catenary(run: Run) -> float:
    """Distance from the elastic catenary, share of L."""
    scene, cable = run.scene, run.scene.cable
    u = np.linspace(0.0, cable.length, 201)
    span = scene.end.position[0] - scene.start.position[0]
    weight = cable.mu * -scene.gravity[2]
    x, z = closed_forms.catenary(u, cable.length, span, weight, cable.EA)
    shape = run.simulator.centerline(u) - np.asarray(scene.start.position)
    return float(np.hypot(shape[:, 0] - x, shape[:, 2] - z).max() / cable.length)


def sags_as_cantilever(run: Run) -> float:
    """Tip deflection, relative to q L^4 / 8 EI."""
    cable = run.scene.cable
    expected = cable.mu * -run.scene.gravity[2] * cable.length**4 / (8.0 * cable.EI)
    return _off(-run.simulator.control_points[-1, 2], expected)


def pulls_as_string(run: Run) -> float:
    """Deflection, relative to an elastic string."""
    force = float(np.linalg.norm(run.scene.load("pull").force))
    return _off(_deflection(run), _of_string(run, force))


def swings(run: Run) -> float:
    """Energy balance; infinite if it moved by less than 1 % of the length."""
    return run.energy_error if _moved(run) > 1e-2 else np.inf


def follows_string(run: Run) -> float:
    """Mean deflection, relative to an elastic string; 1000 times the energy balance.

    Averaged over fast small oscillations; the string is under the load's present force.
    """
    load, found, force = run.scene.load("pull"), [], []
    for _ in range(20):
        run.simulator.advance_steps(1)
        found.append(_deflection(run))
        share = np.sin(2.0 * np.pi * load.frequency * run.simulator.time)
        force.append(np.linalg.norm(load.force) * abs(share))
    expected = _of_string(run, float(np.mean(force)))
    return max(_off(float(np.mean(found)), expected), 1e3 * run.energy_error)


def weighs_its_weight(run: Run) -> float:
    """Reaction, relative to the weight."""
    weight = run.scene.cable.mu * run.scene.cable.length * np.asarray(run.scene.gravity)
    return _off(run.simulator.reaction("start")[0], -weight)


def is_taut(run: Run) -> float:
    """Tension, relative to EA (gap / L - 1)."""
    cable = run.scene.cable
    start, end = (run.simulator.end_pose(name)[0] for name in ENDS)
    stretch = float(np.linalg.norm(end - start)) / cable.length - 1.0
    force = float(np.linalg.norm(run.simulator.reaction("end")[0]))
    return _off(force, cable.EA * stretch)


def keeps_momentum(run: Run) -> float:
    """Momentum against the pulses, and angular momentum over another second, relative."""
    momentum, angular = closed_forms.momenta(run.simulator)
    run.simulator.advance(1.0)
    _, later = closed_forms.momenta(run.simulator)
    impulse = PULSE * np.sum(list(PULSES.values()), axis=0)
    return max(_off(momentum, impulse), _off(later, angular))


def carries_impulse(run: Run) -> float:
    """Momentum, relative to the impulse."""
    return _off(closed_forms.momenta(run.simulator)[0], [0.0, 0.0, BLOW[0] * BLOW[1]])


def turns_as_rod(run: Run) -> float:
    """Moment, relative to GJ Theta / L; displacement off the axis, share of L."""
    cable = run.scene.cable
    moment = abs(run.simulator.reaction("end")[1][0])
    return max(_off(moment, cable.GJ * TURN / cable.length), _off_axis(run))


def stays_straight(run: Run) -> float:
    """Displacement off the axis, share of L; energy balance."""
    return max(_off_axis(run), run.energy_error)


def amplifies_as_column(run: Run) -> float:
    """Buckling load, relative to EI pi^2 / L^2.

    From the sag of the column, which the load amplifies to w0 / (1 - P / Pc).
    """
    scene, cable = run.scene, run.scene.cable
    side = scene.load("side").force[2]
    first_mode = 2.0 * side * cable.length**3 / (np.pi**4 * cable.EI)
    sag = run.simulator.centerline([0.5 * cable.length])[0, 2]
    buckling = abs(scene.load("press").force[0]) / (1.0 - first_mode / sag)
    return _off(buckling, closed_forms.euler_load(scene))


def buckles_as_elastica(run: Run) -> float:
    """Distance of the ends, against the elastica, share of L."""
    length = run.scene.cable.length
    share = abs(run.scene.load("press").force[0]) / closed_forms.euler_load(run.scene)
    first, last = run.simulator.centerline([0.0, length])[:, 0]
    return float(abs((last - first) / length - closed_forms.elastica_gap(share)))


def closes_ring(run: Run) -> float:
    """Distance of the ends, share of L."""
    points = run.simulator.control_points
    return float(np.linalg.norm(points[-1, :3] - points[0, :3]) / run.scene.cable.length)


def mirrors(run: Run) -> float:
    """Asymmetry, share of L; energy balance."""
    shape = _shape(run.simulator)
    middle = np.array([shape[0, 0] + shape[-1, 0], 0.0, 0.0])
    gap = np.abs(shape - shape[::-1] * [-1.0, 1.0, 1.0] - middle).max() / run.scene.cable.length
    return float(max(gap, run.energy_error))


def rests_as_undamped(run: Run) -> float:
    """Distance from the undamped equilibrium, share of L."""
    plain = dict.fromkeys(("damping.mass", "damping.stiffness", "damping.air_drag"), 0.0)
    still = Simulator(run.scene.with_values({**plain, "initial.shape": "equilibrium"}))
    gap = np.linalg.norm(_shape(run.simulator) - _shape(still), axis=1).max()
    return float(gap / run.scene.cable.length)


def _shape(simulator: Simulator) -> Array:
    """101 points of the centerline [m]."""
    return simulator.centerline(np.linspace(0.0, simulator.scene.cable.length, 101))


def _moved(run: Run) -> float:
    """Largest displacement of a control point along an axis since the start, share of L."""
    moved = np.abs(run.simulator.control_points - run.first)[:, :3].max()
    return float(moved / run.scene.cable.length)


def _deflection(run: Run) -> float:
    """Deflection of the middle along y [m]."""
    return float(abs(run.simulator.centerline([0.5 * run.scene.cable.length])[0, 1]))


def _of_string(run: Run, force: float) -> float:
    """Deflection [m] of an elastic string under a force [N] in its middle."""
    cable = run.scene.cable
    return closed_forms.string_deflection(force, cable.EA, cable.length, cable.EI)


def _off_axis(run: Run) -> float:
    """Largest distance of control points from the x axis, share of L."""
    points = run.simulator.control_points
    return float(np.abs(points[:, 1:3]).max() / run.scene.cable.length)


def _off(found: ArrayLike, expected: ArrayLike) -> float:
    """Relative difference of two numbers or vectors."""
    gap = np.linalg.norm(np.subtract(found, expected))
    return float(gap / np.linalg.norm(np.asarray(expected)))
