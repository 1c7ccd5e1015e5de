"""What extreme scenes are put together from: materials, supports, loads. Scene keys, flat."""

from __future__ import annotations

from typing import Any

import numpy as np

from dlo_sim.studies.stability.extremes import Values

STIFF: Values = {
    "integrator.method": "energy_momentum",
    "discretization.control_points": 13,
    "terms.twist": "off",
}
FLAT: Values = {"gravity": [0.0, 0.0, 0.0]}
PLANE = STIFF | {"terms.out_of_plane": "off"}
SPACE = STIFF | {"terms.out_of_plane": "on"}
PINNED: Values = {"start.fixed": [True] * 3, "end.fixed": [True] * 3}
CANTILEVER: Values = {"start.clamped": True, "end.fixed": [False] * 3}
DAMPED: Values = {"damping.mass": 2.0, "damping.stiffness": 1e-3}
GUIDED: Values = {  # the paper's wire
    "start.fixed": [False, True, True],
    "end.fixed": [False, True, True],
    "start.spring": [1e4, 0.0, 0.0],
    "end.spring": [1e4, 0.0, 0.0],
    "end.position": [2.0, 0.0, 0.0],
    "initial.shape": "straight",
}
DRIVEN: Values = {"start.pose_topic": "/start", "end.pose_topic": "/end"}


def material(length: float, diameter: float, density: float, modulus: float) -> Values:
    """A round cable of an isotropic material with Poisson's ratio 0.3."""
    return {
        "cable.length": length,
        "cable.diameter": diameter,
        "cable.density": density,
        "cable.youngs_modulus": modulus,
        "cable.shear_modulus": modulus / 2.6,
    }


ALUMINIUM = material(2.0, 2e-3, 2700.0, 69e9)
STEEL = material(2.0, 2e-3, 7850.0, 200e9)
NYLON = material(1.0, 2e-3, 1150.0, 2e9)
SOFT = material(1.0, 5e-3, 1200.0, 1e7)


def load(name: str, position: float, force: tuple[float, float, float], signal: str) -> Values:
    """One force at a share of the length; `none` = silent until somebody sets it."""
    key = f"loads.{name}"
    values: Values = {f"{key}.type": "force", f"{key}.position": position, f"{key}.signal": signal}
    return values if signal == "none" else values | {f"{key}.force": list(force)}


def suture(density: float, signal: str) -> Values:
    """The collagen suture, held at both ends and pulled at the middle with 1 N."""
    return {
        **SPACE,
        **FLAT,
        **material(0.1, 4e-4, density, 750e6),
        **PINNED,
        "loads.names": ["pull"],
        **load("pull", 0.5, (0.0, 1.0, 0.0), signal),
        "loads.pull.frequency": 0.125,  # [Hz]: the peak comes after 2 s
        "end.position": [0.1, 0.0, 0.0],
        "discretization.control_points": 40,
        "integrator.step": 1e-3,
        "initial.shape": "straight",
    }


def wire(metal: Values, step: float = 2e-3) -> Values:
    """The paper's wire."""
    return {**PLANE, **metal, **GUIDED, "integrator.step": step}


def catenary(length: float, diameter: float, density: float, modulus: float, n: int) -> Values:
    """A cable pinned at both ends 0.9 lengths apart, at rest.

    Its bending stiffness is a hundredth of a solid rod's, as a stranded line has it: the truth that
    it is compared with has none.
    """
    return {
        **PLANE,
        **material(length, diameter, density, modulus),
        **PINNED,
        "cable.bending_stiffness": 0.01 * modulus * np.pi * diameter**4 / 64.0,
        "end.position": [0.9 * length, 0.0, 0.0],
        "discretization.control_points": n,
        "integrator.step": 2e-3,
    }


def thrown(*names: str, **more: Any) -> Values:
    """A cable that nothing holds, with silent loads."""
    places = {"left": 0.0, "right": 1.0, "pull": 0.5}
    loads: Values = {"loads.names": list(names)}
    for name in names:
        loads |= load(name, places[name], (0.0, 0.0, 0.0), "none")
    return {
        **SPACE,
        **FLAT,
        **SOFT,
        **loads,
        "start.fixed": [False] * 3,
        "end.fixed": [False] * 3,
        "integrator.step": 1e-3,
        **more,
    }


def column(share: float, side: float = 1e-5, n: int = 40) -> Values:
    """Pinned column under a share of its Euler load, and of it `side` at the middle sideways."""
    modulus, diameter = 1e9, 5e-3
    euler = np.pi**2 * modulus * np.pi * diameter**4 / 64.0
    return {
        **PLANE,
        **FLAT,
        **material(1.0, diameter, 1200.0, modulus),
        "end.fixed": [False, True, True],
        "loads.names": ["press", "side"],
        **load("press", 1.0, (-share * euler, 0.0, 0.0), "constant"),
        **load("side", 0.5, (0.0, 0.0, side * euler), "constant"),
        "discretization.control_points": n,
        "initial.shape": "equilibrium",
        "integrator.step": 1e-3,
    }
