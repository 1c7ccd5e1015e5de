"""What the loops do at the end of their steps."""

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
    """Change of the terms' own state at the shape after a step; whether that changes forces. Then
    the next step computes them anew, as it would after a pause between two calls.
    """
    _, _, _, follow_shape = closing
    if shape[TERMS] & BISHOP:
        follow_shape(shape, model, inputs, state, scratch)
    if shape[TERMS] & PLASTICITY:
        plastic_flow(shape, model, state, shifted(state, shape[X]))
    return shape[TERMS] & (BISHOP | PLASTICITY) != 0
