"""The wrench (force and moment) that a grasp exerts on the cable."""

from __future__ import annotations

from numba import boolean, int64

from dlo_sim.compiling.groups import grid
from dlo_sim.compiling.kernels import ARRAY, ARRAY_2D, inline, kernel
from dlo_sim.engine.arrays import SLIDING, cable_at
from dlo_sim.engine.bishop import span_tangent
from dlo_sim.engine.frames import write_points
from dlo_sim.engine.grasps import component
from dlo_sim.engine.sliding import END, LOST, STIFFNESS, TURNING, basis_at, gaps
from dlo_sim.engine.springs import spring_value


@inline
def add_force(weights, points, begin, f, axis, about, out):
    """out += resultant of the forces b_k f along a world axis at four control points, and their
    moment about the point `about`.
    """
    following, last = (axis + 1) % 3, (axis + 2) % 3
    for k in range(4):
        force = f * weights[k]
        out[axis] += force
        out[3 + following] += force * (points[begin + k, last] - about[last])
        out[3 + last] -= force * (points[begin + k, following] - about[following])


@inline
def add_moment(cable, f, t, out):
    """out += moment f about the unit vector t, given by line."""
    for d in range(cable.dim):
        out[3 + cable.axes[d]] += f * component(t, d)


@kernel(boolean, int64, int64, ARRAY, ARRAY_2D, ARRAY, ARRAY)
def add_wrench(address, grasp, rows, points, about, out):
    """out += force [N] and moment [N m] of a grasp on the cable, world axes, shape (6,).

    A constraint row with multiplier F (`rows`, one for each; if empty the mean over the last two
    steps) and direction e applies Q = F e to sum_k b_k x_k: the force (sum_k b_k) Q and
    the moment (sum_k b_k (x_k - x_e)) x Q about a point x_e (`about` [m], (3,); if empty the end of
    the cable that the grasp holds). A row of the twist is a moment about the tangent there. Springs
    contribute their present forces. `points`: for `write_points`.

    Returns:
        Whether the reactions are known; if not, and none are given, nothing is added.
    """
    cable = cable_at(address)
    if len(rows) == 0 and cable.rows.count > 0 and cable.state.balance.reactions == 0.0:
        return False
    write_points(cable, points)
    if len(about) == 0:
        about = points[grasp * (cable.n - 1), :3]
    given, points, about, out = grid(rows), grid(points), grid(about), grid(out)
    rows, state, dim = cable.rows, cable.state, cable.dim
    for k in range(rows.count + rows.springs):
        if rows.grasp[k] != grasp:
            continue
        line, point = rows.line[k], rows.point[k]
        if k >= rows.count:
            force = rows.stiffness[k] * (state.anchor[k] - spring_value(cable, k, state.x))
        elif len(given) > 0:
            force = given[k]
        elif state.balance.reactions > 1.0:
            force = 0.5 * (state.reaction[k] + state.reaction_before[k])
        else:
            force = state.reaction[k]
        weights, begin = cable.points.weights[point], cable.points.first[point]
        if line == dim:
            add_moment(cable, force, span_tangent(cable, state.x, begin, rows.xi[k]), out)
        elif line >= 0:
            add_force(weights, points, begin, force, cable.axes[line], about, out)
        else:
            for d in range(dim):
                f = force * state.direction[k, d]
                add_force(weights, points, begin, f, cable.axes[d], about, out)
    add_slide_forces(cable, grasp, points, about, out)
    return True


@inline
def add_slide_forces(cable, grasp, points, about, out):
    """The part of a grasp that slides in `add_wrench`."""
    if cable.terms & SLIDING == 0:
        return
    for k in range(cable.slides.count):
        u = cable.state.slide[k]
        if cable.slides.grasp[k] != grasp or u == LOST:
            continue
        basis, law = basis_at(cable, u), cable.slides.law[k]
        a, b = gaps(cable, k, END, basis, cable.state.x)
        for d in range(cable.dim):
            f, axis = -law[STIFFNESS] * component(a, d), cable.axes[d]
            add_force(basis[1], points, basis[0], f, axis, about, out)
            f = -law[TURNING] * component(b, d)
            add_force(basis[2], points, basis[0], f, axis, about, out)
