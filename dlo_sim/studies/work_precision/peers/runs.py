"""A run of another simulator."""

from __future__ import annotations

from dataclasses import dataclass


@dataclass(frozen=True)
class PeerRun:
    """What another simulator gave on a case.

    Attributes:
        peer: name and version. elements: its resolution. step: [s].
        wall: least run time of the repeats [s per simulated s], estimated where it was too slow to
            run to its end; infinite if it failed. spread: as for trials.
        error: as a share of the case's scale; nan if it was not measured.
        message: empty, or why there is no result.
    """

    peer: str
    elements: int
    step: float
    wall: float
    spread: float
    error: float
    message: str = ""

    @property
    def ok(self) -> bool:
        """Whether there is a result."""
        return not self.message

    @property
    def setting(self) -> str:
        """Resolution and step, for people."""
        return f"n {self.elements}, {1e3 * self.step:.3g} ms"

    @property
    def status(self) -> str:
        """`ok`, or why there is no result; fits a table's cell."""
        return self.message.replace("|", "/") or "ok"
