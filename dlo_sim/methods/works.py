"""Work of loads and grasps between evaluations of the forces, by the trapezoidal rule; work of a
grasp that turns the natural shape, by the change of energy.
"""

from __future__ import annotations

from numba import float64, types, void

from dlo_sim.compiling.groups import load
from dlo_sim.compiling.kernels import inline, kernel
from dlo_sim.compiling.lanes import LANES, lane_sum, zero
from dlo_sim.engine.account import measure, with_potentials
from dlo_sim.engine.arrays import CABLE
from dlo_sim.engine.assembly import all_forces
from dlo_sim.engine.lines import add, clear, copy, solve_mass
from dlo_sim.engine.loads import load_force
from dlo_sim.engine.rows import clear_moved, grasps_move, project, pulled
from dlo_sim.engine.springs import accept_anchors, anchor_work

NATURAL = types.Array(float64, 4, "C")  # values for `state.natural` that Python passes


@inline
def has_work(cable):
    """Whether loads or moving grasps do work on the cable."""
    return cable.loads.count > 0 or grasps_move(cable)


@inline
def force_work(force, x, before):
    """force . (x - before) over all lines [J]."""
    sum_ = zero()
    for line in range(x.shape[0]):
        for c in range(0, x.shape[1], LANES):
            sum_ += load(force, line, c) * (load(x, line, c) - load(before, line, c))
    return lane_sum(sum_)


@kernel(void, CABLE, float64)
def evaluate(cable, t):
    """Compute `work.force` = P M^-1 f at the present configuration, and add the work up to it to
    the energy balance.
    """
    state, work, balance = cable.state, cable.work, cable.state.balance
    x, counted = state.x, state.counted
    is_counted = balance.is_counted != 0.0
    works = has_work(cable)
    all_forces(cable, x, work.force)
    if cable.loads.count:
        clear(work.load)
        load_force(cable, x, t, work.load)
        add(1.0, work.load, work.force)
        if is_counted:
            done = force_work(work.load, x, counted) + force_work(state.loaded, x, counted)
            balance.load_work += 0.5 * done
        copy(work.load, state.loaded)
    solve_mass(cable, work.force)
    half = 0.0
    if works and is_counted:
        half = pulled(cable, state.moved)
    if cable.rows.count:
        project(cable, work.force, state.pull)
    if works:
        if is_counted:
            done = -0.5 * (half + pulled(cable, state.moved))
            if cable.rows.springs:
                done += anchor_work(cable, counted, x)
            balance.drive_work += done
        # The energy balance now contains all work up to the present configuration.
        copy(x, counted)
        clear_moved(cable)
        accept_anchors(cable)
        balance.is_counted = 1.0
        balance.pending = 0.0


@inline
def estimate_pending_work(cable):
    """Set `balance.pending` to the work since the last evaluation, with the forces of that
    evaluation: for steps that end in a drift.
    """
    if has_work(cable):
        state = cable.state
        done = -pulled(cable, state.moved)
        if cable.loads.count:
            done += force_work(state.loaded, state.x, state.counted)
        if cable.rows.springs:
            done += anchor_work(cable, state.counted, state.x)
        state.balance.pending = done


@inline
def turn_natural_shape(cable, rows, turn):
    """Set `state.natural` to `rows` (blocks, samples, 4, LANES), with each curvature vector rotated
    by the 3 x 3 matrix `turn` (9,); the change of energy is work of the grasps.
    """
    natural = cable.state.natural
    measure(cable)
    before = with_potentials(cable, 0.0)
    for b in range(natural.shape[0]):
        for j in range(natural.shape[1]):
            x, y, z = load(rows[b, j, 0], 0), load(rows[b, j, 1], 0), load(rows[b, j, 2], 0)
            for d in range(3):
                value = turn[3 * d] * x + turn[3 * d + 1] * y + turn[3 * d + 2] * z
                natural[b, j, d] = value
            natural[b, j, 3] = load(rows[b, j, 3], 0)
    measure(cable)
    cable.state.balance.drive_work += with_potentials(cable, 0.0) - before
