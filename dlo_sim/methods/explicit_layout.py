"""Scratch of the explicit methods, and of the constraints of an inextensible cable."""

from __future__ import annotations

from dlo_sim.compiling.lanes import LANES
from dlo_sim.engine.band import PADDING
from dlo_sim.engine.layout import FIRST_OWN

MOST_STAGES = 4  # of a Runge-Kutta method
CONSTRAINT_ENTRIES = 16  # per constraint: a 4 x 4 matrix over its control points
SADDLE_WIDTH = 32  # stored entries per row of the saddle-point matrix (`engine.band`)

X_RATES = FIRST_OWN + 30  # lines per stage: rate of the positions
W_RATES = FIRST_OWN + 31  # lines per stage: rate of the momentum variable
X_BEGIN = FIRST_OWN + 32  # lines: positions at the start of the step
W_BEGIN = FIRST_OWN + 33  # lines: momentum variable there
MEAN = FIRST_OWN + 34  # lines: mean rate of the positions over the step
CONSTRAINTS = FIRST_OWN + 35  # in model: CONSTRAINT_ENTRIES numbers each
SADDLE = FIRST_OWN + 36  # saddle-point matrix over all unknowns and multipliers
BLANK = FIRST_OWN + 37  # its constant entries
MULTIPLIERS = FIRST_OWN + 38  # unknowns and multipliers: right-hand side, then solution
RESPONSE = FIRST_OWN + 39  # per held row: unknowns and multipliers for a unit force on it
HELD_SYSTEM = FIRST_OWN + 40  # held x held: displacements of the held rows by unit forces on them
HOLDING_FORCE = FIRST_OWN + 41  # rows, held: reactions to the corrections
STEP_MOVED = FIRST_OWN + 42  # rows, held: MOVED of the step
CORRECTION = FIRST_OWN + 43  # lines
EIGHT_SIDES = FIRST_OWN + 44  # eight right-hand sides: eight numbers per unknown and multiplier
GOOD = FIRST_OWN + 45  # of eight cables: x, w and GOOD_ROWS rows at the last check they passed
BEFORE_MULTIPLIERS, BEHIND_MULTIPLIERS = FIRST_OWN + 46, FIRST_OWN + 47  # padding zeros
GOOD_STEP = 0  # first of the GOOD_ROWS: number of steps at that check
FAILED_STEP = 1  # number of steps at the check that a cable failed, 0 if none
GOOD_LEDGER = 2  # ENERGY_ERROR, EXCHANGED and FLOOR of the ledger
GOOD_ROWS = 5


def explicit_rooms(
    n: int, dim: int, held: int, size: int, constraints: int, stride: int
) -> dict[int, int]:
    """Sizes of the scratch arrays by offset."""
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
