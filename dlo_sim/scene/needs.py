"""The terms of the model that a scene needs, decided here alone, and why the others are absent."""

from __future__ import annotations

from dataclasses import dataclass, field, fields, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from dlo_sim.scene.description import IMPLICIT_METHODS, Scene

Vector = NDArray[np.float64]
_SPACE = (0, 1, 2)


@dataclass(frozen=True)
class Needs:
    """Which terms a scene's step contains.

    Attributes:
        stretch, bend, twist, plasticity, contact, gravity, springs, loads, drive, damping: present
            or not.
        frenet, bishop: twist is relative to the Frenet torsion, or to the Bishop frame, where it
            acts on the shape. quasistatic: it has no rotary inertia about the axis.
        axes: world axes of the motion: all three, or the two of a coordinate plane.
        twist_model: the model of twist, as in `terms.twist`, also of twist that comes later.
        left_out: name of each absent term -> reason.
        warnings: one line for each term that is switched off although the scene needs it: the key,
            what is lost, the cure. Not part of comparisons.
    """

    stretch: bool
    bend: bool
    twist: bool
    frenet: bool
    bishop: bool
    quasistatic: bool
    plasticity: bool
    contact: bool
    gravity: bool
    springs: bool
    loads: bool
    drive: bool
    damping: bool
    axes: tuple[int, ...]
    twist_model: str
    left_out: dict[str, str]
    warnings: tuple[str, ...] = field(default=(), compare=False)

    def with_contact(self, present: bool) -> Needs:
        """These needs with obstacles that the cable touches, or without any."""
        if present == self.contact:
            return self
        needs = self._without("contact", contact=present)
        return needs if present else replace(needs, left_out=needs.left_out | NO_OBSTACLES)

    def with_drive(self) -> Needs:
        """These needs with prescribed motion of ends or grasps."""
        return self if self.drive else self._without("drive", drive=True)

    def with_twist(self, scene: Scene) -> Needs:
        """These needs once something twists the cable; `terms.twist: off` stays and warns."""
        if self.twist:
            return self
        if scene.terms.twist == "off":
            return self._with_warning(_lost(scene, self.axes)["twist"])
        needs = self._without("twist", **_twist(self.twist_model))
        return needs.spatial(scene) if needs.bishop else needs

    def stepped(self, implicit: bool) -> Needs:
        """These needs, in which twist that comes later is of a model that the chosen method has."""
        later = not self.twist and self.twist_model == "quasistatic" and not implicit
        return replace(self, twist_model="bishop") if later else self

    def spatial(self, scene: Scene) -> Needs:
        """These needs once something acts out of their plane: all three dimensions, with twist
        where the roll is held against it, but `terms.out_of_plane: off` keeps the plane and warns.
        """
        if len(self.axes) == 3:
            return self
        if scene.terms.out_of_plane == "off":
            return self._with_warning(_lost(scene, self.axes)["out_of_plane"])
        needs = self._without("out_of_plane", axes=_SPACE)
        twists = scene.terms.twist == "auto" and twists_in_space(scene)
        return needs.with_twist(scene) if twists else needs

    def _without(self, reason: str, **changes: Any) -> Needs:
        reasons = {key: why for key, why in self.left_out.items() if key != reason}
        return replace(self, left_out=reasons, **changes)

    def _with_warning(self, line: str) -> Needs:
        known = line in self.warnings
        return self if known else replace(self, warnings=(*self.warnings, line))

    @property
    def active(self) -> tuple[str, ...]:
        """Names of the terms that are present."""
        return tuple(name for name in TERMS if getattr(self, name))


NO_OBSTACLES = {"contact": "no obstacles"}
TERMS = tuple(member.name for member in fields(Needs) if member.type == "bool")


def needs_of(scene: Scene) -> Needs:
    """Decide for every term whether a scene needs it."""
    axes, leaves = _axes(scene)
    model = _twist_model(scene)
    lost = _lost(scene, axes)
    reasons: dict[str, str] = {}
    warnings: list[str] = []

    def decide(name: str, setting: str, needed: bool, reason: str) -> bool:
        if setting == "off":
            reasons[name] = f"terms.{name} is off"
            if needed:
                warnings.append(lost[name])
        elif setting == "auto" and not needed:
            reasons[name] = reason
        else:
            return True
        return False

    terms = scene.terms
    if terms.twist == "off":
        # Warn now only for twist from the start; later twist warns in `Needs.with_twist`.
        twisting = _twisted(scene, axes)
    elif model == "on":
        twisting = _may_twist(scene)
    else:
        twisting = len(axes) == 3 and (_has_moment(scene) or twists_in_space(scene))
    if len(axes) == 2:
        decide("out_of_plane", terms.out_of_plane, leaves, f"everything lies in {_plane(axes)}")
    present = {
        "stretch": decide("stretch", terms.stretch, scene.cable.EA > 0.0, "axial stiffness is 0"),
        "bend": decide("bend", terms.bend, scene.cable.EI > 0.0, "bending stiffness is 0"),
        "twist": decide("twist", terms.twist, twisting, "nothing twists the cable"),
        "gravity": decide("gravity", terms.gravity, any(scene.gravity), "gravity is 0"),
        "springs": decide("springs", "auto", _sprung(scene), "no end hangs on a spring"),
        "loads": decide("loads", "auto", bool(scene.loads), "no loads"),
        "drive": decide("drive", "auto", _driven(scene), "no gripper moves an end"),
        "damping": decide("damping", terms.damping, _damped(scene), "no damping"),
        "contact": decide("contact", terms.contact, bool(scene.bodies), NO_OBSTACLES["contact"])
        and bool(scene.bodies),
        "plasticity": decide("plasticity", terms.plasticity, _yields(scene), "no yield curvature"),
    }
    if inextensible(scene):
        present["stretch"] = False
        how = "terms.stretch is off" if terms.stretch == "off" else "integrator.method: rattle"
        reasons["stretch"] = f"constraints keep the rest length ({how})"
        warnings = [line for line in warnings if line != lost["stretch"]]
    return Needs(
        **(present | _twist(model if present["twist"] else "")),
        axes=axes,
        twist_model=model,
        left_out=reasons,
        warnings=tuple(warnings),
    )


def _lost(scene: Scene, axes: tuple[int, ...]) -> dict[str, str]:
    """The warning for each term that is switched off but needed: key, loss and cure on one line."""
    cable = scene.cable
    no_rattle = _without_constraint(scene)
    if no_rattle:
        length = f"set it to auto (rattle, which would keep the length, {no_rattle})"
    else:
        length = "set it to auto, or integrator.method to rattle, which keeps the length"
    return {
        "stretch": f"terms.stretch: off, so nothing resists stretching, although EA is "
        f"{cable.EA:.3g} N; {length}",
        "bend": f"terms.bend: off, so nothing resists bending, although EI is {cable.EI:.3g} "
        "N m^2; set it to auto",
        "twist": "terms.twist: off, so nothing turns the cable about its own axis, although a "
        "gripper or a moment does; set it to auto",
        "gravity": f"terms.gravity: off, so the cable has no weight, although gravity is "
        f"{list(scene.gravity)} m/s^2; set it to auto",
        "contact": "terms.contact: off, so the cable goes through its obstacles; set it to auto",
        "damping": "terms.damping: off, so no motion dies away, although the scene has damping "
        "coefficients; set it to auto",
        "plasticity": "terms.plasticity: off, so bending leaves no set, although "
        f"plasticity.yield_curvature is {scene.plasticity.yield_curvature:g} 1/m; set it to auto",
        "out_of_plane": f"terms.out_of_plane: off, so the cable stays in {_plane(axes)}: forces "
        "and moments out of it are dropped, and ends follow their poses' projections onto it; set "
        "it to auto",
    }


def inextensible(scene: Scene) -> bool:
    """Whether constraints keep the length: method rattle, or method auto with stretching switched
    off and nothing in the scene that excludes constraints.
    """
    if scene.integrator.method == "auto":
        return scene.terms.stretch == "off" and not _without_constraint(scene)
    return scene.integrator.method == "rattle"


def _without_constraint(scene: Scene) -> str:
    """Why constraints cannot keep the length of a scene's cable; empty if they can."""
    damping = scene.damping
    if frenet_wanted(scene) or plasticity_wanted(scene):
        return "knows neither Frenet torsion nor plasticity"
    if scene.terms.damping != "off":
        if any(damping.internal):
            return "is not valid with damping.stiffness, stretch, bend or twist"
        if scene.implicit_drag:
            return f"is not valid with {scene.implicit_drag}"
        if damping.air_drag and (scene.start.mass or scene.end.mass):
            return "is not valid with damping.air_drag beside a point mass"
    return "cannot step a cable taut between fixed ends" if _taut(scene) else ""


def _taut(scene: Scene) -> bool:
    """Whether both ends are fixed along the line between them, at least the rest length apart."""
    ends = [np.add(end.position, end.offset) for end in (scene.start, scene.end)]
    line = ends[1] - ends[0]
    along = [axis for axis in range(3) if line[axis]]
    rigid = all(end.fixed[axis] for end in scene.ends.values() for axis in along)
    return rigid and float(np.linalg.norm(line)) >= scene.cable.length * (1.0 - 1e-6)


def _twist_model(scene: Scene) -> str:
    """The model of twist of a scene, where it has twist.

    With `auto` twist acts on the shape, quasistatically where the method is implicit; unless
    nothing can bend, or the cable is kept in its plane, where the uncoupled model is exact. A
    moment about a cable whose roll nothing holds spins it ever faster: there, too, it is uncoupled.
    """
    if scene.terms.twist not in ("auto", "off"):
        return scene.terms.twist
    bends = scene.terms.bend != "off" and scene.cable.EI > 0.0
    if not bends or scene.terms.out_of_plane == "off":
        return "on"
    held = any(holder.holds_roll for holder in scene.holders.values())
    if not held:
        return "bishop" if any(scene.cable.rest_twist) else "on"
    explicit = scene.integrator.method not in IMPLICIT_METHODS or inextensible(scene)
    return "bishop" if explicit else "quasistatic"


def _twist(model: str) -> dict[str, bool]:
    """The terms of a model of twist; none for an empty one."""
    return {
        "twist": bool(model),
        "frenet": model == "frenet",
        "bishop": model in ("bishop", "quasistatic"),
        "quasistatic": model == "quasistatic",
    }


def twists_in_space(scene: Scene) -> bool:
    """Whether bending in space twists the cable, or a gripper can: its roll is held in two places,
    or in one against a natural or plastic curvature; or it is twisted without loads. Otherwise
    the twisting moment is zero everywhere, as nothing takes it up.
    """
    held = sum(holder.holds_roll for holder in scene.holders.values())
    bent = scene.cable.shaped or plasticity_wanted(scene)
    sprung = any(holder.roll_spring for holder in scene.holders.values())
    return held > 1 or sprung or (held == 1 and bent) or any(scene.cable.rest_twist)


def frenet_wanted(scene: Scene) -> bool:
    """Whether twist is relative to the Frenet torsion."""
    return scene.terms.twist == "frenet"


def plasticity_wanted(scene: Scene) -> bool:
    """Whether bending can be plastic."""
    switch = scene.terms.plasticity
    return switch == "on" or (switch == "auto" and _yields(scene))


def needs_of_load(needs: Needs, scene: Scene, force: Vector | None, torque: Vector | None) -> Needs:
    """Needs once a load has this force [N] and moment [N m]."""
    normals = [axis for axis in range(3) if axis not in needs.axes]
    for normal in normals:
        across = torque is not None and any(torque[axis] for axis in needs.axes)
        if across or (force is not None and force[normal]):
            needs = needs.spatial(scene)
    if torque is not None and any(torque) and len(needs.axes) == 3:
        needs = needs.with_twist(scene)
    return needs


def needs_of_end(needs: Needs, scene: Scene, *, leaves_plane: bool, twists: bool) -> Needs:
    """Needs once an end or grasp moves, out of the plane or with a twist if so flagged."""
    needs = needs.with_drive()
    if leaves_plane:
        needs = needs.spatial(scene)
    # Where nothing holds the cable against it, a gripper that turns it does not twist it.
    free = needs.twist_model in ("bishop", "quasistatic") and not twists_in_space(scene)
    return needs.with_twist(scene) if twists and not free else needs


def _axes(scene: Scene) -> tuple[tuple[int, ...], bool]:
    """All three axes, or the two of a plane; and whether anything can act out of that plane."""
    switch = scene.terms.out_of_plane
    # Frenet and Bishop frames, and plasticity, are implemented in three dimensions only.
    framed = scene.terms.twist in ("frenet", "bishop", "quasistatic")
    twisted = _rolled(scene) or any(scene.cable.rest_twist)
    rolled = scene.terms.twist == "auto" and switch != "off" and twisted
    in_space = switch == "on" or framed or rolled or plasticity_wanted(scene)
    free_to_leave = (
        any(load.signal == "none" for load in scene.loads)
        or _driven(scene)
        or any(obstacle.driven for obstacle in scene.obstacles)
        or scene.contact.markers > 0
        or not (scene.start.held or scene.end.held)
    )
    if in_space or (switch == "auto" and free_to_leave):
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
    """Whether weight, loads, obstacles or natural curvature act along axis `normal`."""
    leaving = [scene.gravity[normal], scene.water.velocity[normal] * any(scene.water_drag)]
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


def _may_twist(scene: Scene) -> bool:
    """Whether anything can twist the cable: a moving clamp, a moment, or a held roll."""
    turned = any(end.clamped and end.driven for end in scene.ends.values())
    moments = any(load.type == "wrench" for load in scene.loads)
    return turned or moments or _rolled(scene)


def _has_moment(scene: Scene) -> bool:
    """Whether a load is a moment from the start."""
    return any(any(load.torque) for load in scene.loads)


def moments_may_come(scene: Scene) -> bool:
    """Whether a load may become a moment while the cable is simulated."""
    return any(load.type == "wrench" and load.signal == "none" for load in scene.loads)


def _rolled(scene: Scene) -> bool:
    """Whether the roll is held by anything other than a clamp at an end: a spring, whose stiffness
    limits explicit steps.
    """
    springs = any(holder.roll_spring for holder in scene.holders.values())
    return springs or any(grasp.roll for grasp in scene.grasps)


def _twisted(scene: Scene, axes: tuple[int, ...]) -> bool:
    """Whether a moment twists the cable from the start (in a plane it only bends it), or its roll
    is held by `_rolled`.
    """
    return _rolled(scene) or (len(axes) == 3 and _has_moment(scene))


def _sprung(scene: Scene) -> bool:
    return any(any(one.spring) or one.tangent_spring for one in scene.holders.values())


def _driven(scene: Scene) -> bool:
    return any(holder.driven and holder.held for holder in scene.holders.values())


def _damped(scene: Scene) -> bool:
    by_rates = scene.damping.mass or any(scene.damping.internal) or scene.damping.air_drag
    return bool(by_rates or scene.water.density)


def _yields(scene: Scene) -> bool:
    return scene.plasticity.yield_curvature > 0.0
