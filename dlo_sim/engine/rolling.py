"""Friction that rolls a cable about its axis: its moment, and twist and shape in one matrix.

A cable that twists in space turns about its axis by phi at a sample that touches, which friction
sees as a motion - phi l of its surface with the lever l (`engine.contact`). It turns the cable by
the moment m = - l.f per length, with the derivative - l.S l (`engine.contact_law`).

`contact.add_force` leaves the trial force at an iterate of the shape in `work.touch`, without the
spin of the cable in this step. Then `methods.twist_step` solves for the twist with the moments, and
at last `push_rolling` adds the friction.

A sample that sticks ties the spin to the motion of the axis, as a wheel. Newton's method for the
shape must know that the twist follows, so its matrix K - C D^-1 R is that of the shape with the
twist eliminated, with the matrix D of the twist and the couplings
    C = - dF/dtheta = - S l,   R = - dm/dr = - l.(-df/dr).
It is never formed: unknowns are ordered by control point, three of the shape and one of the twist,
in a band, and the solution for a right-hand side (r, 0) is that in the unknowns of the shape.
"""

from __future__ import annotations

from numba import boolean, void

from dlo_sim.compiling.kernels import YES, inline, kernel
from dlo_sim.compiling.lanes import any_above, lane_sum
from dlo_sim.engine.arrays import BISHOP, CABLE, LINES, MARGIN, PADDING, ROLLING, VECTOR
from dlo_sim.engine.band import (
    clamps_here,
    clear_band,
    eliminate,
    frame_of,
    own_point,
    substitute,
    turn_entries,
)
from dlo_sim.engine.contact import (
    BRISTLE,
    END,
    ENDED,
    FRICTION,
    LEVER,
    MIDDLE,
    PRESSURE,
    SLOPE,
    STICKS,
    STOP,
    TOWARD,
    add_line,
    friction_at,
    push_line,
    push_samples,
    taken,
    to_lines,
    trial_at,
)
from dlo_sim.engine.contact_law import (
    friction_jacobian,
    held_share,
    product,
    product_from_left,
    scaled,
    with_product,
)
from dlo_sim.engine.shapes import NORMAL, three
from dlo_sim.terms.vectors import dot

FOUR = 4  # unknowns of a control point: three of the shape, one of the twist
HALF = 4 * FOUR - 1  # half the bandwidth


@inline
def rubs(cable, o, g):
    """Whether friction of obstacle o acts on any sample of a group."""
    p = cable.work.touch[o, g, PRESSURE]
    return cable.contact.law[o, FRICTION] > 0.0 and any_above(friction_at(cable, o, g) * p)


@inline
def friction_on(cable, o, g, change):
    """Minus the friction on the samples of a group, for a `change` in the step."""
    trial, p = trial_at(cable, o, g, change), cable.work.touch[o, g, PRESSURE]
    share, _ = held_share(friction_at(cable, o, g) * p, trial)
    return scaled(cable.contact.weight[g] * share, trial)


@inline
def jacobian_of(cable, o, g, change):
    """`friction_jacobian` of the samples of a group, for a `change` in the step."""
    touch, mu = cable.work.touch[o, g], friction_at(cable, o, g)
    trial, k_t = trial_at(cable, o, g, change), cable.contact.law[o, BRISTLE]
    return friction_jacobian(k_t, mu, touch[PRESSURE], touch[SLOPE], three(touch, TOWARD), trial)


@kernel(void, CABLE, LINES, LINES, terms=ROLLING)
def add_moments(cable, change, out):
    """out += moments of friction on the twist line, for a `change` in the step."""
    for o in range(cable.contact.count):
        for k in range(int(cable.state.near_count[o])):
            g = int(cable.state.near[o, k])
            if rubs(cable, o, g):
                lever = three(cable.work.touch[o, g], LEVER)
                moment = dot(lever, friction_on(cable, o, g, change))
                push_line(cable, g, cable.dim, moment, out)


@kernel(void, CABLE, LINES, LINES, terms=ROLLING)
def add_stiffness(cable, change, matrix):
    """Add l.S l to the matrix of the twist, its lower diagonals, entry (i + k, i) at [k, i]."""
    for o in range(cable.contact.count):
        for k in range(int(cable.state.near_count[o])):
            g = int(cable.state.near[o, k])
            if rubs(cable, o, g):
                lever = three(cable.work.touch[o, g], LEVER)
                held = dot(lever, product(jacobian_of(cable, o, g, change)[0], lever))
                add_to_twist(cable, g, cable.contact.weight[g] * held, matrix)


@inline
def add_to_twist(cable, g, held, matrix):
    """matrix += the stiffnesses `held` of the samples of a group against their spin, as of
    `add_stiffness`.
    """
    contact = cable.contact
    e, first = contact.basis[g], contact.first[g] - MARGIN
    for a in range(4):
        for b in range(a, 4):
            value = e[a] * e[b] * held
            matrix[b - a, first + a] += lane_sum(value)


@kernel(void, CABLE, LINES, LINES, terms=ROLLING)
def push_rolling(cable, change, out):
    """out += friction on the shape, which `contact.add_force` left out."""
    for o in range(cable.contact.count):
        for k in range(int(cable.state.near_count[o])):
            g = int(cable.state.near[o, k])
            if rubs(cable, o, g):
                f = scaled(-1.0, friction_on(cable, o, g, change))
                push_samples(cable, g, to_lines(cable.state.pose[o], MIDDLE, f), out)


# -- matrix of the shape and the twist -----------------------------------------------------------


@kernel(boolean, CABLE, terms=ROLLING)
def rolls(cable):
    """Whether any sample is pressed on an obstacle with friction."""
    for o in range(cable.contact.count):
        for k in range(int(cable.state.near_count[o])):
            if rubs(cable, o, int(cable.state.near[o, k])):
                return True
    return False


@kernel(boolean, CABLE, LINES, LINES, LINES, boolean, terms=ROLLING)
def eliminate_rolling(cable, pushed, kept, matrix, impulses):
    """`work.rolling_band` = LU factors of the shape's `matrix`, of that of the twist, which is in
    `work.twist_matrix`, and of the couplings at the present iterate of a step; returns whether they
    exist. `pushed`, `kept`: directions of the constraint rows, as of `band.hold`. `impulses`: the
    matrices and couplings are those of `contact.add_impulses`.
    """
    band, span = cable.work.rolling_band, -1
    clear_band(band)
    copy_shape(cable, matrix, band)
    for o in range(cable.contact.count):
        for k in range(int(cable.state.near_count[o])):
            g = int(cable.state.near[o, k])
            if rubs(cable, o, g):
                here = cable.contact.first[g]
                if here != span and span >= 0:
                    add_couplings(cable, span, band)
                couple(cable, o, g, impulses)
                span = here
    if span >= 0:
        add_couplings(cable, span, band)
    hold_couplings(cable, pushed, kept, band)
    copy_twist(cable, band)
    return eliminate(band, FOUR * cable.n, FOUR)


@kernel(boolean, CABLE, LINES, LINES, terms=ROLLING)
def eliminate_impulses(cable, directions, matrix):
    """`eliminate_rolling` for the velocities after contact (`contact.add_impulses`), with the
    `matrix` of the shape.
    """
    twist, mass = cable.work.twist_matrix, cable.linear.mass[1]
    for k in range(4):
        for i in range(cable.n - k):
            twist[k, i] = mass[3 + k, MARGIN + i]
    stiff = STOP * cable.contact.density
    for o in range(cable.contact.count):
        for k in range(int(cable.state.near_count[o])):
            g = int(cable.state.near[o, k])
            if rubs(cable, o, g):
                lever = three(cable.work.touch[o, g], LEVER)
                held = stiff * cable.work.impulses[o, g, STICKS] * dot(lever, lever)
                add_to_twist(cable, g, cable.contact.weight[g] * held, twist)
    return eliminate_rolling(cable, directions, directions, matrix, YES)


@kernel(void, CABLE, LINES, VECTOR, LINES, terms=ROLLING | BISHOP)
def substitute_with_twist(cable, push, solved, v):
    """Solve with the factors in `work.rolling_band`: `solved` has the right-hand side of the shape,
    in the frames of the clamps, and gets its solution; that of the twist is a line of `push`, and
    its solution is added to one of v.
    """
    side, line = cable.work.rolling_side, cable.dim
    for i in range(cable.n):
        for d in range(3):
            side[PADDING + FOUR * i + d] = solved[PADDING + 3 * i + d]
        free = 1.0 - cable.work.twist_held[i]
        side[PADDING + FOUR * i + 3] = free * push[line, MARGIN + i]
    substitute(cable.work.rolling_band, FOUR * cable.n, FOUR, side)
    for i in range(cable.n):
        for d in range(3):
            solved[PADDING + 3 * i + d] = side[PADDING + FOUR * i + d]
        v[line, MARGIN + i] += side[PADDING + FOUR * i + 3]


@inline
def copy_shape(cable, matrix, band):
    """Copy the band matrix of the shape, three unknowns of each control point."""
    for i in range(cable.n):
        for d in range(3):
            row, to = matrix[3 * i + d], band[FOUR * i + d]
            for j in range(max(-3, -i), min(4, cable.n - i)):
                for e in range(3):
                    to[FOUR * j + e - d + HALF] = row[3 * j + e - d + 4 * 3 - 1]


@inline
def copy_twist(cable, band):
    """Copy the matrix of the twist; prescribed unknowns get an equation of the identity."""
    work = cable.work
    for i in range(cable.n):
        for j in range(max(i - 3, 0), min(i + 4, cable.n)):
            value = work.twist_matrix[abs(i - j), min(i, j)]
            if work.twist_held[i] + work.twist_held[j] > 0.0:
                value = 1.0 if i == j else 0.0
            band[FOUR * i + 3, FOUR * (j - i) + HALF] = value


@inline
def couple(cable, o, g, impulses):
    """`work.contact_sums` += couplings of the samples of a group, negative: two lines of the
    dependence of the equations of the shape on the spin, and of that of the twist on the places.
    """
    pose, lever = cable.state.pose[o], three(cable.work.touch[o, g], LEVER)
    w, e, sums = cable.contact.weight[g], cable.contact.basis[g], cable.work.contact_sums
    if impulses:
        stiff = STOP * cable.contact.density * cable.work.impulses[o, g, STICKS]
        by_spin = to_lines(pose, END, scaled(w * stiff, lever))
        by_place = by_spin
    else:
        s, lean = jacobian_of(cable, o, g, cable.work.change)
        by_spin = to_lines(pose, MIDDLE, scaled(w, product(s, lever)))
        s = with_product(s, lean, three(cable.work.measured[o, g, ENDED], NORMAL))
        by_place = to_lines(pose, END, scaled(w, product_from_left(lever, s)))
    add_line(sums, e, 3, 2, 0, by_spin)
    add_line(sums, e, 3, 2, 1, by_place)


@inline
def add_couplings(cable, span, band):
    """band -= the sums of `couple` of the span with this first column, which then has none."""
    sums, first, row = cable.work.contact_sums, span - MARGIN, 0
    for one in range(4):
        for other in range(one, 4):
            for d in range(3):
                on_shape, on_twist = taken(sums, row + d), taken(sums, row + 3 + d)
                i, j = first + one, first + other
                add_coupling(i, j, d, on_shape, on_twist, band)
                if other > one:
                    add_coupling(j, i, d, on_shape, on_twist, band)
            row += 6


@inline
def add_coupling(i, j, d, on_shape, on_twist, band):
    """Between line d of control point i and the twist of control point j, in both equations."""
    band[FOUR * i + d, FOUR * (j - i) + 3 - d + HALF] -= on_shape
    band[FOUR * i + 3, FOUR * (j - i) + d - 3 + HALF] -= on_twist


@inline
def hold_couplings(cable, pushed, kept, band):
    """Rotate the couplings into the frames of the clamps, and drop those of prescribed unknowns."""
    for k in range(cable.rows.count):
        own, line = own_point(cable, k), cable.rows.line[k]
        if own < 0:
            continue
        low, high = max(own - 3, 0), min(own + 4, cable.n)
        if clamps_here(cable, k):
            f, g = frame_of(cable, k, pushed), frame_of(cable, k, kept)
            for j in range(low, high):
                turn_entries(3, f, band, FOUR * own, FOUR * (j - own) + 3 + HALF, 1, -1)
                turn_entries(3, g, band, FOUR * j + 3, FOUR * (own - j) - 3 + HALF, 0, 1)
        for j in range(low, high):
            for d in range(3):
                if line == d or (line < 0 and d > 0):
                    band[FOUR * own + d, FOUR * (j - own) + 3 - d + HALF] = 0.0
                    band[FOUR * j + 3, FOUR * (own - j) + d - 3 + HALF] = 0.0
    for i in range(cable.n):
        if cable.work.twist_held[i] == 0.0:
            continue
        for j in range(max(i - 3, 0), min(i + 4, cable.n)):
            for d in range(3):
                band[FOUR * j + d, FOUR * (i - j) + 3 - d + HALF] = 0.0
                band[FOUR * i + 3, FOUR * (j - i) + d - 3 + HALF] = 0.0
