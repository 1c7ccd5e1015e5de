"""Terms of the model, and what of a scene only some methods can step: two tables."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from operator import attrgetter
from typing import TYPE_CHECKING

from dlo_sim.scene.holders import Grasp
from dlo_sim.scene.parameter import Names, Vector
from dlo_sim.scene.refusal import shown

if TYPE_CHECKING:
    from dlo_sim.scene.description import Scene


@dataclass(frozen=True)
class Term:
    """A term of the model: when a scene has it, and what it gives to the engine.

    Attributes:
        name: as in `left_out`; also of its switch in `terms`, and of its bit in
            `engine.arrays.BITS`, where it has one.
        variants: names of its models, if it has several, which are terms, too.
        needed: whether a scene needs it, `terms.twist` apart (`needs`).
        presses: whether it may move, press or bend a cable that hangs taut.
        absent: why a scene lacks it that does not need it.
        loss: what a scene loses in which it is needed but switched off.
        forces: forces that it exerts, or velocities that it imposes, in the world; the cable stays
            in a plane only if all are in it.
        numbers: what `engine.arrays.Physics` holds for it, by name; vectors are in the world.
        faint: values that put it into a scene without visible effect, for `dlo_sim study omission`,
            where those are all it takes.
    """

    name: str
    needed: Callable[[Scene], bool]
    absent: str
    variants: Names = ()
    presses: bool = False
    loss: Callable[[Scene], str] = lambda scene: ""
    forces: Callable[[Scene], Sequence[Vector]] = lambda scene: ()
    numbers: Callable[[Scene], dict[str, float | Vector]] = lambda scene: {}
    faint: Mapping[str, object] = field(default_factory=dict)


TERMS = (
    Term(
        "stretch",
        needed=lambda scene: scene.cable.EA > 0.0,
        absent="axial stiffness is 0",
        loss=lambda scene: f"nothing resists stretching, although EA is {scene.cable.EA:.3g} N",
        numbers=lambda scene: {"axial_round_off": scene.cable.EA * scene.cable.length},
    ),
    Term(
        "bend",
        needed=lambda scene: scene.cable.EI > 0.0,
        absent="bending stiffness is 0",
        loss=lambda scene: f"nothing resists bending, although EI is {scene.cable.EI:.3g} N m^2",
        numbers=lambda scene: {"bending_round_off": scene.cable.EI * scene.cable.length},
    ),
    Term(
        "twist",
        needed=lambda scene: scene.may_twist,
        absent="nothing twists the cable",
        variants=("frenet", "bishop", "quasistatic"),
        loss=lambda scene: (
            "nothing turns the cable about its own axis, although a gripper or a moment does"
        ),
        numbers=lambda scene: {
            "GJ": scene.cable.GJ,
            "torsion_floor": scene.curvature_floor**2,
        },
    ),
    Term(
        "plasticity",
        needed=lambda scene: scene.plasticity.yield_curvature > 0.0,
        absent="no yield curvature",
        loss=lambda scene: (
            "bending leaves no set, although plasticity.yield_curvature is "
            f"{scene.plasticity.yield_curvature:g} 1/m"
        ),
        numbers=lambda scene: {
            "yield_moment": scene.cable.EI * scene.plasticity.yield_curvature,
            # H = EI h / (1 - h) gives the tangent stiffness h EI.
            "hardening": scene.plasticity.hardening / (1.0 - scene.plasticity.hardening),
        },
    ),
    Term(
        "contact",
        needed=lambda scene: bool(scene.bodies),
        absent="no obstacles",
        loss=lambda scene: "the cable goes through its obstacles",
    ),
    Term(
        "self_contact",
        needed=lambda scene: scene.touches_itself,
        absent="contact.self_contact is not on",
    ),
    Term(
        "friction",
        needed=lambda scene: (
            bool(scene.rubbing) or (scene.touches_itself and scene.contact.friction > 0.0)
        ),
        absent="the cable touches no obstacle, nor itself, with friction",
    ),
    Term(
        "gravity",
        needed=lambda scene: any(scene.gravity),
        absent="gravity is 0",
        loss=lambda scene: (
            f"the cable has no weight, although gravity is {list(scene.gravity)} m/s^2"
        ),
        forces=lambda scene: (scene.gravity,),
    ),
    Term(
        "springs",
        needed=lambda scene: any(
            any(one.spring) or one.tangent_spring or (isinstance(one, Grasp) and one.slides)
            for one in scene.holders.values()
        ),
        absent="no end hangs on a spring",
    ),
    Term("loads", needed=lambda scene: bool(scene.loads), absent="no loads", presses=True),
    Term(
        "drive",
        needed=lambda scene: scene.is_driven,
        absent="no gripper moves an end",
        presses=True,
    ),
    Term(
        "damping",
        needed=lambda scene: (
            any((*scene.damping.internal, scene.damping.mass, scene.damping.air_drag))
            or scene.water.density > 0.0
        ),
        absent="no damping",
        loss=lambda scene: "no motion dies away, although the scene has damping coefficients",
        numbers=lambda scene: {
            "beta_stretch": scene.damping.internal[0],
            "beta_bend": scene.damping.internal[1],
            "beta_twist": scene.damping.internal[2],
            "thinning": scene.damping.thinning**2,
            "drag_across": scene.drag_across,
        },
    ),
    Term(
        "water",
        needed=lambda scene: scene.water.density > 0.0,
        absent="no water",
        forces=lambda scene: (scene.water.velocity,) if any(scene.water_drag) else (),
        numbers=lambda scene: {
            "water_across": scene.water_drag[0],
            "water_along": scene.water_drag[1],
            "water_current": scene.water.velocity,
        },
        faint={"water.density": 1e-9},
    ),
    Term(
        "pressure",
        needed=lambda scene: scene.hose.thrust > 0.0,
        absent="no pressure inside",
        presses=True,
        numbers=lambda scene: {"thrust": scene.hose.thrust},
        faint={"hose.pressure": 1e-3, "hose.bore": 1e-4},
    ),
)

# Names of methods (`core.methods`), the best first.
EXPLICIT = ("velocity_verlet", "rk4", "forest_ruth", "zhai")
IMPLICIT = ("energy_momentum", "implicit_midpoint", "energy_momentum_4")
IMPLICIT_METHODS = ("auto", *IMPLICIT)  # values with which steps may be implicit
FORWARD = ("energy_momentum", "implicit_midpoint")  # implicit, without negative sub-steps
LOSSY = (*FORWARD, *EXPLICIT)
SINGLE = (*FORWARD, "velocity_verlet", "rk4", "zhai")
KEEPING_LENGTH = ("energy_momentum", "energy_momentum_4")  # with terms.stretch: off


@dataclass(frozen=True)
class Restriction:
    """Something that only some methods can step.

    Attributes:
        methods: the methods that can.
        key: the parameter by which a scene asks for it.
        off: its value with which every method will do.
        only: the value that asks for it; by default every one but `off`.
        when: what else is needed for the scene to ask for it.
        value: what the scene asks for; by default the value of the parameter.
        why: why other methods cannot, if that is not plain, to go on behind the value.
    """

    methods: Names
    key: str
    off: str = "0.0"
    only: str = ""
    when: Callable[[Scene], object] = lambda scene: True
    value: Callable[[Scene], float | str] | None = None
    why: str = ""

    def applies(self, scene: Scene) -> bool:
        """Whether the scene asks for it."""
        value = self._value(scene)
        undamped = scene.terms.damping == "off" and self.key.startswith("damping.")
        if undamped or not self.when(scene):
            return False
        if isinstance(value, str):
            return value == self.only if self.only else value not in ("", self.off)
        return value != float(self.off)

    def asked(self, scene: Scene) -> str:
        """Key and value with which the scene asks for it."""
        value = self._value(scene)
        return f"{self.key} {value if isinstance(value, str) else f'{value:g}'}"

    def _value(self, scene: Scene) -> float | str:
        value: float | str = (self.value or attrgetter(self.key))(scene)
        return value

    @property
    def kind(self) -> str:
        """What kind of method can."""
        if self.methods == EXPLICIT:
            return "an explicit method"
        if set(self.methods) <= set(IMPLICIT):
            return "an implicit method"
        return f"one of {', '.join(self.methods)}"


def _names_of(group: str) -> Callable[[Scene], str]:
    """The names of a group of blocks, in one text."""
    return lambda scene: ", ".join(one.name for one in getattr(scene, group))


_GROWING = ", since its negative sub-steps make damping grow"
RESTRICTIONS = (
    Restriction(EXPLICIT, "terms.twist", "auto", only="frenet"),
    Restriction(IMPLICIT, "terms.twist", "auto", only="quasistatic"),
    Restriction(IMPLICIT, "terms.twist", "off", only="bishop"),
    Restriction(FORWARD, "contact.self_contact", "off", only="on"),
    *(
        Restriction(FORWARD, f"damping.{name}")
        for name in ("stiffness", "stretch", "bend", "twist")
    ),
    Restriction(
        ("energy_momentum",), "damping.thinning", when=lambda scene: scene.damping.internal[1]
    ),
    Restriction(IMPLICIT, "damping.air_drag_ratio", "1.0", when=lambda scene: scene.drag_across),
    Restriction(IMPLICIT, "water.density"),
    Restriction(IMPLICIT, "hose.pressure"),
    Restriction(
        IMPLICIT,
        "damping.air_drag",
        when=lambda scene: scene.start.mass or scene.end.mass,
        why=" beside a point mass (start.mass, end.mass)",
    ),
    Restriction(SINGLE, "damping.mass", why=_GROWING),
    Restriction(SINGLE, "damping.air_drag", why=_GROWING),
    Restriction(LOSSY, "plasticity.yield_curvature", when=lambda scene: scene.is_plastic),
    Restriction(
        FORWARD,
        "terms.contact",
        "off",
        when=lambda scene: scene.touches,
        value=lambda scene: f"{scene.terms.contact} ({scene.touched})",
        why=", since its steps cannot land",
    ),
    Restriction(
        FORWARD,
        "slides",
        "false",
        value=lambda scene: next(
            (f"of grasp {one.name}" for one in scene.grasps if one.slides), ""
        ),
        why=", since its steps cannot let the cable slide",
    ),
    Restriction(
        IMPLICIT,
        "grasps.names",
        "[]",
        value=_names_of("grasps"),
    ),
    Restriction(
        IMPLICIT,
        "roll_spring",
        value=lambda scene: max(end.roll_spring for end in scene.ends.values()),
    ),
    Restriction(
        IMPLICIT,
        "cable.rest_curvature",
        "[0.0]",
        # The natural shape, as curvatures and twist rate along the cable.
        value=lambda scene: " ".join(shown(one) for one in scene.cable.natural_shape if any(one)),
    ),
    Restriction(IMPLICIT, "measured.type", "none"),
    *(
        Restriction(IMPLICIT, f"{group}.names", "[]", value=_names_of(group))
        for group in ("branches", "cables", "connectors")
    ),
    Restriction(
        IMPLICIT,
        "joined",
        "''",
        value=lambda scene: next((one.other for one in scene.joints if one.loop), ""),
    ),
)


def restrictions_of(scene: Scene) -> list[Restriction]:
    """What of a scene only some methods can step."""
    return [one for one in RESTRICTIONS if one.applies(scene)]
