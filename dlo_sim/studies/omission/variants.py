"""A scene with and without each of its terms."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import dataclass

import numpy as np

from dlo_sim.core import rotations
from dlo_sim.core.end_motion import EndMotion
from dlo_sim.scene.description import Scene
from dlo_sim.scene.loading import SceneError, scene_values
from dlo_sim.scene.needs import needs_of
from dlo_sim.simulation import optional_terms, selection
from dlo_sim.tuning.trial import Job

Values = dict[str, object]
Change = Callable[[Scene], Values]

TINY = 1e-9  # a damping, drag or spring that is there and does nothing that can be seen
NEVER = 1.0e5  # [1/m] of a curvature at which nothing yields
FLOOR = 10.0  # [1/m] of curvature, below which the Frenet torsion fades
STIFF = 1.0e6  # [N/m] of a spring that holds as well as a fixed axis
FREE: Values = {"start.spring": [0.0] * 3, "end.spring": [0.0] * 3}
STILL: Values = {"start.pose_topic": "", "end.pose_topic": ""}
SPACE: Values = {"terms.out_of_plane": "on"}
# What both runs of a term may need because not every method knows it: the first that will do.
METHODS: tuple[Values, ...] = (
    {},
    {"integrator.method": "velocity_verlet", "integrator.step": 0.0},
    {
        **{"integrator.method": "velocity_verlet", "integrator.step": 0.0},
        **{"damping.stiffness": 0.0, "damping.air_drag": 0.0},
    },
    {
        **{"integrator.method": "velocity_verlet", "integrator.step": 0.0},
        **{"damping.stiffness": 0.0, "damping.air_drag": 0.0, "cable.rest_curvature": [0.0]},
    },
)
# What grippers do, from rest and ever faster: a jump of their speed is no motion of a cable that
# cannot stretch. [m], [rad], [s]
MOVED, TURNED, MOVING = 0.15, 1.0, 1.0


@dataclass(frozen=True)
class Term:
    """What puts a term into a scene and what takes it out.

    Attributes:
        alone: what both runs need so that nothing else differs between them, tried in order.
        reason: why a scene may lack it, where `needs_of` has no words for it.
    """

    put_in: Change
    take_out: Change
    alone: tuple[Change, ...] = ()
    reason: str = ""


@dataclass(frozen=True, eq=False)
class Variant:
    """A term of a scene, with and without.

    Attributes:
        term: its name. automatic: whether the scene's own step contains it.
        reason: why it was left out, or empty. shared: what both scenes have and the scene has not.
        full, bare: the scene with it and without it; None where that does not exist.
        still: whether driven ends stay where they are in both runs.
    """

    term: str
    automatic: bool
    reason: str
    shared: Values
    full: Scene | None
    bare: Scene | None
    still: bool = False

    @property
    def note(self) -> str:
        """Why the term is not in the scene's step, and what both runs have in addition."""
        both = ", ".join(
            f"{key} {'empty' if value == '' else value}" for key, value in self.shared.items()
        )
        parts = [self.reason, f"both with {both}" if both else ""]
        return "; ".join(part for part in parts if part)


def has(scene: Scene, term: str) -> bool:
    """Whether a scene's step contains a term."""
    needs = needs_of(scene)
    if term == "out_of_plane":
        return len(needs.axes) == 3
    if term == "air_drag":
        return bool(needs.damping and scene.damping.air_drag > 0.0)
    return bool(getattr(needs, term))


def variants(scene: Scene) -> list[Variant]:
    """Every term of a scene with and without, in the order of `TERMS`."""
    needs = needs_of(scene)
    found = []
    for name, term in TERMS.items():
        automatic = has(scene, name)
        reason = "" if automatic else needs.left_out.get(name, term.reason)
        first = next(_pairs(scene, name, term), None)
        if first is None:
            words = f"{reason}; " if reason else ""
            found.append(
                Variant(name, automatic, f"{words}no scene differs in it alone", {}, None, None)
            )
            continue
        shared, full, bare = first
        still = name == "drive" and not automatic
        found.append(Variant(name, automatic, reason, shared, full, bare, still))
    return found


def job(scene: Scene, duration: float, still: bool = False) -> Job:
    """A scene's run: grippers that are driven move sideways and turn about the cable."""
    motions = []
    if scene.start.driven and scene.start.held and not still:
        path = np.zeros((3, 3))
        path[0] = scene.start.position
        path[2, 1] = MOVED / MOVING**2
        axis = np.asarray(scene.start.tangent, dtype=float)
        turn = np.zeros((2, 3))
        turn[1] = TURNED / MOVING**2 * axis / max(float(np.linalg.norm(axis)), 1e-300)
        unturned = np.asarray(rotations.IDENTITY, dtype=float)
        motions.append(("start", EndMotion(0.0, MOVING, path, unturned, turn)))
    return Job(scene, duration, tuple(np.linspace(0.0, 1.0, 21)), 2e-3, tuple(motions))


def _pairs(scene: Scene, name: str, term: Term) -> Iterator[tuple[Values, Scene, Scene]]:
    """Ways to have the scene with and without a term: what both share, with, without."""
    for method in METHODS:
        for alone in term.alone or (_nothing,):
            shared = {**alone(scene), **method}
            base = _changed(scene, shared)
            if base is None:
                continue
            present = has(base, name)
            other = _changed(base, (term.take_out if present else term.put_in)(base))
            full, bare = (base, other) if present else (other, base)
            if full is None or bare is None or not has(full, name) or has(bare, name):
                continue
            yield _common(scene, shared, full, bare), full, bare


def _common(scene: Scene, shared: Values, full: Scene, bare: Scene) -> Values:
    """What was changed for both and is the same in both, unlike in the scene."""
    own, ours, theirs = scene_values(scene), scene_values(full), scene_values(bare)
    return {key: v for key, v in shared.items() if own[key] != ours[key] == theirs[key]}


def _changed(scene: Scene, values: Values) -> Scene | None:
    """The scene with these values; None if it is refused or no method of its own suits it."""
    if not values:
        return scene
    try:
        changed = scene.with_values(values)
        optional_terms.check_terms(changed, needs_of(changed))
        selection.choose(changed, 0.0)
    except SceneError:
        return None
    return changed


def _nothing(scene: Scene) -> Values:
    return {}


def _values(**values: object) -> Change:
    """A change that is the same for every scene; `a__b` stands for the key `a.b`."""
    dotted: Values = {key.replace("__", "."): value for key, value in values.items()}

    def change(scene: Scene) -> Values:
        return dotted

    return change


def _spatial(scene: Scene) -> Values:
    """Space, where the scene is in a plane."""
    return {} if has(scene, "out_of_plane") else SPACE


def _driven(scene: Scene) -> Values:
    """What a driven end brings along: space, and twist if it is clamped."""
    return {**SPACE, **({"terms.twist": "on"} if needs_of(scene).twist else {})}


def _twisted(scene: Scene) -> Values:
    """Twist in space, from a shape that needs no equilibrium: none is known with torsion."""
    shape = {"initial.shape": "straight"} if scene.initial.shape == "equilibrium" else {}
    return {"terms.twist": "on", **_spatial(scene), **shape}


def _loaded(scene: Scene) -> Values:
    """What loads bring along: space, if they push out of the plane."""
    return SPACE if scene.loads and has(scene, "out_of_plane") else {}


def _sprung(scene: Scene) -> Values:
    """A spring on a free axis, too soft to be felt; or one instead of a fixed axis, as stiff."""
    for name, end in scene.ends.items():
        if not all(end.fixed):
            return {f"{name}.spring": [0.0 if held else TINY for held in end.fixed]}
    return {"end.fixed": [False, True, True], "end.spring": [STIFF, 0.0, 0.0]}


def _flat(scene: Scene) -> Values:
    """No motion along y, and no load that would push there."""
    across = any(load.force[1] or load.torque[0] or load.torque[2] for load in scene.loads)
    return {"terms.out_of_plane": "off", **({"loads.names": []} if across else {})}


TERMS = {
    "stretch": Term(
        _values(terms__stretch="on"), _values(integrator__method="rattle", integrator__step=0.0)
    ),
    "bend": Term(_values(terms__bend="on"), _values(terms__bend="off")),
    "twist": Term(
        # In a plane nothing can twist, whatever terms.twist says.
        _values(terms__twist="on"),
        _values(terms__twist="off"),
        (_spatial,),
    ),
    "frenet": Term(
        _values(terms__twist="frenet", torsion__curvature_floor=FLOOR),
        _values(terms__twist="on"),
        (_twisted,),
        "terms.twist is not frenet",
    ),
    "plasticity": Term(
        _values(plasticity__yield_curvature=NEVER, terms__plasticity="on"),
        _values(terms__plasticity="off"),
        (_spatial,),
    ),
    "gravity": Term(_values(terms__gravity="on"), _values(terms__gravity="off")),
    "springs": Term(
        _sprung,
        _values(start__fixed=[True] * 3, end__fixed=[True] * 3, **FREE),
        (_nothing, _values(end__clamped=False)),
    ),
    "loads": Term(
        _values(
            **{
                "loads.names": ["nothing"],
                "loads.nothing.type": "force",
                "loads.nothing.signal": "constant",
            }
        ),
        _values(loads__names=[]),
        (_loaded,),
    ),
    "drive": Term(_values(start__pose_topic="~/start/pose"), _values(**STILL), (_driven,)),
    "damping": Term(_values(damping__mass=TINY), _values(terms__damping="off")),
    "air_drag": Term(
        _values(damping__air_drag=TINY), _values(damping__air_drag=0.0), reason="no air drag"
    ),
    "out_of_plane": Term(_values(**SPACE), _flat, (_nothing, _values(**STILL))),
}
