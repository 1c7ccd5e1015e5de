"""A warning for scenes whose cable would coil under torsion although their model cannot show it."""

from __future__ import annotations

import math

from dlo_sim.engine.arrays import BISHOP, TORSION
from dlo_sim.scene.description import Scene
from dlo_sim.simulation.cable import Cable


def coiling_warning(scene: Scene, cable: Cable) -> str:
    """One line if the twisting moment exceeds the buckling moment of a straight cable, else empty.

    A straight cable of length L without tension coils under a moment of 2 pi EI / L (Greenhill
    1883, ends free to turn); tension T raises it to 2 sqrt(EI (T + (pi / L)^2 EI)). The moment is
    GJ times the mean of theta'. T is EA times the strain of the chord, zero for a slack cable.
    Always empty if twist acts on the shape.
    """
    model, material = cable.model, scene.cable
    if not model.twist or model.has(TORSION) or model.has(BISHOP):
        return ""
    theta, points = cable.x[-1], cable.x[:-1]
    moment = abs(theta[-1] - theta[0]) * material.GJ / material.length
    stretched = math.dist(points[:, 0], points[:, -1]) / material.length
    tension = material.EA * max(stretched - 1.0, 0.0)
    limit = 2.0 * math.sqrt(
        material.EI * (tension + (math.pi / material.length) ** 2 * material.EI)
    )
    if moment <= limit:
        return ""
    return (
        f"twisting moment of {moment:.3g} N m: a straight cable would coil from {limit:.3g} N m, "
        f"which only twist that acts on the shape shows; set terms.twist to auto, or turn the ends "
        f"less"
    )
