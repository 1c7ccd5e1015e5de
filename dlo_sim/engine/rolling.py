"""Friction that rolls a cable about its axis: its moment, and twist and shape in one matrix.

A cable that twists in space turns about its axis by phi at a sample that touches, which friction
sees as a motion - phi l of its surface with the lever l (`engine.contact`). With the trial force
T0 at phi = 0 the friction of a step is
    f = - min(1, mu p / |T|) T,   T = T0 - k_t phi l,
and turns the cable by the moment m = - l.f per length. Its derivative is - l.H l, where H, minus
the derivative of f by the motion of the surface, is positive semidefinite.

`contact.add_force` leaves T0, l, mu p and its derivative at an iterate of the shape in
`work.rolling`, with phi without the spin of the cable in this step. Then `methods.twist_step`
solves for the twist with the moments, and at last `push_rolling` adds the friction.

A sample that sticks ties the spin to the motion of the axis, as a wheel. Newton's method for the
shape must know that the twist follows, so its matrix S = K - C D^-1 R is that of the shape with the
twist eliminated, with the matrix D of the twist and the couplings
    C = - dF/dtheta = - H l,   R = - dm/dr = - l.(-df/dr).
It is never formed: unknowns are ordered by control point, three of the shape and one of the twist,
in a band, and the solution for a right-hand side (r, 0) is S^-1 r in the unknowns of the shape.
"""

from __future__ import annotations

from numba import boolean, void

from dlo_sim.compiling.groups import load, store
from dlo_sim.compiling.lanes import LANES, lane, lane_sum, sqrt, where
from dlo_sim.compiling.pieces import YES, part, piece
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
    FRICTION,
    LEAN,
    LEVER,
    LIMIT,
    MIDDLE,
    STOP,
    TINY,
    clear_sums,
    push_line,
    push_samples,
    rolling_trial,
    scaled,
    three,
    to_lines,
)
from dlo_sim.terms.vectors import combined, dot

FOUR = 4  # unknowns of a control point: three of the shape, one of the twist
HALF = 4 * FOUR - 1  # half the bandwidth


@part
def rolling_friction(cable, o, g, change):
    """T, the share of it that holds, |T|, l and k_t of the samples of a group."""
    kept, k_t = cable.work.rolling[o, g], cable.contact.law[o, BRISTLE]
    trial = rolling_trial(cable, o, g, change)
    far, limit = sqrt(dot(trial, trial)) + TINY, kept[LIMIT]
    return trial, where(limit - far, 1.0, limit / far), far, three(kept, LEVER), k_t


@part
def groups_near(cable, o):
    """Number of groups of samples that may touch obstacle o with friction."""
    return int(cable.state.near_count[o]) if cable.contact.law[o, FRICTION] > 0.0 else 0


@part
def any_pressed(cable, o, g):
    """Whether any sample of a group is pressed."""
    return lane_sum(cable.work.rolling[o, g, LIMIT]) > 0.0


@piece(void, CABLE, LINES, LINES, terms=ROLLING)
def add_moments(cable, change, out):
    """out += moments of friction on the twist line, for a `change` in the step."""
    for o in range(cable.contact.count):
        for k in range(groups_near(cable, o)):
            g = int(cable.state.near[o, k])
            if any_pressed(cable, o, g):
                trial, share, _, lever, _ = rolling_friction(cable, o, g, change)
                moment = cable.contact.weight[g] * share * dot(lever, trial)
                push_line(cable, g, cable.dim, moment, out)


@piece(void, CABLE, LINES, LINES, terms=ROLLING)
def add_stiffness(cable, change, matrix):
    """Add l.H l to the matrix of the twist, its lower diagonals, entry (i + k, i) at [k, i]."""
    contact = cable.contact
    for o in range(contact.count):
        for k in range(groups_near(cable, o)):
            g = int(cable.state.near[o, k])
            if not any_pressed(cable, o, g):
                continue
            trial, share, far, lever, stiff = rolling_friction(cable, o, g, change)
            ahead = dot(lever, trial) / far
            held = dot(lever, lever) - where(share - 1.0 + 1e-15, 0.0, ahead * ahead)
            held = contact.weight[g] * share * stiff * held
            add_to_twist(cable, g, held, matrix)


@part
def add_to_twist(cable, g, held, matrix):
    """matrix += the stiffnesses `held` of the samples of a group against their spin, as of
    `add_stiffness`.
    """
    contact = cable.contact
    e, first = contact.basis[g], contact.first[g] - MARGIN
    for a in range(4):
        for b in range(a, 4):
            value = e[a] * e[b] * held
            if g < contact.coarse:
                for span in range(min(LANES, cable.n - 3 - first)):
                    matrix[b - a, first + span + a] += lane(value, span)
            else:
                matrix[b - a, first + a] += lane_sum(value)


@piece(void, CABLE, LINES, LINES, terms=ROLLING)
def push_rolling(cable, change, out):
    """out += friction on the shape, which `contact.add_force` left out."""
    for o in range(cable.contact.count):
        for k in range(groups_near(cable, o)):
            g = int(cable.state.near[o, k])
            if any_pressed(cable, o, g):
                trial, share, _, _, _ = rolling_friction(cable, o, g, change)
                f = scaled(-cable.contact.weight[g] * share, trial)
                push_samples(cable, g, to_lines(cable.state.pose[o], MIDDLE, f), out)


# -- matrix of the shape and the twist -----------------------------------------------------------


@piece(boolean, CABLE, terms=ROLLING)
def rolls(cable):
    """Whether any sample is pressed on an obstacle with friction."""
    for o in range(cable.contact.count):
        for k in range(groups_near(cable, o)):
            if any_pressed(cable, o, int(cable.state.near[o, k])):
                return True
    return False


@piece(boolean, CABLE, LINES, LINES, LINES, boolean, terms=ROLLING)
def eliminate_rolling(cable, pushed, kept, matrix, stops):
    """`work.rolling_band` = LU factors of the shape's `matrix`, of that of the twist, which is in
    `work.twist_matrix`, and of the couplings at the present iterate of a step; returns whether they
    exist. `pushed`, `kept`: directions of the constraint rows, as of `band.hold`. `stops`: the
    matrices and couplings are those of `contact.add_stops`.
    """
    band, sums, block = cable.work.rolling_band, cable.work.contact_sums, -1
    clear_band(band)
    copy_shape(cable, matrix, band)
    for o in range(cable.contact.count):
        for k in range(groups_near(cable, o)):
            g = int(cable.state.near[o, k])
            if not any_pressed(cable, o, g):
                continue
            # Groups of one block of spans, or samples of one span, have the same control points.
            first = cable.contact.first[g] + (0 if g < cable.contact.coarse else cable.columns)
            if first != block:
                if block >= 0:
                    add_couplings(cable, block, band)
                clear_sums(sums)
                block = first
            if stops:
                couple_stops(cable, o, g, sums)
            else:
                couple(cable, o, g, sums)
    if block >= 0:
        add_couplings(cable, block, band)
    hold_couplings(cable, pushed, kept, band)
    copy_twist(cable, band)
    return eliminate(band, FOUR * cable.n, FOUR)


@piece(boolean, CABLE, LINES, LINES, terms=ROLLING)
def eliminate_stops(cable, directions, matrix):
    """`eliminate_rolling` for the velocities after contact (`contact.add_stops`), with the `matrix`
    of the shape.
    """
    twist, mass = cable.work.twist_matrix, cable.linear.mass[1]
    for k in range(4):
        for i in range(cable.n - k):
            twist[k, i] = mass[3 + k, MARGIN + i]
    stiff = STOP * cable.contact.density
    for o in range(cable.contact.count):
        for k in range(groups_near(cable, o)):
            g = int(cable.state.near[o, k])
            if any_pressed(cable, o, g):
                lever = three(cable.work.rolling[o, g], LEVER)
                held = stiff * cable.work.stops[o, g, 0] * dot(lever, lever)
                add_to_twist(cable, g, cable.contact.weight[g] * held, twist)
    return eliminate_rolling(cable, directions, directions, matrix, YES)


@piece(void, CABLE, LINES, VECTOR, LINES, terms=ROLLING | BISHOP)
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


@part
def copy_shape(cable, matrix, band):
    """Copy the band matrix of the shape, three unknowns of each control point."""
    for i in range(cable.n):
        for d in range(3):
            row, to = matrix[3 * i + d], band[FOUR * i + d]
            for j in range(max(-3, -i), min(4, cable.n - i)):
                for e in range(3):
                    to[FOUR * j + e - d + HALF] = row[3 * j + e - d + 4 * 3 - 1]


@part
def copy_twist(cable, band):
    """Copy the matrix of the twist; prescribed unknowns get an equation of the identity."""
    work = cable.work
    for i in range(cable.n):
        for j in range(max(i - 3, 0), min(i + 4, cable.n)):
            value = work.twist_matrix[abs(i - j), min(i, j)]
            if work.twist_held[i] + work.twist_held[j] > 0.0:
                value = 1.0 if i == j else 0.0
            band[FOUR * i + 3, FOUR * (j - i) + HALF] = value


@part
def couple(cable, o, g, sums):
    """sums += couplings of the samples of a group, negative (`add_to_sums`)."""
    kept, pose = cable.work.rolling[o, g], cable.state.pose[o]
    trial, share, far, lever, whole = rolling_friction(cable, o, g, cable.work.change)
    ahead, slides = scaled(1.0 / far, trial), where(share - 1.0 + 1e-15, 0.0, 1.0)
    leans = slides * dot(ahead, lever)
    both_ways = scaled(share * whole, combined(1.0, lever, -leans, ahead))  # H l
    by_spin = to_lines(pose, MIDDLE, both_ways)
    by_place = to_lines(pose, END, combined(1.0, both_ways, leans, three(kept, LEAN)))
    add_to_sums(cable, g, by_spin, by_place, sums)


@part
def couple_stops(cable, o, g, sums):
    """`couple` for the velocities after contact (`contact.add_stops`)."""
    stiff = STOP * cable.contact.density * cable.work.stops[o, g, 0]
    by_spin = scaled(stiff, three(cable.work.rolling[o, g], LEVER))
    by_spin = to_lines(cable.state.pose[o], END, by_spin)
    add_to_sums(cable, g, by_spin, by_spin, sums)


@part
def add_to_sums(cable, g, by_spin, by_place, sums):
    """sums += six rows for each pair of control points of the samples of a group: the dependence
    of the equations of the shape on the spin, and of that of the twist on the places.
    """
    e, w, at = cable.contact.basis[g], cable.contact.weight[g], 0
    for one in range(4):
        for other in range(one, 4):
            both = e[one] * e[other] * w
            for d in range(3):
                store(sums, at + d, 0, load(sums, at + d, 0) + both * by_spin[d])
                store(sums, at + 3 + d, 0, load(sums, at + 3 + d, 0) + both * by_place[d])
            at += 6


@part
def add_couplings(cable, block, band):
    """band -= the sums of `couple`, by lane of spans of a block, or all of a span."""
    sums, fine = cable.work.contact_sums, block >= cable.columns
    first = block - MARGIN - (cable.columns if fine else 0)
    for lane_ in range(LANES):
        begin, at = first + (0 if fine else lane_), 0
        if begin > cable.n - 4:
            break
        for one in range(4):
            for other in range(one, 4):
                for d in range(3):
                    on_shape, on_twist = sums[at + d, lane_], sums[at + 3 + d, lane_]
                    add_coupling(begin + one, begin + other, d, on_shape, on_twist, band)
                    if other > one:
                        add_coupling(begin + other, begin + one, d, on_shape, on_twist, band)
                at += 6


@part
def add_coupling(i, j, d, on_shape, on_twist, band):
    """Between line d of control point i and the twist of control point j, in both equations."""
    band[FOUR * i + d, FOUR * (j - i) + 3 - d + HALF] -= on_shape
    band[FOUR * i + 3, FOUR * (j - i) + d - 3 + HALF] -= on_twist


@part
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
