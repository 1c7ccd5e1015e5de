"""What an implicit step leaves behind: momentum, reactions, and its entries in the account."""

from __future__ import annotations

from dlo_sim.kernels.banded import multiply
from dlo_sim.kernels.ends import anchor_work
from dlo_sim.kernels.jit import kernel
from dlo_sim.kernels.layout import DISSIPATED, DRIVE_WORK, ENERGY_START, LOAD_WORK, REACTION
from dlo_sim.kernels.observe import (
    kinetic_energy,
    potentials,
    prescribed_column,
    velocities,
)
from dlo_sim.kernels.splitting import drive_pull


@kernel
def book_step(terms, drive, loads, work, solver, state, lost, n):
    """Add the step's works and losses to the ledger; work.force holds the step's total force."""
    state.ledger[DISSIPATED] += lost
    if loads is not None:
        for d in range(work.load.shape[0]):
            for i in range(n):
                state.ledger[LOAD_WORK] += work.load[d, i] * work.before[d, i]
    if drive is not None:
        state.ledger[DRIVE_WORK] += anchor_work(
            terms.springs, work.anchors, solver.start, state.position, n
        )
        drive_pull(work.force, drive, terms.mass, n, work.pull)
        for d in range(work.force.shape[0]):
            for j in range(4):
                moved = work.before[d, prescribed_column(j, n)]
                state.ledger[DRIVE_WORK] -= work.pull[0, d, j] * moved


@kernel
def free_travel(drive, mass, work, n, out):
    """out = dq_f + shift dq_p of the step on free DOFs, 0 on prescribed ones."""
    for d in range(out.shape[0]):
        for i in range(n):
            out[d, i] = work.before[d, i] * mass.free[d, i]
    if drive is not None:
        for d in range(out.shape[0]):
            for j in range(4):
                column = prescribed_column(j, n)
                moved = work.before[d, column]
                if mass.free[d, column] == 0.0 and moved != 0.0:
                    for i in range(n):
                        out[d, i] += drive.shift[d, j, i] * moved


@kernel
def finish_momentum(w, acceleration, travel, mass, solver, alpha, newmark, n, dim, tau):
    """w1 = 2 travel / tau - w0, or the generalised-alpha update of w and the acceleration."""
    for d in range(w.shape[0]):
        for i in range(n):
            w0 = solver.start_w[d, i]
            a0 = acceleration[d, i]
            if newmark and d < dim:
                a1 = (travel[d, i] / tau - w0 - tau * (0.5 - alpha.beta) * a0) / (tau * alpha.beta)
                w[d, i] = w0 + tau * ((1.0 - alpha.gamma) * a0 + alpha.gamma * a1)
                acceleration[d, i] = a1
            else:
                w[d, i] = (2.0 / tau * travel[d, i] - w0) * mass.free[d, i]
                if alpha.theta != 0.5 and d < dim:
                    acceleration[d, i] = (w[d, i] - w0) / tau


@kernel
def add_reaction(state, terms, work, solver, n, t0, tau, whole):
    """Add what a part tau of a step `whole` has in the mean force of the ends over that step,
    (M (v1 - v0) - f tau) / whole on the prescribed rows.

    Undamped waves that the step does not resolve change sign from step to step, and with them the
    reaction at an instant; its mean over a step does not.
    """
    velocities(solver.start_w, terms, t0, solver.coast)
    velocities(state.w, terms, t0 + tau, solver.moved)
    for d in range(state.reaction.shape[0]):
        for i in range(n):
            solver.moved[d, i] -= solver.coast[d, i]
            solver.coast[d, i] = -tau * work.force[d, i]
        multiply(terms.mass.band[d], n, solver.moved[d], 1.0, solver.coast[d])
        for i in range(n):
            free = terms.mass.free[d, i]
            state.reaction[d, i] += solver.coast[d, i] * (1.0 - free) / whole
    state.ledger[REACTION] = 1.0


@kernel
def absorb_loss(state, terms, work):
    """Book what the method itself dissipated; energy it adds stays an error."""
    ledger = state.ledger
    total = kinetic_energy(state.w, terms.mass, terms.lattice.n)
    for part in potentials(state.position, terms, work):
        total += part
    missing = (
        ledger[ENERGY_START] + ledger[LOAD_WORK] + ledger[DRIVE_WORK] - ledger[DISSIPATED] - total
    )
    if missing > 0.0:
        ledger[DISSIPATED] += missing


@kernel
def ends_moved(drive, mass, work, n):
    """Whether a prescribed DOF moves in this step."""
    if drive is not None:
        for j in range(4):
            column = prescribed_column(j, n)
            for d in range(work.before.shape[0]):
                if mass.free[d, column] == 0.0 and work.before[d, column] != 0.0:
                    return True
    return False
