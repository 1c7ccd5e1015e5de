"""`dlo_sim study omission`: time per step with and without each term, and the error without it."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace

import numpy as np

from dlo_sim.scene.description import Scene
from dlo_sim.scene.loading import load_scene, shipped_scenes
from dlo_sim.studies import plotting
from dlo_sim.studies.catalogue import Request
from dlo_sim.studies.omission.variants import Variant, job, variants
from dlo_sim.studies.report import Cell, Report
from dlo_sim.tuning.search import present_setting
from dlo_sim.tuning.trial import Trial, attempt, farthest, timed_again

DURATION = {True: 0.1, False: 1.0}  # [s]
BUDGET = {True: 0.05, False: 0.4}  # [s] of repeats
QUICK_SCENES = ("paper_wire",)


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
        """Scene -> largest error that leaving terms out automatically makes."""
        lines = {}
        for scene in dict.fromkeys(row.scene for row in self.rows):
            out = [r for r in self.rows if r.scene == scene and not r.automatic]
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
    rows: list[Row] = []
    for k, (name, path) in enumerate(scenes.items()):
        rows += _rows(name, load_scene(path), request.quick)
        request.progress((k + 1) / len(scenes))
    report.section("Every term of every shipped scene")
    report.text(
        f"""Time per step with the term and without it, compiled and warm, the least of the repeats;
        the error is the largest distance anywhere on the cable within {DURATION[request.quick]:g} s
        between the two motions. Everything else is as the scene has it, but each run takes its own
        stable step. Grippers that are driven move 0.15 m sideways and turn by 1 rad about the cable
        within 0.5 s. *Stretch* left out is the inextensible cable (rattle, another method). What a
        scene leaves out by itself has a reason; its error should be zero, or round-off."""
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


def _rows(name: str, scene: Scene, quick: bool) -> list[Row]:
    def run(one: Scene) -> Trial:
        return attempt(job(one, DURATION[quick]), present_setting(one), budget=BUDGET[quick])

    as_it_is = run(scene)
    rows = []
    for variant in variants(scene):
        full = as_it_is if variant.automatic else _tried(variant.full, run)
        bare = _tried(variant.bare, run) if variant.automatic else as_it_is
        # Both are timed again side by side, so that the machine is the same for the two.
        full = _again(full, variant.full, quick)
        bare = _again(bare, variant.bare, quick)
        rows.append(_row(name, variant, full, bare))
    return rows


def _tried(scene: Scene | None, run: Callable[[Scene], Trial]) -> Trial | None:
    return None if scene is None else run(scene)


def _again(trial: Trial | None, scene: Scene | None, quick: bool) -> Trial | None:
    if trial is None or scene is None or not trial.ok:
        return trial
    fresh = replace(trial, wall=float("inf"), repeats=0)
    return timed_again(fresh, job(scene, DURATION[quick]), budget=BUDGET[quick])


def _row(name: str, variant: Variant, full: Trial | None, bare: Trial | None) -> Row:
    note, off = variant.reason, float("nan")
    for trial in (full, bare):
        if trial is None:
            note = note or "the scene refuses it"
        elif not trial.ok:
            note = trial.message
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
