"""Many independent computations on several processes or machines.

The public names are in `__all__`; importing the room loads no compiler.
"""

from importlib import import_module
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from dlo_sim.batch.batch import BatchResult, forecast_batch, simulate_batch

__all__ = ["BatchResult", "forecast_batch", "simulate_batch"]


def __getattr__(name: str) -> Any:
    """A public name, loaded when first asked for."""
    if name not in __all__:
        raise AttributeError(f"module 'dlo_sim.batch' has no attribute '{name}'")
    return getattr(import_module("dlo_sim.batch.batch"), name)
