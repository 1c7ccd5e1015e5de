"""Reactions: what the end effectors do to the cable."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from dlo_sim.core import bspline
from dlo_sim.core.one_rotation import cross
from dlo_sim.engine import layout
from dlo_sim.simulation.cable import Cable
from dlo_sim.simulation.inextensible import held_force
from dlo_sim.simulation.model import Model

Array = NDArray[np.float64]
Wrench = tuple[float, float, float, float, float, float]


def reaction(cable: Cable, t: float, grasp: int, keeps_length: bool) -> Wrench:
    """Force [N] and moment about the point held [N m] by an end effector, world frame, six numbers,
    both on the cable.

    After a step of an implicit method it is the mean over that step, otherwise that of the instant.
    A row with the value F along its direction e does Q = F e on the quantity sum_k b_k x_k: it is a
    force (sum_k b_k) Q and a moment (sum_k b_k (x_k - x_e)) x Q about the point x_e. Springs
    count too, and so do the constraint forces of an inextensible cable (`keeps_length`).
    """
    model = cable.model
    if cable.entry(layout.HAS_REACTION):
        forces = model.rows(cable.state, layout.REACTION, len(model.holding.rows))[:, 0]
    else:
        forces = held_force(cable, t) if keeps_length else cable.held_force(t)
    force, moment = np.zeros(3), np.zeros(3)
    points = model.to_columns(cable.x)
    about_point = _place_of(model, grasp, points)
    axes, about = list(model.axes), 0.0
    for k, row in enumerate(model.holding.rows):
        if row.grasp != grasp:
            continue
        point = model.holding.points[row.point]
        if point.twist:
            about = float(forces[k])
            continue
        pull = np.zeros(3)
        if row.line < 0:
            pull[axes] = forces[k] * cable.direction(k)
        else:
            pull[axes[row.line]] = forces[k]
        weights = np.array(point.weights)
        force += weights.sum() * pull
        arm = weights @ (points[point.first : point.first + 4, :3] - about_point)
        moment += cross(arm.tolist(), pull.tolist())
    for k, spring in enumerate(model.holding.springs):
        if spring.grasp == grasp:
            seen = slice(spring.point.first, spring.point.first + 4)
            weights, pull = np.array(spring.point.weights), np.zeros(3)
            value = weights @ cable.x[spring.line, seen]
            size = spring.stiffness * (cable.anchors[k, 0] - value)
            if spring.line == len(axes):
                (tangent,) = bspline.evaluate(points[:, :3], model.knots, [spring.u], 1)
                moment += size * tangent / np.linalg.norm(tangent)
                continue
            pull[axes[spring.line]] = size
            if spring.tangent:
                moment += cross((weights @ points[seen, :3]).tolist(), pull.tolist())
            else:
                force += pull
    if about:
        first, second = (0, 1) if grasp == 0 else (-2, -1)
        tangent = points[second, :3] - points[first, :3]
        moment += about * tangent / np.linalg.norm(tangent)
    a, b, c, d, e, f = [*force.tolist(), *moment.tolist()]
    return a, b, c, d, e, f


def _place_of(model: Model, grasp: int, points: Array) -> Array:
    """Where an end effector holds the cable [m], shape (3,)."""
    if grasp < 2:
        return points[-grasp, :3]
    held = [model.holding.points[row.point] for row in model.holding.rows if row.grasp == grasp]
    held += [
        spring.point
        for spring in model.holding.springs
        if spring.grasp == grasp and not spring.tangent
    ]
    place = np.zeros(3)
    for point in held[:1]:
        place = np.array(point.weights) @ points[point.first : point.first + 4, :3]
    return place
