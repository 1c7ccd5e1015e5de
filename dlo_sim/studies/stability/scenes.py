"""The extreme scenes, ordinary for users of stiff, thin, long or short cables, and the materials,
supports and loads that they consist of, as flat scene keys.
"""

from __future__ import annotations

import numpy as np

from dlo_sim.studies.stability import extremes
from dlo_sim.studies.stability.extremes import (
    BIG_PULSE,
    PULSE,
    PULSES,
    TURN,
    Action,
    Check,
    Extreme,
    Values,
    jump,
    move,
    push,
    reconfigure,
    turn,
)


def at(step: float, n: int = 13) -> Values:
    """energy_momentum with a step [s] and n control points."""
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
ALUMINIUM = material(2.0, 2e-3, 2700.0, 69e9)
STEEL = material(2.0, 2e-3, 7850.0, 200e9)
NYLON = material(1.0, 2e-3, 1150.0, 2e9)
SOFT = material(1.0, 5e-3, 1200.0, 1e7)


def load(name: str, position: float, force: tuple[float, float, float], signal: str) -> Values:
    """A force at a share of the length; with signal `none` it is zero until it is set."""
    load = {"type": "force", "position": position, "signal": signal, "force": list(force)}
    return {f"loads.{name}.{key}": value for key, value in load.items()}


def wire(metal: Values, step: float = 2e-3) -> Values:
    """The paper's wire."""
    return at(step) | PLANE | metal | GUIDED | STRAIGHT


def suture(density: float, signal: str) -> Values:
    """The collagen suture, held at both ends and pulled at the middle with 1 N."""
    pull = load("pull", 0.5, (0.0, 1.0, 0.0), signal) | {"loads.names": ["pull"]}
    pull["loads.pull.frequency"] = 0.125  # [Hz]: peak after 2 s
    cable = material(0.1, 4e-4, density, 750e6) | ends(0.0, 0.1)
    return at(1e-3, 40) | SPACE | FLAT | cable | pull | STRAIGHT


def catenary(length: float, diameter: float, density: float, modulus: float, n: int) -> Values:
    """A cable pinned at both ends 0.9 lengths apart, at rest.

    Its bending stiffness is a hundredth of a solid rod's, as for a stranded line: the catenary that
    it is compared with has none.
    """
    bending = 0.01 * modulus * np.pi * diameter**4 / 64.0
    cable = material(length, diameter, density, modulus) | {"cable.bending_stiffness": bending}
    return at(2e-3, n) | PLANE | cable | ends(0.0, 0.9 * length)


def thrown(cable: Values, step: float, *names: str) -> Values:
    """A free cable with loads that are zero until they are set."""
    places = {"left": 0.0, "right": 1.0, "pull": 0.5}
    values: Values = {"loads.names": list(names), "start.fixed": [False] * 3}
    for name in names:
        values |= load(name, places[name], (0.0, 0.0, 0.0), "none")
    return at(step) | SPACE | FLAT | cable | values | {"end.fixed": [False] * 3}


def column(share: float, side: float = 1e-5) -> Values:
    """Pinned column under a share of its Euler load, with `side` of it across the middle."""
    modulus, diameter = 1e9, 5e-3
    euler = np.pi**2 * modulus * np.pi * diameter**4 / 64.0
    press = load("press", 1.0, (-share * euler, 0.0, 0.0), "constant")
    press |= load("side", 0.5, (0.0, 0.0, side * euler), "constant")
    press |= {"loads.names": ["press", "side"], "end.fixed": [False, True, True]}
    cable = material(1.0, diameter, 1200.0, modulus)
    return at(1e-3, 40) | PLANE | FLAT | cable | press | AT_REST


HARD_STEPS = (1e-6, 1e-5, 1e-4, 1e-2, 1e-1)  # [s]; 2 ms is the wire itself
AUTO: Values = {"integrator.method": "auto", "integrator.step": 0.0}
LIGHT, HEAVY = 3.0, 1300.0  # density of the suture [kg/m^3]
GRIPPED = at(2e-3) | PLANE | SOFT | DRIVEN
HOSE = at(5e-3) | PLANE | material(2.0, 0.05, 1100.0, 5e6) | CANTILEVER | damped(2.0, 0.05)
SLACK = at(5e-4) | PLANE | NYLON | DRIVEN | ends(0.0, 0.9) | damped()
SLACK["gravity"] = [0.0, 0.0, -0.01]
SWINGING = at(1e-3) | PLANE | material(1.0, 5e-3, 1200.0, 1e6) | ends(0.0, 0.9) | STRAIGHT
TWISTED = at(1e-3) | SPACE | FLAT | SOFT | DRIVEN | ends(0.0, 1.0) | damped()
TWISTED |= {"start.clamped": True, "end.clamped": True, "terms.twist": "on"}
RING = at(1e-3, 40) | PLANE | FLAT | SOFT | CANTILEVER | AT_REST
RING["cable.rest_curvature"] = [2.0 * np.pi]
FIBRE = at(2e-3) | PLANE | material(0.05, 125e-6, 2200.0, 72e9) | CANTILEVER | AT_REST
LINE = catenary(100.0, 0.02, 2700.0, 70e9, 400)
HANGING = catenary(1.0, 5e-3, 1200.0, 1e7, 13)
SETTLING, VISCOUS = HANGING | damped(20.0) | STRAIGHT, HANGING | damped(1e4, 1.0) | AT_REST
LONG = catenary(1e3, 0.03, 7850.0, 200e9, 100)
FINE: Values = {"discretization.control_points": 2000}


def _wire(name: str, what: str, values: Values, bound: float, duration: float = 10.0) -> Extreme:
    return Extreme(name, what, values, duration, extremes.energy_balance, bound)


def _stepped(tau: float) -> Extreme:
    name, duration = f"step of {tau * 1e3:g} ms", 10.0 if tau >= 1e-2 else 2000 * tau
    return _wire(name, f"aluminium wire, {duration:g} s", wire(ALUMINIUM, tau), 1e-7, duration)


def _pulled(density: float, more: Values) -> Extreme:
    name = f"suture of {density:g} kg/m^3{', automatic' if more else ''}"
    what = "10 cm, r 0.2 mm, E 750 MPa, n_u 40, pulled to 1 N at the middle in 2 s, undamped"
    values = suture(density, "sine") | more
    return Extreme(name, what, values, 2.0, extremes.follows_string, 5e-3)


def _sudden(density: float, more: Values) -> Extreme:
    name = f"{'viscous ' if more else ''}suture of {density:g} kg/m^3, sudden"
    what = f"1 N at once at the middle{', damping.stiffness 1 ms' if more else ''}; 2 s"
    values = suture(density, "constant") | more
    return Extreme(name, what, values, 2.0, extremes.swings_about_string, 1e-6)


WIRES = (
    _wire("aluminium wire", "2 m, 2 mm, released, n_u 13, 2 ms, 10 s", wire(ALUMINIUM), 1e-8),
    _wire("steel wire", "the same of steel, 200 GPa", wire(STEEL), 1e-8),
    _wire("aluminium wire, automatic", "method and step chosen", wire(ALUMINIUM) | AUTO, 1e-8),
    _wire("n_u = 4", "one span", wire(ALUMINIUM) | {"discretization.control_points": 4}, 1e-7),
    *(_stepped(tau) for tau in HARD_STEPS),
)

SUTURES = (
    *(_pulled(density, {}) for density in (LIGHT, HEAVY)),
    _pulled(HEAVY, AUTO),
    *(_sudden(density, {}) for density in (LIGHT, HEAVY)),
    *(_sudden(density, {"damping.stiffness": 1e-3}) for density in (LIGHT, HEAVY)),
    Extreme(
        "suture at rest",
        "its equilibrium under the pull of 1 N",
        *(suture(HEAVY, "constant") | AT_REST, 0.0, extremes.pulls_as_string, 5e-3),
    ),
)

# Name -> scene, duration [s], check and bound. WHAT describes them, EVENTS has (time [s], action).
OTHERS: dict[str, tuple[Values, float, Check, float]] = {
    "glass fibre": (FIBRE, 1.0, extremes.sags_as_cantilever, 1e-3),
    "rubber hose": (HOSE, 10.0, extremes.weighs_its_weight, 1e-4),
    "rubber hose, automatic": (HOSE | AUTO, 10.0, extremes.weighs_its_weight, 1e-4),
    "overhead line": (LINE, 1.0, extremes.hangs_as_catenary, 1e-5),
    "n_u = 2000": (LINE | FINE, 0.04, extremes.hangs_as_catenary, 1e-5),
    "cable of 1 mm": (catenary(1e-3, 1e-5, 1200.0, 1e6, 13), 0.1, extremes.lasting, 1e-5),
    "cable of 1 km": (LONG, 10.0, extremes.hangs_as_catenary, 1e-4),
    "slack cable snapped taut": (SLACK, 4.0, extremes.is_taut, 1e-3),
    "pulse of 1e6 N for 1 ms": (thrown(NYLON, 1e-4, "pull"), 0.01, extremes.carries_impulse, 1e-9),
    "free flight": (thrown(SOFT, 1e-3, "left", "right"), 5.0, extremes.keeps_momentum, 1e-9),
    "ends that meet": (GRIPPED | ends(-0.45, 0.45) | damped(), 1.5, extremes.mirrors, 1e-6),
    "pose jump of 1 m in one tick": (GRIPPED | ends(0.0, 0.8), 1.0, extremes.energy_balance, 1e-5),
    "stiffness times 1e6 at run time": (SWINGING, 0.3, extremes.energy_balance, 1e-6),
    "straight under twist": (TWISTED, 5.0, extremes.turns_as_rod, 1e-6),
    "straight under compression": (column(0.4, 0.0) | STRAIGHT, 0.1, extremes.stays_straight, 1e-7),
    "column below its buckling load": (column(0.9), 0.0, extremes.amplifies_as_column, 1e-3),
    "column above its buckling load": (column(1.1), 0.0, extremes.buckles_as_elastica, 1e-3),
    "ring": (RING, 0.1, extremes.closes_ring, 1e-4),
    "catenary settled by damping": (SETTLING, 10.0, extremes.rests_as_undamped, 1e-6),
    "catenary at rest, large damping": (VISCOUS, 1.0, extremes.rests_as_undamped, 1e-6),
}
WHAT = {
    "glass fibre": "125 um, 5 cm, 72 GPa, clamped at one end, at rest under its weight, 1 s",
    "rubber hose": "2 m, 5 cm thick, 5 MPa, clamped at one end, falls from level, damped; 10 s",
    "rubber hose, automatic": "method and step chosen",
    "overhead line": "100 m, 2 cm, 70 GPa, stranded, n_u 400, at rest, 1 s",
    "n_u = 2000": "the overhead line at rest, and 20 steps",
    "cable of 1 mm": "10 um thick, 1 MPa: at rest, 0.1 s",
    "cable of 1 km": "3 cm thick steel, n_u 100, at rest, 10 s",
    "slack cable snapped taut": "nylon, ends 0.9 L apart, pulled to 1.01 L at 2 m/s, then held, "
    "damped; 4 s",
    "pulse of 1e6 N for 1 ms": "on the middle of a free nylon cable of 3.6 g; 10 ms",
    "free flight": "thrown by two pulses of 10 ms, then 5 s without gravity",
    "ends that meet": "both ends move together in 0.5 s until they are at one place, damped; 1.5 s",
    "pose jump of 1 m in one tick": "the end of a 1 m cable from 0.8 m to -0.2 m beside the start, "
    "at once, undamped; 1 s",
    "stiffness times 1e6 at run time": "a swinging cable of 1 MPa becomes one of 1 TPa for 0.2 s "
    "and soft again; 0.7 s",
    "straight under twist": f"clamped at both ends, the end turned by {TURN:g} rad, 5 s",
    "straight under compression": "pinned column pressed at once with 0.4 Euler loads and nothing "
    "to the side, 0.1 s",
    "column below its buckling load": "0.9 Euler loads and a tiny load to the side",
    "column above its buckling load": "1.1 Euler loads: the shape that it buckles to",
    "ring": "natural curvature 2 pi / L, one end clamped, at rest, 0.1 s",
    "catenary settled by damping": "released straight between ends 0.9 L apart with damping.mass "
    "20 1/s; 10 s",
    "catenary at rest, large damping": "the equilibrium that damping.mass 1e4 1/s and stiffness "
    "1 s start from, after 1 s",
}
EVENTS: dict[str, tuple[tuple[float, Action], ...]] = {
    "slack cable snapped taut": ((0.0, move("end", 2.0, 0.055)),),
    "pulse of 1e6 N for 1 ms": (
        (0.0, push("pull", 0.0, 0.0, BIG_PULSE[0])),
        (BIG_PULSE[1], push("pull", 0.0, 0.0, 0.0)),
    ),
    "free flight": (
        *((0.0, push(name, *force)) for name, force in PULSES.items()),
        *((PULSE, push(name, 0.0, 0.0, 0.0)) for name in PULSES),
    ),
    "ends that meet": ((0.0, move("start", 0.9, 0.5)), (0.0, move("end", -0.9, 0.5))),
    "pose jump of 1 m in one tick": ((0.1, jump("end", -1.0, 0.0, 0.0)),),
    "stiffness times 1e6 at run time": tuple(
        (0.2, reconfigure("cable.youngs_modulus", modulus)) for modulus in (1e12, 1e6)
    ),
    "straight under twist": ((0.0, turn("end", TURN)),),
}
EXTREMES = (
    *(*WIRES, *SUTURES),
    *(Extreme(name, WHAT[name], *row, EVENTS.get(name, ())) for name, row in OTHERS.items()),
)
