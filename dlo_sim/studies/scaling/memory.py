"""Resident memory during many steps, and what a step allocates."""

from __future__ import annotations

import gc
import os
import sys
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from dlo_sim.simulation.simulator import Simulator
from dlo_sim.studies.plotting import Panel, chart
from dlo_sim.studies.report import Report, columns
from dlo_sim.studies.scaling.steps import moving

SIZE = 9  # control points
STEPS = {
    True: {"forest_ruth": 1_000_000, "energy_momentum": 100_000},
    False: {"forest_ruth": 10_000_000, "energy_momentum": 2_000_000},
}
LOOKS = 100
WARM = 10  # of the looks
CALLS = 2000
ROUNDS, WARM_ROUNDS = 7, 5


@dataclass(frozen=True)
class Growth:
    """Memory of one run.

    Attributes:
        steps: at every look; resident: bytes [B] at every look.
        blocks: Python's allocated blocks that `CALLS` calls of one step left behind.
    """

    method: str
    steps: NDArray[np.int64]
    resident: NDArray[np.int64]
    blocks: int

    @property
    def after_warm_up(self) -> int:
        """Resident bytes at the end beyond those after the first `WARM` looks."""
        return int(self.resident[-1] - self.resident[WARM])

    @property
    def largest(self) -> int:
        """Most resident bytes after the warm-up beyond those at its end."""
        return int(self.resident[WARM:].max() - self.resident[WARM])


def resident_bytes() -> int:
    """Resident memory of this process [B], in whole pages (Linux).

    Raises:
        OSError: the system has no /proc.
    """
    pages = Path("/proc/self/statm").read_text(encoding="ascii").split()[1]
    return int(pages) * os.sysconf("SC_PAGE_SIZE")


def watched(
    simulator: Simulator, steps: int, looks: int = LOOKS
) -> tuple[NDArray[np.int64], NDArray[np.int64]]:
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
        _advance(simulator, steps // looks)
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
            _advance(simulator, steps)
        gc.collect()
        counts[k] = sys.getallocatedblocks()
    return int(np.median(np.diff(counts[WARM_ROUNDS - 1 :])))


def _advance(simulator: Simulator, steps: int) -> None:
    report = simulator.advance_steps(steps)
    if not report.status.ok:
        raise RuntimeError(f"watching a run that failed: {report.message}")


def measured(quick: bool, progress: Callable[[float], None]) -> list[Growth]:
    """One run of each method."""
    found = []
    for k, (method, steps) in enumerate(STEPS[quick].items()):
        simulator = moving(SIZE, method)
        done, resident = watched(simulator, steps)
        found.append(Growth(method, done, resident, blocks_left(simulator, CALLS)))
        progress((k + 1) / len(STEPS[quick]))
    return found


def describe(report: Report, found: list[Growth]) -> dict[str, str]:
    """Section, table and figure; returns the verdicts."""
    report.section("Memory over many steps")
    report.text(
        """Resident memory of the process (9 control points), looked at a hundred times in a run;
        the first ten looks are the warm-up. Its resolution is a page, and the interpreter's own
        pages are in it. Separately, the blocks of Python's allocator that two thousand calls of one
        step each leave behind. A call makes its report and one test for finite numbers, which are
        released."""
    )
    report.table(
        "memory",
        "method | steps | resident after warm-up [KB] | growth after it [B] | most above it [B] | "
        "blocks left by calls",
        [
            [
                *(one.method, int(one.steps[-1]), int(one.resident[WARM]), one.after_warm_up),
                *(one.largest, one.blocks),
            ]
            for one in found
        ],
        "Memory: growth over a run, and what calls leave behind",
    )
    rows = [
        (one.method, step / one.steps[-1], (bytes_now - one.resident[WARM]) / 1024.0)
        for one in found
        for step, bytes_now in zip(one.steps, one.resident, strict=True)
    ]
    looks = {one.method: {"linewidth": 4.0 / (k + 1)} for k, one in enumerate(found)}
    panel = Panel(
        "share of the run's steps",
        "resident memory, change [KiB]",
        ["change [KiB]"],
        by="method",
        looks=looks,  # equal lines stay visible below each other
        levels={"one page": os.sysconf("SC_PAGE_SIZE") / 1024.0},
        uprights={"end of warm-up": WARM / LOOKS},
    )
    chart(
        report,
        "resident_memory",
        columns(("method", "share of the run's steps", "change [KiB]"), rows),
        [panel],
        "Resident memory against that after the warm-up",
        (8.5, 3.8),
    )
    return {
        f"memory, {one.method}": (
            f"{one.after_warm_up} bytes more after {one.steps[-1]:.3g} steps than after "
            f"{one.steps[WARM]:.3g}; {CALLS} calls leave {one.blocks} blocks"
        )
        for one in found
    }
