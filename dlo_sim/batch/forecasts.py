"""Many plans for one cable at once: `forecast_batch`."""

from __future__ import annotations

from collections.abc import Sequence
from contextlib import nullcontext
from functools import partial

from dlo_sim.batch.workers import Workers, open_workers
from dlo_sim.simulation.forecast import EVERY, Forecast, Plan
from dlo_sim.simulation.simulator import Simulator

_TOGETHER = 16  # plans that a worker gets at a time


def forecast_batch(
    simulator: Simulator,
    plans: Sequence[Plan],
    every: float = EVERY,
    *,
    workers: Workers | None = None,
    processes: int | None = None,
    scheduler: str | None = None,
) -> list[Forecast]:
    """What `Simulator.forecast` gives for each plan, in their order.

    Args:
        workers, processes, scheduler: as of `simulate_batch`.

    Raises:
        TypeError, ValueError: as `Simulator.forecast`, with the number of the plan.
    """
    numbered = list(enumerate(plans))
    pieces = [numbered[k : k + _TOGETHER] for k in range(0, len(plans), _TOGETHER)]
    opened = open_workers(scheduler, processes) if workers is None else nullcontext(workers)
    with opened as crew:
        done = crew.map(partial(_forecasts, simulator, every), pieces)
        return [found for part in done for found in part]


def _forecasts(
    simulator: Simulator, every: float, plans: Sequence[tuple[int, Plan]]
) -> list[Forecast]:
    found = []
    for k, plan in plans:
        try:
            found.append(simulator.forecast(plan, every))
        except (TypeError, ValueError) as refusal:
            raise type(refusal)(f"plan {k}: {refusal}") from None
    return found
