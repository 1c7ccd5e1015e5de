"""Running an extreme scene: what is done to it while it runs, and the judgement of what came out.

A scene has a truth from outside the simulator where there is one (a catenary, a buckling load, an
impulse), and the balance of energy everywhere.
"""

from __future__ import annotations

import time
from collections.abc import Callable
from dataclasses import dataclass, field
from typing import Any

import numpy as np
from numpy.typing import NDArray

from dlo_sim.core.end_motion import EndMotion
from dlo_sim.scene.loading import SceneError, scene_from_values
from dlo_sim.simulation.simulator import Simulator

Array = NDArray[np.float64]
Values = dict[str, Any]

RAN, REFUSED, STOPPED = "ran", "refused", "stopped"
PIECES = 50  # calls of the stepping loop per run, so that a budget of time can end it


@dataclass(frozen=True)
class Event:
    """Something that happens at a time [s].

    Attributes:
        what: `load` (force [N] on load `who`), `jump` (displacement [m] of end `who`), `turn` (its
            new orientation as a rotation vector [rad]), `move` (it moves at a velocity [m/s] for a
            time [s]: four numbers), `reconfigure` (scene changes).
    """

    time: float
    what: str
    who: str = ""
    numbers: tuple[float, ...] = ()
    changes: Values = field(default_factory=dict)


@dataclass
class Run:
    """A run in progress and what it left behind.

    Attributes:
        simulator: the present one; first: control points at the start, shape (n, 4).
        energy_error: largest so far, over all simulators of the run.
        steps, iterations: done in all. wall: time of stepping [s].
    """

    simulator: Simulator
    first: Array
    energy_error: float = 0.0
    steps: int = 0
    iterations: int = 0
    wall: float = 0.0
    message: str = ""


@dataclass(frozen=True)
class Extreme:
    """One extreme scene.

    Attributes:
        what: for people. values: of the scene. duration [s].
        check: the error of a finished run, and what it is the error of.
        bound: largest error that counts as right. events: in order of time.
        budget: most time of stepping [s]; longer is stopped, and never right.
    """

    name: str
    what: str
    values: Values
    duration: float
    check: Callable[[Run], float]
    measure: str
    bound: float
    events: tuple[Event, ...] = ()
    budget: float = 30.0


@dataclass(frozen=True)
class Finding:
    """What became of an extreme scene; `error` is None unless it ran to its end.

    wall: time of stepping [s], budget: what it may be. right: it ran, and error and time are what
    they should be.
    """

    name: str
    what: str
    outcome: str
    reason: str
    error: float | None
    measure: str
    bound: float
    energy_error: float | None
    method: str
    step: float
    simulated: float
    steps: int
    iterations: int
    wall: float
    budget: float
    right: bool


def examine(extreme: Extreme, share: float = 1.0) -> Finding:
    """Run a scene (or the first `share` of it) and judge it."""
    try:
        simulator = Simulator(scene_from_values(extreme.values))
    except SceneError as refusal:
        return _finding(extreme, REFUSED, str(refusal), None, None)
    run = Run(simulator, simulator.control_points)
    last = extreme.duration * share
    for event in (*extreme.events, Event(last, "end")):
        if not _advance_to(run, min(event.time, last), extreme.budget):
            return _finding(extreme, STOPPED, run.message, None, run)
        if event.time < last:
            try:
                _apply(run, event)
            except SceneError as refusal:
                return _finding(extreme, REFUSED, str(refusal), None, run)
    return _finding(extreme, RAN, "", float(extreme.check(run)), run)


def _finding(
    extreme: Extreme, outcome: str, reason: str, error: float | None, run: Run | None
) -> Finding:
    right = False
    if outcome == RAN and run is not None and error is not None:
        right = bool(np.isfinite(run.simulator.control_points).all())
        right = right and run.wall <= extreme.budget and error <= extreme.bound
    return Finding(
        name=extreme.name,
        what=extreme.what,
        outcome=outcome,
        reason=reason,
        error=error,
        measure=extreme.measure,
        bound=extreme.bound,
        energy_error=run.energy_error if run and run.steps else None,
        method=run.simulator.method if run else "-",
        step=run.simulator.step if run else 0.0,
        simulated=run.simulator.time if run else 0.0,
        steps=run.steps if run else 0,
        iterations=run.iterations if run else 0,
        wall=run.wall if run else 0.0,
        budget=extreme.budget,
        right=right,
    )


def _advance_to(run: Run, until: float, budget: float) -> bool:
    """Whole steps up to a time of the present simulator [s]; whether they were done."""
    simulator = run.simulator
    target = round(until / simulator.step)
    piece = max((target - simulator.steps) // PIECES, 1)
    while simulator.steps < target:
        began = time.perf_counter()
        report = simulator.advance_steps(min(piece, target - simulator.steps))
        run.wall += time.perf_counter() - began
        run.steps += report.steps
        run.iterations += report.force_evaluations
        run.energy_error = max(run.energy_error, simulator.energy_error)
        run.message = report.message
        if report.status.ok and run.wall > budget and simulator.steps < target:
            run.message = f"its budget of {budget:g} s was used up at {simulator.time:.6g} s"
            return False
        if not report.status.ok:
            return False
    return True


def _apply(run: Run, event: Event) -> None:
    simulator = run.simulator
    if event.what == "load":
        simulator.set_load(event.who, force=event.numbers)
    elif event.what == "jump":
        position, _ = simulator.end_pose(event.who)
        simulator.set_end(event.who, position=position + np.array(event.numbers))
    elif event.what == "move":
        position, orientation = simulator.end_pose(event.who)
        path = np.array([position, event.numbers[:3], np.zeros(3)])
        motion = EndMotion(simulator.time, event.numbers[3], path, orientation, np.zeros((2, 3)))
        simulator.set_motion(event.who, motion)
    elif event.what == "turn":
        half = 0.5 * np.array(event.numbers)
        size = float(np.linalg.norm(half))
        simulator.set_end(
            event.who, orientation=np.append(np.sin(size) / size * half, np.cos(size))
        )
    elif event.what == "reconfigure":
        before = simulator.control_points
        run.simulator = simulator.reconfigured(simulator.scene.with_values(event.changes))
        if not np.array_equal(before, run.simulator.control_points):
            raise RuntimeError("reconfiguring changed the shape")
