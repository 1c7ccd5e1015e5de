"""The iteration of an implicit step: first guess, sharpened corrections, search along them, and a
look at what was found.
"""

from __future__ import annotations

import numpy as np

from dlo_sim.kernels.jit import kernel
from dlo_sim.kernels.layout import HISTORY, LENGTH, LENGTH_BEFORE
from dlo_sim.kernels.matrix import substitute

TRUSTED = 0.5  # largest share by which a correction may be repeated
SMALLEST = 1e-300  # square of a correction


@kernel
def alternates(x, history, n, dim):
    """Whether the present configuration is nearer to the last but one than to the last.

    Undamped motion that the step is far too long for turns its sign from step to step.
    """
    once, twice = 0.0, 0.0
    for d in range(dim):
        for i in range(n):
            once += (x[d, i] - history[0, d, i]) ** 2
            twice += (x[d, i] - history[1, d, i]) ** 2
    return twice < once


@kernel
def parabola(tau, last, before):
    """Weights of the present configuration, the last and the last but one in the value at tau of
    the parabola through them; `last` and `before` are the lengths of the last two steps.
    """
    both = last + before
    return (
        (tau + last) * (tau + both) / (last * both),
        -tau * (tau + both) / (last * before),
        tau * (tau + last) / (both * before),
    )


@kernel
def predict(x, w, history, ledger, n, dim, tau):
    """First guess of the free DOFs: the parabola through the last three configurations, the last
    configuration where the motion alternates, or constant w.

    Shifts the history: history[0] becomes the present configuration, history[1] the one before.
    """
    known = ledger[HISTORY] >= 2.0
    last, before_last = ledger[LENGTH], ledger[LENGTH_BEFORE]
    back = known and tau == last == before_last and alternates(x, history, n, dim)
    now_weight, last_weight, before_weight = 0.0, 0.0, 0.0
    if known:
        now_weight, last_weight, before_weight = parabola(tau, last, before_last)
    for d in range(dim):
        for i in range(n):
            now = x[d, i]
            before = history[0, d, i]
            if back:
                x[d, i] = before
            elif known:
                x[d, i] = now_weight * now + last_weight * before + before_weight * history[1, d, i]
            else:
                x[d, i] += tau * w[d, i]
            history[1, d, i] = before
            history[0, d, i] = now
    ledger[LENGTH_BEFORE] = last
    ledger[LENGTH] = tau


@kernel
def restore_prescribed(x, start, free, n, dim):
    """Undo a prediction where nothing is free."""
    for d in range(dim):
        for i in range(n):
            if free[d, i] == 0.0:
                x[d, i] = start[d, i]


@kernel
def damping_velocity_offset(x, w, acceleration, driven, n, dim, tau, rate, g, coast):
    """Into `coast`: tau times the velocity that damping sees, without `rate` times the change over
    the step, by Newmark's formulas
        tau v = rate (q1 - q0) + (1 - rate) tau v0 + g tau^2 a0
    for what w moves. Driven ends and what they carry along, the change of x since `coast`, move at
    the velocities `driven` instead; the twist is that of the midpoint.
    """
    for d in range(x.shape[0]):
        for i in range(n):
            carried = x[d, i] - coast[d, i]
            if d < dim:
                free = (1.0 - rate) * w[d, i] + g * tau * acceleration[d, i]
                coast[d, i] = tau * (free + driven[d, i]) - rate * carried
            else:
                coast[d, i] = (1.0 - rate) * carried


@kernel
def largest(x, n, dim):
    """Largest coordinate."""
    value = 0.0
    for d in range(dim):
        for i in range(n):
            value = max(value, abs(x[d, i]))
    return value


@kernel
def correct(x, moved, solver, known, n, dim):
    """Solve for the correction, sharpen it by the `known` ones since the matrix was made, apply it
    to x and to `moved`, the change of x over the step.

    Broyden's method: each correction tells what the matrix misses along it. With z the solution for
    the present residual and s_j the corrections, z += s_(j+1) (s_j.z) / |s_j|^2 for all but the
    last, then s = z / (1 - s_last.z / |s_last|^2) (Kelley 1995, section 7.3).

    Returns |residual . correction| entry by entry and as a whole, the energy defect
    |residual . moved| that the residual would leave, and the largest entry of the correction.
    """
    size = n * dim
    z = solver.residual
    for r in range(size):
        solver.rhs[r] = z[r]
    substitute(solver.band, size, 4 * dim - 1, z)
    for j in range(known):
        s = solver.corrections[j]
        along = dot(s, z, size) * s[size]
        if j + 1 < known:
            following = solver.corrections[j + 1]
            for r in range(size):
                z[r] += along * following[r]
        elif abs(along) < TRUSTED:
            for r in range(size):
                z[r] /= 1.0 - along
    energy = 0.0
    slope = 0.0
    defect = 0.0
    change = 0.0
    for i in range(n):
        for d in range(dim):
            correction = z[i * dim + d]
            residual = solver.rhs[i * dim + d]
            x[d, i] += correction
            energy += abs(correction * residual)
            slope += correction * residual
            moved[d, i] += correction
            defect += abs(moved[d, i] * residual)
            change = max(change, abs(correction))
    for r in range(size):
        solver.corrections[known, r] = z[r]
    solver.corrections[known, size] = 1.0 / max(dot(z, z, size), SMALLEST)
    return energy, abs(slope), defect, change


@kernel
def residual_along(solver, last, size):
    """Residual . correction, with the residual after that correction."""
    return dot(solver.residual, solver.corrections[last], size)


@kernel
def shortened(before, after):
    """Share of a correction at which the residual along it would vanish, by the secant."""
    share = before / (before - after)
    return min(max(share, 0.1), 0.5) if share > 0.0 and share < np.inf else 0.1


@kernel
def retreat(x, moved, solver, last, share, n, dim):
    """Take back a share of a correction of x and of its change `moved`."""
    step = solver.corrections[last]
    for i in range(n):
        for d in range(dim):
            back = share * step[i * dim + d]
            x[d, i] -= back
            moved[d, i] -= back


@kernel
def turned_over(x, start, free, work, n, dim):
    """Whether an edge of the control polygon turned by more than a right angle in the step.

    Not where an end was put elsewhere in no time: smaller steps would not help.
    """
    jump, shortest = 0.0, np.inf
    found = False
    for i in range(n - 1):
        along, length = 0.0, 0.0
        for d in range(dim):
            edge = start[d, i + 1] - start[d, i]
            along += edge * (x[d, i + 1] - x[d, i])
            length += edge * edge
            moved = max(
                (1.0 - free[d, i]) * abs(work.before[d, i]),
                (1.0 - free[d, i + 1]) * abs(work.before[d, i + 1]),
            )
            jump = max(jump, moved)
        shortest = min(shortest, length)
        found = found or along <= 0.0
    return found and not 4.0 * jump * jump > shortest


@kernel
def dot(a, b, size):
    """a . b, in four sums that do not wait for each other."""
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
