"""Simulation and prediction of cables, for ROS 2.

`load_scene` reads a scene, `Simulator` steps it, `EndMotion` is how its ends move, `Plan` how they
will, `Forecast` what comes of it; all are imported when first used, so that importing the package
needs neither ROS nor a compiler.
"""

from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from dlo_sim.core.end_motion import EndMotion as EndMotion
    from dlo_sim.scene.loading import SceneError as SceneError
    from dlo_sim.scene.loading import load_scene as load_scene
    from dlo_sim.simulation.forecast import Forecast as Forecast
    from dlo_sim.simulation.forecast import Plan as Plan
    from dlo_sim.simulation.simulator import Simulator as Simulator

__version__ = "0.1.0"

__all__ = [
    "EndMotion",
    "Forecast",
    "Obstacle",
    "Plan",
    "SceneError",
    "Simulator",
    "__version__",
    "load_scene",
]

_HOMES = {
    "EndMotion": "dlo_sim.core.end_motion",
    "Forecast": "dlo_sim.simulation.forecast",
    "Obstacle": "dlo_sim.scene.description",
    "Plan": "dlo_sim.simulation.forecast",
    "SceneError": "dlo_sim.scene.loading",
    "Simulator": "dlo_sim.simulation.simulator",
    "load_scene": "dlo_sim.scene.loading",
}


def __getattr__(name: str) -> Any:
    """Import a public name from its room when it is first asked for (PEP 562)."""
    if name not in _HOMES:
        raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
    from importlib import import_module

    value = getattr(import_module(_HOMES[name]), name)
    globals()[name] = value
    return value


def __dir__() -> list[str]:
    """The public names, also those not imported yet."""
    return sorted({*globals(), *__all__})
