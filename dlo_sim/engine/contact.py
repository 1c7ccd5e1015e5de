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
    the pressure p = max(0, p_el - c s (g1 - g0) / tau), with the share s of the way that is inside
and the divided difference p_el = - k s (depth0 + depth1) / 2 of the energy k/2 depth^2, depth < 0;
    friction f = - min(1, mu p / |T|) T, T = k_t P z0 + (k_t + c_t / tau) P dy, P normal to n, with
the bristle z, an elastic displacement along the surface in the frame of the obstacle: it ends as
z1 = (c_t / tau P z0 - f) / (k_t + c_t / tau), or zero where nothing touches. Its energy is
k_t/2 z^2.
The force on the cable per length is F = R_middle (p n + f). The obstacle does the work
F.(r1 - r0) - (p n + f).dy, and the loss is
    (p - p_el) (g0 - g1) + (k_t/2 + c_t / tau) |z1 - P z0|^2 + k_t/2 (|z0|^2 - |P z0|^2)
    - f.(P z0 + P dy - z1);
no part of it is negative.

**Rolling.** A cable that twists in space also turns about its axis by an angle phi relative to the
obstacle, which moves its surface, a radius a off the axis, by - phi l, l = a t x n / (|t| |n|) with
the tangent t. Friction then sees dy - phi l in place of dy, and turns the cable about its axis by
the moment - l.f per length (`engine.rolling`). Without that, friction acts on the axis. The moment
of friction along the cable, which bends it, is left out.

Implicit steps take all of this as one force. Explicit steps have the elastic pressure in their
forces and the rest, friction and damping, as a kick at the end of a step (`dissipate`).

**Jumps.** An obstacle that jumps into the cable would fling it out. It yields instead: its reach is
less by as much as leaves the pressure what it was (`simulation.obstacles.give_way`), and grows back
at the speed RETURN where the cable gives way. Where it does not, being held or pushed out of two
opposite sides, it grows slowly, and waits at last; its force is bounded. The gap then changes by
n.dy and the growth, whose work p times growth is that of the obstacle.

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
from dlo_sim.engine.lines import add, clear, copy, kinetic, solve_mass
from dlo_sim.engine.rows import project
from dlo_sim.terms.one_sided import depth
from dlo_sim.terms.vectors import combined, cross, dot

HALF_SPACE, BOX, CYLINDER, TUBE, MESH = range(5)  # kinds of cores
START, MIDDLE, END = 0, 12, 24  # entries of a pose: R by rows (9), c (3)
BEGUN, ENDED = 0, 1  # of `work.measured`: at the start and the end of a step
UNKNOWN, KNOWN, OF_STEP = 0.0, 1.0, 2.0  # whether that is of the obstacles, and of this step
# Entries there of a group of samples: points of the cable, their places in the frame of an
# obstacle, and what `keep` sets.
POINT, PLACE, DISTANCE, NORMAL, FAR, BEND, SIZE = 0, 3, 6, 7, 10, 11, 17
# Entries of the law of an obstacle, per length of cable: k, c, k_t, c_t, mu.
STIFFNESS, DAMPING, BRISTLE, BRISTLE_DAMPING, FRICTION = range(5)
# Entries of `work.rolling` of a sample: T without the spin in this step (3), l (3), mu p, and its
# derivative by y1 (3).
FREE, LEVER, LIMIT, LEAN = 0, 3, 6, 7

TINY = 1e-30
SMOOTH = 1e-18  # [m^2], of a motion of 1e-9 m, below which n needs no directional part
JUMP = 0.05  # share of the reach that a step may move past an obstacle without a look at normals
# Share of the velocity of a lumped mass that a kick of friction may take. The mass at the end of a
# cable is less than half of that, so half would already turn it round.
KICK = 0.4
RETURN = 0.2  # [m/s], at which an obstacle that has yielded pushes the cable out
# Diameters that a cable may be inside what an obstacle that yields has left: at once, and where it
# does not follow, being held, after RISE [s], as a sudden push would lever it out.
EASY, PRESSED, RISE = 0.01, 0.2, 0.1
SHALLOW = 0.03  # diameters that a cable may begin inside, and of what is not worth a word
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
def copy_pose(pose, at, to):
    """Copy the pose at `at` to `to`."""
    for k in range(12):
        pose[to + k] = pose[at + k]


@part
def settle_yielding(cable, o, at):
    """What an obstacle yields at the start (0) or end (1) of a step is that of the whole step."""
    cable.state.yielded[o, 1 - at] = cable.state.yielded[o, at]


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
        flat = contact.core[o] == HALF_SPACE
        first = 0 if flat else contact.coarse
        count = (contact.coarse if flat else len(contact.first)) - first
        state.near_count[o] = count
        for k in range(count):
            state.near[o, k] = first + k


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
def spin(cable, g, x0, x1):
    """By which angles the cable turns about its axis from x0 to x1 at the samples of a group, in
    the frame that follows its tangent by the smallest rotation.
    """
    e, at, line, angle = cable.contact.basis[g], cable.contact.first[g], cable.dim, zero()
    for k in range(4):
        if g < cable.contact.coarse:
            angle += e[k] * (load(x1, line, at + k) - load(x0, line, at + k))
        else:
            angle += e[k] * (x1[line, at + k] - x0[line, at + k])
    return angle


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
def pressed(k, c, g0, g1):
    """p_el, p, dp/dg1 for gaps before and after; `c`: damping over the length of the step."""
    deep, inverse = depth(g0) + depth(g1), 1.0 / (fabs(g0) + fabs(g1) + TINY)
    share = -deep * inverse
    elastic = -0.5 * k * deep * share
    p = elastic - c * share * (g1 - g0)
    up = sign(g1)
    slope = -0.5 * k * share * (1.0 - up + share * up) - c * share
    slope += c * (g1 - g0) * inverse * (0.5 * (1.0 - up) + share * up)
    p, slope = where(p, p, 0.0), where(p, slope, 0.0)
    return elastic, p, slope


@part
def pressure(cable, o, rate, here, there, dy):
    """Gaps before and after, n, p_el, p, dp/dg1, f0 + f1, 1 where the step may have passed through
    the obstacle, and 1 near its middle, for a step dy between two `measured`. `rate`: 1 / tau, or 0
    at its end.
    """
    contact, yielded = cable.contact, cable.state.yielded[o]
    law, reach, both = contact.law[o], contact.reach[o], here[2] + there[2]
    g0 = here[0] - (reach - (yielded[0] if rate > 0.0 else yielded[1]))
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
    elastic, p, slope = pressed(law[STIFFNESS], law[DAMPING] * rate, g0, g1)
    return (g0, g1), n, elastic, p, slope, both, jumped, where(-g1 - contact.middle[o], 1.0, 0.0)


@part
def keep_for_twist(cable, o, g, free, lever, limit, lean):
    """Let the friction of the samples of a group wait for the twist (`engine.rolling`)."""
    kept = cable.work.rolling[o, g]
    kept[FREE], kept[FREE + 1], kept[FREE + 2] = free
    kept[LEVER], kept[LEVER + 1], kept[LEVER + 2] = lever
    kept[LIMIT] = limit
    kept[LEAN], kept[LEAN + 1], kept[LEAN + 2] = lean


@part
def rolling_trial(cable, o, g, whole, change):
    """T of the samples of a group that roll, for a `change`; `whole`: k_t + c_t / tau."""
    kept, e, at = cable.work.rolling[o, g], cable.contact.basis[g], cable.contact.first[g]
    angle = zero()
    for k in range(4):
        if g < cable.contact.coarse:
            angle += e[k] * load(change, cable.dim, at + k)
        else:
            angle += e[k] * change[cable.dim, at + k]
    return combined(1.0, three(kept, FREE), -whole * angle, three(kept, LEVER))


@part
def along(n, inverse, v):
    """P v = v - n (n . v) / |n|^2; `inverse`: 1 / |n|^2."""
    return combined(1.0, v, -dot(n, v) * inverse, n)


@part
def friction(law, stiff, n, dy, z, p):
    """Trial force T, the share of it that holds, |T|, P z, P dy, 1 / |n|^2; `stiff`: k_t and
    k_t + c_t / tau.
    """
    inverse = 1.0 / (dot(n, n) + TINY)
    held, slip = along(n, inverse, z), along(n, inverse, dy)
    trial = combined(stiff[0], held, stiff[1], slip)
    far = sqrt(dot(trial, trial)) + TINY
    limit = law[FRICTION] * p
    return trial, where(limit - far, 1.0, limit / far), far, held, slip, inverse


# -- forces, energy, Jacobian --------------------------------------------------------------------


@piece(
    *((float64, float64, float64, boolean, float64, float64), CABLE, float64, float64, float64),
    *(boolean, boolean, LINES, LINES, LINES),
    terms=CONTACT,
)
def add_force(cable, springs, rate, most, rubs, waits, x0, x1, out):
    """out += contact force of a step from x0 to x1; the bristles at its end go to `work.trial`.

    Args:
        springs: factor of the elastic pressure, 1 or 0. rate: 1 / tau, 0 for the elastic pressure
            alone. most: bound of k_t + c_t / tau. rubs: whether there is friction. waits: whether
            friction waits in `work.rolling` until the twist is known.

    Returns:
        Work of the obstacles [J], energy put into the bristles [J], loss [J], whether no sample may
        have passed through an obstacle, how many are near the middle of one, and a checksum of what
        touches and, without the twist, what slides.
    """
    contact, state, work = cable.contact, cable.state, cable.work
    worked, kept, lost, jumps, depths = zero(), zero(), zero(), zero(), zero()
    touched = zero()
    begun, middle = (BEGUN, MIDDLE) if rate > 0.0 else (ENDED, END)
    for o in range(contact.count):
        law, pose = contact.law[o], state.pose[o]
        rubbed = rubs and law[FRICTION] > 0.0
        stiff = law[BRISTLE], min(law[BRISTLE] + law[BRISTLE_DAMPING] * rate, most) + TINY
        rates = stiff[1] - stiff[0]
        grown = state.yielded[o, 0] - state.yielded[o, 1] if rate > 0.0 else 0.0
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
                    stored = 0.5 * stiff[0] * w * drop(cable, o, g)
                    lost += stored
                    kept = kept - stored
                continue
            gaps, n, elastic, p, slope, _, jumped, deep = pressure(cable, o, rate, here, there, dy)
            jumps += where(w, jumped, 0.0)
            depths += where(w, deep, 0.0)
            # A checksum: every sample adds its mark if it is pressed, 0.7 marks if it ends outside,
            # 1.7 if it slides. Marks differ from sample to sample, so that one that lets go while
            # another one touches is seen; but not along z of the obstacle, where only the number
            # of samples is seen.
            mark = 1.0 + fabs(before[PLACE]) + fabs(before[PLACE + 1])
            touched += where(p, mark, 0.0) + where(gaps[1], 0.7 * mark, 0.0)
            lost += w * (p - elastic) * (gaps[0] - gaps[1])
            pressed = p - (1.0 - springs) * elastic
            worked += w * grown * pressed
            f = scaled(pressed, n)
            if rubbed:
                z = vector_of(state.bristle[o, g])
                seen = dy
                if cable.terms & ROLLING:
                    phi, lever = rolled(cable, o, g, x0, x1, n)
                    seen = combined(1.0, dy, -phi, lever)
                trial, share, _, held, slip, _ = friction(law, stiff, n, seen, z, p)
                if not waits:
                    f = combined(1.0, f, -share, trial)
                if cable.terms & ROLLING:
                    own = spin(cable, g, x0, x1)
                    moment = share * dot(lever, trial)
                    worked += w * moment * (own - phi)
                    if waits:
                        free = combined(1.0, trial, own * stiff[1], lever)
                        lean = scaled(law[FRICTION] * slope, there[1])
                        keep_for_twist(cable, o, g, free, lever, law[FRICTION] * p, lean)
                    else:
                        push_line(cable, g, cable.dim, w * moment, out)
                else:
                    touched += where(p, where(1.0 - share, 1.7 * mark, 0.0), 0.0)
                z1 = scaled(1.0 / stiff[1], combined(rates, held, share, trial))
                z1 = where(p, z1[0], 0.0), where(p, z1[1], 0.0), where(p, z1[2], 0.0)
                change = combined(1.0, z1, -1.0, held)
                slid = combined(1.0, combined(1.0, held, 1.0, slip), -1.0, z1)
                full, stored = dot(z, z), dot(z1, z1)
                loss = (0.5 * stiff[0] + rates) * dot(change, change)
                loss += 0.5 * stiff[0] * (full - dot(held, held)) + share * dot(trial, slid)
                lost += w * where(p, loss, 0.5 * stiff[0] * full)
                kept += 0.5 * stiff[0] * w * (stored - full)
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
    add_force(cable, 1.0, 0.0, 0.0, NO, NO, x, x, out)


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
            deep = depth(gap + state.yielded[o, 1])
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
def rubbed_by_motion(law, whole, there, found, trial):
    """Minus d f / d y1, by lines, for the trial force of `friction` or `rolling_trial`; `whole`:
    k_t + c_t / tau.
    """
    n1 = there[1]
    _, n, _, p, slope, _, _, _ = found
    far = sqrt(dot(trial, trial)) + TINY
    limit = law[FRICTION] * p
    share = where(limit - far, 1.0, limit / far)
    slides = where(share - 1.0 + 1e-15, 0.0, 1.0) * where(p, 1.0, 0.0)
    ahead = scaled(1.0 / far, trial)
    hold, lean = share * whole, law[FRICTION] * slides * slope
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
    *(void, CABLE, float64, boolean, LINES, LINES, float64, LINES),
    terms=CONTACT,
)
def add_tangent(cable, rate, rubs, x0, x1, scale, band):
    """band -= scale times the Jacobian of `add_force` by x1, with which it was called last."""
    contact, state, work, dim = cable.contact, cable.state, cable.work, cable.dim
    begun = BEGUN if rate > 0.0 else ENDED
    for o in range(contact.count):
        law, pose, block = contact.law[o], state.pose[o], -1
        rubbed = rubs and law[FRICTION] > 0.0
        stiff = law[BRISTLE], law[BRISTLE] + law[BRISTLE_DAMPING] * rate + TINY
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
            found = pressure(cable, o, rate, here, there, dy)
            if lane_sum(found[3]) == 0.0:
                continue
            h = pressed_by_motion(there, found)
            if rubbed:
                z = vector_of(state.bristle[o, g])
                trial = friction(law, stiff, found[1], dy, z, found[3])[0]
                if cable.terms & ROLLING:
                    trial = rolling_trial(cable, o, g, stiff[1], work.change)
                rub = rubbed_by_motion(law, stiff[1], there, found, trial)
                h = (
                    combined(1.0, h[0], 1.0, rub[0]),
                    combined(1.0, h[1], 1.0, rub[1]),
                    combined(1.0, h[2], 1.0, rub[2]),
                )
            # R_middle h R_end^T
            c0, c1, c2 = (
                to_lines(pose, END, h[0]),
                to_lines(pose, END, h[1]),
                to_lines(pose, END, h[2]),
            )
            w, coarse = scale * contact.weight[g], g < contact.coarse
            if coarse and contact.first[g] != block:
                if block >= 0:
                    add_block(cable, block, band)
                clear_sums(work.contact_sums)
                block = contact.first[g]
            for i in range(dim):
                f = combined(pose[MIDDLE + 3 * i], c0, pose[MIDDLE + 3 * i + 1], c1)
                f = scaled(w, combined(1.0, f, pose[MIDDLE + 3 * i + 2], c2))
                if coarse:
                    add_line(work.contact_sums, contact.basis[g], dim, i, f)
                else:
                    store(work.contact_values, i * dim, 0, f[0])
                    store(work.contact_values, i * dim + 1, 0, f[1])
                    if dim == 3:
                        store(work.contact_values, i * dim + 2, 0, f[2])
            if not coarse:
                add_span(cable, g, band)
        if block >= 0:
            add_block(cable, block, band)


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
            if (contact.core[o] == HALF_SPACE) != (g < contact.coarse):
                continue
            room = margin + contact.reach[o]
            room = room - core_distance(cable, o, to_body(state.pose[o], START, r))
            if any_above(where(there, room, 0.0)):
                state.near[o, int(state.near_count[o])] = g
                state.near_count[o] += 1.0


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
    for o in range(cable.contact.count):
        left = max(cable.state.yielded[o, 0] - RETURN * tau, 0.0)
        cable.state.yielded[o, 1] = left
        if cable.state.yielded[o, 0] > 0.0:
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
        if cable.state.yielded[o, 0] > 0.0:
            thick, before = cable.contact.least_margin, cable.state.yielded[o, 0]
            deepest = deepest_begun(cable, o, x)
            out = cable.state.yielded[o, 2] - deepest  # in the last step
            room = max(deepest - before + out, EASY * thick) + PRESSED * thick * tau / RISE
            least = deepest - min(room, PRESSED * thick)
            cable.state.yielded[o, 2] = deepest
            least = min(least, before)  # no further in, whatever pulls
            cable.state.yielded[o, 1] = max(cable.state.yielded[o, 1], least)


@part
def deepest_begun(cable, o, x):
    """How deep the cable is in an obstacle that does not yield at the start of a step [m]."""
    deepest = zero()
    for k in range(int(cable.state.near_count[o])):
        g = int(cable.state.near[o, k])
        measure(cable, o, g, BEGUN, x)
        deep = cable.contact.reach[o] - cable.work.measured[o, g, BEGUN][DISTANCE]
        deep = where(fabs(cable.contact.weight[g]), deep, 0.0)
        deepest = where(deep - deepest, deep, deepest)
    most = 0.0
    for k in range(LANES):
        most = max(most, lane(deepest, k))
    return most


@part
def undo(cable):
    """The step was not made."""
    for o in range(cable.contact.count):
        settle_pose(cable.state.pose[o], START)
        settle_yielding(cable, o, 0)


@part
def keep_bristles(cable):
    """The bristles of the step become those of the state, its end poses those of its end."""
    contact, state = cable.contact, cable.state
    for o in range(contact.count):
        if contact.law[o, FRICTION] > 0.0:
            for k in range(int(state.near_count[o])):
                g = int(state.near[o, k])
                for d in range(3):
                    state.bristle[o, g, d] = cable.work.trial[o, g, d]
        settle_pose(state.pose[o], END)
        settle_yielding(cable, o, 1)


@piece(float64, CABLE, float64, LINES, LINES, LINES, terms=CONTACT)
def look(cable, tau, x0, x1, spare):
    """Find what the contact in an implicit step from x0 to x1 does, for `accept`; `spare` is
    overwritten. Returns the number that changes with what touches and what slides.
    """
    found = add_force(cable, 1.0, 1.0 / tau, np.inf, YES, NO, x0, x1, spare)
    results = cable.work.results
    results.contact_work, results.contact_loss, results.contact_deep = found[0], found[2], found[4]
    results.contact_sane = 1.0 if found[3] else 0.0
    return found[5]


@piece(boolean, CABLE, LINES, terms=CONTACT)
def accept(cable, change):
    """Account for the contact in an implicit step by this change that converged, at whose end
    `look` has looked, and keep its bristles.

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
    keep_bristles(cable)
    return True


# -- explicit steps ------------------------------------------------------------------------------


@part
def contact_energy(cable, x):
    """`energy` [J], into `work.energies`, which is spare between steps."""
    cable.work.energies[TOUCHING] = 0.0
    energy(cable, x, cable.work.energies)
    return cable.work.energies[TOUCHING]


@piece(void, CABLE, float64, LINES, terms=CONTACT)
def carry_obstacles(cable, t, x):
    """Move the obstacles to their poses at time t; the change of energy is their work."""
    if not obstacles_move(cable):
        return
    before = contact_energy(cable, x)
    for o in range(cable.contact.count):
        set_pose(cable, o, END, t)
    cable.state.balance.drive_work += contact_energy(cable, x) - before


@part
def begin_kicks(cable, t0, tau):
    """Prepare an explicit step, which is expected to move the cable as the last one did."""
    balance, x = cable.state.balance, cable.state.x
    copy(x, cable.work.start)
    begin(cable, t0, tau, balance.contact_moved, x)
    growing = False
    for o in range(cable.contact.count):
        copy_pose(cable.state.pose[o], START, END)  # `carry_obstacles` moves it on
        growing = growing or cable.state.yielded[o, 0] > 0.0
    if growing:  # all at once, at the start of the step
        after = contact_energy(cable, x)
        for o in range(cable.contact.count):
            left, cable.state.yielded[o, 1] = cable.state.yielded[o, 1], cable.state.yielded[o, 0]
            cable.state.yielded[o, 0] = left
        balance.drive_work += after - contact_energy(cable, x)
        for o in range(cable.contact.count):
            settle_yielding(cable, o, 0)
        cable.work.results.forces_known = 0.0


@piece(boolean, CABLE, float64, terms=CONTACT)
def dissipate(cable, tau):
    """Friction and damping of an explicit step as a kick of w at its end.

    The energy that it takes from w and from the bristles is lost, but for the work of moving
    obstacles. c_t is reduced to what a kick bears: it must not turn a sliding sample round.

    Returns whether the step may stand, as `accept`.
    """
    balance = cable.state.balance
    x0, x1, w, out = cable.work.start, cable.state.x, cable.state.w, cable.work.change
    clear(out)
    most = KICK * cable.contact.density / (tau * tau)
    worked, kept, _, sane, deep, _ = add_force(cable, 0.0, 1.0 / tau, most, YES, NO, x0, x1, out)
    before = kinetic(cable, w)
    solve_mass(cable, out)
    if cable.rows.count:
        project(cable, out, cable.work.multipliers)
    add(tau, out, w)
    balance.drive_work += worked
    balance.dissipated += before - kinetic(cable, w) + worked - kept
    keep_bristles(cable)
    for d in range(cable.dim):
        for c in range(0, cable.columns, LANES):
            store(out, d, c, load(x1, d, c) - load(x0, d, c))
    balance.contact_moved = largest_way(cable, out) + balance.contact_carried
    balance.contact_way += balance.contact_moved
    balance.contact_deep += deep
    return sane and balance.contact_way <= balance.contact_margin


# -- what touches, for reports -------------------------------------------------------------------


@piece(void, int64, int64, ARRAY_2D, terms=CONTACT)
def report(address, obstacle, out):
    """Gaps [m] and forces on the cable [N], by line, of all samples that may touch an obstacle at
    the present configuration: out[group, 4 lane + 0 .. 3].
    """
    cable, values = cable_at(address), grid(out)
    contact, state, o = cable.contact, cable.state, obstacle
    law, pose, flat = contact.law[o], state.pose[o], contact.core[o] == HALF_SPACE
    for g in range(0 if flat else contact.coarse, contact.coarse if flat else len(contact.first)):
        measure(cable, o, g, ENDED, state.x)
        d, n, _, _ = measured(cable.work.measured[o, g, ENDED])
        gap, z = d - contact.reach[o], vector_of(state.bristle[o, g])
        f = combined(-law[STIFFNESS] * depth(gap + state.yielded[o, 1]), n, -law[BRISTLE], z)
        f = scaled(contact.weight[g], to_lines(pose, END, f))
        for k in range(LANES):
            values[g, 4 * k], values[g, 4 * k + 1] = lane(gap, k), lane(f[0], k)
            values[g, 4 * k + 2], values[g, 4 * k + 3] = lane(f[1], k), lane(f[2], k)
