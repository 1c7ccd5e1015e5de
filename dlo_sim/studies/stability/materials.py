"""Extreme scenes that are an ordinary cable of an extreme material, and what `auto` makes of it."""

from __future__ import annotations

from dlo_sim.studies.stability import checks
from dlo_sim.studies.stability.extremes import Extreme, Values
from dlo_sim.studies.stability.parts import (
    ALUMINIUM,
    CANTILEVER,
    DAMPED,
    PLANE,
    STEEL,
    catenary,
    material,
    suture,
    wire,
)

ENERGY = "energy balance, share of the energy exchanged"
CATENARY = "distance from the elastic catenary, share of L"
AUTO: Values = {"integrator.method": "auto", "integrator.step": 0.0}
HOSE: Values = {
    **PLANE,
    **material(2.0, 0.05, 1100.0, 5e6),
    **CANTILEVER,
    **DAMPED,
    "damping.stiffness": 0.05,
    "integrator.step": 5e-3,
}


def _suture(name: str, density: float, sudden: bool, **more: float) -> Extreme:
    signal = "constant" if sudden else "sine"
    how = "1 N at once" if sudden else "pulled to 1 N in 2 s"
    damped = f", damping {more}" if more else ", undamped"
    return Extreme(
        name,
        f"10 cm, r 0.2 mm, E 750 MPa, n_u 40, {density:g} kg/m^3: {how} at the middle{damped}; 2 s",
        {**suture(density, signal), **more},
        2.0,
        checks.swings_about_string if sudden else checks.follows_string,
        ENERGY if sudden else "mean deflection against the string; 1000 times the energy balance",
        1e-6 if sudden else 5e-3,
        budget=1.0,
    )


MATERIALS: tuple[Extreme, ...] = (
    Extreme(
        "aluminium wire",
        "2 m, 2 mm, released straight, undamped, n_u 13, 2 ms, 10 s",
        wire(ALUMINIUM),
        10.0,
        checks.energy_balance,
        ENERGY,
        1e-8,
    ),
    Extreme(
        "steel wire",
        "the same of steel, 200 GPa",
        wire(STEEL),
        10.0,
        checks.energy_balance,
        ENERGY,
        1e-8,
    ),
    _suture("suture of 3 kg/m^3", 3.0, False),
    _suture("suture of 1300 kg/m^3", 1300.0, False),
    _suture("suture of 3 kg/m^3, sudden", 3.0, True),
    _suture("suture of 1300 kg/m^3, sudden", 1300.0, True),
    _suture("viscous suture of 3 kg/m^3, sudden", 3.0, True, **{"damping.stiffness": 1e-3}),
    _suture("viscous suture of 1300 kg/m^3, sudden", 1300.0, True, **{"damping.stiffness": 1e-3}),
    Extreme(
        "suture at rest",
        "its equilibrium under the pull of 1 N",
        {**suture(1300.0, "constant"), "initial.shape": "equilibrium"},
        0.0,
        checks.pulls_as_string,
        "deflection, relative to an elastic string",
        5e-3,
    ),
    Extreme(
        "glass fibre",
        "125 um, 5 cm, 72 GPa, clamped at one end, at rest under its weight; left alone for 1 s",
        {
            **PLANE,
            **material(0.05, 125e-6, 2200.0, 72e9),
            **CANTILEVER,
            "initial.shape": "equilibrium",
            "integrator.step": 2e-3,
        },
        1.0,
        checks.sags_as_cantilever,
        "tip, relative to q L^4 / 8 EI",
        1e-3,
    ),
    Extreme(
        "rubber hose",
        "5 cm thick, 2 m, 5 MPa, falls from horizontal, clamped at one end, damped; 10 s",
        HOSE,
        10.0,
        checks.weighs_its_weight,
        "reaction, relative to the weight",
        1e-4,
    ),
    Extreme(
        "overhead line",
        "100 m, 2 cm, 70 GPa, stranded, n_u 400, at rest and left alone for 1 s",
        catenary(100.0, 0.02, 2700.0, 70e9, 400),
        1.0,
        checks.hangs_as_catenary,
        CATENARY,
        1e-5,
    ),
)

AUTOMATIC: tuple[Extreme, ...] = (
    Extreme(
        "aluminium wire, automatic",
        "the same wire, method and step chosen; 10 s",
        wire(ALUMINIUM) | AUTO,
        10.0,
        checks.energy_balance,
        ENERGY,
        1e-8,
    ),
    Extreme(
        "suture of 1300 kg/m^3, automatic",
        "the suture pulled to 1 N in 2 s, method and step chosen",
        suture(1300.0, "sine") | AUTO,
        2.0,
        checks.follows_string,
        "mean deflection against the string; 1000 times the energy balance",
        5e-3,
    ),
    Extreme(
        "rubber hose, automatic",
        "the same hose, method and step chosen; 10 s",
        HOSE | AUTO,
        10.0,
        checks.weighs_its_weight,
        "reaction, relative to the weight",
        1e-4,
    ),
)
