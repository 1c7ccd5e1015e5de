"""The two parameters of Zhai's explicit two-step method.

    x1 = x0 + tau v0 + tau^2 ((1/2 + psi) a0 - psi a_before)
    v1 = v0 + tau ((1 + phi) a0 - phi a_before)

The order is 2 for phi = 1/2 and 1 otherwise. Eliminating the velocities gives
    x1 - 2 x0 + x_before = tau^2 ((1/2 + psi) a0 + (1/2 + phi - 2 psi) a_before + (psi - phi)
    a_before2),
which for psi = phi = 1/2 is the recursion of the Stoermer-Verlet method: with the first step taken
as a_before = a0 the positions are those of `velocity_verlet`, and only the velocities differ (by
tau (a0 - a_before) / 2). For phi = 1/2 and psi = 1/2 + delta the recursion damps a mode by the rate
delta omega^4 tau^3 / 2, so psi below 1/2 makes every mode grow.

Source: Zhai 1996, eqs. 3-4; the remarks are derived here and tested.
"""

from __future__ import annotations

from dataclasses import replace

from dlo_sim.core.amplification import stability_limit
from dlo_sim.core.methods import METHODS, Method


def with_parameters(psi: float, phi: float) -> Method:
    """The method with this pair: its order and its stability limit (0 if no step is stable)."""
    method = METHODS["zhai"]
    if psi == 0.5 and phi == 0.5:
        return method
    method = replace(method, zhai_pair=(psi, phi), order=2 if phi == 0.5 else 1)
    return replace(method, stability_limit=stability_limit(method))
