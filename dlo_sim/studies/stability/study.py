"""`dlo_sim study stability`: timed runs first, in this process; then the maps, by workers."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

from dlo_sim.scene.loading import shipped_scene
from dlo_sim.studies import Outcome, Request
from dlo_sim.studies.report import Report
from dlo_sim.studies.stability import maps, stiff
from dlo_sim.studies.stability.extremes import Finding, examine
from dlo_sim.studies.stability.scenes import EXTREMES

WARM = 0.002  # share of an extreme scene that is run before it is timed
TITLE = "Stability limits of the methods, and extreme cables"


def run_study(request: Request) -> Outcome:
    """Run the whole study into a folder."""
    scenes = {"paper_wire": shipped_scene("paper_wire")}
    report = Report(request, TITLE, scenes)
    verdicts = stiff.describe(report, stiff.measured(request.quick, request.part(0.0, 0.3)))
    findings = []
    for extreme in EXTREMES:
        examine(extreme, share=WARM)  # compiles
        findings.append(examine(extreme))
        request.progress(0.3 + 0.2 * len(findings) / len(EXTREMES))
    verdicts |= _describe(report, findings)
    points = maps.points(request.quick)
    results = {}
    found = request.workers.map(maps.examine, points)
    for point, limits in zip(points, found, strict=True):
        results[point] = limits
        request.progress(0.5 + 0.5 * len(results) / len(points))
    maps.add(report, request.quick, results)
    return report.outcome(verdicts)


def _describe(report: Report, findings: Sequence[Finding]) -> dict[str, str]:
    """Add section and table of the extreme scenes; returns the verdicts."""
    rows: list[list[Any]] = []
    verdicts = {}
    for one in findings:
        extreme, right = one.extreme, "yes" if one.right else "**no**"
        ran = one.run.cells if one.run else [None] * 6
        rows.append([extreme.name, extreme.what, one.outcome, right, one.error, extreme.bound])
        rows[-1] += [one.of_what, *ran, one.reason]
        measured = one.outcome if one.error is None else f"{one.error:.1e}"
        answer = "holds" if one.right else "falls short"
        verdicts[extreme.name] = f"{answer}: {measured}, at most {extreme.bound:g}"
    header = (
        "scene | description | outcome | right | error | bound | error of | energy error | "
        "method | step [ms] | steps | iterations | run time [s] | reason"
    )
    report.section("Extreme cables")
    report.table("extremes", header, rows, "Extreme scenes")
    return verdicts
