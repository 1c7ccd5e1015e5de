"""`dlo_sim study omission`: time per step with and without each term, and the error without it."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace

import numpy as np

from dlo_sim.scene.description import Scene
from dlo_sim.scene.loading import load_scene, shipped_scenes
from dlo_sim.studies import plotting
from dlo_sim.studies.catalogue import Outcome, Request
from dlo_sim.studies.omission.variants import TERMS, Variant, job, variants
from dlo_sim.studies.report import Cell, Report, columns
from dlo_sim.studies.runs import each
from dlo_sim.tuning.search import present_setting
from dlo_sim.tuning.trial import Trial, attempt, farthest, timed_again

DURATION = {True: 0.1, False: 1.0}  # [s]
BUDGET = {True: 0.05, False: 0.4}  # [s] of repeats
QUICK_SCENES, QUICK_TERMS = ("paper_wire",), ("stretch", "bend", "gravity", "loads", "out_of_plane")
SMALLER = 0.1  # share of its own step that a run is given which fails at that
TURNS = 2  # with, without, with, without
Piece = tuple[Scene, bool, float]  # a scene, whether its grippers stand still, how long [s]


@dataclass(frozen=True)
class Row:
    """A term of a scene.

    Attributes:
        scene, term: which. automatic: whether the scene's own step contains it.
        full, bare: time per step [s] with it and without it; nan if the run failed.
        error: largest distance [m] between the two motions; nan likewise.
        note: why it was left out, or why a run failed.
    """

    scene: str
    term: str
    automatic: bool
    full: float
    bare: float
    error: float
    note: str


def run_study(request: Request) -> Outcome:
    """Run the study into a folder."""
    quick, title = request.quick, "What leaving a term out saves and costs"
    scenes = {n: p for n, p in shipped_scenes().items() if not quick or n in QUICK_SCENES}
    report = Report(request.folder, title, request.command, scenes)
    terms = QUICK_TERMS if quick else tuple(TERMS)
    found = {name: variants(load_scene(path), terms) for name, path in scenes.items()}
    # Motions by workers first; what is timed then has this machine to itself.
    asked = [p for some in found.values() for v in some for p in pieces(v, DURATION[quick])]
    motions = each(request.workers, motion, asked)
    rows: list[Row] = []
    for k, (name, some) in enumerate(found.items()):
        for variant in some:
            timed = _side_by_side(pieces(variant, DURATION[quick]), motions, BUDGET[quick])
            rows.append(row_of(name, variant, *timed))
        request.progress(0.5 + 0.5 * (k + 1) / len(scenes))
    _describe(report, rows)
    verdicts = verdicts_of(rows)
    return report.outcome(verdicts)


def verdicts_of(rows: list[Row]) -> dict[str, str]:
    """Scene -> largest error that leaving terms out automatically makes.

    The Frenet torsion does not count: it is another model of the twist, which a scene asks for.
    """
    verdicts = {}
    for scene in dict.fromkeys(row.scene for row in rows):
        out = [r for r in rows if (r.scene, r.automatic) == (scene, False) and r.term != "frenet"]
        errors = [row.error for row in out if np.isfinite(row.error)]
        worst = f"{1e3 * max(errors):.2g} mm" if errors else "none to compare"
        verdicts[scene] = f"what is left out automatically changes the motion by: {worst}"
    return verdicts


def pieces(variant: Variant, duration: float) -> list[Piece]:
    """With the term, and without."""
    return [(scene, variant.still, duration) for scene in (variant.full, variant.bare)]


def motion(scene: Scene, still: bool, duration: float) -> Trial:
    """A scene's motion, at a smaller step where its own one fails; a function for workers."""
    whole, setting = job(scene, duration, still), present_setting(scene)
    trial = attempt(whole, setting, timed=False)
    if trial.status != "diverged":
        return trial
    smaller = attempt(whole, replace(setting, step=SMALLER * trial.step), timed=False)
    return smaller if smaller.ok else trial


def _side_by_side(both: list[Piece], motions: Mapping[Piece, Trial], budget: float) -> list[Trial]:
    """Both timed here in turn, so that the machine is the same for the two."""
    timed = [replace(motions[piece], wall=float("inf"), repeats=0) for piece in both]
    for _ in range(TURNS):
        for k, (scene, still, duration) in enumerate(both):
            if timed[k].ok:
                whole = job(scene, duration, still)
                timed[k] = timed_again(timed[k], whole, budget=budget / TURNS)
    return timed


def row_of(name: str, variant: Variant, full: Trial, bare: Trial) -> Row:
    """The row of a term from its two trials."""
    notes, off = [variant.note] if variant.note else [], np.nan
    times = {"with it": np.nan, "without it": np.nan}
    sides = (("with it", variant.full, full), ("without it", variant.bare, bare))
    for which, scene, trial in sides:
        if not trial.ok:
            notes.append(f"{which}: {trial.message}")
            continue
        times[which] = trial.wall * trial.step
        if trial.setting != present_setting(scene):
            notes.append(f"{which}: fails at its own step, so at {SMALLER:g} of it")
    if full.ok and bare.ok:
        off = farthest(bare.points, full.points)
    full_s, bare_s = times.values()
    return Row(name, variant.term, variant.automatic, full_s, bare_s, off, "; ".join(notes))


def _describe(report: Report, rows: list[Row]) -> None:
    report.section("Every term of every shipped scene")
    report.text(
        """Time per step with the term and without it, compiled and warm, the least of the repeats,
        in turn on this machine; the error is the largest distance between the two motions. Each run
        takes its own stable step; what a term needs besides, as a method that knows it, both have,
        see the note. Driven grippers move sideways and turn about the cable, ever faster. What a
        scene leaves out by itself has a reason and an error of zero, or round-off; terms that it
        lacks are put in such that they do nothing that can be seen. Left out, *stretch* is the
        inextensible cable (rattle, another method), *frenet* twist against a frame that does not
        turn with the curve, *drive* leaves grippers where they are, and *out of plane* takes loads
        across the plane along. *Air drag* is a part of damping."""
    )
    cells: list[list[Cell]] = []
    for row in rows:
        numbers = (row.full, row.bare, 1.0 - row.bare / row.full, row.error)
        shown = [number if np.isfinite(number) else None for number in numbers]
        automatic = "yes" if row.automatic else "left out"
        cells.append([row.scene, row.term, automatic, *shown, row.note.replace("|", "/")])
    report.table(
        "omission",
        "scene | term | in its step | with [us/step] | without [us/step] | saved [%] {:.0f} | "
        "error without it [mm] | note",
        cells,
        "Time per step with and without each term, and the error made by leaving it out",
    )
    _figure(report, [row for row in rows if np.isfinite(row.full + row.bare)])


def _figure(report: Report, rows: list[Row]) -> None:
    header = ("scene", "term", "with [s/step]", "without [s/step]", "error [m]")
    data = columns(header, [(r.scene, r.term, r.full, r.bare, r.error) for r in rows])
    full, bare, error = (np.array(data[name]) for name in header[2:])
    figure, (left, right) = plotting.new_figure(1, 2, 12.0, 1.4 + 0.32 * len(rows))
    place = np.arange(len(rows))[::-1].astype(float)
    left.barh(place + 0.2, 1e6 * full, 0.38, label="with", color="tab:orange")
    left.barh(place - 0.2, 1e6 * bare, 0.38, label="without", color="tab:blue")
    marks = [f"{r.scene}: {r.term}{'' if r.automatic else ' (left out)'}" for r in rows]
    left.set_yticks(place, marks)
    left.set_xlabel("time per step [us]")
    left.legend(fontsize="small")
    floor = 1e-10  # [mm]: exact agreement on a logarithmic axis
    right.barh(place, np.maximum(1e3 * error, floor), 0.6, color="gray", left=floor)
    right.set(xscale="log", xlim=(floor, None), yticks=place, yticklabels=[])
    right.set_xlabel(f"error made by leaving it out [mm]; {floor:g} stands for none")
    for axes in (left, right):
        axes.grid(alpha=0.3, axis="x")
    caption = "Time per step with and without each term, and the error without it"
    report.figure("omission_bars", figure, data, caption)
