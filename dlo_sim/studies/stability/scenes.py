"""The extreme scenes: ordinary input for a user of stiff, thin, long or short cables."""

from __future__ import annotations

import numpy as np

from dlo_sim.studies.stability import checks
from dlo_sim.studies.stability.checks import BIG_PULSE, PULSE, PULSES, TURN
from dlo_sim.studies.stability.extremes import Event, Extreme
from dlo_sim.studies.stability.materials import AUTOMATIC, CATENARY, ENERGY, MATERIALS
from dlo_sim.studies.stability.parts import (
    ALUMINIUM,
    CANTILEVER,
    DAMPED,
    DRIVEN,
    FLAT,
    NYLON,
    PINNED,
    PLANE,
    SOFT,
    SPACE,
    catenary,
    column,
    material,
    thrown,
    wire,
)

HARD_STEPS = (1e-6, 1e-5, 1e-4, 1e-2, 1e-1)  # [s]; 2 ms is the wire itself


def _steps(tau: float) -> Extreme:
    duration = 10.0 if tau >= 1e-2 else 2000 * tau
    return Extreme(
        f"step of {tau * 1e3:g} ms",
        f"aluminium wire, tau = {tau:g} s, {duration:g} s",
        wire(ALUMINIUM, tau),
        duration,
        checks.energy_balance,
        ENERGY,
        1e-7,
    )


HAPPENINGS: tuple[Extreme, ...] = (
    Extreme(
        "slack cable snapped taut",
        "nylon, ends 0.9 L apart, pulled to 1.01 L at 2 m/s, then held, damped; 4 s",
        {
            **PLANE,
            **NYLON,
            **PINNED,
            **DRIVEN,
            **DAMPED,
            "end.position": [0.9, 0.0, 0.0],
            "gravity": [0.0, 0.0, -0.01],
            "integrator.step": 5e-4,
        },
        4.0,
        checks.is_taut,
        "tension, relative to EA (gap / L - 1)",
        1e-3,
        (Event(0.0, "move", "end", (2.0, 0.0, 0.0, 0.055)),),
    ),
    Extreme(
        "pulse of 1e6 N for 1 ms",
        "on the middle of a free nylon cable of 3.6 g; 10 ms",
        thrown("pull", **NYLON, **{"integrator.step": 1e-4}),
        0.01,
        checks.carries_impulse,
        "momentum, relative to the impulse",
        1e-9,
        (
            Event(0.0, "load", "pull", (0.0, 0.0, BIG_PULSE[0])),
            Event(BIG_PULSE[1], "load", "pull", (0.0, 0.0, 0.0)),
        ),
    ),
    Extreme(
        "free flight",
        "thrown by two pulses of 10 ms, then 5 s without gravity",
        thrown("left", "right"),
        5.0,
        checks.keeps_momentum,
        "momentum and angular momentum, relative",
        1e-9,
        (
            *(Event(0.0, "load", name, force) for name, force in PULSES.items()),
            *(Event(PULSE, "load", name, (0.0, 0.0, 0.0)) for name in PULSES),
        ),
    ),
    Extreme(
        "ends that meet",
        "both ends move together in 0.5 s until they are at one place, damped; 1.5 s",
        {
            **PLANE,
            **SOFT,
            **PINNED,
            **DRIVEN,
            **DAMPED,
            "start.position": [-0.45, 0.0, 0.0],
            "end.position": [0.45, 0.0, 0.0],
            "integrator.step": 2e-3,
        },
        1.5,
        checks.mirrors,
        "asymmetry, share of L; energy balance",
        1e-6,
        (
            Event(0.0, "move", "start", (0.9, 0.0, 0.0, 0.5)),
            Event(0.0, "move", "end", (-0.9, 0.0, 0.0, 0.5)),
        ),
    ),
    Extreme(
        "pose jump of 1 m in one tick",
        "the end of a 1 m cable from 0.8 m to -0.2 m beside the start, at once, undamped; 1 s",
        {
            **PLANE,
            **SOFT,
            **PINNED,
            **DRIVEN,
            "end.position": [0.8, 0.0, 0.0],
            "integrator.step": 2e-3,
        },
        1.0,
        checks.energy_balance,
        ENERGY,
        1e-5,
        (Event(0.1, "jump", "end", (-1.0, 0.0, 0.0)),),
    ),
    Extreme(
        "stiffness times 1e6 at run time",
        "a swinging cable of 1 MPa becomes one of 1 TPa for 0.2 s and soft again; 0.7 s",
        {
            **PLANE,
            **material(1.0, 5e-3, 1200.0, 1e6),
            **PINNED,
            "end.position": [0.9, 0.0, 0.0],
            "initial.shape": "straight",
            "integrator.step": 1e-3,
        },
        0.3,
        checks.energy_balance,
        ENERGY,
        1e-6,
        (
            Event(0.2, "reconfigure", changes={"cable.youngs_modulus": 1e12}),
            Event(0.2, "reconfigure", changes={"cable.youngs_modulus": 1e6}),
        ),
    ),
)

SHAPES: tuple[Extreme, ...] = (
    Extreme(
        "straight under twist",
        f"clamped at both ends, the end turned by {TURN:g} rad: the moment, and it stays straight",
        {
            **SPACE,
            **FLAT,
            **SOFT,
            **PINNED,
            **DRIVEN,
            **DAMPED,
            "start.clamped": True,
            "end.clamped": True,
            "terms.twist": "on",
            "integrator.step": 1e-3,
        },
        5.0,
        checks.turns_as_rod,
        "moment relative to GJ Theta / L, move off the axis",
        1e-6,
        (Event(0.0, "turn", "end", (TURN, 0.0, 0.0)),),
    ),
    Extreme(
        "straight under compression",
        "pinned column pressed with 1.5 Euler loads and nothing to the side: stays straight",
        {**column(1.5, 0.0), "initial.shape": "straight"},
        0.1,
        checks.stays_straight,
        "move off the axis, share of L; energy balance",
        1e-7,
    ),
    Extreme(
        "column below its buckling load",
        "0.9 Euler loads and a tiny load to the side: buckling load from the amplified sag",
        column(0.9),
        0.0,
        checks.amplifies_as_column,
        "buckling load, relative to EI pi^2 / L^2",
        1e-3,
    ),
    Extreme(
        "column above its buckling load",
        "1.1 Euler loads: the shape that it buckles to",
        column(1.1),
        0.0,
        checks.buckles_as_elastica,
        "gap of the ends against the elastica, share of L",
        1e-3,
    ),
    Extreme(
        "ring",
        "natural curvature 2 pi / L, one end clamped, at rest",
        {
            **PLANE,
            **FLAT,
            **SOFT,
            **CANTILEVER,
            "cable.rest_curvature": [2.0 * np.pi],
            "discretization.control_points": 40,
            "initial.shape": "equilibrium",
            "integrator.step": 1e-3,
        },
        0.1,
        checks.closes_ring,
        "gap of the ends, share of L",
        1e-4,
    ),
    Extreme(
        "catenary settled by damping",
        "released straight between ends 0.9 L apart with damping.mass 20 1/s; 10 s",
        {
            **catenary(1.0, 5e-3, 1200.0, 1e7, 13),
            "damping.mass": 20.0,
            "damping.stiffness": 1e-3,
            "initial.shape": "straight",
        },
        10.0,
        checks.rests_as_undamped,
        "distance from the equilibrium of damping 0, share of L",
        1e-6,
    ),
    Extreme(
        "catenary at rest, large damping",
        "the equilibrium that damping.mass 1e4 1/s and stiffness 1 s start from, after 1 s",
        {
            **catenary(1.0, 5e-3, 1200.0, 1e7, 13),
            "damping.mass": 1e4,
            "damping.stiffness": 1.0,
            "initial.shape": "equilibrium",
        },
        1.0,
        checks.rests_as_undamped,
        "distance from the equilibrium of damping 0, share of L",
        1e-6,
    ),
)

SIZES: tuple[Extreme, ...] = (
    Extreme(
        "n_u = 4",
        "one span: the aluminium wire; 10 s",
        {**wire(ALUMINIUM), "discretization.control_points": 4},
        10.0,
        checks.energy_balance,
        ENERGY,
        1e-7,
    ),
    Extreme(
        "n_u = 2000",
        "the overhead line at rest, and 20 steps",
        catenary(100.0, 0.02, 2700.0, 70e9, 2000),
        0.04,
        checks.hangs_as_catenary,
        CATENARY,
        1e-5,
    ),
    Extreme(
        "cable of 1 mm",
        "10 um thick, 1 MPa: at rest and left alone for 0.1 s",
        catenary(1e-3, 1e-5, 1200.0, 1e6, 13),
        0.1,
        checks.lasting,
        "move, share of L; energy balance",
        1e-5,
    ),
    Extreme(
        "cable of 1 km",
        "3 cm thick steel, n_u 100, at rest and left alone for 10 s",
        catenary(1e3, 0.03, 7850.0, 200e9, 100),
        10.0,
        checks.hangs_as_catenary,
        CATENARY,
        1e-4,
    ),
    *(_steps(tau) for tau in HARD_STEPS),
)

EXTREMES = (*MATERIALS, *AUTOMATIC, *HAPPENINGS, *SHAPES, *SIZES)
