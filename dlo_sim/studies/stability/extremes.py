"""Runs of extreme scenes with actions at given times, checked against an independent result if
there is one, or else the energy balance.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from dlo_sim.core.end_motion import EndMotion
from dlo_sim.scene.description import Scene
from dlo_sim.scene.loading import SceneError, scene_from_values
from dlo_sim.simulation.simulator import Simulator
from dlo_sim.studies import analytic
from dlo_sim.studies.runs import Array, timed

Values = dict[str, Any]
Action = Callable[[Simulator], Simulator | None]

RAN, REFUSED, STOPPED = "ran", "refused", "stopped"
# The study measures the method, not the tolerance of its solver.
TIGHT: Values = {"integrator.tolerance": 1e-10}
BUDGET = 30.0  # [s], largest run time of a scene
PIECES = 50  # calls per run, between which the budget is checked


@dataclass
class Run:
    """A run in progress: its present simulator, the control points at its start (n, 4); over all
    simulators of the run, the largest energy error, numbers of steps and iterations, run time [s],
    and why it ended early.
    """

    simulator: Simulator
    first: Array
    energy_error: float = 0.0
    steps: int = 0
    iterations: int = 0
    wall: float = 0.0
    message: str = ""

    @property
    def scene(self) -> Scene:
        """The scene of the present simulator."""
        return self.simulator.scene

    @property
    def cells(self) -> list[Any]:
        """Cells of the table: energy error, method, step [s], steps, iterations, run time [s]."""
        simulator = self.simulator
        counts = (self.steps, self.iterations, self.wall)
        return [self.energy_error, simulator.method, simulator.step, *counts]


Check = Callable[[Run], float]


@dataclass(frozen=True)
class Extreme:
    """An extreme scene, its duration [s], the `check` that gives the error of a finished run and
    describes it in its docstring, the `bound` on that error, and events (time [s], action) in
    order of time.
    """

    name: str
    what: str
    values: Values
    duration: float
    check: Check
    bound: float
    events: tuple[tuple[float, Action], ...] = ()


@dataclass(frozen=True)
class Finding:
    """Result of an extreme scene: `run` is None if it was refused, `error` is None unless it ran to
    its end."""

    extreme: Extreme
    outcome: str
    reason: str = ""
    error: float | None = None
    run: Run | None = None

    @property
    def of_what(self) -> str:
        """Description of the error."""
        return (self.extreme.check.__doc__ or "").partition("\n")[0]

    @property
    def right(self) -> bool:
        """Whether it ran to its end with finite results and an error within the bound."""
        if self.error is None or self.run is None:
            return False
        finite = bool(np.isfinite(self.run.simulator.control_points).all())
        return finite and self.error <= self.extreme.bound


def examine(extreme: Extreme, share: float = 1.0) -> Finding:
    """Run a scene, or the first `share` of it, and check the result."""
    run = None
    try:
        simulator = Simulator(scene_from_values(TIGHT | extreme.values))
        run = Run(simulator, simulator.control_points)
        last = extreme.duration * share
        for moment, action in (*extreme.events, (last, lambda simulator: None)):
            if not _advance_to(run, min(moment, last)):
                return Finding(extreme, STOPPED, run.message, run=run)
            if moment < last:
                run.simulator = action(run.simulator) or run.simulator
    except SceneError as refusal:
        return Finding(extreme, REFUSED, str(refusal), run=run)
    return Finding(extreme, RAN, error=float(extreme.check(run)), run=run)


def _advance_to(run: Run, until: float) -> bool:
    """Advance by whole steps up to a time of the present simulator [s]; return success."""
    simulator = run.simulator
    target = round(until / simulator.step)
    piece = max((target - simulator.steps) // PIECES, 1)
    while simulator.steps < target:
        took, report = timed(simulator, min(piece, target - simulator.steps))
        run.wall += took
        run.steps += report.steps
        run.iterations += report.force_evaluations
        run.energy_error = max(run.energy_error, simulator.energy_error)
        run.message = "" if report.status.advanced else report.message
        if not run.message and run.wall > BUDGET and simulator.steps < target:
            run.message = f"its budget of {BUDGET:g} s was used up at {simulator.time:.6g} s"
        if run.message:
            return False
    return True


def push(load: str, *force: float) -> Action:
    """Set the force [N] of a load."""
    return lambda simulator: simulator.set_load(load, force=force)


def jump(end: str, *way: float) -> Action:
    """Displace an end instantaneously [m]."""
    return lambda simulator: simulator.set_end(end, position=simulator.end_pose(end)[0] + way)


def turn(end: str, angle: float) -> Action:
    """Rotate an end about x instantaneously, to an angle [rad]."""
    half = (np.sin(0.5 * angle), 0.0, 0.0, np.cos(0.5 * angle))
    return lambda simulator: simulator.set_end(end, orientation=half)


def move(end: str, velocity: float, duration: float) -> Action:
    """Move an end along x with a velocity [m/s] for a time [s]."""

    def begin(simulator: Simulator) -> None:
        position, orientation = simulator.end_pose(end)
        motion = EndMotion(
            start=simulator.time,
            duration=duration,
            position=position,
            orientation=orientation,
            velocity=(velocity, 0.0, 0.0),
        )
        simulator.set_motion(end, motion)

    return begin


def reconfigure(key: str, value: float) -> Action:
    """Change a value of the scene, which must not change the shape."""

    def change(simulator: Simulator) -> Simulator:
        other = simulator.reconfigured(simulator.scene.with_values({key: value}))
        if not np.array_equal(simulator.control_points, other.control_points):
            raise RuntimeError("reconfiguring changed the shape")
        return other

    return change


PULSE = 0.01  # [s]
PULSES = {"left": (3.0, 1.0, -2.0), "right": (-1.0, 0.5, 2.5)}  # [N] at u = 0 and u = L
TURN = 2.0  # [rad]
BIG_PULSE = (1e6, 1e-3)  # [N], [s]


def energy_balance(run: Run) -> float:
    """energy balance, share of the energy exchanged"""
    return run.energy_error


def lasting(run: Run) -> float:
    """displacement, share of L; energy balance"""
    return max(_moved(run), run.energy_error)


def hangs_as_catenary(run: Run) -> float:
    """distance from the elastic catenary, share of L"""
    scene, cable = run.scene, run.scene.cable
    u = np.linspace(0.0, cable.length, 201)
    span = scene.end.position[0] - scene.start.position[0]
    x, z = analytic.catenary(u, cable.length, span, cable.mu * -scene.gravity[2], cable.EA)
    shape = run.simulator.centerline(u) - np.asarray(scene.start.position)
    return float(np.hypot(shape[:, 0] - x, shape[:, 2] - z).max() / cable.length)


def sags_as_cantilever(run: Run) -> float:
    """tip deflection, relative to q L^4 / 8 EI"""
    cable = run.scene.cable
    expected = cable.mu * -run.scene.gravity[2] * cable.length**4 / (8.0 * cable.EI)
    return _off(-run.simulator.control_points[-1, 2], expected)


def pulls_as_string(run: Run) -> float:
    """deflection, relative to an elastic string"""
    force = float(np.linalg.norm(run.scene.load("pull").force))
    return _off(_deflection(run), _of_string(run, force))


def swings_about_string(run: Run) -> float:
    """energy balance, share of the energy exchanged

    Infinite if it moved by less than 1 % of the length.
    """
    return run.energy_error if _moved(run) > 1e-2 else np.inf


def follows_string(run: Run) -> float:
    """mean deflection, relative to an elastic string; 1000 times the energy balance

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
    """reaction, relative to the weight"""
    cable = run.scene.cable
    force, _ = run.simulator.reaction("start")
    weight = cable.mu * cable.length * np.asarray(run.scene.gravity)
    return float(np.abs(force + weight).max() / np.linalg.norm(weight))


def is_taut(run: Run) -> float:
    """tension, relative to EA (gap / L - 1)"""
    cable = run.scene.cable
    start, end = (run.simulator.end_pose(name)[0] for name in ("start", "end"))
    force, _ = run.simulator.reaction("end")
    stretch = float(np.linalg.norm(end - start)) / cable.length - 1.0
    return _off(float(np.linalg.norm(force)), cable.EA * stretch)


def keeps_momentum(run: Run) -> float:
    """momentum against the pulses, and angular momentum over another second, relative"""
    momentum, angular = analytic.momenta(run.simulator)
    impulse = PULSE * np.sum(list(PULSES.values()), axis=0)
    run.simulator.advance(1.0)
    _, later = analytic.momenta(run.simulator)
    return max(_off(momentum, impulse), _off(later, angular))


def carries_impulse(run: Run) -> float:
    """momentum, relative to the impulse"""
    momentum, _ = analytic.momenta(run.simulator)
    return _off(momentum, np.array([0.0, 0.0, BIG_PULSE[0] * BIG_PULSE[1]]))


def turns_as_rod(run: Run) -> float:
    """moment, relative to GJ Theta / L; displacement off the axis, share of L"""
    cable = run.scene.cable
    _, moment = run.simulator.reaction("end")
    return max(_off(abs(moment[0]), cable.GJ * TURN / cable.length), _off_axis(run))


def stays_straight(run: Run) -> float:
    """displacement off the axis, share of L; energy balance"""
    return max(_off_axis(run), run.energy_error)


def amplifies_as_column(run: Run) -> float:
    """buckling load, relative to EI pi^2 / L^2

    From the sag of the column, which the load amplifies to w0 / (1 - P / Pc).
    """
    scene, cable = run.scene, run.scene.cable
    side = scene.load("side").force[2]
    first_mode = 2.0 * side * cable.length**3 / (np.pi**4 * cable.EI)
    sag = run.simulator.centerline([0.5 * cable.length])[0, 2]
    buckling = abs(scene.load("press").force[0]) / (1.0 - first_mode / sag)
    return _off(buckling, analytic.euler_load(scene))


def buckles_as_elastica(run: Run) -> float:
    """distance of the ends, against the elastica, share of L"""
    length = run.scene.cable.length
    share = abs(run.scene.load("press").force[0]) / analytic.euler_load(run.scene)
    first, last = run.simulator.centerline([0.0, length])[:, 0]
    return float(abs((last - first) / length - analytic.elastica_gap(share)))


def closes_ring(run: Run) -> float:
    """distance of the ends, share of L"""
    points = run.simulator.control_points
    return float(np.linalg.norm(points[-1, :3] - points[0, :3]) / run.scene.cable.length)


def mirrors(run: Run) -> float:
    """asymmetry, share of L; energy balance"""
    shape = _shape(run.simulator)
    mirrored = shape[::-1] * np.array([-1.0, 1.0, 1.0])
    middle = np.array([shape[0, 0] + shape[-1, 0], 0.0, 0.0])
    gap = np.abs(shape - mirrored - middle).max() / run.scene.cable.length
    return float(max(gap, run.energy_error))


def rests_as_undamped(run: Run) -> float:
    """distance from the undamped equilibrium, share of L"""
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
    return analytic.string_deflection(force, cable.EA, cable.length, cable.EI)


def _off_axis(run: Run) -> float:
    """Largest distance of control points from the x axis, share of L."""
    points = run.simulator.control_points
    return float(np.abs(points[:, 1:3]).max() / run.scene.cable.length)


def _off(found: ArrayLike, expected: ArrayLike) -> float:
    """Relative difference of two numbers or vectors."""
    gap = np.linalg.norm(np.subtract(found, expected))
    return float(gap / np.linalg.norm(np.asarray(expected)))
