"""`dlo_sim study work-precision`: cases, references, diagrams, and other simulators."""

from __future__ import annotations

from dlo_sim.scene.loading import shipped_scene
from dlo_sim.studies import Outcome, Request
from dlo_sim.studies.report import Cell, Report
from dlo_sim.studies.work_precision import analytic, references, separate, sweep
from dlo_sim.studies.work_precision.cases import all_cases
from dlo_sim.studies.work_precision.peers import beside

SHOWN_LEVEL = 0.01  # error, relative to the scale, for the verdict on the fastest setting


def run_study(request: Request) -> Outcome:
    """Run the study into a folder."""
    files = {name: shipped_scene(name) for name in ("paper_wire", "paper_wire_force")}
    report = Report(request.folder, "Error against run time", request.command, files)
    cases = all_cases(request.quick)
    others = beside.Peers(request)
    truths = references.references(cases, request.workers)
    request.progress(0.2)
    references.add(report, cases, truths)
    report.section("Error against run time, case by case")
    report.text(
        """Error and run time of a setting, least of the repeats, are from the same simulator.
        Implicit methods run at given steps, energy_momentum also with a tolerance of 1e-3 of the
        energy exchanged; explicit ones at shares of their own step. Gauss quadrature with three
        points per span."""
    )
    levels: list[list[Cell]] = []
    beside_us: list[list[Cell]] = []
    verdicts: dict[str, str] = {}
    for k, case in enumerate(cases):
        truth, low = truths[case.name], 0.2 + 0.6 * k / len(cases)
        runs = sweep.swept(case, truth, request.quick, request.part(low, low + 0.6 / len(cases)))
        peers = others.runs(case, truth.points)
        sweep.diagram(report, case, truth, runs, peers)
        levels += sweep.level_rows(case, truth, runs)
        rows = sweep.peer_rows(case, runs, peers)
        beside_us += rows
        found = sweep.fastest(runs, SHOWN_LEVEL)
        words = f"{found.words}: {found.wall:.2g} s" if found else "no setting tried"
        verdicts[f"{case.name}, a simulated second within 1 %"] = words
        ratios = [float(row[-1]) for row in rows if isinstance(row[-1], float)]
        if ratios:
            words = f"take {min(ratios):.3g} to {max(ratios):.3g} times as long"
            verdicts[f"{case.name}, others at their errors"] = words
    report.section("The fastest settings")
    report.table("fastest", sweep.FASTEST, levels, "The fastest setting for each error")
    if request.peers:
        caption = "Other simulators, and the fastest dlo_sim setting whose error is not larger"
        report.table("peers", sweep.BESIDE, beside_us, caption)
        report.text(
            """The chain and MuJoCo 4 observe the same material point. MuJoCo's cables are
            inextensible; on the wire their end springs include its axial compliance."""
        )
    report.text(*(f"Not measured: {line}" for line in others.absent))
    separate.add(report, request, cases, truths)
    request.progress(0.95)
    analytic.add(report, request.quick)
    request.progress(1.0)
    return report.outcome(verdicts)
