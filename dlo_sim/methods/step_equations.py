"""The equations of an implicit step: forces, residual of the momentum balance, Newton matrix."""

from __future__ import annotations

from dlo_sim.compiling.lanes import LANES, first, load, shifted, store
from dlo_sim.compiling.pieces import (
    NO,
    NUMBERS,
    REAL,
    TABLE,
    TRUTH,
    YES,
    part,
    piece,
)
from dlo_sim.engine import layout
from dlo_sim.engine.account import (
    notes_of,
)
from dlo_sim.engine.assembly import (
    ANY,
    add_damping,
    add_damping_tangent,
    all_tangents,
    discrete_gradient,
)
from dlo_sim.engine.band import (
    add_lines,
    add_springs,
    clamps_here,
    clear_band,
    clear_held,
    eliminate,
    hold,
    own_point,
    turn_vector,
)
from dlo_sim.engine.border import balance_border, solve_border, stiffen_border
from dlo_sim.engine.forces import start_with_weight
from dlo_sim.engine.lines import add, add_product, clear, mass_of, row_product
from dlo_sim.engine.loads import add_load_stiffness, load_force
from dlo_sim.engine.springs import (
    spring_force,
)
from dlo_sim.engine.tables import line_of
from dlo_sim.methods.implicit_layout import (
    CHANGE,
    DAMPING_FORCE,
    FACTORS_OF_SAMPLES,
    FORCE_OF_HELD,
    INERTIA,
    MIDDLE,
    MIDDLE_DIRECTION,
    SEEN,
    SEEN_FIXED,
    START,
    START_V,
    residual_of,
)


@part
def is_viscous(shape, model):
    """Whether stretching or bending has internal damping."""
    beta = shape[layout.BETA]
    return shape[layout.TERMS] & layout.DAMPED != 0 and model[beta] + model[beta + LANES] > 0.0


@piece(
    *(REAL, TABLE, NUMBERS, NUMBERS, NUMBERS, NUMBERS, ANY.gradient),
    *(REAL, REAL, REAL, REAL, TRUTH),
)
def step_force(shape, model, inputs, state, scratch, gradient, t, tau, theta, rate, discrete):
    """FORCE = all forces of the step from START to the present configuration, START + CHANGE.

    Damping acts on the velocity at theta, SEEN / tau with SEEN = rate CHANGE + SEEN_FIXED, which is
    CHANGE for the midpoint family. Returns the energy dissipated by damping [J].
    """
    x, force = shifted(state, shape[layout.X]), shifted(scratch, shape[layout.FORCE])
    start, change = shifted(scratch, shape[START]), shifted(scratch, shape[CHANGE])
    middle, seen = shifted(scratch, shape[MIDDLE]), shifted(scratch, shape[SEEN])
    damping, fixed = (
        shifted(scratch, shape[DAMPING_FORCE]),
        shifted(scratch, shape[SEEN_FIXED]),
    )
    loads, notes = shifted(scratch, shape[layout.NEW_LOAD]), notes_of(shape, scratch)
    start_with_weight(shape, model, force)
    clear(shape, loads)
    clear(shape, damping)
    for at in range(0, shape[layout.SIZE], LANES):
        moved = load(change, at)
        store(middle, at, load(start, at) + theta * moved)
        store(seen, at, rate * moved + load(fixed, at))
    viscous = 1.0 / tau if is_viscous(shape, model) else 0.0
    begin, end = (start, x) if discrete else (middle, middle)
    discrete_gradient(gradient, shape, model, state, begin, end, seen, viscous, force, notes)
    lost = notes[0]
    spring_force(shape, model, state, middle, theta, NO, force)
    if shape[layout.LOADS]:
        load_force(shape, model, inputs, scratch, middle, t + theta * tau, loads)
        add(shape, 1.0, loads, force)
    if shape[layout.TERMS] & layout.DAMPED:
        for line in range(shape[layout.LINES]):
            matrix = shape[layout.VISCOUS] + mass_of(shape, line) - shape[layout.MASS]
            add_product(shape, model, matrix, line, -1.0 / tau, seen, damping)
        add_damping(gradient, shape, model, middle, seen, 1.0 / tau, damping)
        add(shape, 1.0, damping, force)
        lost -= first(row_product(shape, damping, change))
    return lost


@part
def balance(shape, model, state, scratch, a, b, c):
    """Compute the residual of the momentum balance, in the frames of the clamps (`residual_of`),
    and the reactions, FORCE_OF_HELD. Returns the sum |INERTIA_i CHANGE_i| [J].
    """
    dim, n, width = shape[layout.DIM], shape[layout.N], shape[layout.LINE]
    change, speed = shifted(scratch, shape[CHANGE]), shifted(scratch, shape[START_V])
    acceleration = shifted(state, shape[layout.HISTORY] + 2 * shape[layout.SIZE])
    row, push = shifted(scratch, shape[SEEN]), shifted(scratch, shape[INERTIA])
    force, residual = shifted(scratch, shape[layout.FORCE]), residual_of(shape, scratch)
    for at in range(0, dim * width, LANES):
        f = a * load(change, at) - b * load(speed, at)
        store(row, at, f - c * load(acceleration, at))
        store(push, at, 0.0)
    inertia = 0.0
    for d in range(dim):
        add_product(shape, model, shape[layout.MASS], d, 1.0, row, push)
        for i in range(n):
            at = d * width + layout.MARGIN + i
            inertia += abs(push[at] * change[at])
            residual[i * dim + d] = force[at] - push[at]
    turn_vector(shape, shifted(scratch, shape[MIDDLE_DIRECTION]), YES, residual)
    balance_border(shape, scratch, residual, shifted(scratch, shape[FORCE_OF_HELD]))
    for k in range(shape[layout.HELD]):
        own, line = own_point(shape, k), line_of(shape, k)
        if own >= 0 and line < dim:
            d = line
            if line < 0:
                d = 1 if clamps_here(shape, k) else 2
            store(scratch, shape[FORCE_OF_HELD] + k * LANES, -residual[own * dim + d])
    clear_held(shape, residual)
    return inertia


@piece(
    *(TRUTH, TABLE, NUMBERS, NUMBERS, NUMBERS, NUMBERS, ANY.tangent),
    *(REAL, REAL, REAL, REAL, REAL, TRUTH),
)
def newton_matrix(shape, model, inputs, state, scratch, tangent, t, tau, a, theta, rate, discrete):
    """MATRIX = LU factors of the Jacobian of the momentum balance; return whether they exist."""
    band, x = shifted(state, shape[layout.MATRIX]), shifted(state, shape[layout.X])
    start, middle = shifted(scratch, shape[START]), shifted(scratch, shape[MIDDLE])
    factors = shifted(scratch, shape[FACTORS_OF_SAMPLES])
    clear_band(shape, band)
    add_lines(shape, model, shape[layout.MASS], a, band)
    viscous = 0.0
    if shape[layout.TERMS] & layout.DAMPED:
        add_lines(shape, model, shape[layout.VISCOUS], rate / tau, band)
        add_damping_tangent(tangent, shape, model, middle, rate / tau, factors, band)
        if is_viscous(shape, model):
            viscous = rate / (2.0 * theta * tau)
    begin, end = (start, x) if discrete else (middle, middle)
    all_tangents(tangent, shape, model, state, begin, end, viscous, 2.0 * theta, factors, band)
    add_springs(shape, model, theta, band)
    add_load_stiffness(shape, model, inputs, middle, t + theta * tau, theta, band)
    rows = shifted(scratch, shape[MIDDLE_DIRECTION])
    hold(shape, rows, shifted(state, shape[layout.DIRECTION]), band)
    stiffen_border(shape, scratch, band)
    weight = shape[layout.LEDGER] + layout.MATRIX_WEIGHT * LANES
    state[weight] = 0.0
    if not eliminate(band, shape[layout.N] * shape[layout.DIM], shape[layout.DIM]):
        return False
    solve_border(shape, scratch, band)
    state[weight] = a
    return True
