"""Resident memory during many steps, and what a step allocates."""

from __future__ import annotations

import gc
import os
import sys
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from dlo_sim.core.methods import IMPLICIT, METHODS
from dlo_sim.simulation.simulator import Simulator
from dlo_sim.studies.plotting import Panel, chart
from dlo_sim.studies.report import Report, columns
from dlo_sim.studies.runs import advance, shipped

SCENE = "paper_wire"
SAMPLES_PER_SPAN = 3
IMPLICIT_STEP = 2e-3  # [s], the paper's
SPEED = 0.3  # [m/s] of mid-span, downwards, at the start
SIZE = 9  # control points
STEPS = {
    True: {"forest_ruth": 1_000_000, "energy_momentum": 100_000},
    False: {"forest_ruth": 10_000_000, "energy_momentum": 2_000_000},
}
LOOKS = 100
WARM = 10  # of the looks
CALLS = 2000
ROUNDS, WARM_ROUNDS = 7, 5
Counts = NDArray[np.int64]
Grown = tuple[str, Counts, Counts, int]  # method, steps and bytes [B] of the looks, blocks left


def moving(control_points: int, method: str) -> Simulator:
    """The straight wire, released with half a sine wave of downward velocity.

    Every method can start so, an inextensible one too, and each size has the same motion: a wire
    that starts at rest hardly moves in the short steps of a fine one, whose iterations would then
    have nothing to do. Explicit methods take the step chosen for them.

    Raises:
        SceneError: the method cannot hold the wire at this size.
    """
    wire = shipped(
        SCENE,
        discretization__control_points=control_points,
        discretization__quadrature="gauss",
        discretization__samples=SAMPLES_PER_SPAN,
        integrator__method=method,
        integrator__step=IMPLICIT_STEP if METHODS[method].family == IMPLICIT else 0.0,
    )
    simulator = Simulator(wire)
    rates = np.zeros((control_points, 4))
    phase = np.pi * simulator.greville / simulator.scene.cable.length
    rates[1:-1, 2] = -SPEED * np.sin(phase[1:-1])
    simulator.start_from(simulator.control_points, rates)
    return simulator


def resident_bytes() -> int:
    """Resident memory of this process [B], in whole pages (Linux).

    Raises:
        OSError: the system has no /proc.
    """
    pages = Path("/proc/self/statm").read_text(encoding="ascii").split()[1]
    return int(pages) * os.sysconf("SC_PAGE_SIZE")


def watched(simulator: Simulator, steps: int, looks: int = LOOKS) -> tuple[Counts, Counts]:
    """Resident memory [B] before the first step and at `looks` moments of a run: (steps, bytes).

    Raises:
        RuntimeError: a step failed.
    """
    done = np.zeros(looks + 1, dtype=np.int64)
    resident = np.zeros(looks + 1, dtype=np.int64)
    for _ in range(500):  # the first hundred readings take a few pages themselves
        resident_bytes()
    resident[0] = resident_bytes()
    for look in range(1, looks + 1):
        advance(simulator, steps // looks)
        done[look] = look * (steps // looks)
        resident[look] = resident_bytes()
    return done, resident


def blocks_left(simulator: Simulator, calls: int, steps: int = 1) -> int:
    """Python's allocated blocks that so many calls of `advance_steps` leave behind.

    The median of a few rounds: what a call leaves behind it leaves in every round, while other
    parts of the program (a progress bar, a late release) add or take something in a few. The first
    rounds, in which the interpreter fills its own stores, do not count.
    """
    counts = np.zeros(WARM_ROUNDS + ROUNDS, dtype=np.int64)  # holds no Python objects
    for k in range(len(counts)):
        for _ in range(calls):
            advance(simulator, steps)
        gc.collect()
        counts[k] = sys.getallocatedblocks()
    return int(np.median(np.diff(counts[WARM_ROUNDS - 1 :])))


def measured(quick: bool, progress: Callable[[float], None]) -> list[Grown]:
    """One run of each method."""
    found = []
    for k, (method, steps) in enumerate(STEPS[quick].items()):
        simulator = moving(SIZE, method)
        seen = watched(simulator, steps)
        found.append((method, *seen, blocks_left(simulator, CALLS)))
        progress((k + 1) / len(STEPS[quick]))
    return found


def describe(report: Report, found: list[Grown]) -> dict[str, str]:
    """Section, table and figure; returns the verdicts."""
    report.section("Memory over many steps")
    report.text(
        """Resident memory of the process (9 control points), looked at a hundred times in a run;
        the first ten looks are the warm-up. Its resolution is a page, and the interpreter's own
        pages are in it. Separately, the blocks of Python's allocator that two thousand calls of one
        step each leave behind. A call makes its report and one test for finite numbers, which are
        released."""
    )
    rows, curves, verdicts, looks = [], [], {}, {}
    for k, (method, steps, resident, blocks) in enumerate(found):
        beyond, last = (resident - resident[WARM]).tolist(), int(steps[-1])
        grown = beyond[-1]
        rows.append([method, last, int(resident[WARM]), grown, max(beyond[WARM:]), blocks])
        curves += [
            (method, done / last, more / 1024.0) for done, more in zip(steps, beyond, strict=True)
        ]
        looks[method] = {"linewidth": 4.0 / (k + 1)}  # equal lines stay visible below each other
        verdicts[f"memory, {method}"] = (
            f"{grown} bytes more after {last:.3g} steps than after {steps[WARM]:.3g}; {CALLS} "
            f"calls leave {blocks} blocks"
        )
    report.table(
        "memory",
        "method | steps | resident after warm-up [KB] | growth after it [B] | most above it [B] | "
        "blocks left by calls",
        rows,
        "Memory: growth over a run, and what calls leave behind",
    )
    share, change = "share of the run's steps", "change [KiB]"
    panel = Panel(share, f"resident memory, {change}", [change], by="method", looks=looks)
    page, warm = {"one page": os.sysconf("SC_PAGE_SIZE") / 1024.0}, {"end of warm-up": WARM / LOOKS}
    panel = replace(panel, levels=page, uprights=warm)
    data = columns(("method", share, change), curves)
    caption = "Resident memory against that after the warm-up"
    chart(report, "resident_memory", data, [panel], caption, (8.5, 3.8))
    return verdicts
