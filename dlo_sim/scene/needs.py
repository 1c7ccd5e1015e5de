"""The terms of the model that a scene needs, decided here alone, and why the others are absent."""

from __future__ import annotations

import math
from collections.abc import Iterator
from dataclasses import dataclass, field, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from dlo_sim.scene.description import Scene
from dlo_sim.scene.refusal import SceneError, refusal
from dlo_sim.scene.terms import (
    IMPLICIT_METHODS,
    KEEPING_LENGTH,
    TERMS,
    Term,
    restrictions_of,
)

Vector = NDArray[np.float64]
_SPACE = (0, 1, 2)


@dataclass(frozen=True)
class Needs:
    """Which terms a scene's step contains; `"contact" in needs` asks for one.

    Attributes:
        active: names of the terms, in the order of `terms.TERMS`, with variants beside `twist`:
            `frenet` (relative to the Frenet torsion), `bishop` (relative to the Bishop frame, acts
            on the shape), `quasistatic` (without rotary inertia about the axis).
        axes: world axes of the motion: all three, or the two of a coordinate plane.
        twist_model: as in `terms.twist`, also of twist that comes later; off if there can be none.
        left_out: name of each absent term -> reason.
        warnings: one line for each term that is switched off although the scene needs it: the key,
            the loss, the cure. Not part of comparisons.
    """

    active: tuple[str, ...]
    axes: tuple[int, ...]
    twist_model: str
    left_out: dict[str, str]
    warnings: tuple[str, ...] = field(default=(), compare=False)

    def __contains__(self, term: str) -> bool:
        return term in self.active

    def with_contact(self, present: bool) -> Needs:
        """These needs with obstacles that the cable touches, or without any."""
        if present == ("contact" in self):
            return self
        if present:
            return self._with("contact")
        active = tuple(name for name in self.active if name != "contact")
        reasons = self.left_out | {"contact": _ROWS["contact"].absent}
        return replace(self, active=active, left_out=reasons)

    def with_drive(self) -> Needs:
        """These needs with prescribed motion of ends or grasps."""
        return self._with("drive")

    def in_plane(self, scene: Scene) -> Needs:
        """These needs once something acts out of their plane, which `terms.out_of_plane: off` drops
        with a warning.

        Raises:
            ValueError: the scene left the plane open.
        """
        if scene.terms.out_of_plane == "off":
            return self._with_warning(_warning_of_plane(self.axes))
        raise ValueError(
            f"terms.out_of_plane: auto keeps a cable that hangs taut in {_plane(self.axes)}, and "
            "this leads out of it; set it to on"
        )

    def twisted(self, scene: Scene) -> Needs:
        """These needs once something twists the cable, which one without twist only warns of."""
        line = "" if "twist" in self else _warning_of_twist(scene)
        return self._with_warning(line) if line else self

    def _with(self, *names: str, **changes: Any) -> Needs:
        """These needs with more terms, or with a reason less to leave one out."""
        reasons = {key: why for key, why in self.left_out.items() if key not in names}
        return replace(self, active=_ordered({*self.active, *names}), left_out=reasons, **changes)

    def _with_warning(self, line: str) -> Needs:
        known = line in self.warnings
        return self if known else replace(self, warnings=(*self.warnings, line))


# Twist has variants, which are terms, too: by the model of twist.
_VARIANTS = {
    "frenet": ("frenet",),
    "bishop": ("bishop",),
    "quasistatic": ("bishop", "quasistatic"),
}
_ONLY_FRICTION = (
    "only friction would twist the cable, so it slides; set terms.twist: bishop to let it roll"
)
_ROWS = {term.name: term for term in TERMS}
NAMES = tuple(name for term in TERMS for name in (term.name, *term.variants))
"""Names of all terms, in the order in which they are reported."""


def _ordered(present: set[str]) -> tuple[str, ...]:
    return tuple(name for name in NAMES if name in present)


def needs_of(scene: Scene, continues: bool = False) -> Needs:
    """Decide for every term whether a scene needs it, also for what may come while it runs.

    Args:
        continues: the cable goes on from another shape than that in which the scene begins.
    """
    axes, leaves = _axes(scene, continues)
    model = _twist_model(scene)
    reasons: dict[str, str] = {}
    warnings: list[str] = []
    if len(axes) == 2 and scene.terms.out_of_plane == "off":
        reasons["out_of_plane"] = "terms.out_of_plane is off"
        warnings += [_warning_of_plane(axes)] * leaves
    elif len(axes) == 2:
        reasons["out_of_plane"] = f"everything lies in {_plane(axes)}"
    present = set()
    for term in TERMS:
        name, setting = term.name, getattr(scene.terms, term.name, "auto")
        needed = _twists(scene, axes) if name == "twist" else term.needed(scene)
        if name == "twist" and setting == "auto" and model == "off":
            reasons[name] = _no_twist(scene)[0] if scene.may_twist else term.absent
            warnings += [line for line in [_warning_of_twist(scene)] if needed and line]
        elif name == "stretch" and inextensible(scene):
            reasons[name] = "the cable keeps its rest length (terms.stretch is off)"
        elif setting == "off":
            reasons[name] = f"terms.{name} is off"
            warnings += [_warning(term, scene)] * needed
        elif not needed and (setting == "auto" or name == "contact"):
            only_friction = name == "twist" and bool(scene.rubbing)
            reasons[name] = _ONLY_FRICTION if only_friction else term.absent
        else:
            present |= {name, *(_VARIANTS.get(model, ()) if name == "twist" else ())}
    return Needs(_ordered(present), axes, model, reasons, tuple(warnings))


def _warning(term: Term, scene: Scene) -> str:
    """What a scene loses in which a term is needed but switched off: key, loss and cure."""
    cure = "set it to auto"
    if term.name == "stretch":
        if _taut(scene):
            cure += " (its length cannot be kept, since its ends pull it taut)"
        else:
            cure += ", or integrator.method to energy_momentum, which keeps the length"
    return f"terms.{term.name}: off, so {term.loss(scene)}; {cure}"


def _warning_of_plane(axes: tuple[int, ...]) -> str:
    return (
        f"terms.out_of_plane: off, so the cable stays in {_plane(axes)}: forces and moments out of "
        "it are dropped, and ends follow their poses' projections onto it; set it to auto"
    )


def check_terms(scene: Scene, needs: Needs) -> None:
    """Raise SceneError for terms, and combinations of them, that have no meaning here."""
    if scene.is_net:
        for key, value, problem in _no_net(scene, needs):
            raise refusal(key, value, problem)
    if scene.terms.contact == "on" and not (scene.bodies or scene.contact.markers):
        raise SceneError("terms.contact: 'on' needs obstacles; name one in obstacles.names")
    slides = next((one.name for one in scene.grasps if one.slides), "")
    if slides and inextensible(scene):
        raise SceneError(
            f"terms.stretch: off keeps the length, which is not available with grasps.{slides}."
            "slides; set terms.stretch to auto"
        )
    if scene.terms.out_of_plane == "off" and len(needs.axes) == 3:
        if "frenet" in needs or "plasticity" in needs:
            raise SceneError(
                "terms.out_of_plane: 'off' is not available with Frenet torsion or plasticity; set "
                "it to auto"
            )
        raise SceneError(
            "terms.out_of_plane: 'off' needs ends that lie, and point, in one coordinate plane; "
            "move them or set it to auto"
        )
    if "plasticity" in needs and not scene.plasticity.yield_curvature:
        raise SceneError(
            "terms.plasticity: 'on' needs plasticity.yield_curvature above 0; give one or set "
            "terms.plasticity off"
        )
    if "plasticity" in needs and "bend" not in needs:
        raise SceneError(
            "terms.plasticity: bends nothing, since terms.bend is off; set one of them"
        )
    for strand in scene.strands:
        twist = strand.scene.cable.rest_twist
        if any(twist) and "bishop" not in needs:
            raise SceneError(
                f"{strand.key_of('cable')}.rest_twist: {list(twist)} needs the twist that acts on "
                "the shape; set terms.twist to auto"
            )


def _no_net(scene: Scene, needs: Needs) -> Iterator[tuple[str, object, str]]:
    """What nets do not support yet: keys, values, and why not, with the cure."""
    none, auto = "is not available for a net of cables", "set it to auto"
    for name in ("stretch", "out_of_plane"):
        if getattr(scene.terms, name) == "off":
            yield f"terms.{name}", "off", f"{none}; {auto}"
    if scene.discretization.quadrature == "uniform":
        yield "discretization.quadrature", "uniform", f"{none}; set it to gauss"
    if "plasticity" in needs:
        yield "plasticity.yield_curvature", scene.plasticity.yield_curvature, f"{none}; set it to 0"
    if scene.hose.pressure:
        yield "hose.pressure", scene.hose.pressure, f"Pa {none}; set it to 0"
    for one in scene.grasps:
        if one.slides:
            yield f"grasps.{one.name}.slides", True, f"{none}; set it to false"
    if scene.passes_roll and scene.terms.twist == "quasistatic":
        why = "is not available where a body turns with the cables; set it to bishop"
        yield "terms.twist", "quasistatic", why
    implicit = scene.integrator.method in IMPLICIT_METHODS  # others are refused by themselves
    if scene.passes_roll and "bishop" not in needs and implicit:
        why = "takes no roll from one cable to another, as rigid and elastic joints and connectors"
        hinge = "or make all joints hinged, without connectors"
        if scene.terms.twist in ("off", "frenet"):
            yield "terms.twist", scene.terms.twist, f"{why} do; {auto}, {hinge}"
        yield "terms.bend", scene.terms.bend, f"{why} do, unless the cables bend; {auto}, {hinge}"


def inextensible(scene: Scene) -> bool:
    """Whether the cable keeps its length: stretching is switched off, the method knows multipliers
    (`engine.tension`), and the ends do not pull the cable taut.
    """
    if scene.terms.stretch != "off" or _taut(scene):
        return False
    if scene.integrator.method == "auto":
        return all("energy_momentum" in one.methods for one in restrictions_of(scene))
    return scene.integrator.method in KEEPING_LENGTH


def _taut(scene: Scene) -> bool:
    """Whether both ends are fixed along the line between them, at least the rest length apart."""
    line = _line(scene)
    along = [axis for axis in range(3) if line[axis]]
    return _far(scene) and all(end.fixed[axis] for end in scene.ends.values() for axis in along)


def _line(scene: Scene) -> Vector:
    """From the start's to the end's attachment [m], shape (3,)."""
    start, end = (np.add(end.position, end.offset) for end in (scene.start, scene.end))
    return np.asarray(end - start)


def _far(scene: Scene) -> bool:
    """Whether the ends are at least the rest length apart."""
    return math.hypot(*_line(scene)) >= scene.cable.length * (1.0 - 1e-6)


def _hangs_taut(scene: Scene) -> bool:
    """Whether a straight cable hangs between resting ends and only its weight bends it."""
    return (
        all(any(end.fixed) and not end.holds_direction for end in scene.ends.values())
        and _far(scene)
        and not (scene.grasps or scene.touches or scene.cable.shaped)
        and not any(term.presses and term.needed(scene) for term in TERMS)
    )


def _twist_model(scene: Scene) -> str:
    """The model of twist; with `auto` quasistatic unless friction can roll the cable, or off."""
    if scene.terms.twist != "auto":
        return scene.terms.twist
    if _no_twist(scene)[0]:
        return "off"
    held = any(holder.holds_roll for holder in scene.holders.values())
    still = held and not scene.may_roll and not scene.passes_roll
    return "quasistatic" if still else "bishop"


def _no_twist(scene: Scene) -> tuple[str, str]:
    """Why `auto` can have no twist, and the cure where that matters; empty if it can."""
    method = scene.integrator.method
    if method not in IMPLICIT_METHODS:
        return f"{method} knows only that of terms.twist: frenet", "use energy_momentum"
    if scene.terms.bend == "off" or scene.cable.EI == 0.0:
        return "the cable does not resist bending, by which twist acts on the shape", "let it bend"
    if scene.terms.out_of_plane == "off":
        return "in a plane it does not act on the shape", "set terms.out_of_plane to auto"
    held = any(holder.holds_roll for holder in scene.holders.values())
    if held or _twisted_at_rest(scene) or scene.passes_roll:
        return "", ""
    return "nothing holds the roll of the cable, so that a moment only spins it", ""


def _twisted_at_rest(scene: Scene) -> bool:
    """Whether any cable is twisted while it is unloaded."""
    return any(any(cable.rest_twist) for cable in scene.materials)


def _warning_of_twist(scene: Scene) -> str:
    """What a scene loses that needs twist and can have none; empty if that does not matter."""
    if scene.terms.twist == "off":
        return _warning(_ROWS["twist"], scene)
    why, cure = _no_twist(scene)
    return f"terms.twist: auto, so {_ROWS['twist'].loss(scene)}: {why}; {cure}" if cure else ""


def _twists(scene: Scene, axes: tuple[int, ...]) -> bool:
    """Whether anything twists the cable, or may while it runs; what may is no warning.

    In space bending twists the cable, or a gripper can, where its roll is held in two places, or in
    one against a natural or plastic curvature. Otherwise nothing takes up a twisting moment.
    """
    in_space = len(axes) == 3  # in a plane a moment only bends the cable
    moment = in_space and any(any(load.torque) for load in scene.loads)
    if scene.terms.twist == "off" or not in_space:
        return moment or (scene.is_rolled and scene.terms.twist == "off")
    comes = any(load.type == "wrench" and load.signal == "none" for load in scene.loads)
    held = sum(holder.holds_roll for holder in scene.holders.values())
    bent = scene.shaped or scene.is_plastic
    sprung = any(holder.roll_spring for holder in scene.holders.values())
    twisted = held > 1 or sprung or (held == 1 and bent) or _twisted_at_rest(scene)
    twisted = twisted or scene.passes_roll
    return moment or twisted or (comes and _twist_model(scene) != "off")


def with_load(
    needs: Needs, scene: Scene, name: str, force: Vector | None, torque: Vector | None
) -> Needs:
    """Needs once a load has this force [N] and moment [N m].

    Raises:
        ValueError: a moment would twist a cable in whose scene none was to come.
    """
    push, turn = (np.zeros(3) if one is None else one for one in (force, torque))
    for normal in (axis for axis in _SPACE if axis not in needs.axes):
        if push[normal] or any(turn[list(needs.axes)]):
            needs = needs.in_plane(scene)
    if not any(turn) or len(needs.axes) == 2 or "twist" in needs:
        return needs
    if needs.twist_model == "off":
        return needs.twisted(scene)
    raise ValueError(
        f"torque of {name}: would twist the cable, but loads.{name} is a force, or has a signal "
        f"without torque; set loads.{name}.type to wrench, without a signal or with a torque in it"
    )


def _axes(scene: Scene, continues: bool) -> tuple[tuple[int, ...], bool]:
    """All three axes, or the two of a plane; and whether anything can act out of that plane.

    A shape in a plane may be unstable across it, at once or while it moves, wherever a part of the
    cable is compressed or held bent. Only a cable that hangs taut never is.
    """
    switch = scene.terms.out_of_plane
    # Frenet and Bishop frames, and plasticity, are implemented in three dimensions only.
    framed = scene.terms.twist in ("frenet", "bishop", "quasistatic")
    twisted = scene.is_rolled or any(scene.cable.rest_twist)
    rolled = scene.terms.twist == "auto" and switch != "off" and twisted
    in_space = scene.is_net or switch == "on" or framed or rolled or scene.is_plastic
    free_to_leave = (
        any(load.signal == "none" for load in scene.loads)
        or scene.is_driven
        or any(obstacle.driven for obstacle in scene.obstacles)
        or scene.contact.markers > 0
        or not (scene.start.held or scene.end.held)
    )
    if in_space or (switch == "auto" and (continues or not _hangs_taut(scene))):
        return _SPACE, False
    leaving = {normal: _forces_leave(scene, normal) for normal in (1, 0, 2)}
    planes = [normal for normal in leaving if not _ends_leave(scene, normal)]
    calm = [normal for normal in planes if not leaving[normal]]
    if calm or (planes and switch == "off"):
        # Switched off: prefer a plane that contains gravity, even if loads act out of it.
        upright = sorted(planes, key=lambda normal: scene.gravity[normal] != 0.0)
        (normal, *_) = calm or upright
        axes = tuple(axis for axis in _SPACE if axis != normal)
        return axes, free_to_leave or leaving[normal]
    return _SPACE, False


def mirrors(scene: Scene) -> list[float]:
    """1 for each world axis normal to a plane in which all ends and grasps lie, and across which
    nothing acts, else 0: nothing in the scene decides to which side of it the cable falls.
    """
    if any(any(one.center[1:]) for one in scene.connectors):
        return [0.0] * 3
    scenes = [strand.scene for strand in scene.strands]
    starts = [np.add(one.start.position, one.start.offset) for one in scenes]
    leave = np.any(np.not_equal(starts, starts[0]), axis=0)
    leave |= np.any([one.direction for one in scene.strands], axis=0)
    for one in scenes:
        leave |= [_ends_leave(one, axis) or _forces_leave(one, axis) for axis in _SPACE]
    return [0.0 if leaves else 1.0 for leaves in leave]


def _ends_leave(scene: Scene, normal: int) -> bool:
    """Whether positions or directions of ends and grasps leave a plane normal to axis `normal`."""
    holders = [*scene.ends.values(), *(grasp for grasp in scene.grasps if grasp.taken)]
    places = [one.position[normal] + one.offset[normal] for one in holders if one.held]
    apart = [max(places) - min(places)] if places else []
    if not (scene.start.held and scene.end.held):
        apart.append(scene.start.position[normal] - scene.end.position[normal])
    apart += [one.tangent[normal] for one in holders if one.holds_direction]
    return any(apart)


def _forces_leave(scene: Scene, normal: int) -> bool:
    """Whether terms, loads, obstacles or natural curvature act along axis `normal`."""
    leaving: list[float] = [force[normal] for term in TERMS for force in term.forces(scene)]
    around = [axis for axis in range(3) if axis != normal]
    place = scene.start.position[normal] + scene.start.offset[normal]
    leaving += [obstacle.pushes_along(normal, place) for obstacle in scene.bodies]
    for load in scene.loads:
        leaving.append(load.force[normal])
        leaving += [load.torque[axis] for axis in around]
    if any(scene.cable.rest_curvature):
        leaving += [scene.cable.rest_curvature_axis[axis] for axis in around]
    leaving += [any(scene.cable.rest_curvature_2)]
    return any(leaving)


def _plane(axes: tuple[int, ...]) -> str:
    return f"the {''.join('xyz'[axis] for axis in axes)} plane"
