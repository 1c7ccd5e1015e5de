"""Constraint rows, by which grasps prescribe the cable: direction . sum_k b_k x_k = target.

The point of a row is four basis values b at a material coordinate (summing to 1 for a position, to
0 for r'), a single control point, or the difference of such sums on two branches, which a rigid
joint keeps at zero. A row is a point, a grasp and a direction, which is an axis or turns with the
grasp. A fixed end is up to three rows at the first control point. A clamp has in
addition two rows at the second one, normal to its tangent; the distance along the tangent stays
free. A grasp along the cable has the same rows with basis values.

The mass matrix M is that of the free cable. With the matrix B of the rows, Z = M^-1 B^T and
S = B Z, small and dense, Y = Z S^-1 is the motion of the cable due to unit motions of the rows, and
P = 1 - Y B projects onto motions that satisfy B v = 0. The state holds the projected velocity
w = P v: forces act on it as P M^-1 f, and v = w + Y (rates of the targets). For rows of constant
direction a drift over dt is exactly x += dt w + Y (change of the targets). For turning directions,
the constraint impulses of a drift act along the directions at its start and satisfy the constraints
at its end, and w is projected with the directions at the end: RATTLE (Andersen 1983), symmetric,
second order.

Methods that evaluate forces at stage times need the rate of w where directions turn. B and P then
depend on time, so w' = P M^-1 f + P' v with
    P' v = - P M^-1 B'^T S^-1 B v - Y B' w.

`directions` are grids (rows, 3), by line; those of the state belong to the present configuration,
`work.ahead` to a requested time.
"""

from __future__ import annotations

from numba import float64, void

from dlo_sim.compiling.groups import load, store
from dlo_sim.compiling.kernels import inline, kernel
from dlo_sim.compiling.lanes import LANES
from dlo_sim.engine.arrays import CABLE, LINES, MARGIN, VECTOR
from dlo_sim.engine.grasps import (
    component,
    count_from,
    direction_by,
    moves,
    place_by,
    prescribed_twist,
    rates,
    rotation_at,
    times,
)
from dlo_sim.engine.lines import add, kinetic
from dlo_sim.engine.spans import store_three, three
from dlo_sim.terms.vectors import cross

# Entries of `work.held`: by rows, attachment point, direction, twist angle; rates (`grasps.rates`).
ROTATION, PLACE, AIM, TWIST, RATES = 0, 9, 12, 15, 16

# -- values and shifts --------------------------------------------------------------------------


@inline
def point_value(cable, point, line, x):
    """sum_k b_k x_k of a point on one line of x."""
    points = cable.points
    own, other = points.own[point], points.other[point]
    if own >= 0:
        return x[line, MARGIN + own]
    c = MARGIN + points.first[point]
    value = points.weights[point, 0] * x[line, c]
    for k in range(1, 4):
        value += points.weights[point, k] * x[line, c + k]
    if other >= 0:
        for k in range(4):
            value += points.other_weights[point, k] * x[line, MARGIN + other + k]
    return value


@inline
def row_value(cable, k, directions, x):
    """B_k x of row k, with its direction in `directions` if that turns."""
    point, line = cable.rows.point[k], cable.rows.line[k]
    if line >= 0:
        return point_value(cable, point, line, x)
    value = 0.0
    for d in range(cable.dim):
        value += directions[k, d] * point_value(cable, point, d, x)
    return value


@kernel(void, CABLE, LINES)
def values_along(cable, x):
    """work.rates = B x with the directions of the state."""
    for k in range(cable.rows.count):
        cable.work.rates[k] = row_value(cable, k, cable.state.direction, x)


@kernel(void, CABLE, LINES, LINES)
def target_residuals(cable, directions, x):
    """work.rates = work.targets - B x, the residuals of the constraints."""
    work = cable.work
    for k in range(cable.rows.count):
        work.rates[k] = work.targets[k] - row_value(cable, k, directions, x)


@inline
def shift_line(cable, point, line, scale, x):
    """x += scale M^-1 b of a point, on one line of x."""
    shift = cable.points.shift
    for c in range(0, cable.columns, LANES):
        store(x, line, c, load(x, line, c) + scale * load(shift, point, c))


@inline
def shift_row(cable, k, directions, scale, x):
    """x += scale Z_k, column k of Z = M^-1 B^T."""
    point, line = cable.rows.point[k], cable.rows.line[k]
    if line >= 0:
        shift_line(cable, point, line, scale, x)
        return
    for d in range(cable.dim):
        shift_line(cable, point, d, scale * directions[k, d], x)


@inline
def through_inverse(inverse, values, scale, out):
    """out = scale times the matrix `inverse` times the vector `values`."""
    for k in range(len(inverse)):
        sum_ = 0.0
        for j in range(len(inverse)):
            sum_ += inverse[k, j] * values[j]
        out[k] = scale * sum_


@kernel(void, CABLE, float64, LINES)
def add_shifts(cable, scale, x):
    """x += scale Y work.rates; work.multipliers = scale S^-1 work.rates."""
    state, work = cable.state, cable.work
    through_inverse(state.inverse, work.rates, scale, work.multipliers)
    for k in range(cable.rows.count):
        shift_row(cable, k, state.direction, work.multipliers[k], x)


@kernel(void, CABLE, LINES, VECTOR)
def project(cable, x, multipliers):
    """x <- P x; the vector `multipliers` gets S^-1 B x. Overwrites work.rates."""
    values_along(cable, x)
    through_inverse(cable.state.inverse, cable.work.rates, 1.0, multipliers)
    for k in range(cable.rows.count):
        shift_row(cable, k, cable.state.direction, -multipliers[k], x)
    for k in range(cable.rows.count):
        pin(cable, k, 0.0, x)


@inline
def pin(cable, k, value, x):
    """Set the coordinate exactly if row k fixes one coordinate of a control point."""
    line, own = cable.rows.line[k], cable.points.own[cable.rows.point[k]]
    if line >= 0 and own >= 0:
        x[line, MARGIN + own] = value


# -- directions and the system S ----------------------------------------------------------------


@inline
def turns(cable, k):
    """Whether the direction of row k turns with its grasp."""
    return cable.rows.line[k] < 0


@inline
def direction_of(cable, k):
    """Direction e of a turning row, world frame, after `set_held`."""
    held, body = cable.work.held[cable.rows.grasp[k]], cable.rows.body[k]
    return times(held, ROTATION, body[0], body[1], body[2])


@inline
def direction_rate(cable, k):
    """e' = omega x e of a turning row [1/s], world frame, after `set_held_rates`."""
    held = cable.work.held[cable.rows.grasp[k]]
    return cross(three(held, RATES + 4), direction_of(cable, k))


@inline
def directions_turn(cable):
    """Whether the directions work.ahead differ from those of the state."""
    for k in range(cable.rows.count):
        if turns(cable, k):
            for d in range(cable.dim):
                if cable.state.direction[k, d] != cable.work.ahead[k, d]:
                    return True
    return False


@inline
def alignment(cable, k, j, a, b):
    """Direction of row k in `a` . direction of row j in `b`; 0 between space and twist."""
    line_k, line_j, dim = cable.rows.line[k], cable.rows.line[j], cable.dim
    if line_k >= 0 and line_j >= 0:
        return 1.0 if line_k == line_j else 0.0
    if line_k == dim or line_j == dim:
        return 0.0
    if line_k >= 0:
        return b[j, line_k]
    if line_j >= 0:
        return a[k, line_j]
    product = 0.0
    for d in range(dim):
        product += a[k, d] * b[j, d]
    return product


@inline
def fill_system(cable, a, b):
    """work.system = S = B M^-1 B^T, with directions `a` on the left and `b` on the right."""
    rows = cable.rows
    for k in range(rows.count):
        for j in range(rows.count):
            product = cable.points.product[rows.point[k], rows.point[j]]
            cable.work.system[k, j] = product * alignment(cable, k, j, a, b)


@inline
def invert_in_place(a):
    """Gauss-Jordan inverse without pivoting, for nearly symmetric positive definite matrices."""
    size = len(a)
    for k in range(size):
        pivot = 1.0 / a[k, k]
        a[k, k] = 1.0
        for j in range(size):
            a[k, j] *= pivot
        for i in range(size):
            if i != k:
                factor = a[i, k]
                a[i, k] = 0.0
                for j in range(size):
                    a[i, j] -= factor * a[k, j]


@inline
def invert(cable, out):
    """out = the inverse of work.system, which is close to symmetric positive definite."""
    for k in range(cable.rows.count):
        for j in range(cable.rows.count):
            out[k, j] = cable.work.system[k, j]
    invert_in_place(out)


@kernel(void, CABLE)
def take_directions(cable):
    """Set the directions of the state to work.ahead, and its inverse to S^-1 along these."""
    state = cable.state
    for k in range(cable.rows.count):
        for d in range(cable.dim):
            state.direction[k, d] = cable.work.ahead[k, d]
    fill_system(cable, state.direction, state.direction)
    invert(cable, state.inverse)


# -- prescribed motion --------------------------------------------------------------------------


@inline
def grasps_move(cable):
    """Whether any grasp moves or was moved."""
    for g in range(cable.grasps):
        if moves(cable.inputs.motion[g]):
            return True
    return False


@kernel(void, CABLE, float64)
def set_held(cable, t):
    """Set the poses of the grasps in `work.held`, but for the twist, to those at time t."""
    for g in range(cable.grasps):
        m, held = cable.inputs.motion[g], cable.work.held[g]
        r = rotation_at(m, t)
        for k in range(9):
            held[ROTATION + k] = r[k]
        store_three(held, PLACE, place_by(m, t, r))
        store_three(held, AIM, direction_by(m, r))


@kernel(void, CABLE, float64)
def keep_frames(cable, t):
    """Count the twist angles of moving grasps from those in `work.held`, at time t, on."""
    for g in range(cable.grasps):
        m, held = cable.inputs.motion[g], cable.work.held[g]
        if moves(m):
            count_from(m, cable.state.frame[g], t, held, three(held, AIM), held[TWIST])


@inline
def set_held_rates(cable, t):
    """`set_held`, and the rates of the grasps, zero for those that do not move."""
    set_held(cable, t)
    for g in range(cable.grasps):
        m, held = cable.inputs.motion[g], cable.work.held[g]
        if not moves(m):
            for k in range(7):
                held[RATES + k] = 0.0
            continue
        v = rates(m, t, held, cable.state.frame[g])
        for k in range(7):
            held[RATES + k] = v[k]


@inline
def target_of(cable, k):
    """Target of a row or spring k whose direction does not turn: twist angle of its grasp in
    `work.held`, or a coordinate of its attachment point or direction; between strands the
    difference of twist angles that is untwisted (`bishop.follow_shape`), or 0.
    """
    line, g = cable.rows.line[k], cable.rows.grasp[k]
    if g < 0:
        return cable.state.anchor[k] if line == cable.dim else 0.0
    held = cable.work.held[g]
    if line == cable.dim:
        return held[TWIST]
    return held[(AIM if cable.rows.aims[k] else PLACE) + cable.axes[line]]


@kernel(void, CABLE, float64)
def set_targets(cable, t):
    """Set `work.held`, work.targets and the turning directions in work.ahead to those at time t."""
    rows, work = cable.rows, cable.work
    set_held(cable, t)
    for g in range(cable.grasps):
        held = work.held[g]
        held[TWIST] = prescribed_twist(cable.inputs.motion[g], cable.state.frame[g], t, held)
    for k in range(rows.count):
        share = cable.points.sum[rows.point[k]] if rows.grasp[k] >= 0 else 1.0
        if not turns(cable, k):
            work.targets[k] = share * target_of(cable, k)
            continue
        e, target = direction_of(cable, k), 0.0
        for d in range(cable.dim):
            axis = cable.axes[d]
            work.ahead[k, d] = component(e, axis)
            target += component(e, axis) * work.held[rows.grasp[k], PLACE + axis]
        work.targets[k] = share * target


@inline
def turn_rows(cable, t, out):
    """out = directions of the turning rows at time t."""
    set_held(cable, t)
    for k in range(cable.rows.count):
        if turns(cable, k):
            e = direction_of(cable, k)
            for d in range(cable.dim):
                out[k, d] = component(e, cable.axes[d])


@inline
def target_rates(cable, x, t):
    """work.rates = rates of the targets at time t, for the configuration x."""
    set_held_rates(cable, t)
    for k in range(cable.rows.count):
        cable.work.rates[k] = target_rate(cable, k, x) if cable.rows.grasp[k] >= 0 else 0.0


@inline
def target_rate(cable, k, x):
    """s e.A' - e'.(b.x - s A) of row k with attachment point A, direction e, s = sum of b."""
    line, point = cable.rows.line[k], cable.rows.point[k]
    share, held = cable.points.sum[point], cable.work.held[cable.rows.grasp[k]]
    if line == cable.dim:
        return share * held[RATES + 3]
    if line >= 0:
        return share * held[RATES + cable.axes[line]]
    e, spin = direction_of(cable, k), direction_rate(cable, k)
    rate = 0.0
    for d in range(cable.dim):
        axis = cable.axes[d]
        arm = point_value(cable, point, d, x) - share * held[PLACE + axis]
        rate += share * component(e, axis) * held[RATES + axis]
        rate -= component(spin, axis) * arm
    return rate


@kernel(void, CABLE, LINES, float64, LINES)
def add_velocity_of_held(cable, x, t, v):
    """v += Y (rates of the targets at time t), which makes w the velocity."""
    if grasps_move(cable):
        target_rates(cable, x, t)
        add_shifts(cable, 1.0, v)


@kernel(void, CABLE, float64)
def set_directions(cable, t):
    """Set the directions and the inverse of the state to those at time t."""
    if grasps_move(cable):
        set_targets(cable, t)
        if directions_turn(cable):
            take_directions(cable)


@kernel(void, CABLE, LINES, LINES, float64, float64)
def carry(cable, x, w, t, dt):
    """Drift over dt to time t: x += dt w, then x += Y (targets - B x).

    state.moved += displacement of the rows, the mean of those along the directions before and
    after. Where directions turn, the constraint impulses change the kinetic energy of w; this is
    added to the work of the grasps. dt = 0 is a jump: x only moves onto the constraints.
    """
    state, work = cable.state, cable.work
    moving = grasps_move(cable)
    turning = False
    energy = 0.0
    if moving:
        set_targets(cable, t)
        turning = directions_turn(cable)
        target_residuals(cable, work.ahead, x)
        add_moved(cable, 0.5 if turning else 1.0)
        if turning:
            energy = kinetic(cable, w)
            values_along(cable, x)
            add_moved(cable, -0.5)
    add(dt, w, x)
    if not moving:
        return
    target_residuals(cable, work.ahead, x)
    if turning and dt == 0.0:
        take_directions(cable)  # a jump uses the new directions
    elif turning:
        fill_system(cable, work.ahead, state.direction)
        invert(cable, state.inverse)
    add_shifts(cable, 1.0, x)
    if turning:
        if dt != 0.0:
            add_shifts(cable, 1.0 / dt, w)
        values_along(cable, x)
        add_moved(cable, 0.5)
        take_directions(cable)
        project(cable, w, work.multipliers)
        state.balance.drive_work += kinetic(cable, w) - energy
    for k in range(cable.rows.count):
        pin(cable, k, work.targets[k], x)


# -- work, and the rate of the projected velocity -----------------------------------------------


@inline
def add_moved(cable, share):
    """state.moved += share work.rates."""
    for k in range(cable.rows.count):
        cable.state.moved[k] += share * cable.work.rates[k]


@inline
def clear_moved(cable):
    """state.moved = 0."""
    for k in range(cable.rows.count):
        cable.state.moved[k] = 0.0


@inline
def pulled(cable, values):
    """state.pull . values: minus the work [J] of the grasps for displacements of the rows, minus
    their power [W] for rates.
    """
    sum_ = 0.0
    for k in range(cable.rows.count):
        sum_ += cable.state.pull[k] * values[k]
    return sum_


@inline
def direction_rates(cable, t):
    """Set work.ahead to e' of the turning rows; return whether any of them is not zero."""
    found = False
    set_held_rates(cable, t)
    for k in range(cable.rows.count):
        if not turns(cable, k):
            continue
        spin = direction_rate(cable, k)
        for d in range(cable.dim):
            rate = component(spin, cable.axes[d])
            cable.work.ahead[k, d] = rate
            found = found or rate != 0.0
    return found


@inline
def add_turning(cable, w, t, out):
    """out += P' v, for out = P M^-1 f and the directions at time t.

    work.multipliers must hold S^-1 B v, from `add_velocity_of_held`. Returns the power of the
    grasps w^T M P' v = - (B' w) . (S^-1 B v) [W].
    """
    work, power = cable.work, 0.0
    if not grasps_move(cable) or not direction_rates(cable, t):
        return power
    for k in range(cable.rows.count):
        if turns(cable, k):
            f = work.multipliers[k]
            shift_row(cable, k, work.ahead, -f, out)
            power -= f * row_value(cable, k, work.ahead, w)
    project(cable, out, work.multipliers)
    for k in range(cable.rows.count):
        work.rates[k] = row_value(cable, k, work.ahead, w) if turns(cable, k) else 0.0
    add_shifts(cable, -1.0, out)
    return power
