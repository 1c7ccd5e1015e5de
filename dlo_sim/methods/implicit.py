"""Implicit steps: one Newton loop for the energy-momentum method, the implicit midpoint rule and
the generalised-alpha method.

All three solve a momentum balance for q1, up to reactions of the grasps,
    M (a (q1 - q0) - b v0 - c a0) = f(q0, q1),
where f is minus the discrete gradient (`energy_momentum`) or the force at q0 + theta (q1 - q0),
plus loads and damping there. The midpoint rule and the energy-momentum method have theta = 1/2,
a = 2 / tau^2, b = 2 / tau, c = 0; `core.methods` has the generalised-alpha constants. Newton's
method uses the exact Jacobian, except for the dependence of the viscous forces on the geometry and
for the plastic flow within the step. A step that does not converge is rejected and repeated in
halves, quarters, ... of its length. The twist line is always integrated by the midpoint rule
(`methods.twist_step`).

Where a clamp turns, its reaction acts along its directions at the middle of the step, and its
constraints hold at the end: symmetric, and exact in the energy account.
"""

from __future__ import annotations

import numpy as np

from dlo_sim.compiling.lanes import LANES, bare, shifted, store
from dlo_sim.compiling.pieces import (
    COUNTS,
    NUMBERS,
    REAL,
    REALS,
    TABLE,
    TRUTH,
    WHOLE,
    Engine,
    part,
    piece,
)
from dlo_sim.engine import layout
from dlo_sim.engine.account import (
    COUNT,
    RESOLUTION,
    measure,
    notes_of,
    update_account,
)
from dlo_sim.engine.assembly import ANY, assembly, by_terms, flow
from dlo_sim.engine.bundles import CABLE, RECORDS, bared, bared_records
from dlo_sim.engine.held import (
    grasps_move,
)
from dlo_sim.engine.sampling import begin_sample, end_sample
from dlo_sim.methods.implicit_layout import (
    CHANGE,
    CORRECTIONS,
    INERTIA_WEIGHT,
    MASS_WEIGHT,
    MOST_CORRECTIONS,
    NEWMARK_BETA,
    NEWMARK_GAMMA,
    START,
    THETA,
    residual_of,
)
from dlo_sim.methods.newton import (
    apply_step,
    correct,
    dot,
    largest,
    moving,
    shortened,
    turned_over,
)
from dlo_sim.methods.step_begin import begin_step, undo_step
from dlo_sim.methods.step_end import finish_step
from dlo_sim.methods.step_equations import balance, newton_matrix, step_force
from dlo_sim.methods.twist_step import NO_TWIST, TWIST, TWIST_IN_FRAME

MAX_ITERATIONS = 40  # force evaluations before a step is halved
MAX_HALVINGS = 12
CAREFUL_HALVINGS = 4  # of a step that folds the cable over; after these the fold is accepted
SLOW = 0.02  # ratio of successive correction energies above which the matrix is renewed
STALLED = 0.2  # the same above which a correction counts as stalled
GROWTH = 1.0  # of the residual along a correction, above which the correction is shortened
SMALLEST_SHARE = 1e-6  # of a correction that shortening may leave
NOISE = 1e-9  # stalled corrections below this share of the coordinates are round-off
BUDGET = 300_000  # unknowns times iterations per step with all its parts: some 30 ms
LEAST_BUDGET = 500  # iterations per step
ROOM = 10.0  # error of the energy account in the long run, in tolerances
TIGHT = 1e-10  # tolerance of a step once that is reached
SAFETY = 10.0  # factor on the expected contraction
MOST_WITH_KEPT = 3  # iterations with a matrix of an earlier step; with a new one two are usual
MOST_SETBACKS = 5.0  # log2 of the longest wait [steps]
SMALLEST_SHRINKING = 1e-3  # lower bound on the measured contraction
FORGETTING = 1.5  # growth of the remembered contraction per step that does not measure it
ROUND_OFF = 1e-14  # corrections below this share of the coordinates are round-off


@part
def allowed_error(shape, state, tolerance, inertia):
    """Energy error [J] allowed in this step: `tolerance` times the energy exchanged so far, reduced
    to TIGHT times an energy scale as the error of the account approaches ROOM tolerances.

    The scale includes FLOOR and the work against inertia, so that a run can start at rest.
    """
    ledger = shape[layout.LEDGER]
    exchanged = state[ledger + layout.EXCHANGED * LANES]
    loose = tolerance * exchanged - state[ledger + layout.ENERGY_ERROR * LANES] / ROOM
    scale = max(exchanged, max(state[ledger + layout.FLOOR * LANES], 0.1 * inertia))
    return max(loose, min(tolerance, TIGHT) * scale)


@part
def weights(constants, newmark, tau):
    """theta, a, c of the momentum balance (b = a tau), and rate and g of the velocity that damping
    acts on: tau v = rate (q1 - q0) + (1 - rate) tau v0 + g tau^2 a0.
    """
    if not newmark:
        return 0.5, 2.0 / (tau * tau), 0.0, 1.0, 0.0
    theta, beta, gamma = constants[THETA], constants[NEWMARK_BETA], constants[NEWMARK_GAMMA]
    c = constants[INERTIA_WEIGHT] * (0.5 - beta) - constants[MASS_WEIGHT]
    rate = theta * gamma / beta
    g = theta * (1.0 - gamma) - rate * (0.5 - beta)
    return theta, constants[INERTIA_WEIGHT] / (tau * tau), c, rate, g


@part
def may_keep(shape, state, ledger, a):
    """Whether a step may start with the matrix of an earlier one: it has the same factor a of the
    mass, no wait is due (`judge_matrix`), and there are no border rows, whose part of the
    factorisation is in scratch and so is lost after its step.
    """
    made = state[ledger + layout.MATRIX_WEIGHT * LANES] == a
    return made and state[ledger + layout.MATRIX_WAIT * LANES] == 0.0 and not shape[layout.BORDER]


@part
def judge_matrix(state, ledger, iterations, made):
    """Decide whether the next steps reuse their matrix; `made` is the iteration in which the last
    matrix of this step was factorised, 0 if in an earlier step.

    If reuse cost more iterations than a new matrix would have, the next steps factorise their own:
    one step after the first such setback in a row, two after the second, then four, ...
    """
    shrinks = ledger + layout.MATRIX_SHRINKING * LANES
    wait, setbacks = ledger + layout.MATRIX_WAIT * LANES, ledger + layout.MATRIX_SETBACKS * LANES
    if made > 0:
        state[shrinks] = 1.0
    if made == 1:
        state[wait] = max(state[wait] - 1.0, 0.0)
    elif made > 1 or iterations > MOST_WITH_KEPT:
        state[wait] = 2.0 ** state[setbacks]
        state[setbacks] = min(state[setbacks] + 1.0, MOST_SETBACKS)
    else:
        state[setbacks] = 0.0
        if iterations == 1:
            state[shrinks] = min(FORGETTING * state[shrinks], 1.0)


PARTS = (begin_step, step_force, newton_matrix, finish_step)
PARTS_OF_STEP = (PARTS, ANY.gradient, ANY.tangent, ANY.flow, NO_TWIST)
"""The pieces of one implicit step, for its signature."""


@piece(
    *((TRUTH, WHOLE), TABLE, NUMBERS, NUMBERS, NUMBERS, NUMBERS, PARTS_OF_STEP),
    *(NUMBERS, REAL, REAL, REAL, TRUTH, REAL, TRUTH),
)
def implicit_step(
    shape,
    model,
    inputs,
    state,
    scratch,
    pieces,
    constants,
    t0,
    tau,
    whole,
    discrete,
    tolerance,
    careful,
):
    """One step in place; returns whether it converged, and the number of iterations. If not, x, w
    and the constraints of the state are restored.

    It is a part of a step of length `whole`, over which reactions are averaged. With `careful`, a
    step that folds the cable over (`turned_over`) counts as not converged.

    The matrix is reused, across steps too, while the iteration contracts fast (`judge_matrix`). It
    belongs to the state, so that a run continues bitwise identically from a snapshot.
    """
    _, parts, gradient, tangent, flows, twisting = pieces
    _, begin_step, step_force, newton_matrix, finish_step = parts
    _, step_twist, end_twist = twisting
    ledger = shape[layout.LEDGER]
    # The generalised-alpha method needs an initial acceleration: its first step is a midpoint step.
    dissipates = constants[THETA] != 0.5
    newmark = dissipates and state[ledger + layout.KNOWN * LANES] > 0.0
    theta, a, c, rate, g = weights(constants, newmark, tau)
    b = a * tau
    size = shape[layout.N] * shape[layout.DIM]
    x, start = shifted(state, shape[layout.X]), shifted(scratch, shape[START])
    change, residual = shifted(scratch, shape[CHANGE]), residual_of(shape, scratch)
    begin_step(shape, model, inputs, state, scratch, newmark, t0, tau, theta, rate, g)
    reach = largest(shape, x)  # scale of the round-off of corrections
    moves = grasps_move(shape, inputs)
    coupled = shape[layout.TERMS] & layout.BISHOP != 0
    converged = False
    iterations = 0
    previous = np.inf
    linearize = not may_keep(shape, state, ledger, a)
    shrinks = ledger + layout.MATRIX_SHRINKING * LANES
    made = 0  # iteration in which the matrix was factorised, 0: in an earlier step
    slope = 0.0  # |residual . correction| before the last correction
    share = 1.0  # of the last correction that x contains
    stalls = 0  # successive stalled corrections
    known = np.int64(0)  # corrections since the matrix was factorised
    lost, floor = 0.0, 0.0
    # Share of the flow at the configuration at which the forces of the step are evaluated.
    state[ledger + layout.SLIP * LANES] = 0.5 if discrete else 1.0
    while True:
        lost = step_force(
            shape, model, inputs, state, scratch, gradient, t0, tau, theta, rate, discrete
        )
        if coupled:
            anew = iterations == 0
            lost += step_twist(shape, model, inputs, state, scratch, t0, tau, discrete, anew)
        inertia = balance(shape, model, state, scratch, a, b, c)
        if converged or iterations == MAX_ITERATIONS:
            break
        iterations += 1
        if known > 0:
            last = shifted(scratch, shape[CORRECTIONS] + (known - 1) * (size + 1))
            along = dot(residual, last, size)
            if not abs(along) <= GROWTH * slope and share > SMALLEST_SHARE:
                # Overshoot: shorten the last correction and continue with a new matrix.
                less = share * shortened(slope, along)
                apply_step(shape, state, scratch, known - 1, less - share, x, change)
                share = less
                linearize = True
                continue
        if linearize or known == MOST_CORRECTIONS:
            if not newton_matrix(
                shape, model, inputs, state, scratch, tangent, t0, tau, a, theta, rate, discrete
            ):
                break
            known, made = np.int64(0), iterations
        energy, slope, defect, moved = correct(shape, state, scratch, known, x, change)
        known += 1
        if not energy < 1e300:
            break
        stalls = stalls + 1 if energy > STALLED * previous else 0
        # The correction is expected to reduce the energy error by the factor `shrinking`.
        shrinking = 1.0
        if share == 1.0 and iterations > 1:
            shrinking = max(np.sqrt(energy / previous), SMALLEST_SHRINKING)
            if iterations == 2:
                state[shrinks] = shrinking
        elif made == 0:
            shrinking = state[shrinks]
        share = 1.0
        exhausted = moved <= ROUND_OFF * reach or (stalls > 1 and moved <= NOISE * reach)
        allowed = allowed_error(shape, state, tolerance, inertia)
        converged = exhausted or min(SAFETY * shrinking, 1.0) * defect <= allowed
        if exhausted:
            # Corrections are round-off: the energy account cannot be more accurate than this.
            floor = RESOLUTION * defect
        # The work of moving grasps needs the forces, and the twist the shape, after the last
        # correction: one more evaluation, unless all is at rest.
        again = moves or coupled
        if converged and not (again and moving(shape, change, ROUND_OFF * reach)):
            break
        linearize = energy > SLOW * previous and not converged
        previous = energy
    judge_matrix(state, ledger, iterations, made)
    # Newton's method may converge to a cable folded through itself, with the same energy.
    if converged and careful:
        converged = not turned_over(shape, x, start, change)
    if converged:
        at = ledger + layout.FLOOR * LANES
        state[at] = max(state[at], floor)
        finish_step(
            shape, model, inputs, state, scratch, end_twist, constants, newmark,
            t0, tau, whole, lost, dissipates,
        )  # fmt: skip
        state[ledger + layout.SLIP * LANES] = 0.5  # the account takes the mean with all methods
        flow(flows, shape, model, inputs, state, scratch)
    else:
        undo_step(shape, state, scratch)
    state[ledger + layout.SLIP * LANES] = 0.0
    return converged, iterations


@part
def add_numerical_loss(shape, model, state, scratch):
    """Add the numerical dissipation of the method, known from the energy balance after `measure`,
    to DISSIPATED. Energy that the method adds remains an error."""
    at, notes = shape[layout.LEDGER], notes_of(shape, scratch)
    total = notes[0]
    for k in range(COUNT):
        total += state[at + (layout.ENERGY + k) * LANES]
    missing = state[at + layout.ENERGY_START * LANES] + state[at + layout.LOAD_WORK * LANES]
    missing += state[at + layout.DRIVE_WORK * LANES] - state[at + layout.DISSIPATED * LANES] - total
    if missing > 0.0:
        state[at + layout.DISSIPATED * LANES] += missing


@by_terms
def engine_of(terms: int) -> Engine:
    """The pieces that `advance_implicit` calls, for a scene with these bits."""
    _, energies, gradient, tangent, flows = assembly(terms)
    twisting = NO_TWIST
    if terms & layout.TWISTED:
        twisting = TWIST_IN_FRAME if terms & layout.BISHOP else TWIST
    pieces = PARTS, gradient, tangent, flows, twisting
    return Engine(energies, implicit_step, pieces, update_account, end_sample)


ENGINE = engine_of(0)  # of the type of all others


@piece(
    *(COUNTS, CABLE, ENGINE, REALS, REALS, TRUTH, REAL, WHOLE, WHOLE, WHOLE, REAL, RECORDS),
)
def advance_implicit(
    cable,
    engine,
    constants,
    substeps,
    discrete,
    tolerance,
    halvings,
    first_step,
    steps,
    tau,
    records,
):
    """Advance by whole steps; returns (status, steps done, Newton iterations).

    `substeps`: lengths of the substeps of a composition method, in units of the step.
    `halvings` (at most MAX_HALVINGS) is how often a step may be halved. The energy account is
    updated every step.
    """
    _, look, implicit_step, pieces, update, end_sample = engine.pieces
    parts = len(substeps)
    shape, model, inputs, state, scratch = bared(cable)
    records = bared_records(records)
    constants, substeps = bare(constants), bare(substeps)
    iterations = 0
    budget = max(BUDGET // (shape[layout.N] * shape[layout.DIM]), LEAST_BUDGET)
    whole = 1 << MAX_HALVINGS
    for step in range(first_step, first_step + steps):
        t0 = step * tau
        begun = iterations
        sampling = begin_sample(shape, model, inputs, state, scratch, records, t0, tau)
        for k in range(shape[layout.HELD]):
            store(state, shape[layout.REACTION] + k * LANES, 0.0)
        at = 0.0
        for k in range(parts):
            part_t, part_tau = t0 + at * tau, substeps[k] * tau
            # Halve where Newton's method does not converge.
            level, done = 0, 0  # `done` in units of 2^-MAX_HALVINGS of the substep
            while done < whole:
                one = whole >> level
                converged, used = implicit_step(
                    shape, model, inputs, state, scratch, pieces, constants,
                    part_t + part_tau * done / whole, part_tau * one / whole, tau,
                    discrete, tolerance, level < CAREFUL_HALVINGS,
                )  # fmt: skip
                iterations += used
                if converged:
                    done += one
                    # Double again only where the longer piece is aligned, so that pieces nest.
                    if level > 0 and done % (2 * one) == 0:
                        level -= 1
                elif level == halvings or iterations - begun > budget:
                    return layout.NOT_CONVERGED, step - first_step, iterations
                else:
                    level += 1
            at += substeps[k]
        if constants[THETA] != 0.5:
            measure(shape, model, state, scratch, look)
            add_numerical_loss(shape, model, state, scratch)
        if not update(shape, model, state, scratch, look):
            return layout.DIVERGED, step - first_step, iterations
        if sampling:
            end_sample(shape, model, inputs, state, scratch, look, update, records, t0, tau)
    return layout.OK, steps, iterations
