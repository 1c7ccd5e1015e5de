"""Twist relative to the Bishop frame, assembled: strain theta' + tau (`terms.bishop`).

Within a step, the frame to which theta refers rotates with each tangent by the smallest rotation
from its direction at the end of the last step (REFERENCE), and so has a twist rate tau along the
cable. At the end of the step `follow_shape` makes the frame rotation-minimising again: theta += psi
with the spline psi whose derivative fits tau best (least squares), corrected to the exact integral
of tau at the end of the cable (`frame_turned`). The rest of tau is a discretisation error, which
would accumulate with every turn of the cable; it is dropped, and its energy counts as dissipated.

The angle that a gripper prescribes refers to a frame that follows the tangent directly from its
direction at the start of the motion. FRAME_TURN is the lag of theta's frame behind that one: the
psi added so far, minus the area on the unit sphere between the two paths of the tangent. It is
known at the end of a step, so this part of the angle of a moving clamp is one step late.
"""

from __future__ import annotations

import numpy as np

from dlo_sim.compiling.lanes import LANES, first, load, root, shifted, store, zero
from dlo_sim.compiling.pieces import part, piece
from dlo_sim.engine import layout
from dlo_sim.engine.elastic import (
    add_sample,
    bending_at,
    block_of,
    coefficients,
    curve,
    sample_of,
    scatter,
    scatter_lines,
    store_three,
    tangent_at,
    three,
)
from dlo_sim.engine.grasps import DIRECTION, MOTION_SIZE, framed
from dlo_sim.engine.lines import gathered
from dlo_sim.engine.natural_curvature import follow_natural, rest_twist_at
from dlo_sim.engine.springs import rolls, spring_value
from dlo_sim.engine.tables import (
    grasp_of,
    line_of,
    own_of,
    point_of,
    spring_first,
    spring_grasp,
)
from dlo_sim.engine.term import ENERGY, FLOW, FORCE, Term, add_energy
from dlo_sim.engine.torsion import angle_block
from dlo_sim.terms import bishop

COUPLING_ROWS = layout.COUPLING_ROWS


@part
def polynomial(a, xi):
    """a0 + a1 xi + a2 xi^2."""
    return a[0] + xi * (a[1] + xi * a[2])


@part
def add_polynomial(a, f, xi):
    """a + f (1, xi, xi^2)."""
    return a[0] + f, a[1] + xi * f, a[2] + xi * xi * f


@part
def turn_by_shape(shape, model, state, x0, x1, viscous, discrete, rows, out):
    """out -= the part on theta of the discrete gradient, between x0 and x1, of the twisting energy
    that depends on tau; `push_by_twist` adds the part on the centreline.

    Args:
        viscous: beta / tau [-], 0 without damping. discrete: if false, x0 is x1.
        rows: for `push_by_twist`, COUPLING_ROWS of every sample: mean rate [rad/m], its change, G.
    """
    stiffness = load(model, shape[layout.SCALES] + layout.STIFFNESS_GJ * LANES)
    reference = shifted(state, shape[layout.REFERENCE])
    for b in range(shape[layout.BLOCKS]):
        block = block_of(shape, b)
        s = load(model, block + layout.SLOPE * LANES)
        r = curve(shape, model, reference, b, 1.0)
        p, q = curve(shape, model, x0, b, 1.0), curve(shape, model, x1, b, 1.0)
        turned = (zero(), zero(), zero())
        for j in range(shape[layout.SAMPLES]):
            at = sample_of(block, j)
            xi = load(model, at + layout.XI * LANES)
            w = stiffness * load(model, at + layout.QUADRATURE * LANES)
            t, k = tangent_at(r, xi), bending_at(r, xi, s)
            t0, k0 = tangent_at(p, xi), bending_at(p, xi, s)
            t1, k1 = tangent_at(q, xi), bending_at(q, xi, s)
            after, change = bishop.change(t, k, t1, k1), zero()
            rate = after - rest_twist_at(shape, state, b, j)
            if discrete:
                change = after - bishop.change(t, k, t0, k0)
                rate -= 0.5 * change
            turned = add_polynomial(turned, w * (rate + viscous * change), xi)
            row = (b * shape[layout.SAMPLES] + j) * COUPLING_ROWS * LANES
            store(rows, row, rate)
            store(rows, row + LANES, change)
            store_three(rows, row + 2 * LANES, bishop.mean_gradient(t0, k0, t1, k1))
        at = shape[layout.DIM] * shape[layout.LINE] + layout.MARGIN + LANES * b
        scatter(turned, at, 1, model, block, -1.0, out)


@part
def push_by_twist(shape, model, x0, x1, viscous, rows, out):
    """out -= the part on the centreline (`turn_by_shape`, which wrote `rows`), for the twist lines
    of x0 and x1. Returns the energy [J] dissipated beyond that of theta alone, as partial sums.
    """
    stiffness = load(model, shape[layout.SCALES] + layout.STIFFNESS_GJ * LANES)
    taken = zero()
    for b in range(shape[layout.BLOCKS]):
        block = block_of(shape, b)
        angle0, angle1 = angle_block(shape, model, x0, b), angle_block(shape, model, x1, b)
        g0 = g1 = g2 = (zero(), zero(), zero())
        for j in range(shape[layout.SAMPLES]):
            at = sample_of(block, j)
            xi = load(model, at + layout.XI * LANES)
            w = stiffness * load(model, at + layout.QUADRATURE * LANES)
            row = (b * shape[layout.SAMPLES] + j) * COUPLING_ROWS * LANES
            rate, change, g = load(rows, row), load(rows, row + LANES), three(rows, row + 2 * LANES)
            theta0, theta1 = polynomial(angle0, xi), polynomial(angle1, xi)
            own = theta1 - theta0
            stress = w * (rate + 0.5 * (theta0 + theta1) + viscous * (change + own))
            taken += w * viscous * change * (change + 2.0 * own)
            g0 = add_sample(g0, stress * g[0], zero(), xi)
            g1 = add_sample(g1, stress * g[1], zero(), xi)
            g2 = add_sample(g2, stress * g[2], zero(), xi)
        scatter_lines(shape, model, b, g0, g1, g2, -1.0, out)
    return taken


@piece(*FORCE)
def force(shape, model, state, _, x, out):
    """out -= gradient of the twisting energy that depends on tau; within an implicit step
    `methods.twist_step` does that.
    """
    stiffness = load(model, shape[layout.SCALES] + layout.STIFFNESS_GJ * LANES)
    reference = shifted(state, shape[layout.REFERENCE])
    for b in range(shape[layout.BLOCKS]):
        block = block_of(shape, b)
        s = load(model, block + layout.SLOPE * LANES)
        r, p = curve(shape, model, reference, b, 1.0), curve(shape, model, x, b, 1.0)
        angle = angle_block(shape, model, x, b)
        g0 = g1 = g2 = turned = (zero(), zero(), zero())
        for j in range(shape[layout.SAMPLES]):
            at = sample_of(block, j)
            xi = load(model, at + layout.XI * LANES)
            w = stiffness * load(model, at + layout.QUADRATURE * LANES)
            t, k = tangent_at(p, xi), bending_at(p, xi, s)
            rate = bishop.change(tangent_at(r, xi), bending_at(r, xi, s), t, k)
            rate -= rest_twist_at(shape, state, b, j)
            turned = add_polynomial(turned, w * rate, xi)
            stress, g = w * (rate + polynomial(angle, xi)), bishop.mean_gradient(t, k, t, k)
            g0 = add_sample(g0, stress * g[0], zero(), xi)
            g1 = add_sample(g1, stress * g[1], zero(), xi)
            g2 = add_sample(g2, stress * g[2], zero(), xi)
        scatter_lines(shape, model, b, g0, g1, g2, -1.0, out)
        at = shape[layout.DIM] * shape[layout.LINE] + layout.MARGIN + LANES * b
        scatter(turned, at, 1, model, block, -1.0, out)


@piece(*ENERGY)
def energy(shape, model, state, x, out):
    """Add the part of the twisting energy that depends on tau [J]."""
    stiffness = load(model, shape[layout.SCALES] + layout.STIFFNESS_GJ * LANES)
    sum_, reference = zero(), shifted(state, shape[layout.REFERENCE])
    for b in range(shape[layout.BLOCKS]):
        block = block_of(shape, b)
        s = load(model, block + layout.SLOPE * LANES)
        r, p = curve(shape, model, reference, b, 1.0), curve(shape, model, x, b, 1.0)
        angle = angle_block(shape, model, x, b)
        for j in range(shape[layout.SAMPLES]):
            at = sample_of(block, j)
            xi = load(model, at + layout.XI * LANES)
            rate = bishop.change(
                tangent_at(r, xi), bending_at(r, xi, s), tangent_at(p, xi), bending_at(p, xi, s)
            )
            rate -= rest_twist_at(shape, state, b, j)
            w = stiffness * load(model, at + layout.QUADRATURE * LANES)
            sum_ += w * rate * (0.5 * rate + polynomial(angle, xi))
    add_energy(shape, sum_, layout.TWISTING, out)


@part
def add_rates(shape, model, state, x, rates, out):
    """Write tau to the rows `rates`, one per sample; out += integral b' tau du, on the twist."""
    reference = shifted(state, shape[layout.REFERENCE])
    for b in range(shape[layout.BLOCKS]):
        block = block_of(shape, b)
        s = load(model, block + layout.SLOPE * LANES)
        r, p = curve(shape, model, reference, b, 1.0), curve(shape, model, x, b, 1.0)
        turned = (zero(), zero(), zero())
        for j in range(shape[layout.SAMPLES]):
            at = sample_of(block, j)
            xi, w = load(model, at + layout.XI * LANES), load(model, at + layout.QUADRATURE * LANES)
            rate = bishop.change(
                tangent_at(r, xi), bending_at(r, xi, s), tangent_at(p, xi), bending_at(p, xi, s)
            )
            store(rates, (b * shape[layout.SAMPLES] + j) * LANES, rate)
            turned = add_polynomial(turned, w * rate, xi)
        scatter(turned, layout.MARGIN + LANES * b, 1, model, block, 1.0, out)


@part
def squares_lost(shape, model, state, x, rates, psi):
    """Integral of (theta' + tau - rest)^2 - (theta' + psi' - rest)^2, as partial sums."""
    sum_ = zero()
    for b in range(shape[layout.BLOCKS]):
        block = block_of(shape, b)
        angle = angle_block(shape, model, x, b)
        own = coefficients(psi, layout.MARGIN + LANES * b, 1, model, block)
        for j in range(shape[layout.SAMPLES]):
            at = sample_of(block, j)
            xi, w = load(model, at + layout.XI * LANES), load(model, at + layout.QUADRATURE * LANES)
            old = load(rates, (b * shape[layout.SAMPLES] + j) * LANES)
            new = polynomial(own, xi)
            theta = polynomial(angle, xi) - rest_twist_at(shape, state, b, j)
            sum_ += w * (old - new) * (2.0 * theta + old + new)
    return sum_


@part
def solve_line(shape, model, factors, x):
    """Solve in place on one line with the factors at offset `factors` of the model."""
    n, width = shape[layout.N], shape[layout.LINE]
    for k in range(layout.MARGIN, n + layout.MARGIN):
        f = factors + k
        x[k] -= model[f] * x[k - 3] + model[f + width] * x[k - 2]
        x[k] -= model[f + 2 * width] * x[k - 1]
    for k in range(n + layout.MARGIN - 1, layout.MARGIN - 1, -1):
        f = factors + k
        x[k] = x[k] * model[f + 3 * width] - model[f + 6 * width] * x[k + 3]
        x[k] -= model[f + 5 * width] * x[k + 2] + model[f + 4 * width] * x[k + 1]


@part
def edge(shape, x, own):
    """Unit tangent at the end of the cable with control point `own`."""
    width, at = shape[layout.LINE], layout.MARGIN + max(own, 1)
    v0, v1 = x[at] - x[at - 1], x[at + width] - x[at + width - 1]
    v2 = 0.0
    if shape[layout.DIM] == 3:
        v2 = x[at + 2 * width] - x[at + 2 * width - 1]
    inverse = 1.0 / np.sqrt(v0 * v0 + v1 * v1 + v2 * v2)
    return inverse * v0, inverse * v1, inverse * v2


@part
def half_area(a, b, c):
    """Cosine and sine, times a common factor, of half the signed area of the spherical triangle of
    unit vectors a, b, c. A frame transported a -> b -> c by the smallest rotations leads one
    transported a -> c by this area.
    """
    triple = a[0] * (b[1] * c[2] - b[2] * c[1]) + a[1] * (b[2] * c[0] - b[0] * c[2])
    triple += a[2] * (b[0] * c[1] - b[1] * c[0])
    sides = a[0] * b[0] + a[1] * b[1] + a[2] * b[2] + b[0] * c[0] + b[1] * c[1] + b[2] * c[2]
    return 1.0 + sides + c[0] * a[0] + c[1] * a[1] + c[2] * a[2], triple


@part
def area(a, b, c):
    """Signed area of the spherical triangle of unit vectors a, b, c."""
    cosine, sine = half_area(a, b, c)
    return 2.0 * np.arctan2(sine, cosine)


@part
def span_tangent(shape, model, x, span, xi):
    """Unit tangent of one span at a local coordinate."""
    row, width = block_of(shape, span // LANES) + span % LANES, shape[layout.LINE]
    t0 = t1 = t2 = 0.0
    for k in range(4):
        b = model[row + 3 * k * LANES] + xi * model[row + (3 * k + 1) * LANES]
        b += xi * xi * model[row + (3 * k + 2) * LANES]
        at = layout.MARGIN + span + k
        t0 += b * x[at]
        t1 += b * x[at + width]
        if shape[layout.DIM] == 3:
            t2 += b * x[at + 2 * width]
    inverse = 1.0 / np.sqrt(t0 * t0 + t1 * t1 + t2 * t2)
    return inverse * t0, inverse * t1, inverse * t2


@part
def turn_by_arcs(shape, model, reference, x, last, end, arcs, guess):
    """Integral of tau up to the local coordinate `end` of span `last`: the angle by which the frame
    carried along in time leads the one transported along the cable.

    It is the area between the old and the new tangent curve on the unit sphere, summed over
    spherical triangles with `arcs` chords per span; the chord error depends on the shapes alone and
    does not accumulate. The area is known up to multiples of two turns; of these values the one
    closest to `guess` is returned.
    """
    cosine, sine = 1.0, 0.0
    old = span_tangent(shape, model, reference, 0, -1.0)
    new = span_tangent(shape, model, x, 0, -1.0)
    for arc in range(arcs * (last + 1)):
        older, newer = old, new
        span = arc // arcs
        length = end + 1.0 if span == last else 2.0
        xi = length * (arc % arcs + 1) / arcs - 1.0
        old = span_tangent(shape, model, reference, span, xi)
        new = span_tangent(shape, model, x, span, xi)
        c, s = half_area(older, old, new)
        d, t = half_area(older, newer, new)
        c, s = c * d + s * t, s * d - c * t
        scale = 1.0 / np.sqrt(c * c + s * s)
        cosine, sine = scale * (cosine * c - sine * s), scale * (cosine * s + sine * c)
    turned = 2.0 * np.arctan2(sine, cosine)
    return turned + 4.0 * np.pi * np.floor((guess - turned) / (4.0 * np.pi) + 0.5)


@part
def frame_turned(shape, model, reference, x, span, xi, guess):
    """Integral of tau: Richardson extrapolation of `turn_by_arcs`, whose error is second order."""
    coarse = turn_by_arcs(shape, model, reference, x, span, xi, 1, guess)
    return (4.0 * turn_by_arcs(shape, model, reference, x, span, xi, 2, guess) - coarse) / 3.0


@part
def unit_at(p, xi):
    """Unit tangents of the spans of a block at a local coordinate."""
    t = tangent_at(p, xi)
    inverse = 1.0 / root(t[0] * t[0] + t[1] * t[1] + t[2] * t[2])
    return inverse * t[0], inverse * t[1], inverse * t[2]


@part
def strip(a, b, c, d):
    """Cosine and sine of half the area between the chords a -> b (old) and c -> d (new)."""
    c0, s0 = half_area(a, b, d)
    c1, s1 = half_area(a, c, d)
    cosine, sine = c0 * c1 + s0 * s1, s0 * c1 - c0 * s1
    scale = 1.0 / root(cosine * cosine + sine * sine)
    return scale * cosine, scale * sine


@part
def joined(a, b):
    """Cosine and sine of the sum of two angles given by theirs."""
    return a[0] * b[0] - a[1] * b[1], a[0] * b[1] + a[1] * b[0]


@part
def angle_of(spare, part, guess):
    """Twice the sum of the angles whose cosines and sines the lanes of `part` have, up to multiples
    of two turns: the value closest to `guess`. `spare`: room of two rows.
    """
    store(spare, 0, part[0])
    store(spare, LANES, part[1])
    whole = (1.0, 0.0)
    for lane in range(LANES):
        whole = joined(whole, (spare[lane], spare[LANES + lane]))
    turned = 2.0 * np.arctan2(whole[1], whole[0])
    return turned + 4.0 * np.pi * np.floor((guess - turned) / (4.0 * np.pi) + 0.5)


@part
def cable_turned(shape, model, reference, x, guess, spare):
    """`frame_turned` up to the end of the cable, eight spans at a time."""
    coarse = fine = (zero() + 1.0, zero())
    for b in range(shape[layout.BLOCKS]):
        p, q = curve(shape, model, reference, b, 1.0), curve(shape, model, x, b, 1.0)
        begin, middle, end = unit_at(p, -1.0), unit_at(p, 0.0), unit_at(p, 1.0)
        begin1, middle1, end1 = unit_at(q, -1.0), unit_at(q, 0.0), unit_at(q, 1.0)
        coarse = joined(coarse, strip(begin, end, begin1, end1))
        fine = joined(fine, strip(begin, middle, begin1, middle1))
        fine = joined(fine, strip(middle, end, middle1, end1))
    least = angle_of(spare, coarse, guess)
    return (4.0 * angle_of(spare, fine, guess) - least) / 3.0


@part
def follow_springs(shape, model, inputs, state, psi, x):
    """Transform the anchors of the roll springs to the new frame of theta. The change of spring
    energy, by the error of psi and by the path of the tangent, counts as work of the grasp.
    """
    reference, ledger = shifted(state, shape[layout.REFERENCE]), shape[layout.LEDGER]
    for k in range(shape[layout.SPRINGS]):
        if rolls(shape, k):
            grasp, span = spring_grasp(shape, k), spring_first(shape, k)
            m = shape[layout.MOTION] + MOTION_SIZE * grasp
            d, share = m + DIRECTION, 0.0
            row = shape[layout.SPRING] + layout.SPRING_ROWS * k * LANES
            xi = model[row + 6 * LANES]
            begin = framed(inputs, m, inputs[d], inputs[d + 1], inputs[d + 2])
            old = span_tangent(shape, model, reference, span, xi)
            turned = area(begin, old, span_tangent(shape, model, x, span, xi))
            for q in range(4):
                share += model[row + q * LANES] * psi[layout.MARGIN + span + q]
            moved = frame_turned(shape, model, reference, x, span, xi, share) - turned
            value = first(spring_value(shape, model, k, x))
            anchor = state[shape[layout.ANCHOR] + k * LANES]
            before, after = anchor - (value - share), anchor + moved - value
            work = 0.5 * model[row + 4 * LANES] * (after - before) * (after + before)
            state[ledger + layout.DRIVE_WORK * LANES] += work
            state[shape[layout.FRAME_TURN] + grasp * LANES] += moved
            state[shape[layout.ANCHOR] + k * LANES] += moved
            state[shape[layout.ANCHOR_BOOKED] + k * LANES] += moved


@piece(*FLOW)
def follow_shape(shape, model, inputs, state, scratch):
    """Transform theta and the angles of the grasps to the Bishop frame of the present shape."""
    n, line = shape[layout.N], shape[layout.DIM] * shape[layout.LINE]
    x, reference = shifted(state, shape[layout.X]), shifted(state, shape[layout.REFERENCE])
    booked, psi = shifted(state, shape[layout.BOOKED]), shifted(scratch, shape[layout.FRAME_SPARE])
    for at in range(shape[layout.LINE]):
        psi[at] = 0.0
    rates = shifted(psi, shape[layout.LINE])
    if shape[layout.TERMS] & layout.MATERIAL:
        follow_natural(shape, model, state, x)
    add_rates(shape, model, state, x, rates, psi)
    psi[layout.MARGIN] = 0.0
    solve_line(shape, model, shape[layout.FRAME_FACTORS], psi)
    last = psi[layout.MARGIN + n - 1]
    spare = shifted(rates, shape[layout.BLOCKS] * shape[layout.SAMPLES] * LANES)
    missing = cable_turned(shape, model, reference, x, last, spare) - last
    shares = shape[layout.FRAME_FACTORS] + 7 * shape[layout.LINE]
    for at in range(layout.MARGIN, layout.MARGIN + n):
        psi[at] += model[shares + at] * missing
    lost = gathered(shape, squares_lost(shape, model, state, x, rates, psi))
    stiffness = load(model, shape[layout.SCALES] + layout.STIFFNESS_GJ * LANES)
    at = shape[layout.LEDGER] + layout.DISSIPATED * LANES
    store(state, at, load(state, at) + 0.5 * stiffness * lost)
    for at in range(layout.MARGIN, layout.MARGIN + n):
        x[line + at] += psi[at]
        booked[line + at] += psi[at]
    for k in range(shape[layout.HELD]):
        if line_of(shape, k) == shape[layout.DIM]:
            own, grasp = own_of(shape, point_of(shape, k)), grasp_of(shape, k)
            m = shape[layout.MOTION] + MOTION_SIZE * grasp + DIRECTION
            begin = framed(inputs, m - DIRECTION, inputs[m], inputs[m + 1], inputs[m + 2])
            turned = area(begin, edge(shape, reference, own), edge(shape, x, own))
            at = shape[layout.FRAME_TURN] + grasp * LANES
            store(state, at, load(state, at) + (psi[layout.MARGIN + own] - turned))
    follow_springs(shape, model, inputs, state, psi, x)
    for at in range(0, shape[layout.SIZE], LANES):
        store(reference, at, load(x, at))


TERM = Term(layout.BISHOP, force=force, energy=energy, flow=follow_shape)
