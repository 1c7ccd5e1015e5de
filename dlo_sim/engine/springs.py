"""Springs: constraint rows that give, by which a compliant grasp holds the cable, and flexible
joints between branches: force k (anchor - sum_q b_q x_q) along a line.

The anchor is the row's target. A position spring acts along one axis, and its anchor is the
attachment point of the grasp. A tangent spring has the slopes b'_q, and its anchor is the grasp's
direction d: its energy k/2 |r' - d|^2 is k (1 - cos) of the angle between them, since |r'| is close
to 1. A roll spring acts on the twist angle; its anchor is the prescribed angle. A joint has the
anchor zero. The work of moving anchors belongs to the work of the grasps in the energy balance.
"""

from __future__ import annotations

from numba import boolean, float64, void

from dlo_sim.compiling.kernels import inline, kernel
from dlo_sim.engine.arrays import CABLE, LINES, MARGIN, SPRUNG
from dlo_sim.engine.grasps import moves
from dlo_sim.engine.rows import point_value, target_of

ROLL_DAMPING = 0.5  # damping over stiffness, in units of the step


@inline
def rolls(cable, k):
    """Whether row k acts on the twist angle."""
    return cable.rows.line[k] == cable.dim


@inline
def spring_value(cable, k, x):
    """sum_q b_q x_q of the spring in row k."""
    return point_value(cable, cable.rows.point[k], cable.rows.line[k], x)


@inline
def push(cable, k, f, out):
    """out += b_q f on the coordinates of the spring in row k."""
    points, point, line = cable.points, cable.rows.point[k], cable.rows.line[k]
    for q in range(4):
        out[line, MARGIN + points.first[point] + q] += points.weights[point, q] * f
    if points.other[point] >= 0:
        for q in range(4):
            out[line, MARGIN + points.other[point] + q] += points.other_weights[point, q] * f


@kernel(void, CABLE, LINES, float64, boolean, LINES, terms=SPRUNG)
def spring_force(cable, x, share, rolling, out):
    """out += forces of the springs, with anchors at the share `share` of their motion in the step.

    `rolling` selects the roll springs, else all others. Implicit steps evaluate roll springs at the
    end of the step, which equals the midpoint rule with damping of half a step (`roll_loss`): a
    stiff one then does not ring.
    """
    now, old = cable.state.anchor, cable.state.anchor_counted
    for k in range(cable.rows.count, cable.rows.count + cable.rows.springs):
        if rolls(cable, k) != rolling:
            continue
        anchor = now[k] if share == 1.0 else old[k] + share * (now[k] - old[k])
        f = cable.rows.stiffness[k] * (anchor - spring_value(cable, k, x))
        push(cable, k, f, out)


@inline
def roll_loss(cable, change):
    """Energy [J] dissipated in a step by the damping of the roll springs (damping coefficient
    ROLL_DAMPING times stiffness times step), and the work [J] of the anchors against it.
    """
    state = cable.state
    lost, driven = 0.0, 0.0
    for k in range(cable.rows.count, cable.rows.count + cable.rows.springs):
        if rolls(cable, k):
            moved = state.anchor[k] - state.anchor_counted[k]
            behind = moved - spring_value(cable, k, change)
            moment = ROLL_DAMPING * cable.rows.stiffness[k] * behind
            lost += moment * behind
            driven += moment * moved
    return lost, driven


@kernel(float64, CABLE, LINES, terms=SPRUNG)
def spring_energy(cable, x):
    """Elastic energy of the springs [J]."""
    energy = 0.0
    for k in range(cable.rows.count, cable.rows.count + cable.rows.springs):
        apart = spring_value(cable, k, x) - cable.state.anchor[k]
        energy += 0.5 * cable.rows.stiffness[k] * apart * apart
    return energy


@kernel(void, CABLE, terms=SPRUNG)
def move_anchors(cable):
    """Set the anchors of moving grasps to their values in `work.held`."""
    for k in range(cable.rows.count, cable.rows.count + cable.rows.springs):
        grasp = cable.rows.grasp[k]
        if grasp >= 0 and moves(cable.inputs.motion[grasp]):
            cable.state.anchor[k] = target_of(cable, k)


@kernel(void, CABLE, terms=SPRUNG)
def put_anchors(cable):
    """Set all anchors to their values in `work.held`, without work."""
    for k in range(cable.rows.count, cable.rows.count + cable.rows.springs):
        cable.state.anchor[k] = target_of(cable, k)
    accept_anchors(cable)


@kernel(float64, CABLE, LINES, LINES, terms=SPRUNG)
def anchor_work(cable, x0, x1):
    """Work [J] of the moving anchors while the cable moves from x0 to x1:
    k (mean anchor - mean value) (change of the anchor), exact if both change linearly in time.
    """
    done = 0.0
    for k in range(cable.rows.count, cable.rows.count + cable.rows.springs):
        now, old = cable.state.anchor[k], cable.state.anchor_counted[k]
        value = spring_value(cable, k, x0) + spring_value(cable, k, x1)
        done += 0.5 * cable.rows.stiffness[k] * (now - old) * (now + old - value)
    return done


@inline
def accept_anchors(cable):
    """The energy account contains the work of the anchors up to their present values."""
    for k in range(cable.rows.count, cable.rows.count + cable.rows.springs):
        cable.state.anchor_counted[k] = cable.state.anchor[k]


@inline
def restore_anchors(cable):
    """Take back the motion of the anchors in a rejected step."""
    for k in range(cable.rows.count, cable.rows.count + cable.rows.springs):
        cable.state.anchor[k] = cable.state.anchor_counted[k]
