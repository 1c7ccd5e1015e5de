"""The energy account: energy, work and loss of a run, and whether they still agree.

Energies count by term (`layout.ENERGIES`), a row each. The energy of what is held is left out of
the kinetic energy: it is that of w, the motion that leaves the grasps at rest. Of one cable only
lane 0 of the ledger counts.
"""

from __future__ import annotations

import numpy as np

from dlo_sim.compiling.lanes import LANES, load, shifted, store
from dlo_sim.compiling.pieces import NUMBERS, TABLE, TRUTH, part, piece
from dlo_sim.engine.forces import energies
from dlo_sim.engine.layout import (
    BENDING_ENERGY,
    DIM,
    DISSIPATED,
    DRIVE_WORK,
    ENERGIES,
    ENERGY,
    ENERGY_BEGIN,
    ENERGY_ERROR,
    ENERGY_START,
    EXCHANGED,
    FLOOR,
    LEDGER,
    LINE,
    LOAD_WORK,
    MARGIN,
    NOTES,
    PENDING,
    ROUND_OFF_AXIAL,
    ROUND_OFF_BENDING,
    SCALES,
    SPAN_LENGTH,
    STRETCHING,
    STRIDE,
    TERMS,
    TORSION,
    TORSION_LAST,
    TORSION_LOOKS,
    TORSION_SUM,
    TORSION_WORST,
    WEIGHT_ENERGY,
    N,
    W,
    X,
)
from dlo_sim.engine.lines import kinetic
from dlo_sim.engine.torsion import undefined_torsion

DIVERGED_SHARE = 0.5  # of the energy exchanged so far; a usable run stays far below
RESOLUTION = 1e6  # times the round-off of the energies: below that, differences mean nothing
EPSILON = 2.2e-16
COUNT = len(ENERGIES)


@part
def cables(shape):
    """Cables side by side."""
    return shape[STRIDE]


@part
def notes_of(shape, scratch):
    """Rows for passing results."""
    return shifted(scratch, shape[NOTES])


@part
def book(shape, state, row, amount):
    """Add a row of amounts [J] to a row of the ledger."""
    at = shape[LEDGER] + row * LANES
    store(state, at, load(state, at) + amount)


@part
def write(shape, state, row, value):
    """Set a row of the ledger."""
    store(state, shape[LEDGER] + row * LANES, value)


@part
def strain_round_off(stiffness, energy, strain):
    """Round-off of an energy E = k eps^2 / 2 [J] whose strain is known to `strain`:
    k (eps strain + strain^2). It outweighs that of E itself where the strain is small.
    """
    return np.sqrt(2.0 * abs(energy) * stiffness) * strain + stiffness * strain * strain


@part
def raise_floor(shape, model, state, large, kinetic_energy, lane):
    """Raise the floor of one cable to that of the present state.

    Strain is a difference of coordinates over a span, curvature one over the square of a span, so
    their round-off grows with the number of spans and with the distance from the origin. `large`:
    sum of the sizes of the weight's energy.
    """
    stride, ledger = shape[STRIDE], shape[LEDGER] + lane
    reach = 0.0
    for d in range(shape[DIM]):
        at = shape[X] + d * shape[LINE] + MARGIN * stride + lane
        for k in range(shape[N]):
            reach = max(reach, abs(state[at + k * stride]))
    scale = shape[SCALES] + lane
    span = model[scale + SPAN_LENGTH * LANES]
    strain = EPSILON * (1.0 + reach / span)
    others = kinetic_energy + large
    for k in range(COUNT):
        if k != WEIGHT_ENERGY:
            others += abs(state[ledger + (ENERGY + k) * LANES])
    stretched = state[ledger + (ENERGY + STRETCHING) * LANES]
    bent = state[ledger + (ENERGY + BENDING_ENERGY) * LANES]
    noise = EPSILON * others
    noise += strain_round_off(model[scale + ROUND_OFF_AXIAL * LANES], stretched, strain)
    noise += strain_round_off(model[scale + ROUND_OFF_BENDING * LANES], bent, strain / span)
    at = ledger + FLOOR * LANES
    state[at] = max(state[at], RESOLUTION * noise)


@part
def count_torsion(shape, model, state, scratch):
    """Book how many samples have no torsion worth the name at the present shape."""
    if shape[TERMS] & TORSION:
        count = undefined_torsion(shape, model, scratch, shifted(state, shape[X]))
        at = shape[LEDGER]
        state[at + TORSION_LOOKS * LANES] += 1.0
        state[at + TORSION_SUM * LANES] += count
        state[at + TORSION_LAST * LANES] = count
        worst = at + TORSION_WORST * LANES
        state[worst] = max(state[worst], count)


@part
def measure(shape, model, state, scratch, look):
    """Kinetic energy of w into row 0 of the notes; potential energies into the ledger and the rows
    behind.
    """
    x, out = shifted(state, shape[X]), notes_of(shape, scratch)
    store(out, 0, kinetic(shape, model, shifted(state, shape[W])))
    look(shape, model, state, x, shifted(out, LANES))
    for at in range(COUNT * LANES):
        state[shape[LEDGER] + ENERGY * LANES + at] = out[LANES + at]


@part
def open_account(shape, model, state, scratch, look):
    """Open the account at the present state; the ledger holds nothing but a floor."""
    count_torsion(shape, model, state, scratch)
    measure(shape, model, state, scratch, look)
    out = notes_of(shape, scratch)
    for lane in range(cables(shape)):
        ledger = shape[LEDGER] + lane
        raise_floor(shape, model, state, out[(1 + COUNT) * LANES + lane], out[lane], lane)
        state[ledger + EXCHANGED * LANES] = out[lane]
        total = out[lane]
        for k in range(COUNT):
            energy = state[ledger + (ENERGY + k) * LANES]
            state[ledger + (ENERGY_BEGIN + k) * LANES] = energy
            total += energy
        state[ledger + ENERGY_START * LANES] = total


@part
def total_energy(shape, state, kinetic_energy, lane):
    """Energy [J] of one cable whose potential energies were measured."""
    total = kinetic_energy
    for k in range(COUNT):
        total += state[shape[LEDGER] + (ENERGY + k) * LANES + lane]
    return total


@piece(TRUTH, TABLE, NUMBERS, NUMBERS, NUMBERS, energies)
def update_account(shape, model, state, scratch, look):
    """Compare the energy with work done and energy lost; whether all cables are sane.

    Row 0 of the notes gets the energies [J]; row 1 is 1.0 for each sane cable.
    """
    count_torsion(shape, model, state, scratch)  # before: it uses the notes as well
    measure(shape, model, state, scratch, look)
    out = notes_of(shape, scratch)
    sane = True
    for lane in range(cables(shape)):
        ledger = shape[LEDGER] + lane
        total = total_energy(shape, state, out[lane], lane)
        exchanged = max(state[ledger + EXCHANGED * LANES], out[lane])
        for k in range(COUNT):
            change = state[ledger + (ENERGY + k) * LANES]
            change -= state[ledger + (ENERGY_BEGIN + k) * LANES]
            exchanged = max(exchanged, abs(change))
        loads, drive = state[ledger + LOAD_WORK * LANES], state[ledger + DRIVE_WORK * LANES]
        exchanged = max(exchanged, max(abs(loads), abs(drive)))
        error = total - state[ledger + ENERGY_START * LANES] - loads - drive
        error = abs(error - state[ledger + PENDING * LANES] + state[ledger + DISSIPATED * LANES])
        raise_floor(shape, model, state, out[(1 + COUNT) * LANES + lane], out[lane], lane)
        state[ledger + EXCHANGED * LANES] = exchanged
        at = ledger + ENERGY_ERROR * LANES
        state[at] = max(state[at], error)
        floor = max(exchanged, state[ledger + FLOOR * LANES])
        good = np.isfinite(total) and error <= DIVERGED_SHARE * floor
        out[lane] = total
        out[LANES + lane] = 1.0 if good else 0.0
        sane = sane and good
    return sane
