"""A scene with and without each of its terms."""

from __future__ import annotations

from collections.abc import Callable, Iterable
from dataclasses import dataclass
from itertools import product

import numpy as np

from dlo_sim.core import rotations
from dlo_sim.core.end_motion import EndMotion
from dlo_sim.scene.description import Scene
from dlo_sim.scene.loading import SceneError, scene_values
from dlo_sim.scene.needs import needs_of
from dlo_sim.simulation import optional_terms, selection
from dlo_sim.tuning.trial import Job

Values = dict[str, object]
Change = Values | Callable[[Scene], Values]  # for every scene the same, or by scene

TINY = 1e-9  # a damping, drag or spring that is there and does nothing that can be seen
NEVER = 1.0e5  # [1/m] of a curvature at which nothing yields
FLOOR = 10.0  # [1/m] of curvature, below which the Frenet torsion fades
DEEP = 1.0e3  # [m] of a plane that is never touched
STIFF = 1.0e6  # [N/m] of a spring that holds as well as a fixed axis
FREE: Values = {"start.spring": [0.0] * 3, "end.spring": [0.0] * 3}
STILL: Values = {"start.pose_topic": "", "end.pose_topic": ""}
SPACE: Values = {"terms.out_of_plane": "on"}
# What both runs of a term may need because not every method knows it: the first that will do.
VERLET: Values = {"integrator.method": "velocity_verlet", "integrator.step": 0.0}
PLAIN: Values = {"damping.stiffness": 0.0, "damping.air_drag": 0.0}
UNBENT: Values = {"cable.rest_curvature": [0.0]}
METHODS: tuple[Values, ...] = ({}, VERLET, {**VERLET, **PLAIN}, {**VERLET, **PLAIN, **UNBENT})
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
    alone: tuple[Change, ...] = ({},)
    reason: str = ""


@dataclass(frozen=True, eq=False)
class Variant:
    """A term of a scene, with and without.

    Attributes:
        term: its name. automatic: whether the scene's own step contains it.
        reason: why it was left out, or empty. shared: what both scenes have and the scene has not.
        full, bare: the scene with it and without it.
        still: whether driven ends stay where they are in both runs.
    """

    term: str
    automatic: bool
    reason: str
    shared: Values
    full: Scene
    bare: Scene
    still: bool = False

    @property
    def note(self) -> str:
        """Why the term is not in the scene's step, and what both runs have in addition."""
        both = ", ".join(
            f"{key} {'empty' if value == '' else value}" for key, value in self.shared.items()
        )
        return "; ".join(filter(None, (self.reason, f"both with {both}" if both else "")))


def has(scene: Scene, term: str) -> bool:
    """Whether a scene's step contains a term."""
    needs = needs_of(scene)
    if term == "out_of_plane":
        return len(needs.axes) == 3
    if term == "air_drag":
        return bool(needs.damping and scene.damping.air_drag > 0.0)
    return bool(getattr(needs, term))


def variants(scene: Scene, terms: Iterable[str] = ()) -> list[Variant]:
    """Terms of a scene (default: all) with and without, in the order of `TERMS`.

    Raises:
        RuntimeError: no two scenes differ in one of them alone.
    """
    needs = needs_of(scene)
    found = []
    for name in terms or TERMS:
        automatic = has(scene, name)
        reason = "" if automatic else needs.left_out.get(name, TERMS[name].reason)
        still = name == "drive" and not automatic
        found.append(Variant(name, automatic, reason, *_pair(scene, name, TERMS[name]), still))
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


def _pair(scene: Scene, name: str, term: Term) -> tuple[Values, Scene, Scene]:
    """The first way to have the scene with and without a term: what both share, with, without."""
    for method, alone in product(METHODS, term.alone):
        shared = {**_values(alone, scene), **method}
        try:
            base = _changed(scene, shared)
            present = has(base, name)
            other = _changed(base, _values(term.take_out if present else term.put_in, base))
        except SceneError:
            continue
        full, bare = (base, other) if present else (other, base)
        if has(full, name) and not has(bare, name):
            # What was changed for both and is the same in both, unlike in the scene.
            own, ours, theirs = map(scene_values, (scene, full, bare))
            common = {k: v for k, v in shared.items() if own[k] != ours[k] == theirs[k]}
            return common, full, bare
    raise RuntimeError(f"omission: no two scenes differ in the term {name} alone")


def _values(change: Change, scene: Scene) -> Values:
    return change(scene) if callable(change) else change


def _changed(scene: Scene, values: Values) -> Scene:
    """The scene with these values; refused like by a simulator if no method of its own suits it."""
    if not values:
        return scene
    changed = scene.with_values(values)
    optional_terms.check_terms(changed, needs_of(changed))
    selection.choose(changed, 0.0)
    return changed


def _spatial(scene: Scene) -> Values:
    """Space, where the scene is in a plane."""
    return {} if has(scene, "out_of_plane") else SPACE


def _driven(scene: Scene) -> Values:
    """What a driven end brings along: space, and twist if it is clamped."""
    return {**SPACE, **({"terms.twist": "on"} if needs_of(scene).twist else {})}


def _turning(scene: Scene) -> Values:
    """Twist in space."""
    return {"terms.twist": "on", **_spatial(scene)}


def _twisted(scene: Scene) -> Values:
    """Twist in space, from a shape that needs no equilibrium: none is known with torsion."""
    shape = {"initial.shape": "straight"} if scene.initial.shape == "equilibrium" else {}
    return {**_turning(scene), **shape}


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


NOTHING: Values = {
    "loads.names": ["nothing"],
    "loads.nothing.type": "force",
    "loads.nothing.signal": "constant",
}
HELD: Values = {"start.fixed": [True] * 3, "end.fixed": [True] * 3, **FREE}
RATTLE: Values = {"integrator.method": "rattle", "integrator.step": 0.0}
FRENET: Values = {"terms.twist": "frenet", "torsion.curvature_floor": FLOOR}
BISHOP: Values = {"terms.twist": "bishop"}
GROUND: Values = {"obstacles.names": ["ground"], "obstacles.ground.position": [0.0, 0.0, -DEEP]}
YIELDING: Values = {"plasticity.yield_curvature": NEVER, "terms.plasticity": "on"}
TERMS = {
    "stretch": Term({"terms.stretch": "on"}, RATTLE),
    "bend": Term({"terms.bend": "on"}, {"terms.bend": "off"}),
    # In a plane nothing can twist, whatever terms.twist says.
    "twist": Term({"terms.twist": "on"}, {"terms.twist": "off"}, (_spatial,)),
    "frenet": Term(FRENET, {"terms.twist": "on"}, (_twisted,), "terms.twist is not frenet"),
    "bishop": Term(BISHOP, {"terms.twist": "on"}, (_turning,), "terms.twist is not bishop"),
    "contact": Term(GROUND, {"terms.contact": "off"}),
    "plasticity": Term(YIELDING, {"terms.plasticity": "off"}, (_spatial,)),
    "gravity": Term({"terms.gravity": "on"}, {"terms.gravity": "off"}),
    "springs": Term(_sprung, HELD, ({}, {"end.clamped": False})),
    "loads": Term(NOTHING, {"loads.names": []}, (_loaded,)),
    "drive": Term({"start.pose_topic": "~/start/pose"}, STILL, (_driven,)),
    "damping": Term({"damping.mass": TINY}, {"terms.damping": "off"}),
    "air_drag": Term({"damping.air_drag": TINY}, {"damping.air_drag": 0.0}, reason="no air drag"),
    "out_of_plane": Term(SPACE, _flat, ({}, STILL)),
}
