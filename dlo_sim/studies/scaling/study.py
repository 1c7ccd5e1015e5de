"""`dlo_sim study scaling`: time per step, memory, and the parts of a step against the bound."""

from __future__ import annotations

from dataclasses import dataclass

from dlo_sim.scene.loading import shipped_scene
from dlo_sim.studies.catalogue import Request
from dlo_sim.studies.report import Report
from dlo_sim.studies.scaling import memory, parts, steps
from dlo_sim.studies.scaling.wire import NAME, SAMPLES_PER_SPAN, SPEED


@dataclass(frozen=True)
class Outcome:
    """What the study leaves behind; see `catalogue.Outcome`."""

    report: str
    figures: list[str]
    data: list[str]
    tables: dict[str, int]
    verdicts: dict[str, str]


def run_study(request: Request) -> Outcome:
    """Run the study into a folder."""
    quick = request.quick
    report = Report(
        request.folder,
        "Cost and memory as the cable gets finer",
        request.command,
        {NAME: shipped_scene(NAME)},
    )
    report.text(
        f"""The scene is `{NAME}` with Gauss quadrature, {SAMPLES_PER_SPAN} points per span,
        straight at first and moving downwards with half a sine wave of {SPEED:g} m/s. Everything
        here is a time or a memory of this machine, so all of it ran here, in one process:
        `--scheduler` has nothing to give away."""
    )
    # Memory first: what the timed simulators leave to the allocator would blur it.
    grown = memory.measured(quick, request.part(0.0, 0.3))
    runs = steps.timed(quick, request.part(0.3, 0.8))
    found = parts.measured(quick, request.part(0.8, 1.0))
    verdicts = steps.describe(report, runs, quick)
    verdicts |= memory.describe(report, grown)
    verdicts |= parts.describe(report, found)
    lines = [f"- {asked}: **{answer}**" for asked, answer in verdicts.items()]
    path = report.write(["\n".join(lines)])
    return Outcome(str(path), report.figures, report.data, report.tables, verdicts)
