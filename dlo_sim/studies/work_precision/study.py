"""`dlo_sim study work-precision`: cases, references, diagrams, targets, other simulators."""

from __future__ import annotations

from dataclasses import dataclass

from dlo_sim.scene.loading import shipped_scene
from dlo_sim.studies.catalogue import Request
from dlo_sim.studies.report import Report
from dlo_sim.studies.work_precision import analytic, references, separate, sweep, targets
from dlo_sim.studies.work_precision.cases import all_cases
from dlo_sim.studies.work_precision.peers import beside


@dataclass(frozen=True)
class Outcome:
    """What the study leaves behind; see `catalogue.Outcome`.

    Attributes:
        targets: what was asked, measured, and whether it was reached.
    """

    report: str
    figures: list[str]
    data: list[str]
    tables: dict[str, int]
    targets: list[targets.Verdict]

    @property
    def verdicts(self) -> dict[str, str]:
        """Target -> reached or not, with the numbers."""
        return {verdict.work: verdict.words for verdict in self.targets}


def run_study(request: Request) -> Outcome:
    """Run the study into a folder."""
    files = {name: shipped_scene(name) for name in ("paper_wire", "paper_wire_force")}
    report = Report(request.folder, "Error against run time", request.command, files)
    cases = all_cases(request.quick)
    # What is timed comes before anything is given to workers, which would share the machine.
    longest = {case.name: case for case in [*cases, *targets.target_cases(request.quick)]}
    others = beside.measured(request, list(longest.values()))
    verdicts = targets.add(report, request, others)
    request.progress(0.2)
    truths = references.references(cases, request.workers)
    references.add(report, cases, truths)
    request.progress(0.35)
    report.section("Error against run time, case by case")
    report.text(
        """Check, then time: a setting's error and its run time come from the same simulator, which
        is compiled and warm; the time is the least of the repeats, with the distance of their
        median. Implicit methods and explicit ones at shares of their own step; Gauss quadrature
        with three points per span. Some implicit methods run with stretching by span as well
        (dashed)."""
    )
    grid = sweep.QUICK if request.quick else sweep.FULL
    for k, case in enumerate(cases):
        shares = (0.35 + 0.4 * part / len(cases) for part in (k, k + 1))
        points = sweep.swept(case, truths[case.name], grid, request.part(*shares))
        peers = others.judged(case, truths[case.name].points)
        sweep.add(report, case, truths[case.name], points, peers)
    separate.add(report, request, cases, truths)
    request.progress(0.9)
    analytic.add(report, request)
    others.add(report)
    path = report.write(_summary(request, verdicts))
    request.progress(1.0)
    return Outcome(str(path), report.figures, report.data, report.tables, verdicts)


def _summary(request: Request, verdicts: list[targets.Verdict]) -> list[str]:
    lines = ["\n".join(f"- {verdict.work}: **{verdict.words}**" for verdict in verdicts)]
    if request.quick:
        lines.insert(0, "**Quick study:** shorter runs, fewer settings, coarser references.")
    return lines
