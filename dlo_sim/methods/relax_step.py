"""A step of the search for an equilibrium (`simulation.statics`): of the gradient flow
    M ((q1 - q0) / s + G (q1 - qb)) = f(q1),
by backward Euler with the pseudo-time s, mass matrix M and forces f. A guide G hardly lets the
cable move along some directions from the shape qb in which the search began. Newton's method has
the tension as an unknown of its own (`engine.tension`).

With twist that acts on the shape all lines are found together, where the Bishop frame follows the
shape at every iterate. A correction of the twist is one of the material frame against the shape
that is corrected, so that shape and twist of each control point act on its neighbours only, and
the matrix is that of an energy, whose positive definiteness says whether the cable is stable. What
couples twist and shape is differentiated numerically, which costs as many evaluations of the forces
for any number of points. The unknowns are ordered by control point, as in `engine.rolling`.
"""

from __future__ import annotations

from numba import boolean, float64, int64, void

from dlo_sim.compiling.groups import grid
from dlo_sim.compiling.kernels import ARRAY, ARRAY_2D, NO, YES, inline, kernel
from dlo_sim.engine.arrays import (
    BETWEEN,
    BISHOP,
    CABLE,
    CURVED,
    IN_ROLLING_BAND,
    IN_STATE,
    LINES,
    MARGIN,
    MATERIAL,
    PADDING,
    PLASTICITY,
    cable_at,
)
from dlo_sim.engine.assembly import all_forces
from dlo_sim.engine.band import (
    bordered,
    clear_band,
    clear_held,
    eliminate,
    hold,
    keep_border,
    set_border,
    solve_border,
    spread,
    stiffen_border,
    substitute,
    turn_vector,
)
from dlo_sim.engine.bishop import follow_shape
from dlo_sim.engine.bishop import force as bishop_force
from dlo_sim.engine.lines import add, add_product, clear, copy
from dlo_sim.engine.loads import add_load_stiffness, load_force
from dlo_sim.engine.natural_curvature import follow_natural, natural_force
from dlo_sim.engine.rolling import (
    FOUR,
    HALF,
    copy_shape,
    copy_twist,
    hold_couplings,
    substitute_with_twist,
)
from dlo_sim.engine.spans import store_three, three
from dlo_sim.engine.springs import add_roll_stiffness
from dlo_sim.engine.tension import predict_tension
from dlo_sim.methods.between_steps import set_stiffness
from dlo_sim.terms.vectors import combined

MAX_ITERATIONS = 12
CONVERGED, EXACT = 1e-4, 1e-12  # last correction: share of that of the step, or of the length
# The same with twist: frames are known to a few per cent where a span bends sharply.
LOOSE, NEAR = 1e-2, 1e-10
SMALL = 1e-4  # spans, and radians: steps of finite differences
SPIN = 0.16  # of the length: radius of gyration of the twist in pseudo-time
COLOURS = 7  # control points that far apart do not act on each other


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
            follow_shape(cable)
        else:
            if cable.terms & MATERIAL:
                follow_natural(cable, x)
            if cable.terms & BISHOP:
                copy(x, state.reference)
        for k in range(len(state.anchor) if rolls else 0):
            state.anchor[k] = anchors[k]
        for k in range(len(state.frame_turn) if rolls or not twist else 0):
            state.frame_turn[k] = 0.0
        if last <= converged * moved or last < exact:
            clear(work.nudge)  # a step in time leaves the line of the twist zero
            return iteration, moved
    clear(work.nudge)
    return 0, 0.0


@kernel(boolean, *GIVEN, family=BETWEEN)
def is_stable(address, pseudo, guide, begun, anchors, length, twist, rolls):
    """Whether the matrix of such a step at the present shape is positive."""
    work = cable_at(address).work
    clear(work.change)
    stable = correct(address, pseudo, grid(guide), grid(begun), length, NO, twist, NO)
    clear(work.nudge)
    return stable


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
    work, dim, size = cable.work, cable.dim, cable.n * cable.dim
    band, directions, x = work.band, cable.state.direction, cable.state.x
    if twist:
        set_natural_aside(cable, YES)
    set_stiffness(cable, predicted)
    if twist:
        set_natural_aside(cable, NO)
        couple(cable, length, (SPIN * length) * (SPIN * length) / pseudo)
    else:
        add_load_stiffness(cable, x, 0.0, 1.0, band)
    add_inertia(cable, pseudo, guide)
    hold(cable, directions, directions, band)
    set_border(cable, directions, directions)
    stiffen_border(cable, band)
    work.results.coupled = IN_ROLLING_BAND if twist else IN_STATE
    if twist:
        if not eliminate_twist(cable) or negative(work.rolling_band, FOUR * cable.n, HALF):
            return False
    elif not eliminate(band, size, dim) or negative(band, size, 4 * dim - 1):
        return False
    solve_border(cable, band, 1.0)
    set_force(cable, pseudo, guide, begun, length, twist)
    solve_lines(cable, work.force, twist, work.nudge)
    if rolls:
        turn_held(cable, begun, length)
    finite = True
    for d in range(dim):
        for i in range(cable.n):
            value = work.nudge[d, MARGIN + i]
            finite = finite and value - value == 0.0
    return finite


@kernel(void, CABLE, LINES, boolean, LINES, family=BETWEEN)
def solve_lines(cable, push, twist, out):
    """out = solution for the right-hand side `push` with the factors of `correct`, with the rows of
    the grasps kept; both are lines.
    """
    work, dim, z = cable.work, cable.dim, cable.work.residual
    band, directions, count = work.band, cable.state.direction, cable.n * cable.dim
    for d in range(dim):
        for i in range(cable.n):
            z[PADDING + i * dim + d] = push[d, MARGIN + i]
    turn_vector(cable, directions, YES, z, PADDING)
    clear_held(cable, z, PADDING)
    clear(out)
    if twist:
        for r in range(count):
            work.unbalanced[r] = z[PADDING + r]
        substitute_with_twist(cable, push, z, out)
        if bordered(cable):  # solve once more, with the forces of these rows
            keep_border(cable, z)  # sets `border_value`
            for r in range(count):
                z[PADDING + r] = work.unbalanced[r]
            for k in range(bordered(cable)):
                pull = 0.0
                for j in range(bordered(cable)):
                    pull += work.border_system[k, j] * work.border_value[j]
                spread(cable, work.border_force, k, -pull, z, PADDING)
            clear(out)
            substitute_with_twist(cable, push, z, out)
    else:
        substitute(band, count, dim, z)
        keep_border(cable, z)
    turn_vector(cable, directions, NO, z, PADDING)
    for d in range(dim):
        for i in range(cable.n):
            out[d, MARGIN + i] = z[PADDING + i * dim + d]


@inline
def negative(band, size, half):
    """Whether a pivot is negative; the factors have 1 / pivot."""
    for r in range(size):
        if band[r, half] < 0.0:
            return True
    return False


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
            rate[dim, c] = (SPIN * length) * (SPIN * length) / pseudo * work.change[dim, c]
    for d in range(cable.lines if twist else dim):
        add_product(mass, -1.0, rate[d], f[d])


@inline
def add_inertia(cable, pseudo, guide):
    """band += M (1 / s + G)."""
    dim, n, mass, band = cable.dim, cable.n, cable.linear.mass[0], cable.work.band
    for k in range(7):
        for i in range(max(3 - k, 0), min(n, n + 3 - k)):
            for d in range(dim):
                for e in range(dim):
                    share = guide[d, e] + (1.0 / pseudo if d == e else 0.0)
                    column = (k - 3) * dim + e - d + 4 * dim - 1
                    band[i * dim + d, column] += share * mass[k, MARGIN + i]


# -- with twist ------------------------------------------------------------------------------------


@inline
def set_natural_aside(cable, aside):
    """Let the natural and plastic curvature have no part in the stiffness, or again a part."""
    if not cable.terms & CURVED:
        return
    natural, kept, mesh = cable.state.natural, cable.work.coupling, cable.mesh
    for b in range(cable.blocks):
        for j in range(cable.samples):
            if not aside:
                store_three(natural[b, j], 0, three(kept[b, j], 0))
                continue
            n = three(natural[b, j], 0)
            store_three(kept[b, j], 0, n)
            less = combined(0.0, n, 0.0, n)
            if cable.terms & PLASTICITY:  # of the sum (`natural_curvature.natural_with`)
                p = three(cable.state.plastic[b, j], 0)
                less = combined(-mesh.weight[b, j] * mesh.bending[b], p, 0.0, p)
            store_three(natural[b, j], 0, less)


@inline
def coupled_forces(cable, out):
    """Forces that couple the twist to the shape."""
    x = cable.state.x
    clear(out)
    natural_force(cable, x, x, YES, YES, out)
    load_force(cable, x, 0.0, out)
    bishop_force(cable, x, x, out)


@kernel(void, CABLE, float64, float64, terms=BISHOP, family=BETWEEN)
def couple(cable, length, spin):
    """Minus the derivatives of `coupled_forces` by all lines, as central differences: add those of
    the shape to `work.band`, set `work.twist_matrix` to that of the twist, with all its stiffness
    and its inertia `spin` times the mass, and `work.rolling_band` to what couples the two.
    """
    work, x, dim, n = cable.work, cable.state.x, cable.dim, cable.n
    twist, there, more, less = work.twist_matrix, work.middle, work.v0, work.v1
    mass, own = cable.linear.mass[0], cable.linear.twist
    for k in range(4):
        for i in range(n - k):
            twist[k, i] = own[3 + k, MARGIN + i] + spin * mass[3 + k, MARGIN + i]
    add_roll_stiffness(cable, twist)
    clear_band(work.rolling_band)
    copy(x, there)
    for line in range(dim + 1):
        step = SMALL if line == dim else SMALL * length / (n - 3)
        for colour in range(min(COLOURS, n)):
            for side in range(2):
                for c in range(MARGIN + colour, MARGIN + n, COLOURS):
                    x[line, c] = there[line, c] + (step if side == 0 else -step)
                coupled_forces(cable, more if side == 0 else less)
            for c in range(MARGIN + colour, MARGIN + n, COLOURS):
                x[line, c] = there[line, c]
            for j in range(colour, n, COLOURS):
                for i in range(max(j - 3, 0), min(j + 4, n)):
                    for e in range(dim + 1):
                        value = (less[e, MARGIN + i] - more[e, MARGIN + i]) / (2.0 * step)
                        add_entry(cable, i, e, j, line, value)


@inline
def add_entry(cable, i, e, j, line, value):
    """Add an entry between line e of control point i and another line of control point j."""
    dim, work = cable.dim, cable.work
    if e < dim and line < dim:
        work.band[i * dim + e, (j - i) * dim + line - e + 4 * dim - 1] += value
    elif e < dim or line < dim:
        work.rolling_band[FOUR * i + e, FOUR * (j - i) + line - e + HALF] = value
    elif i >= j:
        work.twist_matrix[i - j, j] += value


@kernel(boolean, CABLE, terms=BISHOP, family=BETWEEN)
def eliminate_twist(cable):
    """`work.rolling_band` = LU factors of the matrix of all lines; whether they exist."""
    work, directions, rows = cable.work, cable.state.direction, cable.rows
    for i in range(cable.n):
        work.twist_held[i] = 0.0
    for row in range(rows.count):
        if rows.line[row] == cable.dim:
            work.twist_held[cable.points.own[rows.point[row]]] = 1.0
    copy_shape(cable, work.band, work.rolling_band)
    hold_couplings(cable, directions, directions, work.rolling_band)
    copy_twist(cable, work.rolling_band)
    return eliminate(work.rolling_band, FOUR * cable.n, FOUR)


@kernel(void, CABLE, LINES, float64, terms=BISHOP, family=BETWEEN)
def turn_held(cable, begun, length):
    """Let what holds the roll turn with the Bishop frame, in the correction `work.nudge`, so that
    the twist angles there are those of `begun`. What holds the roll farther along the cable does
    not turn the frame here, so that one after the other is found.
    """
    work, x, dim, n = cable.work, cable.state.x, cable.dim, cable.n
    nudge, frame, push, answer = work.nudge, work.load, work.force, work.inertia
    for row in range(cable.rows.count):
        if cable.rows.line[row] != dim:
            continue
        k = cable.points.own[cable.rows.point[row]]
        turn_of_frame(cable, k, length, frame)
        theta = x[dim, MARGIN + k]
        x[dim, MARGIN + k] = theta + SMALL
        coupled_forces(cable, work.v0)
        x[dim, MARGIN + k] = theta - SMALL
        coupled_forces(cable, work.v1)
        x[dim, MARGIN + k] = theta
        for c in range(cable.columns):
            for d in range(dim):
                push[d, c] = (work.v0[d, c] - work.v1[d, c]) / (2.0 * SMALL)
            push[dim, c] = 0.0
        for i in range(max(k - 3, 0), min(k + 4, n)):
            push[dim, MARGIN + i] = -work.twist_matrix[abs(i - k), min(i, k)]
        solve_lines(cable, push, YES, answer)
        answer[dim, MARGIN + k] = 1.0
        missing, share = begun[dim, MARGIN + k] - theta, 1.0
        for d in range(dim):
            for c in range(cable.columns):
                missing -= frame[d, c] * nudge[d, c]
                share += frame[d, c] * answer[d, c]
        for d in range(dim + 1):
            for c in range(cable.columns):
                nudge[d, c] += missing / share * answer[d, c]


@inline
def turn_of_frame(cable, k, length, out):
    """out = derivative of the angle of the Bishop frame at control point k by the shape: minus the
    force on it of a unit twisting moment up to there.
    """
    theta, kept, ends = (
        cable.state.x[cable.dim],
        cable.work.middle[cable.dim],
        cable.linear.greville,
    )
    for c in range(cable.columns):
        kept[c] = theta[c]
    for c in range(MARGIN, MARGIN + cable.n):
        theta[c] = -min(ends[c], ends[MARGIN + k]) * length / cable.physics.GJ
    clear(out)
    bishop_force(cable, cable.state.x, cable.state.x, out)
    clear(cable.work.v0)
    for c in range(MARGIN, MARGIN + cable.n):
        theta[c] = 0.0
    bishop_force(cable, cable.state.x, cable.state.x, cable.work.v0)
    add(-1.0, cable.work.v0, out)
    for c in range(cable.columns):
        theta[c] = kept[c]
