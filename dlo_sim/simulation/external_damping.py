"""Damping from outside the cable, for every method, account and stability limit from this place.

Mass-proportional damping acts on all momenta. Air drag is a force per length and speed of the
centerline: it has no torque about it, so it leaves the twist alone. Where it depends on the
direction of motion, its part along the cable is here, and what it has more across the cable is
assembled with the forces (`engine.drag`).
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from dlo_sim.scene.description import Scene

Array = NDArray[np.float64]


def external_rates(scene: Scene) -> tuple[float, float]:
    """Rates [1/s] at which the momenta of the centerline and of the twist die away,
    alpha + c / mu and alpha; both 0 where damping is switched off.
    """
    if scene.terms.damping == "off":
        return 0.0, 0.0
    alpha = scene.damping.mass
    along = scene.damping.air_drag * scene.damping.air_drag_ratio
    return alpha + along / scene.cable.mu, alpha


def row_rates(scene: Scene, dim: int, rows: int) -> Array:
    """The rate of every row of a step of `dim` spatial rows, shape (rows,).

    Valid where drag and mass have the same shape: not beside a point mass, which `selection`
    (`_check_damping`) refuses for the explicit methods and rattle, the only ones that use them.
    """
    centerline, twist = external_rates(scene)
    return np.array([centerline] * dim + [twist] * (rows - dim))


def row_matrices(scene: Scene, masses: Array, gram: Array, dim: int) -> Array:
    """alpha M + c G of every row as lower diagonals, shape (rows, 4, n): G is the Gram matrix that
    the mass of the cable is made of, without point masses, and c is 0 for the twist.
    """
    centerline, alpha = external_rates(scene)
    matrices = alpha * masses
    matrices[:dim] += (centerline - alpha) * scene.cable.mu * gram
    return np.ascontiguousarray(matrices)
