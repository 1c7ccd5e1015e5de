"""The step of Zhai's explicit two-step method, with psi = phi = 1/2:

    x1 = x0 + tau v0 + tau^2 (a0 - a_before / 2)
    v1 = v0 + tau (3 a0 - a_before) / 2

Eliminating the velocities gives the recursion of the Stoermer-Verlet method: with the first step
taken as a_before = a0 the positions are those of `velocity_verlet`, and only the velocities differ
(by tau (a0 - a_before) / 2). Other pairs have smaller stable steps, or none, or first order.

One force evaluation per step. The acceleration of the previous step is part of the state; the first
step uses the present one instead. Constraint rows drift as in `engine.rows`; the accelerations are
projected with the directions at the end of the step.

Source: Zhai 1996, eqs. 3-4; the remarks are derived here and tested.
"""

from __future__ import annotations

from numba import boolean, float64, int64

from dlo_sim.compiling.groups import load, store
from dlo_sim.compiling.kernels import inline, kernel
from dlo_sim.compiling.lanes import LANES
from dlo_sim.engine.arrays import CABLE, METHOD, ZHAI
from dlo_sim.engine.lines import add
from dlo_sim.engine.rows import carry, grasps_move, project
from dlo_sim.engine.springs import move_anchors
from dlo_sim.methods.runge_kutta import add_damping_loss, add_decay
from dlo_sim.methods.works import evaluate


@inline
def accelerate(cable, t):
    """`work.force` = P M^-1 f - decay w; adds the work to the energy balance."""
    evaluate(cable, t)
    add_decay(cable, cable.work.force)


@kernel(boolean, METHOD, CABLE, int64, float64, terms=ZHAI)
def zhai_step(method, cable, step, tau):
    """Step number `step`, of length tau; the acceleration at its start becomes the previous one."""
    state, work, results = cable.state, cable.work, cable.work.results
    w, before, mean = state.w, state.acceleration, work.mean_rate
    t, known = (step + 1) * tau, state.balance.known != 0.0
    if results.forces_known == 0.0:
        accelerate(cable, step * tau)
        results.evaluations += 1.0
    add_damping_loss(cable, 0.5 * tau)
    for line in range(cable.lines):
        for c in range(0, cable.columns, LANES):
            a, v = load(work.force, line, c), load(w, line, c)
            b = load(before, line, c) if known else a
            store(mean, line, c, v + tau * (a - 0.5 * b))
            store(w, line, c, tau * (0.5 * a))
            store(before, line, c, a)
    state.balance.known = 1.0
    carry(cable, state.x, mean, t, tau)
    move_anchors(cable)
    if grasps_move(cable):
        project(cable, w, work.multipliers)
        project(cable, before, work.multipliers)
    add(1.0, mean, w)
    add_damping_loss(cable, 0.5 * tau)
    accelerate(cable, t)
    results.evaluations += 1.0
    results.forces_known = 1.0
    return True
