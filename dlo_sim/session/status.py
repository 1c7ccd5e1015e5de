"""What a session says about itself after a tick."""

from __future__ import annotations

from enum import Enum
from typing import NamedTuple


class SessionStatus(Enum):
    """What a session is doing; the values are readable."""

    WAITING = "waiting for the first pose"
    RUNNING = "running"
    PAUSED = "paused"
    FAILED = "failed: the last good state is held, call ~/reset"


class TickReport(NamedTuple):
    """What a tick did.

    Attributes:
        advanced_steps: steps taken.
        lag_ns: how far the state is behind the time it should have [ns]: missing poses, or too slow
            a computer.
        status: what the session is doing.
        message: one line when there is something to say (why it failed, what it waits for), else
            "".
        stop: the simulator failed and `integrator.on_failure` is `stop`.
    """

    advanced_steps: int
    lag_ns: int
    status: SessionStatus
    message: str = ""
    stop: bool = False
