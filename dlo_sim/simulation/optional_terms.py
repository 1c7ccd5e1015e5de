"""Terms that only some scenes ask for: which combinations exist."""

from __future__ import annotations

from dlo_sim.core.methods import CONSTRAINED, IMPLICIT, RUNGE_KUTTA, SPLITTING, ZHAI, Method
from dlo_sim.scene.description import Scene
from dlo_sim.scene.loading import SceneError
from dlo_sim.scene.needs import Needs, frenet_wanted, inextensible, plasticity_wanted


def check_terms(scene: Scene, needs: Needs) -> None:
    """Refuse terms, and combinations of them, that have no meaning here.

    Raises:
        SceneError: naming the key and the cure.
    """
    if scene.terms.contact == "on" and not (scene.bodies or scene.contact.markers):
        raise SceneError("terms.contact: 'on' needs obstacles; name one in obstacles.names")
    if scene.terms.stretch == "on" and inextensible(scene):
        raise SceneError(
            "terms.stretch: 'on' contradicts integrator.method rattle, whose constraints keep the "
            "length; set terms.stretch to auto or use another method"
        )
    if scene.terms.out_of_plane == "off" and len(needs.axes) == 3:
        if needs.frenet or needs.plasticity:
            raise SceneError(
                "terms.out_of_plane: 'off' is not available with Frenet torsion or plasticity; set "
                "it to auto"
            )
        raise SceneError(
            "terms.out_of_plane: 'off' needs ends that lie, and point, in one coordinate plane; "
            "move them or set it to auto"
        )
    if needs.plasticity and not scene.plasticity.yield_curvature:
        raise SceneError(
            "terms.plasticity: 'on' needs plasticity.yield_curvature above 0; give one or set "
            "terms.plasticity off"
        )
    if needs.plasticity and not needs.bend:
        raise SceneError(
            "terms.plasticity: bends nothing, since terms.bend is off; set one of them"
        )
    constrained = inextensible(scene) and scene.integrator.method == "auto"
    if scene.terms.twist == "quasistatic" and constrained:
        raise SceneError(
            "terms.twist: quasistatic is not available together with terms.stretch off; set it to "
            "auto, or terms.twist to bishop"
        )
    if any(scene.cable.rest_twist) and not needs.bishop:
        raise SceneError(
            f"cable.rest_twist: {list(scene.cable.rest_twist)} needs the twist that acts on the "
            "shape; set terms.twist to auto"
        )


def check_method(scene: Scene, method: Method) -> None:
    """Refuse a method that does not know the scene's terms.

    Raises:
        SceneError: naming the key and the cure.
    """
    if method.family == CONSTRAINED and scene.measured.type != "none":
        raise SceneError(
            f"measured.type: {scene.measured.type} is not available with integrator.method "
            f"{method.name}, whose constraints a correction breaks; use energy_momentum"
        )
    if scene.terms.contact != "off" and len(method.substeps) > 1 or method.family == CONSTRAINED:
        rubbing = [o.name for o in scene.bodies if scene.friction_of(o) > 0.0]
        key = f"friction of obstacle {rubbing[0]}" if rubbing else "contact.damping"
        if rubbing or (scene.bodies and scene.contact.damping > 0.0):
            raise SceneError(
                f"integrator.method: {method.name} is not available with {key}, since its steps "
                "cannot dissipate in contact; use energy_momentum, or set it to 0.0"
            )
    if scene.contact.markers and (method.family != IMPLICIT or len(method.substeps) > 1):
        raise SceneError(
            f"integrator.method: {method.name} is not available with contact.markers "
            f"{scene.contact.markers}, since obstacles that come later may be stiffer than its "
            "steps allow; use energy_momentum, and do not set terms.stretch off"
        )
    if scene.terms.twist == "quasistatic" and method.family != IMPLICIT:
        raise SceneError(
            f"terms.twist: quasistatic is not available with integrator.method {method.name}; use "
            "energy_momentum, or bishop"
        )
    if method.family in (SPLITTING, RUNGE_KUTTA, ZHAI):
        return
    if frenet_wanted(scene):
        raise SceneError(
            f"integrator.method: {method.name} does not know terms.twist frenet; use "
            "velocity_verlet, rk4 or forest_ruth"
        )
    if plasticity_wanted(scene) and (method.family == CONSTRAINED or len(method.substeps) > 1):
        raise SceneError(
            f"integrator.method: {method.name} is not available with plasticity.yield_curvature "
            f"{scene.plasticity.yield_curvature:g}; use energy_momentum, velocity_verlet or rk4"
        )
