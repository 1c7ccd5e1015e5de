"""Dense output: states at given times by cubic Hermite interpolation over the step."""

from __future__ import annotations

from numba import float64, void

from dlo_sim.compiling.groups import load, store
from dlo_sim.compiling.kernels import inline, kernel
from dlo_sim.compiling.lanes import LANES
from dlo_sim.engine.account import update_account
from dlo_sim.engine.arrays import CABLE, RECORDS
from dlo_sim.engine.lines import copy
from dlo_sim.engine.rows import add_velocity_of_held


@inline
def velocities(cable, t, out):
    """Velocities of all control points at time t: w plus the prescribed motion."""
    copy(cable.state.w, out)
    add_velocity_of_held(cable, cable.state.x, t, out)


@inline
def begin_sample(cable, records, t0, tau):
    """Save the state at the start of a step that contains a sample time; return whether it does."""
    k = records.marks[0]
    if k < len(records.times) and records.times[k] <= t0 + tau * (1.0 + 1e-9):
        copy(cable.state.x, cable.work.before)
        velocities(cable, t0, cable.work.v0)
        return True
    return False


@kernel(void, CABLE, RECORDS, float64, float64)
def end_sample(cable, records, t0, tau):
    """Record all samples of this step. Their energy is that at the end of the step."""
    work, x = cable.work, cable.state.x
    velocities(cable, t0 + tau, work.v1)
    update_account(cable)
    while records.marks[0] < len(records.times):
        k = records.marks[0]
        s = (records.times[k] - t0) / tau
        if s > 1.0 + 1e-9:
            break
        a = (1.0 + 2.0 * s) * (1.0 - s) * (1.0 - s)
        b = s * (1.0 - s) * (1.0 - s) * tau
        c = s * s * (3.0 - 2.0 * s)
        e = s * s * (s - 1.0) * tau
        if abs(s - 1.0) < 1e-9:
            a, b, c, e = 0.0, 0.0, 1.0, 0.0
        for line in range(cable.lines):
            for i in range(0, cable.columns, LANES):
                value = a * load(work.before, line, i) + b * load(work.v0, line, i)
                value = value + c * load(x, line, i) + e * load(work.v1, line, i)
                store(records.x, k, line, i, value)
        records.energy[k] = work.results.total
        records.marks[0] = k + 1
