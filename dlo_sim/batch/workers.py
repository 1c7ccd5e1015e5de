"""Independent pieces of work, in this process, in processes of this machine, or on a Dask cluster.

The pieces are calls of one importable function. Their results come back in the order of the items
and do not depend on which process computed them.
"""

from __future__ import annotations

import importlib.util
import multiprocessing
from collections.abc import Callable, Iterator, Sequence
from concurrent.futures import ProcessPoolExecutor
from concurrent.futures.process import BrokenProcessPool
from contextlib import contextmanager
from dataclasses import dataclass
from functools import partial
from multiprocessing.process import BaseProcess
from typing import Any, TypeVar

from dlo_sim.process.children import children, processors
from dlo_sim.process.stopping import cleanup
from dlo_sim.scene.refusal import Refusal

Item = TypeVar("Item")
Result = TypeVar("Result")
CONNECT_TIMEOUT = 10.0  # [s] until a scheduler that does not answer counts as absent


class WorkersError(Refusal):
    """Workers that cannot be had: one line that names the address and the cure."""


class WorkerLost(Exception):
    """A process of this machine was lost before its work was done: one line with the cure."""


@dataclass(frozen=True)
class Workers:
    """Does independent pieces of work.

    Attributes:
        count: how many pieces at a time. mapped: what `map` calls.
    """

    count: int
    mapped: Callable[..., Iterator[Any]]

    def map(self, function: Callable[[Item], Result], items: Sequence[Item]) -> Iterator[Result]:
        """Results of `function` on each item, in their order; yields each as soon as it can.

        The function and the items must be picklable: a function of a module, plain data.

        Raises:
            WorkerLost: a process was killed, by somebody or by the system for want of memory.
        """
        with _named_loss():  # where work is handed out, and in `_watched` where results are taken
            return _watched(self.mapped(function, items))


HERE = Workers(1, map)
"""This process, one piece after the other: what is timed belongs here."""


@contextmanager
def open_workers(scheduler: str | None = None, processes: int | None = None) -> Iterator[Workers]:
    """Workers for the duration of a `with` block.

    Args:
        scheduler: address of a Dask scheduler such as tcp://host:8786; None = this machine.
        processes: on this machine; None = one per core, 1 = this process itself.

    Raises:
        WorkersError: no Dask, or nobody at the address.
    """
    if scheduler is not None:
        client = _connected(scheduler)
        try:
            yield Workers(max(sum(client.nthreads().values()), 1), partial(_on_cluster, client))
        finally:
            client.close()
        return
    count = processes or processors()
    if count == 1:
        yield HERE
        return
    others = {*multiprocessing.active_children()}
    pool = ProcessPoolExecutor(count, children())
    with cleanup(lambda: _end(pool, others)):
        yield Workers(count, pool.map)
        pool.shutdown()
        others |= {*multiprocessing.active_children()}  # the pool's have ended


def _watched(results: Iterator[Result]) -> Iterator[Result]:
    with _named_loss():
        yield from results


@contextmanager
def _named_loss() -> Iterator[None]:
    """Turn the loss of a process into one line with the cure."""
    try:
        yield
    except BrokenProcessPool:
        raise WorkerLost(
            "a worker process was killed or ran out of memory before its work was done; free "
            "memory and run again"
        ) from None


def _on_cluster(
    client: Any, function: Callable[[Item], Result], items: Sequence[Item]
) -> Iterator[Result]:
    """Results from a Dask cluster; `dlo_sim` must be installed on its workers."""
    # pure=False: two equal items are two pieces of work, as they are here.
    futures = client.map(function, list(items), pure=False)
    return (future.result() for future in futures)


def _end(pool: ProcessPoolExecutor, others: set[BaseProcess]) -> None:
    """End the processes of a pool, whatever they do: all children of this one but `others`."""
    pool.shutdown(wait=False, cancel_futures=True)
    for child in {*multiprocessing.active_children()} - others:
        child.terminate()


def _connected(scheduler: str) -> Any:
    if importlib.util.find_spec("distributed") is None:
        raise WorkersError(
            f"--scheduler {scheduler} needs Dask; install dlo_sim with the extra 'dask'"
        )
    import distributed

    try:
        return distributed.Client(scheduler, timeout=CONNECT_TIMEOUT)
    except (OSError, ValueError, TimeoutError) as error:
        raise WorkersError(
            f"no Dask scheduler at {scheduler} ({type(error).__name__}); "
            "start one with 'dask scheduler' or correct the address"
        ) from None
