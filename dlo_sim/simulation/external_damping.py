"""Damping from outside the cable, the same for all methods, the account and stability limits.

Mass-proportional damping acts on all momenta. Air drag is a force per length and speed of the
centerline. It has no torque about the centerline, so it does not damp twist. If the drag depends on
the direction of motion, only the coefficient along the cable is used here; the excess across the
cable is assembled with the forces (`engine.drag`).
"""

from __future__ import annotations

from dlo_sim.scene.description import Scene


def external_rates(scene: Scene) -> tuple[float, float]:
    """Decay rates [1/s] of the momenta of centerline and twist, alpha + c / mu and alpha.

    c is the air drag along the cable. Both are 0 if terms.damping is off.
    """
    if scene.terms.damping == "off":
        return 0.0, 0.0
    alpha = scene.damping.mass
    along = scene.damping.air_drag * scene.damping.air_drag_ratio
    return alpha + along / scene.cable.mu, alpha
