"""The energy balance of a run: energies, work and dissipation, and the error of their sum.

The kinetic energy is that of the projected velocity w, the motion relative to the prescribed one
(`engine.rows`); the energy of the prescribed motion is not included.
"""

from __future__ import annotations

import numpy as np
from numba import boolean

from dlo_sim.compiling.kernels import inline, kernel
from dlo_sim.engine.arrays import BENDING, CABLE, ENERGIES, MARGIN, STRETCHING, TORSION, WEIGHT
from dlo_sim.engine.assembly import all_energies
from dlo_sim.engine.lines import kinetic
from dlo_sim.engine.torsion import undefined_torsion

DIVERGED_SHARE = 0.5  # of the energy exchanged so far; a usable run stays far below
RESOLUTION = 1e6  # ratio of `balance.floor` to the round-off of the energies
EPSILON = 2.2e-16
COUNT = len(ENERGIES)


@inline
def strain_round_off(stiffness, energy, strain):
    """Round-off [J] of E = k eps^2 / 2 due to an error `strain` of eps: k (eps strain + strain^2).

    For small eps it exceeds the round-off of E itself. `stiffness` is k, `energy` is E.
    """
    return np.sqrt(2.0 * abs(energy) * stiffness) * strain + stiffness * strain * strain


@inline
def raise_floor(cable):
    """Raise `balance.floor` to RESOLUTION times the round-off of the energies of `measure`.

    Strain is a difference of coordinates divided by the span length, curvature one divided by its
    square, so their round-off grows with the number of spans and the distance from the origin.
    """
    physics, state, work = cable.physics, cable.state, cable.work
    reach = 0.0
    for d in range(cable.dim):
        for c in range(MARGIN, MARGIN + cable.n):
            reach = max(reach, abs(state.x[d, c]))
    span = physics.shortest_span
    strain = EPSILON * (1.0 + reach / span)
    others = work.results.kinetic + work.energies[COUNT]
    for k in range(COUNT):
        if k != WEIGHT:
            others += abs(state.energy[k])
    noise = EPSILON * others
    noise += strain_round_off(physics.axial_round_off, state.energy[STRETCHING], strain)
    noise += strain_round_off(physics.bending_round_off, state.energy[BENDING], strain / span)
    state.balance.floor = max(state.balance.floor, RESOLUTION * noise)


@inline
def count_torsion(cable):
    """Update the counts of samples whose torsion is suppressed (`engine.torsion`)."""
    if cable.terms & TORSION:
        balance, count = cable.state.balance, undefined_torsion(cable, cable.state.x)
        balance.torsion_looks += 1.0
        balance.torsion_sum += count
        balance.torsion_last = count
        balance.torsion_worst = max(balance.torsion_worst, count)


@inline
def measure(cable):
    """Write the kinetic energy of w to `work.results.kinetic`, and the potential energies by term
    to `work.energies` and `state.energy` [J].
    """
    state, work = cable.state, cable.work
    work.results.kinetic = kinetic(cable, state.w)
    all_energies(cable, state.x, work.energies)
    for k in range(COUNT):
        state.energy[k] = work.energies[k]


@inline
def with_potentials(cable, total):
    """`total` plus the potential energies of `measure` [J]."""
    for k in range(COUNT):
        total += cable.state.energy[k]
    return total


@inline
def open_account(cable):
    """Start the balance at the present state; it must be zero except for `floor`."""
    state, work = cable.state, cable.work
    count_torsion(cable)
    measure(cable)
    raise_floor(cable)
    for k in range(COUNT):
        state.energy_begin[k] = state.energy[k]
    state.balance.exchanged = work.results.kinetic
    state.balance.energy_start = with_potentials(cable, work.results.kinetic)


@inline
def open_balance(cable):
    """|energy - start - work + dissipated| and the largest energy exchanged so far [J]; the energy
    is in `work.results.total`.
    """
    state, balance, results = cable.state, cable.state.balance, cable.work.results
    measure(cable)
    results.total = with_potentials(cable, results.kinetic)
    exchanged = max(balance.exchanged, results.kinetic)
    for k in range(COUNT):
        exchanged = max(exchanged, abs(state.energy[k] - state.energy_begin[k]))
    exchanged = max(exchanged, max(abs(balance.load_work), abs(balance.drive_work)))
    error = results.total - balance.energy_start - balance.load_work - balance.drive_work
    return abs(error - balance.pending + balance.dissipated), exchanged


@kernel(boolean, CABLE)
def update_account(cable):
    """Update the error of the energy balance (`open_balance`).

    Returns whether the run is usable: the energy is finite, and the error at most DIVERGED_SHARE of
    the energy exchanged or of `balance.floor`.
    """
    balance = cable.state.balance
    count_torsion(cable)
    error, balance.exchanged = open_balance(cable)
    raise_floor(cable)
    balance.error = max(balance.error, error)
    usable = error <= DIVERGED_SHARE * max(balance.exchanged, balance.floor)
    return np.isfinite(cable.work.results.total) and usable
