"""Sliding grasps: rows that give, at a material coordinate that moves with friction.

A gripper at p holds the cable at the material coordinate u through a spring of stiffness k, and its
direction d, if at all, through one of stiffness k_t:
    U = k/2 |r(u) - p|^2 + k_t/2 |r'(u) - d|^2.
At constant u this is a compliant grasp (`engine.springs`). The force that does work when u changes
is G = - k (r - p).r' - k_t (r' - d).r''; the cable slides where |G| would otherwise exceed
    mu (k |P (r - p)| + grip),
with the projection P normal to the cable and the force `grip` of the jaws [N]. Without friction the
gripper is therefore at the point of the cable that is nearest to it. A kink that is sharper than
the knot spans can represent has less energy at some places of a span than at others, which resists
sliding as friction does: with knot spans of twice the bending length sqrt(EI / tension), by up to a
tenth of the tension.

**An implicit step** from (x0, u0, p0) to (x1, u1, p1) has, with gaps a = r - p, b = r' - d at its
start and end, means marked by a bar, and the mean tangent t = (r(u1) - r(u0)) / (u1 - u0) of the
mean of x0 and x1, at the end of which u1 either equals u0, or is found such that |G| is the limit,
    the force f = - k (mean a + (1/2) (t.(a1 - a0)) t / |t|^2) and - k_t (mean b) for the direction,
of which half acts on the material point u0, half on u1. Along the cable, f contains the gap at the
end: with the mean gap, it would oscillate when the cable begins to slide. The gripper does the work
f.(p1 - p0) - k_t (mean b).(d1 - d0), and the loss is
    k/2 (t.(a1 - a0))^2 / |t|^2 + G (u1 - u0),
no part of which is negative: the energy account is closed. The limit of friction is that at the
start of the step; that at its end has no derivative, as |P a|, where the gripper does not press.

Explicit steps cannot let the cable slide: with u fixed in a step of length tau, friction would be
too large by k tau/2 times the speed of sliding.

A gripper stops beside one that holds the cable fast, and two that slide never pass each other: u
stays within stops (`stops_of`), where the force along the cable is more than friction.

A cable whose end passes the gripper slips out of it: its u is LOST from then on. In the step in
which it does, its tangent goes on beyond the end, so that friction limits the force to the last.
"""

from __future__ import annotations

import numpy as np
from numba import boolean, float64, int64, void

from dlo_sim.compiling.kernels import inline, kernel
from dlo_sim.compiling.lanes import LANES, lane
from dlo_sim.engine.arrays import CABLE, LINES, MARGIN, SLIDING, SPRING, VECTOR
from dlo_sim.engine.grasps import component, moves
from dlo_sim.engine.rows import AIM, PLACE
from dlo_sim.terms.vectors import combined, dot

STIFFNESS, TURNING, FRICTION, GRIP = range(4)  # entries of the law of a slide: k, k_t, mu, grip
START, END = 0, 6  # entries of the pose of its gripper: p (3), d (3), by line
LOST = -1.0
MOST_SEARCHES = 30  # for u1
CLOSE = 1e-13  # of the length, below which u1 is found
NEXT = 1e-6  # of the length, how near a slide comes to what else holds the cable
APART = 1e-7  # of the length, below which the mean tangent is the tangent


# -- the curve at a material coordinate ---------------------------------------------------------


@inline
def basis_at(cable, u):
    """First control point of the span at u, and the values, first and second derivatives of its
    four basis functions there; beyond an end of the cable those of its tangent.
    """
    breaks, mesh = cable.slides.breaks, cable.mesh
    inside = min(max(u, 0.0), breaks[cable.n - 3])
    past = u - inside
    span, beyond = 0, cable.n - 3
    while beyond - span > 1:
        middle = (span + beyond) // 2
        if inside < breaks[middle]:
            beyond = middle
        else:
            span = middle
    block, k = span // LANES, span % LANES
    slope = lane(mesh.slope[block], k)
    xi, bent = slope * (inside - breaks[span]) - 1.0, 0.0 if past != 0.0 else 1.0
    a = basis_of(mesh, block, k, 0, xi, slope)
    b = basis_of(mesh, block, k, 1, xi, slope)
    c = basis_of(mesh, block, k, 2, xi, slope)
    d = basis_of(mesh, block, k, 3, xi, slope)
    return (
        span,
        (a[0] + past * a[1], b[0] + past * b[1], c[0] + past * c[1], d[0] + past * d[1]),
        (a[1], b[1], c[1], d[1]),
        (bent * a[2], bent * b[2], bent * c[2], bent * d[2]),
    )


@inline
def basis_of(mesh, block, k, j, xi, slope):
    """Value and two derivatives of basis function j of lane k of a block."""
    constant, linear = lane(mesh.slopes[block, 3 * j], k), lane(mesh.slopes[block, 3 * j + 1], k)
    square, value = lane(mesh.slopes[block, 3 * j + 2], k), lane(mesh.values[block, j], k)
    rise = xi * (constant + xi * (linear / 2.0 + xi * square / 3.0))
    return (
        value + rise / slope,
        constant + xi * (linear + xi * square),
        slope * (linear + 2.0 * xi * square),
    )


@inline
def summed(cable, span, weights, x):
    """sum_k b_k x_k, by line."""
    at, dim = MARGIN + span, cable.dim
    first, second, third = 0.0, 0.0, 0.0
    for k in range(4):
        first += weights[k] * x[0, at + k]
        second += weights[k] * x[1, at + k]
        if dim == 3:
            third += weights[k] * x[2, at + k]
    return first, second, third


@inline
def mean_of(cable, span, weights, x0, x1):
    """`summed` of the mean of two configurations."""
    a, b = summed(cable, span, weights, x0), summed(cable, span, weights, x1)
    return combined(0.5, a, 0.5, b)


@inline
def gaps(cable, k, at, basis, x):
    """r - p and r' - d of slide k with the pose of its gripper at `at`."""
    pose = cable.state.slide_pose[k]
    r, tangent = summed(cable, basis[0], basis[1], x), summed(cable, basis[0], basis[2], x)
    return (
        combined(1.0, r, -1.0, (pose[at], pose[at + 1], pose[at + 2])),
        combined(1.0, tangent, -1.0, (pose[at + 3], pose[at + 4], pose[at + 5])),
    )


# -- the law ------------------------------------------------------------------------------------


@inline
def response(cable, k, u0, u1, x0, x1):
    """Of a step from (x0, u0) to (x1, u1): mean gaps a and b, of which a has that at the end along
    the cable; mean tangent t and curvature; G and its limit; both `basis_at`.
    """
    law = cable.slides.law[k]
    begun, end = basis_at(cable, u0), basis_at(cable, u1)
    a0, b0 = gaps(cable, k, START, begun, x0)
    a1, b1 = gaps(cable, k, END, end, x1)
    if abs(u1 - u0) > APART * cable.slides.breaks[cable.n - 3]:
        way = 1.0 / (u1 - u0)
        r0 = mean_of(cable, begun[0], begun[1], x0, x1)
        r1 = mean_of(cable, end[0], end[1], x0, x1)
        t = combined(way, r1, -way, r0)
        r0 = mean_of(cable, begun[0], begun[2], x0, x1)
        r1 = mean_of(cable, end[0], end[2], x0, x1)
        turn = combined(way, r1, -way, r0)
    else:
        t = mean_of(cable, end[0], end[2], x0, x1)
        turn = mean_of(cable, end[0], end[3], x0, x1)
    a, b = combined(0.5, a0, 0.5, a1), combined(0.5, b0, 0.5, b1)
    square = dot(t, t)
    a = combined(1.0, a, (dot(t, a1) - dot(t, a)) / square, t)
    t0 = summed(cable, begun[0], begun[2], x0)
    aside = combined(1.0, a0, -dot(t0, a0) / dot(t0, t0), t0)
    pressed = law[STIFFNESS] * np.sqrt(dot(aside, aside))
    driving = -law[STIFFNESS] * dot(a, t) - law[TURNING] * dot(b, turn)
    return a, b, t, turn, driving, law[FRICTION] * (pressed + law[GRIP]), begun, end


@inline
def stops_of(cable, k):
    """Material coordinates [m] between which slide k may end a step: less than halfway to others
    that slide, and no nearer than NEXT.
    """
    slide, stops = cable.state.slide, cable.slides.stops[k]
    u, apart = slide[k], NEXT * cable.slides.breaks[cable.n - 3]
    low, high = min(stops[0], u), max(stops[1], u)
    for other in range(cable.slides.count):
        v = slide[other]
        if v != LOST and v < u:
            low = max(low, min(u, max(u - 0.4 * (u - v), v + apart)))
        if v > u:
            high = min(high, max(u, min(u + 0.4 * (v - u), v - apart)))
    return low, high


@kernel(float64, CABLE, int64, LINES, LINES, terms=SLIDING)
def slid_to(cable, k, x0, x1):
    """Material coordinate u1 [m] of slide k at the end of a step from x0 to x1, or on the tangent
    beyond the end of a cable that slips out.
    """
    law, u0 = cable.slides.law[k], cable.state.slide[k]
    length = cable.slides.breaks[cable.n - 3]
    low, high = stops_of(cable, k)
    u1, side = u0, 0.0
    for _ in range(MOST_SEARCHES):
        _, _, t, turn, driving, limit, _, _ = response(cable, k, u0, u1, x0, x1)
        if side == 0.0:
            if abs(driving) <= limit:
                return u0
            side = 1.0 if driving > 0.0 else -1.0
        stiffness = law[STIFFNESS] * dot(t, t) + 0.5 * law[TURNING] * dot(turn, turn)
        before = u1
        u1 += (driving - side * limit) / stiffness
        u1 = min(max(u1, low), high)
        if side * (u1 - u0) < 0.0:
            return u0
        if abs(u1 - before) <= CLOSE * length:
            break
    return u1


@inline
def push_slide(cable, basis, scale, a, b, out):
    """out += scale a on the material point of a basis, and scale b on its r'."""
    at = MARGIN + basis[0]
    for d in range(cable.dim):
        force, moment = scale * component(a, d), scale * component(b, d)
        for k in range(4):
            out[d, at + k] += force * basis[1][k] + moment * basis[2][k]


# -- forces, energy, Jacobian -------------------------------------------------------------------


@kernel(float64, CABLE, LINES, LINES, LINES, terms=SLIDING)
def step_slides(cable, x0, x1, out):
    """out += forces of an implicit step from x0 to x1; its u1 go to `work.slid`.

    Returns the loss [J].
    """
    lost = 0.0
    for k in range(cable.slides.count):
        u0 = cable.state.slide[k]
        if u0 == LOST:
            continue
        law = cable.slides.law[k]
        u1 = slid_to(cable, k, x0, x1)
        cable.work.slid[k] = u1
        a, b, t, _, driving, _, begun, end = response(cable, k, u0, u1, x0, x1)
        f, moment = combined(-law[STIFFNESS], a, 0.0, a), combined(-law[TURNING], b, 0.0, b)
        push_slide(cable, begun, 0.5, f, moment, out)
        push_slide(cable, end, 0.5, f, moment, out)
        a0, _ = gaps(cable, k, START, begun, x0)
        a1, _ = gaps(cable, k, END, end, x1)
        closing = dot(t, a1) - dot(t, a0)
        lost += 0.5 * law[STIFFNESS] * closing * closing / dot(t, t) + driving * (u1 - u0)
    return lost


@kernel(void, CABLE, LINES, LINES, terms=SLIDING)
def slide_force(cable, x, out):
    """out += forces at one configuration, with the grippers at the end of the step."""
    for k in range(cable.slides.count):
        if cable.state.slide[k] != LOST:
            basis, law = basis_at(cable, cable.state.slide[k]), cable.slides.law[k]
            a, b = gaps(cable, k, END, basis, x)
            f, moment = combined(-law[STIFFNESS], a, 0.0, a), combined(-law[TURNING], b, 0.0, b)
            push_slide(cable, basis, 1.0, f, moment, out)


@inline
def stored(cable, k, u, x):
    """U of slide k [J] with its gripper at the end of the step."""
    law = cable.slides.law[k]
    a, b = gaps(cable, k, END, basis_at(cable, u), x)
    return 0.5 * (law[STIFFNESS] * dot(a, a) + law[TURNING] * dot(b, b))


@kernel(void, CABLE, LINES, VECTOR, terms=SLIDING)
def slide_energy(cable, x, out):
    """Add U [J] of all slides to the energy of the springs."""
    for k in range(cable.slides.count):
        if cable.state.slide[k] != LOST:
            out[SPRING] += stored(cable, k, cable.state.slide[k], x)


@kernel(void, CABLE, boolean, LINES, LINES, float64, LINES, terms=SLIDING)
def slide_tangent(cable, slips, x0, x1, scale, band):
    """band += scale times minus the Jacobian of the forces of a step with respect to x1, at fixed
    u1; or with `slips` false, scale/2 times that of U.
    """
    dim, lines, half = cable.dim, cable.lines, 4 * cable.lines - 1
    for k in range(cable.slides.count):
        u0 = cable.state.slide[k]
        if u0 == LOST:
            continue
        law = cable.slides.law[k]
        u1 = cable.work.slid[k] if slips else u0
        _, _, t, _, _, _, _, end = response(cable, k, u0, u1, x0, x1)
        inverse = 1.0 / dot(t, t)
        along = 1.0 if slips else 0.0
        low, high = stops_of(cable, k)
        if u1 != u0 and low < u1 < high:  # the force along the cable is the friction
            along = -1.0
        for i in range(dim):
            for j in range(dim):
                value = along * component(t, i) * component(t, j) * inverse
                value = law[STIFFNESS] * (value + (1.0 if i == j else 0.0))
                turn = law[TURNING] if i == j else 0.0
                for p in range(4):
                    row = band[(end[0] + p) * lines + i]
                    for q in range(4):
                        both = value * end[1][p] * end[1][q] + turn * end[2][p] * end[2][q]
                        row[(q - p) * lines + j - i + half] += 0.5 * scale * both


# -- the grippers and the account ----------------------------------------------------------------


@kernel(void, CABLE, terms=SLIDING)
def move_slides(cable):
    """Move the grippers to where they are in `work.held`, at the end of the step."""
    for k in range(cable.slides.count):
        if moves(cable.inputs.motion[cable.slides.grasp[k]]):
            place_slide(cable, k)


@inline
def place_slide(cable, k):
    """The pose of a gripper in `work.held` becomes that at the end of the step."""
    held, pose = cable.work.held[cable.slides.grasp[k]], cable.state.slide_pose[k]
    for line in range(cable.dim):
        pose[END + line] = held[PLACE + cable.axes[line]]
        pose[END + 3 + line] = held[AIM + cable.axes[line]]


@inline
def settle_slides(cable, at, to):
    """The poses of the grippers at `at` become those at `to`."""
    for k in range(cable.slides.count):
        pose = cable.state.slide_pose[k]
        for entry in range(6):
            pose[to + entry] = pose[at + entry]


@kernel(void, CABLE, terms=SLIDING)
def jump_slides(cable):
    """Put the grippers to where they are in `work.held`, instantaneously."""
    for k in range(cable.slides.count):
        place_slide(cable, k)
    settle_slides(cable, END, START)


@inline
def pose_work(cable, k, a, b):
    """Work [J] of the gripper of slide k in a step with these mean gaps."""
    law, pose = cable.slides.law[k], cable.state.slide_pose[k]
    work = 0.0
    for line in range(cable.dim):
        moved, turned = pose[END + line] - pose[line], pose[END + 3 + line] - pose[3 + line]
        work -= law[STIFFNESS] * component(a, line) * moved
        work -= law[TURNING] * component(b, line) * turned
    return work


@kernel(void, CABLE, LINES, LINES, terms=SLIDING)
def accept_slides(cable, x0, x1):
    """The step from x0 to x1 was made: count the work of the grippers, and keep what has slid. A
    cable whose end has passed its gripper has slipped out.
    """
    balance, length = cable.state.balance, cable.slides.breaks[cable.n - 3]
    for k in range(cable.slides.count):
        u0, u1 = cable.state.slide[k], cable.work.slid[k]
        if u0 == LOST:
            continue
        a, b, _, _, _, _, _, _ = response(cable, k, u0, u1, x0, x1)
        balance.drive_work += pose_work(cable, k, a, b)
        cable.state.slide[k] = u1
        if not 0.0 < u1 < length:
            balance.dissipated += stored(cable, k, u1, x1)
            cable.state.slide[k] = LOST
    settle_slides(cable, END, START)
