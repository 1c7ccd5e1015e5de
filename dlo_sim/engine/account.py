"""The energy account: energies, work and dissipation of a run, and the error of their balance.

The kinetic energy is that of w, the motion relative to the prescribed one (`engine.held`); the
energy of the prescribed motion is not included. For one cable only lane 0 of the ledger is used.
"""

from __future__ import annotations

import numpy as np

from dlo_sim.compiling.lanes import LANES, load, shifted, store
from dlo_sim.compiling.pieces import NUMBERS, TABLE, TRUTH, part, piece
from dlo_sim.engine import layout
from dlo_sim.engine.assembly import ANY, all_energies
from dlo_sim.engine.lines import kinetic
from dlo_sim.engine.torsion import undefined_torsion

DIVERGED_SHARE = 0.5  # of the energy exchanged so far; a usable run stays far below
RESOLUTION = 1e6  # ratio of the ledger's floor to the round-off of the energies
EPSILON = 2.2e-16
COUNT = len(layout.ENERGIES)


@part
def cables(shape):
    """Number of cables: 1 or LANES."""
    return shape[layout.STRIDE]


@part
def notes_of(shape, scratch):
    """The rows NOTES, which pass results from one function to the next."""
    return shifted(scratch, shape[layout.NOTES])


@part
def add_to_ledger(shape, state, row, amount):
    """Add a row of amounts [J] to a row of the ledger."""
    at = shape[layout.LEDGER] + row * LANES
    store(state, at, load(state, at) + amount)


@part
def set_ledger(shape, state, row, value):
    """Set a row of the ledger."""
    store(state, shape[layout.LEDGER] + row * LANES, value)


@part
def strain_round_off(stiffness, energy, strain):
    """Round-off [J] of E = k eps^2 / 2 due to an error `strain` of eps: k (eps strain + strain^2).

    For small eps it exceeds the round-off of E itself. `stiffness` is k, `energy` is E.
    """
    return np.sqrt(2.0 * abs(energy) * stiffness) * strain + stiffness * strain * strain


@part
def raise_floor(shape, model, state, large, kinetic_energy, lane):
    """Raise FLOOR of one cable to RESOLUTION times the round-off of the present energies.

    Strain is a difference of coordinates divided by the span length, curvature one divided by its
    square, so their round-off grows with the number of spans and the distance from the origin.
    `large`: sum of the absolute summands of the gravitational energy [J].
    """
    stride, ledger = shape[layout.STRIDE], shape[layout.LEDGER] + lane
    reach = 0.0
    for d in range(shape[layout.DIM]):
        at = shape[layout.X] + d * shape[layout.LINE] + layout.MARGIN * stride + lane
        for k in range(shape[layout.N]):
            reach = max(reach, abs(state[at + k * stride]))
    scale = shape[layout.SCALES] + lane
    span = model[scale + layout.SPAN_LENGTH * LANES]
    strain = EPSILON * (1.0 + reach / span)
    others = kinetic_energy + large
    for k in range(COUNT):
        if k != layout.WEIGHT_ENERGY:
            others += abs(state[ledger + (layout.ENERGY + k) * LANES])
    stretched = state[ledger + (layout.ENERGY + layout.STRETCHING) * LANES]
    bent = state[ledger + (layout.ENERGY + layout.BENDING_ENERGY) * LANES]
    noise = EPSILON * others
    noise += strain_round_off(model[scale + layout.ROUND_OFF_AXIAL * LANES], stretched, strain)
    noise += strain_round_off(model[scale + layout.ROUND_OFF_BENDING * LANES], bent, strain / span)
    at = ledger + layout.FLOOR * LANES
    state[at] = max(state[at], RESOLUTION * noise)


@part
def count_torsion(shape, model, state, scratch):
    """Update the counts of samples whose torsion is suppressed (`terms.torsion`)."""
    if shape[layout.TERMS] & layout.TORSION:
        count = undefined_torsion(shape, model, scratch, shifted(state, shape[layout.X]))
        at = shape[layout.LEDGER]
        state[at + layout.TORSION_LOOKS * LANES] += 1.0
        state[at + layout.TORSION_SUM * LANES] += count
        state[at + layout.TORSION_LAST * LANES] = count
        worst = at + layout.TORSION_WORST * LANES
        state[worst] = max(state[worst], count)


@part
def measure(shape, model, state, scratch, look):
    """Write the kinetic energy of w to row 0 of the notes, and the potential energies to the
    following rows and to the ledger.
    """
    x, out = shifted(state, shape[layout.X]), notes_of(shape, scratch)
    store(out, 0, kinetic(shape, model, shifted(state, shape[layout.W])))
    all_energies(look, shape, model, state, x, shifted(out, LANES))
    for at in range(COUNT * LANES):
        state[shape[layout.LEDGER] + layout.ENERGY * LANES + at] = out[LANES + at]


@part
def open_account(shape, model, state, scratch, look):
    """Start the account at the present state, with a ledger that is zero except for FLOOR."""
    count_torsion(shape, model, state, scratch)
    measure(shape, model, state, scratch, look)
    out = notes_of(shape, scratch)
    for lane in range(cables(shape)):
        ledger = shape[layout.LEDGER] + lane
        raise_floor(shape, model, state, out[(1 + COUNT) * LANES + lane], out[lane], lane)
        state[ledger + layout.EXCHANGED * LANES] = out[lane]
        total = out[lane]
        for k in range(COUNT):
            energy = state[ledger + (layout.ENERGY + k) * LANES]
            state[ledger + (layout.ENERGY_BEGIN + k) * LANES] = energy
            total += energy
        state[ledger + layout.ENERGY_START * LANES] = total


@part
def total_energy(shape, state, kinetic_energy, lane):
    """Kinetic plus potential energy [J] of one cable; the ledger holds the potential energies."""
    total = kinetic_energy
    for k in range(COUNT):
        total += state[shape[layout.LEDGER] + (layout.ENERGY + k) * LANES + lane]
    return total


@piece(TRUTH, TABLE, NUMBERS, NUMBERS, NUMBERS, ANY.energies)
def update_account(shape, model, state, scratch, look):
    """Update the error of the energy balance, |energy - start - work + dissipated|.

    Return whether all cables are sane: energy finite, error at most DIVERGED_SHARE of EXCHANGED or
    FLOOR. Row 0 of the notes gets the energies [J], row 1 a 1.0 for each sane cable.
    """
    count_torsion(shape, model, state, scratch)  # first, because it overwrites the notes
    measure(shape, model, state, scratch, look)
    out = notes_of(shape, scratch)
    sane = True
    for lane in range(cables(shape)):
        ledger = shape[layout.LEDGER] + lane
        total = total_energy(shape, state, out[lane], lane)
        exchanged = max(state[ledger + layout.EXCHANGED * LANES], out[lane])
        for k in range(COUNT):
            change = state[ledger + (layout.ENERGY + k) * LANES]
            change -= state[ledger + (layout.ENERGY_BEGIN + k) * LANES]
            exchanged = max(exchanged, abs(change))
        loads, drive = (
            state[ledger + layout.LOAD_WORK * LANES],
            state[ledger + layout.DRIVE_WORK * LANES],
        )
        exchanged = max(exchanged, max(abs(loads), abs(drive)))
        error = total - state[ledger + layout.ENERGY_START * LANES] - loads - drive
        error = abs(
            error
            - state[ledger + layout.PENDING * LANES]
            + state[ledger + layout.DISSIPATED * LANES]
        )
        raise_floor(shape, model, state, out[(1 + COUNT) * LANES + lane], out[lane], lane)
        state[ledger + layout.EXCHANGED * LANES] = exchanged
        at = ledger + layout.ENERGY_ERROR * LANES
        state[at] = max(state[at], error)
        floor = max(exchanged, state[ledger + layout.FLOOR * LANES])
        good = np.isfinite(total) and error <= DIVERGED_SHARE * floor
        out[lane] = total
        out[LANES + lane] = 1.0 if good else 0.0
        sane = sane and good
    return sane
