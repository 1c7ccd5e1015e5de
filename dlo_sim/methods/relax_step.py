"""A step of the search for an equilibrium (`simulation.statics`): of the gradient flow
    M ((q1 - q0) / s + G (q1 - qb)) = f(q1),
by backward Euler with the pseudo-time s, mass matrix M and forces f. A guide G hardly lets the
cable move along some directions from the shape qb in which the search began. Newton's method has
the tension as an unknown of its own (`engine.tension`).

With twist that acts on the shape all lines are found together, where the Bishop frame follows the
shape at every iterate. A correction of the twist is one of the material frame against the shape
that is corrected, so that the matrix is that of an energy, whose positive definiteness says whether
the cable is stable.
"""

from __future__ import annotations

from numba import boolean, float64, int64, void

from dlo_sim.compiling.groups import grid
from dlo_sim.compiling.kernels import ARRAY, ARRAY_2D, NO, YES, inline, kernel
from dlo_sim.compiling.lanes import where, zero
from dlo_sim.engine import roll
from dlo_sim.engine.arrays import (
    BETWEEN,
    BISHOP,
    CABLE,
    LINES,
    MARGIN,
    MATERIAL,
    PADDING,
    cable_at,
)
from dlo_sim.engine.assembly import all_forces
from dlo_sim.engine.band import (
    add_line,
    to_lines,
    to_unknowns,
)
from dlo_sim.engine.bishop import follow_shape, tau_between
from dlo_sim.engine.border import (
    solve_constrained,
)
from dlo_sim.engine.lines import add_product, clear, copy
from dlo_sim.engine.loads import add_load_stiffness, load_force
from dlo_sim.engine.natural_curvature import follow_natural
from dlo_sim.engine.spans import (
    add_sample,
    belongs,
    bending_at,
    blocks_of,
    curve,
    scatter_lines,
    tangent_at,
)
from dlo_sim.engine.tension import predict_tension
from dlo_sim.methods.between_steps import factorize_at_rest, set_stiffness

MAX_ITERATIONS = 12
CONVERGED, EXACT = 1e-4, 1e-12  # last correction: share of that of the step, or of the length
# The same with twist: frames are known to a few per cent where a span bends sharply.
LOOSE, NEAR = 1e-2, 1e-10
SPIN = 0.16  # of the length: radius of gyration of the twist in pseudo-time


GIVEN = int64, float64, ARRAY_2D, ARRAY_2D, ARRAY, float64, boolean, boolean


@kernel((int64, float64), *GIVEN, family=BETWEEN)
def relax_step(address, pseudo, guide, begun, anchors, length, twist, rolls):
    """One step of pseudo-time `pseudo` [s^2] in place.

    Args:
        guide: G by lines [1/s^2], zero for none. begun: configuration at the start of the search.
        anchors: of the springs there. length: of the cable [m]. twist: whether to find the twist,
            too. rolls: what holds the roll turns with the Bishop frame: the twist angles there, and
            the anchors, are those at the start of the search.

    Returns:
        Iterations, 0 if Newton's method did not converge and the state is useless; and the largest
        move, as a share of the length, or an angle [rad].
    """
    cable = cable_at(address)
    x, work, state = cable.state.x, cable.work, cable.state
    converged, exact = (LOOSE, NEAR) if twist else (CONVERGED, EXACT)
    lines = cable.lines if twist else cable.dim
    copy(x, work.start)
    clear(work.change)
    for iteration in range(1, MAX_ITERATIONS + 1):
        known = iteration > 1
        if not correct(address, pseudo, grid(guide), grid(begun), length, known, twist, rolls):
            break
        for d in range(cable.dim):
            for c in range(cable.columns):
                work.v0[d, c] = 2.0 * work.nudge[d, c]
        predict_tension(cable, x, x, work.v0, 1.0)
        for d in range(lines):
            for c in range(cable.columns):
                x[d, c] += work.nudge[d, c]
                work.change[d, c] += work.nudge[d, c]
        moved = size_of(cable, work.change, lines, length)
        last = size_of(cable, work.nudge, lines, length)
        if not moved < 1e3:
            break
        if twist:
            follow_shape(cable, 0.0)
        else:
            if cable.terms & MATERIAL:
                follow_natural(cable, x)
            if cable.terms & BISHOP:
                copy(x, state.reference)
            roll.follow(cable, NO)
        for k in range(cable.rows.joints, cable.rows.springs if rolls else 0):
            at = cable.rows.count + k
            state.anchor[at] = state.anchor_counted[at] = anchors[k]
        if last <= converged * moved or last < exact:
            return iteration, moved
    return 0, 0.0


@kernel(boolean, *GIVEN, family=BETWEEN)
def is_stable(address, pseudo, guide, begun, anchors, length, twist, rolls):
    """Whether the matrix of such a step at the present shape is positive."""
    clear(cable_at(address).work.change)
    return correct(address, pseudo, grid(guide), grid(begun), length, NO, twist, NO)


@inline
def size_of(cable, change, lines, length):
    """Largest entry, as a share of the length or in radians."""
    largest = 0.0
    for d in range(lines):
        scale = 1.0 / length if d < cable.dim else 1.0
        for c in range(cable.columns):
            entry = scale * abs(change[d, c])
            if not entry <= largest:  # not a number, either
                largest = entry
    return largest


@kernel(boolean, int64, float64, LINES, LINES, float64, boolean, boolean, boolean, family=BETWEEN)
def correct(address, pseudo, guide, begun, length, predicted, twist, rolls):
    """Set `work.nudge` to Newton's correction; returns whether it exists and leads downhill.

    Args: see `relax_step`. predicted: whether the tension is the one that the last correction
        predicted. `work.change`: the move in this step so far, of the twist that against the shape.
    """
    cable = cable_at(address)
    work, band = cable.work, cable.work.band
    set_stiffness(cable, predicted, twist)
    add_load_stiffness(cable, cable.state.x, 0.0, 1.0, band)
    add_inertia(cable, pseudo, guide)
    if twist:
        add_line(cable, cable.dim, cable.linear.mass[0], spin(length, pseudo), band)
    if rolls:
        keep_columns(cable)
    exist, negative = factorize_at_rest(cable, twist)
    if not exist or negative != 0:
        return False
    set_force(cable, pseudo, guide, begun, length, twist)
    solve_lines(cable, work.force, YES, work.nudge)
    if rolls:
        turn_held(cable, begun)
    finite = True
    for d in range(cable.lines):
        for i in range(cable.n):
            value = work.nudge[d, MARGIN + i]
            finite = finite and value - value == 0.0
    return finite


@inline
def spin(length, pseudo):
    """Inertia of the twist over the pseudo-time, as a factor of the mass."""
    return (SPIN * length) * (SPIN * length) / pseudo


@kernel(void, CABLE, LINES, boolean, LINES, family=BETWEEN)
def solve_lines(cable, push, closes, out):
    """out = solution for the right-hand side `push` with the factors of `correct`, with the rows of
    the grasps kept, and if it `closes` their gaps closed; both are lines.
    """
    z, directions = cable.work.residual, cable.state.direction
    to_unknowns(cable, push, z)
    solve_constrained(cable, cable.work.band, directions, directions, closes, z)
    clear(out)
    to_lines(cable, z, PADDING, out)


@inline
def set_force(cable, pseudo, guide, begun, length, twist):
    """force = f(q1) - M ((q1 - q0) / s + G (q1 - qb))."""
    work, x, dim = cable.work, cable.state.x, cable.dim
    f, rate, mass = work.force, work.rate, cable.linear.mass[0]
    all_forces(cable, x, f)
    load_force(cable, x, 0.0, f)
    for c in range(cable.columns):
        for d in range(dim):
            rate[d, c] = work.change[d, c] / pseudo
            for e in range(dim):
                rate[d, c] += guide[d, e] * (x[e, c] - begun[e, c])
        if twist:
            rate[dim, c] = spin(length, pseudo) * work.change[dim, c]
        elif cable.lines > dim:
            f[dim, c] = 0.0
    for d in range(cable.lines if twist else dim):
        add_product(mass, -1.0, rate[d], f[d])


@inline
def add_inertia(cable, pseudo, guide):
    """band += M (1 / s + G)."""
    dim, lines, n = cable.dim, cable.lines, cable.n
    mass, band = cable.linear.mass[0], cable.work.band
    for k in range(7):
        for i in range(max(3 - k, 0), min(n, n + 3 - k)):
            for d in range(dim):
                for e in range(dim):
                    share = guide[d, e] + (1.0 / pseudo if d == e else 0.0)
                    column = (k + 1) * lines + e - d - 1
                    band[i * lines + d, column] += share * mass[k, MARGIN + i]


# -- what holds the roll ---------------------------------------------------------------------------


@inline
def holds_roll(cable, row):
    """Whether a grasp prescribes a twist angle by this row; else it may be between strands."""
    return cable.rows.line[row] == cable.dim and cable.rows.grasp[row] >= 0


@inline
def keep_columns(cable):
    """Keep the columns of the matrix that belong to twist angles which grasps prescribe."""
    work, lines, half = cable.work, cable.lines, 4 * cable.lines - 1
    for row in range(cable.rows.count):
        if holds_roll(cable, row):
            c = lines * cable.points.own[cable.rows.point[row]] + cable.dim
            for r in range(cable.n * lines):
                near = abs(c - r) <= half
                work.columns[row, r] = work.band[r, c - r + half] if near else 0.0


@kernel(void, CABLE, LINES, terms=BISHOP, family=BETWEEN)
def turn_held(cable, begun):
    """Let what holds the roll turn with the Bishop frame, in the correction `work.nudge`, so that
    the twist angles there are those of `begun`. What holds the roll farther along the cable does
    not turn the frame here, so that one after the other is found.
    """
    work, theta, dim = cable.work, cable.state.x[cable.dim], cable.dim
    nudge, frame, push, answer = work.nudge, work.load, work.force, work.inertia
    for row in range(cable.rows.count):
        if not holds_roll(cable, row):
            continue
        own = cable.points.own[cable.rows.point[row]]
        turn_of_frame(cable, own, frame)
        to_lines(cable, work.columns[row], 0, push)
        for d in range(cable.lines):
            for c in range(cable.columns):
                push[d, c] = -push[d, c]
        solve_lines(cable, push, NO, answer)
        answer[dim, MARGIN + own] = 1.0
        missing, share = begun[dim, MARGIN + own] - theta[MARGIN + own], 1.0
        for d in range(dim):
            for c in range(cable.columns):
                missing -= frame[d, c] * nudge[d, c]
                share += frame[d, c] * answer[d, c]
        for d in range(cable.lines):
            for c in range(cable.columns):
                nudge[d, c] += missing / share * answer[d, c]


@inline
def turn_of_frame(cable, own, out):
    """out = derivative of the angle of the Bishop frame at an end, control point `own`, by the
    shape: integral of G (`engine.bishop`) from the start of its strand.
    """
    mesh, number = cable.mesh, cable.mesh.branch[own]
    begin, end = blocks_of(cable, number)
    clear(out)
    for b in range(begin, end if own > mesh.strand[number, 0] else begin):
        p, s, here = curve(cable, cable.state.x, b, 1.0), mesh.slope[b], belongs(cable, b, number)
        g0 = g1 = g2 = (zero(), zero(), zero())
        for j in range(cable.samples):
            xi, w = mesh.xi[b, j], where(here, mesh.weight[b, j], 0.0)
            t, k = tangent_at(p, xi), bending_at(p, xi, s)
            g = tau_between(t, k, t, k)[1]
            g0 = add_sample(g0, w * g[0], zero(), xi)
            g1 = add_sample(g1, w * g[1], zero(), xi)
            g2 = add_sample(g2, w * g[2], zero(), xi)
        scatter_lines(cable, b, g0, g1, g2, 1.0, out)
