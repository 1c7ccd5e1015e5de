"""What a replay did, as data: for people, for JSON, for the comparison with a recording."""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

from dlo_sim.replay.comparison import AxisComparison

Array = NDArray[np.float64]


@dataclass
class ReplayFigures:
    """How a replay ended, and its numbers.

    Attributes:
        status: `done`; `truncated`: the bag is damaged, what could be read was used; `diverged`:
            the simulator gave up; `refused`: more than 5 % of the messages of a topic could not be
            used; `unresolved`: at some time the shape was no cable's; `output_incomplete`: the
            disk was full, the output holds what was written until then.
        message: one line that explains any status but `done`, else "".
        messages_used, messages_written: input and output messages.
        simulated_s: simulated time [s]; wall_s: time for reading, stepping and writing [s] without
            building the simulator; compile_s: time for building it [s]; real_time_factor:
            simulated_s / wall_s.
    """

    status: str = "done"
    message: str = ""
    messages_used: int = 0
    messages_written: int = 0
    simulated_s: float = 0.0
    wall_s: float = 0.0
    compile_s: float = 0.0
    real_time_factor: float = 0.0

    @property
    def ok(self) -> bool:
        """Whether the whole bag was replayed, and used but for a few messages."""
        return self.status == "done"


@dataclass
class ReplaySummary(ReplayFigures):
    """What a replay did.

    Attributes:
        output: the bag written.
        messages_copied: input messages that came again, as from a second recorder; ignored.
        messages_refused: input messages; refused_by_reason: the same by reason; refused_by_topic:
            topic -> reason -> number.
        events: what else was counted (silences, resets, ...).
        ticks: ticks of the session.
        comparison: end -> rows per axis, for the ends asked for.
        warnings: one line each.
        resolution: how many control points, and why.
        error_estimate: largest estimated position errors [m]: `time`, `space`, `total` (None =
            unknown); None if errors were not estimated (accuracy.estimate).
        advice: the error if it exceeds accuracy.target, and what cures it, one line; else empty.
    """

    output: str = ""
    messages_copied: int = 0
    messages_refused: int = 0
    refused_by_reason: dict[str, int] = field(default_factory=dict)
    refused_by_topic: dict[str, dict[str, int]] = field(default_factory=dict)
    events: dict[str, int] = field(default_factory=dict)
    ticks: int = 0
    comparison: dict[str, list[AxisComparison]] = field(default_factory=dict)
    warnings: list[str] = field(default_factory=list)
    resolution: str = ""
    error_estimate: dict[str, float | None] | None = None
    advice: str = ""


class Recording:
    """Times and forces being collected."""

    def __init__(self, end: str) -> None:
        self.end = end
        self.frames: set[str] = set()
        self._times: list[int] = []
        self._forces: list[object] = []

    def add(self, stamp_ns: int, force: object) -> None:
        """Append a sample; one that is not newer than the last replaces nothing and is left out."""
        if not self._times or stamp_ns > self._times[-1]:
            self._times.append(stamp_ns)
            self._forces.append(force)

    def arrays(self) -> tuple[Array, Array]:
        """Times [s], shape (n,), and forces [N], shape (n, 3)."""
        return np.array(self._times, dtype=float) * 1e-9, np.array(
            self._forces, dtype=float
        ).reshape(-1, 3)
