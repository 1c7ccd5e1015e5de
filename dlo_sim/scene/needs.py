"""What a scene needs: the one place that decides which terms exist in its step, and why not."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from dlo_sim.scene.description import Scene

Vector = NDArray[np.float64]
TERMS = (
    "stretch",
    "bend",
    "twist",
    "frenet",
    "plasticity",
    "gravity",
    "springs",
    "loads",
    "drive",
    "damping",
)


@dataclass(frozen=True)
class Needs:
    """Which terms a scene's step contains.

    Attributes:
        stretch, bend, twist, gravity, springs, loads, drive, damping, plasticity: present or not.
        frenet: twist is measured against the Frenet torsion.
        axes: world axes that the motion needs: all three, or the two of a coordinate plane.
        left_out: name of each absent term -> reason.
    """

    stretch: bool
    bend: bool
    twist: bool
    gravity: bool
    springs: bool
    loads: bool
    drive: bool
    damping: bool
    frenet: bool
    plasticity: bool
    axes: tuple[int, ...]
    left_out: dict[str, str]

    def with_drive(self) -> Needs:
        """The same needs with ends that move."""
        return self if self.drive else self._without("drive", drive=True)

    def with_twist(self) -> Needs:
        """The same needs with twist."""
        return self if self.twist else self._without("twist", twist=True)

    def spatial(self) -> Needs:
        """The same needs in all three dimensions."""
        return self._without("out_of_plane", axes=(0, 1, 2))

    def _without(self, reason: str, **changes: Any) -> Needs:
        reasons = {key: why for key, why in self.left_out.items() if key != reason}
        return replace(self, left_out=reasons, **changes)

    @property
    def active(self) -> tuple[str, ...]:
        """Names of the terms that are there."""
        return tuple(name for name in TERMS if getattr(self, name))


def needs_of(scene: Scene) -> Needs:
    """Decide every term of a scene from what is in it."""
    reasons: dict[str, str] = {}

    def decide(name: str, setting: str, needed: bool, reason: str) -> bool:
        if setting == "off":
            reasons[name] = f"terms.{name} is off"
        elif setting == "auto" and not needed:
            reasons[name] = reason
        else:
            return True
        return False

    terms = scene.terms
    damping = scene.damping
    damped = bool(damping.mass or damping.stiffness or damping.air_drag)
    axes = _axes(scene)
    if len(axes) == 2:
        reasons["out_of_plane"] = f"everything lies in the {'xyz'[axes[0]]}{'xyz'[axes[1]]} plane"
    return Needs(
        axes=axes,
        stretch=decide("stretch", terms.stretch, *_stretches(scene)),
        bend=decide("bend", terms.bend, scene.cable.EI > 0.0, "bending stiffness is 0"),
        twist=decide("twist", terms.twist, _twists(scene), "nothing twists the cable"),
        gravity=decide("gravity", terms.gravity, any(scene.gravity), "gravity is 0"),
        springs=decide("springs", "auto", _sprung(scene), "no end hangs on a spring"),
        loads=decide("loads", "auto", bool(scene.loads), "no loads"),
        drive=decide("drive", "auto", _driven(scene), "no gripper moves an end"),
        damping=decide("damping", terms.damping, damped, "no damping"),
        frenet=frenet_wanted(scene),
        plasticity=decide(
            "plasticity", terms.plasticity, plasticity_wanted(scene), "no yield curvature"
        ),
        left_out=reasons,
    )


def _stretches(scene: Scene) -> tuple[bool, str]:
    """Whether the cable stretches, and the reason if not."""
    if scene.integrator.method == "rattle":
        return False, "constraints keep the rest length (integrator.method: rattle)"
    return scene.cable.EA > 0.0, "axial stiffness is 0"


def frenet_wanted(scene: Scene) -> bool:
    """Whether twist is measured against the Frenet torsion."""
    return scene.terms.twist == "frenet"


def plasticity_wanted(scene: Scene) -> bool:
    """Whether bending can leave a set."""
    switch = scene.terms.plasticity
    return switch == "on" or (switch == "auto" and scene.plasticity.yield_curvature > 0.0)


def _twists(scene: Scene) -> bool:
    """Something turns the cable about its own axis: a turning gripper, or a moment with a clamp."""
    turned = any(end.clamped and end.driven for end in scene.ends.values())
    moments = any(load.type == "wrench" for load in scene.loads)
    return turned or moments


def needs_of_load(needs: Needs, scene: Scene, force: Vector | None, torque: Vector | None) -> Needs:
    """Needs once a load has this force [N] and moment [N m]."""
    normals = [axis for axis in range(3) if axis not in needs.axes]
    for normal in normals:
        across = torque is not None and any(torque[axis] for axis in needs.axes)
        if across or (force is not None and force[normal]):
            needs = needs.spatial()
    if scene.terms.twist == "auto" and torque is not None and any(torque):
        if len(needs.axes) == 3:
            needs = needs.with_twist()
    return needs


def _axes(scene: Scene) -> tuple[int, ...]:
    """All three axes, or two if start, end, forces and moments leave a coordinate plane alone."""
    everything = (0, 1, 2)
    free_to_leave = (
        scene.terms.out_of_plane == "on"
        or frenet_wanted(scene)
        or plasticity_wanted(scene)
        or any(load.signal == "none" for load in scene.loads)
        or _driven(scene)
        or not (scene.start.held or scene.end.held)
    )
    if free_to_leave:
        return everything
    for normal in (1, 0, 2):
        if scene.terms.out_of_plane == "off" and normal != 1:
            break
        if scene.terms.out_of_plane == "off" or _stays_in_plane(scene, normal):
            return tuple(axis for axis in everything if axis != normal)
    return everything


def _stays_in_plane(scene: Scene, normal: int) -> bool:
    """Whether nothing in the scene has a component along axis `normal`."""
    ends = [end.position[normal] + end.offset[normal] for end in scene.ends.values() if end.held]
    flat = [scene.gravity[normal], max(ends) - min(ends)]
    if not (scene.start.held and scene.end.held):
        flat.append(scene.start.position[normal] - scene.end.position[normal])
    flat += [end.tangent[normal] for end in scene.ends.values() if end.clamped]
    around = [axis for axis in range(3) if axis != normal]
    for load in scene.loads:
        flat.append(load.force[normal])
        flat += [load.torque[axis] for axis in around]
    if any(scene.cable.rest_curvature):
        flat += [scene.cable.rest_curvature_axis[axis] for axis in around]
    return not any(flat)


def _sprung(scene: Scene) -> bool:
    return any(any(end.spring) for end in scene.ends.values())


def _driven(scene: Scene) -> bool:
    return any(end.driven and end.held for end in scene.ends.values())
