"""Eight cables side by side: the last valid state of each; lanes of failed cables run on unused."""

from __future__ import annotations

from dlo_sim.compiling.lanes import LANES
from dlo_sim.compiling.pieces import part
from dlo_sim.engine.account import notes_of
from dlo_sim.engine.layout import ENERGY_ERROR, EXCHANGED, FLOOR, LEDGER, SIZE, W, X
from dlo_sim.methods.explicit_layout import FAILED_STEP, GOOD, GOOD_LEDGER, GOOD_STEP


@part
def keep_sane(shape, state, scratch, step):
    """Save the state of every cable that passed all checks of the account so far, the present one
    after `step` steps included. Return whether there is any.
    """
    size, good, ledger = shape[SIZE], shape[GOOD], shape[LEDGER]
    rows, found = good + 2 * size, notes_of(shape, scratch)
    any_left = False
    for lane in range(LANES):
        if scratch[rows + FAILED_STEP * LANES + lane] != 0.0:
            continue
        if found[LANES + lane] == 0.0:
            scratch[rows + FAILED_STEP * LANES + lane] = step
            continue
        any_left = True
        scratch[rows + GOOD_STEP * LANES + lane] = step
        for at in range(lane, size, LANES):
            scratch[good + at] = state[shape[X] + at]
            scratch[good + size + at] = state[shape[W] + at]
        at = rows + GOOD_LEDGER * LANES + lane
        scratch[at] = state[ledger + ENERGY_ERROR * LANES + lane]
        scratch[at + LANES] = state[ledger + EXCHANGED * LANES + lane]
        scratch[at + 2 * LANES] = state[ledger + FLOOR * LANES + lane]
    return any_left
