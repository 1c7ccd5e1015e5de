"""Many plans for one cable at once: `forecast_batch`."""

from __future__ import annotations

from collections.abc import Sequence
from contextlib import nullcontext
from dataclasses import dataclass

from dlo_sim.batch.workers import Workers, open_workers
from dlo_sim.simulation.forecast import EVERY, Forecast, Plan
from dlo_sim.simulation.simulator import Simulator

_TOGETHER = 16  # plans that a worker gets at a time


@dataclass(frozen=True)
class _Asked:
    """Plans for a cable; first: number of the first of them in the batch."""

    simulator: Simulator
    first: int
    plans: Sequence[Plan]
    every: float


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
    asked = [
        _Asked(simulator, k, plans[k : k + _TOGETHER], every)
        for k in range(0, len(plans), _TOGETHER)
    ]
    opened = open_workers(scheduler, processes) if workers is None else nullcontext(workers)
    with opened as crew:
        return [found for part in crew.map(_forecasts, asked) for found in part]


def _forecasts(asked: _Asked) -> list[Forecast]:
    found = []
    for k, plan in enumerate(asked.plans, asked.first):
        try:
            found.append(asked.simulator.forecast(plan, asked.every))
        except (TypeError, ValueError) as refusal:
            raise type(refusal)(f"plan {k}: {refusal}") from None
    return found
