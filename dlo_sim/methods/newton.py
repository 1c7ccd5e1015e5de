"""Iteration of an implicit step: predictor, Newton and Broyden corrections, their line search, and
a check of the solution.
"""

from __future__ import annotations

import numpy as np

from dlo_sim.compiling.lanes import LANES, shifted
from dlo_sim.compiling.pieces import NO, YES, part
from dlo_sim.engine import layout
from dlo_sim.engine.band import own_point, substitute, turn_vector
from dlo_sim.engine.border import keep_border
from dlo_sim.methods.implicit_layout import BALANCE, CORRECTIONS, STEP, residual_of

TRUSTED = 0.5  # largest s_last.z / |s_last|^2 in Broyden's denominator
SMALLEST = 1e-300  # lower bound on the square of a correction


@part
def parabola(tau, last, before):
    """Lagrange weights, at tau after the present, of the present configuration and the two before;
    `last` and `before` are the lengths of the last two steps.
    """
    both = last + before
    return (
        (tau + last) * (tau + both) / (last * both),
        -tau * (tau + both) / (last * before),
        tau * (tau + last) / (both * before),
    )


@part
def predict(shape, state, x, w, tau):
    """Predictor of the spatial lines: quadratic extrapolation of the last three configurations, or
    constant w if they are not known. If the motion alternates from step to step, as undamped stiff
    modes do in steps far too long for them, the configuration before the present one.

    Shifts the history by one configuration.
    """
    ledger, size = shape[layout.LEDGER], shape[layout.SIZE]
    near, far = shifted(state, shape[layout.HISTORY]), shifted(state, shape[layout.HISTORY] + size)
    known = state[ledger + layout.KNOWN * LANES] >= 2.0
    last, before_last = (
        state[ledger + layout.LENGTH * LANES],
        state[ledger + layout.LENGTH_BEFORE * LANES],
    )
    count = shape[layout.DIM] * shape[layout.LINE]
    back = False
    a = b = c = 0.0
    if known:
        once, twice = 0.0, 0.0
        for at in range(count):
            once += (x[at] - near[at]) ** 2
            twice += (x[at] - far[at]) ** 2
        back = tau == last == before_last and twice < once
        a, b, c = parabola(tau, last, before_last)
    for at in range(count):
        now, before = x[at], near[at]
        if back:
            x[at] = before
        elif known:
            x[at] = a * now + b * before + c * far[at]
        else:
            x[at] = now + tau * w[at]
        far[at] = before
        near[at] = now
    state[ledger + layout.LENGTH_BEFORE * LANES] = last
    state[ledger + layout.LENGTH * LANES] = tau


@part
def largest(shape, x):
    """Largest coordinate."""
    value = 0.0
    for at in range(shape[layout.DIM] * shape[layout.LINE]):
        value = max(value, abs(x[at]))
    return value


@part
def apply_step(shape, state, scratch, number, share, x, change):
    """x and `change` += share times correction `number`."""
    dim, n, width = shape[layout.DIM], shape[layout.N], shape[layout.LINE]
    step = shifted(scratch, shape[STEP])
    correction = shifted(scratch, shape[CORRECTIONS] + number * (n * dim + 1))
    for r in range(n * dim):
        step[r] = share * correction[r]
    turn_vector(shape, shifted(state, shape[layout.DIRECTION]), NO, step)
    for d in range(dim):
        at = d * width + layout.MARGIN
        for i in range(n):
            x[at + i] += step[i * dim + d]
            change[at + i] += step[i * dim + d]


@part
def correct(shape, state, scratch, known, x, change):
    """Solve for the next correction by Broyden's method and add it to x and `change`.

    With z = K^-1 r of the present residual r and the `known` corrections s_j since K was
    factorised, z += s_(j+1) (s_j.z) / |s_j|^2 for all but the last, then
    s = z / (1 - s_last.z / |s_last|^2) (Kelley 1995, section 7.3).

    Returns sum |r_i s_i|, |r.s|, the energy error sum |r_i change_i| [J] before this correction,
    and the largest entry of s.
    """
    dim, n, width = shape[layout.DIM], shape[layout.N], shape[layout.LINE]
    size = n * dim
    z, balance = residual_of(shape, scratch), shifted(scratch, shape[BALANCE])
    corrections = shifted(scratch, shape[CORRECTIONS])
    for r in range(size):
        balance[r] = z[r]
    substitute(shifted(state, shape[layout.MATRIX]), size, dim, z)
    keep_border(shape, scratch, z)
    for j in range(known):
        s = shifted(corrections, j * (size + 1))
        along = dot(s, z, size) * s[size]
        if j + 1 < known:
            following = shifted(corrections, (j + 1) * (size + 1))
            for r in range(size):
                z[r] += along * following[r]
        elif abs(along) < TRUSTED:
            for r in range(size):
                z[r] /= 1.0 - along
    s = shifted(corrections, known * (size + 1))
    energy, slope, largest_entry = 0.0, 0.0, 0.0
    for r in range(size):
        s[r] = z[r]
        energy += abs(z[r] * balance[r])
        slope += z[r] * balance[r]
        largest_entry = max(largest_entry, abs(z[r]))
    s[size] = 1.0 / max(dot(z, z, size), SMALLEST)
    apply_step(shape, state, scratch, known, 1.0, x, change)
    step, defect = shifted(scratch, shape[STEP]), 0.0
    for d in range(dim):
        at = d * width + layout.MARGIN
        for i in range(n):
            step[i * dim + d] = change[at + i]
    turn_vector(shape, shifted(state, shape[layout.DIRECTION]), YES, step)
    for r in range(size):
        defect += abs(step[r] * balance[r])
    return energy, abs(slope), defect, largest_entry


@part
def shortened(before, after):
    """Share of a correction at which the residual along it vanishes by the secant rule, limited."""
    share = before / (before - after)
    return min(max(share, 0.1), 0.5) if share > 0.0 and share < np.inf else 0.1


@part
def turned_over(shape, x, start, change):
    """Whether an edge of the control polygon turned by more than a right angle in the step.

    False if a grasp jumped by more than half an edge: shorter steps would not help.
    """
    dim, n, width = shape[layout.DIM], shape[layout.N], shape[layout.LINE]
    jump, shortest = 0.0, np.inf
    found = False
    for i in range(layout.MARGIN, layout.MARGIN + n - 1):
        along, length = 0.0, 0.0
        for d in range(dim):
            at = d * width + i
            edge = start[at + 1] - start[at]
            along += edge * (x[at + 1] - x[at])
            length += edge * edge
        shortest = min(shortest, length)
        found = found or along <= 0.0
    for k in range(shape[layout.HELD]):
        own = own_point(shape, k)
        if own >= 0:
            for d in range(dim):
                jump = max(jump, abs(change[d * width + layout.MARGIN + own]))
    return found and not 4.0 * jump * jump > shortest


@part
def moving(shape, change, least):
    """Whether any coordinate changed by more than `least`."""
    for at in range(shape[layout.SIZE]):
        if abs(change[at]) > least:
            return True
    return False


@part
def dot(a, b, size):
    """a . b, as four independent sums."""
    s0, s1, s2, s3 = 0.0, 0.0, 0.0, 0.0
    whole = size - size % 4
    for r in range(0, whole, 4):
        s0 += a[r] * b[r]
        s1 += a[r + 1] * b[r + 1]
        s2 += a[r + 2] * b[r + 2]
        s3 += a[r + 3] * b[r + 3]
    for r in range(whole, size):
        s0 += a[r] * b[r]
    return (s0 + s1) + (s2 + s3)
