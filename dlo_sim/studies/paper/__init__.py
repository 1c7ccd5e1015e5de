"""`dlo_sim study paper`: Khalifa & Palli reproduced, tables and figures beside the printed ones,
and verdicts on the claims at the top of the report.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

from dlo_sim.scene.loading import shipped_scene
from dlo_sim.studies import Outcome, Request
from dlo_sim.studies.paper import accuracy, claims, energy, limits, motion, timing
from dlo_sim.studies.paper.published import CPP_1, MATLAB_1, STEP
from dlo_sim.studies.paper.wires import SCENES, Paper, scenario, softening
from dlo_sim.studies.report import Report

# Timed sections come first, before other load heats the machine.
SECTIONS = (
    ("Run time against simulated time (Tables 1 to 4)", timing.add),
    ("Cost over n_u and n_s (Tables 5 to 8)", timing.add_sizes),
    ("Largest stable step, and requirements of 2 ms", limits.add),
    ("The motion", motion.add),
    ("Energy, its drift, and the growth of position errors", energy.add),
    ("Accuracy against run time", accuracy.add),
    ("Error against the reference model", accuracy.add_resolution),
)
OPENING = """A. Khalifa and G. Palli model a deformable linear object (an aluminium wire 2 m long
    and 2 mm thick, both ends guided along x on springs of 10 kN/m) by a cubic B-spline with n_u
    control points and n_s quadrature samples, and compare three time integrators: a fourth-order
    symplectic one (Forest-Ruth/Neri), classical Runge-Kutta and Zhai's two-step method, in MATLAB
    and C++, in two scenarios: gravity alone, and gravity with a sinusoidal force at the centre.
    This report repeats all of it with the published constants, with the tables side by side, and
    gives verdicts on the claims. The step of 2 ms cannot be reproduced: explicit methods are stable
    up to some 20 us, so they run at their own steps here, and results at 2 ms are marked."""
QUICK = """**Quick study:** extrapolated rows are marked. Growth over time and errors against the
    reference are from 1 s instead of 10 s; verdicts can differ from those of the full study."""


@dataclass(frozen=True)
class PaperOutcome(Outcome):
    """Results of the study, and the claims with their verdicts."""

    claims: list[dict[str, Any]]


def run_study(request: Request) -> PaperOutcome:
    """Run the whole study into a folder."""
    scenes = {name: shipped_scene(name) for name in SCENES.values()}
    title = "Khalifa & Palli's symplectic spline cable, reproduced"
    report = Report(request, title, scenes)
    factor = softening(scenario(1), STEP)
    paper = Paper(report, request.workers, request.quick, factor)
    for k, (heading, add) in enumerate(SECTIONS):
        report.section(heading)
        add(paper)
        request.progress((k + 1) / len(SECTIONS))
    found = paper.found
    found[limits.AT_2_MS[1]] = factor
    matlab, cpp = (table["forest_ruth"][-1] for table in (MATLAB_1, CPP_1))
    found["MATLAB / C++ time of the paper"] = matlab / cpp
    report.section("Claims")
    judged = claims.judge(report, found)
    lines = [f"- {c['name']}: **{c['verdict']}**. {claims.evidence(c)}." for c in judged]
    report.table("measured", "what | value", found.items(), "Everything measured by its name")
    opening = [" ".join(text.split()) for text in (OPENING, QUICK)[: 1 + request.quick]]
    verdicts = {claim["name"]: claim["verdict"] for claim in judged}
    outcome = report.outcome(verdicts, [*opening, "## Verdicts", "\n".join(lines)])
    return PaperOutcome(**vars(outcome), claims=judged)
