"""The wrench (force and moment) that a grasp exerts on the cable."""

from __future__ import annotations

from dlo_sim.compiling.lanes import LANES, first, load, shifted
from dlo_sim.compiling.pieces import MATRIX, NOTHING, REALS, WHOLE, part, piece
from dlo_sim.engine import layout
from dlo_sim.engine.bishop import edge, span_tangent
from dlo_sim.engine.bundles import CABLE, bared
from dlo_sim.engine.held import component3
from dlo_sim.engine.springs import rolls, spring_value, stiffness_of
from dlo_sim.engine.tables import (
    first_of_point,
    grasp_of,
    line_of,
    own_of,
    point_of,
    spring_first,
    spring_grasp,
    spring_line,
)


@part
def add_force(model, weights, points, begin, f, axis, about, out):
    """out += resultant of the forces b_k f along a world axis at four control points, and their
    moment about the point `about`.
    """
    following, last = (axis + 1) % 3, (axis + 2) % 3
    for k in range(4):
        force = f * model[weights + k * LANES]
        out[axis] += force
        out[3 + following] += force * (points[begin + k, last] - about[last])
        out[3 + last] -= force * (points[begin + k, following] - about[following])


@part
def add_moment(shape, f, t, out):
    """out += moment f about the unit vector t."""
    for d in range(shape[layout.DIM]):
        out[3 + shape[layout.AXES + d]] += f * component3(t, d)


@piece(NOTHING, CABLE, WHOLE, REALS, MATRIX, REALS, REALS)
def add_wrench(cable, grasp, rows, points, about, out):
    """out += force [N] and moment [N m] of a grasp on the cable, world axes, shape (6,).

    A held row with multiplier F (`rows`, one per held row; if empty REACTION, the mean over the
    last step) and direction e applies Q = F e to sum_k b_k x_k: the force (sum_k b_k) Q and the
    moment (sum_k b_k (x_k - x_e)) x Q about a point x_e (`about` [m], (3,); `points` [m], (n, 4)).
    A twist row is a moment about the tangent at its end. Springs contribute their present forces.
    """
    shape, model, _, state, _ = bared(cable)
    x = shifted(state, shape[layout.X])
    for k in range(shape[layout.HELD]):
        line, point = line_of(shape, k), point_of(shape, k)
        held = rows[k] if len(rows) else state[shape[layout.REACTION] + k * LANES]
        if grasp_of(shape, k) != grasp:
            continue
        weights = shape[layout.HELD_WEIGHTS] + layout.POINT_ROWS * LANES * point
        begin = first_of_point(shape, point)
        if line == shape[layout.DIM]:
            add_moment(shape, held, edge(shape, x, own_of(shape, point)), out)
        elif line >= 0:
            axis = shape[layout.AXES + line]
            add_force(model, weights, points, begin, held, axis, about, out)
        else:
            e = shape[layout.DIRECTION] + layout.DIRECTION_ROWS * LANES * k
            for d in range(shape[layout.DIM]):
                axis = shape[layout.AXES + d]
                f = held * state[e + d * LANES]
                add_force(model, weights, points, begin, f, axis, about, out)
    for k in range(shape[layout.SPRINGS]):
        if spring_grasp(shape, k) == grasp:
            apart = load(state, shape[layout.ANCHOR] + k * LANES) - spring_value(shape, model, k, x)
            f = first(stiffness_of(shape, model, k) * apart)
            if rolls(shape, k):
                xi = model[shape[layout.SPRING] + (layout.SPRING_ROWS * k + 6) * LANES]
                t = span_tangent(shape, model, x, spring_first(shape, k), xi)
                add_moment(shape, f, t, out)
                continue
            axis = shape[layout.AXES + spring_line(shape, k)]
            weights = shape[layout.SPRING] + layout.SPRING_ROWS * LANES * k
            add_force(model, weights, points, spring_first(shape, k), f, axis, about, out)
