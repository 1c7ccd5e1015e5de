"""Scratch of the implicit step."""

from __future__ import annotations

from dlo_sim.compiling.lanes import LANES, shifted
from dlo_sim.compiling.pieces import part
from dlo_sim.engine.band import PADDING
from dlo_sim.engine.layout import FIRST_OWN
from dlo_sim.engine.tangent import MOMENT_ROWS, SAMPLE_ROWS

MOST_CORRECTIONS = 14  # of one step with one matrix
THETA, MASS_WEIGHT, NEWMARK_BETA, NEWMARK_GAMMA, INERTIA_WEIGHT = 0, 1, 2, 3, 4  # of `constants`

START = FIRST_OWN  # lines: configuration at the start of the step
START_V = FIRST_OWN + 1  # lines: velocity there
CHANGE = FIRST_OWN + 2  # lines: q1 - q0
MIDDLE = FIRST_OWN + 3  # lines: configuration at theta
SEEN = FIRST_OWN + 4  # lines: tau times the velocity that damping acts on, rate CHANGE + SEEN_FIXED
SEEN_FIXED = FIRST_OWN + 5  # lines: the part of it that stays constant during the iteration
DAMPING_FORCE = FIRST_OWN + 6  # lines
INERTIA = FIRST_OWN + 7  # lines: M (a CHANGE - b velocity - c acceleration)
TWIST_LATEST = FIRST_OWN + 8  # lines
TWIST_REST = FIRST_OWN + 9  # lines
TWIST_SUM = FIRST_OWN + 10  # lines
LINES_HERE = 11
BAND = FIRST_OWN + 11  # matrix over all unknowns, for `methods.between_steps`
RESIDUAL_ROOM = FIRST_OWN + 12  # all unknowns between padding zeros (`residual_of`)
BALANCE = FIRST_OWN + 13  # all unknowns: right-hand side of the last correction
STEP = FIRST_OWN + 14  # all unknowns: a correction in world coordinates
CORRECTIONS = FIRST_OWN + 15  # corrections s with the present matrix, each with 1 / |s|^2
FACTORS_OF_SAMPLES = FIRST_OWN + 16  # `engine.tangent`
TWIST_MATRIX = FIRST_OWN + 17  # 7 n
OLD_DIRECTION = FIRST_OWN + 18  # DIRECTION at the start of the step
OLD_INVERSE = FIRST_OWN + 19  # INVERSE at the start of the step
MIDDLE_DIRECTION = FIRST_OWN + 20  # directions at the middle of the step
FORCE_OF_HELD = FIRST_OWN + 21  # rows, held: reactions
TRAVEL = FIRST_OWN + 23  # lines: P (q1 - q0), the change of the free motion
TWIST_HELD = FIRST_OWN + 22  # n: 1 where the twist is held
TWIST_OWN = FIRST_OWN + 24  # lines: moments except those of GJ and natural curvature


@part
def residual_of(shape, scratch):
    """The residual over all unknowns, padded for `band.substitute`."""
    return shifted(scratch, shape[RESIDUAL_ROOM] + PADDING)


def band_room(n: int, dim: int) -> int:
    """Entries of a band matrix over all unknowns, and of what whole vectors read past its end."""
    return n * dim * 16 * (dim - 1) + 16 * LANES


def implicit_rooms(n: int, dim: int, samples: int, held: int, size: int) -> dict[int, int]:
    """Sizes of the scratch arrays by offset."""
    unknowns = n * dim
    rooms = dict.fromkeys(range(START, START + LINES_HERE), size)
    directions = held * 4 * LANES
    return rooms | {
        BAND: band_room(n, dim),
        RESIDUAL_ROOM: unknowns + 2 * PADDING,
        BALANCE: unknowns,
        STEP: unknowns,
        CORRECTIONS: MOST_CORRECTIONS * (unknowns + 1),
        FACTORS_OF_SAMPLES: (samples * SAMPLE_ROWS + MOMENT_ROWS + 1) * LANES,
        TWIST_MATRIX: 7 * n,
        OLD_DIRECTION: directions,
        OLD_INVERSE: held * held * LANES,
        MIDDLE_DIRECTION: directions,
        FORCE_OF_HELD: held * LANES,
        TWIST_HELD: n,
        TRAVEL: size,
        TWIST_OWN: size,
    }
