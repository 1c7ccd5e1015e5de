"""The loop of Zhai's explicit two-step method (see `dlo_sim.core.zhai`).

One force evaluation per step. The acceleration of the step before is part of the state
(`State.history[0]`); the first step takes the present one in its place. Driven ends are placed at
the end of the step and the free DOFs carried along (see `layout.State`).
"""

from __future__ import annotations

from dlo_sim.kernels.banded import solve_rows
from dlo_sim.kernels.jit import entry, kernel
from dlo_sim.kernels.layout import HISTORY
from dlo_sim.kernels.observe import begin_sample, end_sample, update_account
from dlo_sim.kernels.plastic import plastic_flow
from dlo_sim.kernels.runge_kutta import lose_energy
from dlo_sim.kernels.splitting import DIVERGED, OK, drive_ends, evaluate


@kernel
def add_decay(state, force, decay, n):
    """Accelerations in `force` += - decay w of the external damping."""
    if decay is not None:
        for d in range(state.w.shape[0]):
            for i in range(n):
                force[d, i] -= decay[d] * state.w[d, i]


@kernel
def two_step(state, force, n, psi, phi, tau):
    """Positions and w after the step; the present acceleration becomes the one before."""
    before = state.history[0]
    known = state.ledger[HISTORY] != 0.0
    state.ledger[HISTORY] = 1.0
    for d in range(state.w.shape[0]):
        for i in range(n):
            a = force[d, i]
            b = before[d, i] if known else a
            state.position[d, i] += tau * (state.w[d, i] + tau * ((0.5 + psi) * a - psi * b))
            state.w[d, i] += tau * ((1.0 + phi) * a - phi * b)
            before[d, i] = a


@kernel
def zhai_step(state, terms, work, psi, phi, step, tau, fresh):
    """One step; `fresh` says that work.force holds the accelerations of the present state.

    Returns force evaluations.
    """
    n = terms.lattice.n
    evaluations = 0
    for side in range(1 if fresh else 0, 2):
        if side == 1:
            lose_energy(state, terms.mass, terms.decay, n, 0.5 * tau)
            drive_ends(
                state.position,
                terms.drive,
                terms.springs,
                terms.mass,
                terms.axes,
                n,
                (step + 1) * tau,
                work.ends,
            )
            two_step(state, work.force, n, psi, phi, tau)
            lose_energy(state, terms.mass, terms.decay, n, 0.5 * tau)
        evaluate(state, terms, work, (step + side) * tau)
        solve_rows(terms.mass.lower, terms.mass.inverse_diagonal, n, work.force)
        add_decay(state, work.force, terms.decay, n)
        evaluations += 1
    return evaluations


@entry
def advance_zhai(state, terms, work, psi, phi, first_step, steps, tau, guard, recorder):
    """Advance by whole steps from time first_step * tau.

    Returns (OK or DIVERGED, steps done, force evaluations), as `advance_splitting` does.
    """
    evaluations = 0
    fresh = False
    for step in range(first_step, first_step + steps):
        t0 = step * tau
        sampling = begin_sample(state, terms, work, recorder, t0, tau)
        evaluations += zhai_step(state, terms, work, psi, phi, step, tau, fresh)
        fresh = not plastic_flow(state, terms.lattice, terms.plastic, terms.axes, work.coefficients)
        if (step + 1) % guard == 0:
            _, sane = update_account(state, terms, work)
            if not sane:
                return DIVERGED, step - first_step, evaluations
        if sampling:
            end_sample(state, terms, work, recorder, t0, tau)
    return OK, steps, evaluations
