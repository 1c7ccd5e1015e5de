"""Reactions: forces and moments of the end effectors on the cable."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from dlo_sim.core import bspline
from dlo_sim.engine.reaction import add_wrench
from dlo_sim.simulation.cable import Cable
from dlo_sim.simulation.model import Model

Array = NDArray[np.float64]
_NONE = np.zeros(0)  # tells `add_wrench` to take the reactions of the last steps, about the end


def reaction(cable: Cable, t: float, grasp: int) -> Array:
    """Force [N] and moment [N m] of an end effector on the cable, world frame, shape (6,).

    The moment is about the held point. The part of the constraint rows is the mean over the last
    two steps of an implicit method, from one to the next of which that of a stiff cable alternates
    after a jump; else the present value. The part of the springs is the present value.
    """
    points, wrench = cable.model.blank.copy(), np.zeros(6)
    about = (
        _NONE
        if grasp < 2 and cable.model.layout is None
        else _place_of(cable.model, grasp, cable.points, cable.slides)
    )
    if not cable.call(add_wrench, grasp, _NONE, points, about, wrench):
        cable.call(add_wrench, grasp, cable.held_force(t), points, about, wrench)
    return wrench


def _place_of(model: Model, grasp: int, points: Array, slides: Array) -> Array:
    """Point at which a grasp holds the cable [m], shape (3,).

    Zeros if it does not hold the cable.
    """
    at = model.geometries[list(model.scene.holders)[grasp]].u
    for slide, u in zip(model.holding.slides, slides, strict=True):
        at = u if slide.grasp == grasp else at
    if at is None or at < 0.0:
        return np.zeros(3)
    part = model.part_held(grasp)
    return np.asarray(bspline.evaluate(points[part.here, :3], part.model.knots, [at])[0])
