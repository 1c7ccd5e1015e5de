"""A scene: what it computes, its step, and whether this machine keeps up with it."""

from __future__ import annotations

import math
import time
from collections.abc import Iterator

from dlo_sim.doctor.finding import Finding, note, ok, problem
from dlo_sim.scene.refusal import SceneError
from dlo_sim.simulation.simulator import Simulator

_TICKS = 100  # for which the time of a step is measured
_COMFORTABLE = 0.5  # share of a timer period that steps may take


def findings(simulator: Simulator) -> Iterator[Finding]:
    """What is to be known of a simulator that has been built, without messages."""
    left_out = "; ".join(f"{name} ({why})" for name, why in simulator.left_out.items())
    computed = ", ".join(simulator.active_terms)
    yield ok(f"active terms: {computed}; inactive: {left_out or 'none'}")
    choice = simulator.choice
    limit = "no stability limit"
    if math.isfinite(choice.limit):
        limit = f"{choice.step / choice.limit:.0%} of the stability limit {choice.limit:.3g} s"
    yield ok(f"{simulator.method}, step {choice.step:.3g} s ({choice.reason}); {limit}")
    yield ok(simulator.resolution)
    for line in simulator.scene.cable.assumptions:
        yield ok(line)
    for line in simulator.warnings:
        yield note(line)
    yield keeping_up(simulator.scene.rate, measured_load(simulator))


def measured_load(simulator: Simulator) -> float:
    """Time that steps take as a share of the time they simulate, without forces or motion.

    Raises:
        SceneError: a step fails.
    """
    steps = max(1, round(1.0 / (simulator.scene.rate * simulator.step)))
    took = []
    for _ in range(_TICKS):
        begin = time.perf_counter()
        report = simulator.advance_steps(steps)
        if not report.status.advanced:
            raise SceneError(report.message)
        took.append(time.perf_counter() - begin)
    return sorted(took)[_TICKS // 2] / (steps * simulator.step)


def keeping_up(rate: float, load: float) -> Finding:
    """Whether steps fit into the timer's periods.

    Args:
        rate: of the timer [Hz]. load: from `measured_load`.
    """
    what = f"steps take {load:.0%} of a timer period ({1e3 / rate:.3g} ms at rate {rate:g} Hz)"
    if load < _COMFORTABLE:
        return ok(what)
    cure = "lower discretization.control_points, or try dlo_sim tune"
    if load < 1.0:
        return note(f"{what}; there may be no time for the error estimate", cure)
    return problem(f"{what}; the node cannot keep up", cure)
