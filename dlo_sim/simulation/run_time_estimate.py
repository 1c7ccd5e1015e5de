"""An estimate of the run time, and of a faster alternative."""

from __future__ import annotations

from dlo_sim.simulation.selection import less_work
from dlo_sim.simulation.simulator import Simulator

LONG = 5.0  # [s]: remaining time from which the estimate is shown

_UNITS = (("days", 86400.0), ("h", 3600.0), ("min", 60.0), ("s", 1.0))
_SMALL = (("s", 1.0), ("ms", 1e-3), ("us", 1e-6), ("ns", 1e-9))


def run_time_estimate(simulator: Simulator, steps: int, seconds: float) -> str:
    """One line: the number of steps, their approximate time, and a method with less work if any.

    Args:
        steps: of the whole run. seconds: approximate time that is left.
    """
    line = f"{steps} steps of {_shown(simulator.step, _SMALL)}, about {_shown(seconds, _UNITS)}"
    other = less_work(simulator.scene, simulator.choice)
    if other is None:
        return line
    fewer = max(round(steps * simulator.step / other.step), 1)
    return (
        f"{line}; {other.method.name} would take {fewer} steps of {_shown(other.step, _SMALL)} "
        "(--set integrator.method=auto --set integrator.step=0)"
    )


def _shown(seconds: float, units: tuple[tuple[str, float], ...]) -> str:
    """A time in the largest unit that does not exceed it."""
    name, size = next((unit for unit in units if seconds >= unit[1]), units[-1])
    return f"{seconds / size:.3g} {name}"
