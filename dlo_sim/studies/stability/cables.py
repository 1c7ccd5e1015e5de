"""What extreme scenes are put together from: materials, supports, loads; flat scene keys."""

from __future__ import annotations

from typing import Any

import numpy as np

Values = dict[str, Any]


def at(step: float, n: int = 13) -> Values:
    """energy_momentum at a step [s], with so many control points."""
    values = {"integrator.step": step, "discretization.control_points": n}
    return values | {"integrator.method": "energy_momentum", "terms.twist": "off"}


def material(length: float, diameter: float, density: float, modulus: float) -> Values:
    """A round cable of an isotropic material with Poisson's ratio 0.3."""
    return {
        "cable.length": length,
        "cable.diameter": diameter,
        "cable.density": density,
        "cable.youngs_modulus": modulus,
        "cable.shear_modulus": modulus / 2.6,
    }


def damped(mass: float = 2.0, stiffness: float = 1e-3) -> Values:
    """Damping by mass [1/s] and by stiffness [s]."""
    return {"damping.mass": mass, "damping.stiffness": stiffness}


def ends(start: float, end: float) -> Values:
    """Both ends held on the x axis [m]."""
    places = {"start.position": [start, 0.0, 0.0], "end.position": [end, 0.0, 0.0]}
    return places | {"start.fixed": [True] * 3, "end.fixed": [True] * 3}


PLANE: Values = {"terms.out_of_plane": "off"}
SPACE: Values = {"terms.out_of_plane": "on"}
FLAT: Values = {"gravity": [0.0, 0.0, 0.0]}
STRAIGHT: Values = {"initial.shape": "straight"}
AT_REST: Values = {"initial.shape": "equilibrium"}
CANTILEVER: Values = {"start.clamped": True, "end.fixed": [False] * 3}
DRIVEN: Values = {"start.pose_topic": "/start", "end.pose_topic": "/end"}
GUIDED: Values = {  # the paper's wire
    "start.fixed": [False, True, True],
    "end.fixed": [False, True, True],
    "start.spring": [1e4, 0.0, 0.0],
    "end.spring": [1e4, 0.0, 0.0],
    "end.position": [2.0, 0.0, 0.0],
}
# What is looked at is the method, not how far its equations are solved.
TIGHT: Values = {"integrator.tolerance": 1e-10}
ALUMINIUM = material(2.0, 2e-3, 2700.0, 69e9)
STEEL = material(2.0, 2e-3, 7850.0, 200e9)
NYLON = material(1.0, 2e-3, 1150.0, 2e9)
SOFT = material(1.0, 5e-3, 1200.0, 1e7)


def load(name: str, position: float, force: tuple[float, float, float], signal: str) -> Values:
    """One force at a share of the length; `none` = silent until somebody sets it."""
    load = {"type": "force", "position": position, "signal": signal, "force": list(force)}
    return {f"loads.{name}.{key}": value for key, value in load.items()}


def wire(metal: Values, step: float = 2e-3) -> Values:
    """The paper's wire."""
    return at(step) | PLANE | metal | GUIDED | STRAIGHT


def suture(density: float, signal: str) -> Values:
    """The collagen suture, held at both ends and pulled at the middle with 1 N."""
    pull = load("pull", 0.5, (0.0, 1.0, 0.0), signal) | {"loads.names": ["pull"]}
    pull["loads.pull.frequency"] = 0.125  # [Hz]: the peak comes after 2 s
    cable = material(0.1, 4e-4, density, 750e6) | ends(0.0, 0.1)
    return at(1e-3, 40) | SPACE | FLAT | cable | pull | STRAIGHT


def catenary(length: float, diameter: float, density: float, modulus: float, n: int) -> Values:
    """A cable pinned at both ends 0.9 lengths apart, at rest.

    Its bending stiffness is a hundredth of a solid rod's, as a stranded line has it: the truth that
    it is compared with has none.
    """
    bending = 0.01 * modulus * np.pi * diameter**4 / 64.0
    cable = material(length, diameter, density, modulus) | {"cable.bending_stiffness": bending}
    return at(2e-3, n) | PLANE | cable | ends(0.0, 0.9 * length)


def thrown(cable: Values, step: float, *names: str) -> Values:
    """A cable that nothing holds, with silent loads."""
    places = {"left": 0.0, "right": 1.0, "pull": 0.5}
    values: Values = {"loads.names": list(names), "start.fixed": [False] * 3}
    for name in names:
        values |= load(name, places[name], (0.0, 0.0, 0.0), "none")
    return at(step) | SPACE | FLAT | cable | values | {"end.fixed": [False] * 3}


def column(share: float, side: float = 1e-5) -> Values:
    """Pinned column under a share of its Euler load, and of it `side` at the middle sideways."""
    modulus, diameter = 1e9, 5e-3
    euler = np.pi**2 * modulus * np.pi * diameter**4 / 64.0
    press = load("press", 1.0, (-share * euler, 0.0, 0.0), "constant")
    press |= load("side", 0.5, (0.0, 0.0, side * euler), "constant")
    press |= {"loads.names": ["press", "side"], "end.fixed": [False, True, True]}
    cable = material(1.0, diameter, 1200.0, modulus)
    return at(1e-3, 40) | PLANE | FLAT | cable | press | AT_REST
