"""Contact with obstacles: pressure along the normal, and friction that sticks.

**Gap.** An obstacle is a core (half space, box, cylinder, tube) grown by its `reach`: its own
rounding and the radius of the cable. A sphere is a box of size zero, a capsule one that is long in
z only. The wall of a tube has no thickness but what it is grown by; a ring is a tube of length 0.
A mesh has a field of signed distances on a grid (`engine.distance_field`).
At y = R^T (r - c), the place of a sample r of the cable in the frame of the obstacle, the gap is
g = d(y) - reach with the signed distance d from the core. Obstacles may move: `state.pose` has R
and c at the start, the middle and the end of a step, which are equal between steps.

**Samples.** The cable touches at samples of its own, finer than the quadrature where an obstacle is
small, with both ends of the cable: sharp tips would sink in between Gauss points.

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

Implicit steps take all of this as one force. Explicit steps have the elastic pressure in their
forces and the rest, friction and damping, as a kick at the end of a step (`dissipate`).

**Broad phase.** Blocks of spans near an obstacle are found for many steps at once: until cable and
obstacles have moved by `balance.contact_margin`.

Everything is in coordinates of lines: a planar cable has its two, and zero for the third.
"""

from __future__ import annotations

import numpy as np
from numba import boolean, float64, int64, void

from dlo_sim.compiling.groups import grid, load, store
from dlo_sim.compiling.lanes import LANES, fabs, lane, lane_sum, sqrt, where, zero
from dlo_sim.compiling.pieces import ARRAY_2D, NO, YES, part, piece
from dlo_sim.engine.arrays import (
    CABLE,
    CONTACT,
    LINES,
    MARGIN,
    TOUCHING,
    VECTOR,
    cable_at,
)
from dlo_sim.engine.distance_field import field_distance
from dlo_sim.engine.grasps import POSITION, component, elapsed, moves, turned
from dlo_sim.engine.lines import add, clear, copy, kinetic, solve_mass
from dlo_sim.engine.rows import project
from dlo_sim.terms.one_sided import depth
from dlo_sim.terms.vectors import combined, dot

HALF_SPACE, BOX, CYLINDER, TUBE, MESH = range(5)  # kinds of cores
START, MIDDLE, END = 0, 12, 24  # entries of a pose: R by rows (9), c (3)
# Entries of the law of an obstacle, per length of cable: k, c, k_t, c_t, mu.
STIFFNESS, DAMPING, BRISTLE, BRISTLE_DAMPING, FRICTION = range(5)

TINY = 1e-30
SMOOTH = 1e-18  # [m^2], of a motion of 1e-9 m, below which n needs no directional part
JUMP = 0.05  # share of the reach that a step may move past an obstacle without a look at normals
# Share of the velocity of a lumped mass that a kick of friction may take. The mass at the end of a
# cable is less than half of that, so half would already turn it round.
KICK = 0.4
AHEAD = 16.0  # expected motions of a step that the margin of the broad phase allows for


# -- obstacles -----------------------------------------------------------------------------------


@part
def line_axis(cable, d):
    """World axis of line d; that normal to the plane of a planar cable for d = 2."""
    return cable.axes[d] if d < cable.dim else 3 - cable.axes[0] - cable.axes[1]


@part
def set_pose(cable, o, at, t):
    """Set the pose of obstacle o at time t, its entries from `at` on."""
    m, pose = cable.inputs.obstacle[o], cable.state.pose[o]
    s = elapsed(m, t)
    x, y, z = (
        turned(m, t, 1.0, 0.0, 0.0),
        turned(m, t, 0.0, 1.0, 0.0),
        turned(m, t, 0.0, 0.0, 1.0),
    )
    for d in range(3):
        a = line_axis(cable, d)
        pose[at + 3 * d] = component(x, a)
        pose[at + 3 * d + 1] = component(y, a)
        pose[at + 3 * d + 2] = component(z, a)
        way = m[POSITION + 3 + a] + s * m[POSITION + 6 + a]
        pose[at + 9 + d] = m[POSITION + a] + s * way - cable.contact.still[a]


@part
def copy_pose(pose, at, to):
    """Copy the pose at `at` to `to`."""
    for k in range(12):
        pose[to + k] = pose[at + k]


@part
def settle_pose(pose, at):
    """The pose at `at` is that of the whole step."""
    for k in range(12):
        value = pose[at + k]
        pose[START + k] = value
        pose[MIDDLE + k] = value
        pose[END + k] = value


@piece(void, int64, float64, terms=CONTACT)
def place_obstacles(address, t):
    """Set the poses of all obstacles to those at time t."""
    cable = cable_at(address)
    for o in range(cable.contact.count):
        set_pose(cable, o, END, t)
        settle_pose(cable.state.pose[o], END)


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
    for k in range(9):
        turn += (pose[END + k] - pose[START + k]) ** 2
    for k in range(9, 12):
        way += (pose[END + k] - pose[START + k]) ** 2
    return np.sqrt(way) + np.sqrt(turn) * cable.contact.extent[o]


@part
def to_body(pose, at, r):
    """R^T (r - c)."""
    a, b, c = r[0] - pose[at + 9], r[1] - pose[at + 10], r[2] - pose[at + 11]
    return (
        pose[at] * a + pose[at + 3] * b + pose[at + 6] * c,
        pose[at + 1] * a + pose[at + 4] * b + pose[at + 7] * c,
        pose[at + 2] * a + pose[at + 5] * b + pose[at + 8] * c,
    )


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


@part
def box_distance(contact, o, y):
    """`distance` of a box."""
    h = contact.half[o]
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
    return d, n, fabs(d) + TINY, bend


@part
def cylinder_distance(contact, o, y):
    """`distance` of a cylinder about z: a box in the coordinates rho and z."""
    h = contact.half[o]
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
    return d, n, f, (xx, yy, on_cap, less * ex * ey, zero(), zero())


@part
def tube_distance(contact, o, y):
    """`distance` of a tube about z, open at both ends: a segment along z in the coordinates rho and
    z. The distance from the middle of its wall, so that d > 0 on both sides.
    """
    h = contact.half[o]
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
    return d, n, f, (xx, yy, 1.0 - wall, (1.0 - round_) * ex * ey, zero(), zero())


@part
def distance(cable, o, y):
    """Signed distance d from the core, its gradient n, the distance f from the centre of curvature,
    and f n' + n n^T as its entries xx, yy, zz, xy, xz, yz.
    """
    contact = cable.contact
    if contact.core[o] == HALF_SPACE:
        one, none = zero() + 1.0, zero()
        return y[2], (none, none, one), one, (none, none, one, none, none, none)
    if contact.core[o] == BOX:
        return box_distance(contact, o, y)
    if contact.core[o] == CYLINDER:
        return cylinder_distance(contact, o, y)
    if contact.core[o] == TUBE:
        return tube_distance(contact, o, y)
    return field_distance(cable, o, y)


# -- samples of the cable ------------------------------------------------------------------------


@part
def span_points(cable, x, b):
    """The four control points of every span of a block."""
    at, none = MARGIN + LANES * b, zero()
    if cable.dim == 3:
        return (
            (load(x, 0, at), load(x, 1, at), load(x, 2, at)),
            (load(x, 0, at + 1), load(x, 1, at + 1), load(x, 2, at + 1)),
            (load(x, 0, at + 2), load(x, 1, at + 2), load(x, 2, at + 2)),
            (load(x, 0, at + 3), load(x, 1, at + 3), load(x, 2, at + 3)),
        )
    return (
        (load(x, 0, at), load(x, 1, at), none),
        (load(x, 0, at + 1), load(x, 1, at + 1), none),
        (load(x, 0, at + 2), load(x, 1, at + 2), none),
        (load(x, 0, at + 3), load(x, 1, at + 3), none),
    )


@part
def sample_at(contact, b, j, q):
    """Point of the curve at sample j."""
    e = contact.basis[b, j]
    return (
        e[0] * q[0][0] + e[1] * q[1][0] + (e[2] * q[2][0] + e[3] * q[3][0]),
        e[0] * q[0][1] + e[1] * q[1][1] + (e[2] * q[2][1] + e[3] * q[3][1]),
        e[0] * q[0][2] + e[1] * q[1][2] + (e[2] * q[2][2] + e[3] * q[3][2]),
    )


@part
def bristle_of(state, b, o, j):
    """z."""
    z = state.bristle[b, o, j]
    return z[0], z[1], z[2]


@part
def dropped(cable, b, o, j):
    """Let a sample that does not touch lose its bristle; returns |z|^2."""
    z, ends = bristle_of(cable.state, b, o, j), cable.work.trial[b, o, j]
    ends[0] = zero()
    ends[1] = zero()
    ends[2] = zero()
    return dot(z, z)


# -- the law of one sample -----------------------------------------------------------------------


@part
def beyond(cable, o, r):
    """Whether all lanes of points r are further from an obstacle than it, or they, may move in a
    step; false for a half space, which has no bounds.
    """
    contact, pose = cable.contact, cable.state.pose[o]
    if contact.core[o] == HALF_SPACE:
        return False
    room = contact.extent[o] + contact.reach[o] + cable.state.balance.contact_margin
    a, b, c = r[0] - pose[END + 9], r[1] - pose[END + 10], r[2] - pose[END + 11]
    return lane_sum(where(room * room - (a * a + b * b + c * c), 1.0, 0.0)) == 0.0


@part
def misses(contact, o, here, there, dy):
    """Whether no lane can touch or pass an obstacle in a step dy between two `distance`: the way is
    shorter than the sum of its gaps at both ends.
    """
    room = here[0] + there[0] - 2.0 * contact.reach[o]
    free = where(room, where(room * room - dot(dy, dy), 0.0, 1.0), 1.0)
    return lane_sum(free) == 0.0


@part
def pressure(contact, o, rate, here, there, dy):
    """Gaps before and after, n, p_el, p, dp/dg1, f0 + f1, and 1 where the step may have passed
    through the obstacle, for a step dy between two `distance`. `rate`: 1 / tau.
    """
    law, reach = contact.law[o], contact.reach[o]
    g0, g1, both = here[0] - reach, there[0] - reach, here[2] + there[2]
    n, jumped = there[1], zero()
    if contact.core[o] != HALF_SPACE:
        way = dot(dy, dy)
        n = scaled(1.0 / both, combined(here[2], here[1], there[2], there[1]))
        n = combined(1.0, n, ((g1 - g0) - dot(n, dy)) / (way + SMOOTH), dy)
        far = sqrt(way)
        jumped = where(far - (g0 + g1), 1.0, 0.0) * where(0.5 - dot(here[1], there[1]), 1.0, 0.0)
        jumped = jumped * where(far - JUMP * reach, 1.0, 0.0)
        # Not across the opening of a ring, from one side to the other.
        jumped = jumped * where(-dot(here[1], dy), 1.0, where(dot(there[1], dy), 1.0, 0.0))
    k, c = law[STIFFNESS], law[DAMPING] * rate
    deep, inverse = depth(g0) + depth(g1), 1.0 / (fabs(g0) + fabs(g1) + TINY)
    share = -deep * inverse
    elastic = -0.5 * k * deep * share
    p = elastic - c * share * (g1 - g0)
    up = sign(g1)
    slope = -0.5 * k * share * (1.0 - up + share * up) - c * share
    slope += c * (g1 - g0) * inverse * (0.5 * (1.0 - up) + share * up)
    p, slope = where(p, p, 0.0), where(p, slope, 0.0)
    return (g0, g1), n, elastic, p, slope, both, jumped


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


@part
def add_to_point(cable, at, f, out):
    """out += forces on one control point of every span of a block."""
    store(out, 0, at, load(out, 0, at) + f[0])
    store(out, 1, at, load(out, 1, at) + f[1])
    if cable.dim == 3:
        store(out, 2, at, load(out, 2, at) + f[2])


@piece(
    *((float64, float64, float64, boolean), CABLE, float64, float64, float64),
    *(boolean, LINES, LINES, LINES),
    terms=CONTACT,
)
def add_force(cable, springs, rate, most, rubs, x0, x1, out):
    """out += contact force of a step from x0 to x1; the bristles at its end go to `work.trial`.

    Args:
        springs: factor of the elastic pressure, 1 or 0. rate: 1 / tau, 0 for the elastic pressure
            alone. most: bound of k_t + c_t / tau. rubs: whether there is friction.

    Returns:
        Work of the obstacles [J], energy put into the bristles [J], loss [J], and whether no sample
        may have passed through an obstacle.
    """
    contact, state, none = cable.contact, cable.state, (zero(), zero(), zero())
    worked, kept, lost, jumps = zero(), zero(), zero(), zero()
    begun, middle = (START, MIDDLE) if rate > 0.0 else (END, END)
    for o in range(contact.count):
        law, pose, pick = contact.law[o], state.pose[o], contact.rule[o]
        rubbed = rubs and law[FRICTION] > 0.0
        stiff = law[BRISTLE], min(law[BRISTLE] + law[BRISTLE_DAMPING] * rate, most) + TINY
        rates = stiff[1] - stiff[0]
        for b in range(cable.blocks):
            if state.near[b, o] == 0.0:
                continue
            q0, q1 = span_points(cable, x0, b), span_points(cable, x1, b)
            g0, g1, g2, g3 = none, none, none, none
            for j in range(0, contact.last[b], contact.stride[pick]):
                r1, w = sample_at(contact, b, j, q1), contact.weight[b, j, pick]
                if beyond(cable, o, r1):
                    if rubbed:
                        stored = 0.5 * stiff[0] * w * dropped(cable, b, o, j)
                        lost += stored
                        kept = kept - stored
                    continue
                r0 = sample_at(contact, b, j, q0)
                y0, y1 = to_body(pose, begun, r0), to_body(pose, END, r1)
                here, there = distance(cable, o, y0), distance(cable, o, y1)
                dy = combined(1.0, y1, -1.0, y0)
                if contact.core[o] != HALF_SPACE and misses(contact, o, here, there, dy):
                    if rubbed:
                        stored = 0.5 * stiff[0] * w * dropped(cable, b, o, j)
                        lost += stored
                        kept = kept - stored
                    continue
                found = pressure(contact, o, rate, here, there, dy)
                gaps, n, elastic, p, _, _, jumped = found
                jumps += where(w, jumped, 0.0)
                lost += w * (p - elastic) * (gaps[0] - gaps[1])
                f = scaled(p - (1.0 - springs) * elastic, n)
                if rubbed:
                    z = bristle_of(state, b, o, j)
                    trial, share, _, held, slip, _ = friction(law, stiff, n, dy, z, p)
                    f = combined(1.0, f, -share, trial)
                    z1 = scaled(1.0 / stiff[1], combined(rates, held, share, trial))
                    z1 = where(p, z1[0], 0.0), where(p, z1[1], 0.0), where(p, z1[2], 0.0)
                    change = combined(1.0, z1, -1.0, held)
                    slid = combined(1.0, combined(1.0, held, 1.0, slip), -1.0, z1)
                    full, stored = dot(z, z), dot(z1, z1)
                    loss = (0.5 * stiff[0] + rates) * dot(change, change)
                    loss += 0.5 * stiff[0] * (full - dot(held, held)) + share * dot(trial, slid)
                    lost += w * where(p, loss, 0.5 * stiff[0] * full)
                    kept += 0.5 * stiff[0] * w * (stored - full)
                    ends = cable.work.trial[b, o, j]
                    ends[0], ends[1], ends[2] = z1
                on_lines = to_lines(pose, middle, f)
                worked += w * (dot(on_lines, combined(1.0, r1, -1.0, r0)) - dot(f, dy))
                push, e = scaled(w, on_lines), contact.basis[b, j]
                g0, g1 = combined(1.0, g0, e[0], push), combined(1.0, g1, e[1], push)
                g2, g3 = combined(1.0, g2, e[2], push), combined(1.0, g3, e[3], push)
            at = MARGIN + LANES * b
            add_to_point(cable, at, g0, out)
            add_to_point(cable, at + 1, g1, out)
            add_to_point(cable, at + 2, g2, out)
            add_to_point(cable, at + 3, g3, out)
    return lane_sum(worked), lane_sum(kept), lane_sum(lost), lane_sum(jumps) == 0.0


@part
def add_elastic_force(cable, x, out):
    """out += elastic pressure at one configuration."""
    add_force(cable, 1.0, 0.0, 0.0, NO, x, x, out)


@piece(void, CABLE, LINES, VECTOR, terms=CONTACT)
def energy(cable, x, out):
    """Add the energy of pressure and bristles [J], obstacles at the end of the last step."""
    contact, state, sum_ = cable.contact, cable.state, zero()
    for o in range(contact.count):
        law, pose, pick = contact.law[o], state.pose[o], contact.rule[o]
        for b in range(cable.blocks):
            if state.near[b, o] == 0.0:
                continue
            q = span_points(cable, x, b)
            for j in range(0, contact.last[b], contact.stride[pick]):
                r = sample_at(contact, b, j, q)
                if beyond(cable, o, r):
                    continue
                y = to_body(pose, END, r)
                deep = depth(distance(cable, o, y)[0] - contact.reach[o])
                z = bristle_of(state, b, o, j)
                stored = law[STIFFNESS] * deep * deep + law[BRISTLE] * dot(z, z)
                sum_ += 0.5 * contact.weight[b, j, pick] * stored
    out[TOUCHING] += lane_sum(sum_)


@part
def by_motion(contact, o, rate, stiff, here, there, dy, z, rubbed):
    """Minus d (p n + f) / d y1, by lines."""
    law, n1, bend = contact.law[o], there[1], there[3]
    _, n, _, p, slope, both, _ = pressure(contact, o, rate, here, there, dy)
    turn = -p / both
    push, aside = scaled(-slope, n), scaled(-turn, n)
    h = (
        combined(push[0], n1, aside[0], n1),
        combined(push[1], n1, aside[1], n1),
        combined(push[2], n1, aside[2], n1),
    )
    h = (
        (h[0][0] + turn * bend[0], h[0][1] + turn * bend[3], h[0][2] + turn * bend[4]),
        (h[1][0] + turn * bend[3], h[1][1] + turn * bend[1], h[1][2] + turn * bend[5]),
        (h[2][0] + turn * bend[4], h[2][1] + turn * bend[5], h[2][2] + turn * bend[2]),
    )
    if rubbed:
        trial, share, far, _, _, inverse = friction(law, stiff, n, dy, z, p)
        slides = where(share - 1.0 + 1e-15, 0.0, 1.0) * where(p, 1.0, 0.0)
        way = scaled(1.0 / far, trial)
        hold, lean = share * stiff[1], law[FRICTION] * slides * slope
        gone, flat = hold * slides, hold * inverse
        h = (
            combined(1.0, h[0], 1.0, combined(lean * way[0], n1, -flat * n[0], n)),
            combined(1.0, h[1], 1.0, combined(lean * way[1], n1, -flat * n[1], n)),
            combined(1.0, h[2], 1.0, combined(lean * way[2], n1, -flat * n[2], n)),
        )
        h = (
            combined(1.0, h[0], -gone * way[0], way),
            combined(1.0, h[1], -gone * way[1], way),
            combined(1.0, h[2], -gone * way[2], way),
        )
        h = (
            (h[0][0] + hold, h[0][1], h[0][2]),
            (h[1][0], h[1][1] + hold, h[1][2]),
            (h[2][0], h[2][1], h[2][2] + hold),
        )
    return h


@piece(
    *(void, CABLE, float64, boolean, LINES, LINES, float64, LINES),
    terms=CONTACT,
)
def add_tangent(cable, rate, rubs, x0, x1, scale, band):
    """band -= scale times the Jacobian of `add_force` with respect to x1."""
    contact, state, work, dim = cable.contact, cable.state, cable.work, cable.dim
    for b in range(cable.blocks):
        found = zero()
        q0, q1 = span_points(cable, x0, b), span_points(cable, x1, b)
        for o in range(contact.count):
            if state.near[b, o] == 0.0:
                continue
            law, pose, pick = contact.law[o], state.pose[o], contact.rule[o]
            rubbed = rubs and law[FRICTION] > 0.0
            stiff = law[BRISTLE], law[BRISTLE] + law[BRISTLE_DAMPING] * rate + TINY
            for j in range(0, contact.last[b], contact.stride[pick]):
                r1 = sample_at(contact, b, j, q1)
                if beyond(cable, o, r1):
                    continue
                y0 = to_body(pose, START, sample_at(contact, b, j, q0))
                y1 = to_body(pose, END, r1)
                here, there = distance(cable, o, y0), distance(cable, o, y1)
                dy = combined(1.0, y1, -1.0, y0)
                if contact.core[o] != HALF_SPACE and misses(contact, o, here, there, dy):
                    continue
                z = bristle_of(state, b, o, j)
                h = by_motion(contact, o, rate, stiff, here, there, dy, z, rubbed)
                # R_middle h R_end^T
                c0, c1 = to_lines(pose, END, h[0]), to_lines(pose, END, h[1])
                c2 = to_lines(pose, END, h[2])
                if lane_sum(found) == 0.0:
                    clear_sums(work.contact_sums)
                w = scale * contact.weight[b, j, pick]
                found += where(w, 1.0, 0.0)
                for i in range(dim):
                    f = combined(pose[MIDDLE + 3 * i], c0, pose[MIDDLE + 3 * i + 1], c1)
                    f = scaled(w, combined(1.0, f, pose[MIDDLE + 3 * i + 2], c2))
                    add_line(work.contact_sums, contact.basis[b, j], dim, i, f)
        if lane_sum(found) > 0.0:
            scatter_sums(cable, b, found, band)


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


@part
def scatter_sums(cable, b, found, band):
    """band += `Work.contact_sums` of the spans of a block that touch anything."""
    dim, sums = cable.dim, cable.work.contact_sums
    for span in range(min(LANES, cable.n - 3 - LANES * b)):
        if lane(found, span) == 0.0:
            continue
        at = 0
        for first in range(4):
            for other in range(first, 4):
                for i in range(dim):
                    row = band[(LANES * b + span + first) * dim + i]
                    twin = band[(LANES * b + span + other) * dim + i]
                    begin, apart = 4 * dim - 1 - i, (other - first) * dim
                    for c in range(dim):
                        value = sums[at + c, span]
                        row[begin + apart + c] += value
                        if other > first:
                            twin[begin - apart + c] += value
                    at += dim


# -- broad phase ---------------------------------------------------------------------------------


@part
def core_distance(cable, o, r0, r1, r2):
    """Distance of a point from the core of an obstacle at the start of the step, 0 inside."""
    half, pose = cable.contact.half[o], cable.state.pose[o]
    y = to_body(pose, START, (r0, r1, r2))
    if cable.contact.core[o] == HALF_SPACE:
        return y[2]
    c = max(abs(y[2]) - half[2], 0.0)
    if cable.contact.core[o] in (BOX, MESH):
        a, b = max(abs(y[0]) - half[0], 0.0), max(abs(y[1]) - half[1], 0.0)
        return np.sqrt(a * a + b * b + c * c)
    a = np.sqrt(y[0] * y[0] + y[1] * y[1]) - half[0]
    a = max(a, 0.0) if cable.contact.core[o] == CYLINDER else abs(a)
    return np.sqrt(a * a + c * c)


@part
def find_near(cable, x, margin):
    """Set `state.near` where a block of spans may come within `margin` of an obstacle: the convex
    hull of its control points contains it.
    """
    for b in range(cable.blocks):
        first = MARGIN + LANES * b
        last = min(first + LANES + 3, MARGIN + cable.n)
        square, c0, c1, c2 = 0.0, 0.0, 0.0, 0.0
        for d in range(cable.dim):
            low = high = x[d, first]
            for i in range(first + 1, last):
                low, high = min(low, x[d, i]), max(high, x[d, i])
            middle = 0.5 * (low + high)
            square += (high - middle) * (high - middle)
            if d == 0:
                c0 = middle
            elif d == 1:
                c1 = middle
            else:
                c2 = middle
        room = np.sqrt(square) + margin
        for o in range(cable.contact.count):
            far = core_distance(cable, o, c0, c1, c2) - cable.contact.reach[o]
            cable.state.near[b, o] = 0.0 if far > room else 1.0


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
    way = 1.5 * (way + carried)
    if not balance.contact_way + way < balance.contact_margin:
        balance.contact_margin = AHEAD * way + cable.contact.least_margin
        balance.contact_way = 0.0
        find_near(cable, x, balance.contact_margin)
    balance.contact_carried = carried


@part
def undo(cable):
    """The step was not made."""
    for o in range(cable.contact.count):
        settle_pose(cable.state.pose[o], START)


@part
def keep_bristles(cable):
    """The bristles of the step become those of the state, its end poses those of its end."""
    contact, state = cable.contact, cable.state
    for o in range(contact.count):
        if contact.law[o, FRICTION] > 0.0:
            for b in range(cable.blocks):
                if state.near[b, o] != 0.0:
                    for j in range(0, contact.last[b], contact.stride[contact.rule[o]]):
                        for k in range(3):
                            state.bristle[b, o, j, k] = cable.work.trial[b, o, j, k]
        settle_pose(state.pose[o], END)


@piece(boolean, CABLE, float64, LINES, LINES, LINES, LINES, terms=CONTACT)
def accept(cable, tau, x0, x1, change, spare):
    """Account for the contact in an implicit step from x0 to x1 = x0 + change that converged, and
    keep its bristles; `spare` is overwritten.

    Returns whether the step may stand: nothing passed through an obstacle, and all that came near
    one was looked at.
    """
    balance = cable.state.balance
    way = largest_way(cable, change) + balance.contact_carried
    balance.contact_way += way
    if balance.contact_way > balance.contact_margin:
        balance.contact_margin = 0.0
        return False
    worked, _, lost, sane = add_force(cable, 1.0, 1.0 / tau, np.inf, YES, x0, x1, spare)
    if not sane:
        return False
    balance.drive_work += worked
    balance.dissipated += lost
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
    copy(cable.state.x, cable.work.start)
    begin(cable, t0, tau, cable.state.balance.contact_moved, cable.state.x)
    for o in range(cable.contact.count):
        copy_pose(cable.state.pose[o], START, END)  # `carry_obstacles` moves it on


@piece(void, CABLE, float64, terms=CONTACT)
def dissipate(cable, tau):
    """Friction and damping of an explicit step as a kick of w at its end.

    The energy that it takes from w and from the bristles is lost, but for the work of moving
    obstacles. c_t is reduced to what a kick bears: it must not turn a sliding sample round.
    """
    balance = cable.state.balance
    x0, x1, w, out = cable.work.start, cable.state.x, cable.state.w, cable.work.change
    clear(out)
    most = KICK * cable.contact.density / (tau * tau)
    worked, kept, _, _ = add_force(cable, 0.0, 1.0 / tau, most, YES, x0, x1, out)
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


# -- what touches, for reports -------------------------------------------------------------------


@piece(void, int64, int64, ARRAY_2D, terms=CONTACT)
def report(address, obstacle, out):
    """Gaps [m] and forces on the cable [N], by line, of all samples with an obstacle at the present
    configuration: out[b LANES + lane (span), 4 j + 0 .. 3].
    """
    cable, values = cable_at(address), grid(out)
    contact, state, o = cable.contact, cable.state, obstacle
    law, pose, pick = contact.law[o], state.pose[o], contact.rule[o]
    for b in range(cable.blocks):
        q = span_points(cable, state.x, b)
        for j in range(0, contact.last[b], contact.stride[pick]):
            w = contact.weight[b, j, pick]
            y = to_body(pose, END, sample_at(contact, b, j, q))
            d, n, _, _ = distance(cable, o, y)
            gap, z = d - contact.reach[o], bristle_of(state, b, o, j)
            f = combined(-law[STIFFNESS] * depth(gap), n, -law[BRISTLE], z)
            f = scaled(w, to_lines(pose, END, f))
            for k in range(LANES):
                row = values[LANES * b + k]
                row[4 * j], row[4 * j + 1] = lane(gap, k), lane(f[0], k)
                row[4 * j + 2], row[4 * j + 3] = lane(f[1], k), lane(f[2], k)
