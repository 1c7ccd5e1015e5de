"""Scratch of the explicit methods, and what an inextensible cable needs."""

from __future__ import annotations

from dlo_sim.compiling.lanes import LANES
from dlo_sim.engine.band import PADDING
from dlo_sim.engine.layout import FIRST_OWN

MOST_STAGES = 4  # of a Runge-Kutta method
CONSTRAINT_ENTRIES = 16  # of a constraint: a matrix over four control points
SADDLE_WIDTH = 32  # entries of a row of the saddle-point matrix (`engine.band`)

X_RATES = FIRST_OWN + 30  # lines a stage: rate of the positions
W_RATES = FIRST_OWN + 31  # lines a stage: rate of the momentum variable
X_BEGIN = FIRST_OWN + 32  # lines: positions, momentum variable at the begin of the step
W_BEGIN = FIRST_OWN + 33
MEAN = FIRST_OWN + 34  # lines: mean rate of the positions over the step
CONSTRAINTS = FIRST_OWN + 35  # in model: CONSTRAINT_ENTRIES numbers each
SADDLE = FIRST_OWN + 36  # matrix over all unknowns and multipliers
BLANK = FIRST_OWN + 37  # what never changes of it
MULTIPLIERS = FIRST_OWN + 38  # unknowns and multipliers: right-hand side, solution
RESPONSE = FIRST_OWN + 39  # unknowns and multipliers a held row: what a unit force on it does
HELD_SYSTEM = FIRST_OWN + 40  # held x held: what unit forces on held rows do to them
HOLDING_FORCE = FIRST_OWN + 41  # rows, held: of the corrections
STEP_MOVED = FIRST_OWN + 42  # rows, held: MOVED of the step
CORRECTION = FIRST_OWN + 43  # lines
EIGHT_SIDES = FIRST_OWN + 44  # eight numbers each unknown and multiplier
GOOD = FIRST_OWN + 45  # of eight cables: x, w and GOOD_ROWS rows at the last look that was good
BEFORE_MULTIPLIERS, BEHIND_MULTIPLIERS = FIRST_OWN + 46, FIRST_OWN + 47  # zeros around them
GOOD_STEP = 0  # rows behind them: steps up to that look
FAILED_STEP = 1  # steps up to the look that was not, 0 without one
GOOD_LEDGER = 2  # what the ledger knew of the energy's error
GOOD_ROWS = 5


def explicit_rooms(
    n: int, dim: int, held: int, size: int, constraints: int, stride: int
) -> dict[int, int]:
    """Sizes of the scratch by its offset."""
    rooms = {
        X_RATES: MOST_STAGES * size,
        W_RATES: MOST_STAGES * size,
        **dict.fromkeys((X_BEGIN, W_BEGIN, MEAN), size),
        GOOD: 2 * size + GOOD_ROWS * LANES if stride > 1 else 0,
    }
    if not constraints:
        return rooms
    unknowns = n * (dim + 1) + 1
    whole = -(-unknowns // LANES) * LANES
    return rooms | {
        SADDLE: unknowns * SADDLE_WIDTH + 2 * LANES,
        BLANK: unknowns * SADDLE_WIDTH,
        BEFORE_MULTIPLIERS: PADDING,
        MULTIPLIERS: whole,
        BEHIND_MULTIPLIERS: PADDING,
        RESPONSE: held * whole,
        EIGHT_SIDES: unknowns * LANES,
        HELD_SYSTEM: held * held,
        HOLDING_FORCE: held * LANES,
        STEP_MOVED: held * LANES,
        CORRECTION: size,
    }
