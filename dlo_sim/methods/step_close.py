"""What every loop does around its steps: flows once a step, looks at the account, samples."""

from __future__ import annotations

from dlo_sim.compiling.lanes import shifted
from dlo_sim.compiling.pieces import part
from dlo_sim.engine.account import update_account
from dlo_sim.engine.bishop import follow_shape
from dlo_sim.engine.layout import BISHOP, PLASTICITY, TERMS, X
from dlo_sim.engine.plasticity import plastic_flow
from dlo_sim.engine.sampling import end_sample

CLOSING = (update_account, end_sample, follow_shape)
"""The pieces that close a step."""


@part
def flow(shape, model, inputs, state, scratch, closing):
    """Change of the terms' own state at the shape after a step; whether that changes forces."""
    _, _, _, follow_shape = closing
    if shape[TERMS] & BISHOP:
        follow_shape(shape, model, inputs, state, scratch)
    if shape[TERMS] & PLASTICITY:
        plastic_flow(shape, model, state, shifted(state, shape[X]))
        return True
    return False


@part
def close_step(arrays, look, closing, looked_at, sampling, records, t0, tau):
    """Compare the energy with the account if the step is `looked_at`, and store the samples of the
    step if it holds any; whether the cable is sane.
    """
    shape, model, inputs, state, scratch = arrays
    _, update, end_sample, _ = closing
    if looked_at and not update(shape, model, state, scratch, look):
        return False
    if sampling:
        end_sample(shape, model, inputs, state, scratch, look, update, records, t0, tau)
    return True
