"""Runs of extreme scenes with actions at given times, checked against an independent result if
there is one, or else the energy balance.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

import numpy as np

from dlo_sim.core.end_motion import EndMotion
from dlo_sim.scene.description import Scene
from dlo_sim.scene.loading import SceneError, scene_from_values
from dlo_sim.simulation.simulator import Simulator
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
        run.message = report.message
        if report.status.ok and run.wall > BUDGET and simulator.steps < target:
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
