"""The step of all drift/kick methods (`core.methods`).

A step is, for each stage, a drift x += c_i tau w and a kick w += d_i tau P M^-1 f. A drift also
moves the constraint rows to their targets at the time of the stage (`engine.rows`). External
damping is split off and solved exactly, half a step before and half after; methods with negative
weights do not offer it.
"""

from __future__ import annotations

import numpy as np
from numba import boolean, float64, int64

from dlo_sim.compiling.groups import load, store
from dlo_sim.compiling.kernels import inline, kernel
from dlo_sim.compiling.lanes import LANES
from dlo_sim.engine.arrays import CABLE, DAMPED, METHOD, SPLITTING
from dlo_sim.engine.lines import add, form, mass_of
from dlo_sim.engine.rows import carry, grasps_move
from dlo_sim.engine.springs import move_anchors
from dlo_sim.methods.works import estimate_pending_work, evaluate, has_work


@inline
def decay_flow(cable, dt):
    """Exact flow of the external damping over dt: w <- exp(-decay dt) w on every line."""
    if not cable.terms & DAMPED:
        return
    w, decay = cable.state.w, cable.linear.decay
    rate, factor = 0.0, 1.0
    for line in range(cable.lines):
        if decay[line] != rate:
            rate = decay[line]
            factor = np.exp(-rate * dt)
        energy = form(mass_of(cable, line), w[line])
        cable.state.balance.dissipated += 0.5 * energy * (1.0 - factor * factor)
        for c in range(0, cable.columns, LANES):
            store(w, line, c, factor * load(w, line, c))


@inline
def drift(cable, t, dt):
    """Drift over dt to time t (`rows.carry`), and move the anchors of springs."""
    carry(cable, cable.state.x, cable.state.w, t, dt)
    if grasps_move(cable):
        move_anchors(cable)


@kernel(boolean, METHOD, CABLE, int64, float64, terms=SPLITTING)
def splitting_step(method, cable, step, tau):
    """Step number `step`, of length tau. Stage times are (step + sum of c_i) tau."""
    c, d, results = method.drift, method.kick, cable.work.results
    works, fresh = has_work(cable), results.forces_known != 0.0
    if works and c[0] != 0.0 and cable.state.balance.is_counted == 0.0:
        evaluate(cable, step * tau)
    elapsed, evaluations = 0.0, 0
    decay_flow(cable, 0.5 * tau)
    for stage in range(method.stages):
        if c[stage] != 0.0:
            elapsed += c[stage]
            drift(cable, (step + elapsed) * tau, c[stage] * tau)
            fresh = False
        if d[stage] != 0.0:
            if not fresh:
                evaluate(cable, (step + elapsed) * tau)
                evaluations += 1
                fresh = True
            add(d[stage] * tau, cable.work.force, cable.state.w)
    if works and not fresh:
        estimate_pending_work(cable)
    decay_flow(cable, 0.5 * tau)
    results.evaluations += evaluations
    results.forces_known = 1.0 if fresh else 0.0
    return True
