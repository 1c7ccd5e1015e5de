"""Contact with obstacles: pressure along the normal, and friction that sticks.

**Gap.** An obstacle is a core (half space, box, cylinder, tube) grown by its `reach`: its own
rounding and the radius of the cable. A sphere is a box of size zero, a capsule one that is long in
z only. The wall of a tube has no thickness but what it is grown by; a ring is a tube of length 0.
A mesh has a field of signed distances on a grid (`engine.distance_field`).
At y = R^T (r - c), the place of a sample r of the cable in the frame of the obstacle, the gap is
g = d(y) - reach with the signed distance d from the core. Obstacles may move: `state.pose` has R
and c at the start, the middle and the end of a step, which are equal between steps.

**Samples.** The cable touches at samples of its own, finer than the quadrature, with both ends of
the cable: sharp tips would sink in between Gauss points. Neighbouring samples of one span are the
lanes of a group.

**A step** from y0 to y1 of length tau, dy = y1 - y0, has for each sample and obstacle
    the discrete gradient of the gap, n = m + (g1 - g0 - m.dy) dy / |dy|^2 with
m = (f0 n0 + f1 n1) / (f0 + f1), so that n.dy = g1 - g0, with the distances f from the centre of
curvature: the last part vanishes on faces, spheres and cylinders, and where dy is round-off;
    the pressure p and the friction f of `engine.contact_law`, with the damping c = l/2 + DAMPED
(1 - l) and the share l of landing: 1 where a sample lands or rests, nearly 0 where it slid in the
step before (`slides_along`). The bristle z is in the frame of the obstacle, undamped.
The force on the cable per length is F = R_middle (p n + f). The obstacle does the work
F.(r1 - r0) - (p n + f).dy.

**Landing.** A step of the midpoint family that stops a sample at a surface within its length leaves
it any velocity between those of coming and going, v1 = 2 (r1 - r0) / tau - v0, which depends on
where the step began. So at the end of a step what is pressed gets the velocity that it has after
contact, relative to the obstacle: along the normal minus the restitution times that at which it
came, and none across where friction holds. Impulses bring that about, which change the velocities
least in the metric of the mass (Moreau 1988); with those of the step they obey the law of Coulomb.
They do nothing where what is pressed already has that velocity, as at rest and in steady sliding.
Restitution is that of Newton, the same at every step: 0 lies where it lands, 1 loses nothing.
    With restitution 0, samples that were pressed less than LIES ago and have left the surface are
held, too, while others land. A span of which a part has landed cannot follow the kink in the
velocity there, and would throw that part up, at some steps by 5 cm, at others not. What holds
it are impulses that pull, so friction is that of the sum of all impulses along the normal: the
share of it in those that push is the share that the law of Coulomb counts (`net_share`).

**Rolling.** A cable that twists in space also turns about its axis by an angle phi relative to the
obstacle, which moves its surface, a radius a off the axis, by - phi l, l = a t x n / (|t| |n|) with
the tangent t. Friction then sees dy - phi l in place of dy, and turns the cable about its axis by
the moment m = - l.f per length. With the derivative S of `engine.contact_law`,
    - dm/dphi = l.S l,   dF/dphi = S l,   dm/dr = l.(- df/dr).
A sample that sticks ties the spin to the motion of the axis, as a wheel. Without that, friction
acts on the axis. The moment of friction along the cable, which bends it, is left out.

**Overlap that decays.** An obstacle that jumps into the cable would fling it out. Instead its reach
becomes less at first by the same length for all samples, the largest by which one is pressed in
more than before (`simulation.obstacles.let_overlap`), and the reach to each sample grows back at up
to RETURN, as fast as the cable comes out. Where it does not come, being held or pushed out of two
opposite sides, the reach grows slowly, and waits at last; its force is bounded. The gap then
changes by n.dy and the growth, whose work p times growth is that of the obstacle.

**Broad phase.** Groups of samples near an obstacle are found for many steps at once: until cable
and obstacles have moved by `balance.contact_margin`.

Everything is in coordinates of lines: a planar cable has its two, and zero for the third.
"""

from __future__ import annotations

import numpy as np
from numba import boolean, float64, int64, void

from dlo_sim.compiling.groups import grid, load, store
from dlo_sim.compiling.kernels import ARRAY_2D, inline, kernel
from dlo_sim.compiling.lanes import (
    LANES,
    any_above,
    bits_above,
    fabs,
    lane,
    lane_sum,
    sqrt,
    where,
    zero,
)
from dlo_sim.engine.arrays import (
    CABLE,
    CONTACT,
    LINES,
    MARGIN,
    ROLLING,
    TOUCHING,
    VECTOR,
    cable_at,
)
from dlo_sim.engine.contact_law import (
    TINY,
    friction,
    friction_jacobian,
    held_share,
    pressure,
    product,
    product_from_left,
    scaled,
    with_product,
)
from dlo_sim.engine.grasps import POSITION, component, elapsed, moves, rotation_at
from dlo_sim.engine.shapes import (
    BEND,
    DISTANCE,
    FAR,
    HALF_SPACE,
    NORMAL,
    PLACE,
    POINT,
    SIZE,
    set_distance,
    three,
)
from dlo_sim.terms.one_sided import depth
from dlo_sim.terms.vectors import combined, cross, dot

START, MIDDLE, END = 0, 12, 24  # entries of a pose: R by rows (9), c (3)
BEGUN, ENDED = 0, 1  # of `work.measured`: at the start and the end of a step
STIFFNESS, BRISTLE, FRICTION = range(3)  # entries of the law of an obstacle: k, k_t, mu
# Entries of `work.touch` of a sample, of the last forces: p, dp/dg1, p / (f0 + f1), n (3), the
# trial force of friction (3), and the lever l (3).
PRESSURE, SLOPE, TURN, TOWARD, TRIAL, LEVER = 0, 1, 2, 3, 6, 9
# Entries of `work.impulses` of a sample at the end of a step, in the frame of the obstacle: normal
# (3); impulses of pressure and friction (3) in the step, per length; velocity of the obstacle, by
# line (3); that after contact along the normal; rate at which the obstacle turns about the cable;
# whether friction holds, 1 or 0; where it slides, its impulse less that of the step (3); what is
# known of the impulse of the pressure, less that of the step; 1 if it gets that velocity, else 0.
UNIT, PUSHED, RUBBED, CARRIED, BOUNCE, TURNS, STICKS, SLID, KNOWN = 0, 3, 4, 7, 10, 11, 12, 13, 16
HELD = 17

SMOOTH = 1e-18  # [m^2], of a motion of 1e-9 m, below which n needs no directional part
JUMP = 0.05  # share of the reach that a step may move past an obstacle without a look at normals
RETURN = 0.2  # [m/s], at which overlap with an obstacle decays
# Overlap of a sample with an obstacle decays by up to FOLLOWED times as much in a step as
# the sample came out in the last one; where it does not, being held, until the pressure is that of
# so many weights of the cable on EARTH, after RISE [s], as a sudden push would lever it out.
FOLLOWED, PRESSED, RISE, EARTH = 2.0, 150.0, 0.15, 9.81
SHALLOW = 0.03  # diameters that a cable may begin inside, and up to which nothing is said
# Weight of the end of the step, beyond its middle, in the pressure on samples that slide.
DAMPED = 0.01
RESTING = 1e-3  # [m/s], below which what touches does not slide
STOP = 1e2  # penalty for other velocities than those after contact, in linear densities
LIES = 5e-3  # [s], for which a sample that was pressed is held while others land
SAME = 1e-3  # change of an impulse of friction, in its limit, that counts as none
AHEAD = 16.0  # expected motions of a step that the margin of the broad phase allows for


# -- obstacles -----------------------------------------------------------------------------------


@inline
def line_axis(cable, d):
    """World axis of line d; that normal to the plane of a planar cable for d = 2."""
    return cable.axes[d] if d < cable.dim else 3 - cable.axes[0] - cable.axes[1]


@kernel(void, CABLE, int64, int64, float64, terms=CONTACT)
def set_pose(cable, o, at, t):
    """Set the pose of obstacle o at time t, its entries from `at` on."""
    m, pose = cable.inputs.obstacle[o], cable.state.pose[o]
    s, r = elapsed(m, t), rotation_at(m, t)
    for d in range(3):
        a = line_axis(cable, d)
        row = r[0:3] if a == 0 else (r[3:6] if a == 1 else r[6:9])
        for k in range(3):
            pose[at + 3 * d + k] = row[k]
        way = m[POSITION + 3 + a] + s * m[POSITION + 6 + a]
        pose[at + 9 + d] = m[POSITION + a] + s * way - cable.contact.still[a]


@inline
def settle_overlap(cable, o, at):
    """The overlap at the start (0) or end (1) of a step is that of the whole step."""
    for k in range(int(cable.state.near_count[o])):
        overlap = cable.state.overlap[o, int(cable.state.near[o, k])]
        overlap[1 - at] = overlap[at]


@inline
def settle_pose(pose, at):
    """The pose at `at` is that of the whole step."""
    for k in range(12):
        value = pose[at + k]
        pose[START + k] = value
        pose[MIDDLE + k] = value
        pose[END + k] = value


@inline
def let_all_be_near(cable):
    """Let all groups of samples be near all obstacles until a step begins."""
    contact, state = cable.contact, cable.state
    state.balance.contact_margin = 0.0
    for o in range(contact.count):
        count = contact.end[o] - contact.begin[o]
        state.near_count[o] = count
        for k in range(count):
            state.near[o, k] = contact.begin[o] + k


@kernel(void, int64, terms=CONTACT)
def look_everywhere(address):
    """`let_all_be_near`."""
    let_all_be_near(cable_at(address))


@kernel(void, int64, float64, terms=CONTACT)
def place_obstacles(address, t):
    """Set the poses of all obstacles to those at time t."""
    cable = cable_at(address)
    for o in range(cable.contact.count):
        set_pose(cable, o, END, t)
        settle_pose(cable.state.pose[o], END)
    let_all_be_near(cable)


@inline
def obstacles_move(cable):
    """Whether any obstacle moves or was moved."""
    for o in range(cable.contact.count):
        if moves(cable.inputs.obstacle[o]):
            return True
    return False


@inline
def pose_way(cable, o):
    """By how much at most a point of the core of obstacle o moves in the step [m]."""
    pose = cable.state.pose[o]
    turn, way = 0.0, 0.0
    for k in range(12):
        moved = pose[END + k] - pose[START + k]
        if k < 9:
            turn += moved * moved
        else:
            way += moved * moved
    return np.sqrt(way) + np.sqrt(turn) * cable.contact.extent[o]


@inline
def turned_back(pose, at, v):
    """R^T v."""
    return (
        pose[at] * v[0] + pose[at + 3] * v[1] + pose[at + 6] * v[2],
        pose[at + 1] * v[0] + pose[at + 4] * v[1] + pose[at + 7] * v[2],
        pose[at + 2] * v[0] + pose[at + 5] * v[1] + pose[at + 8] * v[2],
    )


@inline
def to_body(pose, at, r):
    """R^T (r - c)."""
    return turned_back(pose, at, (r[0] - pose[at + 9], r[1] - pose[at + 10], r[2] - pose[at + 11]))


@inline
def to_lines(pose, at, v):
    """R v."""
    return (
        pose[at] * v[0] + pose[at + 1] * v[1] + pose[at + 2] * v[2],
        pose[at + 3] * v[0] + pose[at + 4] * v[1] + pose[at + 5] * v[2],
        pose[at + 6] * v[0] + pose[at + 7] * v[1] + pose[at + 8] * v[2],
    )


@inline
def from_body(pose, at, y):
    """R y + c."""
    return combined(1.0, to_lines(pose, at, y), 1.0, (pose[at + 9], pose[at + 10], pose[at + 11]))


# -- samples of the cable ------------------------------------------------------------------------


@inline
def line_of(cable, x, line, g, e):
    """Sum of one line of the control points of the span of a group with weights e (4)."""
    at, value = cable.contact.first[g], zero()
    for k in range(4):
        value += e[k] * x[line, at + k]
    return value


@inline
def line_at(cable, x, g, line):
    """One line of x at the samples of a group."""
    return line_of(cable, x, line, g, cable.contact.basis[g])


@inline
def weighted(cable, x, g, e):
    """Sums of the control points of the span of a group with weights e (4)."""
    third = line_of(cable, x, 2, g, e) if cable.dim == 3 else zero()
    return line_of(cable, x, 0, g, e), line_of(cable, x, 1, g, e), third


@inline
def sample_at(cable, x, g):
    """Points of the curve at the samples of a group."""
    return weighted(cable, x, g, cable.contact.basis[g])


@inline
def push_line(cable, g, line, f, out):
    """out += one line of the forces on the samples of a group."""
    e, at = cable.contact.basis[g], cable.contact.first[g]
    for k in range(4):
        out[line, at + k] += lane_sum(e[k] * f)


@inline
def push_samples(cable, g, f, out):
    """out += forces on the samples of a group."""
    push_line(cable, g, 0, f[0], out)
    push_line(cable, g, 1, f[1], out)
    if cable.dim == 3:
        push_line(cable, g, 2, f[2], out)


@inline
def put(kept, at, v):
    """Set three successive entries of lanes."""
    kept[at], kept[at + 1], kept[at + 2] = v


@inline
def same_place(kept, y):
    """Whether `work.measured` of a group is known, and that of its places y; not if a place is not
    finite.
    """
    a, b, c = kept[PLACE] - y[0], kept[PLACE + 1] - y[1], kept[PLACE + 2] - y[2]
    return lane_sum(fabs(a) + fabs(b) + fabs(c)) == 0.0 and any_above(kept[FAR])


@kernel(void, CABLE, int64, int64, int64, LINES, terms=CONTACT)
def measure(cable, o, g, when, x):
    """Set `work.measured[o, g, when]` to the points on x of the samples of a group, their places in
    the frame of an obstacle, and the distance of these; `when`: BEGUN for its pose at the start of
    the step, or ENDED. What is known of these places is not computed again.
    """
    kept, ended = cable.work.measured[o, g, when], cable.work.measured[o, g, ENDED]
    r = sample_at(cable, x, g)
    y = to_body(cable.state.pose[o], START if when == BEGUN else END, r)
    put(kept, POINT, r)
    if same_place(kept, y):
        return
    if when == BEGUN and same_place(ended, y):
        for k in range(PLACE, SIZE):
            kept[k] = ended[k]
    else:
        set_distance(cable, o, g, when, y)


@inline
def obstacle_turn(pose):
    """Rotation of an obstacle in the step, to second order, as a vector in its frame."""
    turn = zero(), zero(), zero()
    for d in range(3):
        a0, a1, a2 = pose[START + 3 * d], pose[START + 3 * d + 1], pose[START + 3 * d + 2]
        b0, b1, b2 = pose[END + 3 * d], pose[END + 3 * d + 1], pose[END + 3 * d + 2]
        turn = (
            turn[0] + 0.5 * (b1 * a2 - b2 * a1),
            turn[1] + 0.5 * (b2 * a0 - b0 * a2),
            turn[2] + 0.5 * (b0 * a1 - b1 * a0),
        )
    return turn


@inline
def rolled(cable, o, g, x, n):
    """The angle phi by which the cable turns about its axis relative to an obstacle in a step to x,
    and the lever l, at the mean tangent of the step.
    """
    pose, slope = cable.state.pose[o], cable.contact.slope[g]
    t0 = turned_back(pose, START, weighted(cable, cable.work.start, g, slope))
    t1 = turned_back(pose, END, weighted(cable, x, g, slope))
    t = combined(1.0, t0, 1.0, t1)
    inverse = 1.0 / (sqrt(dot(t, t)) + TINY)
    size = (cable.contact.radius + cable.contact.wider[g]) * inverse / (sqrt(dot(n, n)) + TINY)
    own = line_at(cable, cable.work.change, g, cable.dim)
    return own - inverse * dot(obstacle_turn(pose), t), scaled(size, cross(t, n))


# -- forces, energy, Jacobian --------------------------------------------------------------------


@inline
def reach_to(contact, o, g):
    """By how much the core of an obstacle is grown where it meets the samples of a group."""
    return contact.reach[o] + contact.wider[g]


@inline
def misses(contact, o, g0, g1, dy):
    """Whether no lane touches or passes an obstacle in a step dy: it is outside before and after,
    and moves by no more than both gaps; false for a half space, where nothing is saved.

    That bounds the way of a field whose slope is at most 1. The spline of a mesh overshoots where a
    wall is thinner than two cells, with slopes up to 1.33 at one of 1.2 cells: there a step may
    touch and be taken to miss.
    """
    if contact.core[o] == HALF_SPACE:
        return False
    room = (g0 + g1) * (g0 + g1) - dot(dy, dy)
    return not any_above(1.0 - where(g0, where(g1, where(room, 1.0, 0.0), 0.0), 0.0))


@inline
def toward(contact, o, reach, before, after, gaps, dy):
    """n of a step dy between two `measured` with this sum of the gaps, and 1 where it may have
    passed the obstacle, grown by its `reach`.
    """
    n, m, jumped = three(before, NORMAL), three(after, NORMAL), zero()
    if contact.core[o] == HALF_SPACE:
        return m, jumped
    way, closing = dot(dy, dy), after[DISTANCE] - before[DISTANCE]
    mean = combined(before[FAR], n, after[FAR], m)
    mean = scaled(1.0 / (before[FAR] + after[FAR]), mean)
    far = sqrt(way)
    jumped = where(far - gaps, 1.0, 0.0) * where(0.5 - dot(n, m), 1.0, 0.0)
    jumped = jumped * where(far - JUMP * reach, 1.0, 0.0)
    # Not across the opening of a ring, from one side to the other.
    jumped = jumped * where(-dot(n, dy), 1.0, where(dot(m, dy), 1.0, 0.0))
    return combined(1.0, mean, (closing - dot(mean, dy)) / (way + SMOOTH), dy), jumped


@inline
def friction_at(cable, o, g):
    """Coefficients of friction of the samples of a group: 0 where overlap decays, as friction would
    hold fast what is pushed out in different directions.
    """
    return where(cable.state.overlap[o, g, 1], 0.0, cable.contact.law[o, FRICTION])


@inline
def release(cable, o, g):
    """Let the samples of a group, none of which touches, lose their bristles; returns |z|^2."""
    z, none = three(cable.state.bristle[o, g], 0), zero()
    put(cable.work.trial[o, g], 0, (none, none, none))
    return dot(z, z)


@kernel(void, CABLE, boolean, LINES, LINES, terms=CONTACT)
def add_force(cable, steps, x, out):
    """out += contact force of a step to x from the configuration with which it began (`begin`).

    Sets `work.touch`; the bristles at its end, `work.trial`; `work.touched`, a number that tells
    which samples touch and slide; and of `work.results` the work of the obstacles, the loss [J],
    how many samples may have passed through an obstacle, and how many are near the middle of one.
    `steps` is false for the pressure at x alone.
    """
    contact, state, work = cable.contact, cable.state, cable.work
    worked, lost, jumps, deep, touched = zero(), zero(), zero(), zero(), 0
    for o in range(contact.count):
        law, pose = contact.law[o], state.pose[o]
        rubbed, k_t = steps and law[FRICTION] > 0.0, law[BRISTLE]
        for k in range(int(state.near_count[o])):
            g = int(state.near[o, k])
            measure(cable, o, g, ENDED, x)
            before, after = (
                work.measured[o, g, BEGUN if steps else ENDED],
                work.measured[o, g, ENDED],
            )
            dy = combined(1.0, three(after, PLACE), -1.0, three(before, PLACE))
            reach = reach_to(contact, o, g)
            g0, g1, w = before[DISTANCE] - reach, after[DISTANCE] - reach, contact.weight[g]
            touch, overlap = work.touch[o, g], state.overlap[o, g]
            if misses(contact, o, g0, g1, dy):
                touch[PRESSURE] = zero()
                if rubbed:
                    lost += 0.5 * k_t * w * release(cable, o, g)
                continue
            g0, g1 = g0 + overlap[0], g1 + overlap[1]
            n, jumped = toward(contact, o, reach, before, after, g0 + g1, dy)
            lands = 1.0 - state.slides[o, g, 0]
            damped = law[STIFFNESS] * (DAMPED + (0.5 - DAMPED) * lands) if steps else zero()
            p, slope, loss = pressure(law[STIFFNESS], damped, lands, g0, g1)
            touch[PRESSURE], touch[SLOPE] = p, slope
            touch[TURN] = p / (before[FAR] + after[FAR])
            put(touch, TOWARD, n)
            jumps += where(w, jumped, 0.0)
            deep += where(w, where(-g1 - contact.wider[g] - contact.middle[o], 1.0, 0.0), 0.0)
            bits = bits_above(p) | bits_above(g1) << LANES
            lost += w * loss
            worked += w * (overlap[0] - overlap[1]) * p
            f = scaled(p, n)
            if rubbed:
                phi, lever = zero(), (zero(), zero(), zero())
                if cable.terms & ROLLING:
                    phi, lever = rolled(cable, o, g, x, n)
                    put(touch, LEVER, lever)
                mu, z = friction_at(cable, o, g), three(state.bristle[o, g], 0)
                seen = combined(1.0, dy, -phi, lever)
                trial, share, z1, loss = friction(k_t, k_t, mu, p, n, seen, z)
                lost += w * loss
                put(work.trial[o, g], 0, z1)
                f = combined(1.0, f, -share, trial)
                if cable.terms & ROLLING:
                    own = line_at(cable, work.change, g, cable.dim)
                    moment = share * dot(lever, trial)
                    worked += w * moment * (own - phi)
                    push_line(cable, g, cable.dim, w * moment, out)
                bits |= bits_above(where(p, 1.0 - share, 0.0)) << 2 * LANES
                put(touch, TRIAL, trial)
            touched = ((touched ^ bits) * 1000003 + g) & 0x7FFFFFFF
            on_lines = to_lines(pose, MIDDLE, f)
            way = combined(1.0, three(after, POINT), -1.0, three(before, POINT))
            worked += w * (dot(on_lines, way) - dot(f, dy))
            push_samples(cable, g, scaled(w, on_lines), out)
    work.touched[0], results = touched, work.results
    results.contact_work, results.contact_loss = lane_sum(worked), lane_sum(lost)
    results.contact_jumps, results.contact_deep = lane_sum(jumps), lane_sum(deep)


@kernel(void, CABLE, LINES, VECTOR, terms=CONTACT)
def energy(cable, x, out):
    """Add the energy of pressure and bristles [J], obstacles at the end of the last step."""
    contact, state, sum_ = cable.contact, cable.state, zero()
    for o in range(contact.count):
        law = contact.law[o]
        for k in range(int(state.near_count[o])):
            g = int(state.near[o, k])
            measure(cable, o, g, ENDED, x)
            gap = cable.work.measured[o, g, ENDED][DISTANCE] - reach_to(contact, o, g)
            deep, z = depth(gap + state.overlap[o, g, 1]), three(state.bristle[o, g], 0)
            stored = law[STIFFNESS] * deep * deep + law[BRISTLE] * dot(z, z)
            sum_ += 0.5 * contact.weight[g] * stored
    out[TOUCHING] += lane_sum(sum_)


@kernel(void, CABLE, boolean, float64, LINES, terms=CONTACT)
def add_tangent(cable, steps, scale, band):
    """band -= scale times the Jacobian of the last `add_force` by the end of the step."""
    contact, work, span, none = cable.contact, cable.work, -1, zero()
    for o in range(contact.count):
        law = contact.law[o]
        for k in range(int(cable.state.near_count[o])):
            g = int(cable.state.near[o, k])
            touch, after = work.touch[o, g], work.measured[o, g, ENDED]
            p, slope, turn = touch[PRESSURE], touch[SLOPE], touch[TURN]
            if not any_above(p):
                continue
            n, diagonal, mixed = three(touch, TOWARD), three(after, BEND), three(after, BEND + 3)
            h = (
                scaled(-turn, (diagonal[0], mixed[0], mixed[1])),
                scaled(-turn, (mixed[0], diagonal[1], mixed[2])),
                scaled(-turn, (mixed[1], mixed[2], diagonal[2])),
            )
            push = scaled(turn - slope, n)
            by_spin = by_place = (none, none, none)
            held = none
            if steps and law[FRICTION] > 0.0:
                mu, trial = friction_at(cable, o, g), three(touch, TRIAL)
                s, lean = friction_jacobian(law[BRISTLE], mu, p, slope, n, trial)
                push = combined(1.0, push, 1.0, lean)
                if cable.terms & ROLLING:
                    lever = three(touch, LEVER)
                    by_spin = product(s, lever)
                    held = dot(lever, by_spin)
                    of_place = with_product(s, lean, three(after, NORMAL))
                    by_place = product_from_left(lever, of_place)
                h = (
                    combined(1.0, h[0], 1.0, s[0]),
                    combined(1.0, h[1], 1.0, s[1]),
                    combined(1.0, h[2], 1.0, s[2]),
                )
            h = with_product(h, push, three(after, NORMAL))
            spun = by_spin, by_place, held
            span = add_samples(cable, o, g, MIDDLE, h, spun, scale, span, band)
    if span >= 0:
        add_span(cable, span, band)


@inline
def add_samples(cable, o, g, turned_at, h, spun, scale, span, band):
    """band += `scale` times the integral of R h R_end^T over the samples of a group, with R of the
    pose at `turned_at`; and of `spun`, where the cable rolls: minus the derivatives of force by
    spin (R f) and of moment by place (f R_end^T), and the one of moment by spin. They wait in
    `work.contact_sums` until those of another span begin; returns the first column of the span that
    waits.
    """
    contact, pose = cable.contact, cable.state.pose[o]
    h = to_lines(pose, END, h[0]), to_lines(pose, END, h[1]), to_lines(pose, END, h[2])
    w, e, here = scale * contact.weight[g], contact.basis[g], contact.first[g]
    h = scaled(w, h[0]), scaled(w, h[1]), scaled(w, h[2])
    if here != span and span >= 0:
        add_span(cable, span, band)
    sums = cable.work.contact_sums
    if cable.terms & ROLLING:  # with loops of known length
        spin, place = to_lines(pose, turned_at, spun[0]), to_lines(pose, END, spun[1])
        add_lines(sums, e, 4, pose, turned_at, h, scaled(-w, spin))
        add_line(sums, e, 4, 3, scaled(-w, place), w * spun[2])
    elif cable.dim == 3:
        add_lines(sums, e, 3, pose, turned_at, h, h[0])
    else:
        add_lines(sums, e, 2, pose, turned_at, h, h[0])
    return here


@inline
def add_lines(sums, e, size, pose, at, h, last):
    """Add what a sample with basis values e adds to the lines of R h, and `last`, their entries on
    the twist: see `add_line`.
    """
    for i in range(min(size, 3)):
        f = combined(pose[at + 3 * i], h[0], pose[at + 3 * i + 1], h[1])
        f = combined(1.0, f, pose[at + 3 * i + 2], h[2])
        add_line(sums, e, size, i, f, component(last, i))


@inline
def add_line(sums, e, size, i, f, last):
    """Add what a sample with basis values e adds to line i between all pairs of control points of
    its span, from line i of its derivative, (f, last): size^2 rows of `sums` for each pair.
    """
    at = size * i
    for first in range(4):
        for other in range(first, 4):
            both = e[first] * e[other]
            store(sums, at, 0, load(sums, at, 0) + both * f[0])
            store(sums, at + 1, 0, load(sums, at + 1, 0) + both * f[1])
            if size > 2:
                store(sums, at + 2, 0, load(sums, at + 2, 0) + both * f[2])
            if size > 3:
                store(sums, at + 3, 0, load(sums, at + 3, 0) + both * last)
            at += size * size


@inline
def taken(sums, row):
    """What waits in a row of `work.contact_sums`, which then has none."""
    value = lane_sum(load(sums, row, 0))
    store(sums, row, 0, 0.0)
    return value


@inline
def add_lines_of_span(cable, span, size, band):
    """`add_span` for so many lines."""
    sums, lines, first, row = cable.work.contact_sums, cable.lines, span - MARGIN, 0
    half = 4 * lines - 1
    for one in range(4):
        for other in range(one, 4):
            apart = (other - one) * lines
            for i in range(size):
                at, to = (first + one) * lines + i, (first + other) * lines + i
                for c in range(size):
                    value = taken(sums, row)
                    band[at, half - i + c + apart] += value
                    if other > one:
                        band[to, half - i + c - apart] += value
                    row += 1


@kernel(void, CABLE, int64, LINES, terms=CONTACT)
def add_span(cable, span, band):
    """band += what waits in `work.contact_sums` of the span with this first column."""
    if cable.terms & ROLLING:  # with loops of known length
        add_lines_of_span(cable, span, 4, band)
    elif cable.dim == 3:
        add_lines_of_span(cable, span, 3, band)
    else:
        add_lines_of_span(cable, span, 2, band)


# -- velocities after contact --------------------------------------------------------------------


@inline
def body_velocity(pose, y, f, g):
    """Velocity (3, by line) of points y in the frame of an obstacle: f times their way in the first
    half of a step, g times that in the second, that of the parabola through its three poses.
    """
    middle = from_body(pose, MIDDLE, y)
    early = combined(1.0, middle, -1.0, from_body(pose, START, y))
    late = combined(1.0, from_body(pose, END, y), -1.0, middle)
    return combined(f, early, g, late)


@inline
def is_pressed(cable, o, g):
    """Whether any sample of a group is pressed at the end of a step, as last looked at, or was less
    than LIES ago.
    """
    gap = cable.work.measured[o, g, ENDED][DISTANCE] - reach_to(cable.contact, o, g)
    lain = cable.state.lain[o, g, 0]
    return any_above(where(lain, lain, -(gap + cable.state.overlap[o, g, 1])))


@inline
def clear_stopped(cable):
    """No impulses in the last step."""
    stopped, none = cable.state.stopped, zero()
    for o in range(cable.contact.count):
        for g in range(stopped.shape[1]):
            put(stopped[o, g], 0, (none, none, none))
    cable.state.balance.stopped = 0.0


@inline
def expect(cable, o, g, tau):
    """Set `work.impulses` of the samples of a group at the end of a step, with friction that holds
    where it did in the step.
    """
    contact, work, pose = cable.contact, cable.work, cable.state.pose[o]
    before, after, touch = work.measured[o, g, BEGUN], work.measured[o, g, ENDED], work.touch[o, g]
    kept, normal, none = work.impulses[o, g], three(after, NORMAL), zero()
    rubbed, limit = (none, none, none), friction_at(cable, o, g) * touch[PRESSURE]
    kept[TURNS] = none
    if contact.law[o, FRICTION] > 0.0:
        trial = three(touch, TRIAL)
        rubbed = scaled(-tau * held_share(limit, trial)[0], trial)
        if cable.terms & ROLLING:
            t = turned_back(pose, END, weighted(cable, cable.state.x, g, contact.slope[g]))
            turn = dot(obstacle_turn(pose), t)
            kept[TURNS] = turn / (tau * sqrt(dot(t, t)) + TINY)
    elif cable.terms & ROLLING:
        put(touch, LEVER, rubbed)
    came = body_velocity(pose, three(before, PLACE), 3.0 / tau, -1.0 / tau)
    came = combined(1.0, sample_at(cable, work.start_v, g), -1.0, came)
    speed = dot(three(before, NORMAL), turned_back(pose, START, came))
    put(kept, UNIT, scaled(1.0 / (sqrt(dot(normal, normal)) + TINY), normal))
    kept[PUSHED], kept[BOUNCE] = (
        tau * touch[PRESSURE],
        contact.restitution * where(speed, 0.0, speed),
    )
    put(kept, RUBBED, rubbed)
    put(kept, CARRIED, body_velocity(pose, three(after, PLACE), -1.0 / tau, 3.0 / tau))
    limit = tau * limit
    kept[STICKS] = where(limit * limit - (1.0 + SAME) * dot(rubbed, rubbed), 1.0, 0.0)
    put(kept, SLID, (none, none, none))
    kept[KNOWN] = none
    lies = cable.state.lain[o, g, 0] if contact.restitution == 0.0 else none
    kept[HELD] = where(kept[PUSHED], 1.0, where(lies, 1.0, 0.0))


@inline
def excess_velocity(cable, o, g, v):
    """Of the samples of a group with the velocities v: that of their surface relative to an
    obstacle across the normal, in its frame, and by how much that along it exceeds that after
    contact.
    """
    kept, pose = cable.work.impulses[o, g], cable.state.pose[o]
    u = combined(1.0, sample_at(cable, v, g), -1.0, three(kept, CARRIED))
    u = turned_back(pose, END, u)
    if cable.terms & ROLLING:
        spins = kept[TURNS] - line_at(cable, v, g, cable.dim)
        u = combined(1.0, u, spins, three(cable.work.touch[o, g], LEVER))
    n = three(kept, UNIT)
    closing = dot(n, u)
    return combined(1.0, u, -closing, n), closing + kept[BOUNCE]


@inline
def impulses_at(cable, o, g, across, excess):
    """Impulses of friction and pressure of the samples of a group, less those of the step, for
    velocities from `excess_velocity`.
    """
    kept, contact = cable.work.impulses[o, g], cable.contact
    stiff = STOP * contact.density * contact.heavier[g]
    rub = combined(1.0, three(kept, SLID), -stiff * kept[STICKS], across)
    return rub, where(kept[HELD], kept[KNOWN] - stiff * excess, 0.0)


@kernel((float64, float64), CABLE, float64, LINES, terms=CONTACT)
def begin_impulses(cable, tau, v):
    """Energy [J] of velocities that contact changes at the end of a step, and of its impulses in
    it; sets `work.impulses`.
    """
    contact, open_, spent = cable.contact, zero(), zero()
    if cable.state.balance.stopped > 0.0:
        clear_stopped(cable)
    for o in range(contact.count):
        for k in range(int(cable.state.near_count[o])):
            g = int(cable.state.near[o, k])
            kept = cable.work.impulses[o, g]
            kept[STICKS] = zero()
            if not is_pressed(cable, o, g):
                continue
            expect(cable, o, g, tau)
            across, excess = excess_velocity(cable, o, g, v)
            lacking = where(kept[PUSHED], excess * excess, 0.0) + kept[STICKS] * dot(across, across)
            w, heavier = contact.weight[g], contact.heavier[g]
            open_ += w * heavier * lacking
            spent += w / heavier * kept[PUSHED] * kept[PUSHED]
    return 0.5 * contact.density * lane_sum(open_), 0.5 / contact.density * lane_sum(spent)


@kernel(void, CABLE, LINES, LINES, LINES, terms=CONTACT)
def add_impulses(cable, v, push, band):
    """push += impulses on samples that have the velocities v, and band += their dependence on a
    change of v: penalties for other velocities than those after contact, and friction that slides.
    """
    contact, span, none = cable.contact, -1, zero()
    for o in range(contact.count):
        for k in range(int(cable.state.near_count[o])):
            g = int(cable.state.near[o, k])
            if not is_pressed(cable, o, g):
                continue
            kept, w = cable.work.impulses[o, g], contact.weight[g]
            stiff = STOP * contact.density * contact.heavier[g]
            n, hold = three(kept, UNIT), stiff * kept[STICKS]
            across, excess = excess_velocity(cable, o, g, v)
            rub, pushed = impulses_at(cable, o, g, across, excess)
            lever = none, none, none
            if cable.terms & ROLLING:
                lever = three(cable.work.touch[o, g], LEVER)
                push_line(cable, g, cable.dim, -w * dot(lever, rub), push)
            f = to_lines(cable.state.pose[o], END, combined(1.0, rub, pushed, n))
            push_samples(cable, g, scaled(w, f), push)
            h = (hold, none, none), (none, hold, none), (none, none, hold)
            h = with_product(h, scaled(where(kept[HELD], stiff, 0.0) - hold, n), n)
            spun = scaled(hold, lever), scaled(hold, lever), hold * dot(lever, lever)
            span = add_samples(cable, o, g, END, h, spun, 1.0, span, band)
    if span >= 0:
        add_span(cable, span, band)


@inline
def net_share(cable, o, v):
    """Share of the impulses along the normal that push in their sum, of an obstacle, with the
    velocities v after them: below 1 where others pull.
    """
    contact, net, positive = cable.contact, zero(), zero()
    for k in range(int(cable.state.near_count[o])):
        g = int(cable.state.near[o, k])
        if not is_pressed(cable, o, g):
            continue
        _, push = impulses_at(cable, o, g, *excess_velocity(cable, o, g, v))
        total = contact.weight[g] * (cable.work.impulses[o, g, PUSHED] + push)
        net += total
        positive += where(total, total, 0.0)
    return max(lane_sum(net), 0.0) / (lane_sum(positive) + TINY)


@kernel((boolean, float64), CABLE, float64, LINES, boolean, terms=CONTACT)
def validate_impulses(cable, tau, v, last):
    """Whether friction holds and slides as `add_impulses` had it, with the velocities v after it,
    and the work of the obstacles [J]. If not, and not at the `last` time, `work.impulses` is set
    anew.
    """
    contact = cable.contact
    worked, wrong = zero(), zero()
    cable.state.balance.stopped = 1.0
    for o in range(contact.count):
        share = net_share(cable, o, v) if contact.law[o, FRICTION] > 0.0 else 0.0
        for k in range(int(cable.state.near_count[o])):
            g = int(cable.state.near[o, k])
            if not is_pressed(cable, o, g):
                continue
            kept, w = cable.work.impulses[o, g], contact.weight[g]
            stiff = STOP * contact.density * contact.heavier[g]
            p, holds, slid = kept[PUSHED], kept[STICKS], three(kept, SLID)
            across, excess = excess_velocity(cable, o, g, v)
            f, push = impulses_at(cable, o, g, across, excess)
            whole = combined(1.0, f, push, three(kept, UNIT))
            whole = to_lines(cable.state.pose[o], END, whole)
            worked += w * dot(whole, three(kept, CARRIED))
            put(cable.state.stopped[o, g], 0, scaled(1.0 / tau, whole))
            if contact.restitution > 0.0:
                # The penalty leaves a share of 1 / STOP, which counts where it should bounce.
                wrong += where(w, where(fabs(excess) * stiff - SAME * fabs(push), 1.0, 0.0), 0.0)
                kept[KNOWN] = kept[KNOWN] if last else push
            if contact.law[o, FRICTION] == 0.0:
                continue
            rubbed = three(kept, RUBBED)
            limit = share * friction_at(cable, o, g) * where(p + push, p + push, 0.0)
            whole = combined(1.0, rubbed, 1.0, f)
            size = sqrt(dot(whole, whole)) + TINY
            speed = sqrt(dot(across, across)) + TINY
            # What held slides beyond the limit of Coulomb; what slid the way it is pushed holds.
            slips = holds * where(size - (1.0 + SAME) * limit, 1.0, 0.0)
            sticks = (1.0 - holds) * where(dot(across, whole), 1.0, 0.0) * where(limit, 1.0, 0.0)
            way = combined(holds / size, whole, (holds - 1.0) / speed, across)
            slides = combined(limit, way, -1.0, rubbed)
            off = combined(1.0, slides, -1.0, slid)
            goes_on = (1.0 - holds) * (1.0 - sticks) * kept[HELD]
            apart = where(dot(off, off) - SAME * SAME * (limit * limit + p * p), goes_on, 0.0)
            wrong += where(w, slips + sticks + apart, 0.0)
            if not last:
                kept[STICKS] = holds * (1.0 - slips) + sticks
                put(kept, SLID, scaled(slips + goes_on, slides))
    return lane_sum(wrong) == 0.0, lane_sum(worked)


# -- broad phase ---------------------------------------------------------------------------------


@inline
def find_near(cable, x, margin):
    """Set `state.near` to the groups of which a sample comes within `margin` of an obstacle at the
    start of the step.
    """
    contact, state = cable.contact, cable.state
    for o in range(contact.count):
        near, room = 0, margin + contact.reach[o]
        for g in range(contact.begin[o], contact.end[o]):
            measure(cable, o, g, BEGUN, x)
            left = room + contact.wider[g] - cable.work.measured[o, g, BEGUN][DISTANCE]
            if any_above(where(fabs(contact.weight[g]), left, 0.0)):
                state.near[o, near] = g
                near += 1
            else:
                put(state.overlap[o, g], 0, (zero(), zero(), zero()))
                state.slides[o, g, 0] = zero()
                state.lain[o, g, 0] = zero()
        state.near_count[o] = near


@inline
def largest_way(cable, change):
    """By how much samples move at most [m]."""
    most = 0.0
    for c in range(MARGIN, MARGIN + cable.n):
        way = 0.0
        for d in range(cable.dim):
            way += change[d, c] * change[d, c]
        most = max(most, way)
    return cable.contact.leverage * np.sqrt(most)


@kernel(void, CABLE, float64, float64, float64, LINES, terms=CONTACT)
def begin(cable, t0, tau, way, x):
    """Prepare a step of length tau from x that is expected to move the cable by `way` [m]: poses of
    the obstacles, and what is near them.
    """
    balance, carried = cable.state.balance, 0.0
    if obstacles_move(cable):
        for o in range(cable.contact.count):
            set_pose(cable, o, MIDDLE, t0 + 0.5 * tau)
            set_pose(cable, o, END, t0 + tau)
            carried = max(carried, pose_way(cable, o))
    if balance.decaying > 0.0:
        carried = max(carried, RETURN * tau)
    way = 1.5 * (way + carried)
    if not balance.contact_way + way < balance.contact_margin:
        balance.contact_margin = AHEAD * way + cable.contact.least_margin
        balance.contact_way = 0.0
        find_near(cable, x, balance.contact_margin)
    balance.contact_carried = carried
    for o in range(cable.contact.count):
        for k in range(int(cable.state.near_count[o])):
            measure(cable, o, int(cable.state.near[o, k]), BEGUN, x)
    cable.work.results.decaying = balance.decaying
    if balance.decaying > 0.0:
        decay_overlap(cable, tau)


@inline
def decay_overlap(cable, tau):
    """Let the overlap with obstacles become less in a step of length tau."""
    contact, state, left = cable.contact, cable.state, zero()
    for o in range(contact.count):
        for k in range(int(state.near_count[o])):
            g = int(state.near[o, k])
            most = PRESSED * EARTH * contact.density * contact.heavier[g]
            most, reach = most / contact.law[o, STIFFNESS], reach_to(contact, o, g)
            overlap = state.overlap[o, g]
            before = overlap[0]
            if not any_above(before):
                continue
            deep = reach - cable.work.measured[o, g, BEGUN][DISTANCE]
            grown = FOLLOWED * (overlap[2] - deep)  # out of it in the last step
            grown = where(grown - most * tau / RISE, grown, most * tau / RISE)
            grown = where(grown - RETURN * tau, RETURN * tau, grown)
            room = before - deep  # where it does not press, to where it does
            grown = where(room, where(room - RETURN * tau, RETURN * tau, room), grown)
            after = before - where(most + room, grown, 0.0)
            overlap[1] = where(after, after, 0.0)
            left += overlap[1]
    state.balance.decaying = 1.0 if lane_sum(left) > 0.0 else 0.0


@inline
def reset(cable):
    """The step was not made."""
    for o in range(cable.contact.count):
        settle_pose(cable.state.pose[o], START)
        settle_overlap(cable, o, 0)
    cable.state.balance.decaying = cable.work.results.decaying


@inline
def slides_along(cable, o, g, tau):
    """|dy across n|^2 / (|dy|^2 + (RESTING tau)^2) for the motion dy of samples relative to an
    obstacle in a step of length tau: about 1 where they slide, 0 where they come along the normal n
    or rest.
    """
    before, after = cable.work.measured[o, g, BEGUN], cable.work.measured[o, g, ENDED]
    dy = combined(1.0, three(after, PLACE), -1.0, three(before, PLACE))
    n, rest, way = three(after, NORMAL), RESTING * tau * RESTING * tau, dot(dy, dy)
    along_n = dot(n, dy)
    across = way - along_n * along_n / (dot(n, n) + TINY)  # those of meshes have no exact length
    return where(across, across, 0.0) / (way + rest)


@kernel(void, CABLE, float64, terms=CONTACT)
def commit(cable, tau):
    """The bristles of the step become those of the state, its end poses those of its end; the
    deepest place of the run is kept.
    """
    contact, state = cable.contact, cable.state
    for o in range(contact.count):
        deepest = zero()
        for k in range(int(state.near_count[o])):
            g = int(state.near[o, k])
            if contact.law[o, FRICTION] > 0.0:
                put(state.bristle[o, g], 0, three(cable.work.trial[o, g], 0))
            state.slides[o, g, 0] = slides_along(cable, o, g, tau)
            reach = reach_to(contact, o, g)
            deep = reach - cable.work.measured[o, g, ENDED][DISTANCE]
            # Of the start of the step, for `decay_overlap`.
            begun = cable.work.measured[o, g, BEGUN][DISTANCE]
            state.overlap[o, g, 2] = reach - begun
            deep = where(fabs(contact.weight[g]), deep - state.overlap[o, g, 1], 0.0)
            deepest = where(deep - deepest, deep, deepest)
            left = state.lain[o, g, 0] - tau
            state.lain[o, g, 0] = where(deep, LIES, where(left, left, 0.0))
        if any_above(deepest - state.deepest[o]):
            for k in range(LANES):
                state.deepest[o] = max(state.deepest[o], lane(deepest, k))
        settle_pose(state.pose[o], END)
        settle_overlap(cable, o, 1)


@kernel(boolean, CABLE, LINES, terms=CONTACT)
def validate(cable, change):
    """Account for the contact in an implicit step by this change that converged, with the forces at
    its end.

    Returns whether the step may stand: nothing passed through an obstacle, and all that came near
    one was looked at.
    """
    balance, results = cable.state.balance, cable.work.results
    balance.contact_way += largest_way(cable, change) + balance.contact_carried
    if balance.contact_way > balance.contact_margin:
        balance.contact_margin = 0.0
        return False
    if results.contact_jumps > 0.0:
        return False
    balance.contact_deep += results.contact_deep
    balance.drive_work += results.contact_work
    balance.dissipated += results.contact_loss
    return True


# -- what touches, for reports -------------------------------------------------------------------


@kernel(void, int64, int64, ARRAY_2D, terms=CONTACT)
def report(address, obstacle, out):
    """Gaps [m] and forces on the cable [N], by line, of all samples that may touch an obstacle at
    the present configuration, with the mean force of the impulses of the last step: out[group,
    4 lane + 0 .. 3].
    """
    cable, values = cable_at(address), grid(out)
    contact, state, o = cable.contact, cable.state, obstacle
    law, pose = contact.law[o], state.pose[o]
    for g in range(contact.begin[o], contact.end[o]):
        measure(cable, o, g, ENDED, state.x)
        kept, z = cable.work.measured[o, g, ENDED], three(state.bristle[o, g], 0)
        gap, n = kept[DISTANCE] - reach_to(contact, o, g), three(kept, NORMAL)
        f = combined(-law[STIFFNESS] * depth(gap + state.overlap[o, g, 1]), n, -law[BRISTLE], z)
        f = combined(1.0, to_lines(pose, END, f), 1.0, three(state.stopped[o, g], 0))
        f = scaled(contact.weight[g], f)
        for k in range(LANES):
            values[g, 4 * k], values[g, 4 * k + 1] = lane(gap, k), lane(f[0], k)
            values[g, 4 * k + 2], values[g, 4 * k + 3] = lane(f[1], k), lane(f[2], k)
