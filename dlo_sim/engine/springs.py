"""Rows that are held through a stiffness: k (target - sum_k b_k x_k) along an axis.

The target is where the grasp is; where grasps move, the anchors follow, and what that does is
booked as their work. A tangent is held likewise, with slopes b'_k and the grasp's direction d as
target: k/2 |r' - d|^2 is k (1 - cos) of the angle between them, as |r'| is all but 1. A roll is
held on the line of the twist, by the angle that the grasp prescribes.
"""

from __future__ import annotations

from dlo_sim.compiling.lanes import LANES, first, load, store, zero
from dlo_sim.compiling.pieces import part
from dlo_sim.engine import layout
from dlo_sim.engine.grasps import DIRECTION, MOTION_SIZE, place, turned
from dlo_sim.engine.held import component, component3
from dlo_sim.engine.tables import spring_first, spring_grasp, spring_line

ROLL_DAMPING = 0.5  # of a step


@part
def spring_place(shape, k):
    """Entry of a line array at which the four control points of spring row k begin."""
    point = spring_first(shape, k)
    line = spring_line(shape, k)
    return line * shape[layout.LINE] + (layout.MARGIN + point) * shape[layout.STRIDE]


@part
def spring_value(shape, model, k, x):
    """sum_k b_k x_k of spring row k."""
    at, stride = spring_place(shape, k), shape[layout.STRIDE]
    f = zero()
    for q in range(4):
        weight = load(model, shape[layout.SPRING] + (layout.SPRING_ROWS * k + q) * LANES)
        f += weight * load(x, at + q * stride)
    return f


@part
def stiffness_of(shape, model, k):
    """Stiffness [N/m], of a tangent or a roll [N m/rad]."""
    return load(model, shape[layout.SPRING] + (layout.SPRING_ROWS * k + 4) * LANES)


@part
def push(shape, model, k, f, out):
    """out += f on what spring row k holds. One cable's numbers stand at stride 1, one by one."""
    at, stride = spring_place(shape, k), shape[layout.STRIDE]
    for q in range(4):
        weight = shape[layout.SPRING] + (layout.SPRING_ROWS * k + q) * LANES
        to = at + q * stride
        if stride == 1:
            out[to] += model[weight] * first(f)
        else:
            store(out, to, load(out, to) + load(model, weight) * f)


@part
def spring_force(shape, model, state, x, share, rolling, out):
    """out += forces of the springs, with anchors at a share of the way that is still to be booked.

    share 1: where they are. `rolling`: those that hold the roll, else all others. Implicit steps
    take these at the end of the step, where a damping makes the moment of its middle that of its
    end (`roll_loss`): so a stiff one does not ring.
    """
    for k in range(shape[layout.SPRINGS]):
        if rolls(shape, k) != rolling:
            continue
        now, old = shape[layout.ANCHOR] + k * LANES, shape[layout.ANCHOR_BOOKED] + k * LANES
        anchor = load(state, old) + share * (load(state, now) - load(state, old))
        if share == 1.0:
            anchor = load(state, now)
        f = stiffness_of(shape, model, k) * (anchor - spring_value(shape, model, k, x))
        push(shape, model, k, f, out)


@part
def rolls(shape, k):
    """Whether spring row k holds the roll."""
    return spring_line(shape, k) == shape[layout.DIM]


@part
def roll_loss(shape, model, state, change):
    """Energy [J] that the damping of the springs that hold the roll takes in a step, ROLL_DAMPING
    times stiffness and step, and what of it moving anchors put in.
    """
    lost, driven = 0.0, 0.0
    for k in range(shape[layout.SPRINGS]):
        if rolls(shape, k):
            now, old = shape[layout.ANCHOR] + k * LANES, shape[layout.ANCHOR_BOOKED] + k * LANES
            moved = state[now] - state[old]
            behind = moved - first(spring_value(shape, model, k, change))
            moment = ROLL_DAMPING * first(stiffness_of(shape, model, k)) * behind
            lost += moment * behind
            driven += moment * moved
    return lost, driven


@part
def add_roll_stiffness(shape, model, matrix):
    """matrix += stiffness of springs that hold the roll, as four lower diagonals of n entries."""
    n = shape[layout.N]
    for k in range(shape[layout.SPRINGS]):
        if rolls(shape, k):
            at = shape[layout.SPRING] + layout.SPRING_ROWS * k * LANES
            begin = spring_first(shape, k)
            stiffness = model[at + 4 * LANES]
            for p in range(4):
                for q in range(p + 1):
                    value = model[at + p * LANES] * model[at + q * LANES]
                    matrix[(p - q) * n + begin + q] += stiffness * value


@part
def add_roll_change(shape, model, moved, out):
    """out += what a further change of the twist line does to their moments."""
    for k in range(shape[layout.SPRINGS]):
        if rolls(shape, k):
            stiffness = stiffness_of(shape, model, k)
            push(shape, model, k, -stiffness * spring_value(shape, model, k, moved), out)


@part
def spring_energy(shape, model, state, x):
    """Energy of the springs [J], a row."""
    f = zero()
    for k in range(shape[layout.SPRINGS]):
        apart = spring_value(shape, model, k, x) - load(state, shape[layout.ANCHOR] + k * LANES)
        f += 0.5 * stiffness_of(shape, model, k) * apart * apart
    return f


@part
def target_of(shape, model, inputs, state, k, t):
    """What spring row k pulls to at time t: its grasp's angle, a coordinate of its place, or of its
    direction.
    """
    grasp = shape[layout.MOTION] + MOTION_SIZE * spring_grasp(shape, k)
    if rolls(shape, k):
        angle = place(inputs, grasp, t)[3]
        if shape[layout.TERMS] & layout.BISHOP:
            angle += state[shape[layout.FRAME_TURN] + spring_grasp(shape, k) * LANES]
        return angle
    axis = shape[layout.AXES + spring_line(shape, k)]
    if model[shape[layout.SPRING] + (layout.SPRING_ROWS * k + 5) * LANES] == 0.0:
        d = grasp + DIRECTION
        direction = turned(inputs, grasp, t, inputs[d], inputs[d + 1], inputs[d + 2])
        return component3(direction, axis)
    return component(place(inputs, grasp, t), axis)


@part
def move_anchors(shape, model, inputs, state, t):
    """Let the springs of grasps that move pull to where these are at time t."""
    for k in range(shape[layout.SPRINGS]):
        if inputs[shape[layout.MOTION] + MOTION_SIZE * spring_grasp(shape, k)] != 0.0:
            target = target_of(shape, model, inputs, state, k, t)
            store(state, shape[layout.ANCHOR] + k * LANES, target)


@part
def anchor_work(shape, model, state, x0, x1):
    """Work done on the springs by anchors that moved while the cable moved from x0 to x1, a row:
    k (mean anchor - mean value) . (change of the anchor), exact for straight and even motion.
    """
    done = zero()
    for k in range(shape[layout.SPRINGS]):
        now = load(state, shape[layout.ANCHOR] + k * LANES)
        old = load(state, shape[layout.ANCHOR_BOOKED] + k * LANES)
        value = spring_value(shape, model, k, x0) + spring_value(shape, model, k, x1)
        done += 0.5 * stiffness_of(shape, model, k) * (now - old) * (now + old - value)
    return done


@part
def book_anchors(shape, state):
    """Nothing that anchors did is left to be booked."""
    for at in range(shape[layout.SPRINGS] * LANES):
        state[shape[layout.ANCHOR_BOOKED] + at] = state[shape[layout.ANCHOR] + at]


@part
def restore_anchors(shape, state):
    """Anchors as they were when work was booked last."""
    for at in range(shape[layout.SPRINGS] * LANES):
        state[shape[layout.ANCHOR] + at] = state[shape[layout.ANCHOR_BOOKED] + at]
