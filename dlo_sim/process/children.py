"""Processes that work for this one."""

from __future__ import annotations

import multiprocessing
import os
import signal
import threading
from multiprocessing import resource_tracker
from multiprocessing.context import SpawnContext, SpawnProcess
from multiprocessing.process import BaseProcess

from dlo_sim.process import beginning

# A terminal sends them to all of its processes; this one ends its children.
_OF_A_TERMINAL = signal.SIGINT, signal.SIGHUP


class _Child(SpawnProcess):
    """A process that never sees the signals of a terminal, not even while it starts. It prints
    warnings as this one does, and ends with this one, however that ends.
    """

    def start(self) -> None:
        """Start it; what is blocked in this thread stays as it was."""
        self._lines = beginning.uses_lines()
        before = signal.pthread_sigmask(signal.SIG_BLOCK, _OF_A_TERMINAL)
        try:
            # When it starts its own process, it unblocks SIGINT in this thread.
            resource_tracker.ensure_running()
            signal.pthread_sigmask(signal.SIG_BLOCK, _OF_A_TERMINAL)
            super().start()
        finally:
            signal.pthread_sigmask(signal.SIG_SETMASK, before)

    def run(self) -> None:
        """Do its work; called in the new process."""
        beginning.use_lines(self._lines)
        parent = multiprocessing.parent_process()
        if parent is not None:
            threading.Thread(target=_end_with, args=(parent,), daemon=True).start()
        super().run()


def _end_with(parent: BaseProcess) -> None:
    """End this process when its parent has ended: a worker of a pool would wait for ever."""
    parent.join()
    os._exit(1)


class _Children(SpawnContext):
    Process = _Child


def children() -> SpawnContext:
    """The context of multiprocessing for every process that this package starts.

    They are not forked: threads of this process (numba's, ROS's) would not survive that.
    """
    return _Children()


def processors() -> int:
    """Number of logical cores that this process may use."""
    if hasattr(os, "sched_getaffinity"):  # not on every platform
        return len(os.sched_getaffinity(0))
    return os.cpu_count() or 1
