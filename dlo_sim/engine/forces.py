"""All forces at one configuration, and all energies: the sum over the terms of a scene."""

from __future__ import annotations

from dlo_sim.compiling.lanes import LANES, load, size, store, zero
from dlo_sim.compiling.pieces import NOTHING, NUMBERS, TABLE, part, piece
from dlo_sim.engine.bishop import couple_twist, coupled_energy
from dlo_sim.engine.contact import contact_energy, contact_force
from dlo_sim.engine.elastic import elastic_energy, elastic_force
from dlo_sim.engine.layout import (
    BENDING_ENERGY,
    BISHOP,
    CONTACT,
    CONTACT_ENERGY,
    CURVED,
    DIM,
    ENERGIES,
    GRAVITY,
    LINE,
    MARGIN,
    MATERIAL,
    PARTS,
    PLASTIC_ENERGY,
    PLASTICITY,
    SPRING_ENERGY,
    STRETCHING,
    STRIDE,
    TERMS,
    TORSION,
    TORSIONAL,
    TWIST,
    TWISTED,
    TWISTING,
    WEIGHT,
    WEIGHT_ENERGY,
)
from dlo_sim.engine.lines import add_differences, clear, difference_form, gathered
from dlo_sim.engine.natural_curvature import natural_energy, natural_force
from dlo_sim.engine.plasticity import plastic_energy
from dlo_sim.engine.springs import spring_energy, spring_force
from dlo_sim.engine.torsion import torsion_energy, torsion_force


@piece(NOTHING, TABLE, NUMBERS, NUMBERS, NUMBERS, NUMBERS)
def forces(shape, model, state, x, out):
    """out = - dU/dq of everything that has a potential."""
    clear(shape, out)
    terms = shape[TERMS]
    elastic_force(shape, model, x, out)
    if terms & CURVED:
        natural_force(shape, model, state, x, x, terms & MATERIAL != 0, True, out)
    if terms & TORSION:
        torsion_force(shape, model, x, out)
    if terms & BISHOP:
        couple_twist(shape, model, state, x, x, 0.0, True, True, out)
    if terms & TWISTED:
        add_differences(shape, model, shape[TWIST], shape[DIM], -1.0, x, out)
    if terms & GRAVITY:
        add_weight(shape, model, out)
    if terms & CONTACT:
        contact_force(shape, model, x, x, out)
    spring_force(shape, model, state, x, 1.0, out)


@part
def add_weight(shape, model, out):
    """out += generalised weight."""
    for at in range(0, shape[DIM] * shape[LINE], LANES):
        store(out, at, load(out, at) + load(model, shape[WEIGHT] + at))


@part
def weight_energy(shape, model, x):
    """Energy in the field of gravity [J], zero at the world's origin, and the sum of the sizes of
    its parts; both to be gathered.
    """
    f, large = zero(), zero()
    for d in range(shape[DIM]):
        start = d * shape[LINE] + MARGIN * shape[STRIDE]
        for b in range(shape[PARTS]):
            at = start + LANES * b
            e = load(model, shape[WEIGHT] + at) * load(x, at)
            f -= e
            large += size(e)
    return f, large


@piece(NOTHING, TABLE, NUMBERS, NUMBERS, NUMBERS, NUMBERS)
def energies(shape, model, state, x, out):
    """Potential energies [J] by term (`layout.ENERGIES`) as rows of `out`; then the sum of the
    sizes of the weight's parts.
    """
    terms = shape[TERMS]
    for at in range((len(ENERGIES) + 1) * LANES):
        out[at] = 0.0
    stretching, bending = elastic_energy(shape, model, x)
    if terms & CURVED:
        bending += natural_energy(shape, model, state, x)
    store(out, STRETCHING * LANES, gathered(shape, stretching))
    store(out, BENDING_ENERGY * LANES, gathered(shape, bending))
    if terms & TWISTED:
        f = 0.5 * difference_form(shape, model, shape[TWIST], shape[DIM], x)
        if terms & BISHOP:
            f += coupled_energy(shape, model, state, x)
        store(out, TWISTING * LANES, gathered(shape, f))
    if terms & TORSION:
        store(out, TORSIONAL * LANES, gathered(shape, torsion_energy(shape, model, x)))
    if terms & PLASTICITY:
        store(out, PLASTIC_ENERGY * LANES, gathered(shape, plastic_energy(shape, model, state)))
    if terms & GRAVITY:
        weight, large = weight_energy(shape, model, x)
        store(out, WEIGHT_ENERGY * LANES, gathered(shape, weight))
        store(out, len(ENERGIES) * LANES, gathered(shape, large))
    if terms & CONTACT:
        f = contact_energy(shape, model, x)
        store(out, CONTACT_ENERGY * LANES, gathered(shape, f))
    store(out, SPRING_ENERGY * LANES, spring_energy(shape, model, state, x))
