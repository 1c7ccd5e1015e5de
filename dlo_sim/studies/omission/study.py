"""`dlo_sim study omission`: time per step with and without each term, and the error without it."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace

import numpy as np

from dlo_sim.scene.description import Scene
from dlo_sim.scene.loading import load_scene, shipped_scenes
from dlo_sim.studies import plotting
from dlo_sim.studies.catalogue import Request
from dlo_sim.studies.omission.variants import (
    FLOOR,
    MOVED,
    MOVING,
    NEVER,
    STIFF,
    TINY,
    TURNED,
    Variant,
    job,
    variants,
)
from dlo_sim.studies.report import Cell, Report
from dlo_sim.tuning.search import present_setting
from dlo_sim.tuning.trial import Trial, attempt, farthest, timed_again

DURATION = {True: 0.1, False: 1.0}  # [s]
BUDGET = {True: 0.05, False: 0.4}  # [s] of repeats
QUICK_SCENES = ("paper_wire",)
SMALLER = 0.1  # share of its own step that a run is given which fails at that
TURNS = 2  # with, without, with, without
Piece = tuple[Scene, bool]  # a scene, and whether its grippers stand still


@dataclass(frozen=True)
class Row:
    """A term of a scene.

    Attributes:
        scene, term: which. automatic: whether the scene's own step contains it.
        full, bare: time per step [s] with it and without it; nan if there is no such run.
        error: largest distance [m] between the two motions; nan likewise.
        note: why it was left out, or why there is no other run.
    """

    scene: str
    term: str
    automatic: bool
    full: float
    bare: float
    error: float
    note: str


@dataclass(frozen=True)
class Outcome:
    """What the study leaves behind; see `catalogue.Outcome`."""

    report: str
    figures: list[str]
    data: list[str]
    tables: dict[str, int]
    rows: list[Row]

    @property
    def verdicts(self) -> dict[str, str]:
        """Scene -> largest error that leaving terms out automatically makes.

        The Frenet torsion does not count: it is another model of the twist, which a scene asks for.
        """
        lines = {}
        for scene in dict.fromkeys(row.scene for row in self.rows):
            own = [row for row in self.rows if row.scene == scene and row.term != "frenet"]
            out = [row for row in own if not row.automatic]
            errors = [row.error for row in out if np.isfinite(row.error)]
            worst = f"{1e3 * max(errors):.2g} mm" if errors else "none to compare"
            lines[scene] = f"what is left out automatically changes the motion by: {worst}"
        return lines


def run_study(request: Request) -> Outcome:
    """Run the study into a folder."""
    scenes = {n: p for n, p in shipped_scenes().items() if not request.quick or n in QUICK_SCENES}
    report = Report(
        request.folder, "What leaving a term out saves and costs", request.command, scenes
    )
    found = {name: variants(load_scene(path)) for name, path in scenes.items()}
    pieces = list(dict.fromkeys(p for one in found.values() for v in one for p in _pieces(v)))
    # Motions by workers first; what is timed then has this machine to itself.
    work = [(piece, DURATION[request.quick]) for piece in pieces]
    motions = {}
    for piece, trial in zip(pieces, request.workers.map(_motion, work), strict=True):
        motions[piece] = trial
        request.progress(0.5 * len(motions) / len(pieces))
    rows: list[Row] = []
    for k, name in enumerate(scenes):
        rows += _rows(name, found[name], motions, request.quick)
        request.progress(0.5 + 0.5 * (k + 1) / len(scenes))
    report.section("Every term of every shipped scene")
    report.text(
        f"""Time per step with the term and without it, compiled and warm, the least of the repeats,
        the two in turn on this machine; the error is the largest distance anywhere on the cable
        within {DURATION[request.quick]:g} s between the two motions. Everything else is as the
        scene has it, but each run takes its own stable step; where a term needs something else, as
        a method that knows it, both have it and the note says so. Grippers that are driven move
        sideways and turn about the cable, ever faster, by {MOVED:g} m and {TURNED:g} rad within
        {MOVING:g} s. What a
        scene leaves out by itself has a reason; its error should be zero, or round-off.""",
        f"""Some terms are put in such that they do nothing that can be seen: a load of zero, a
        gripper at rest, damping of {TINY:g} /s, drag of {TINY:g} N s/m^2, a yield curvature of
        {NEVER:g} /m, a spring of {TINY:g} N/m on a free axis, or of {STIFF:g} N/m in place of a
        fixed one. *Stretch* left out is the inextensible cable (rattle, another method). *Frenet*
        is twist against the Frenet torsion with a curvature floor of {FLOOR:g} /m; without it,
        against a frame that does not turn with the curve. *Drive* left out leaves grippers where
        they are. *Air drag* is a part of damping. *Out of plane* left out takes loads across the
        plane along.""",
    )
    report.table(
        "omission",
        [
            *("scene", "term", "in its step", "with [us/step]", "without [us/step]"),
            *("saved", "error without it [mm]", "note"),
        ],
        [_cells(row) for row in rows],
        "Time per step with and without each term, and the error made by leaving it out",
    )
    _figure(report, rows)
    outcome = Outcome("", report.figures, report.data, report.tables, rows)
    summary = [f"- {scene}: {words}" for scene, words in outcome.verdicts.items()]
    path = report.write(["\n".join(summary)])
    return Outcome(str(path), report.figures, report.data, report.tables, rows)


def _rows(
    name: str, found: list[Variant], motions: Mapping[Piece, Trial], quick: bool
) -> list[Row]:
    rows = []
    for variant in found:
        trials = [motions.get(piece) for piece in _pieces(variant)]
        rows.append(_row(name, variant, *_side_by_side(variant, trials, quick)))
    return rows


def _pieces(variant: Variant) -> list[Piece]:
    """With the term, and without; none where that does not exist."""
    scenes = (variant.full, variant.bare)
    return [(scene, variant.still) for scene in scenes if scene is not None]


def _motion(piece: tuple[Piece, float]) -> Trial:
    """A scene's motion over a time [s], at a smaller step where its own one fails; a function for
    workers."""
    (scene, still), duration = piece
    whole, setting = job(scene, duration, still), present_setting(scene)
    trial = attempt(whole, setting, timed=False)
    if trial.status != "diverged":
        return trial
    smaller = attempt(whole, replace(setting, step=SMALLER * trial.step), timed=False)
    return smaller if smaller.ok else trial


def _side_by_side(variant: Variant, trials: list[Trial | None], quick: bool) -> list[Trial | None]:
    """Both timed here in turn, so that the machine is the same for the two."""
    timed = [None if t is None else replace(t, wall=float("inf"), repeats=0) for t in trials]
    for _ in range(TURNS):
        for k, (scene, still) in enumerate(_pieces(variant)):
            trial = timed[k]
            if trial is not None and trial.ok:
                whole = job(scene, DURATION[quick], still)
                timed[k] = timed_again(trial, whole, budget=BUDGET[quick] / TURNS)
    return timed or [None, None]


def _row(name: str, variant: Variant, full: Trial | None, bare: Trial | None) -> Row:
    note, off = variant.note, float("nan")
    sides = (("with it", variant.full, full), ("without it", variant.bare, bare))
    for which, scene, trial in sides:
        words = ""
        if trial is not None and not trial.ok:
            words = f"{which}: {trial.message}"
        elif trial is not None and scene is not None and trial.setting != present_setting(scene):
            words = f"{which}: fails at its own step, so at {SMALLER:g} of it"
        note = "; ".join(part for part in (note, words) if part)
    if full is not None and bare is not None and full.ok and bare.ok:
        off = farthest(bare.points, full.points)
    times = [t.wall * t.step if t is not None and t.ok else float("nan") for t in (full, bare)]
    return Row(name, variant.term, variant.automatic, times[0], times[1], off, note)


def _cells(row: Row) -> list[Cell]:
    def micro(value: float, factor: float) -> Cell:
        return factor * value if np.isfinite(value) else None

    saved = 1.0 - row.bare / row.full
    return [
        row.scene,
        row.term,
        "yes" if row.automatic else "left out",
        micro(row.full, 1e6),
        micro(row.bare, 1e6),
        f"{100 * saved:.0f} %" if np.isfinite(saved) else None,
        micro(row.error, 1e3),
        row.note.replace("|", "/"),
    ]


def _figure(report: Report, rows: list[Row]) -> None:
    shown = [row for row in rows if np.isfinite(row.full) and np.isfinite(row.bare)]
    height = 1.4 + 0.32 * len(shown)
    figure, (left, right) = plotting.new_figure(1, 2, width=12.0, height=height)
    place = np.arange(len(shown))[::-1].astype(float)
    left.barh(place + 0.2, [1e6 * r.full for r in shown], 0.38, label="with", color="tab:orange")
    left.barh(place - 0.2, [1e6 * r.bare for r in shown], 0.38, label="without", color="tab:blue")
    marks = [f"{r.scene}: {r.term}{'' if r.automatic else ' (left out)'}" for r in shown]
    left.set_yticks(place, marks)
    left.set_xlabel("time per step [us]")
    left.grid(alpha=0.3, axis="x")
    left.legend(fontsize="small")
    floor = 1e-10  # [mm]: exact agreement on a logarithmic axis
    errors = [max(1e3 * r.error, floor) for r in shown]
    right.barh(place, errors, 0.6, color="tab:gray", left=floor)
    right.set(xscale="log", xlim=(floor, None), yticks=place, yticklabels=[])
    right.set_xlabel(f"error made by leaving it out [mm]; {floor:g} stands for none")
    right.grid(alpha=0.3, axis="x")
    report.figure(
        "omission_bars",
        figure,
        {
            "scene": np.array([r.scene for r in shown]),
            "term": np.array([r.term for r in shown]),
            "with [s/step]": [r.full for r in shown],
            "without [s/step]": [r.bare for r in shown],
            "error [m]": [r.error for r in shown],
        },
        "Time per step with and without each term, and the error without it",
    )
