"""When a twisted cable would coil: twist and bending are not coupled here, so it does not."""

from __future__ import annotations

import math

from dlo_sim.kernels import layout
from dlo_sim.scene.description import Scene
from dlo_sim.simulation.model import Model


def coiling_warning(scene: Scene, model: Model, state: layout.State) -> str:
    """One line if the twisting moment exceeds that of a straight cable's buckling; empty otherwise.

    A straight cable of length L without tension coils under a moment of 2 pi EI / L (Greenhill
    1883, ends free to turn); tension T raises that to 2 sqrt(EI (T + (pi / L)^2 EI)). The moment
    is GJ times the mean of theta', the tension that of the mean stretch; slack counts as none.
    """
    row = model.twist_row
    if row is None or model.terms.frenet is not None:
        return ""
    cable, n = scene.cable, model.n
    theta = state.position[row]
    moment = abs(theta[n - 1] - theta[0]) * cable.GJ / cable.length
    points = state.position[: len(model.axes), :n]
    stretched = math.dist(points[:, 0], points[:, -1]) / cable.length
    tension = cable.EA * max(stretched - 1.0, 0.0)
    limit = 2.0 * math.sqrt(cable.EI * (tension + (math.pi / cable.length) ** 2 * cable.EI))
    if moment <= limit:
        return ""
    return (
        f"twisting moment of {moment:.3g} N m: a straight cable would coil from {limit:.3g} N m, "
        f"which this model does not show; turn the ends less"
    )
