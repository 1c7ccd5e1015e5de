"""Holonomic constraints of the grasps: held rows direction . sum_k b_k x_k = target.

A held point is four basis values b at a material coordinate (summing to 1 for a position, to 0 for
r'), or a single control point. A held row is a point, a grasp and a direction, which is an axis or
turns with the grasp. A fixed end is up to three rows at the first control point. A clamp has in
addition two rows at the second one, normal to its tangent; the distance along the tangent stays
free. A grasp along the cable has the same rows with basis values.

The mass matrix M is that of the free cable. With the matrix B of the held rows, Z = M^-1 B^T and
S = B Z, small and dense, Y = Z S^-1 is the motion of the cable due to unit motions of the rows, and
P = 1 - Y B projects onto motions that satisfy B v = 0. The momentum variable is w = P v: forces
act on it as P M^-1 f, and v = w + Y (rates of the targets). For rows of constant direction a drift
over dt is exactly x += dt w + Y (change of the targets). For turning directions, the constraint
impulses of a drift act along the directions at its start and satisfy the constraints at its end,
and w is projected with the directions at the end: RATTLE (Andersen 1983), symmetric, second order.
"""

from __future__ import annotations

from dlo_sim.compiling.lanes import LANES, first, load, store, zero
from dlo_sim.compiling.pieces import part
from dlo_sim.engine import layout
from dlo_sim.engine.grasps import MOTION_SIZE, place, turned
from dlo_sim.engine.tables import first_of_point, grasp_of, line_of, own_of, point_of


@part
def grasps_move(shape, inputs):
    """Whether any grasp moves or was moved."""
    for g in range(shape[layout.GRASPS]):
        if inputs[shape[layout.MOTION] + MOTION_SIZE * g] != 0.0:
            return True
    return False


@part
def point_value(shape, model, point, line, x):
    """sum_k b_k x_k of a held point on one line."""
    width, stride = shape[layout.LINE], shape[layout.STRIDE]
    own = own_of(shape, point)
    if own >= 0:
        return load(x, line * width + (layout.MARGIN + own) * stride)
    at = line * width + (layout.MARGIN + first_of_point(shape, point)) * stride
    weight = shape[layout.HELD_WEIGHTS] + layout.POINT_ROWS * LANES * point
    f = load(model, weight) * load(x, at)
    f += load(model, weight + LANES) * load(x, at + stride)
    f += load(model, weight + 2 * LANES) * load(x, at + 2 * stride)
    return f + load(model, weight + 3 * LANES) * load(x, at + 3 * stride)


@part
def row_value(shape, model, k, directions, at, x):
    """B_k x of row k; its direction, if it turns, is in `directions` from offset `at`."""
    point = point_of(shape, k)
    line = line_of(shape, k)
    if line >= 0:
        return point_value(shape, model, point, line, x)
    f = zero()
    for d in range(shape[layout.DIM]):
        to = at + (layout.DIRECTION_ROWS * k + d) * LANES
        f += load(directions, to) * point_value(shape, model, point, d, x)
    return f


@part
def shift_line(shape, model, point, line, scale, x):
    """x += scale M^-1 b of a held point, on one line."""
    width, stride = shape[layout.LINE], shape[layout.STRIDE]
    at, start = shape[layout.HELD_SHIFT] + width * point, layout.MARGIN * stride
    if stride == 1:
        factor = first(scale)
        for b in range(shape[layout.PARTS]):
            to = start + LANES * b
            store(x, line * width + to, load(x, line * width + to) + factor * load(model, at + to))
    else:
        for b in range(shape[layout.PARTS]):
            to = start + LANES * b
            store(x, line * width + to, load(x, line * width + to) + scale * load(model, at + to))


@part
def shift_row(shape, model, k, directions, at, scale, x):
    """x += scale Z_k, column k of Z = M^-1 B^T."""
    point = point_of(shape, k)
    line = line_of(shape, k)
    if line >= 0:
        shift_line(shape, model, point, line, scale, x)
        return
    for d in range(shape[layout.DIM]):
        to = at + (layout.DIRECTION_ROWS * k + d) * LANES
        shift_line(shape, model, point, d, scale * load(directions, to), x)


@part
def through_inverse(shape, matrix, at, values, scale, out, to):
    """Write scale times the matrix at `at` times the rows RATES of `values` to `out` at `to`."""
    held = shape[layout.HELD]
    for k in range(held):
        f = zero()
        for j in range(held):
            f += load(matrix, at + (held * k + j) * LANES) * load(
                values, shape[layout.RATES] + j * LANES
            )
        store(out, to + k * LANES, scale * f)


@part
def add_shifts(shape, model, state, scratch, scale, x):
    """x += scale Y RATES."""
    through_inverse(
        shape, state, shape[layout.INVERSE], scratch, scale, scratch, shape[layout.SYSTEM]
    )
    for k in range(shape[layout.HELD]):
        f = load(scratch, shape[layout.SYSTEM] + k * LANES)
        shift_row(shape, model, k, state, shape[layout.DIRECTION], f, x)


@part
def project(shape, model, state, scratch, x, out, to):
    """x <- P x. The rows of `out` at `to` get the multipliers S^-1 B x."""
    held, directions = shape[layout.HELD], shape[layout.DIRECTION]
    values_along(shape, model, state, scratch, x)
    through_inverse(shape, state, shape[layout.INVERSE], scratch, 1.0, out, to)
    for k in range(held):
        shift_row(shape, model, k, state, directions, -load(out, to + k * LANES), x)
    for k in range(held):
        pin(shape, k, zero(), x)


@part
def pin(shape, k, value, x):
    """Set the coordinate exactly if row k fixes one coordinate of a control point."""
    line = line_of(shape, k)
    own = own_of(shape, point_of(shape, k))
    if line >= 0 and own >= 0:
        stride = shape[layout.STRIDE]
        at = line * shape[layout.LINE] + (layout.MARGIN + own) * stride
        if stride == 1:
            x[at] = first(value)
        else:
            store(x, at, value)


@part
def set_targets(shape, model, inputs, state, scratch, t):
    """Write the targets and directions of all rows at time t to TARGETS and AHEAD."""
    dim = shape[layout.DIM]
    for k in range(shape[layout.HELD]):
        point = point_of(shape, k)
        line = line_of(shape, k)
        grasp = shape[layout.MOTION] + MOTION_SIZE * grasp_of(shape, k)
        share = model[shape[layout.HELD_WEIGHTS] + (layout.POINT_ROWS * point + 4) * LANES]
        a = place(inputs, grasp, t)
        if line == dim:
            angle = zero() + a[3]
            if shape[layout.TERMS] & layout.BISHOP:
                angle += load(state, shape[layout.FRAME_TURN] + grasp_of(shape, k) * LANES)
            store(scratch, shape[layout.TARGETS] + k * LANES, share * angle)
        elif line >= 0:
            store(
                scratch,
                shape[layout.TARGETS] + k * LANES,
                share * component(a, shape[layout.AXES + line]),
            )
        else:
            body = shape[layout.HELD_BODY] + layout.DIRECTION_ROWS * LANES * k
            v = turned(inputs, grasp, t, model[body], model[body + LANES], model[body + 2 * LANES])
            target = 0.0
            for d in range(dim):
                axis = shape[layout.AXES + d]
                to = shape[layout.AHEAD] + (layout.DIRECTION_ROWS * k + d) * LANES
                store(scratch, to, component3(v, axis))
                target += component3(v, axis) * component(a, axis)
            store(scratch, shape[layout.TARGETS] + k * LANES, share * target)


@part
def component(a, axis):
    """Entry `axis` of a tuple of four, of which it is one of the first three."""
    return a[0] if axis == 0 else (a[1] if axis == 1 else a[2])


@part
def component3(a, axis):
    """Entry `axis` of a tuple of three."""
    return a[0] if axis == 0 else (a[1] if axis == 1 else a[2])


@part
def directions_turn(shape, state, scratch):
    """Whether the directions AHEAD differ from those of the state."""
    for k in range(shape[layout.HELD]):
        if line_of(shape, k) < 0:
            for d in range(shape[layout.DIM]):
                at = (layout.DIRECTION_ROWS * k + d) * LANES
                if state[shape[layout.DIRECTION] + at] != scratch[shape[layout.AHEAD] + at]:
                    return True
    return False


@part
def alignment(shape, k, j, a, at_a, b, at_b):
    """Direction of row k in `a` . direction of row j in `b`; 0 between space and twist."""
    line_k = line_of(shape, k)
    line_j = line_of(shape, j)
    to_k, to_j = at_a + layout.DIRECTION_ROWS * LANES * k, at_b + layout.DIRECTION_ROWS * LANES * j
    dim = shape[layout.DIM]
    if line_k >= 0 and line_j >= 0:
        return zero() + (1.0 if line_k == line_j else 0.0)
    if line_k == dim or line_j == dim:
        return zero()
    if line_k >= 0:
        return load(b, to_j + line_k * LANES)
    if line_j >= 0:
        return load(a, to_k + line_j * LANES)
    f = zero()
    for d in range(dim):
        f += load(a, to_k + d * LANES) * load(b, to_j + d * LANES)
    return f


@part
def fill_system(shape, model, scratch, a, at_a, b, at_b):
    """Write S = B M^-1 B^T to SYSTEM, with directions `a` on the left and `b` on the right."""
    held = shape[layout.HELD]
    for k in range(held):
        p = point_of(shape, k)
        for j in range(held):
            q = point_of(shape, j)
            product = load(
                model, shape[layout.HELD_PRODUCT] + (shape[layout.POINTS] * p + q) * LANES
            )
            f = product * alignment(shape, k, j, a, at_a, b, at_b)
            store(scratch, shape[layout.SYSTEM] + (held * k + j) * LANES, f)


@part
def invert(shape, scratch, out, to):
    """Write the inverse of SYSTEM to `out` at `to`; SYSTEM is overwritten.

    Gauss-Jordan elimination without pivoting: S is close to symmetric positive definite.
    """
    held, at = shape[layout.HELD], shape[layout.SYSTEM]
    for k in range(held * held):
        store(out, to + k * LANES, 0.0)
    for k in range(held):
        store(out, to + (held + 1) * k * LANES, 1.0)
    for k in range(held):
        inverse = 1.0 / load(scratch, at + (held + 1) * k * LANES)
        for j in range(held):
            one = (held * k + j) * LANES
            store(scratch, at + one, load(scratch, at + one) * inverse)
            store(out, to + one, load(out, to + one) * inverse)
        for i in range(held):
            if i != k:
                factor = load(scratch, at + (held * i + k) * LANES)
                for j in range(held):
                    one, other = (held * k + j) * LANES, (held * i + j) * LANES
                    f = load(scratch, at + other) - factor * load(scratch, at + one)
                    store(scratch, at + other, f)
                    store(out, to + other, load(out, to + other) - factor * load(out, to + one))


@part
def take_directions(shape, model, state, scratch):
    """DIRECTION = AHEAD, and INVERSE for these directions."""
    for at in range(shape[layout.HELD] * layout.DIRECTION_ROWS * LANES):
        state[shape[layout.DIRECTION] + at] = scratch[shape[layout.AHEAD] + at]
    directions = shape[layout.DIRECTION]
    fill_system(shape, model, scratch, state, directions, state, directions)
    invert(shape, scratch, state, shape[layout.INVERSE])


@part
def target_residuals(shape, model, directions, at, scratch, x):
    """RATES = TARGETS - B x, the constraint residuals, with the directions at `at`."""
    for k in range(shape[layout.HELD]):
        f = load(scratch, shape[layout.TARGETS] + k * LANES) - row_value(
            shape, model, k, directions, at, x
        )
        store(scratch, shape[layout.RATES] + k * LANES, f)


@part
def values_along(shape, model, state, scratch, x):
    """RATES = B x with the directions of the state."""
    for k in range(shape[layout.HELD]):
        f = row_value(shape, model, k, state, shape[layout.DIRECTION], x)
        store(scratch, shape[layout.RATES] + k * LANES, f)
