"""Many independent computations: who does them, and many cables at once.

`simulate_batch` and `BatchResult` are the public names; importing the room loads no compiler.
"""

from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from dlo_sim.batch.batch import BatchResult, simulate_batch

__all__ = ["BatchResult", "simulate_batch"]


def __getattr__(name: str) -> Any:
    """`simulate_batch` and `BatchResult`, loaded when first asked for."""
    if name in __all__:
        from dlo_sim.batch import batch

        return getattr(batch, name)
    raise AttributeError(f"module 'dlo_sim.batch' has no attribute '{name}'")
