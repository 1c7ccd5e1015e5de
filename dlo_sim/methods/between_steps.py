"""Pieces for calls from Python between steps: velocities, forces, stiffness, reactions, energy.

`address` is that of a packed `arrays.CableArrays`; `t` is a time [s]. Arrays of lines have shape
(lines, columns).
"""

from __future__ import annotations

from numba import boolean, float64, int64, void

from dlo_sim.compiling.groups import grid
from dlo_sim.compiling.kernels import ARRAY, ARRAY_2D, NO, YES, inline, kernel
from dlo_sim.engine import account, bishop, contact, roll
from dlo_sim.engine.arrays import (
    BETWEEN,
    BISHOP,
    CABLE,
    CONTACT,
    IN_STATE,
    PADDING,
    TWISTED,
    cable_at,
)
from dlo_sim.engine.assembly import (
    add_damping,
    all_forces,
    discrete_gradient,
    discrete_jacobian,
)
from dlo_sim.engine.band import (
    add_springs,
    clear_band,
    clear_held,
    eliminate,
    hold,
    hold_unknown,
    substitute_transposed,
    turn_vector,
)
from dlo_sim.engine.border import (
    ground_border,
    keep_border_transposed,
    negative_border,
    set_border,
    solve_border,
    solve_constrained,
    stiffen_border,
)
from dlo_sim.engine.grasps import (
    ACTIVE,
    DURATION,
    START,
    TANGENT,
    count_from,
    direction_at,
    place,
    prescribed_twist,
    rotation_at,
)
from dlo_sim.engine.lines import (
    add,
    add_differences,
    add_product,
    clear,
    copy,
    damping_of,
    kinetic,
    solve_mass,
)
from dlo_sim.engine.loads import add_load_stiffness, load_force
from dlo_sim.engine.rows import (
    add_shifts,
    carry,
    grasps_move,
    project,
    row_value,
    set_targets,
    take_directions,
    target_rates,
    target_residuals,
    through_inverse,
)
from dlo_sim.engine.sampling import velocities
from dlo_sim.engine.sliding import jump_slides, slide_tangent
from dlo_sim.engine.spans import store_three, three
from dlo_sim.engine.springs import move_anchors, put_anchors
from dlo_sim.engine.tension import take_tension
from dlo_sim.methods.works import NATURAL, evaluate, turn_natural_shape
from dlo_sim.terms.vectors import dot


@kernel(void, int64, float64)
def turn_to(address, t):
    """Set the directions of the constraint rows, and S^-1, to those of the grasps at time t. Twist
    angles that did not count before do from there on.
    """
    cable = cable_at(address)
    for g in range(cable.grasps):
        m, frame = cable.inputs.motion[g], cable.state.frame[g]
        tangent = three(frame, TANGENT)
        if dot(tangent, tangent) == 0.0:
            count_from(m, frame, t, rotation_at(m, t), direction_at(m, t), 0.0)
    set_targets(cable, t)
    take_directions(cable)


@kernel(void, int64, float64)
def place_held(address, t):
    """Project the configuration onto the constraints at time t, in the metric of the mass M."""
    cable = cable_at(address)
    set_targets(cable, t)
    take_directions(cable)
    target_residuals(cable, cable.state.direction, cable.state.x)
    add_shifts(cable, 1.0, cable.state.x)


@kernel(void, int64)
def keep_free_motion(address):
    """w <- P w, for a `state.w` that holds velocities."""
    cable = cable_at(address)
    project(cable, cable.state.w, cable.work.multipliers)


@kernel(void, int64, float64, ARRAY_2D)
def velocity(address, t, out):
    """Velocities of all control points at time t into the lines `out`."""
    velocities(cable_at(address), t, grid(out))


@kernel(float64, int64, ARRAY_2D)
def kinetic_energy(address, v):
    """v^T M v / 2 [J] of the lines `v`."""
    return kinetic(cable_at(address), grid(v))


@kernel(void, int64)
def open_account(address):
    """Start the energy balance at the present state (`account.open_account`)."""
    account.open_account(cable_at(address))


@kernel(void, int64)
def measure(address):
    """Compute the kinetic energy of w and the potential energies (`account.measure`)."""
    account.measure(cable_at(address))


@kernel((float64, float64), int64)
def open_balance(address):
    """Open energy balance, and energy exchanged so far or floor (`account.open_balance`) [J]."""
    cable = cable_at(address)
    error, exchanged = account.open_balance(cable)
    return error, max(exchanged, cable.state.balance.floor)


@kernel(void, ARRAY, float64, ARRAY)
def place_of_grasp(motion, t, out):
    """Attachment point [m] and unit direction of the cable at a grasp at time t, from its numbers
    `motion` (MOTION_SIZE,) into `out` (6,).
    """
    m = grid(motion)
    store_three(grid(out), 0, place(m, t))
    store_three(grid(out), 3, direction_at(m, t))


@kernel(float64, int64, int64, float64)
def twist_held(address, grasp, t):
    """Twist angle [rad] that a grasp prescribes at time t."""
    cable = cable_at(address)
    m = cable.inputs.motion[grasp]
    return prescribed_twist(m, cable.state.frame[grasp], t, rotation_at(m, t))


@kernel(void, int64, int64, float64, float64)
def count_twist(address, grasp, t, angle):
    """The twist angle of a grasp is this one at time t."""
    cable = cable_at(address)
    m, frame = cable.inputs.motion[grasp], cable.state.frame[grasp]
    count_from(m, frame, t, rotation_at(m, t), direction_at(m, t), angle)


@kernel(void, int64, int64, float64)
def count_roll(address, number, angle):
    """The roll of a body is this angle in the present configuration (`engine.roll`)."""
    cable = cable_at(address)
    roll.count_from(cable, number, cable.state.x, angle)


@kernel(void, int64, float64, ARRAY_2D)
def forces_now(address, t, out):
    """Potential and load forces at the present configuration into the lines `out`."""
    cable, f = cable_at(address), grid(out)
    all_forces(cable, cable.state.x, f)
    load_force(cable, cable.state.x, t, f)


@kernel(void, int64, boolean)
def stiffness(address, moments):
    """`set_stiffness` of shape and twist with the tension of the present shape, and with `moments`
    that of the applied moments, which depend on the tangent, at time zero.
    """
    cable = cable_at(address)
    set_stiffness(cable, NO, YES)
    if moments:
        add_load_stiffness(cable, cable.state.x, 0.0, 1.0, cable.work.band)


@kernel(void, CABLE, boolean, boolean)
def set_stiffness(cable, predicted, twist):
    """`work.band` = Hessian of the potential energy, if `predicted` with the predicted tension
    (`engine.tension`) instead of that of the present shape. Without `twist`, or where it does not
    act on the shape, its equations are those of the identity.
    """
    band, x = cable.work.band, cable.state.x
    if not predicted:
        take_tension(cable, x, x)
    clear_band(band)
    bishop.force(cable, x, x, cable.work.rate)  # sets the moment
    discrete_jacobian(cable, x, x, 0.0, 0.5 if twist else 0.0, 2.0, band)
    if cable.terms & CONTACT:
        contact.add_force(cable, NO, x, cable.work.rate)
        contact.add_tangent(cable, NO, 2.0, band)
    add_springs(cable, 1.0, band)
    slide_tangent(cable, NO, x, x, 2.0, band)
    if cable.lines > cable.dim and not (twist and cable.terms & BISHOP):
        for i in range(cable.n):
            hold_unknown(cable.lines, i * cable.lines + cable.dim, band)


@kernel((boolean, int64), CABLE, boolean, family=BETWEEN)
def factorize_at_rest(cable, twist):
    """Factorise the matrix `work.band` in place, with the constraint rows of the present
    configuration imposed (`border.solve_constrained`). Without `twist` the twist angles stay.

    Returns whether the factors exist, and for a symmetric matrix the number of its negative
    eigenvalues within the constraints.
    """
    band, x, directions = cable.work.band, cable.state.x, cable.state.direction
    lines, size = cable.lines, cable.n * cable.lines
    cable.work.results.coupled = IN_STATE
    hold(cable, directions, directions, band)
    roll.set_rolls(cable, x, x, twist)
    set_border(cable, directions, directions)
    stiffen_border(cable, band)
    ground_border(cable, band)
    if not eliminate(band, size, lines):
        return False, 0
    solve_border(cable, band, 1.0)
    negative = -negative_border(cable)
    for r in range(size):
        if band[r, 4 * lines - 1] < 0.0:  # the inverse of a pivot
            negative += 1
    return True, negative


@kernel(int64, int64, ARRAY_2D, boolean, family=BETWEEN)
def solve_held(address, unknowns, transposed):
    """Solve K y = unknowns, or K^T y = unknowns, for every row of the unknowns (m, n lines), with
    the constraint rows imposed, in place; K in `work.band` is overwritten.

    Returns for a symmetric matrix the number of negative eigenvalues within the constraints, or -1
    if a pivot is not usable.
    """
    cable, sides = cable_at(address), grid(unknowns)
    lines, size = cable.lines, cable.n * cable.lines
    band, z, directions = cable.work.band, cable.work.residual, cable.state.direction
    exist, negative = factorize_at_rest(cable, YES)
    if not exist:
        return -1
    for side in range(len(sides)):
        for r in range(size):
            z[PADDING + r] = sides[side, r]
        if transposed:
            turn_vector(cable, directions, YES, z, PADDING)
            keep_border_transposed(cable, z)
            substitute_transposed(band, size, lines, z)
            clear_held(cable, z, PADDING)
            turn_vector(cable, directions, NO, z, PADDING)
        else:
            solve_constrained(cable, band, directions, directions, NO, z)
        for r in range(size):
            sides[side, r] = z[PADDING + r]
    return negative


@kernel(void, int64, ARRAY_2D, boolean)
def free_acceleration(address, lines, keep):
    """f <- P M^-1 f for forces in lines, in place; without P if `keep` is false."""
    cable, x = cable_at(address), grid(lines)
    solve_mass(cable, x)
    if keep and cable.rows.count:
        project(cable, x, cable.work.multipliers)


RATE_STEP = 1e-6  # [s] for the finite differences of prescribed velocities


@inline
def add_held_accelerations(cable, t, out):
    """out += prescribed accelerations of the constraint rows at time t, shape (rows,).

    Central differences of the target rates inside the present motion of a grasp, one-sided at its
    ends: a velocity jump from one motion to the next is an impulse, not a finite acceleration. With
    the target rates R(x, t) of e.(b x), e.(b x'') is the time derivative of R - e.(b v) at fixed v.
    """
    rows, work, x = cable.rows, cable.work, cable.state.x
    v, moved = work.v0, work.v1
    velocities(cable, t, v)
    for g in range(cable.grasps):
        motion = cable.inputs.motion[g]
        begin, duration = motion[START], motion[DURATION]
        inside = begin - RATE_STEP <= t <= begin + duration + RATE_STEP
        if motion[ACTIVE] == 0.0 or duration <= 4.0 * RATE_STEP or not inside:
            continue
        low = min(max(t - RATE_STEP, begin), begin + duration - 2.0 * RATE_STEP)
        for side in range(2):
            time = low + 2.0 * RATE_STEP * side
            copy(x, moved)
            add(time - t, v, moved)
            set_targets(cable, time)
            target_rates(cable, moved, time)
            for k in range(rows.count):
                if rows.grasp[k] == g:
                    f = work.rates[k] - row_value(cable, k, work.ahead, v)
                    out[k] += (2.0 * side - 1.0) * f / (2.0 * RATE_STEP)


@kernel(void, int64, float64, ARRAY_2D, ARRAY)
def held_force(address, t, force, out):
    """Reactions `out`, shape (rows,), of the grasps on the constraint rows at time t: [N], twist
    [N m].

    They solve B M^-1 (f + B^T out) = prescribed accelerations. `force`: lines of all other forces
    f, overwritten.
    """
    cable, f, values = cable_at(address), grid(force), grid(out)
    state, work, count = cable.state, cable.work, cable.rows.count
    solve_mass(cable, f)
    for k in range(count):
        values[k] = -row_value(cable, k, state.direction, f)
    if grasps_move(cable):
        add_held_accelerations(cable, t, values)
    for k in range(count):  # the target rates have used `work.rates`
        work.rates[k] = values[k]
    through_inverse(state.inverse, work.rates, 1.0, values)


@kernel(void, int64, ARRAY_2D, ARRAY_2D, family=BETWEEN)
def damping_forces(address, velocities, out):
    """out += forces of linear damping, drag and viscosity at these velocities; both are lines."""
    cable, v, f = cable_at(address), grid(velocities), grid(out)
    physics, x, spare = cable.physics, cable.state.x, cable.work.v1
    for line in range(cable.lines):
        add_product(damping_of(cable, line), -1.0, v[line], f[line])
    add_damping(cable, x, v, 1.0, f)
    if physics.beta_stretch + physics.beta_bend > 0.0:
        clear(spare)
        discrete_gradient(cable, x, x, v, 1.0, spare)
        add(1.0, spare, f)
        clear(spare)
        discrete_gradient(cable, x, x, v, 0.0, spare)
        add(-1.0, spare, f)
    if cable.terms & TWISTED:
        scale = -physics.beta_twist
        add_differences(cable.linear.twist, scale, v[cable.dim], f[cable.dim])


@kernel(void, int64, float64)
def jump(address, t):
    """Move the constraint rows and anchors to their targets at t instantaneously. The caller adds
    the change of the potential energy to the work of the grasps, as the rule of `works` does not
    apply.
    """
    cable = cable_at(address)
    carry(cable, cable.state.x, cable.state.w, t, 0.0)
    set_targets(cable, t)
    move_anchors(cable)
    jump_slides(cable)


@kernel(void, int64, float64)
def pull(address, t):
    """Put the anchors of springs, and the grippers that let the cable slide, to where they are at
    time t, without work.
    """
    cable = cable_at(address)
    set_targets(cable, t)
    put_anchors(cable)
    jump_slides(cable)


@kernel(void, int64, NATURAL, ARRAY)
def turn_natural(address, rows, turn):
    """`turn_natural_shape` by the matrix `turn` (9,); `rows`: (blocks, samples, 4, LANES)."""
    turn_natural_shape(cable_at(address), grid(rows), grid(turn))


@kernel(void, int64, float64)
def settle(address, t):
    """Add the work up to time t to the energy balance."""
    evaluate(cable_at(address), t)
