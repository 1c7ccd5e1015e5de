"""Contact of the cable with itself: pressure between strands, and friction that sticks.

**Segments.** The cable is a chain of short straight segments between corners, points of its curve
at fixed material coordinates. Two segments touch unless they are closer than `chain.apart` along
one strand, or both near a joint of their strands (`chain.joints`). At the shares s, t of the two,
m = a(s) - b(t) is the vector between their axes, and
    d^2 = min over s, t of |m|^2 + r_a (s - 1/2)^2 + r_b (t - 1/2)^2
their smoothed squared distance: r, a small share of the squared length of a segment, makes s and
t unique and continuous where segments are parallel. The gap is g = d - D, with the sum D of the
radii of both.

**A step** from (s0, t0, d0) to (s1, t1, d1). The squared distance is a minimum of functions that
are linear in the squares and products of the vectors between the four ends. Hence a share c in
[0, 1] exists with which
    (1 - c) x (change of |m|^2 at s0, t0) + c x (that at s1, t1) = d1^2 - d0^2,
and the gap has the exact discrete gradient that consists of 2 m_middle / (d0 + d1) at both pairs of
material points, with the shares 1 - c and c, and m in the middle of the step. Both act along the
line between two points, equal and opposite: pressure changes neither momentum nor angular momentum,
and its energy is exact.

Pressure, bristles and losses are those of `engine.contact_law`, per length of segment, with the
displacement dy = (1 - c) (change of m at s0, t0) + c (that at s1, t1) and the normal of the
discrete gradient. Friction acts on the axes of the strands: its
moment about the point of contact, which would roll both about themselves, is left out, so friction
alone does not keep the angular momentum. When a contact goes over to the next segment, its
bristle, of the length of the penetration times mu, begins anew; its energy is lost.

Where the contact goes over, two pairs share the pressure: for a moment it is up to twice as stiff.

**Strands that overlap** when a run begins would fling each other out. They touch with a sum D
that is less by as much as they overlap and grows back at the speed RETURN, as the reach of
obstacles does (`engine.contact`). The gap then changes by the growth, too, and p times the
growth is the work that it does.

**Crossing.** Control points move straight from the start of a step to its end. A step in which two
segments would pass through each other is not valid (`validate`), so that the chain keeps its knots.

**Broad phase.** Pairs of spans that may come near are found for many steps at once (`find_near`):
neither far apart, nor of one stretch without sharp bends. Pairs of segments are found in each step
from the expected motion of these spans relative to each other.
"""

from __future__ import annotations

import numpy as np
from numba import boolean, float64, int64, void

from dlo_sim.compiling.groups import grid, load, store
from dlo_sim.compiling.kernels import ARRAY_2D, YES, inline, kernel
from dlo_sim.compiling.lanes import LANES, fabs, lane, lane_sum, sqrt, where, zero
from dlo_sim.engine.arrays import CABLE, IN_SKYLINE, LINES, MARGIN, SELF, TOUCHING, VECTOR, cable_at
from dlo_sim.engine.band import clear_held, turn_vector
from dlo_sim.engine.contact import RETURN
from dlo_sim.engine.contact_law import TINY, friction, friction_jacobian, pressure, scaled
from dlo_sim.engine.skyline import add_entry, begin_skyline, open_skyline, reach_to
from dlo_sim.terms.one_sided import depth
from dlo_sim.terms.vectors import combined, cross, dot

# Entries of the law of contact, per length of cable: k, c, k_t, c_t, mu.
STIFFNESS, DAMPING, BRISTLE, BRISTLE_DAMPING, FRICTION = range(5)
# r in squared lengths of a segment, up to LONGEST diameters: more makes strands that slide feel
# segments, and r / 2 adds to the squared distance of their ends.
BLUNT, LONGEST = 0.005, 2.0
CONE = 0.8  # cosine to its first edge, of a stretch of the cable that cannot touch itself
TURN = 0.1  # change of edges, in their lengths, until such stretches are looked for anew
# Change of an edge, in its length, up to which a stretch that is in its cone at the start of a step
# cannot cross itself; else the step is repeated in halves, and where FOLD_HALVINGS do not help, as
# where a gripper jumps, with all stretches.
FOLD, FOLD_HALVINGS = 0.4, 4
LAST_HALVINGS = 8  # of a step in which the cable passes through itself; then it may
AHEAD = 8.0  # margin of `find_near` in motions that a step allows for
ROOM, LEAST = 1.5, 0.1  # these, in expected motions, and of two spans in diameters
STRETCHED = 0.65  # half a segment, in rest lengths, that is stretched by 30 %
MEETING = 1e-6  # shares of a segment beyond its ends where it still meets others
FAR = 1e3  # [m] between the segments of lanes without a pair

# Rows of `Work.pair_ends`: both ends of both segments at the start and at the end of a step, r of
# both, length, sum of the radii.
BEGUN, ENDED, BLUNT_A, BLUNT_B, LONG, THICK = 0, 12, 24, 25, 26, 27
# Of a joint: strand and material coordinate [m] of its one and its other place, and the distance
# from it along both [m] up to which segments do not touch.
ONE, ONE_AT, OTHER, OTHER_AT, BESIDE = range(5)
# Rows of `Work.pair_law`: s0, t0, s1, t1, c; minus derivatives of the force of a pair, by rows (9),
# by the motion of m at s1, t1, which changes the gap, and by that at the mean shares, against which
# friction holds; the pressure; whether the step may have crossed.
AT, BY_GAP, BY_SLIP, PRESSURE, PASSED = 0, 5, 14, 23, 24


# -- the chain -----------------------------------------------------------------------------------


@inline
def place_corners(cable, x):
    """Set `work.corner` to the corners of all spans."""
    corner, chain = cable.work.corner, cable.chain
    for b in range(cable.blocks):
        at = MARGIN + LANES * b
        for j in range(chain.segments + 1):
            e = chain.basis[b, j]
            for d in range(cable.dim):
                value = e[0] * load(x, d, at) + e[1] * load(x, d, at + 1)
                value += e[2] * load(x, d, at + 2) + e[3] * load(x, d, at + 3)
                store(corner, 3 * j + d, LANES * b, value)


@inline
def key_of(cable, a, b, i, j):
    """The number of a pair: segment i of span a, and j of span b."""
    spans, count = len(cable.chain.arc), cable.chain.segments
    return float(((a * spans + b) * count + i) * count + j)


@inline
def pair_of(cable, key):
    """The inverse of `key_of`."""
    spans, count, number = len(cable.chain.arc), cable.chain.segments, int(key)
    j, number = number % count, number // count
    i, number = number % count, number // count
    return number // spans, number % spans, i, j


@inline
def gather(cable, at):
    """Copy the ends of the segments of all pairs to the rows of `work.pair_ends` from `at` on."""
    corner, ends, pairs = cable.work.corner, cable.work.pair_ends, cable.state.pair
    count = int(cable.state.balance.pairs)
    for p in range(count):
        a, b, i, j = pair_of(cable, pairs[0, p])
        for k in range(6):
            ends[at + k, p] = corner[3 * i + k, a]
            ends[at + 6 + k, p] = corner[3 * j + k, b]
    for p in range(count, count + -count % LANES):
        for k in range(12):
            ends[at + k, p] = FAR if k >= 6 else 0.0


@inline
def lengths_of_pairs(cable):
    """Set the constant rows of `work.pair_ends`, and `work.beside`."""
    ends, chain, beside = cable.work.pair_ends, cable.chain, cable.work.beside
    count = int(cable.state.balance.pairs)
    for b in range(len(beside)):
        beside[b] = 0.0
    for p in range(count + -count % LANES):
        ends[BLUNT_A, p] = ends[BLUNT_B, p] = 1.0
        ends[LONG, p] = ends[THICK, p] = 0.0
        if p < count:
            a, b, _, _ = pair_of(cable, cable.state.pair[0, p])
            most_a, most_b = 2.0 * LONGEST * chain.radius[a], 2.0 * LONGEST * chain.radius[b]
            ends[BLUNT_A, p] = BLUNT * min(chain.length[a], most_a) ** 2
            ends[BLUNT_B, p] = BLUNT * min(chain.length[b], most_b) ** 2
            ends[LONG, p] = 0.5 * (chain.length[a] + chain.length[b])
            ends[THICK, p] = chain.radius[a] + chain.radius[b]
            beside[a // LANES] = beside[b // LANES] = 1.0


@inline
def loaded(rows, at, p):
    """Three rows of LANES pairs as a vector."""
    return load(rows, at, p), load(rows, at + 1, p), load(rows, at + 2, p)


@inline
def segments_at(ends, at, p):
    """a(0) - b(0), and the vectors along both segments, of LANES pairs."""
    a, b = loaded(ends, at, p), loaded(ends, at + 6, p)
    along_a = combined(1.0, loaded(ends, at + 3, p), -1.0, a)
    along_b = combined(1.0, loaded(ends, at + 9, p), -1.0, b)
    return combined(1.0, a, -1.0, b), along_a, along_b


@inline
def between(segments, s, t):
    """m at the shares s and t."""
    return combined(1.0, combined(1.0, segments[0], s, segments[1]), -t, segments[2])


@inline
def within(share):
    """A share clipped to 0 .. 1."""
    above = where(share, share, 0.0)
    return where(1.0 - above, above, 1.0)


@inline
def smoothed(segments, s, t, blunt):
    """|m|^2 + r_a (s - 1/2)^2 + r_b (t - 1/2)^2; `blunt`: r_a and r_b."""
    m = between(segments, s, t)
    return dot(m, m) + blunt[0] * (s - 0.5) * (s - 0.5) + blunt[1] * (t - 0.5) * (t - 0.5)


@inline
def nearest(segments, blunt):
    """s, t and d^2 of the smoothed distance: of its minimum without bounds s is clipped, then t for
    that s, then s for that t.
    """
    w, u, v = segments
    a, b, e = dot(u, u) + blunt[0], dot(u, v), dot(v, v) + blunt[1]
    c, f = dot(u, w) - 0.5 * blunt[0], dot(v, w) + 0.5 * blunt[1]
    s = within((b * f - c * e) / (a * e - b * b))
    t = within((b * s + f) / e)
    s = within((b * t - c) / a)
    return s, t, smoothed(segments, s, t, blunt)


# -- forces and energy ---------------------------------------------------------------------------


@inline
def may_pass(before, after, square0, square1, blunt):
    """1 where two segments may pass through each other in a step: the motion of an end of one
    relative to one of the other is as long as the sum of the distances at both ends of the step.
    """
    most, excess = zero(), 0.25 * (blunt[0] + blunt[1])
    for i in range(2):
        for j in range(2):
            way = combined(1.0, between(after, i, j), -1.0, between(before, i, j))
            most = where(dot(way, way) - most, dot(way, way), most)
    near0, near1 = square0 - excess, square1 - excess
    room = sqrt(where(near0, near0, 0.0)) + sqrt(where(near1, near1, 0.0))
    return where(sqrt(most) - room, 1.0, 0.0)


@inline
def spread_forces(cable, count, out):
    """out += `work.pair_force`."""
    work, chain = cable.work, cable.chain
    push, forces = work.corner_push, work.pair_force
    for j in range(push.shape[0]):
        for c in range(0, push.shape[1], LANES):
            store(push, j, c, 0.0)
    for p in range(count):
        if work.pair_law[PRESSURE, p] > 0.0:
            a, b, i, j = pair_of(cable, cable.state.pair[0, p])
            for k in range(6):
                push[3 * i + k, a] += forces[k, p]
                push[3 * j + k, b] += forces[6 + k, p]
    for b in range(cable.blocks):
        if work.beside[b] == 0.0:
            continue
        for d in range(cable.dim):
            for k in range(4):
                value = load(out, d, MARGIN + LANES * b + k)
                for j in range(chain.segments + 1):
                    value += chain.basis[b, j][k] * load(push, 3 * j + d, LANES * b)
                store(out, d, MARGIN + LANES * b + k, value)


@kernel(void, CABLE, float64, LINES, LINES, terms=SELF)
def add_force(cable, rate, x1, out):
    """out += contact force of a step from the configuration with which it began to x1; the bristles
    at its end go to `work.pair_trial`, what a matrix needs to `work.pair_law`.

    Args:
        rate: 1 / tau; 0 for the elastic pressure at x1 alone.
    """
    chain, state, work = cable.chain, cable.state, cable.work
    count, balance = int(state.balance.pairs), state.balance
    if count == 0:
        return
    less0 = balance.pair_overlap
    less1 = balance.pair_overlap_end if rate > 0.0 else less0
    ends, kept, forces, law = work.pair_ends, work.pair_law, work.pair_force, chain.law
    k_t, mu = law[BRISTLE], law[FRICTION]
    whole = k_t + law[BRISTLE_DAMPING] * rate + TINY
    place_corners(cable, x1)
    if rate == 0.0:
        lengths_of_pairs(cable)
    gather(cable, ENDED)
    begun = BEGUN if rate > 0.0 else ENDED
    worked, lost, none = zero(), zero(), zero()
    still = none, none, none
    for p in range(0, count, LANES):
        blunt = load(ends, BLUNT_A, p), load(ends, BLUNT_B, p)
        wide, thick = load(ends, LONG, p), load(ends, THICK, p)
        thick0, thick1 = thick - less0, thick - less1
        before, after = segments_at(ends, begun, p), segments_at(ends, ENDED, p)
        s1, t1, square1 = nearest(after, blunt)
        s0, t0, square0 = s1, t1, square1
        share = zero() + 0.5
        if rate > 0.0:
            s0, t0, square0 = nearest(before, blunt)
            less = fabs(smoothed(after, s0, t0, blunt) - square1)
            more = fabs(smoothed(before, s1, t1, blunt) - square0)
            noise = 1e-14 * (square0 + square1) + TINY
            share = (less + noise) / (less + more + 2.0 * noise)
        d0, d1 = sqrt(square0), sqrt(square1)
        one = 1.0 / (d0 + d1 + TINY)
        near, far = between(before, s0, t0), between(after, s1, t1)
        near_after, far_before = between(after, s0, t0), between(before, s1, t1)
        toward = combined(one, near, one, near_after), combined(one, far_before, one, far)
        n = combined(1.0 - share, toward[0], share, toward[1])
        damped = law[DAMPING] * rate + none
        push, slope, loss = pressure(law[STIFFNESS], damped, none, d0 - thick0, d1 - thick1)
        lost += wide * loss
        worked += wide * push * (thick1 - thick0)
        first, last = scaled((1.0 - share) * push, toward[0]), scaled(share * push, toward[1])
        by_slip, along = (still, still, still), scaled(-slope, n)
        if rate > 0.0 and mu > 0.0:
            one_way = combined(1.0, near_after, -1.0, near)
            other_way = combined(1.0, far, -1.0, far_before)
            dy, z = combined(1.0 - share, one_way, share, other_way), loaded(state.pair, 1, p)
            trial, holds, z1, loss = friction(k_t, whole, mu, push, n, dy, z)
            lost += wide * loss
            first = combined(1.0, first, (share - 1.0) * holds, trial)
            last = combined(1.0, last, -share * holds, trial)
            for d in range(3):
                store(work.pair_trial, d, p, z1[d])
            by_slip, lean = friction_jacobian(whole, mu, push, slope, n, trial)
            along = combined(1.0, along, 1.0, lean)
        unit = scaled(wide / (d1 + TINY), far)
        rows = s0, t0, s1, t1, share
        for d in range(5):
            store(kept, AT + d, p, rows[d])
        for d in range(3):
            for e in range(3):
                store(kept, BY_GAP + 3 * d + e, p, along[d] * unit[e])
                store(kept, BY_SLIP + 3 * d + e, p, wide * by_slip[d][e])
        store(kept, PRESSURE, p, wide * push)
        store(kept, PASSED, p, may_pass(before, after, square0, square1, blunt))
        first, last = scaled(wide, first), scaled(wide, last)
        for d in range(3):
            store(forces, d, p, (1.0 - s0) * first[d] + (1.0 - s1) * last[d])
            store(forces, 3 + d, p, s0 * first[d] + s1 * last[d])
            store(forces, 6 + d, p, -((1.0 - t0) * first[d] + (1.0 - t1) * last[d]))
            store(forces, 9 + d, p, -(t0 * first[d] + t1 * last[d]))
    spread_forces(cable, count, out)
    work.results.pair_work, work.results.pair_loss = lane_sum(worked), lane_sum(lost)


@kernel(void, CABLE, LINES, VECTOR, terms=SELF)
def energy(cable, x, out):
    """Add the energy of pressure and bristles [J]."""
    chain, state, ends, sum_ = cable.chain, cable.state, cable.work.pair_ends, zero()
    count = int(state.balance.pairs)
    if count == 0:
        return
    place_corners(cable, x)
    lengths_of_pairs(cable)  # the pairs may be those of a state that was restored
    gather(cable, ENDED)
    for p in range(0, count, LANES):
        blunt = load(ends, BLUNT_A, p), load(ends, BLUNT_B, p)
        _, _, square = nearest(segments_at(ends, ENDED, p), blunt)
        deep = depth(sqrt(square) - (load(ends, THICK, p) - state.balance.pair_overlap))
        z = loaded(state.pair, 1, p)
        stored = chain.law[STIFFNESS] * deep * deep + chain.law[BRISTLE] * dot(z, z)
        sum_ += 0.5 * load(ends, LONG, p) * stored
    out[TOUCHING] += lane_sum(sum_)


# -- matrix --------------------------------------------------------------------------------------


@inline
def fill_side(cable, directions, p, a, b, s, t, first):
    """Rows first, first + 1, ... of `work.pair_side`: by how much m of pair p at the shares s, t
    moves along each line for a unit change of the unknowns `work.pair_at`, in the frames of the
    clamps. Returns the number of unknowns.
    """
    work, chain, lines = cable.work, cable.chain, cable.lines
    _, _, i, j = pair_of(cable, cable.state.pair[0, p])
    spare, at, side = work.step, work.pair_at, work.pair_side
    count = 0
    for r in range(a * lines, (b + 4) * lines):
        if r < (a + 4) * lines or r >= b * lines:
            at[count] = r
            count += 1
    for line in range(cable.dim):
        for k in range(count):
            spare[at[k]] = 0.0
        for k in range(4):
            value = (1.0 - s) * lane(chain.basis[a // LANES, i][k], a % LANES)
            value += s * lane(chain.basis[a // LANES, i + 1][k], a % LANES)
            spare[(a + k) * lines + line] += value
            value = (1.0 - t) * lane(chain.basis[b // LANES, j][k], b % LANES)
            value += t * lane(chain.basis[b // LANES, j + 1][k], b % LANES)
            spare[(b + k) * lines + line] -= value
        turn_vector(cable, directions, YES, spare, 0)
        clear_held(cable, spare, 0)
        for k in range(count):
            side[first + line, k] = spare[at[k]]
    return count


@kernel(void, CABLE, LINES, LINES, LINES, terms=SELF)
def couple(cable, pushed, kept, band):
    """If segments press on each other and there is room, make `work.skyline` the band matrix minus
    the Jacobian of the last `add_force`, and `work.results.coupled` IN_SKYLINE.

    The motion of s, t and c with the configuration is left out. `pushed`, `kept`: directions of the
    constraint rows on the left and on the right, as of `band.hold`.
    """
    work, law = cable.work, cable.work.pair_law
    count, pressing = int(cable.state.balance.pairs), 0
    begin_skyline(cable)
    for p in range(count):
        if law[PRESSURE, p] > 0.0:
            a, b, _, _ = pair_of(cable, cable.state.pair[0, p])
            reach_to(cable, a, b)
            pressing += 1
    if pressing == 0 or not open_skyline(cable, band):
        return
    for r in range(len(work.step)):
        work.step[r] = 0.0
    for p in range(count):
        if law[PRESSURE, p] > 0.0:
            add_pair(cable, pushed, kept, p)
    work.results.coupled = IN_SKYLINE


@inline
def add_pair(cable, pushed, kept, p):
    """Add minus the Jacobian of pair p to the skyline."""
    work, dim = cable.work, cable.dim
    law, side, at = work.pair_law, work.pair_side, work.pair_at
    a, b, _, _ = pair_of(cable, cable.state.pair[0, p])
    c = law[AT + 4, p]
    s, t = law[AT, p], law[AT + 1, p]
    last_s, last_t = law[AT + 2, p], law[AT + 3, p]
    mean_s, mean_t = s + c * (last_s - s), t + c * (last_t - t)
    fill_side(cable, pushed, p, a, b, mean_s, mean_t, 0)
    fill_side(cable, kept, p, a, b, last_s, last_t, 3)
    size = fill_side(cable, kept, p, a, b, mean_s, mean_t, 6)
    for k in range(size):
        for d in range(dim):
            value, row = 0.0, 3 * d
            for e in range(dim):
                value += law[BY_GAP + row + e, p] * side[3 + e, k]
                value += law[BY_SLIP + row + e, p] * side[6 + e, k]
            side[9 + d, k] = value
    for k in range(size):
        for r in range(size):
            value = 0.0
            for d in range(dim):
                value += side[d, r] * side[9 + d, k]
            add_entry(work, at[r], at[k], value)


# -- broad phase ---------------------------------------------------------------------------------


@inline
def motion(cable, x0, x1):
    """By how much control points of strands move relative to the first one at most [m], and the
    largest change of an edge between neighbours, as a share of its length there.
    """
    way, turn, strand = 0.0, 0.0, cable.mesh.strand
    for k in range(len(strand)):
        begin, end = MARGIN + strand[k, 0], MARGIN + strand[k, 1]
        for c in range(begin, end):
            moved = changed = length = 0.0
            for d in range(cable.dim):
                here = x1[d, c] - x0[d, c]
                moved += (here - (x1[d, MARGIN] - x0[d, MARGIN])) ** 2
                if c + 1 < end:
                    edge = x0[d, c + 1] - x0[d, c]
                    changed += (x1[d, c + 1] - x0[d, c + 1] - here) ** 2
                    length += edge * edge
            way = max(way, moved)
            turn = max(turn, changed / (length + TINY))
    return np.sqrt(way), np.sqrt(turn)


@inline
def middle_of(cable, x, b, d):
    """One line of the mean of the control points of span b."""
    c = MARGIN + b
    return 0.25 * (x[d, c] + x[d, c + 1] + x[d, c + 2] + x[d, c + 3])


@inline
def size_of(cable, x, b):
    """Distance of the farthest control point of span b from their mean."""
    square = 0.0
    for c in range(MARGIN + b, MARGIN + b + 4):
        far = 0.0
        for d in range(cable.dim):
            far += (x[d, c] - middle_of(cable, x, b, d)) ** 2
        square = max(square, far)
    return np.sqrt(square)


@inline
def leaves_cone(cable, x, first, c):
    """Whether the edge from control point c (a column) leaves the cone about that from `first`."""
    along = one = other = 0.0
    for d in range(cable.dim):
        e, f = x[d, first + 1] - x[d, first], x[d, c + 1] - x[d, c]
        along += e * f
        one += e * e
        other += f * f
    return not along > 0.0 or along * along < CONE * CONE * one * other


@inline
def find_near(cable, x, margin):
    """Set `state.near_pair`: spans that may come within a diameter of each other while control
    points move by `margin`.
    """
    state, chain, count = cable.state, cable.chain, 0
    folds = state.balance.near_fold > 0.0
    spans, most = cable.n - 3, len(state.near_pair)
    for a in range(spans):
        if chain.length[a] == 0.0:
            continue
        size = size_of(cable, x, a)
        straight = not (folds or leaves_cone(cable, x, MARGIN + a + 1, MARGIN + a))
        straight = straight and not leaves_cone(cable, x, MARGIN + a + 1, MARGIN + a + 2)
        for b in range(a, spans):
            straight = straight and cable.mesh.branch[b] == cable.mesh.branch[a]
            if b > a and straight:
                straight = not leaves_cone(cable, x, MARGIN + a + 1, MARGIN + b + 2)
            if straight or chain.length[b] == 0.0:
                continue
            room, square = size + size_of(cable, x, b) + chain.diameter + 2.0 * margin, 0.0
            for d in range(cable.dim):
                square += (middle_of(cable, x, a, d) - middle_of(cable, x, b, d)) ** 2
            if square > room * room:
                continue
            if count == most:
                cable.work.results.pairs_beyond += 1.0
                continue
            state.near_pair[count] = float(a * spans + b)
            count += 1
    state.balance.near_spans = float(count)


@inline
def relative_way(cable, change, a, b):
    """Bound of the motion of a point of span a relative to one of span b [m]."""
    one = other = 0.0
    for k in range(4):
        from_a = from_b = 0.0
        for d in range(cable.dim):
            middle = 0.5 * (change[d, MARGIN + a + 1] + change[d, MARGIN + b + 1])
            from_a += (change[d, MARGIN + a + k] - middle) ** 2
            from_b += (change[d, MARGIN + b + k] - middle) ** 2
        one, other = max(one, from_a), max(other, from_b)
    return np.sqrt(one) + np.sqrt(other)


@inline
def apart_at(corner, segments, a, b):
    """Distance of the middles of two spans [m]."""
    far, k = 0.0, 3 * (segments // 2)
    for d in range(3):
        far += (corner[k + d, a] - corner[k + d, b]) ** 2
    return np.sqrt(far)


@inline
def near_place(cable, a, i, number, u, within):
    """Whether segment i of span a is of this strand and `within` reach of its coordinate u."""
    chain = cable.chain
    begin = chain.arc[a] + i * chain.length[a]
    near = begin - within < u and u < begin + chain.length[a] + within
    return near and cable.mesh.branch[a] == int(number)


@inline
def joined(cable, a, b, i, j):
    """Whether segment i of span a and j of span b are both near a joint of their strands."""
    for k in range(len(cable.chain.joints)):
        one = cable.chain.joints[k]
        far = one[BESIDE]
        if near_place(cable, a, i, one[ONE], one[ONE_AT], far):
            if near_place(cable, b, j, one[OTHER], one[OTHER_AT], far):
                return True
        if near_place(cable, b, j, one[ONE], one[ONE_AT], far):
            if near_place(cable, a, i, one[OTHER], one[OTHER_AT], far):
                return True
    return False


@inline
def release(cable, p):
    """Count the energy of the bristle of a pair that left its contact as lost."""
    pair, chain = cable.state.pair, cable.chain
    a, b, _, _ = pair_of(cable, pair[0, p])
    square = pair[1, p] ** 2 + pair[2, p] ** 2 + pair[3, p] ** 2
    wide = 0.5 * (chain.length[a] + chain.length[b])
    cable.state.balance.dissipated += 0.5 * chain.law[BRISTLE] * wide * square


@inline
def find_pairs(cable, x, change):
    """Set `state.pair` to the segments that may touch in a step from x that is expected to be
    `change`, with their bristles; and `work.near_room`.
    """
    state, work, chain = cable.state, cable.work, cable.chain
    balance, fresh, corner = state.balance, work.fresh_pair, work.corner
    old, seen, count = int(balance.pairs), 0, 0
    spans, most = cable.n - 3, fresh.shape[1]
    place_corners(cable, x)
    for k in range(int(balance.near_spans)):
        a, b = int(state.near_pair[k]) // spans, int(state.near_pair[k]) % spans
        thick, same = (
            chain.radius[a] + chain.radius[b],
            cable.mesh.branch[a] == cable.mesh.branch[b],
        )
        way = ROOM * relative_way(cable, change, a, b) + LEAST * thick
        work.near_room[k] = way
        long_a, long_b = chain.length[a], chain.length[b]
        reach = thick + way + STRETCHED * (long_a + long_b)
        if apart_at(corner, chain.segments, a, b) > reach + (chain.segments - 1) * 0.5 * (
            long_a + long_b
        ):
            continue
        for i in range(chain.segments):
            end = chain.arc[a] + (i + 1) * long_a + chain.apart[a]
            for j in range(chain.segments):
                if same and chain.arc[b] + j * long_b < end:
                    continue
                far = 0.0
                for d in range(3):
                    here = corner[3 * i + d, a] + corner[3 * i + 3 + d, a]
                    there = corner[3 * j + d, b] + corner[3 * j + 3 + d, b]
                    far += 0.25 * (here - there) ** 2
                if far > reach * reach or joined(cable, a, b, i, j):
                    continue
                if count == most:
                    work.results.pairs_beyond += 1.0
                    continue
                key = key_of(cable, a, b, i, j)
                while seen < old and state.pair[0, seen] < key:
                    release(cable, seen)
                    seen += 1
                fresh[0, count] = key
                known = seen < old and state.pair[0, seen] == key
                for d in range(1, 4):
                    fresh[d, count] = state.pair[d, seen] if known else 0.0
                seen += 1 if known else 0
                count += 1
    for p in range(seen, old):
        release(cable, p)
    for p in range(count):
        for d in range(4):
            state.pair[d, p] = fresh[d, p]
    balance.pairs = float(count)
    lengths_of_pairs(cable)
    gather(cable, BEGUN)


@kernel(void, CABLE, float64, LINES, LINES, LINES, terms=SELF)
def begin(cable, tau, x0, x1, change):
    """Prepare a step of length tau from x0 that is expected to lead to x1 = x0 + change: find what
    may touch.
    """
    balance = cable.state.balance
    balance.pair_overlap_end = max(balance.pair_overlap - RETURN * tau, 0.0)
    way, turn = motion(cable, x0, x1)
    way = ROOM * way + 0.1 * LEAST * cable.chain.diameter
    cable.work.results.pairs_beyond = 0.0
    known = balance.near_fold == 0.0 and balance.near_way + way < balance.near_margin
    if not (known and balance.near_turn + turn < TURN):
        balance.near_margin = AHEAD * way
        balance.near_way = balance.near_turn = 0.0
        find_near(cable, x0, balance.near_margin)
    if balance.near_spans > 0.0 or balance.pairs > 0.0:
        find_pairs(cable, x0, change)


@kernel(void, int64, terms=SELF)
def reset(address):
    """Find what touches at the present configuration, from which a run begins."""
    cable = cable_at(address)
    x, change, balance = cable.state.x, cable.work.change, cable.state.balance
    for d in range(change.shape[0]):
        for c in range(0, change.shape[1], LANES):
            store(change, d, c, 0.0)
    balance.near_margin = balance.near_way = balance.near_turn = balance.near_fold = 0.0
    begin(cable, 0.0, x, x, change)


# -- the end of a step ---------------------------------------------------------------------------


@inline
def looked_at_all(cable, folds):
    """Whether the motion of a step was not longer than its pairs allow for. `folds`: one that folds
    the cable is repeated with all pairs of spans.
    """
    balance, spans, change = cable.state.balance, cable.n - 3, cable.work.change
    way, turn = motion(cable, cable.work.start, cable.state.x)
    if turn > FOLD and balance.near_fold == 0.0:
        balance.near_fold = 1.0 if folds else 0.0
        return False
    if not balance.near_way + way <= balance.near_margin:
        balance.near_margin = 0.0
        return False
    for k in range(int(balance.near_spans)):
        number = int(cable.state.near_pair[k])
        if relative_way(cable, change, number // spans, number % spans) > cable.work.near_room[k]:
            return False
    balance.near_way += way
    balance.near_turn += turn
    return True


@inline
def corner_of(ends, p, k, t):
    """End k of the segments of pair p (two of the first, two of the second), at the share t of the
    step.
    """
    k *= 3
    return (
        ends[BEGUN + k, p] + t * (ends[ENDED + k, p] - ends[BEGUN + k, p]),
        ends[BEGUN + k + 1, p] + t * (ends[ENDED + k + 1, p] - ends[BEGUN + k + 1, p]),
        ends[BEGUN + k + 2, p] + t * (ends[ENDED + k + 2, p] - ends[BEGUN + k + 2, p]),
    )


@inline
def volume(ends, p, t):
    """u . (v x m) of the segments u, v of pair p at the share t of the step: zero in one plane."""
    a, b = corner_of(ends, p, 0, t), corner_of(ends, p, 2, t)
    u = combined(1.0, corner_of(ends, p, 1, t), -1.0, a)
    v = combined(1.0, corner_of(ends, p, 3, t), -1.0, b)
    return dot(u, cross(v, combined(1.0, a, -1.0, b)))


@inline
def meet(ends, p, t):
    """Whether the segments of pair p, in one plane at the share t of the step, meet there."""
    a, b = corner_of(ends, p, 0, t), corner_of(ends, p, 2, t)
    u = combined(1.0, corner_of(ends, p, 1, t), -1.0, a)
    v = combined(1.0, corner_of(ends, p, 3, t), -1.0, b)
    w = combined(1.0, a, -1.0, b)
    across = cross(u, v)
    square = dot(across, across) + TINY
    s, r = dot(cross(v, w), across) / square, dot(cross(u, w), across) / square
    return -MEETING <= s <= 1.0 + MEETING and -MEETING <= r <= 1.0 + MEETING


@inline
def root(ends, p, low, high, at_low):
    """Zero of `volume` between two shares of the step with different signs, the first `at_low`."""
    for _ in range(40):
        middle = 0.5 * (low + high)
        if (volume(ends, p, middle) > 0.0) == (at_low > 0.0):
            low = middle
        else:
            high = middle
    return 0.5 * (low + high)


@inline
def crosses(cable, p):
    """Whether the segments of pair p pass through each other when their ends move straight: they
    meet where `volume`, a cubic polynomial, is zero. In planar motion it always is: they meet if
    they do at the end.
    """
    ends = cable.work.pair_ends
    if cable.dim == 2:
        return meet(ends, p, 1.0)
    f0, f1 = volume(ends, p, 0.0), volume(ends, p, 1.0)
    g0, g1 = volume(ends, p, 1.0 / 3.0), volume(ends, p, 2.0 / 3.0)
    # derivative a t^2 + b t + c of the polynomial through these four
    a = 13.5 * (f1 - f0 + 3.0 * (g0 - g1))
    b = 9.0 * (2.0 * f0 - 5.0 * g0 + 4.0 * g1 - f1)
    c = -5.5 * f0 + 9.0 * g0 - 4.5 * g1 + f1
    first, second = 1.0, 1.0
    under = b * b - 4.0 * a * c
    if under > 0.0:
        q = -0.5 * (b + np.copysign(np.sqrt(under), b))
        first = q / a if a != 0.0 else 1.0
        second = c / q if q != 0.0 else 1.0
        first, second = min(first, second), max(first, second)
    low, at_low = 0.0, f0
    for k in range(3):
        high = first if k == 0 else (second if k == 1 else 1.0)
        if not low < high <= 1.0:
            continue
        at_high = volume(ends, p, high)
        if (at_low > 0.0) != (at_high > 0.0) and meet(ends, p, root(ends, p, low, high, at_low)):
            return True
        low, at_low = high, at_high
    return False


@inline
def too_many(cable, level, left):
    """Whether a step that was halved `level` times, and can be `left` times more, should be, since
    there is no room for the pairs that may touch in it.
    """
    return cable.work.results.pairs_beyond > 0.0 and level < LAST_HALVINGS and left > 0


@kernel(boolean, CABLE, float64, int64, int64, terms=SELF)
def validate(cable, tau, level, left):
    """Whether a converged step of length tau may stand: all that came
    near was looked at, and nothing passed through itself; or it is counted, since the step was
    halved `level` times, and can be only `left` times more.
    """
    last = level >= LAST_HALVINGS or left == 0
    beyond = cable.work.results.pairs_beyond
    if not looked_at_all(cable, level >= FOLD_HALVINGS):
        if left > 0:
            return False
        beyond += 1.0
    cable.state.balance.pairs_lost += beyond
    work, count = cable.work, int(cable.state.balance.pairs)
    if count == 0:
        return True
    add_force(cable, 1.0 / tau, cable.state.x, work.rate)
    for p in range(count):
        if work.pair_law[PASSED, p] > 0.0 and crosses(cable, p):
            if not last:
                return False
            cable.state.balance.crossed += 1.0
            return True
    return True


@inline
def commit(cable):
    """Account for a step that was found valid, and keep its bristles."""
    state, count = cable.state, int(cable.state.balance.pairs)
    state.balance.pair_overlap = state.balance.pair_overlap_end
    if state.balance.near_fold > 0.0:  # the next step looks anew, and leaves out what is straight
        state.balance.near_fold = state.balance.near_margin = 0.0
    if count == 0:
        return
    state.balance.dissipated += cable.work.results.pair_loss
    state.balance.drive_work += cable.work.results.pair_work
    if cable.chain.law[FRICTION] > 0.0:
        for p in range(count):
            for d in range(3):
                state.pair[1 + d, p] = cable.work.pair_trial[d, p]


# -- what touches, for reports -------------------------------------------------------------------


@kernel(void, int64, ARRAY_2D, terms=SELF)
def report(address, out):
    """Of all pairs at the present configuration: gap [m]; length [m] that touches, else 0; on the
    first of the two the material coordinate [m] and the force [N], by line (3); its strand.
    """
    cable, values = cable_at(address), grid(out)
    chain, ends, pair = cable.chain, cable.work.pair_ends, cable.state.pair
    place_corners(cable, cable.state.x)
    lengths_of_pairs(cable)
    gather(cable, ENDED)
    for p in range(0, values.shape[0], LANES):
        blunt = load(ends, BLUNT_A, p), load(ends, BLUNT_B, p)
        segments = segments_at(ends, ENDED, p)
        s, t, square = nearest(segments, blunt)
        far = sqrt(square)
        gap, wide = far - load(ends, THICK, p), load(ends, LONG, p)
        deep = depth(gap + cable.state.balance.pair_overlap)
        z = loaded(pair, 1, p)
        push = -chain.law[STIFFNESS] * deep
        f = combined(push / (far + TINY), between(segments, s, t), -chain.law[BRISTLE], z)
        for k in range(min(LANES, values.shape[0] - p)):
            row = values[p + k]
            row[0] = lane(gap, k)
            if lane(deep, k) < 0.0:
                a, _, i, _ = pair_of(cable, pair[0, p + k])
                row[1] = lane(wide, k)
                row[2] = chain.arc[a] + (i + lane(s, k)) * chain.length[a]
                row[6] = cable.mesh.branch[a]
                for d in range(3):
                    row[3 + d] = lane(wide, k) * lane(f[d], k)
