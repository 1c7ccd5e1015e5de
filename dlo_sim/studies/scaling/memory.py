"""Resident memory during many steps, and what a step allocates."""

from __future__ import annotations

import gc
import os
import sys
import tracemalloc
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from dlo_sim.simulation.simulator import Simulator
from dlo_sim.studies import plotting
from dlo_sim.studies.report import Report
from dlo_sim.studies.scaling.wire import moving

SIZE = 9  # control points
STEPS = {
    True: {"forest_ruth": 1_000_000, "energy_momentum": 100_000},
    False: {"forest_ruth": 10_000_000, "energy_momentum": 2_000_000},
}
LOOKS = 100
WARM = 10  # of the looks
CALLS = 2000
ROUNDS, WARM_ROUNDS = 7, 5
LONG_CALL = 20_000  # steps


@dataclass(frozen=True)
class Growth:
    """Memory of one run.

    Attributes:
        steps: at every look; resident: bytes [B] at every look. energy_error: of the run [-].
        blocks: Python's allocated blocks that `CALLS` calls of one step left behind.
        traced: bytes that they left behind. short_peak, long_peak: bytes in use above the start at
            the worst moment of a call of one step and of one of `LONG_CALL`.
    """

    method: str
    steps: NDArray[np.int64]
    resident: NDArray[np.int64]
    energy_error: float
    blocks: int
    traced: int
    short_peak: int
    long_peak: int

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


def bytes_left(simulator: Simulator, calls: int, steps: int = 1) -> int:
    """Traced bytes (Python's and numpy's) that so many calls of `advance_steps` leave behind."""
    tracemalloc.start()
    try:
        for _ in range(calls):
            _advance(simulator, steps)
        before = tracemalloc.get_traced_memory()[0]
        for _ in range(calls):
            _advance(simulator, steps)
        return tracemalloc.get_traced_memory()[0] - before
    finally:
        tracemalloc.stop()


def peak_of_a_call(simulator: Simulator, steps: int) -> int:
    """Most traced bytes in use during one call of `advance_steps` beyond those before it."""
    tracemalloc.start()
    try:
        _advance(simulator, steps)
        before = tracemalloc.get_traced_memory()[0]
        tracemalloc.reset_peak()
        _advance(simulator, steps)
        return tracemalloc.get_traced_memory()[1] - before
    finally:
        tracemalloc.stop()


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
        found.append(
            Growth(
                method,
                done,
                resident,
                simulator.energy_error,
                blocks_left(simulator, CALLS),
                bytes_left(simulator, CALLS),
                peak_of_a_call(simulator, 1),
                peak_of_a_call(simulator, LONG_CALL),
            )
        )
        progress((k + 1) / len(STEPS[quick]))
    return found


def describe(report: Report, found: list[Growth]) -> dict[str, str]:
    """Section, table and figure; returns the verdicts."""
    report.section("Memory over many steps")
    report.text(
        f"""Resident memory of the process ({SIZE} control points), looked at {LOOKS} times in a
        run; the first {WARM} looks are the warm-up. Pages are {os.sysconf("SC_PAGE_SIZE")} bytes,
        so this is its resolution, and the interpreter's own pages are in it. Separately, what
        {CALLS} calls of one step each leave behind: blocks of Python's allocator, and bytes traced
        (numpy's arrays included). A call makes its report and one test for finite numbers, which
        are released (one number may be held); what is in use at the worst moment of a call of
        {LONG_CALL} steps is what it is in a call of one step, but for some loop counters. A step
        itself allocates nothing, and cannot: kernels are compiled without numba's allocator
        (`_nrt`), where one that makes an array does not compile."""
    )
    report.table(
        "memory",
        [
            *("method", "steps", "resident after warm-up [MB]", "growth after warm-up [B]"),
            *("most above it [B]", "growth [B/step]", "blocks left by calls"),
            *("bytes left by calls", "peak of a 1-step call [B]"),
            *(f"peak of a {LONG_CALL}-step call [B]", "energy error [-]"),
        ],
        [
            [
                one.method,
                int(one.steps[-1]),
                1e-6 * float(one.resident[WARM]),
                one.after_warm_up,
                one.largest,
                one.after_warm_up / float(one.steps[-1] - one.steps[WARM]),
                one.blocks,
                one.traced,
                one.short_peak,
                one.long_peak,
                one.energy_error,
            ]
            for one in found
        ],
        "Memory: growth over a run, and what calls leave behind",
    )
    _figure(report, found)
    return {
        f"memory, {one.method}": (
            f"{one.after_warm_up} bytes more after {one.steps[-1]:.3g} steps than after "
            f"{one.steps[WARM]:.3g}; {CALLS} calls leave {one.blocks} blocks"
        )
        for one in found
    }


def _figure(report: Report, found: list[Growth]) -> None:
    figure, (axes,) = plotting.new_figure(height=3.6)
    for k, one in enumerate(found):
        change = (one.resident - one.resident[WARM]) / 1024.0
        axes.plot(
            one.steps / one.steps[-1],
            change,
            linewidth=5.0 / (k + 1) ** 1.5,  # equal lines stay visible below each other
            color=plotting.COLORS[one.method],
            label=f"{one.method}, {one.steps[-1]:.3g} steps",
        )
    axes.axvline(WARM / LOOKS, color="black", linestyle=":", label="end of warm-up")
    axes.set(xlabel="share of the run's steps [-]", ylabel="resident memory, change [KiB]")
    low, high = axes.get_ylim()
    axes.set_ylim(min(low, -64.0), max(high, 64.0))
    axes.grid(alpha=0.3)
    axes.legend(fontsize="small")
    report.figure(
        "resident_memory",
        figure,
        {
            "method": np.concatenate([np.repeat(one.method, len(one.steps)) for one in found]),
            "steps": np.concatenate([one.steps for one in found]),
            "resident [B]": np.concatenate([one.resident for one in found]),
        },
        "Resident memory against that after the warm-up",
    )
