"""Reactions: what the end effectors do to the cable."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from dlo_sim.engine import layout
from dlo_sim.engine.reaction import add_wrench
from dlo_sim.simulation.cable import Cable
from dlo_sim.simulation.inextensible import held_force
from dlo_sim.simulation.model import Model

Array = NDArray[np.float64]


def reaction(cable: Cable, t: float, grasp: int, keeps_length: bool) -> Array:
    """Force [N] and moment about the point held [N m] by an end effector, world frame, both on the
    cable, shape (6,).

    After a step of an implicit method it is the mean over that step, otherwise that of the instant.
    Springs count with what they do at its end, and so do the constraint forces of an inextensible
    cable (`keeps_length`).
    """
    model = cable.model
    if cable.entry(layout.HAS_REACTION):
        rows = model.rows(cable.state, layout.REACTION, len(model.holding.rows))[:, 0].copy()
    else:
        rows = held_force(cable, t) if keeps_length else cable.held_force(t)
    points = model.to_columns(cable.x)
    about = points[-grasp, :3] if grasp < 2 else _place_of(model, grasp, points)
    wrench = np.zeros(6)
    add_wrench(cable.arrays, grasp, rows, points, about, wrench)
    return wrench


def _place_of(model: Model, grasp: int, points: Array) -> Array:
    """Where a grasp holds the cable [m], shape (3,); moments are the same about any place if it
    holds only a direction.
    """
    held = [model.holding.points[row.point] for row in model.holding.rows if row.grasp == grasp]
    held += [spring.point for spring in model.holding.springs if spring.grasp == grasp]
    places = [point for point in held if abs(sum(point.weights)) > 0.5]
    if not places:
        return np.zeros(3)
    return np.array(places[0].weights) @ points[places[0].first : places[0].first + 4, :3]
