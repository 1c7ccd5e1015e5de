"""Pieces for calls from Python between steps: velocities, forces, stiffness, reactions, energy."""

from __future__ import annotations

from collections.abc import Callable

from dlo_sim.compiling.lanes import LANES, bare, first, load, shifted, store
from dlo_sim.compiling.pieces import (
    NO,
    NOTHING,
    REAL,
    REALS,
    TRUTH,
    WHOLE,
    YES,
    Engine,
    part,
    piece,
)
from dlo_sim.engine import account, layout
from dlo_sim.engine.assembly import (
    add_damping,
    all_forces,
    all_tangents,
    assembly,
    by_terms,
    discrete_gradient,
)
from dlo_sim.engine.band import (
    add_springs,
    clear_band,
    clear_held,
    eliminate,
    hold,
    substitute,
    turn_vector,
    width_of,
)
from dlo_sim.engine.border import keep_border, set_border, solve_border, stiffen_border
from dlo_sim.engine.bundles import CABLE, bared
from dlo_sim.engine.grasps import DURATION, MOTION_SIZE, START, place
from dlo_sim.engine.held import (
    add_shifts,
    grasps_move,
    project,
    row_value,
    set_targets,
    take_directions,
    target_residuals,
    through_inverse,
)
from dlo_sim.engine.held_motion import carry, target_rates
from dlo_sim.engine.lines import (
    add,
    add_differences,
    add_product,
    clear,
    copy,
    kinetic,
    mass_of,
    solve_mass,
)
from dlo_sim.engine.loads import add_load_stiffness, load_force
from dlo_sim.engine.sampling import velocities
from dlo_sim.engine.springs import move_anchors
from dlo_sim.engine.tables import grasp_of
from dlo_sim.methods.implicit_layout import BAND, FACTORS_OF_SAMPLES, residual_of
from dlo_sim.methods.works import evaluate, turn_natural_shape


def _engines(name: str) -> Callable[[int], Engine]:
    """Bits of the terms -> the functions of this name of `Assembly`."""
    return by_terms(lambda terms: Engine(getattr(assembly(terms), name)))


forces_of, energies_of = _engines("forces"), _engines("energies")
gradient_of, tangent_of = _engines("gradient"), _engines("tangent")
# Of the types of all others.
FORCES, ENERGIES, GRADIENT, TANGENT = forces_of(0), energies_of(0), gradient_of(0), tangent_of(0)


@piece(NOTHING, CABLE, REAL)
def turn_to(cable, t):
    """Set DIRECTION and INVERSE to those of the grasps at time t."""
    shape, model, inputs, state, scratch = bared(cable)
    if shape[layout.HELD]:
        set_targets(shape, model, inputs, state, scratch, t)
        take_directions(shape, model, state, scratch)


@piece(NOTHING, CABLE, REAL)
def place_held(cable, t):
    """Project the configuration onto the constraints at time t, in the metric of the mass M."""
    shape, model, inputs, state, scratch = bared(cable)
    x = shifted(state, shape[layout.X])
    if shape[layout.HELD]:
        set_targets(shape, model, inputs, state, scratch, t)
        take_directions(shape, model, state, scratch)
        target_residuals(shape, model, state, shape[layout.DIRECTION], scratch, x)
        add_shifts(shape, model, state, scratch, 1.0, x)


@piece(NOTHING, CABLE)
def keep_free_motion(cable):
    """w <- P w, for a W that holds velocities."""
    shape, model, _, state, scratch = bared(cable)
    if shape[layout.HELD]:
        project(
            shape,
            model,
            state,
            scratch,
            shifted(state, shape[layout.W]),
            scratch,
            shape[layout.SYSTEM],
        )


@piece(NOTHING, CABLE, REAL, REALS)
def velocity(cable, t, out):
    """Velocities of all control points at time t into the lines of `out`."""
    shape, model, inputs, state, scratch = bared(cable)
    velocities(shape, model, inputs, state, scratch, t, bare(out))


@piece(REAL, CABLE, REALS)
def kinetic_energy(cable, v):
    """v^T M v / 2 [J] of one cable."""
    shape, model, _, _, _ = bared(cable)
    return first(kinetic(shape, model, bare(v)))


@piece(NOTHING, CABLE, ENERGIES)
def open_account(cable, engine):
    """Open the energy account at the present state."""
    shape, model, _, state, scratch = bared(cable)
    _, look = engine.pieces
    account.open_account(shape, model, state, scratch, look)


@piece(NOTHING, CABLE, ENERGIES)
def measure(cable, engine):
    """Kinetic energy of w into the notes, potential energies into the ledger."""
    shape, model, _, state, scratch = bared(cable)
    _, look = engine.pieces
    account.measure(shape, model, state, scratch, look)


@piece(NOTHING, REALS, WHOLE, REAL, REALS)
def grasp_place(inputs, at, t, out):
    """Attachment point (3) and twist angle of the grasp at an offset of the inputs, at time t."""
    a = place(bare(inputs), at, t)
    out[0], out[1], out[2], out[3] = a[0], a[1], a[2], a[3]


@piece(NOTHING, CABLE, FORCES, REAL, REALS)
def forces_now(cable, engine, t, out):
    """Potential and load forces at the present configuration into the lines of `out`."""
    shape, model, inputs, state, scratch = bared(cable)
    out = bare(out)
    x = shifted(state, shape[layout.X])
    _, forces = engine.pieces
    all_forces(forces, shape, model, state, x, out)
    load_force(shape, model, inputs, scratch, x, t, out)


@piece(NOTHING, CABLE, TANGENT)
def stiffness(cable, engine):
    """BAND = Hessian of the potential energy with respect to the spatial lines."""
    shape, model, _, state, scratch = bared(cable)
    band, x = shifted(scratch, shape[BAND]), shifted(state, shape[layout.X])
    clear_band(shape, band)
    _, tangent = engine.pieces
    factors = shifted(scratch, shape[FACTORS_OF_SAMPLES])
    all_tangents(tangent, shape, model, state, x, x, 0.0, 2.0, factors, band)
    add_springs(shape, model, 1.0, band)


@piece(NOTHING, CABLE)
def moment_stiffness(cable):
    """BAND += stiffness of the applied moments, which depend on the tangent, at time zero."""
    shape, model, inputs, state, scratch = bared(cable)
    band, x = shifted(scratch, shape[BAND]), shifted(state, shape[layout.X])
    add_load_stiffness(shape, model, inputs, x, 0.0, 1.0, band)


@piece(WHOLE, CABLE, REALS)
def solve_held(cable, unknowns):
    """Solve BAND y = unknowns in place with the held rows fixed. Returns the number of negative
    pivots, for a symmetric matrix that of negative eigenvalues, or -1 if a pivot is not usable.
    """
    shape, model, _, state, scratch = bared(cable)
    y = bare(unknowns)
    dim = shape[layout.DIM]
    size, width = shape[layout.N] * dim, width_of(dim)
    band, directions = shifted(scratch, shape[BAND]), shifted(state, shape[layout.DIRECTION])
    hold(shape, directions, directions, band)
    set_border(shape, model, scratch, directions, directions)
    stiffen_border(shape, scratch, band)
    if not eliminate(band, size, dim):
        return -1
    solve_border(shape, scratch, band)
    z = residual_of(shape, scratch)
    for r in range(size):
        z[r] = y[r]
    turn_vector(shape, directions, YES, z)
    clear_held(shape, z)
    substitute(band, size, dim, z)
    keep_border(shape, scratch, z)
    turn_vector(shape, directions, NO, z)
    for r in range(size):
        y[r] = z[r]
    negative = 0
    for r in range(size):
        if band[r * width + 4 * dim - 1] < 0.0:
            negative += 1
    return negative


@piece(NOTHING, CABLE, REALS, TRUTH)
def free_acceleration(cable, lines, keep):
    """f <- P M^-1 f for forces in lines, in place; without P if `keep` is false."""
    shape, model, _, state, scratch = bared(cable)
    x = bare(lines)
    solve_mass(shape, model, x)
    if keep and shape[layout.HELD]:
        project(shape, model, state, scratch, x, scratch, shape[layout.SYSTEM])


RATE_STEP = 1e-6  # [s] for the finite differences of prescribed velocities


@part
def add_held_accelerations(shape, model, inputs, state, scratch, t, out):
    """out += prescribed accelerations of the held rows at time t.

    Central differences of the target rates inside the present motion of a grasp, one-sided at its
    ends: a velocity jump from one motion to the next is an impulse, not a finite acceleration. With
    the target rates R(x, t) of e.(b x), e.(b x'') is the time derivative of R - e.(b v) at fixed v.
    """
    x, v = shifted(state, shape[layout.X]), shifted(scratch, shape[layout.V0])
    moved = shifted(scratch, shape[layout.V1])
    velocities(shape, model, inputs, state, scratch, t, v)
    for g in range(shape[layout.GRASPS]):
        at = shape[layout.MOTION] + MOTION_SIZE * g
        begin, duration = inputs[at + START], inputs[at + DURATION]
        inside = begin - RATE_STEP <= t <= begin + duration + RATE_STEP
        if inputs[at] == 0.0 or duration <= 4.0 * RATE_STEP or not inside:
            continue
        low = min(max(t - RATE_STEP, begin), begin + duration - 2.0 * RATE_STEP)
        for side in range(2):
            time = low + 2.0 * RATE_STEP * side
            copy(shape, x, moved)
            add(shape, time - t, v, moved)
            set_targets(shape, model, inputs, state, scratch, time)
            target_rates(shape, model, inputs, state, scratch, moved, time)
            for k in range(shape[layout.HELD]):
                if grasp_of(shape, k) == g:
                    f = load(scratch, shape[layout.RATES] + k * LANES)
                    f = f - row_value(shape, model, k, scratch, shape[layout.AHEAD], v)
                    out[k] += (2.0 * side - 1.0) * first(f) / (2.0 * RATE_STEP)


@piece(NOTHING, CABLE, REAL, REALS, REALS)
def held_force(cable, t, force, out):
    """Reactions `out`, shape (held,), of the grasps on the held rows at time t: [N], twist [N m].

    They solve B M^-1 (f + B^T out) = prescribed accelerations. `force`: lines of all other forces
    f, overwritten.
    """
    shape, model, inputs, state, scratch = bared(cable)
    f, out = bare(force), bare(out)
    held = shape[layout.HELD]
    solve_mass(shape, model, f)
    for k in range(held):
        out[k] = -first(row_value(shape, model, k, state, shape[layout.DIRECTION], f))
    if grasps_move(shape, inputs):
        add_held_accelerations(shape, model, inputs, state, scratch, t, out)
    for k in range(held):
        store(scratch, shape[layout.RATES] + k * LANES, out[k])
    through_inverse(
        shape, state, shape[layout.INVERSE], scratch, 1.0, scratch, shape[layout.SYSTEM]
    )
    for k in range(held):
        out[k] = scratch[shape[layout.SYSTEM] + k * LANES]


@piece(NOTHING, CABLE, GRADIENT, REALS, REALS)
def damping_forces(cable, engine, v, out):
    """out += forces of linear damping, drag and viscosity at velocities v; both are lines."""
    shape, model, _, state, scratch = bared(cable)
    v, out = bare(v), bare(out)
    for line in range(shape[layout.LINES]):
        matrix = shape[layout.VISCOUS] + mass_of(shape, line) - shape[layout.MASS]
        add_product(shape, model, matrix, line, -1.0, v, out)
    x, spare = shifted(state, shape[layout.X]), shifted(scratch, shape[layout.V1])
    _, gradient = engine.pieces
    add_damping(gradient, shape, model, x, v, 1.0, out)
    beta = shape[layout.BETA]
    if model[beta] + model[beta + LANES] > 0.0:
        notes = shifted(scratch, shape[layout.NOTES])
        clear(shape, spare)
        discrete_gradient(gradient, shape, model, state, x, x, v, 1.0, spare, notes)
        add(shape, 1.0, spare, out)
        clear(shape, spare)
        discrete_gradient(gradient, shape, model, state, x, x, v, 0.0, spare, notes)
        add(shape, -1.0, spare, out)
    if shape[layout.TERMS] & layout.TWISTED:
        scale = -model[beta + 2 * LANES]
        add_differences(shape, model, shape[layout.TWIST], shape[layout.DIM], scale, v, out)


@piece(NOTHING, CABLE, carry, REAL)
def jump(cable, carry, t):
    """Move the held rows and anchors to their targets at t instantaneously. The caller adds the
    change of the potential energy to the work of the grasps, as the rule of `works` does not apply.
    """
    shape, model, inputs, state, scratch = bared(cable)
    x, w = shifted(state, shape[layout.X]), shifted(state, shape[layout.W])
    carry(shape, model, inputs, state, scratch, x, w, t, 0.0)
    move_anchors(shape, model, inputs, state, t)


@piece(NOTHING, CABLE, ENERGIES, REALS, REALS)
def turn_natural(cable, engine, rows, turn):
    """`turn_natural_shape` by one matrix, (9)."""
    shape, model, _, state, scratch = bared(cable)
    _, look = engine.pieces
    turn_natural_shape(shape, model, state, scratch, look, rows, turn, 0)


@piece(NOTHING, CABLE, evaluate, FORCES, REAL)
def settle(cable, evaluate, engine, t):
    """Add the work up to time t to the ledger."""
    shape, model, inputs, state, scratch = bared(cable)
    _, forces = engine.pieces
    evaluate(shape, model, inputs, state, scratch, forces, t)
