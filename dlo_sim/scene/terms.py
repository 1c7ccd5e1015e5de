"""Terms of the model, and what of a scene only some methods can step: two tables."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
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
        needed: whether a scene needs it, `terms.twist` apart (`needs`).
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
        needed=lambda scene: scene.contact.self_contact == "on",
        absent="contact.self_contact is not on",
    ),
    Term(
        "friction",
        needed=lambda scene: bool(scene.rubbing) or scene.rubs_itself,
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
    Term("loads", needed=lambda scene: bool(scene.loads), absent="no loads"),
    Term("drive", needed=lambda scene: scene.is_driven, absent="no gripper moves an end"),
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
        value: its value; 0 or "" if the scene does not ask for it.
        off: the value with which every method will do.
        why: why other methods cannot, if that is not plain, to go on behind the value.
    """

    methods: Names
    key: str
    value: Callable[[Scene], float | str]
    off: str = "0.0"
    why: str = ""

    def asked(self, scene: Scene) -> str:
        """Key and value with which the scene asks for it."""
        value = self.value(scene)
        return f"{self.key} {value if isinstance(value, str) else f'{value:g}'}"

    @property
    def kind(self) -> str:
        """What kind of method can."""
        if self.methods == EXPLICIT:
            return "an explicit method"
        if set(self.methods) <= set(IMPLICIT):
            return "an implicit method"
        return f"one of {', '.join(self.methods)}"


def _of_twist(model: str) -> Callable[[Scene], str]:
    return lambda scene: model if scene.terms.twist == model else ""


def _of_damping(
    name: str, if_also: Callable[[Scene], float] = lambda scene: 1.0
) -> Callable[[Scene], float]:
    def value(scene: Scene) -> float:
        present = scene.terms.damping != "off" and if_also(scene)
        return float(getattr(scene.damping, name)) if present else 0.0

    return value


def _on(scene: Scene) -> str:
    return "on" if scene.contact.self_contact == "on" else ""


def _touching(scene: Scene) -> str:
    return f"{scene.terms.contact} ({scene.touched})" if scene.touches else ""


def _sliding(scene: Scene) -> str:
    return next((f"of grasp {one.name}" for one in scene.grasps if one.slides), "")


def _grasping(scene: Scene) -> str:
    return ", ".join(grasp.name for grasp in scene.grasps)


def _rolled(scene: Scene) -> float:
    return max(end.roll_spring for end in scene.ends.values())


def _shaped(scene: Scene) -> str:
    """The natural shape, as curvatures and twist rate along the cable."""
    return " ".join(shown(one) for one in scene.cable.natural_shape if any(one))


def _turned_drag(scene: Scene) -> str:
    return f"{scene.damping.air_drag_ratio:g}" if scene.drag_across else ""


def _measured(scene: Scene) -> str:
    return "" if scene.measured.type == "none" else scene.measured.type


_GROWING = ", since its negative sub-steps make damping grow"
_POINT_MASS = " beside a point mass (start.mass, end.mass)"
RESTRICTIONS = (
    Restriction(EXPLICIT, "terms.twist", _of_twist("frenet"), "auto"),
    Restriction(IMPLICIT, "terms.twist", _of_twist("quasistatic"), "auto"),
    Restriction(IMPLICIT, "terms.twist", _of_twist("bishop"), "off"),
    Restriction(FORWARD, "contact.self_contact", _on, "off"),
    Restriction(FORWARD, "damping.stiffness", _of_damping("stiffness")),
    Restriction(FORWARD, "damping.stretch", _of_damping("stretch")),
    Restriction(FORWARD, "damping.bend", _of_damping("bend")),
    Restriction(FORWARD, "damping.twist", _of_damping("twist")),
    Restriction(
        ("energy_momentum",),
        "damping.thinning",
        _of_damping("thinning", if_also=lambda scene: scene.damping.internal[1]),
    ),
    Restriction(IMPLICIT, "damping.air_drag_ratio", _turned_drag, "1.0"),
    Restriction(IMPLICIT, "water.density", lambda scene: scene.water.density),
    Restriction(IMPLICIT, "hose.pressure", lambda scene: scene.hose.pressure),
    Restriction(
        IMPLICIT,
        "damping.air_drag",
        _of_damping("air_drag", if_also=lambda scene: scene.start.mass or scene.end.mass),
        why=_POINT_MASS,
    ),
    Restriction(SINGLE, "damping.mass", _of_damping("mass"), why=_GROWING),
    Restriction(SINGLE, "damping.air_drag", _of_damping("air_drag"), why=_GROWING),
    Restriction(
        LOSSY,
        "plasticity.yield_curvature",
        lambda scene: scene.plasticity.yield_curvature if scene.is_plastic else 0.0,
    ),
    Restriction(FORWARD, "terms.contact", _touching, "off", ", since its steps cannot land"),
    Restriction(
        FORWARD, "slides", _sliding, "false", ", since its steps cannot let the cable slide"
    ),
    Restriction(IMPLICIT, "grasps.names", _grasping, "[]"),
    Restriction(IMPLICIT, "roll_spring", _rolled),
    Restriction(IMPLICIT, "cable.rest_curvature", _shaped, "[0.0]"),
    Restriction(IMPLICIT, "measured.type", _measured, "none"),
)


def restrictions_of(scene: Scene) -> list[Restriction]:
    """What of a scene only some methods can step."""
    return [one for one in RESTRICTIONS if one.value(scene)]
