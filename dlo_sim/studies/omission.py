"""`dlo_sim study omission`: time per step of scenes with and without each term, and the error."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping
from dataclasses import dataclass, replace
from itertools import product
from pathlib import Path
from typing import NamedTuple

import numpy as np

from dlo_sim.core.end_motion import EndMotion
from dlo_sim.scene import description, terms
from dlo_sim.scene.description import Scene
from dlo_sim.scene.loading import SceneError, load_scene, scene_values, shipped_scenes
from dlo_sim.scene.needs import check_terms, needs_of
from dlo_sim.simulation import selection
from dlo_sim.studies import Outcome, Request
from dlo_sim.studies.report import Report
from dlo_sim.studies.runs import each
from dlo_sim.tuning.setting import present_setting
from dlo_sim.tuning.trial import Job, Trial, attempt, farthest, timed_again

Values = dict[str, object]
Change = Values | Callable[[Scene], Values]  # the same for every scene, or a function of the scene

TINY = 1e-9  # a damping, drag or spring that is present without visible effect
NEVER = 1.0e5  # [1/m], a yield curvature that is never reached
FLOOR = 10.0  # [1/m], curvature floor of the Frenet torsion
DEEP = 1.0e3  # [m], depth of a plane that is never touched
STIFF = 1.0e6  # [N/m], a spring that holds as well as a fixed axis
FREE: Values = {"start.spring": [0.0] * 3, "end.spring": [0.0] * 3}
STILL: Values = {"start.pose_topic": "", "end.pose_topic": ""}
SPACE: Values = {"terms.out_of_plane": "on"}
UNTWISTED: Values = {"terms.twist": "off"}
BISHOP: Values = {"terms.twist": "bishop"}
QUASISTATIC: Values = {"terms.twist": "quasistatic"}
# Accelerated motion of grippers from rest, as an inextensible cable does not admit a velocity jump:
# [m], [rad], [s]
MOVED, TURNED, MOVING = 0.15, 1.0, 1.0
DURATION = {True: 0.1, False: 1.0}  # [s]
BUDGET = {True: 0.05, False: 0.4}  # [s] of repeats
QUICK_SCENES, QUICK_TERMS = ("paper_wire",), ("stretch", "bend", "gravity", "loads", "out_of_plane")
SMALLER = 0.1  # factor on the step of a run that failed
TURNS = 2  # with, without, with, without
EXPLANATION = """Time per step with and without the term, compiled, least of the repeats, in turn on
    this machine; the error is the largest distance between the two motions. Each run has its own
    stable step; other changes that a term requires, such as a method that supports it, are made in
    both runs, see the note. Driven grippers move sideways and rotate about the cable with constant
    acceleration. A term that a scene leaves out automatically has a reason, and an error of zero or
    round-off; terms that it lacks are added without visible effect. Without *stretch* the cable is
    inextensible, without *frenet* there is no twist, without *drive* grippers are at rest, and
    without *out of plane* loads normal to the plane are removed. *Air drag* is a part of
    damping."""
HEADER = (
    "scene | term | in its step | with [us/step] | without [us/step] | saved [%] {:.0f} | "
    "error without it [mm] | note"
)
BARS = "scene: term | with [us/step] | without [us/step]"
CAPTION = "Time per step with and without each term, and the error made by leaving it out"
Piece = tuple[Scene, bool, float]  # a scene, whether its grippers are at rest, duration [s]


def _inextensible(scene: Scene) -> Values:
    """No stretch, by a method that keeps the length; without one, the cable would fall apart."""
    values: Values = {"terms.stretch": "off", "integrator.method": "auto", "integrator.step": 0.0}
    lost = [line for line in needs_of(scene.with_values(values)).warnings if "stretch" in line]
    if lost:
        raise SceneError(lost[0])
    return values


def _sprung(scene: Scene) -> Values:
    """A very soft spring on a free axis, or a very stiff one in place of a fixed axis."""
    for name, end in scene.ends.items():
        if not all(end.fixed):
            return {f"{name}.spring": [0.0 if held else TINY for held in end.fixed]}
    return {"end.fixed": [False, True, True], "end.spring": [STIFF, 0.0, 0.0]}


def _smooth(scene: Scene) -> Values:
    """No obstacle with friction."""
    return {f"obstacles.{one.name}.friction": 0.0 for one in scene.obstacles}


def _flat(scene: Scene) -> Values:
    """No motion along y, and no load that acts there."""
    across = any(load.force[1] or load.torque[0] or load.torque[2] for load in scene.loads)
    return {"terms.out_of_plane": "off", **({"loads.names": []} if across else {})}


class Term(NamedTuple):
    """Changes that add a term to a scene and remove it; `reason`: why a scene may lack the term, if
    `needs_of` does not say; `along`: terms that come and go with it.
    """

    put_in: Change
    take_out: Change
    reason: str = ""
    along: tuple[str, ...] = ()


NOTHING: Values = {
    "loads.names": ["nothing"],
    "loads.nothing.type": "force",
    "loads.nothing.signal": "constant",
}
HELD: Values = {"start.fixed": [True] * 3, "end.fixed": [True] * 3, **FREE}
FRENET: Values = {"terms.twist": "frenet", "torsion.curvature_floor": FLOOR}
UNTOUCHED: Values = {"terms.contact": "off"}  # also for methods whose steps cannot land
GROUND: Values = {"obstacles.names": ["ground"], "obstacles.ground.position": [0.0, 0.0, -DEEP]}
YIELDING: Values = {"plasticity.yield_curvature": NEVER, "terms.plasticity": "on"}
DRAG: Values = {"damping.air_drag": TINY}
DEFAULTS = scene_values(description.default_scene())
TERMS = {
    "stretch": Term({"terms.stretch": "on"}, _inextensible),
    "bend": Term({"terms.bend": "on"}, {"terms.bend": "off"}),
    "twist": Term(BISHOP, UNTWISTED, along=("quasistatic",)),
    "frenet": Term(FRENET, UNTWISTED, "terms.twist is not frenet", ("twist", "quasistatic")),
    "quasistatic": Term(QUASISTATIC, BISHOP, "terms.twist is not quasistatic"),
    "contact": Term(GROUND, UNTOUCHED, along=("friction",)),
    "self_contact": Term({"contact.self_contact": "on"}, {"contact.self_contact": "off"}),
    "friction": Term({"contact.friction": 0.3}, _smooth),
    "plasticity": Term(YIELDING, {"terms.plasticity": "off"}),
    "gravity": Term({"terms.gravity": "on"}, {"terms.gravity": "off"}),
    "springs": Term(_sprung, HELD),
    "loads": Term(NOTHING, {"loads.names": []}),
    "drive": Term({"start.pose_topic": "~/start/pose"}, STILL),
    "damping": Term({"damping.mass": TINY}, {"terms.damping": "off"}, along=("air_drag",)),
    "air_drag": Term(DRAG, {"damping.air_drag": 0.0}, "no air drag", ("damping",)),
    "out_of_plane": Term(SPACE, _flat, along=("loads",)),
    **{
        one.name: Term({**one.faint}, {key: DEFAULTS[key] for key in one.faint}, along=("damping",))
        for one in terms.TERMS
        if one.faint
    },
}
# Changes to both runs of a pair, tried in this order until the pair differs in one term alone: of
# the method, where it does not support a term, and of what else a term needs or would bring along.
IMPLICIT: Values = {"integrator.method": "energy_momentum", "integrator.step": 0.0}
VERLET: Values = {"integrator.method": "velocity_verlet", "integrator.step": 0.0}
PLAIN: Values = {"damping.stiffness": 0.0, "damping.air_drag": 0.0, "cable.rest_curvature": [0.0]}
METHODS: tuple[Values, ...] = ({}, IMPLICIT, {**VERLET, **PLAIN}, {**VERLET, **PLAIN, **UNTOUCHED})
COMMON: tuple[Values, ...] = (
    {},
    SPACE,
    QUASISTATIC,
    UNTWISTED,
    {**UNTWISTED, "end.clamped": False},
    {"initial.shape": "straight"},
    GROUND,
    {**GROUND, **BISHOP},
)


@dataclass(frozen=True, eq=False)
class Variant:
    """A term of a scene, with and without.

    Attributes:
        automatic: whether the original scene's step contains it. reason: why not, or empty.
        shared: changes of the original scene common to `full`, with the term, and `bare`, without.
        still: whether driven ends are at rest in both runs.
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
        """Why the term is not in the scene's step, and the changes common to both runs."""
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
        return bool("damping" in needs and scene.damping.air_drag > 0.0)
    return term in needs


def single_cables() -> dict[str, Path]:
    """Paths of the shipped scenes but for nets, which some terms cannot be taken out of."""
    return {name: p for name, p in shipped_scenes().items() if not load_scene(p).is_net}


def variants(scene: Scene, terms: Iterable[str] = ()) -> list[Variant]:
    """Pairs of scenes with and without each of some terms (default: all), in the order of `TERMS`.

    Raises:
        RuntimeError: no pair of scenes differs in one of them alone.
    """
    needs = needs_of(scene)
    found = []
    for name in terms or TERMS:
        automatic = has(scene, name)
        reason = "" if automatic else needs.left_out.get(name, TERMS[name].reason)
        still = name == "drive" and not automatic
        found.append(Variant(name, automatic, reason, *_pair(scene, name), still))
    return found


def _pair(scene: Scene, name: str) -> tuple[Values, Scene, Scene]:
    """The first pair of scenes that differs in this term alone: common changes, with, without."""
    term = TERMS[name]
    for method, common in product(METHODS, COMMON):
        shared = {**common, **method}
        try:
            base = scene.with_values(shared)
            present = has(base, name)
            other = base.with_values(_values(term.take_out if present else term.put_in, base))
            full, bare = (base, other) if present else (other, base)
            if not (has(full, name) and not has(bare, name) and _alike(full, bare, name)):
                continue
            if has(full, "frenet") and full.initial.shape == "equilibrium":
                continue  # none is computed with torsion
            for one in (full, bare):  # refused, as by a simulator, if no method supports it
                check_terms(one, needs_of(one))
                selection.choose(one, 0.0)
        except SceneError:
            continue
        # Changed values that are equal in both, but differ from the original scene.
        own, ours, theirs = map(scene_values, (scene, full, bare))
        kept = {k: v for k, v in shared.items() if own.get(k) != ours[k] == theirs[k]}
        return kept, full, bare
    raise RuntimeError(f"omission: no two scenes differ in the term {name} alone")


def _alike(full: Scene, bare: Scene, name: str) -> bool:
    """Whether two scenes have the same terms, but for this one and those along with it."""
    others = set(TERMS) - {name, *TERMS[name].along}
    return all(has(full, other) == has(bare, other) for other in others)


def _values(change: Change, scene: Scene) -> Values:
    return change(scene) if callable(change) else change


def job(scene: Scene, duration: float, still: bool = False) -> Job:
    """A scene's run, in which driven grippers move sideways and rotate about the cable."""
    motions = []
    if scene.start.driven and scene.start.held and not still:
        axis = np.asarray(scene.start.tangent, dtype=float)
        axis /= max(float(np.linalg.norm(axis)), 1e-300)
        rate = 2.0 / MOVING**2
        way, turn = [0.0, rate * MOVED, 0.0], rate * TURNED * axis
        rests = EndMotion.resting(scene.start.position)
        moves = rests.then(MOVING, acceleration=way, angular_acceleration=turn)
        motions.append(("start", moves))
    return Job(scene, duration, tuple(np.linspace(0.0, 1.0, 21)), 2e-3, tuple(motions))


class Row(NamedTuple):
    """Result for a term of a scene, a row of the table: whether the scene's own step contains it,
    time per step [s] with and without it, share saved, largest distance [m] between the two
    motions, and notes; None where a run failed.
    """

    scene: str
    term: str
    own: str
    full: float | None
    bare: float | None
    saved: float | None
    error: float | None
    note: str


def run_study(request: Request) -> Outcome:
    """Run the study into a folder."""
    quick = request.quick
    scenes = {n: p for n, p in single_cables().items() if not quick or n in QUICK_SCENES}
    report = Report(request, "What leaving a term out saves and costs", scenes)
    terms = QUICK_TERMS if quick else tuple(TERMS)
    found = {name: variants(load_scene(path), terms) for name, path in scenes.items()}
    # Motions by workers first, then the timed runs alone on the machine.
    asked = [p for some in found.values() for v in some for p in pieces(v, DURATION[quick])]
    motions = each(request.workers, motion, asked)
    rows: list[Row] = []
    for name, some in found.items():
        for variant in some:
            both = pieces(variant, DURATION[quick])
            rows.append(row_of(name, variant, *_side_by_side(both, motions, BUDGET[quick])))
        request.progress(0.5 + 0.5 * len({row.scene for row in rows}) / len(scenes))
    report.text(EXPLANATION)
    report.table("omission", HEADER, rows, CAPTION)
    bars = [
        (f"{row.scene}: {row.term}{'' if row.own == 'yes' else ' (left out)'}", row.full, row.bare)
        for row in rows
        if row.full and row.bare
    ]
    report.bars("omission_bars", BARS, bars, "Time per step with and without each term")
    return report.outcome(verdicts_of(rows))


def verdicts_of(rows: list[Row]) -> dict[str, str]:
    """Scene -> largest error due to terms that are left out automatically.

    The Frenet torsion does not count: it is another model of the twist, used only on request.
    """
    verdicts = {}
    for scene in dict.fromkeys(row.scene for row in rows):
        out = [r for r in rows if (r.scene, r.own) == (scene, "left out") and r.term != "frenet"]
        errors = [row.error for row in out if row.error is not None]
        worst = f"{1e3 * max(errors):.2g} mm" if errors else "none to compare"
        verdicts[scene] = f"what is left out automatically changes the motion by: {worst}"
    return verdicts


def pieces(variant: Variant, duration: float) -> list[Piece]:
    """The runs with and without the term."""
    return [(scene, variant.still, duration) for scene in (variant.full, variant.bare)]


def motion(scene: Scene, still: bool, duration: float) -> Trial:
    """A scene's motion, at a smaller step if its own step fails; a function for workers."""
    whole, setting = job(scene, duration, still), present_setting(scene)
    trial = attempt(whole, setting, timed=False)
    if trial.status != "diverged":
        return trial
    smaller = attempt(whole, replace(setting, step=SMALLER * trial.step), timed=False)
    return smaller if smaller.ok else trial


def _side_by_side(both: list[Piece], motions: Mapping[Piece, Trial], budget: float) -> list[Trial]:
    """Time both runs in turn, so that other load affects both alike."""
    timed = [replace(motions[piece], wall=float("inf"), repeats=0) for piece in both]
    for _ in range(TURNS):
        for k, (scene, still, duration) in enumerate(both):
            if timed[k].ok:
                whole = job(scene, duration, still)
                timed[k] = timed_again(timed[k], whole, budget=budget / TURNS)
    return timed


def row_of(name: str, variant: Variant, full: Trial, bare: Trial) -> Row:
    """The result for a term from its two trials."""
    notes, times = [variant.note] if variant.note else [], []
    sides = (("with it", variant.full, full), ("without it", variant.bare, bare))
    for which, scene, trial in sides:
        times.append(trial.wall * trial.step if trial.ok else None)
        if not trial.ok:
            notes.append(f"{which}: {trial.message}")
        elif trial.setting != present_setting(scene):
            notes.append(f"{which}: fails at its own step, run at {SMALLER:g} of it")
    saved, off = None, None
    if full.ok and bare.ok:
        saved = 1.0 - bare.wall * bare.step / (full.wall * full.step)
        off = farthest(bare.points, full.points)
    own, note = "yes" if variant.automatic else "left out", "; ".join(notes).replace("|", "/")
    with_it, without_it = times
    return Row(name, variant.term, own, with_it, without_it, saved, off, note)
