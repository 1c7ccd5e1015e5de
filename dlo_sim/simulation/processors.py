"""How many processors there are to share work among."""

from __future__ import annotations

import os


def processors() -> int:
    """Logical cores that this process may use."""
    if hasattr(os, "sched_getaffinity"):  # not everywhere
        return len(os.sched_getaffinity(0))
    return os.cpu_count() or 1
