"""`dlo_sim study scaling`: time per step, and memory."""

from __future__ import annotations

from dlo_sim.scene.loading import shipped_scene
from dlo_sim.studies.catalogue import Outcome, Request
from dlo_sim.studies.report import Report
from dlo_sim.studies.scaling import memory, steps
from dlo_sim.studies.scaling.steps import SCENE


def run_study(request: Request) -> Outcome:
    """Run the study into a folder."""
    title, files = "Cost and memory as the cable gets finer", {SCENE: shipped_scene(SCENE)}
    report = Report(request.folder, title, request.command, files)
    report.text(
        """The scene is `paper_wire` with Gauss quadrature, three points per span, straight at first
        and moving downwards with half a sine wave of 0.3 m/s. Everything here is a time or a memory
        of this machine, so all of it ran here, in one process: `--scheduler` has nothing to give
        away."""
    )
    # Memory first: what the timed simulators leave to the allocator would blur it.
    grown = memory.measured(request.quick, request.part(0.0, 0.3))
    runs = steps.timed(request.quick, request.part(0.3, 1.0))
    verdicts = steps.describe(report, runs) | memory.describe(report, grown)
    return report.outcome(verdicts)
