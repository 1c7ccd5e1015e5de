"""What a scene needs: the one place that decides which terms exist in its step, and why not."""

from __future__ import annotations

from dataclasses import dataclass
from types import MappingProxyType

from dlo_sim.scene.description import Scene


@dataclass(frozen=True)
class Needs:
    """Which terms a scene's step contains.

    Attributes:
        stretch, bend, twist, gravity, springs, loads, drive, damping: present or not.
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
    left_out: MappingProxyType[str, str]

    @property
    def active(self) -> tuple[str, ...]:
        """Names of the terms that are there."""
        names = ("stretch", "bend", "twist", "gravity", "springs", "loads", "drive", "damping")
        return tuple(name for name in names if getattr(self, name))


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
    return Needs(
        stretch=decide("stretch", terms.stretch, scene.cable.EA > 0.0, "axial stiffness is 0"),
        bend=decide("bend", terms.bend, scene.cable.EI > 0.0, "bending stiffness is 0"),
        twist=decide("twist", terms.twist, _twists(scene), "nothing twists the cable"),
        gravity=decide("gravity", terms.gravity, any(scene.gravity), "gravity is 0"),
        springs=decide("springs", "auto", _sprung(scene), "no end hangs on a spring"),
        loads=decide("loads", "auto", bool(scene.loads), "no loads"),
        drive=decide("drive", "auto", _driven(scene), "no gripper moves an end"),
        damping=decide("damping", terms.damping, damped, "no damping"),
        left_out=MappingProxyType(reasons),
    )


def _twists(scene: Scene) -> bool:
    """Something turns the cable about its own axis: a turning gripper, or a moment with a clamp."""
    turned = any(end.clamped and end.driven for end in scene.ends.values())
    moments = any(load.type == "wrench" for load in scene.loads)
    return turned or moments


def _sprung(scene: Scene) -> bool:
    return any(any(end.spring) for end in scene.ends.values())


def _driven(scene: Scene) -> bool:
    return any(end.driven and end.held for end in scene.ends.values())
