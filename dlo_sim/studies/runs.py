"""Runs of the studies: scenes with a method and a step, recorded, compared and timed (after a
warm-up, repeated, the minimum with its spread). What runs without a setting of `tuning` runs here.
"""

from __future__ import annotations

import time
from collections.abc import Callable, Hashable, Iterable
from functools import partial
from typing import NamedTuple, TypeVar

import numpy as np
from numpy.typing import ArrayLike, NDArray

from dlo_sim.batch.workers import Workers
from dlo_sim.core.end_motion import EndMotion
from dlo_sim.scene.description import Scene
from dlo_sim.simulation.recording import Recording, record
from dlo_sim.simulation.simulator import Simulator

Array = NDArray[np.float64]
Case = TypeVar("Case", bound=tuple[Hashable, ...])
Result = TypeVar("Result")


def at_method(scene: Scene, method: str, step: float = 0.0) -> Scene:
    """The scene with this method and step [s]; 0 = the step that the method chooses."""
    return scene.with_values({"integrator.method": method, "integrator.step": step})


def each(
    workers: Workers, function: Callable[..., Result], cases: Iterable[Case]
) -> dict[Case, Result]:
    """Case -> result of a module-level function for it, computed by workers; not for timing. A case
    is the hashable tuple of the arguments of one call, as from `product(methods, steps)`.
    """
    asked = list(dict.fromkeys(cases))
    return dict(zip(asked, workers.map(partial(_called, function), asked), strict=True))


def _called(function: Callable[..., Result], case: tuple[Hashable, ...]) -> Result:
    return function(*case)


def run(scene: Scene, duration: float, every: float, whole: bool = True) -> Recording:
    """Record a run; its errors are known from finer runs, not estimated.

    Raises:
        RuntimeError: it must be whole and failed, with the simulator's message.
    """
    recording = record(scene.with_values({"accuracy.estimate": "off"}), duration, every)
    if whole and not recording.ok:
        raise RuntimeError(f"a run of the study failed: {recording.message}")
    return recording


def reaches(scene: Scene, duration: float) -> bool:
    """Whether a run gets to its end [s], whatever its step."""
    return Simulator(scene, unchecked_step=True).advance(duration).status.advanced


class Timed(Simulator):
    """A simulator that adds up the processor time of its steps, `seconds` [s]."""

    seconds = 0.0

    def run(self, duration: float) -> None:
        """Advance by a duration [s].

        Raises:
            RuntimeError: a step failed.
        """
        began = time.process_time()
        report = self.advance(duration)
        self.seconds += time.process_time() - began
        if not report.status.ok:
            raise RuntimeError(f"a run of the study failed: {report.message}")

    def move(
        self, name: str, duration: float, velocity: ArrayLike, turning: ArrayLike = (0.0,) * 3
    ) -> None:
        """Let an end or an obstacle move from now on, with these velocities [m/s], [rad/s]."""
        rests = EndMotion.resting(*self.end_pose(name), self.time)
        self.set_motion(name, rests.then(duration, velocity=velocity, angular_velocity=turning))


def distance(one: Recording, other: Recording) -> Array:
    """Largest distance [m] between two centerlines over time, shape (T,)."""
    count = min(len(one.time), len(other.time))
    gap = one.centerline[:count] - other.centerline[:count]
    return np.asarray(np.linalg.norm(gap, axis=2).max(axis=1))


def bisected(fine: Callable[[float], bool], low: float, high: float, tolerance: float) -> float:
    """Largest value with `fine(value)`, by bisection to a relative tolerance, between a positive
    `low` for which it holds and `high` for which it does not.
    """
    while high / low > 1.0 + tolerance:
        middle = float(np.sqrt(low * high))
        low, high = (middle, high) if fine(middle) else (low, middle)
    return low


class Cost(NamedTuple):
    """Time of one step [s]: the least of the repeats, and (median - least) / least [-]."""

    best: float
    spread: float


def step_cost(simulator: Simulator, seconds: float = 0.003, repeats: int = 40) -> Cost:
    """Cost of a step of a simulator, which is reset before and after, timed in pieces of about
    `seconds` [s]: on a busy machine some of many short pieces run undisturbed.

    Raises:
        RuntimeError: a step failed.
    """

    def piece(steps: int) -> float:
        simulator.reset()
        return advance(simulator, steps) / steps

    piece(64)
    steps = max(64, int(seconds / piece(64)))
    times = sorted(piece(steps) for _ in range(repeats))
    simulator.reset()
    return Cost(times[0], times[repeats // 2] / times[0] - 1.0)


def least(work: Callable[[], object], repeats: int) -> float:
    """Least time [s] of a function, after a call to warm up."""
    times = []
    for _ in range(repeats + 1):
        began = time.perf_counter()
        work()
        times.append(time.perf_counter() - began)
    return min(times[1:])


def advance(simulator: Simulator, steps: int) -> float:
    """Time that steps take [s].

    Raises:
        RuntimeError: one failed.
    """
    began = time.perf_counter()
    report = simulator.advance_steps(steps)
    took = time.perf_counter() - began
    if not report.status.advanced:
        raise RuntimeError(f"timing a run that failed: {report.message}")
    return took
