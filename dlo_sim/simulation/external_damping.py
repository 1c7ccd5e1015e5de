"""Damping from outside the cable, for every method, account and stability limit from this place.

Mass-proportional damping acts on all momenta. Air drag is a force per length and speed of the
centerline: it has no torque about it, so it leaves the twist alone. Where it depends on the
direction of motion, its part along the cable is here, and what it has more across the cable is
assembled with the forces (`engine.drag`).
"""

from __future__ import annotations

from dlo_sim.scene.description import Scene


def external_rates(scene: Scene) -> tuple[float, float]:
    """Rates [1/s] at which the momenta of the centerline and of the twist die away,
    alpha + c / mu and alpha; both 0 where damping is switched off.
    """
    if scene.terms.damping == "off":
        return 0.0, 0.0
    alpha = scene.damping.mass
    along = scene.damping.air_drag * scene.damping.air_drag_ratio
    return alpha + along / scene.cable.mu, alpha
