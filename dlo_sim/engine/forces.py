"""Forces at one configuration, and energies, of the basic terms: stretching, bending, twisting
theta'^2, weight, springs. `engine.assembly` adds the optional ones.
"""

from __future__ import annotations

from dlo_sim.compiling.lanes import LANES, load, size, store, zero
from dlo_sim.compiling.pieces import NO, NOTHING, NUMBERS, TABLE, YES, part, piece
from dlo_sim.engine import layout
from dlo_sim.engine.elastic import elastic_energy, elastic_force
from dlo_sim.engine.lines import add_differences, difference_form, gathered
from dlo_sim.engine.springs import spring_energy, spring_force


@piece(NOTHING, TABLE, NUMBERS, NUMBERS, NUMBERS, NUMBERS)
def forces(shape, model, state, x, out):
    """out = - dU/dq of these terms."""
    terms = shape[layout.TERMS]
    start_with_weight(shape, model, out)
    elastic_force(shape, model, x, out)
    if terms & layout.TWISTED:
        add_differences(shape, model, shape[layout.TWIST], shape[layout.DIM], -1.0, x, out)
    spring_force(shape, model, state, x, 1.0, NO, out)
    if terms & layout.TWISTED:
        spring_force(shape, model, state, x, 1.0, YES, out)


@part
def start_with_weight(shape, model, out):
    """out = generalised weight, which is zero without gravity."""
    spatial = shape[layout.DIM] * shape[layout.LINE]
    for at in range(0, spatial, LANES):
        store(out, at, load(model, shape[layout.WEIGHT] + at))
    for at in range(spatial, shape[layout.SIZE], LANES):
        store(out, at, 0.0)


@part
def weight_energy(shape, model, x):
    """Gravitational energy [J], zero at the world's origin, and the sum of the absolute values of
    its summands, a measure of its round-off; both as partial sums.
    """
    f, large = zero(), zero()
    for d in range(shape[layout.DIM]):
        start = d * shape[layout.LINE] + layout.MARGIN * shape[layout.STRIDE]
        for b in range(shape[layout.PARTS]):
            at = start + LANES * b
            e = load(model, shape[layout.WEIGHT] + at) * load(x, at)
            f -= e
            large += size(e)
    return f, large


@piece(NOTHING, TABLE, NUMBERS, NUMBERS, NUMBERS, NUMBERS)
def energies(shape, model, state, x, out):
    """Potential energies [J] by term (`layout.ENERGIES`) as rows of `out`, then a row with the
    second value of `weight_energy`.
    """
    terms = shape[layout.TERMS]
    for at in range((len(layout.ENERGIES) + 1) * LANES):
        out[at] = 0.0
    stretching, bending = elastic_energy(shape, model, x)
    store(out, layout.STRETCHING * LANES, gathered(shape, stretching))
    store(out, layout.BENDING_ENERGY * LANES, gathered(shape, bending))
    if terms & layout.TWISTED:
        f = 0.5 * difference_form(shape, model, shape[layout.TWIST], shape[layout.DIM], x)
        store(out, layout.TWISTING * LANES, gathered(shape, f))
    if terms & layout.GRAVITY:
        weight, large = weight_energy(shape, model, x)
        store(out, layout.WEIGHT_ENERGY * LANES, gathered(shape, weight))
        store(out, len(layout.ENERGIES) * LANES, gathered(shape, large))
    store(out, layout.SPRING_ENERGY * LANES, spring_energy(shape, model, state, x))
