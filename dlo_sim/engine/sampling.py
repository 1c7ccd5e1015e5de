"""Dense output: states at given times by cubic Hermite interpolation over the step.

The recorder is four arrays: times [s] (T,), states (T, SIZE) as lines, energies (T, LANES) [J], and
`marks` (2,): index of the next sample, number of samples T.
"""

from __future__ import annotations

from dlo_sim.compiling.lanes import LANES, shifted
from dlo_sim.compiling.pieces import NOTHING, NUMBERS, REAL, TABLE, part, piece
from dlo_sim.engine.account import notes_of, update_account
from dlo_sim.engine.assembly import ANY
from dlo_sim.engine.bundles import BARE_RECORDS
from dlo_sim.engine.held_motion import add_velocity_of_held
from dlo_sim.engine.layout import BEFORE, SIZE, V0, V1, W, X
from dlo_sim.engine.lines import copy


@part
def velocities(shape, model, inputs, state, scratch, t, out):
    """Velocities of all control points at time t: w plus the prescribed motion."""
    copy(shape, shifted(state, shape[W]), out)
    x = shifted(state, shape[X])
    add_velocity_of_held(shape, model, inputs, state, scratch, x, t, out)


@part
def begin_sample(shape, model, inputs, state, scratch, records, t0, tau):
    """Save the state at the start of a step that contains a sample time; return whether it does."""
    times, _, _, marks = records
    k = marks[0]
    if k < marks[1] and times[k] <= t0 + tau * (1.0 + 1e-9):
        copy(shape, shifted(state, shape[X]), shifted(scratch, shape[BEFORE]))
        v0 = shifted(scratch, shape[V0])
        velocities(shape, model, inputs, state, scratch, t0, v0)
        return True
    return False


@piece(
    *(NOTHING, TABLE, NUMBERS, NUMBERS, NUMBERS, NUMBERS, ANY.energies, update_account),
    *(BARE_RECORDS, REAL, REAL),
)
def end_sample(shape, model, inputs, state, scratch, look, update, records, t0, tau):
    """Record all samples of this step. Their energy is that at the end of the step."""
    times, samples, powers, marks = records
    v0, v1 = shifted(scratch, shape[V0]), shifted(scratch, shape[V1])
    before = shifted(scratch, shape[BEFORE])
    x = shifted(state, shape[X])
    velocities(shape, model, inputs, state, scratch, t0 + tau, v1)
    update(shape, model, state, scratch, look)
    out = notes_of(shape, scratch)
    size = shape[SIZE]
    while marks[0] < marks[1]:
        k = marks[0]
        s = (times[k] - t0) / tau
        if s > 1.0 + 1e-9:
            break
        a = (1.0 + 2.0 * s) * (1.0 - s) * (1.0 - s)
        b = s * (1.0 - s) * (1.0 - s) * tau
        c = s * s * (3.0 - 2.0 * s)
        e = s * s * (s - 1.0) * tau
        if abs(s - 1.0) < 1e-9:
            a, b, c, e = 0.0, 0.0, 1.0, 0.0
        for at in range(size):
            samples[k * size + at] = a * before[at] + b * v0[at] + c * x[at] + e * v1[at]
        for lane in range(LANES):
            powers[k * LANES + lane] = out[lane]
        marks[0] = k + 1
