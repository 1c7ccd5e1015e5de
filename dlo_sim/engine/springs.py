"""Spring rows, by which a compliant grasp holds the cable: force k (anchor - sum_q b_q x_q).

A position spring acts along one axis, and its anchor is the attachment point of the grasp. A
tangent spring has the slopes b'_q, and its anchor is the grasp's direction d: its energy
k/2 |r' - d|^2 is k (1 - cos) of the angle between them, since |r'| is close to 1. A roll spring
acts on the twist angle; its anchor is the prescribed angle. The work of moving anchors belongs to
the work of the grasps in the energy ledger.
"""

from __future__ import annotations

from dlo_sim.compiling.lanes import LANES, first, load, store, zero
from dlo_sim.compiling.pieces import part
from dlo_sim.engine import layout
from dlo_sim.engine.grasps import DIRECTION, MOTION_SIZE, place, turned
from dlo_sim.engine.held import component, component3
from dlo_sim.engine.tables import spring_first, spring_grasp, spring_line

ROLL_DAMPING = 0.5  # damping over stiffness, in units of the step


@part
def spring_place(shape, k):
    """Index in an array of lines of the first of the four coordinates of spring row k."""
    point = spring_first(shape, k)
    line = spring_line(shape, k)
    return line * shape[layout.LINE] + (layout.MARGIN + point) * shape[layout.STRIDE]


@part
def spring_value(shape, model, k, x):
    """sum_q b_q x_q of spring row k."""
    at, stride = spring_place(shape, k), shape[layout.STRIDE]
    f = zero()
    for q in range(4):
        weight = load(model, shape[layout.SPRING] + (layout.SPRING_ROWS * k + q) * LANES)
        f += weight * load(x, at + q * stride)
    return f


@part
def stiffness_of(shape, model, k):
    """Stiffness: [N/m] for a position, [N m/rad] for a tangent or a roll."""
    return load(model, shape[layout.SPRING] + (layout.SPRING_ROWS * k + 4) * LANES)


@part
def push(shape, model, k, f, out):
    """out += b_q f on the four coordinates of spring row k."""
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
    """out += forces of the springs, with anchors at ANCHOR_BOOKED + share (ANCHOR - ANCHOR_BOOKED).

    `rolling` selects the roll springs, else all others. Implicit steps evaluate roll springs at the
    end of the step, which equals the midpoint rule with damping of half a step (`roll_loss`): a
    stiff one then does not ring.
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
    """Whether spring row k is a roll spring."""
    return spring_line(shape, k) == shape[layout.DIM]


@part
def roll_loss(shape, model, state, change):
    """Energy [J] dissipated in a step by the damping of the roll springs (damping coefficient
    ROLL_DAMPING times stiffness times step), and the work [J] of the anchors against it.
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
    """matrix += stiffness of the roll springs; four lower diagonals of n entries each."""
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
    """out += change of the moments of the roll springs by a change `moved` of the twist line."""
    for k in range(shape[layout.SPRINGS]):
        if rolls(shape, k):
            stiffness = stiffness_of(shape, model, k)
            push(shape, model, k, -stiffness * spring_value(shape, model, k, moved), out)


@part
def spring_energy(shape, model, state, x):
    """Elastic energy of the springs [J], a row."""
    f = zero()
    for k in range(shape[layout.SPRINGS]):
        apart = spring_value(shape, model, k, x) - load(state, shape[layout.ANCHOR] + k * LANES)
        f += 0.5 * stiffness_of(shape, model, k) * apart * apart
    return f


@part
def target_of(shape, model, inputs, state, k, t):
    """Anchor of spring row k at time t: twist angle of its grasp [rad], or one coordinate of its
    attachment point [m] or of its direction.
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
    """Set the anchors of moving grasps to their values at time t."""
    for k in range(shape[layout.SPRINGS]):
        if inputs[shape[layout.MOTION] + MOTION_SIZE * spring_grasp(shape, k)] != 0.0:
            target = target_of(shape, model, inputs, state, k, t)
            store(state, shape[layout.ANCHOR] + k * LANES, target)


@part
def anchor_work(shape, model, state, x0, x1):
    """Work [J] of the moving anchors while the cable moves from x0 to x1, a row:
    k (mean anchor - mean value) (change of the anchor), exact if both change linearly in time.
    """
    done = zero()
    for k in range(shape[layout.SPRINGS]):
        now = load(state, shape[layout.ANCHOR] + k * LANES)
        old = load(state, shape[layout.ANCHOR_BOOKED] + k * LANES)
        value = spring_value(shape, model, k, x0) + spring_value(shape, model, k, x1)
        done += 0.5 * stiffness_of(shape, model, k) * (now - old) * (now + old - value)
    return done


@part
def accept_anchors(shape, state):
    """ANCHOR_BOOKED = ANCHOR: the ledger contains the work of the anchors up to here."""
    for at in range(shape[layout.SPRINGS] * LANES):
        state[shape[layout.ANCHOR_BOOKED] + at] = state[shape[layout.ANCHOR] + at]


@part
def restore_anchors(shape, state):
    """ANCHOR = ANCHOR_BOOKED: take back the motion of the anchors in a rejected step."""
    for at in range(shape[layout.SPRINGS] * LANES):
        state[shape[layout.ANCHOR] + at] = state[shape[layout.ANCHOR_BOOKED] + at]
