"""Many independent computations: who does them, and many cables at once.

The public names are in `__all__`; importing the room loads no compiler.
"""

from importlib import import_module
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from dlo_sim.batch.batch import BatchResult, simulate_batch
    from dlo_sim.batch.forecasts import forecast_batch

__all__ = ["BatchResult", "forecast_batch", "simulate_batch"]


def __getattr__(name: str) -> Any:
    """A public name, loaded when first asked for."""
    if name not in __all__:
        raise AttributeError(f"module 'dlo_sim.batch' has no attribute '{name}'")
    home = "forecasts" if name == "forecast_batch" else "batch"
    return getattr(import_module(f"dlo_sim.batch.{home}"), name)
