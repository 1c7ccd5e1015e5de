"""Constraint rows between control points, which border the band matrix of `engine.band`.

A row at a place between control points couples four of them, and a joint four of each branch, so
it cannot be imposed by fixing single unknowns. These rows border the matrix. Let K be the band
matrix with all other constraints imposed, and let F and C be the border rows with their directions
at the middle and at the end of the step, in the frames of the clamps. The constraint forces act
along F^T, the constraints are C y = 0, and a Newton correction y for the residual r is
    K y = r + F^T f,   C y = 0:   y = (1 - Z (C Z)^-1 C) K^-1 r,   Z = K^-1 F^T.
A joint that gives, a spring of stiffness k between two branches, lies outside the band. Its change
of force f = - k C y gives the same with C Z + 1 / k in place of C Z.

The rolls of strands on bodies (`engine.roll`) are border rows, too, whose F and C depend on the
configuration. Where a rigid one is still open by a gap, a correction fulfils C y = -gap.

Adding multiples of F^T C to K does not change y. It is done because K is singular if only border
rows support a cable at rest. For a row between two places, F = a + b, the product lies outside the
band. At rest (`ground_border`) g (a^T a + b^T b) is added instead,
    a^T a + b^T b = (F^T F + D^T D) / 2,   D = a - b:
the first half changes nothing where F y = 0, and the second one is undone exactly by a border row D
with the stiffness - g / 2. Of a joint of stiffness k, g = k leaves the stiffness k / 2. K is then
singular only where the strands within the constraints are, and the unstable modes within these are
the negative pivots of K less those of `negative_border`.

The part of r in the range of F^T is balanced by the forces of the grasps, the multipliers
f = - (P F^T)^-1 P r, and so does not belong to the residual. P is F, but rolls have only the part
on their twist angle in it, which is constant: at a solution, where r is in the range of F^T, all P
give the same f. The moments of the rolls come first, and the other rows balance what is then left,
so that the inverse of P P^T is that of the step. Where P P^T is singular, as where two bodies turn
one place of a strand, P is F, and the inverse is found anew with F.
"""

from __future__ import annotations

import numpy as np
from numba import boolean, float64, int64, void

from dlo_sim.compiling.groups import load, store
from dlo_sim.compiling.kernels import NO, YES, inline, kernel
from dlo_sim.compiling.lanes import LANES, lane, lane_sum, zero
from dlo_sim.engine.arrays import (
    BETWEEN,
    BORDERED,
    CABLE,
    IN_SKYLINE,
    LINES,
    PADDING,
    ROLLED,
    SOME,
    VECTOR,
)
from dlo_sim.engine.band import clear_held, solve, turn_vector
from dlo_sim.engine.skyline import substitute_skyline_columns

UNKNOWN, KNOWN = 1.0, 2.0  # values of `border_known`, which is 0 outside of steps
LEAST_PIVOT = 1e-3  # of P P^T (see above), with weights of about 1


@inline
def rigid_count(cable):
    """Number of rigid border rows: rows of `cable.rows`, then rolls."""
    return cable.rows.border + cable.rolls.rigid_rolls


@inline
def border_count(cable):
    """Number of border rows: rigid ones, then joints and rolls that give."""
    giving = len(cable.rolls.stiffness) - cable.rolls.rigid_rolls
    return rigid_count(cable) + cable.rows.joints + giving


@inline
def border_columns(cable):
    """Number of border rows, with those that undo groundings."""
    return border_count(cable) + np.int64(cable.work.results.grounded)


@inline
def border_row(cable, k):
    """Constraint row of border row k, -1 for a roll."""
    rows = cable.rows
    if k < rows.border:
        return rows.count - rows.border + k
    joint = k - rigid_count(cable)
    return rows.count + joint if 0 <= joint < rows.joints else -1


@inline
def roll_of(cable, k):
    """Roll of border row k, which is one."""
    return k - cable.rows.border - (cable.rows.joints if k >= rigid_count(cable) else 0)


@inline
def places_in_p(cable, k):
    """Number of the places of row k of F, which is rigid, that P has."""
    return 1 if k >= cable.rows.border and cable.work.results.whole_rolls == 0.0 else 2


@inline
def along(cable, matrix, k, count, y, begin):
    """Product of border row k of F or C, at its first one or both places (`count`), with the
    unknowns y[begin], y[begin + 1], ...
    """
    value, places = 0.0, cable.work.border_at[k]
    for w in range(count):
        if places[w] >= 0:
            at = begin + places[w]
            for r in range(matrix.shape[2]):
                value += matrix[k, w, r] * y[at + r]
    return value


@inline
def spread(cable, matrix, k, scale, y, begin):
    """Add `scale` times border row k of F to the unknowns y[begin], y[begin + 1], ..."""
    places = cable.work.border_at[k]
    for w in range(2):
        if places[w] >= 0:
            at = begin + places[w]
            for r in range(matrix.shape[2]):
                y[at + r] += scale * matrix[k, w, r]


@inline
def set_places(cable, k):
    """Set where border row k acts, its compliance, and whether it is free of what others hold."""
    rows, rolls, points, work = cable.rows, cable.rolls, cable.points, cable.work
    row = border_row(cable, k)
    if row < 0:
        roll = roll_of(cable, k)
        work.border_at[k, 0] = cable.lines * rolls.first[roll]
        work.border_at[k, 1] = cable.lines * first_of(cable, rolls.body[roll])
        stiffness = rolls.stiffness[roll]
    else:
        first, other = points.first[rows.point[row]], points.other[rows.point[row]]
        work.border_at[k, 0] = cable.lines * first
        work.border_at[k, 1] = cable.lines * other if other >= 0 else -1
        stiffness = rows.stiffness[row]
    work.border_compliance[k] = 0.0 if k < rigid_count(cable) else 1.0 / stiffness
    for w in range(2):
        work.border_free[k, w] = 1
        for j in range(4 if work.border_at[k, w] >= 0 else 0):
            weight = 1.0
            if row >= 0 and w == 1:
                weight = points.other_weights[rows.point[row], j]
            elif row >= 0:
                weight = points.weights[rows.point[row], j]
            elif w == 0:
                weight = rolls.weights[roll_of(cable, k), j]
            held = work.held_point[work.border_at[k, w] // cable.lines + j] == 1
            if held and weight != 0.0:
                work.border_free[k, w] = 0


@inline
def first_of(cable, body):
    """First control point of a body."""
    point = cable.bodies.point[body]
    return min(min(point[0], point[1]), min(point[2], point[3]))


@inline
def write_place(cable, k, w, directions, rolled, out, at):
    """Write border row k at its place w, in world coordinates, to out[at], out[at + 1], ...;
    `rolled`: the rows of the rolls.
    """
    lines, points, row = cable.lines, cable.points, border_row(cable, k)
    if row < 0:
        roll = roll_of(cable, k)
        for r in range(4 * lines):
            out[at + r] = rolled[roll, w, r]
        return
    line, point = cable.rows.line[row], cable.rows.point[row]
    for j in range(4):
        weight = points.other_weights[point, j] if w == 1 else points.weights[point, j]
        for d in range(lines):
            along_d = 1.0 if d == line else 0.0
            if line < 0 and d < cable.dim:
                along_d = directions[row, d]
            out[at + j * lines + d] = along_d * weight


@inline
def write_border(cable, first, directions, rolled, free, out):
    """Write the border rows from `first` on with directions (rows, 3), in the frames of the clamps,
    to `out` (border, places, 4 lines). `rolled`: rows of the rolls (rolls, places, 4 lines).
    `free`: zero at the unknowns that other constraint rows fix.
    """
    work, spare = cable.work, cable.work.border_spare
    for k in range(first, border_count(cable)):
        for w in range(2):
            at = work.border_at[k, w]
            if at < 0:
                continue
            if work.border_free[k, w] == 1:
                write_place(cable, k, w, directions, rolled, out[k][w], 0)
                continue
            write_place(cable, k, w, directions, rolled, spare, at)
            turn_vector(cable, directions, YES, spare, 0)
            if free:
                clear_held(cable, spare, 0)
            for r in range(out.shape[2]):
                out[k, w, r] = spare[at + r]


@kernel(void, CABLE, LINES, LINES, terms=BORDERED)
def set_border(cable, pushed, ahead):
    """Set F with the directions `pushed`, C with the directions `ahead`, and (P F^T)^-1; those of
    rolls from `work.roll_force` and `work.roll_condition`. Where no other row turns or meets what
    is held, all but the rolls stay for the steps of a call.
    """
    work, first = cable.work, cable.rows.border
    work.results.grounded = 0.0
    if work.results.border_known == KNOWN:
        write_border(cable, first, pushed, work.roll_force, NO, work.border_push)
        set_roll_rows(cable, pushed, ahead)
        return
    find_coupled(cable)
    for i in range(cable.n):
        work.held_point[i] = 0
    for k in range(cable.rows.count):
        own = cable.points.own[cable.rows.point[k]]
        if own >= 0:
            work.held_point[own] = 1
    for k in range(border_count(cable)):
        set_places(cable, k)
    write_border(cable, 0, pushed, work.roll_force, NO, work.border_push)
    write_border(cable, 0, pushed, work.roll_force, YES, work.border_force)
    write_border(cable, 0, ahead, work.roll_condition, YES, work.border_condition)
    work.results.whole_rolls = 0.0
    if set_gram(cable) < LEAST_PIVOT and cable.rolls.rigid_rolls > 0:
        work.results.whole_rolls = 1.0
        set_gram(cable)
    if work.results.border_known == UNKNOWN and work.results.whole_rolls == 0.0:
        work.results.border_known = KNOWN
        for k in range(border_count(cable)):
            row, free = border_row(cable, k), work.border_free[k, 0] == 1
            turned = row >= 0 and (cable.rows.line[row] < 0 or work.border_free[k, 1] == 0)
            if turned or not free:
                work.results.border_known = UNKNOWN


@kernel(void, CABLE, LINES, terms=ROLLED)
def set_roll_force(cable, pushed):
    """Set anew how rolls push, and where P contains all of F, this and (P F^T)^-1."""
    work, first = cable.work, cable.rows.border
    write_border(cable, first, pushed, work.roll_force, NO, work.border_push)
    if work.results.whole_rolls != 0.0:
        write_border(cable, first, pushed, work.roll_force, YES, work.border_force)
        set_gram(cable)


@kernel(void, CABLE, LINES, LINES, terms=ROLLED)
def set_roll_rows(cable, pushed, ahead):
    """Set F and C of the rolls anew, as `set_border`."""
    work, first = cable.work, cable.rows.border
    write_border(cable, first, pushed, work.roll_force, YES, work.border_force)
    write_border(cable, first, ahead, work.roll_condition, YES, work.border_condition)


@inline
def find_coupled(cable):
    """Set where strands end, with the bodies that have control points of theirs."""
    n, end, bodies = cable.n, cable.work.coupled_end, cable.bodies
    for i in range(n):
        end[i] = i + 1
    for span in range(n - 3):
        if lane(cable.mesh.share[span // LANES], span % LANES) != 0.0:
            end[span] = span + 4
    for body in range(len(bodies.stiffness)):
        first = first_of(cable, body)
        for k in range(4):
            end[first] = max(end[first], bodies.point[body, k] + 1)
    begin = 0
    while begin < n:
        last, i = end[begin], begin
        while i < last:
            last = max(last, end[i])
            i += 1
        for i in range(begin, last):
            end[i] = last
        begin = last


@inline
def set_gram(cable):
    """(P P^T)^-1 of the rigid rows; returns the smallest pivot."""
    work, count = cable.work, rigid_count(cable)
    for k in range(count):
        for j in range(k + 1):
            work.border_gram[k, j] = work.border_gram[j, k] = product_of_rows(cable, k, j)
    return invert_pivoted(work.border_gram, count, work.border_order)


@inline
def product_of_rows(cable, k, j):
    """Scalar product of two rows of P."""
    f, places, value = cable.work.border_force, cable.work.border_at, 0.0
    for w in range(places_in_p(cable, k)):
        for v in range(places_in_p(cable, j)):
            apart = places[j, v] - places[k, w]
            if places[k, w] >= 0 and places[j, v] >= 0 and abs(apart) < f.shape[2]:
                for r in range(max(apart, 0), f.shape[2] + min(apart, 0)):
                    value += f[k, w, r] * f[j, v, r - apart]
    return value


@inline
def invert_pivoted(a, size, order):
    """Gauss-Jordan inverse in place of the first `size` rows, with partial pivoting; `order`: room.
    Returns the size of the smallest pivot.

    The rows are whole vectors.
    """
    smallest = np.inf
    for k in range(size):
        best = k
        for i in range(k + 1, size):
            if abs(a[i, k]) > abs(a[best, k]):
                best = i
        order[k] = best
        smallest = min(smallest, abs(a[best, k]))
        pivot = 1.0 / a[best, k]
        a[best, k] = 1.0
        for j in range(0, size, LANES):
            row = load(a, best, j) * pivot
            if best != k:
                store(a, best, j, load(a, k, j))
            store(a, k, j, row)
        for i in range(size):
            factor = a[i, k]
            if i != k and factor != 0.0:  # rows far apart do not meet in F F^T
                a[i, k] = 0.0
                for j in range(0, size, LANES):
                    store(a, i, j, load(a, i, j) - factor * load(a, k, j))
    for k in range(size - 1, -1, -1):
        best = order[k]
        for i in range(size if best != k else 0):
            a[i, k], a[i, best] = a[i, best], a[i, k]
    return smallest


@kernel(void, CABLE, LINES, terms=BORDERED)
def stiffen_border(cable, band):
    """Add F^T C of the rigid rows at one place to the band matrix, each scaled to the largest
    diagonal entry where it acts.
    """
    work = cable.work
    for k in range(cable.rows.border):
        if work.border_at[k, 1] < 0:  # else outside the band
            stiffness = largest_at(cable, work.border_at[k, 0], band)
            f, c = work.border_force[k][0], work.border_condition[k][0]
            norm = 0.0
            for r in range(len(f)):
                norm += f[r] * c[r]
            ground(cable, work.border_at[k, 0], f, c, stiffness / norm, band)


@inline
def largest_at(cable, begin, band):
    """Largest diagonal entry of the matrix at the 4 lines unknowns from `begin` on."""
    value = 0.0
    for r in range(begin, begin + 4 * cable.lines):
        value = max(value, abs(band[r, 4 * cable.lines - 1]))
    return value


@inline
def ground(cable, begin, f, c, stiffness, band):
    """Add stiffness f^T c at the 4 lines unknowns from `begin` on."""
    half = 4 * cable.lines - 1
    for r in range(len(f)):
        for q in range(len(c) if f[r] != 0.0 else 0):
            band[begin + r, q - r + half] += stiffness * f[r] * c[q]


@kernel(void, CABLE, LINES, terms=BORDERED, family=BETWEEN)
def ground_border(cable, band):
    """Ground both places of every row between two places, and undo it through further border rows
    (see the head of this file), so that the matrix is not singular where only such rows support a
    strand at rest.
    """
    work, base = cable.work, border_count(cable)
    extra = base
    for k in range(base):
        a, b = work.border_at[k, 0], work.border_at[k, 1]
        if b < 0:
            continue
        norm = 0.0
        for w in range(2):
            for r in range(4 * cable.lines):
                norm += work.border_force[k, w, r] * work.border_condition[k, w, r]
        stiffness = max(largest_at(cable, a, band), largest_at(cable, b, band)) / norm
        if work.border_compliance[k] > 0.0:
            stiffness = 1.0 / work.border_compliance[k]
            work.border_compliance[k] *= 2.0
        for w in range(2):
            f, c = work.border_force[k][w], work.border_condition[k][w]
            ground(cable, work.border_at[k, w], f, c, stiffness, band)
            sign = 1.0 if w == 0 else -1.0
            work.border_at[extra, w] = work.border_at[k, w]
            for r in range(4 * cable.lines):
                work.border_force[extra, w, r] = sign * f[r]
                work.border_condition[extra, w, r] = sign * c[r]
        work.border_compliance[extra] = -2.0 / stiffness
        extra += 1
    work.results.grounded = float(extra - base)


@kernel(void, CABLE, LINES, float64, terms=BORDERED)
def solve_border(cable, band, share):
    """Compute Z = K^-1 F^T and (C Z + compliance)^-1 with the LU factors of K. `share`: of the
    stiffness of joints in the matrix, as of the other springs.
    """
    work, size, count = cable.work, cable.n * cable.lines, border_columns(cable)
    z, system = work.border_shift, work.border_system
    for r in range(PADDING, PADDING + size):
        for column in range(0, count, LANES):
            store(z, r, column, 0.0)
    if work.results.coupled == IN_SKYLINE:
        for k in range(count):
            add_column(cable, k, k, 0, size, z)
        for column in range(0, count, LANES):
            substitute_skyline_columns(cable, size, 0, column, z)
    else:
        begin = 0
        while begin < cable.n:
            end = work.coupled_end[begin]
            solve_columns(cable, band, cable.lines * begin, cable.lines * end, count)
            begin = end
    for j in range(count):
        for column in range(0, count, LANES):
            store(system, j, column, 0.0)
        for w in range(2):
            at = PADDING + work.border_at[j, w]
            for r in range(4 * cable.lines if at >= PADDING else 0):
                factor = work.border_condition[j, w, r]
                for column in range(0, count if factor != 0.0 else 0, LANES):
                    sums = load(system, j, column) + factor * load(z, at + r, column)
                    store(system, j, column, sums)
        system[j, j] += work.border_compliance[j] / share_of(cable, j, share)
    invert_pivoted(system, count, work.border_order)


@inline
def first_seen(cable, k, low, high):
    """First unknown from `low` on at which border row k acts, or `high`."""
    first, places = high, cable.work.border_at[k]
    for w in range(2):
        first = min(first, places[w]) if low <= places[w] else first
    return first


@inline
def add_column(cable, k, column, low, high, z):
    """Add border row k of F, from the unknown `low` to before `high`, to a column of z."""
    for w in range(2):
        at = cable.work.border_at[k, w]
        if low <= at < high:
            for r in range(4 * cable.lines):
                z[PADDING + at + r, column] += cable.work.border_force[k, w, r]


@inline
def solve_columns(cable, band, low, high, count):
    """Z at the unknowns from `low` to before `high`, which are coupled to no others: the columns
    that are not zero, up to 32 at a time.
    """
    work, lines = cable.work, cable.lines
    z, some, here = work.border_shift, work.border_some, work.border_order
    k = 0
    while k < count:
        found, first = 0, high
        while k < count and found < SOME:
            begin = first_seen(cable, k, low, high)
            if begin < high:
                here[found], first = k, min(first, begin)
                found += 1
            k += 1
        for r in range(low, high + 2 * PADDING):
            for column in range(0, LANES if found <= LANES else SOME, LANES):
                store(some, r, column, 0.0)
        for column in range(found):
            add_column(cable, here[column], column, low, high, some)
        if found > 0 and lines == 2:
            substitute_columns(band, low, high, 7, first, found, some)
        elif found > 0 and lines == 3:
            substitute_columns(band, low, high, 11, first, found, some)
        elif found > 0:
            substitute_columns(band, low, high, 15, first, found, some)
        for r in range(PADDING + low, PADDING + high):
            for column in range(found):
                z[r, here[column]] = some[r, column]


@inline
def share_of(cable, k, share):
    """Share of the stiffness of border row k in the matrix: all of it in a step, for moments that
    act as at its end.
    """
    row = border_row(cable, k)
    whole = row >= 0 and cable.rows.line[row] == cable.dim  # a roll that gives acts at the middle
    return min(2.0 * share, 1.0) if whole else share


@inline
def substitute_columns(band, low, high, half, first, count, z):
    """`substitute_rows` for `count` columns of z, up to 32, and the unknowns from `low` to before
    `high`, which are coupled to no others; zero before `first`. More than eight columns are summed
    together, as each sum waits for its last product.
    """
    if count <= LANES:
        for r in range(first, high):
            row, at = band[r], PADDING + r
            value = load(z, at, 0)
            for k in range(half):
                value -= row[k] * load(z, at - half + k, 0)
            store(z, at, 0, value)
        for r in range(high - 1, low - 1, -1):
            row, at = band[r], PADDING + r
            value = load(z, at, 0)
            for k in range(half, 0, -1):
                value -= row[half + k] * load(z, at + k, 0)
            store(z, at, 0, value * row[half])
        return
    for r in range(first, high):
        row, at = band[r], PADDING + r
        a, b, c, d = load(z, at, 0), load(z, at, 8), load(z, at, 16), load(z, at, 24)
        for k in range(half):
            factor, i = row[k], at - half + k
            a -= factor * load(z, i, 0)
            b -= factor * load(z, i, 8)
            c -= factor * load(z, i, 16)
            d -= factor * load(z, i, 24)
        store(z, at, 0, a)
        store(z, at, 8, b)
        store(z, at, 16, c)
        store(z, at, 24, d)
    for r in range(high - 1, low - 1, -1):
        row, at = band[r], PADDING + r
        a, b, c, d = load(z, at, 0), load(z, at, 8), load(z, at, 16), load(z, at, 24)
        for k in range(half, 0, -1):
            factor, i = row[half + k], at + k
            a -= factor * load(z, i, 0)
            b -= factor * load(z, i, 8)
            c -= factor * load(z, i, 16)
            d -= factor * load(z, i, 24)
        store(z, at, 0, a * row[half])
        store(z, at, 8, b * row[half])
        store(z, at, 16, c * row[half])
        store(z, at, 24, d * row[half])


@kernel(int64, CABLE, terms=BORDERED, family=BETWEEN)
def negative_border(cable):
    """Number of negative eigenvalues that the border rows take from the matrix K, after
    `solve_border` for a symmetric system: within the constraints, K has so many less.

    The bordered matrix has those of K and the positive ones of S = C Z + compliance (Haynsworth);
    but also those within the constraints, one more for each rigid row and each positive compliance,
    and none for a negative one. So the number is that of the negative eigenvalues of S, which are
    those of its inverse, less the number of negative compliances.
    """
    work, count = cable.work, border_columns(cable)
    a = work.border_signs
    for i in range(count):
        for j in range(count):
            a[i, j] = 0.5 * (work.border_system[i, j] + work.border_system[j, i])
    return negative_eigenvalues(a, count) - np.int64(work.results.grounded)


@inline
def swap(a, size, i, j):
    """Exchange rows and columns i and j."""
    for k in range(size):
        a[i, k], a[j, k] = a[j, k], a[i, k]
    for k in range(size):
        a[k, i], a[k, j] = a[k, j], a[k, i]


@inline
def negative_eigenvalues(a, size):
    """Number of negative eigenvalues of a symmetric matrix, which is overwritten: L D L^T with
    pivots of one or two rows (Bunch & Parlett 1971, SIAM J. Numer. Anal. 8, 639-655).
    """
    negative, at = 0, 0
    while at < size:
        diagonal, best, aside, row, column = -1.0, at, 0.0, at, at
        for i in range(at, size):
            if abs(a[i, i]) > diagonal:
                diagonal, best = abs(a[i, i]), i
            for j in range(at, i):
                if abs(a[i, j]) > aside:
                    aside, row, column = abs(a[i, j]), i, j
        if diagonal >= 0.64 * aside or row == column:  # the same where entries are no numbers
            swap(a, size, at, best)
            negative += 1 if a[at, at] < 0.0 else 0
            for i in range(at + 1, size):
                factor = a[i, at] / a[at, at]
                for j in range(at + 1, size):
                    a[i, j] -= factor * a[at, j]
            at += 1
        else:  # one of its two eigenvalues is negative
            swap(a, size, at, column)
            swap(a, size, at + 1, row)
            negative += 1
            p, q, s = a[at, at], a[at + 1, at], a[at + 1, at + 1]
            inverse = 1.0 / (p * s - q * q)
            for i in range(at + 2, size):
                first = inverse * (s * a[i, at] - q * a[i, at + 1])
                second = inverse * (p * a[i, at + 1] - q * a[i, at])
                for j in range(at + 2, size):
                    a[i, j] -= first * a[at, j] + second * a[at + 1, j]
            at += 2
    return negative


@inline
def take_shares(cable, count, y):
    """y -= Z `border_share`."""
    z, shares = cable.work.border_shift, cable.work.border_share
    for k in range(count, cable.work.border_shift.shape[1]):
        shares[k] = 0.0
    if count == 1:
        for r in range(PADDING, PADDING + cable.n * cable.lines):
            y[r] -= shares[0] * z[r, 0]
        return
    for r in range(PADDING, PADDING + cable.n * cable.lines):
        sums = zero()
        for column in range(0, count, LANES):
            sums += load(shares, column) * load(z, r, column)
        y[r] -= lane_sum(sums)


@kernel(void, CABLE, boolean, VECTOR, terms=BORDERED)
def keep_border(cable, closes, y):
    """Let a correction y, of which unknown r is y[PADDING + r], keep the border rows, and if it
    `closes` the gaps of the rigid ones, close these:
    y <- y - Z (C Z + compliance)^-1 (C y + gap).
    Minus `work.border_share` are the multipliers that it adds.
    """
    work, count = cable.work, border_columns(cable)
    values = work.border_value
    for k in range(count):
        values[k] = along(cable, work.border_condition, k, 2, y, PADDING)
    for k in range(cable.rows.border, rigid_count(cable) if closes else 0):
        values[k] += work.border_gap[k]
    for k in range(count):
        share = 0.0
        for j in range(count):
            share += work.border_system[k, j] * values[j]
        work.border_share[k] = share
    take_shares(cable, count, y)


@kernel(void, CABLE, VECTOR, terms=BORDERED)
def keep_border_transposed(cable, y):
    """The transpose of `keep_border`: y <- (1 - C^T (C Z + compliance)^-T Z^T) y."""
    work, count = cable.work, border_columns(cable)
    values, z = work.border_value, work.border_shift
    for column in range(0, count, LANES):
        sums = zero()
        for r in range(PADDING, PADDING + cable.n * cable.lines):
            sums += y[r] * load(z, r, column)
        store(values, column, sums)
    for k in range(count):
        share = 0.0
        for j in range(count):
            share += work.border_system[j, k] * values[j]
        spread(cable, work.border_condition, k, -share, y, PADDING)


@kernel(void, CABLE, VECTOR, VECTOR, terms=BORDERED)
def balance_border(cable, residual, forces):
    """Remove from the residual, whose unknown r is residual[PADDING + r], the part that rigid
    border rows balance; write their forces to the entries of `forces` (rows,), and the moments of
    rolls to `work.roll_moment`.

    These forces also act on unknowns that other rows fix, so this comes before the reactions there
    are read from the residual.
    """
    if cable.rolls.rigid_rolls > 0:
        balance_rows(cable, cable.rows.border, rigid_count(cable), residual, forces)
    balance_rows(cable, 0, cable.rows.border, residual, forces)


@inline
def balance_rows(cable, begin, end, residual, forces):
    """`balance_border` with some of the rows."""
    work, count = cable.work, rigid_count(cable)
    values = work.border_value
    for k in range(count):
        values[k] = along(cable, work.border_force, k, places_in_p(cable, k), residual, PADDING)
    for k in range(begin, end):
        force = 0.0
        for j in range(count):
            force -= work.border_gram[k, j] * values[j]
        if k < cable.rows.border:
            forces[border_row(cable, k)] = force
        else:
            work.roll_moment[k - cable.rows.border] = force
        spread(cable, work.border_push, k, force, residual, PADDING)


@inline
def solve_constrained(cable, band, pushed, ahead, closes, y):
    """y <- K^-1 y within all constraint rows, with the factors of the last Newton matrix
    (`band.solve`). Unknown r is y[PADDING + r], in world coordinates. `pushed`, `ahead`: as for
    `set_border`; `closes`: as for `keep_border`.
    """
    turn_vector(cable, pushed, YES, y, PADDING)
    clear_held(cable, y, PADDING)
    solve(cable, band, y)
    keep_border(cable, closes, y)
    turn_vector(cable, ahead, NO, y, PADDING)
