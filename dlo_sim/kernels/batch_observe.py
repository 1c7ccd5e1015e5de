"""Energies of LANES cables at once, a judgement of each, and samples.

The formulas are those of `kernels.elastic` and `observe`. A lane whose energy makes no sense any
more is marked and its last good state kept.
"""

from __future__ import annotations

import numpy as np

from dlo_sim.kernels.batch_forces import mean_strains, span_coefficients
from dlo_sim.kernels.batch_layout import (
    BEND,
    GRAVITY,
    KINETIC,
    PARTS,
    SPRING,
    STRETCH,
    add_row,
    add_rows,
    add_scaled,
    clear,
    clear_row,
    put,
)
from dlo_sim.kernels.jit import kernel
from dlo_sim.kernels.layout import (
    DISSIPATED,
    ENERGY_ERROR,
    ENERGY_START,
    EXCHANGED,
    FLOOR,
    LANES,
    LOAD_WORK,
    PENDING,
    POTENTIAL_START,
)
from dlo_sim.kernels.observe import DIVERGED_SHARE, energy_floor

_SLOTS = (0, 1, 3, 4)  # of these potentials in the ledger, which has twist as well


@kernel
def square_row(scale, band, w, other, out):
    """out += scale band w other."""
    for e in range(out.shape[0]):
        out[e] += scale * band[e] * w[e] * other[e]


@kernel
def kinetic(w, band, sums, out):
    """out = w^T M w / 2 of every lane [J]."""
    n = w.shape[0]
    clear_row(sums)
    for i in range(n):
        square_row(0.5, band[i, 0], w[i], w[i], sums)
        for k in range(1, min(4, n - i)):
            square_row(1.0, band[i, k], w[i], w[i + k], sums)
    clear_row(out)
    add_rows(sums, out)


@kernel
def sample_energy(p, xi, weights, slope, stretch, bend, axes, stretching, bending):
    """Add one sample's stretching and bending energy; see `kernels.elastic.elastic_energy`."""
    dim = len(axes)
    for lane in range(weights.shape[0]):
        s = slope[lane]
        w = weights[lane]
        b0, c0 = p[dim * LANES + lane], p[2 * dim * LANES + lane]
        b1, c1 = p[(dim + 1) * LANES + lane], p[(2 * dim + 1) * LANES + lane]
        t0 = p[lane] + xi * (b0 + xi * c0)
        t1 = p[LANES + lane] + xi * (b1 + xi * c1)
        k0 = s * (b0 + 2.0 * xi * c0)
        k1 = s * (b1 + 2.0 * xi * c1)
        t2 = 0.0
        k2 = 0.0
        if dim == 3:
            b2, c2 = p[5 * LANES + lane], p[8 * LANES + lane]
            t2 = p[2 * LANES + lane] + xi * (b2 + xi * c2)
            k2 = s * (b2 + 2.0 * xi * c2)
        c = t0 * t0 + t1 * t1 + t2 * t2
        if stretch is not None:
            strain = (c - 1.0) / (np.sqrt(c) + 1.0)
            stretching[lane] += 0.5 * stretch[lane] * w * strain * strain
        if bend is not None:
            n0 = t1 * k2 - t2 * k1
            n1 = t2 * k0 - t0 * k2
            n2 = t0 * k1 - t1 * k0
            area = n0 * n0 + n1 * n1 + n2 * n2
            bending[lane] += 0.5 * bend[lane] * w * area / (c * c * c)


@kernel
def span_energy(p, xi, weights, slope, spans, span, dim, stretching):
    """Add the stretching energy of one span of every lane; see `kernels.span_stretch`."""
    if spans is not None:
        mean_strains(p, xi, weights, slope, spans, dim)
        linear = spans.linear[span]
        for lane in range(stretching.shape[0]):
            m, part = spans.sums[lane], spans.sums[LANES + lane]
            strain = m * m + linear * part * part
            stretching[lane] += spans.stiffness[lane] * strain / slope[lane]


@kernel
def elastic_energy(
    x, xi, weights, extraction, slope, stretch, spans, bend, axes, p, stretching, bending
):
    """Stretching and bending energy of every lane [J]."""
    clear_row(stretching)
    clear_row(bending)
    for span in range(xi.shape[0]):
        span_coefficients(x, extraction, slope, span, p)
        for j in range(xi.shape[1]):
            w = weights[span, j]
            sample_energy(p, xi[span, j], w, slope, stretch, bend, axes, stretching, bending)
        span_energy(p, xi[span], weights[span], slope, spans, span, len(axes), stretching)


@kernel
def add_weight(x, gravity, sums, noise):
    """Add the weight's energy of one control point, and the size of it."""
    for e in range(sums.shape[0]):
        sums[e] -= gravity[e] * x[e]
        noise[e] += abs(gravity[e] * x[e])


@kernel
def weight_energy(x, gravity, sums, noise, out):
    """out = energy of the weight [J], zero at the world's origin; noise = its round-off."""
    clear_row(sums)
    clear_row(noise)
    clear_row(out)
    if gravity is not None:
        for i in range(x.shape[0]):
            add_weight(x[i], gravity[i], sums, noise)
        add_rows(sums, out)


@kernel
def spring_energy(x, springs, out):
    """out = energy of the end springs [J]."""
    clear_row(out)
    if springs is not None:
        for end in range(2):
            i = end * (x.shape[0] - 1)
            for e in range(x.shape[1]):
                moved = x[i, e] - springs.anchor[end, e]
                out[e % LANES] += 0.5 * springs.stiffness[end, e] * moved * moved


@kernel
def energies(state, stack, work):
    """All parts of the energy of every lane into work.parts; work.sums[1] is the size of the
    weight's terms."""
    x, parts, sums = state.position, work.parts, work.sums
    elastic_energy(
        x,
        stack.xi,
        stack.weights,
        stack.extraction,
        stack.slope,
        stack.stretch,
        stack.span_stretch,
        stack.bend,
        stack.axes,
        work.coefficients,
        parts[STRETCH],
        parts[BEND],
    )
    spring_energy(x, stack.springs, parts[SPRING])
    kinetic(state.w, stack.band, sums[0], parts[KINETIC])
    weight_energy(x, stack.gravity, sums[0], sums[1], parts[GRAVITY])


@kernel
def largest_row(x, out):
    """out = the larger of itself and |x|."""
    for e in range(out.shape[0]):
        value = abs(x[e])
        out[e] = value if value > out[e] else out[e]


@kernel
def lane_floor(stack, reach, weight, spans, parts, lane):
    """`kernels.observe.energy_floor` of one lane."""
    far = 0.0
    heavy = 0.0
    for e in range(lane, reach.shape[0], LANES):
        far = max(far, reach[e])
        heavy += weight[e]
    span = 2.0 / stack.slope[lane]
    return energy_floor(
        parts[STRETCH, lane],
        parts[BEND, lane],
        parts[SPRING, lane] + parts[KINETIC, lane] + heavy,
        far,
        span,
        span * spans,
        lane_value(stack.stretch, lane) + lane_stiffness(stack.span_stretch, lane),
        lane_value(stack.bend, lane),
    )


@kernel
def lane_value(values, lane):
    """Value of one lane, 0 without the term."""
    if values is not None:
        return values[lane]
    return 0.0


@kernel
def lane_stiffness(spans, lane):
    """EA of one lane that is stretched by span, 0 without."""
    if spans is not None:
        return spans.stiffness[lane]
    return 0.0


@kernel
def sane(ledger, parts, floor, lane):
    """Compare a lane's energy with work done and energy lost; false leaves the account as it is.

    See `kernels.observe.update_account`.
    """
    total = parts[KINETIC, lane]
    exchanged = max(ledger[EXCHANGED, lane], total)
    for row in range(KINETIC):
        total += parts[row, lane]
        change = abs(parts[row, lane] - ledger[POTENTIAL_START + _SLOTS[row], lane])
        exchanged = max(exchanged, change)
    exchanged = max(exchanged, abs(ledger[LOAD_WORK, lane]))
    known = ledger[ENERGY_START, lane] + ledger[LOAD_WORK, lane] + ledger[PENDING, lane]
    error = abs(total - known + ledger[DISSIPATED, lane])
    floor = max(ledger[FLOOR, lane], floor)
    if np.isfinite(total) and error <= DIVERGED_SHARE * max(exchanged, floor):
        ledger[FLOOR, lane] = floor
        ledger[EXCHANGED, lane] = exchanged
        ledger[ENERGY_ERROR, lane] = max(ledger[ENERGY_ERROR, lane], error)
        return True
    return False


@kernel
def keep_good(state, lane):
    """Remember the state of one lane."""
    for i in range(state.position.shape[0]):
        for e in range(lane, state.position.shape[1], LANES):
            state.good_position[i, e] = state.position[i, e]
            state.good_w[i, e] = state.w[i, e]


@kernel
def judge(state, stack, reach, weight, parts, step):
    """Judge every lane after `step` whole steps and keep the sane states."""
    clear_row(reach)
    for i in range(state.position.shape[0]):
        largest_row(state.position[i], reach)
    spans = state.position.shape[0] - 3.0
    good = 0
    for lane in range(LANES):
        if state.failed_step[lane] < 0:
            floor = lane_floor(stack, reach, weight, spans, parts, lane)
            if sane(state.ledger, parts, floor, lane):
                state.good_step[lane] = step
                good += 1
            else:
                state.failed_step[lane] = step
    if good == LANES:
        put(state.position, state.good_position)
        put(state.w, state.good_w)
    else:
        for lane in range(LANES):
            if state.good_step[lane] == step:
                keep_good(state, lane)


@kernel
def look(state, stack, work, step):
    """Energies of all lanes into work.parts, and a judgement of every lane."""
    energies(state, stack, work)
    judge(state, stack, work.sums[0], work.sums[1], work.parts, step)


@kernel
def sampled(recorder, t0, tau):
    """Whether a sample falls into the step from t0."""
    k = recorder.next[0]
    return k < recorder.times.shape[0] and recorder.times[k] <= t0 + tau * (1.0 + 1e-9)


@kernel
def store_samples(state, recorder, parts, t0, tau):
    """Store every sample time inside the step: cubic Hermite between the states at its two ends.

    The energy is that of the state at the end of the step.
    """
    x, w = state.position, state.w
    while recorder.next[0] < recorder.times.shape[0]:
        k = recorder.next[0]
        s = (recorder.times[k] - t0) / tau
        if s > 1.0 + 1e-9:
            break
        a = (1.0 + 2.0 * s) * (1.0 - s) * (1.0 - s)
        b = s * (1.0 - s) * (1.0 - s) * tau
        c = s * s * (3.0 - 2.0 * s)
        e = s * s * (s - 1.0) * tau
        if abs(s - 1.0) < 1e-9:
            a, b, c, e = 0.0, 0.0, 1.0, 0.0
        out = recorder.positions[k]
        clear(out)
        add_scaled(a, recorder.before, out)
        add_scaled(b, recorder.before_w, out)
        add_scaled(c, x, out)
        add_scaled(e, w, out)
        clear_row(recorder.energies[k])
        for row in range(PARTS):
            add_row(1.0, parts[row], recorder.energies[k])
        recorder.next[0] = k + 1
