"""Twist relative to a rotation-minimising (Bishop) frame: its coupling to the centreline.

Frames along the cable that follow the unit tangent T in time by the smallest rotations have a twist
rate tau(u) [rad/m] along it, which changes between two shapes by
    (t1 x t0) . (k0 / s0 + k1 / s1) / (s0 s1 + t0 . t1),   s = |r'|,
exactly if T turns by less than half a turn. With the angle theta from that frame to the material
frame, the twist is theta' + tau and its energy GJ/2 (theta' + tau)^2. The change of tau equals
(t1 - t0) . G, so the twisting moment M acts on r' as M G; for equal shapes G is the binormal
curvature t x k / s^3.

theta is an angle in frames that move with the cable, so tau has no derivative by r'': the coupling
does no work except that of the moments at the ends (Bergou et al. 2008, ACM Trans. Graph. 27 (3),
63; Langer & Singer 1996, SIAM Review 38, 605-618).

Within a step, the frame to which theta refers rotates with each tangent by the smallest rotation
from its direction at the end of the last step (`state.reference`), and so has a twist rate tau
along the cable. At the end of the step `follow_shape` makes the frame rotation-minimising again:
theta += psi with the spline psi whose derivative fits tau best (least squares), corrected to the
exact integral of tau at the end of the cable (`strand_turned`). The rest of tau is a discretisation
error, which would accumulate with every turn of the cable; it is dropped, and its energy counts as
dissipated. All of this goes along each strand from its own start.

The angle that a gripper prescribes counts in the same frame (`engine.grasps`): the tangent at a
clamp at the end of a step is the gripper's direction, so it is known within the step. A roll spring
sees the tangent of the cable at the start of the step.
"""

from __future__ import annotations

import numpy as np
from numba import boolean, float64, void

from dlo_sim.compiling.kernels import YES, inline, kernel
from dlo_sim.compiling.lanes import LANES, lane, lane_sum, sqrt, where, zero
from dlo_sim.engine import roll
from dlo_sim.engine.arrays import (
    BISHOP,
    CABLE,
    IMPLICIT,
    LINES,
    MARGIN,
    MATERIAL,
    SPRUNG,
    TWISTING,
    VECTOR,
)
from dlo_sim.engine.grasps import (
    ANGLE,
    angle_about,
    carried,
    count_from,
    director_at,
    nearest,
    rotation_at,
)
from dlo_sim.engine.lines import copy, solve_line
from dlo_sim.engine.natural_curvature import follow_natural, rest_twist_at
from dlo_sim.engine.spans import (
    add_sample,
    belongs,
    bending_at,
    blocks_of,
    coefficients,
    curve,
    scatter,
    scatter_lines,
    tangent_at,
    twist_rate,
)
from dlo_sim.engine.springs import rolls, spring_value
from dlo_sim.engine.term import ENERGY, FORCE
from dlo_sim.terms.material_frame import unit
from dlo_sim.terms.vectors import combined, cross, dot


@inline
def tau_between(t0, k0, t1, k1):
    """Change of tau [rad/m] from shape 0 to shape 1, and G, such that the twisting moment M acts on
    r' as M G. Two square roots and one division take most of the time.
    """
    s0, s1 = sqrt(dot(t0, t0)), sqrt(dot(t1, t1))
    both = s0 * s1
    v, share = combined(s1, k0, s0, k1), 1.0 / (both * (both + dot(t0, t1)))
    half = 0.5 * share
    return share * dot(cross(t1, t0), v), cross(combined(half, t0, half, t1), v)


@inline
def polynomial(a, xi):
    """a0 + a1 xi + a2 xi^2."""
    return a[0] + xi * (a[1] + xi * a[2])


@inline
def add_polynomial(a, f, xi):
    """a + f (1, xi, xi^2)."""
    return a[0] + f, a[1] + xi * f, a[2] + xi * xi * f


@inline
def tau_at(r, p, xi, s):
    """tau [rad/m] at a quadrature point of curve p, for theta's frame that follows from curve r."""
    t, k = tangent_at(r, xi), bending_at(r, xi, s)
    return tau_between(t, k, tangent_at(p, xi), bending_at(p, xi, s))[0]


@kernel(float64, CABLE, LINES, LINES, float64, boolean, LINES, terms=BISHOP, family=IMPLICIT)
def step_force(cable, x0, x1, viscous, discrete, out):
    """out -= discrete gradient of the twisting energy between the start x0 of a step and x1, or, if
    not `discrete`, gradient in the middle of the step, with the shape x1 there and the twist at its
    end in the state; and the forces of internal damping. `viscous`: beta / tau [-].

    Writes the twisting moment, times the weights, to `work.moment`. Returns the energy dissipated.
    """
    mesh, end, lost = cable.mesh, cable.state.x, zero()
    for b in range(cable.blocks):
        s = mesh.slope[b]
        p, q = curve(cable, x0, b, 1.0), curve(cable, x1, b, 1.0)
        angle0, angle1 = twist_rate(cable, x0, b), twist_rate(cable, end, b)
        g0 = g1 = g2 = turned = (zero(), zero(), zero())
        for j in range(cable.samples):
            xi, w = mesh.xi[b, j], mesh.torsional[b] * mesh.weight[b, j]
            t0, k0 = tangent_at(p, xi), bending_at(p, xi, s)
            t1, k1 = tangent_at(q, xi), bending_at(q, xi, s)
            change, gradient = tau_between(t0, k0, t1, k1)
            rate = 0.5 * change
            if not discrete:  # x1 is the middle
                rate, change = change, 2.0 * change
                gradient = tau_between(t1, k1, t1, k1)[1]
            theta0, theta1 = polynomial(angle0, xi), polynomial(angle1, xi)
            change += theta1 - theta0
            rate += 0.5 * (theta0 + theta1) - rest_twist_at(cable, b, j)
            moment = w * (rate + viscous * change)
            cable.work.moment[b, j] = moment
            lost += w * viscous * change * change
            turned = add_polynomial(turned, moment, xi)
            g0 = add_sample(g0, moment * gradient[0], zero(), xi)
            g1 = add_sample(g1, moment * gradient[1], zero(), xi)
            g2 = add_sample(g2, moment * gradient[2], zero(), xi)
        scatter_lines(cable, b, g0, g1, g2, -1.0, out)
        scatter(mesh, b, turned, -1.0, out[cable.dim])
    return lane_sum(lost)


@kernel(*FORCE, terms=BISHOP)
def force(cable, _, x, out):
    """out -= gradient of the twisting energy at rest, with the moment as of `step_force`."""
    mesh = cable.mesh
    for b in range(cable.blocks):
        s, angle = mesh.slope[b], twist_rate(cable, x, b)
        r, p = curve(cable, cable.state.reference, b, 1.0), curve(cable, x, b, 1.0)
        g0 = g1 = g2 = turned = (zero(), zero(), zero())
        for j in range(cable.samples):
            xi, w = mesh.xi[b, j], mesh.torsional[b] * mesh.weight[b, j]
            t, k = tangent_at(p, xi), bending_at(p, xi, s)
            rate = tau_at(r, p, xi, s) - rest_twist_at(cable, b, j)
            moment, g = w * (rate + polynomial(angle, xi)), tau_between(t, k, t, k)[1]
            cable.work.moment[b, j] = moment
            turned = add_polynomial(turned, moment, xi)
            g0 = add_sample(g0, moment * g[0], zero(), xi)
            g1 = add_sample(g1, moment * g[1], zero(), xi)
            g2 = add_sample(g2, moment * g[2], zero(), xi)
        scatter_lines(cable, b, g0, g1, g2, -1.0, out)
        scatter(mesh, b, turned, -1.0, out[cable.dim])


@kernel(*ENERGY, terms=BISHOP)
def energy(cable, x, out):
    """Add the twisting energy [J]."""
    mesh, sum_ = cable.mesh, zero()
    for b in range(cable.blocks):
        s, angle = mesh.slope[b], twist_rate(cable, x, b)
        r, p = curve(cable, cable.state.reference, b, 1.0), curve(cable, x, b, 1.0)
        for j in range(cable.samples):
            xi, w = mesh.xi[b, j], mesh.torsional[b] * mesh.weight[b, j]
            rate = tau_at(r, p, xi, s) - rest_twist_at(cable, b, j)
            rate += polynomial(angle, xi)
            sum_ += 0.5 * w * rate * rate
    out[TWISTING] += lane_sum(sum_)


@inline
def squares_lost(cable, x, rates, psi):
    """Integral of (theta' + tau - rest)^2 - (theta' + psi' - rest)^2 [1/m], tau from `rates`, with
    the torsional stiffness in that of the first strand.
    """
    mesh, sum_ = cable.mesh, zero()
    for b in range(cable.blocks):
        angle, own = twist_rate(cable, x, b), coefficients(mesh, b, psi)
        share = mesh.torsional[b] / cable.physics.GJ
        for j in range(cable.samples):
            xi = mesh.xi[b, j]
            old, new = rates[b, j], polynomial(own, xi)
            theta = polynomial(angle, xi) - rest_twist_at(cable, b, j)
            sum_ += share * mesh.weight[b, j] * (old - new) * (2.0 * theta + old + new)
    return lane_sum(sum_)


@inline
def span_tangent(cable, x, span, xi):
    """Unit tangent of one span at a local coordinate."""
    b, own = span // LANES, span % LANES
    t0 = t1 = t2 = 0.0
    for k in range(4):
        slopes, at = cable.mesh.slopes[b], MARGIN + span + k
        slope = lane(slopes[3 * k], own) + xi * lane(slopes[3 * k + 1], own)
        slope += xi * xi * lane(slopes[3 * k + 2], own)
        t0 += slope * x[0, at]
        t1 += slope * x[1, at]
        if cable.dim == 3:
            t2 += slope * x[2, at]
    inverse = 1.0 / np.sqrt(t0 * t0 + t1 * t1 + t2 * t2)
    return inverse * t0, inverse * t1, inverse * t2


@inline
def half_area(a, b, c):
    """Cosine and sine, times a common factor, of half the signed area of the spherical triangle of
    unit vectors a, b, c. A frame transported a -> b -> c by the smallest rotations leads one
    transported a -> c by this area.
    """
    return 1.0 + dot(a, b) + dot(b, c) + dot(c, a), dot(a, cross(b, c))


@inline
def joined(a, b):
    """Cosine and sine of the sum of two angles given by theirs."""
    return a[0] * b[0] - a[1] * b[1], a[0] * b[1] + a[1] * b[0]


@inline
def twice_angle(whole, guess):
    """Twice the angle with cosine and sine `whole`, up to multiples of two turns: the value closest
    to `guess`.
    """
    turned = 2.0 * np.arctan2(whole[1], whole[0])
    return turned + 4.0 * np.pi * np.floor((guess - turned) / (4.0 * np.pi) + 0.5)


@inline
def turn_by_arcs(cable, x, m, r, last, end, arcs, guess):
    """Integral of tau up to the local coordinate `end` of span `last` from the start of its strand:
    the angle by which the director of the grasp (`director_at`), transported along the strand and
    then in time, leads that transported in time and then along it, with `arcs` chords per span.

    The chord error depends on the shapes alone and does not accumulate. Of the angle, known up to
    whole turns, the value closest to `guess` is returned.
    """
    reference, first = cable.state.reference, cable.mesh.strand[cable.mesh.branch[last], 0]
    old, new = span_tangent(cable, reference, first, -1.0), span_tangent(cable, x, first, -1.0)
    before = director_at(m, r, old)
    after = carried(old, new, before)
    for arc in range(arcs * (last + 1 - first)):
        older, newer = old, new
        span = first + arc // arcs
        length = end + 1.0 if span == last else 2.0
        xi = length * (arc % arcs + 1) / arcs - 1.0
        old, new = span_tangent(cable, reference, span, xi), span_tangent(cable, x, span, xi)
        before, after = carried(older, old, before), carried(newer, new, after)
    return nearest(angle_about(new, after, carried(old, new, before)), guess)


@inline
def strip(a, b, c, d):
    """Cosine and sine of half the area between the chords a -> b (old) and c -> d (new)."""
    c0, s0 = half_area(a, b, d)
    c1, s1 = half_area(a, c, d)
    cosine, sine = c0 * c1 + s0 * s1, s0 * c1 - c0 * s1
    scale = 1.0 / sqrt(cosine * cosine + sine * sine)
    return scale * cosine, scale * sine


@inline
def only(here, turn):
    """Cosine and sine of an angle where `here` is above 0, else of none."""
    return where(here, turn[0], 1.0), where(here, turn[1], 0.0)


@inline
def angle_of(strips, guess):
    """Twice the sum of the angles whose cosines and sines are in the lanes of `strips`, as
    `twice_angle`.
    """
    whole = (1.0, 0.0)
    for k in range(LANES):
        whole = joined(whole, (lane(strips[0], k), lane(strips[1], k)))
    return twice_angle(whole, guess)


@inline
def strand_turned(cable, number, x, guess):
    """Integral of tau up to the end of a strand, as `turn_by_arcs`, eight spans at a time:
    Richardson extrapolation of one and of two chords per span.
    """
    coarse = fine = (zero() + 1.0, zero())
    begin, end = blocks_of(cable, number)
    for b in range(begin, end):
        p, q = curve(cable, cable.state.reference, b, 1.0), curve(cable, x, b, 1.0)
        begin0, begin1 = unit(tangent_at(p, -1.0)), unit(tangent_at(q, -1.0))
        middle0, middle1 = unit(tangent_at(p, 0.0)), unit(tangent_at(q, 0.0))
        end0, end1 = unit(tangent_at(p, 1.0)), unit(tangent_at(q, 1.0))
        here = belongs(cable, b, number)
        coarse = joined(coarse, only(here, strip(begin0, end0, begin1, end1)))
        fine = joined(fine, only(here, strip(begin0, middle0, begin1, middle1)))
        fine = joined(fine, only(here, strip(middle0, end0, middle1, end1)))
    return (4.0 * angle_of(fine, guess) - angle_of(coarse, guess)) / 3.0


@kernel(void, CABLE, VECTOR, LINES, float64, terms=SPRUNG)
def follow_springs(cable, psi, x, t):
    """Transform the anchors of the roll springs to the new frame of theta. The change of spring
    energy, by the error of psi and by the path of the tangent, counts as work of the grasp.
    """
    rows, points, state = cable.rows, cable.points, cable.state
    for k in range(rows.count, rows.count + rows.springs):
        if rolls(cable, k) and rows.grasp[k] >= 0:
            grasp, point, xi = rows.grasp[k], rows.point[k], rows.xi[k]
            span = points.first[point]
            m, share = cable.inputs.motion[grasp], 0.0
            r, old = rotation_at(m, t), span_tangent(cable, state.reference, span, xi)
            new = span_tangent(cable, x, span, xi)
            for q in range(4):
                share += points.weights[point, q] * psi[MARGIN + span + q]
            # Richardson extrapolation, as the error of `turn_by_arcs` is of second order
            coarse = turn_by_arcs(cable, x, m, r, span, xi, 1, share)
            moved = (4.0 * turn_by_arcs(cable, x, m, r, span, xi, 2, share) - coarse) / 3.0
            turned = carried(old, new, director_at(m, r, old))
            moved += angle_about(new, turned, director_at(m, r, new))
            value = spring_value(cable, k, x)
            before = state.anchor[k] - (value - share)
            after = state.anchor[k] + moved - value
            work = 0.5 * rows.stiffness[k] * (after - before) * (after + before)
            state.balance.drive_work += work
            state.anchor[k] += moved
            state.anchor_counted[k] += moved
            count_from(m, state.frame[grasp], t, r, new, state.anchor[k])


@inline
def difference_at(cable, point, psi):
    """Difference of psi between the two places of a point between strands."""
    points, value = cable.points, 0.0
    for k in range(4):
        value += points.weights[point, k] * psi[MARGIN + points.first[point] + k]
        value += points.other_weights[point, k] * psi[MARGIN + points.other[point] + k]
    return value


@kernel(void, CABLE, float64, terms=BISHOP)
def follow_shape(cable, t):
    """Transform theta and the angles of the grasps to the Bishop frame of the present shape, at
    time t.
    """
    mesh, state, rows, n, twist = cable.mesh, cable.state, cable.rows, cable.n, cable.dim
    x, reference, psi, rates = state.x, state.reference, cable.work.psi, cable.work.tau
    for at in range(len(psi)):
        psi[at] = 0.0
    if cable.terms & MATERIAL:
        follow_natural(cable, x)
    for b in range(cable.blocks):
        s, r, p = mesh.slope[b], curve(cable, reference, b, 1.0), curve(cable, x, b, 1.0)
        turned = (zero(), zero(), zero())
        for j in range(cable.samples):
            xi = mesh.xi[b, j]
            rate = tau_at(r, p, xi, s)
            rates[b, j] = rate
            turned = add_polynomial(turned, mesh.weight[b, j] * rate, xi)
        scatter(mesh, b, turned, 1.0, psi)
    strands = len(mesh.strand)
    for number in range(strands):
        psi[MARGIN + mesh.strand[number, 0]] = 0.0
    solve_line(cable.linear.frame_factors, n, psi)
    for number in range(strands):
        begin, end = MARGIN + mesh.strand[number, 0], MARGIN + mesh.strand[number, 1]
        last = psi[end - 1]
        missing = strand_turned(cable, number, x, last) - last
        for at in range(begin, end):
            psi[at] += cable.linear.greville[at] * missing
    lost = squares_lost(cable, x, rates, psi)
    state.balance.dissipated += 0.5 * cable.physics.GJ * lost
    for at in range(MARGIN, MARGIN + n):
        x[twist, at] += psi[at]
        state.counted[twist, at] += psi[at]
        state.history[0, twist, at] += psi[at]
        state.history[1, twist, at] += psi[at]
    for k in range(rows.count + rows.springs):
        if rows.line[k] == twist and rows.grasp[k] < 0:
            turned = difference_at(cable, rows.point[k], psi)
            state.anchor[k] += turned
            state.anchor_counted[k] += turned
    for k in range(rows.count):
        if rows.line[k] == twist and rows.grasp[k] >= 0:
            state.frame[rows.grasp[k], ANGLE] += psi[MARGIN + cable.points.own[rows.point[k]]]
    follow_springs(cable, psi, x, t)
    roll.follow(cable, YES)
    copy(x, reference)
