"""A run of another simulator."""

from __future__ import annotations

from dataclasses import dataclass


@dataclass(frozen=True)
class PeerRun:
    """What another simulator gave on a case.

    Attributes:
        peer: name and version. setting: its resolution and step, for people.
        wall: least run time of the repeats [s per simulated s]. spread: as for trials.
        error: as a share of the case's scale; nan if it was not measured.
        message: empty, or why there is no result.
    """

    peer: str
    setting: str
    wall: float
    spread: float
    error: float
    message: str = ""

    @property
    def ok(self) -> bool:
        """Whether there is a result."""
        return not self.message
