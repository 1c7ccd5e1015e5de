"""The time loop of all drift/kick methods (`core.methods`).

A step is, for each stage, a drift x += c_i tau w and a kick w += d_i tau P M^-1 f. A drift also
moves the held rows to their targets at the time of the stage (`engine.held`). External damping is
split off and solved exactly, half a step before and half after; methods with negative weights do
not offer it.
"""

from __future__ import annotations

import numpy as np

from dlo_sim.compiling.lanes import LANES, load, shifted, store
from dlo_sim.compiling.pieces import COUNTS, REAL, REALS, WHOLE, Engine, part, piece
from dlo_sim.engine import layout
from dlo_sim.engine.account import add_to_ledger, update_account
from dlo_sim.engine.assembly import assembly, by_terms, flow
from dlo_sim.engine.bundles import CABLE, RECORDS, bared, bared_records
from dlo_sim.engine.held_motion import carry
from dlo_sim.engine.lines import add, form, gathered, mass_of
from dlo_sim.engine.sampling import begin_sample, end_sample
from dlo_sim.engine.springs import move_anchors
from dlo_sim.methods.sane_cables import keep_sane
from dlo_sim.methods.works import estimate_pending_work, evaluate, has_work


@part
def decay_flow(shape, model, state, scratch, dt):
    """Exact flow of the external damping over dt."""
    if not shape[layout.TERMS] & layout.DAMPED:
        return
    w, factors = shifted(state, shape[layout.W]), shape[layout.NOTES]
    for line in range(shape[layout.LINES]):
        rates = shape[layout.DECAY] + line * LANES
        if line == 0 or model[rates] != model[rates - LANES] or shape[layout.STRIDE] > 1:
            for lane in range(LANES):
                scratch[factors + lane] = np.exp(-model[rates + lane] * dt)
        factor = load(scratch, factors)
        energy = gathered(shape, form(shape, model, mass_of(shape, line), line, w))
        add_to_ledger(shape, state, layout.DISSIPATED, 0.5 * energy * (1.0 - factor * factor))
        start = line * shape[layout.LINE] + layout.MARGIN * shape[layout.STRIDE]
        for b in range(shape[layout.PARTS]):
            at = start + LANES * b
            store(w, at, factor * load(w, at))


@by_terms
def engine_of(terms: int) -> Engine:
    """The pieces that the loops of explicit methods call, for a scene with these bits."""
    forces, energies, _, _, flows = assembly(terms)
    return Engine(forces, energies, flows, carry, evaluate, update_account, end_sample)


ENGINE = engine_of(0)  # of the type of all others


@part
def drift(shape, model, inputs, state, scratch, carry, t, dt):
    """Drift over dt to time t (`held_motion.carry`), and move the anchors of springs."""
    x, w = shifted(state, shape[layout.X]), shifted(state, shape[layout.W])
    carry(shape, model, inputs, state, scratch, x, w, t, dt)
    move_anchors(shape, model, inputs, state, t)


@piece(COUNTS, CABLE, ENGINE, REALS, REALS, WHOLE, WHOLE, REAL, WHOLE, RECORDS)
def advance_splitting(
    cable, engine, drift_weights, kick_weights, first_step, steps, tau, guard, records
):
    """Advance by whole steps from time first_step * tau: (status, steps done, evaluations).

    Stage times are (step + sum of c_i) tau, so that the end of a step is bitwise the start of the
    next. The energy account is checked every `guard` steps, counted from time zero so that
    splitting a run into calls changes nothing; for eight cables also after the last step, and the
    loop continues while one of them is sane.
    """
    _, forces, look, flows, carry, evaluate, update, end_sample = engine.pieces
    shape, model, inputs, state, scratch = bared(cable)
    records = bared_records(records)
    w, force = shifted(state, shape[layout.W]), shifted(scratch, shape[layout.FORCE])
    evaluations = 0
    fresh = False  # FORCE holds the acceleration of the present state
    works, eight = has_work(shape, inputs), shape[layout.STRIDE] > 1
    if steps > 0 and works and drift_weights[0] != 0.0:
        if state[shape[layout.LEDGER] + layout.IS_BOOKED * LANES] == 0.0:
            evaluate(shape, model, inputs, state, scratch, forces, first_step * tau)
    for step in range(first_step, first_step + steps):
        t0 = step * tau
        sampling = begin_sample(shape, model, inputs, state, scratch, records, t0, tau)
        elapsed = 0.0
        decay_flow(shape, model, state, scratch, 0.5 * tau)
        for stage in range(len(drift_weights)):
            c = drift_weights[stage]
            if c != 0.0:
                elapsed += c
                drift(shape, model, inputs, state, scratch, carry, (step + elapsed) * tau, c * tau)
                fresh = False
            if kick_weights[stage] != 0.0:
                if not fresh:
                    t = (step + elapsed) * tau
                    evaluate(shape, model, inputs, state, scratch, forces, t)
                    evaluations += 1
                    fresh = True
                add(shape, kick_weights[stage] * tau, force, w)
        if works and not fresh:
            estimate_pending_work(shape, model, inputs, state)
        decay_flow(shape, model, state, scratch, 0.5 * tau)
        if flow(flows, shape, model, inputs, state, scratch):
            fresh = False
        if (step + 1) % guard == 0 or (eight and step + 1 == first_step + steps):
            if works and not fresh:
                evaluate(shape, model, inputs, state, scratch, forces, (step + 1) * tau)
            sane = update(shape, model, state, scratch, look)
            if eight:
                sane = keep_sane(shape, state, scratch, step + 1)
            if not sane:
                return layout.DIVERGED, step - first_step, evaluations
        if sampling:
            end_sample(shape, model, inputs, state, scratch, look, update, records, t0, tau)
    return layout.OK, steps, evaluations
