"""`dlo_sim study stability`: what is timed first, here; then the maps and scenes, by workers."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass
from typing import TypeVar

from dlo_sim.scene.loading import shipped_scene
from dlo_sim.studies.catalogue import Request
from dlo_sim.studies.report import Report
from dlo_sim.studies.stability import extremes, map_figures, maps, random_report, sections, stiff
from dlo_sim.studies.stability.materials import MATERIALS
from dlo_sim.studies.stability.random_checks import run_seed
from dlo_sim.studies.stability.scenes import EXTREMES
from dlo_sim.studies.stability.sections import Verdict

Result = TypeVar("Result")
WARM = 0.002  # of an extreme scene, run before it is timed
ALUMINIUM, STEEL = "aluminium wire", "steel wire"  # of the extreme scenes
RANDOM = {True: 60, False: 2000}  # scenes, by `quick`


@dataclass(frozen=True)
class Outcome:
    """What the study leaves behind: the report, its files, what was asked and measured."""

    report: str
    figures: list[str]
    data: list[str]
    tables: dict[str, int]
    asked: list[Verdict]

    @property
    def verdicts(self) -> dict[str, str]:
        """What was asked -> holds or falls short."""
        return {one.name: f"{one.answer} ({one.measured})" for one in self.asked}


def run_study(request: Request) -> Outcome:
    """Run the whole study into a folder."""
    report = Report(
        request.folder,
        "Stability: how far the methods go, extreme cables, random scenes",
        request.command,
        {"paper_wire": shipped_scene("paper_wire")},
    )
    asked = _stiff(report, request.quick)
    request.progress(0.1)
    # The scenes of the table are timed too; once before, so that nothing compiles in them.
    findings = []
    for extreme in EXTREMES:
        extremes.examine(extreme, share=WARM)
        findings.append(extremes.examine(extreme))
        request.progress(0.1 + 0.1 * len(findings) / len(EXTREMES))
    asked += sections.add_extremes(report, findings, _steel())
    extent = maps.QUICK if request.quick else maps.FULL
    points = maps.points(extent)
    found = _watched(request.workers.map(maps.examine, points), len(points), request, 0.2, 0.65)
    map_figures.add(report, extent, dict(zip(points, found, strict=True)))
    seeds = range(RANDOM[request.quick])
    outcomes = _watched(request.workers.map(run_seed, seeds), len(seeds), request, 0.65, 1.0)
    asked += random_report.add_random(report, outcomes)
    path = report.write(_summary(request.quick, asked))
    return Outcome(str(path), report.figures, report.data, report.tables, asked)


def _stiff(report: Report, quick: bool) -> list[Verdict]:
    steps = (*stiff.STEPS, *stiff.HARD_STEPS)
    repeats = 2 if quick else 5
    sizes = stiff.ASKED_RATIO
    rows = [row for n in sizes for row in stiff.measure(n, steps, repeats)]
    gauss = [row for n in sizes for row in stiff.measure(n, steps, repeats, gauss=True)]
    composed = [
        row
        for n in sizes
        for row in stiff.measure(n, stiff.COMPOSED_STEPS, repeats, method="energy_momentum_4")
    ]
    return sections.add_stiff(report, rows, gauss, composed, stiff.reference_error())


def _steel() -> float:
    """Run time of the steel wire over that of the aluminium wire, in turns, the least of each."""
    walls: dict[str, list[float]] = {ALUMINIUM: [], STEEL: []}
    for _ in range(5):
        for extreme in MATERIALS:
            if extreme.name in walls:
                walls[extreme.name].append(extremes.examine(extreme).wall)
    return min(walls[STEEL]) / min(walls[ALUMINIUM])


def _watched(
    results: Iterable[Result], count: int, request: Request, begin: float, end: float
) -> list[Result]:
    """The results as a list, with the progress from one fraction to another."""
    done = []
    for result in results:
        done.append(result)
        request.progress(begin + (end - begin) * len(done) / count)
    return done


def _summary(quick: bool, asked: list[Verdict]) -> list[str]:
    """The first page: what was asked, what was measured."""
    lines = [
        "The step of a simulation should follow the accuracy that is asked for and not the fastest "
        "wave of the cable, and nothing may ever turn into NaN. This report shows how far every "
        "method goes, what becomes of extreme cables, and of random ones."
    ]
    if quick:
        lines.append("**Quick study:** coarser maps, shorter runs and fewer random scenes.")
    short = [one for one in asked if not one.holds]
    lines.append(f"Asked and measured: {len(asked) - len(short)} of {len(asked)} hold.")
    table = ["| asked of | asked | measured | |", "|---|---|---|---|"]
    table += [
        f"| {one.name} | {one.asked} | {one.measured} | "
        f"{'holds' if one.holds else '**falls short**'} |"
        for one in asked
    ]
    lines.append("\n".join(table))
    return lines
