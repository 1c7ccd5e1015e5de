"""Timing of steps: warm, repeated, the minimum with its spread."""

from __future__ import annotations

import time
from collections.abc import Callable
from dataclasses import dataclass

from dlo_sim.simulation.simulator import Simulator


@dataclass(frozen=True)
class Cost:
    """Time of one step [s]: the least of the repeats, and their median."""

    best: float
    median: float

    @property
    def spread(self) -> float:
        """(median - best) / best [-]."""
        return self.median / self.best - 1.0


def least(work: Callable[[], object], repeats: int, count: int = 1) -> Cost:
    """Time per thing of `work`, which does `count` things; called once before to warm up."""
    work()
    return _cost([seconds_of(work) / count for _ in range(repeats)])


def step_cost(simulator: Simulator, seconds: float = 0.003, repeats: int = 40) -> Cost:
    """Cost of a step of a simulator from its start, in pieces of about `seconds` [s].

    Short pieces: on a busy machine some of many short ones run undisturbed, of few long ones none.
    The simulator is reset before and after.

    Raises:
        RuntimeError: a step failed; a cost of steps that were not done means nothing.
    """

    def piece(steps: int) -> float:
        simulator.reset()
        began = time.perf_counter()
        report = simulator.advance_steps(steps)
        took = time.perf_counter() - began
        if not report.status.ok:
            raise RuntimeError(f"timing a run that failed: {report.message}")
        return took / steps

    piece(64)
    steps = max(64, int(seconds / piece(64)))
    times = [piece(steps) for _ in range(repeats)]
    simulator.reset()
    return _cost(times)


def seconds_of(work: Callable[[], object]) -> float:
    """Time that work takes [s]."""
    began = time.perf_counter()
    work()
    return time.perf_counter() - began


def _cost(times: list[float]) -> Cost:
    times.sort()
    return Cost(times[0], times[len(times) // 2])
