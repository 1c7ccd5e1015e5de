"""Contact with obstacles: pressure along the normal, and friction that sticks.

**Gap.** An obstacle is a core (half space, box, cylinder, tube) grown by its `reach`: its own
rounding and the radius of the cable. A sphere is a box of size zero, a capsule one that is long in
z only. The wall of a tube has no thickness but what it is grown by; a ring is a tube of length 0.
A mesh has a field of signed distances on a grid (`engine.distance_field`).
At y = R^T (r - c), the place of a sample r of the cable in the frame of the obstacle, the gap is
g = d(y) - reach with the signed distance d from the core. Obstacles may move: `state.pose` has R
and c at the start, the middle and the end of a step, which are equal between steps.

**Samples.** The cable touches at samples of its own, finer than the quadrature, with both ends of
the cable: sharp tips would sink in between Gauss points. They are the lanes of groups: one sample
of every span of a block for half spaces, which need few samples of much of the cable, and
neighbouring samples of one span for bodies, which need many of little.

**A step** from y0 to y1 of length tau, dy = y1 - y0, has for each sample and obstacle
    the discrete gradient of the gap, n = m + (g1 - g0 - m.dy) dy / |dy|^2 with
m = (f0 n0 + f1 n1) / (f0 + f1), so that n.dy = g1 - g0, with the distances f from the centre of
curvature: the last part vanishes on faces, spheres and cylinders, and where dy is round-off;
    the pressure p = max(0, p_el - c k s (g1 - g0) - l/2 (1 - s) k depth1), with the share s of the
way that is inside, the divided difference p_el = - k s (depth0 + depth1) / 2 of the energy
k/2 depth^2, depth < 0, and c = l/2 + DAMPED (1 - l). Where a sample lands or rests, l = 1 and
p = - k depth1: contact may be as stiff as it likes, as what a step leaves over does not swing back.
Where it slid in the step before, l is nearly 0 (`slides_along`): pressures at the ends of steps
would lag behind the places of contact and brake the cable;
    friction f = - min(1, mu p / |T|) T, T = k_t (P z0 + P dy), P normal to n, with the bristle z,
an elastic displacement along the surface in the frame of the obstacle: it ends as z1 = - f / k_t,
or zero where nothing touches. Its energy is k_t/2 z^2.
The force on the cable per length is F = R_middle (p n + f). The obstacle does the work
F.(r1 - r0) - (p n + f).dy, and the loss is
    (p - p_el) (g0 - g1) + k_t/2 |z1 - P z0|^2 + k_t/2 (|z0|^2 - |P z0|^2) - f.(P z0 + P dy - z1);
no part of it is negative.

**Landing.** A step of the midpoint family that stops a sample at a surface within its length leaves
it any velocity between those of coming and going, v1 = 2 (r1 - r0) / tau - v0, which depends on
where the step began. So at the end of a step what is pressed gets the velocity that it has after
contact, relative to the obstacle: along the normal minus the restitution times that at which it
came, and none across where friction holds. Impulses bring that about, which change the velocities
least in the metric of the mass (Moreau 1988); with those of the step they obey the law of Coulomb.
They do nothing where what is pressed already has that velocity, as at rest and in steady sliding.
Restitution is that of Newton, the same at every step: 0 lies where it lands, 1 loses nothing.

**Rolling.** A cable that twists in space also turns about its axis by an angle phi relative to the
obstacle, which moves its surface, a radius a off the axis, by - phi l, l = a t x n / (|t| |n|) with
the tangent t. Friction then sees dy - phi l in place of dy, and turns the cable about its axis by
the moment - l.f per length (`engine.rolling`). Without that, friction acts on the axis. The moment
of friction along the cable, which bends it, is left out.

**Jumps.** An obstacle that jumps into the cable would fling it out. It yields instead: at first its
reach becomes less by the same length for all samples, the largest by which one is pressed in more
than before (`simulation.obstacles.give_way`). Then the reach to each sample grows back at up to
RETURN, as fast as the cable gives way. Where it does not, being held or pushed out of two opposite
sides, it grows slowly, and waits at last; its force is bounded. The gap then changes by n.dy and
the growth, whose work p times growth is that of the obstacle.

**Broad phase.** Groups of samples near an obstacle are found for many steps at once: until cable
and obstacles have moved by `balance.contact_margin`.

Everything is in coordinates of lines: a planar cable has its two, and zero for the third.
"""

from __future__ import annotations

import numpy as np
from numba import boolean, float64, int64, void

from dlo_sim.compiling.groups import grid, load, store
from dlo_sim.compiling.lanes import LANES, any_above, fabs, lane, lane_sum, sqrt, where, zero
from dlo_sim.compiling.pieces import ARRAY_2D, NO, YES, part, piece
from dlo_sim.engine.arrays import (
    BOXED,
    CABLE,
    CONTACT,
    LINES,
    MARGIN,
    MESHED,
    ROLLING,
    ROUND,
    TOUCHING,
    TUBED,
    VECTOR,
    cable_at,
)
from dlo_sim.engine.distance_field import field_distance
from dlo_sim.engine.grasps import POSITION, component, elapsed, moves, turned
from dlo_sim.terms.one_sided import depth
from dlo_sim.terms.vectors import combined, cross, dot

HALF_SPACE, BOX, CYLINDER, TUBE, MESH = range(5)  # kinds of cores
START, MIDDLE, END = 0, 12, 24  # entries of a pose: R by rows (9), c (3)
BEGUN, ENDED = 0, 1  # of `work.measured`: at the start and the end of a step
UNKNOWN, KNOWN, OF_STEP = 0.0, 1.0, 2.0  # whether that is of the obstacles, and of this step
# Entries there of a group of samples: points of the cable, their places in the frame of an
# obstacle, and what `keep` sets.
POINT, PLACE, DISTANCE, NORMAL, FAR, BEND, SIZE = 0, 3, 6, 7, 10, 11, 17
STIFFNESS, BRISTLE, FRICTION = range(3)  # entries of the law of an obstacle: k, k_t, mu
# Entries of `work.rolling` of a sample: T without the spin in this step (3), l (3), mu p, and its
# derivative by y1 (3).
FREE, LEVER, LIMIT, LEAN = 0, 3, 6, 7

TINY = 1e-30
SMOOTH = 1e-18  # [m^2], of a motion of 1e-9 m, below which n needs no directional part
JUMP = 0.05  # share of the reach that a step may move past an obstacle without a look at normals
RETURN = 0.2  # [m/s], at which an obstacle that has yielded pushes the cable out
# An obstacle that has yielded to a sample grows back by up to FOLLOWED times as much in a step as
# the sample came out in the last one; where it does not, being held, until the pressure is that of
# so many weights of the cable on EARTH, after RISE [s], as a sudden push would lever it out.
FOLLOWED, PRESSED, RISE, EARTH = 2.0, 150.0, 0.15, 9.81
SHALLOW = 0.03  # diameters that a cable may begin inside, and up to which nothing is said
# Weight of the end of the step, beyond its middle, in the pressure on samples that slide.
DAMPED = 0.01
RESTING = 1e-3  # [m/s], below which what touches does not slide
STOP = 1e2  # penalty for other velocities than those after contact, in linear densities
SAME = 1e-3  # change of an impulse of friction, in its limit, that counts as none
AHEAD = 16.0  # expected motions of a step that the margin of the broad phase allows for


# -- obstacles -----------------------------------------------------------------------------------


@part
def line_axis(cable, d):
    """World axis of line d; that normal to the plane of a planar cable for d = 2."""
    return cable.axes[d] if d < cable.dim else 3 - cable.axes[0] - cable.axes[1]


@piece(void, CABLE, int64, int64, float64, terms=CONTACT)
def set_pose(cable, o, at, t):
    """Set the pose of obstacle o at time t, its entries from `at` on."""
    m, pose = cable.inputs.obstacle[o], cable.state.pose[o]
    s = elapsed(m, t)
    for k in range(3):
        x, y = 1.0 if k == 0 else 0.0, 1.0 if k == 1 else 0.0
        v = turned(m, t, x, y, 1.0 - x - y)
        for d in range(3):
            pose[at + 3 * d + k] = component(v, line_axis(cable, d))
    for d in range(3):
        a = line_axis(cable, d)
        way = m[POSITION + 3 + a] + s * m[POSITION + 6 + a]
        pose[at + 9 + d] = m[POSITION + a] + s * way - cable.contact.still[a]


@part
def settle_yielding(cable, o, at):
    """What an obstacle yields at the start (0) or end (1) of a step is that of the whole step."""
    for k in range(int(cable.state.near_count[o])):
        yielded = cable.state.yielded[o, int(cable.state.near[o, k])]
        yielded[1 - at] = yielded[at]


@part
def settle_pose(pose, at):
    """The pose at `at` is that of the whole step."""
    for k in range(12):
        value = pose[at + k]
        pose[START + k] = value
        pose[MIDDLE + k] = value
        pose[END + k] = value


@part
def see_all(cable):
    """Let all groups of samples be near all obstacles until a step begins."""
    contact, state = cable.contact, cable.state
    state.balance.contact_margin = 0.0
    for o in range(contact.count):
        count = contact.end[o] - contact.begin[o]
        state.near_count[o] = count
        for k in range(count):
            state.near[o, k] = contact.begin[o] + k


@piece(void, int64, terms=CONTACT)
def look_everywhere(address):
    """`see_all`."""
    see_all(cable_at(address))


@piece(void, int64, float64, terms=CONTACT)
def place_obstacles(address, t):
    """Set the poses of all obstacles to those at time t."""
    cable = cable_at(address)
    for o in range(cable.contact.count):
        set_pose(cable, o, END, t)
        settle_pose(cable.state.pose[o], END)
    see_all(cable)


@part
def obstacles_move(cable):
    """Whether any obstacle moves or was moved."""
    for o in range(cable.contact.count):
        if moves(cable.inputs.obstacle[o]):
            return True
    return False


@part
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


@part
def turned_back(pose, at, v):
    """R^T v."""
    return (
        pose[at] * v[0] + pose[at + 3] * v[1] + pose[at + 6] * v[2],
        pose[at + 1] * v[0] + pose[at + 4] * v[1] + pose[at + 7] * v[2],
        pose[at + 2] * v[0] + pose[at + 5] * v[1] + pose[at + 8] * v[2],
    )


@part
def to_body(pose, at, r):
    """R^T (r - c)."""
    return turned_back(pose, at, (r[0] - pose[at + 9], r[1] - pose[at + 10], r[2] - pose[at + 11]))


@part
def to_lines(pose, at, v):
    """R v."""
    return (
        pose[at] * v[0] + pose[at + 1] * v[1] + pose[at + 2] * v[2],
        pose[at + 3] * v[0] + pose[at + 4] * v[1] + pose[at + 5] * v[2],
        pose[at + 6] * v[0] + pose[at + 7] * v[1] + pose[at + 8] * v[2],
    )


@part
def scaled(f, v):
    """f v."""
    return f * v[0], f * v[1], f * v[2]


@part
def sign(a):
    """1 where a > 0, else -1."""
    return where(a, 1.0, -1.0)


# -- samples of the cable ------------------------------------------------------------------------


@part
def sample_at(cable, x, g):
    """Points of the curve at the samples of a group."""
    return weighted(cable, x, g, cable.contact.basis[g])


@part
def weighted(cable, x, g, e):
    """Sums of the control points of the spans of a group with weights e (4)."""
    at, c = cable.contact.first[g], zero()
    if g < cable.contact.coarse:
        a = e[0] * load(x, 0, at) + e[1] * load(x, 0, at + 1)
        a += e[2] * load(x, 0, at + 2) + e[3] * load(x, 0, at + 3)
        b = e[0] * load(x, 1, at) + e[1] * load(x, 1, at + 1)
        b += e[2] * load(x, 1, at + 2) + e[3] * load(x, 1, at + 3)
        if cable.dim == 3:
            c = e[0] * load(x, 2, at) + e[1] * load(x, 2, at + 1)
            c += e[2] * load(x, 2, at + 2) + e[3] * load(x, 2, at + 3)
    else:
        a = e[0] * x[0, at] + e[1] * x[0, at + 1] + (e[2] * x[0, at + 2] + e[3] * x[0, at + 3])
        b = e[0] * x[1, at] + e[1] * x[1, at + 1] + (e[2] * x[1, at + 2] + e[3] * x[1, at + 3])
        if cable.dim == 3:
            c = e[0] * x[2, at] + e[1] * x[2, at + 1] + (e[2] * x[2, at + 2] + e[3] * x[2, at + 3])
    return a, b, c


@part
def push_samples(cable, g, f, out):
    """out += forces on the samples of a group."""
    e, at = cable.contact.basis[g], cable.contact.first[g]
    if g < cable.contact.coarse:
        for k in range(4):
            store(out, 0, at + k, load(out, 0, at + k) + e[k] * f[0])
            store(out, 1, at + k, load(out, 1, at + k) + e[k] * f[1])
            if cable.dim == 3:
                store(out, 2, at + k, load(out, 2, at + k) + e[k] * f[2])
    else:
        for k in range(4):
            out[0, at + k] += lane_sum(e[k] * f[0])
            out[1, at + k] += lane_sum(e[k] * f[1])
            if cable.dim == 3:
                out[2, at + k] += lane_sum(e[k] * f[2])


@part
def push_line(cable, g, line, f, out):
    """out += one line of the forces on the samples of a group."""
    e, at = cable.contact.basis[g], cable.contact.first[g]
    for k in range(4):
        if g < cable.contact.coarse:
            store(out, line, at + k, load(out, line, at + k) + e[k] * f)
        else:
            out[line, at + k] += lane_sum(e[k] * f)


@part
def vector_of(z):
    """Three entries of lanes."""
    return z[0], z[1], z[2]


@part
def drop(cable, o, g):
    """Let the samples of a group, none of which touches, lose their bristles; returns |z|^2."""
    z, ends = vector_of(cable.state.bristle[o, g]), cable.work.trial[o, g]
    ends[0] = zero()
    ends[1] = zero()
    ends[2] = zero()
    return dot(z, z)


@part
def line_at(cable, x, g, line):
    """One line of x at the samples of a group."""
    e, at, value = cable.contact.basis[g], cable.contact.first[g], zero()
    for k in range(4):
        if g < cable.contact.coarse:
            value += e[k] * load(x, line, at + k)
        else:
            value += e[k] * x[line, at + k]
    return value


@part
def spin(cable, g, x0, x1):
    """By which angles the cable turns about its axis from x0 to x1 at the samples of a group, in
    the frame that follows its tangent by the smallest rotation.
    """
    return line_at(cable, x1, g, cable.dim) - line_at(cable, x0, g, cable.dim)


@part
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


@part
def rolled(cable, o, g, x0, x1, n):
    """The angle phi by which the cable turns about its axis relative to an obstacle, and the lever
    l (`engine.contact`), at the mean tangent of the step.
    """
    pose, slope = cable.state.pose[o], cable.contact.slope[g]
    t0 = turned_back(pose, START, weighted(cable, x0, g, slope))
    t1 = turned_back(pose, END, weighted(cable, x1, g, slope))
    t = combined(1.0, t0, 1.0, t1)
    inverse = 1.0 / (sqrt(dot(t, t)) + TINY)
    size = cable.contact.radius * inverse / (sqrt(dot(n, n)) + TINY)
    phi = spin(cable, g, x0, x1) - inverse * dot(obstacle_turn(pose), t)
    return phi, scaled(size, cross(t, n))


# -- distances from obstacles --------------------------------------------------------------------


@part
def three(kept, at):
    """Three successive entries of lanes."""
    return kept[at], kept[at + 1], kept[at + 2]


@part
def keep(kept, d, n, f, bend):
    """Set entries of `work.measured`: signed distance d from the core, its gradient n, the distance
    f from the centre of curvature, and f n' + n n^T as xx, yy, zz, xy, xz, yz.
    """
    kept[DISTANCE], kept[FAR] = d, f
    kept[NORMAL], kept[NORMAL + 1], kept[NORMAL + 2] = n
    kept[BEND], kept[BEND + 1], kept[BEND + 2] = bend[0], bend[1], bend[2]
    kept[BEND + 3], kept[BEND + 4], kept[BEND + 5] = bend[3], bend[4], bend[5]


@part
def measured(kept):
    """What `keep` has set: d, n, f, bend."""
    bend = kept[BEND], kept[BEND + 1], kept[BEND + 2], kept[BEND + 3], kept[BEND + 4]
    return kept[DISTANCE], three(kept, NORMAL), kept[FAR], (*bend, kept[BEND + 5])


@part
def same_place(kept, y):
    """Whether `work.measured` of a group is that of its places y."""
    a, b, c = kept[PLACE] - y[0], kept[PLACE + 1] - y[1], kept[PLACE + 2] - y[2]
    return lane_sum(fabs(a) + fabs(b) + fabs(c)) == 0.0  # not if a place is not finite


@piece(void, CABLE, int64, int64, int64, terms=BOXED)
def box_distance(cable, o, g, when):
    """`measure` for a box."""
    kept, h = cable.work.measured[o, g, when], cable.contact.half[o]
    y = three(kept, PLACE)
    a, b, c = fabs(y[0]) - h[0], fabs(y[1]) - h[1], fabs(y[2]) - h[2]
    u, v, w = where(a, a, 0.0), where(b, b, 0.0), where(c, c, 0.0)
    far = sqrt(u * u + v * v + w * w)
    inverse = 1.0 / (far + TINY)
    first = where(a - b, 1.0, 0.0) * where(a - c, 1.0, 0.0)  # inside: the nearest face
    second = (1.0 - first) * where(b - c, 1.0, 0.0)
    third = 1.0 - first - second
    inside = first * a + second * b + third * c
    n = (
        where(far, u * inverse, first) * sign(y[0]),
        where(far, v * inverse, second) * sign(y[1]),
        where(far, w * inverse, third) * sign(y[2]),
    )
    d = where(far, far, inside)
    bend = (
        where(far, where(a, 1.0, 0.0), first),
        where(far, where(b, 1.0, 0.0), second),
        where(far, where(c, 1.0, 0.0), third),
        zero(),
        zero(),
        zero(),
    )
    keep(kept, d, n, fabs(d) + TINY, bend)


@piece(void, CABLE, int64, int64, int64, terms=ROUND)
def cylinder_distance(cable, o, g, when):
    """`measure` for a cylinder about z: a box in the coordinates rho and z."""
    kept, h = cable.work.measured[o, g, when], cable.contact.half[o]
    y = three(kept, PLACE)
    rho = sqrt(y[0] * y[0] + y[1] * y[1])
    ex, ey = y[0] / (rho + TINY), y[1] / (rho + TINY)
    a, c = rho - h[0], fabs(y[2]) - h[2]
    u, w = where(a, a, 0.0), where(c, c, 0.0)
    far = sqrt(u * u + w * w)
    side = where(a - c, 1.0, 0.0)  # inside: the nearest face
    radial = where(far, u / (far + TINY), side)
    n = radial * ex, radial * ey, where(far, w / (far + TINY), 1.0 - side) * sign(y[2])
    d = where(far, far, where(a - c, a, c))
    lateral = where(radial, where(c, where(far, 0.0, 1.0), 1.0), 0.0)
    f = where(lateral, rho, fabs(d)) + TINY
    # Along the rim the surface curves by 1 / rho: u / rho instead of 1 in f n' + n n^T.
    less = where(lateral, 0.0, where(radial, 1.0 - u / (rho + TINY), 0.0))
    on_side, on_cap = where(radial, 1.0, 0.0), where(lateral, 0.0, 1.0)
    xx, yy = on_side - less * ey * ey, on_side - less * ex * ex
    keep(kept, d, n, f, (xx, yy, on_cap, less * ex * ey, zero(), zero()))


@piece(void, CABLE, int64, int64, int64, terms=TUBED)
def tube_distance(cable, o, g, when):
    """`measure` for a tube about z, open at both ends: a segment along z in the coordinates rho and
    z. The distance from the middle of its wall, so that d > 0 on both sides.
    """
    kept, h = cable.work.measured[o, g, when], cable.contact.half[o]
    y = three(kept, PLACE)
    rho = sqrt(y[0] * y[0] + y[1] * y[1])
    ex, ey = y[0] / (rho + TINY), y[1] / (rho + TINY)
    u, c = rho - h[0], fabs(y[2]) - h[2]
    w = where(c, c, 0.0)
    d = sqrt(u * u + w * w)
    radial = where(d, u / (d + TINY), 1.0)
    n = radial * ex, radial * ey, where(d, w / (d + TINY), 0.0) * sign(y[2])
    # The wall curves by 1 / rho about the axis; at the rims also by 1 / d across it.
    wall = where(-c, 1.0 if h[2] > 0.0 else 0.0, 0.0)
    f = where(wall, rho, d) + TINY
    round_ = where(wall, sign(u), u / (rho + TINY))
    xx, yy = ex * ex + round_ * ey * ey, ey * ey + round_ * ex * ex
    keep(kept, d, n, f, (xx, yy, 1.0 - wall, (1.0 - round_) * ex * ey, zero(), zero()))


@piece(void, CABLE, int64, int64, int64, terms=MESHED)
def mesh_distance(cable, o, g, when):
    """`measure` for a mesh, with a distance of 1 m from the centre of curvature."""
    kept = cable.work.measured[o, g, when]
    d, n, (xx, yy, zz, xy, xz, yz) = field_distance(cable, o, three(kept, PLACE))
    xx, yy, zz = xx + n[0] * n[0], yy + n[1] * n[1], zz + n[2] * n[2]
    xy, xz, yz = xy + n[0] * n[1], xz + n[0] * n[2], yz + n[1] * n[2]
    keep(kept, d, n, zero() + 1.0, (xx, yy, zz, xy, xz, yz))


@part
def set_distance(cable, o, g, when, y):
    """`keep` the distance of the samples of a group at places y in the frame of an obstacle."""
    core, kept = cable.contact.core[o], cable.work.measured[o, g, when]
    kept[PLACE], kept[PLACE + 1], kept[PLACE + 2] = y
    if core == HALF_SPACE:
        one, none = zero() + 1.0, zero()
        keep(kept, y[2], (none, none, one), one, (none, none, one, none, none, none))
    elif core == BOX:
        box_distance(cable, o, g, when)
    elif core == CYLINDER:
        cylinder_distance(cable, o, g, when)
    elif core == TUBE:
        tube_distance(cable, o, g, when)
    else:
        mesh_distance(cable, o, g, when)


@piece(void, CABLE, int64, int64, int64, LINES, terms=CONTACT)
def measure(cable, o, g, when, x):
    """Set `work.measured[o, g, when]` to the points on x of the samples of a group, their places in
    the frame of an obstacle, and the distance of these (`keep`); `when`: BEGUN for its pose at the
    start of the step, or ENDED. What is known of these places is not computed again; other
    obstacles come with other working memory, where nothing is known.
    """
    kept, known = cable.work.measured[o, g, when], cable.work.measured_known[o, g]
    r = sample_at(cable, x, g)
    y = to_body(cable.state.pose[o], START if when == BEGUN else END, r)
    kept[POINT], kept[POINT + 1], kept[POINT + 2] = r
    before, known[when] = known[when], OF_STEP if when == BEGUN else KNOWN
    if before != UNKNOWN and same_place(kept, y):
        return
    ended = cable.work.measured[o, g, ENDED]
    if when == BEGUN and known[ENDED] != UNKNOWN and same_place(ended, y):
        for k in range(PLACE, SIZE):
            kept[k] = ended[k]
    else:
        set_distance(cable, o, g, when, y)


# -- the law of one sample -----------------------------------------------------------------------


@part
def misses(contact, o, here, there, dy):
    """Whether no lane touches or passes an obstacle in a step dy between two `measured`: it is
    outside before and after, and moves by no more than both gaps; false for a half space, where
    nothing is saved.

    That bounds the way of a field whose slope is at most 1. The spline of a mesh overshoots where a
    wall is thinner than two cells, with slopes up to 1.33 at one of 1.2 cells: there a step may
    touch and be taken to miss.
    """
    if contact.core[o] == HALF_SPACE:
        return False
    g0, g1 = here[0] - contact.reach[o], there[0] - contact.reach[o]
    room = (g0 + g1) * (g0 + g1) - dot(dy, dy)
    return lane_sum(where(g0, where(g1, where(room, 0.0, 1.0), 1.0), 1.0)) == 0.0


@part
def pressed(k, c, lands, g0, g1):
    """p_el, p and dp/dg1 for gaps before and after, with the damping c and the share of l."""
    deep, inverse = depth(g0) + depth(g1), 1.0 / (fabs(g0) + fabs(g1) + TINY)
    share = -deep * inverse
    elastic = -0.5 * k * deep * share
    p = elastic - c * k * share * (g1 - g0)
    up = sign(g1)
    slope = -0.5 * k * share * (1.0 - up + share * up) - c * k * share
    slope += c * k * (g1 - g0) * inverse * (0.5 * (1.0 - up) + share * up)
    far = where(g0, 0.5 * k * lands * (1.0 - share), 0.0)
    p, slope = p - far * depth(g1), slope - where(g1, 0.0, far * (1.0 - share))
    return elastic, where(p, p, 0.0), where(p, slope, 0.0)


@part
def pressure(cable, o, g, steps, here, there, dy):
    """Gaps before and after, n, loss, p, dp/dg1, f0 + f1, 1 where the step may have passed through
    the obstacle, and 1 near its middle, for a step dy between two `measured`; not `steps`: at its
    end, with half the derivative, as of one of two configurations that are the same.
    """
    contact, yielded = cable.contact, cable.state.yielded[o, g]
    law, reach, both = contact.law[o], contact.reach[o], here[2] + there[2]
    g0 = here[0] - (reach - (yielded[0] if steps else yielded[1]))
    g1 = there[0] - (reach - yielded[1])
    n, jumped = there[1], zero()
    if contact.core[o] != HALF_SPACE:
        way = dot(dy, dy)
        n = scaled(1.0 / both, combined(here[2], here[1], there[2], there[1]))
        n = combined(1.0, n, ((there[0] - here[0]) - dot(n, dy)) / (way + SMOOTH), dy)
        far = sqrt(way)
        jumped = where(far - (g0 + g1), 1.0, 0.0) * where(0.5 - dot(here[1], there[1]), 1.0, 0.0)
        jumped = jumped * where(far - JUMP * reach, 1.0, 0.0)
        # Not across the opening of a ring, from one side to the other.
        jumped = jumped * where(-dot(here[1], dy), 1.0, where(dot(there[1], dy), 1.0, 0.0))
    lands = 1.0 - cable.state.slides[o, g, 0] if steps else zero()
    damped = (DAMPED if steps else 0.0) + (0.5 - DAMPED) * lands
    elastic, p, slope = pressed(law[STIFFNESS], damped, lands, g0, g1)
    loss = (p - elastic) * (g0 - g1)
    return (g0, g1), n, loss, p, slope, both, jumped, where(-g1 - contact.middle[o], 1.0, 0.0)


@part
def keep_for_twist(cable, o, g, free, lever, limit, lean):
    """Let the friction of the samples of a group wait for the twist (`engine.rolling`)."""
    kept = cable.work.rolling[o, g]
    kept[FREE], kept[FREE + 1], kept[FREE + 2] = free
    kept[LEVER], kept[LEVER + 1], kept[LEVER + 2] = lever
    kept[LIMIT] = limit
    kept[LEAN], kept[LEAN + 1], kept[LEAN + 2] = lean


@part
def rolling_trial(cable, o, g, change):
    """T of the samples of a group that roll, for a `change`."""
    kept, angle = cable.work.rolling[o, g], line_at(cable, change, g, cable.dim)
    stiff = cable.contact.law[o, BRISTLE]
    return combined(1.0, three(kept, FREE), -stiff * angle, three(kept, LEVER))


@part
def along(n, inverse, v):
    """P v = v - n (n . v) / |n|^2; `inverse`: 1 / |n|^2."""
    return combined(1.0, v, -dot(n, v) * inverse, n)


@part
def friction_at(cable, o, g):
    """Coefficients of friction of the samples of a group: 0 where the obstacle has yielded, as it
    would hold fast what it pushes out in different directions.
    """
    return where(cable.state.yielded[o, g, 1], 0.0, cable.contact.law[o, FRICTION])


@part
def friction(stiff, limit, n, dy, z):
    """Trial force T, the share of it that holds, |T|, P z, P dy, for the largest force `limit`;
    `stiff`: factors of P z and P dy in T.
    """
    inverse = 1.0 / (dot(n, n) + TINY)
    held, slip = along(n, inverse, z), along(n, inverse, dy)
    trial = combined(stiff[0], held, stiff[1], slip)
    far = sqrt(dot(trial, trial)) + TINY
    return trial, where(limit - far, 1.0, limit / far), far, held, slip


# -- forces, energy, Jacobian --------------------------------------------------------------------


@piece(
    *((float64, float64, float64, boolean, float64, float64), CABLE, boolean, boolean),
    *(LINES, LINES, LINES),
    terms=CONTACT,
)
def add_force(cable, steps, waits, x0, x1, out):
    """out += contact force of a step from x0 to x1; the bristles at its end go to `work.trial`.

    Args:
        steps: false for the pressure at x1 = x0 alone. waits: whether friction waits in
            `work.rolling` until the twist is known.

    Returns:
        Work of the obstacles [J], energy put into the bristles [J], loss [J], whether no sample may
        have passed through an obstacle, how many are near the middle of one, and a checksum of what
        touches and, without the twist, what slides.
    """
    contact, state, work = cable.contact, cable.state, cable.work
    worked, kept, lost, jumps, depths = zero(), zero(), zero(), zero(), zero()
    touched = zero()
    begun, middle = (BEGUN, MIDDLE) if steps else (ENDED, END)
    for o in range(contact.count):
        law, pose = contact.law[o], state.pose[o]
        rubbed, k_t = steps and law[FRICTION] > 0.0, law[BRISTLE]
        for k in range(int(state.near_count[o])):
            g = int(state.near[o, k])
            if begun == BEGUN and work.measured_known[o, g, BEGUN] != OF_STEP:
                measure(cable, o, g, BEGUN, x0)
            measure(cable, o, g, ENDED, x1)
            before, after = work.measured[o, g, begun], work.measured[o, g, ENDED]
            dy = combined(1.0, three(after, PLACE), -1.0, three(before, PLACE))
            here, there, w = measured(before), measured(after), contact.weight[g]
            if misses(contact, o, here, there, dy):
                if rubbed:
                    if waits:
                        work.rolling[o, g, LIMIT] = zero()
                    stored = 0.5 * k_t * w * drop(cable, o, g)
                    lost += stored
                    kept = kept - stored
                continue
            gaps, n, loss, p, slope, _, jumped, deep = pressure(cable, o, g, steps, here, there, dy)
            jumps += where(w, jumped, 0.0)
            depths += where(w, deep, 0.0)
            # A checksum: every sample adds its mark if it is pressed, 0.7 marks if it ends outside,
            # 1.7 if it slides. Marks differ from sample to sample, so that one that lets go while
            # another one touches is seen; but not along z of the obstacle, where only the number
            # of samples is seen.
            mark = 1.0 + fabs(before[PLACE]) + fabs(before[PLACE + 1])
            touched += where(p, mark, 0.0) + where(gaps[1], 0.7 * mark, 0.0)
            lost += w * loss
            if steps:
                worked += w * (state.yielded[o, g, 0] - state.yielded[o, g, 1]) * p
            f = scaled(p, n)
            if rubbed:
                z = vector_of(state.bristle[o, g])
                seen = dy
                if cable.terms & ROLLING:
                    phi, lever = rolled(cable, o, g, x0, x1, n)
                    seen = combined(1.0, dy, -phi, lever)
                mu = friction_at(cable, o, g)
                trial, share, _, held, slip = friction((k_t, k_t), mu * p, n, seen, z)
                if not waits:
                    f = combined(1.0, f, -share, trial)
                if cable.terms & ROLLING:
                    own = spin(cable, g, x0, x1)
                    moment = share * dot(lever, trial)
                    worked += w * moment * (own - phi)
                    if waits:
                        free = combined(1.0, trial, own * k_t, lever)
                        lean = scaled(mu * slope, there[1])
                        keep_for_twist(cable, o, g, free, lever, mu * p, lean)
                    else:
                        push_line(cable, g, cable.dim, w * moment, out)
                else:
                    touched += where(p, where(1.0 - share, 1.7 * mark, 0.0), 0.0)
                z1 = scaled(share / k_t, trial)
                z1 = where(p, z1[0], 0.0), where(p, z1[1], 0.0), where(p, z1[2], 0.0)
                change = combined(1.0, z1, -1.0, held)
                slid = combined(1.0, combined(1.0, held, 1.0, slip), -1.0, z1)
                full, stored = dot(z, z), dot(z1, z1)
                loss = 0.5 * k_t * (dot(change, change) + full - dot(held, held))
                loss += share * dot(trial, slid)
                lost += w * where(p, loss, 0.5 * k_t * full)
                kept += 0.5 * k_t * w * (stored - full)
                ends = work.trial[o, g]
                ends[0], ends[1], ends[2] = z1
            on_lines = to_lines(pose, middle, f)
            way = combined(1.0, three(after, POINT), -1.0, three(before, POINT))
            worked += w * (dot(on_lines, way) - dot(f, dy))
            push_samples(cable, g, scaled(w, on_lines), out)
    sane, deep = lane_sum(jumps) == 0.0, lane_sum(depths)
    return lane_sum(worked), lane_sum(kept), lane_sum(lost), sane, deep, lane_sum(touched)


@part
def add_elastic_force(cable, x, out):
    """out += elastic pressure at one configuration."""
    add_force(cable, NO, NO, x, x, out)


@piece(void, CABLE, LINES, VECTOR, terms=CONTACT)
def energy(cable, x, out):
    """Add the energy of pressure and bristles [J], obstacles at the end of the last step."""
    contact, state, sum_ = cable.contact, cable.state, zero()
    for o in range(contact.count):
        law = contact.law[o]
        for k in range(int(state.near_count[o])):
            g = int(state.near[o, k])
            measure(cable, o, g, ENDED, x)
            gap = cable.work.measured[o, g, ENDED][DISTANCE] - contact.reach[o]
            deep = depth(gap + state.yielded[o, g, 1])
            z = vector_of(state.bristle[o, g])
            stored = law[STIFFNESS] * deep * deep + law[BRISTLE] * dot(z, z)
            sum_ += 0.5 * contact.weight[g] * stored
    out[TOUCHING] += lane_sum(sum_)


@part
def pressed_by_motion(there, found):
    """Minus d (p n) / d y1, by lines, from a `measured` and a `pressure`."""
    n1, bend = there[1], there[3]
    _, n, _, p, slope, both, _, _ = found
    turn = -p / both
    push, aside = scaled(-slope, n), scaled(-turn, n)
    h = (
        combined(push[0], n1, aside[0], n1),
        combined(push[1], n1, aside[1], n1),
        combined(push[2], n1, aside[2], n1),
    )
    return (
        (h[0][0] + turn * bend[0], h[0][1] + turn * bend[3], h[0][2] + turn * bend[4]),
        (h[1][0] + turn * bend[3], h[1][1] + turn * bend[1], h[1][2] + turn * bend[5]),
        (h[2][0] + turn * bend[4], h[2][1] + turn * bend[5], h[2][2] + turn * bend[2]),
    )


@part
def rubbed_by_motion(k_t, mu, there, found, trial):
    """Minus d f / d y1, by lines, for the trial force of `friction` or `rolling_trial` and the
    coefficient of friction mu.
    """
    n1 = there[1]
    _, n, _, p, slope, _, _, _ = found
    far = sqrt(dot(trial, trial)) + TINY
    limit = mu * p
    share = where(limit - far, 1.0, limit / far)
    slides = where(share - 1.0 + 1e-15, 0.0, 1.0) * where(p, 1.0, 0.0)
    ahead = scaled(1.0 / far, trial)
    hold, lean = share * k_t, mu * slides * slope
    gone, flat = hold * slides, hold / (dot(n, n) + TINY)
    h = (
        combined(lean * ahead[0], n1, -flat * n[0], n),
        combined(lean * ahead[1], n1, -flat * n[1], n),
        combined(lean * ahead[2], n1, -flat * n[2], n),
    )
    h = (
        combined(1.0, h[0], -gone * ahead[0], ahead),
        combined(1.0, h[1], -gone * ahead[1], ahead),
        combined(1.0, h[2], -gone * ahead[2], ahead),
    )
    return (
        (h[0][0] + hold, h[0][1], h[0][2]),
        (h[1][0], h[1][1] + hold, h[1][2]),
        (h[2][0], h[2][1], h[2][2] + hold),
    )


@piece(
    *(void, CABLE, boolean, LINES, LINES, float64, LINES),
    terms=CONTACT,
)
def add_tangent(cable, steps, x0, x1, scale, band):
    """band -= scale times the Jacobian of `add_force` by x1, with which it was called last."""
    contact, state, work = cable.contact, cable.state, cable.work
    begun = BEGUN if steps else ENDED
    for o in range(contact.count):
        law, block = contact.law[o], -1
        rubbed = steps and law[FRICTION] > 0.0
        for k in range(int(state.near_count[o])):
            g = int(state.near[o, k])
            if begun == BEGUN and work.measured_known[o, g, BEGUN] != OF_STEP:
                measure(cable, o, g, BEGUN, x0)
            measure(cable, o, g, ENDED, x1)
            before, after = work.measured[o, g, begun], work.measured[o, g, ENDED]
            dy = combined(1.0, three(after, PLACE), -1.0, three(before, PLACE))
            here, there = measured(before), measured(after)
            if misses(contact, o, here, there, dy):
                continue
            found = pressure(cable, o, g, steps, here, there, dy)
            if lane_sum(found[3]) == 0.0:
                continue
            h = pressed_by_motion(there, found)
            if rubbed:
                mu = friction_at(cable, o, g)
                if cable.terms & ROLLING:
                    trial = rolling_trial(cable, o, g, work.change)
                else:
                    z, limit = vector_of(state.bristle[o, g]), mu * found[3]
                    k_t = law[BRISTLE]
                    trial = friction((k_t, k_t), limit, found[1], dy, z)[0]
                rub = rubbed_by_motion(law[BRISTLE], mu, there, found, trial)
                h = (
                    combined(1.0, h[0], 1.0, rub[0]),
                    combined(1.0, h[1], 1.0, rub[1]),
                    combined(1.0, h[2], 1.0, rub[2]),
                )
            block = add_samples(cable, o, g, MIDDLE, h, scale, block, band)
        if block >= 0:
            add_block(cable, block, band)


@part
def add_samples(cable, o, g, turned_at, h, scale, block, band):
    """band += `scale` times the integral of R h R_end^T over the samples of a group, with R of the
    pose at `turned_at`. Samples on half spaces wait in `work.contact_sums` until another block of
    spans begins; returns the block that waits, or -1.
    """
    contact, work, dim, pose = cable.contact, cable.work, cable.dim, cable.state.pose[o]
    c0, c1, c2 = to_lines(pose, END, h[0]), to_lines(pose, END, h[1]), to_lines(pose, END, h[2])
    w, coarse = scale * contact.weight[g], g < contact.coarse
    if coarse and contact.first[g] != block:
        if block >= 0:
            add_block(cable, block, band)
        clear_sums(work.contact_sums)
        block = contact.first[g]
    for i in range(dim):
        at = turned_at + 3 * i
        f = combined(pose[at], c0, pose[at + 1], c1)
        f = scaled(w, combined(1.0, f, pose[at + 2], c2))
        if coarse:
            add_line(work.contact_sums, contact.basis[g], dim, i, f)
        else:
            store(work.contact_values, i * dim, 0, f[0])
            store(work.contact_values, i * dim + 1, 0, f[1])
            if dim == 3:
                store(work.contact_values, i * dim + 2, 0, f[2])
    if not coarse:
        add_span(cable, g, band)
    return block


@part
def clear_sums(sums):
    """sums = 0."""
    for k in range(sums.shape[0]):
        for c in range(0, sums.shape[1], LANES):
            store(sums, k, c, 0.0)


@part
def add_line(sums, e, dim, i, f):
    """Add what a sample with basis values e adds to line i between all pairs of control points of
    its span, from line i of its derivative f: dim^2 rows of `Work.contact_sums` for each pair.
    """
    at = dim * i
    for first in range(4):
        for other in range(first, 4):
            both = e[first] * e[other]
            store(sums, at, 0, load(sums, at, 0) + both * f[0])
            store(sums, at + 1, 0, load(sums, at + 1, 0) + both * f[1])
            if dim == 3:
                store(sums, at + 2, 0, load(sums, at + 2, 0) + both * f[2])
            at += dim * dim


@piece(void, CABLE, int64, LINES, terms=CONTACT)
def add_block(cable, first, band):
    """band += `Work.contact_sums` of the spans of the block from this column on."""
    dim, sums = cable.dim, cable.work.contact_sums
    for span in range(min(LANES, MARGIN + cable.n - 3 - first)):
        pair = 0
        for one in range(4):
            for other in range(one, 4):
                for i in range(dim):
                    for c in range(dim):
                        value = sums[(pair * dim + i) * dim + c, span]
                        add_pair(dim, first - MARGIN + span, one, other, i, c, value, band)
                pair += 1


@piece(void, CABLE, int64, LINES, terms=CONTACT)
def add_span(cable, g, band):
    """band += what `Work.contact_values` of the samples of a group make of their span."""
    dim, values, sums = cable.dim, cable.work.contact_values, cable.work.pair_sums
    pairs = cable.contact.pairs[g - cable.contact.coarse]
    for entry in range(dim * dim):
        low, high = zero(), zero()
        for k in range(LANES):
            low += values[entry, k] * pairs[k, 0]
            high += values[entry, k] * pairs[k, 1]
        store(sums, entry, 0, low)
        store(sums, entry, LANES, high)
    pair = 0
    for one in range(4):
        for other in range(one, 4):
            for i in range(dim):
                for c in range(dim):
                    value = sums[i * dim + c, pair]
                    add_pair(dim, cable.contact.first[g] - MARGIN, one, other, i, c, value, band)
            pair += 1


@part
def add_pair(dim, first, one, other, i, c, value, band):
    """band += an entry between line i of control point first + `one` and line c of first + `other`,
    and between line i of the latter and c of the former.
    """
    at, apart = 4 * dim - 1 - i + c, (other - one) * dim
    band[(first + one) * dim + i, at + apart] += value
    if other > one:
        band[(first + other) * dim + i, at - apart] += value


# -- velocities after contact --------------------------------------------------------------------


@part
def pose_rate(pose, k, f, g):
    """f times the change of entry k of a pose in the first half of a step, g in the second."""
    early, late = pose[MIDDLE + k] - pose[START + k], pose[END + k] - pose[MIDDLE + k]
    return f * early + g * late


@part
def body_velocity(pose, y, begins, tau):
    """Velocity (3, by line) of points y in the frame of an obstacle at the beginning or the end of
    a step: that of the parabola through its three poses.
    """
    f, g = (3.0 / tau, -1.0 / tau) if begins else (-1.0 / tau, 3.0 / tau)
    turned_by = (
        (pose_rate(pose, 0, f, g), pose_rate(pose, 1, f, g), pose_rate(pose, 2, f, g)),
        (pose_rate(pose, 3, f, g), pose_rate(pose, 4, f, g), pose_rate(pose, 5, f, g)),
        (pose_rate(pose, 6, f, g), pose_rate(pose, 7, f, g), pose_rate(pose, 8, f, g)),
    )
    return (
        dot(turned_by[0], y) + pose_rate(pose, 9, f, g),
        dot(turned_by[1], y) + pose_rate(pose, 10, f, g),
        dot(turned_by[2], y) + pose_rate(pose, 11, f, g),
    )


@part
def is_pressed(cable, o, g):
    """Whether any sample of a group is pressed at the end of a step, as last looked at."""
    gap = cable.work.measured[o, g, ENDED][DISTANCE] - cable.contact.reach[o]
    return any_above(-(gap + cable.state.yielded[o, g, 1]))


@part
def after_contact(cable, o, g, tau, v):
    """Of the samples of a group at the end of a step, in the frame of the obstacle: normal n,
    impulses of pressure and friction per length, velocity of the surface of the cable in `v` less
    that of the obstacle, by which its part along n exceeds that after contact, and lever l; and the
    velocity of the obstacle, by line.
    """
    contact, work, pose, law = cable.contact, cable.work, cable.state.pose[o], cable.contact.law[o]
    before, after = work.measured[o, g, BEGUN], work.measured[o, g, ENDED]
    here, there = measured(before), measured(after)
    dy = combined(1.0, three(after, PLACE), -1.0, three(before, PLACE))
    found = pressure(cable, o, g, YES, here, there, dy)
    n = scaled(1.0 / (sqrt(dot(there[1], there[1])) + TINY), there[1])
    p, rubbed, lever = found[3], (zero(), zero(), zero()), (zero(), zero(), zero())
    carried = body_velocity(pose, three(after, PLACE), NO, tau)
    u = turned_back(pose, END, combined(1.0, sample_at(cable, v, g), -1.0, carried))
    if law[FRICTION] > 0.0:
        limit, z = friction_at(cable, o, g) * p, vector_of(cable.state.bristle[o, g])
        if cable.terms & ROLLING:
            lever = three(work.rolling[o, g], LEVER)
            spins = line_at(cable, v, g, cable.dim)
            t = turned_back(pose, END, weighted(cable, cable.state.x, g, contact.slope[g]))
            turn = dot(obstacle_turn(pose), t) / (tau * sqrt(dot(t, t)) + TINY)
            u = combined(1.0, u, turn - spins, lever)
            trial = rolling_trial(cable, o, g, work.change)
            far = sqrt(dot(trial, trial)) + TINY
            share = where(limit - far, 1.0, limit / far)
        else:
            trial, share, _, _, _ = friction((law[BRISTLE], law[BRISTLE]), limit, found[1], dy, z)
        rubbed = scaled(-tau * share, trial)
    came = body_velocity(pose, three(before, PLACE), YES, tau)
    came = combined(1.0, sample_at(cable, work.start_v, g), -1.0, came)
    speed = dot(here[1], turned_back(pose, START, came))
    excess = dot(n, u) + contact.restitution * where(speed, 0.0, speed)
    return n, p * tau, rubbed, u, excess, lever, carried


@part
def clear_stopped(cable):
    """No impulses in the last step."""
    stopped = cable.state.stopped
    for o in range(cable.contact.count):
        for g in range(stopped.shape[1]):
            for d in range(3):
                stopped[o, g, d] = zero()
    cable.state.balance.stopped = 0.0


@piece((float64, float64), CABLE, float64, LINES, terms=CONTACT)
def begin_stops(cable, tau, v):
    """Energy [J] of velocities that contact changes at the end of a step, and of its impulses in
    it; sets `work.stops`, whether friction holds a sample (1 or 0), its impulse where it slides,
    less that of the step (3), and what is known of the impulse of the pressure, less that.
    """
    contact, open_, spent = cable.contact, zero(), zero()
    if cable.state.balance.stopped > 0.0:
        clear_stopped(cable)
    for o in range(contact.count):
        for k in range(int(cable.state.near_count[o])):
            g = int(cable.state.near[o, k])
            if not is_pressed(cable, o, g):
                continue
            n, p, rubbed, u, excess, _, _ = after_contact(cable, o, g, tau, v)
            limit = friction_at(cable, o, g) * p
            holds = where(limit * limit - (1.0 + SAME) * dot(rubbed, rubbed), 1.0, 0.0)
            across = combined(1.0, u, -dot(n, u), n)
            lacking = where(p, excess * excess, 0.0) + holds * dot(across, across)
            open_ += contact.weight[g] * lacking
            spent += contact.weight[g] * p * p
            stops = cable.work.stops[o, g]
            stops[0], stops[1], stops[2], stops[3], stops[4] = holds, zero(), zero(), zero(), zero()
    return 0.5 * contact.density * lane_sum(open_), 0.5 / contact.density * lane_sum(spent)


@piece(void, CABLE, float64, LINES, LINES, LINES, terms=CONTACT)
def add_stops(cable, tau, v, push, band):
    """push += impulses on samples that have the velocities v, and band += their dependence on a
    change of v: penalties for other velocities than those after contact, and friction that slides.
    """
    contact, stiff = cable.contact, STOP * cable.contact.density
    for o in range(contact.count):
        pose, block = cable.state.pose[o], -1
        for k in range(int(cable.state.near_count[o])):
            g = int(cable.state.near[o, k])
            if not is_pressed(cable, o, g):
                continue
            n, p, _, u, excess, lever, _ = after_contact(cable, o, g, tau, v)
            stops, w = cable.work.stops[o, g], contact.weight[g]
            across = combined(1.0, u, -dot(n, u), n)
            f = combined(1.0, three(stops, 1), -stiff * stops[0], across)
            if cable.terms & ROLLING:
                push_line(cable, g, cable.dim, -w * dot(lever, f), push)
            f = combined(1.0, f, where(p, stops[4] - stiff * excess, 0.0), n)
            push_samples(cable, g, scaled(w, to_lines(pose, END, f)), push)
            hold = stiff * stops[0]
            m = scaled(where(p, stiff, 0.0) - hold, n)
            a, b, c = scaled(n[0], m), scaled(n[1], m), scaled(n[2], m)
            h = (hold + a[0], a[1], a[2]), (b[0], hold + b[1], b[2]), (c[0], c[1], hold + c[2])
            block = add_samples(cable, o, g, END, h, 1.0, block, band)
        if block >= 0:
            add_block(cable, block, band)


@piece((boolean, float64), CABLE, float64, LINES, boolean, terms=CONTACT)
def look_at_stops(cable, tau, v, last):
    """Whether friction holds and slides as `add_stops` had it, with the velocities v after it, and
    the work of the obstacles [J]. If not, and not at the `last` time, `work.stops` is set anew.
    """
    contact, stiff = cable.contact, STOP * cable.contact.density
    worked, wrong = zero(), zero()
    cable.state.balance.stopped = 1.0
    for o in range(contact.count):
        pose = cable.state.pose[o]
        for k in range(int(cable.state.near_count[o])):
            g = int(cable.state.near[o, k])
            if not is_pressed(cable, o, g):
                continue
            n, p, rubbed, u, excess, _, carried = after_contact(cable, o, g, tau, v)
            stops, w = cable.work.stops[o, g], contact.weight[g]
            push = where(p, stops[4] - stiff * excess, 0.0)
            across = combined(1.0, u, -dot(n, u), n)
            f = combined(1.0, three(stops, 1), -stiff * stops[0], across)
            on_lines = to_lines(pose, END, combined(1.0, f, push, n))
            worked += w * dot(on_lines, carried)
            mean = cable.state.stopped[o, g]
            mean[0], mean[1], mean[2] = scaled(1.0 / tau, on_lines)
            if contact.restitution > 0.0:
                # The penalty leaves a share of 1 / STOP, which counts where it should bounce.
                wrong += where(w, where(fabs(excess) * stiff - SAME * fabs(push), 1.0, 0.0), 0.0)
            if not last:
                stops[4] = push if contact.restitution > 0.0 else stops[4]
            if contact.law[o, FRICTION] == 0.0:
                continue
            limit = friction_at(cable, o, g) * where(p + push, p + push, 0.0)
            whole = combined(1.0, rubbed, 1.0, f)
            size = sqrt(dot(whole, whole)) + TINY
            speed = sqrt(dot(across, across)) + TINY
            # What held slides beyond the limit of Coulomb; what slid the way it is pushed holds.
            slips = stops[0] * where(size - (1.0 + SAME) * limit, 1.0, 0.0)
            sticks = (1.0 - stops[0]) * where(dot(across, whole), 1.0, 0.0) * where(p, 1.0, 0.0)
            way = combined(stops[0] / size, whole, (stops[0] - 1.0) / speed, across)
            slid = combined(limit, way, -1.0, rubbed)
            off = combined(1.0, slid, -1.0, three(stops, 1))
            slides = (1.0 - stops[0]) * (1.0 - sticks) * where(p, 1.0, 0.0)
            apart = where(dot(off, off) - SAME * SAME * (limit * limit + p * p), slides, 0.0)
            wrong += where(w, slips + sticks + apart, 0.0)
            if not last:
                stops[0] = stops[0] * (1.0 - slips) + sticks
                stops[1], stops[2], stops[3] = scaled(slips + slides, slid)
    return lane_sum(wrong) == 0.0, lane_sum(worked)


# -- broad phase ---------------------------------------------------------------------------------


@part
def core_distance(cable, o, y):
    """Distance from the core of an obstacle at places y in its frame, 0 inside; from the box around
    a cylinder or mesh.
    """
    core, h = cable.contact.core[o], cable.contact.half[o]
    if core == HALF_SPACE:
        return y[2]
    a, b, c = fabs(y[0]) - h[0], fabs(y[1]) - h[1], fabs(y[2]) - h[2]
    if core == TUBE:
        a, b = fabs(sqrt(y[0] * y[0] + y[1] * y[1]) - h[0]), zero()
    a, b, c = where(a, a, 0.0), where(b, b, 0.0), where(c, c, 0.0)
    return sqrt(a * a + b * b + c * c)


@part
def find_near(cable, x, margin):
    """Set `state.near` to the groups of which a sample may come within `margin` of an obstacle at
    the start of the step.
    """
    contact, state = cable.contact, cable.state
    for o in range(contact.count):
        state.near_count[o] = 0.0
    for g in range(len(contact.first)):
        r, there = sample_at(cable, x, g), fabs(contact.weight[g])
        for o in range(contact.count):
            if g < contact.begin[o] or g >= contact.end[o]:
                continue
            room = margin + contact.reach[o]
            room = room - core_distance(cable, o, to_body(state.pose[o], START, r))
            if any_above(where(there, room, 0.0)):
                state.near[o, int(state.near_count[o])] = g
                state.near_count[o] += 1.0
            else:
                for k in range(3):
                    state.yielded[o, g, k] = zero()
                state.slides[o, g, 0] = zero()


@part
def largest_way(cable, change):
    """By how much control points move at most [m]."""
    most = 0.0
    for c in range(MARGIN, MARGIN + cable.n):
        way = 0.0
        for d in range(cable.dim):
            way += change[d, c] * change[d, c]
        most = max(most, way)
    return np.sqrt(most)


@piece(void, CABLE, float64, float64, float64, LINES, terms=CONTACT)
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
    if balance.yields > 0.0:
        carried = max(carried, RETURN * tau)
    way = 1.5 * (way + carried)
    if not balance.contact_way + way < balance.contact_margin:
        balance.contact_margin = AHEAD * way + cable.contact.least_margin
        balance.contact_way = 0.0
        find_near(cable, x, balance.contact_margin)
    balance.contact_carried = carried
    for o in range(cable.contact.count):
        for k in range(int(cable.state.near_count[o])):
            known = cable.work.measured_known[o, int(cable.state.near[o, k])]
            known[BEGUN] = min(known[BEGUN], KNOWN)
    cable.work.results.yielded = balance.yields
    if balance.yields > 0.0:
        grow_back(cable, tau, x)


@part
def grow_back(cable, tau, x):
    """Let what obstacles have yielded become less in a step of length tau from x."""
    contact, state, left = cable.contact, cable.state, zero()
    for o in range(contact.count):
        most = PRESSED * EARTH * contact.density / contact.law[o, STIFFNESS]
        for k in range(int(state.near_count[o])):
            g = int(state.near[o, k])
            yielded = state.yielded[o, g]
            before = yielded[0]
            if not any_above(before):
                continue
            measure(cable, o, g, BEGUN, x)
            deep = contact.reach[o] - cable.work.measured[o, g, BEGUN][DISTANCE]
            grown = FOLLOWED * (yielded[2] - deep)  # out of it in the last step
            grown = where(grown - most * tau / RISE, grown, most * tau / RISE)
            grown = where(grown - RETURN * tau, RETURN * tau, grown)
            room = before - deep  # where it does not press, to where it does
            grown = where(room, where(room - RETURN * tau, RETURN * tau, room), grown)
            after = before - where(most + room, grown, 0.0)
            yielded[1] = where(after, after, 0.0)
            left += yielded[1]
    state.balance.yields = 1.0 if lane_sum(left) > 0.0 else 0.0


@part
def undo(cable):
    """The step was not made."""
    for o in range(cable.contact.count):
        settle_pose(cable.state.pose[o], START)
        settle_yielding(cable, o, 0)
    cable.state.balance.yields = cable.work.results.yielded


@part
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


@piece(void, CABLE, float64, terms=CONTACT)
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
                for d in range(3):
                    state.bristle[o, g, d] = cable.work.trial[o, g, d]
            state.slides[o, g, 0] = slides_along(cable, o, g, tau)
            deep = contact.reach[o] - cable.work.measured[o, g, ENDED][DISTANCE]
            # Of the start of the step, for `grow_back`.
            begun = cable.work.measured[o, g, BEGUN][DISTANCE]
            state.yielded[o, g, 2] = contact.reach[o] - begun
            deep = where(fabs(contact.weight[g]), deep - state.yielded[o, g, 1], 0.0)
            deepest = where(deep - deepest, deep, deepest)
        if any_above(deepest - state.deepest[o]):
            for k in range(LANES):
                state.deepest[o] = max(state.deepest[o], lane(deepest, k))
        settle_pose(state.pose[o], END)
        settle_yielding(cable, o, 1)


@piece(float64, CABLE, LINES, LINES, LINES, terms=CONTACT)
def look(cable, x0, x1, spare):
    """Find what the contact in an implicit step from x0 to x1 does, for `accept`; `spare` is
    overwritten. Returns the number that changes with what touches and what slides.
    """
    found = add_force(cable, YES, NO, x0, x1, spare)
    results = cable.work.results
    results.contact_work, results.contact_loss, results.contact_deep = found[0], found[2], found[4]
    results.contact_sane = 1.0 if found[3] else 0.0
    return found[5]


@piece(boolean, CABLE, LINES, terms=CONTACT)
def accept(cable, change):
    """Account for the contact in an implicit step by this change that converged, at whose end
    `look` has looked.

    Returns whether the step may stand: nothing passed through an obstacle, and all that came near
    one was looked at.
    """
    balance, results = cable.state.balance, cable.work.results
    way = largest_way(cable, change) + balance.contact_carried
    balance.contact_way += way
    if balance.contact_way > balance.contact_margin:
        balance.contact_margin = 0.0
        return False
    if results.contact_sane == 0.0:
        return False
    balance.contact_deep += results.contact_deep
    balance.drive_work += results.contact_work
    balance.dissipated += results.contact_loss
    return True


# -- what touches, for reports -------------------------------------------------------------------


@piece(void, int64, int64, ARRAY_2D, terms=CONTACT)
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
        d, n, _, _ = measured(cable.work.measured[o, g, ENDED])
        gap, z = d - contact.reach[o], vector_of(state.bristle[o, g])
        f = combined(-law[STIFFNESS] * depth(gap + state.yielded[o, g, 1]), n, -law[BRISTLE], z)
        f = combined(1.0, to_lines(pose, END, f), 1.0, vector_of(state.stopped[o, g]))
        f = scaled(contact.weight[g], f)
        for k in range(LANES):
            values[g, 4 * k], values[g, 4 * k + 1] = lane(gap, k), lane(f[0], k)
            values[g, 4 * k + 2], values[g, 4 * k + 3] = lane(f[1], k), lane(f[2], k)
