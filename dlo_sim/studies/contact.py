"""`dlo_sim study contact`: contact and friction with known answers, error against run time.

Each test is a function of its resolution, a step or a number of control points, that returns what
was measured beside the exact value, and the processor time of the steps.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from functools import partial

from dlo_sim.studies import Outcome, Request, bodies, strands
from dlo_sim.studies.known_answers import Answer, Answers
from dlo_sim.studies.report import Report
from dlo_sim.studies.throws import throws, throws_of_two

# A test as a function of its resolution, and resolutions: of every study, and of a full one.
Test = tuple[Callable[..., Answers], tuple[float, ...], tuple[float, ...]]
PANELS: dict[str, dict[str, Test]] = {  # panel of the figure -> name -> test
    "at rest, pushed, and landing": {
        "rest on a table, yaw 0": (partial(bodies.rest, 0.0), (1e-2,), (5e-3,)),
        "rest on a table, yaw 10 degrees": (partial(bodies.rest, bodies.YAW), (1e-2,), (5e-3,)),
        "bounce": (bodies.bounce, (1e-2, 1e-3), (1e-4,)),
        "drop": (bodies.drop, (1e-2, 2.5e-3), (1e-3,)),
        "plug, 1 MPa": (partial(bodies.plug, 1e6), (9,), (17,)),
        "plug, 10 MPa": (partial(bodies.plug, 1e7), (9,), (17,)),
        "plug, 1 GPa": (partial(bodies.plug, 1e9), (9,), (17,)),
    },
    "lifted ends": {
        "lifted end, held": (partial(bodies.lifted, True), (20, 40), (80,)),
        "lifted end, pinned": (partial(bodies.lifted, False), (20, 40), (80,)),
    },
    "friction": {
        "sliding rod, 3.8 N": (partial(bodies.sticking, 3.8), (5e-4,), (2.5e-4,)),
        "sliding rod, 5 N": (partial(bodies.sliding, 5.0), (1e-2, 5e-3), (1e-3,)),
        "sliding rod, 8 N": (partial(bodies.sliding, 8.0), (1e-2, 5e-3), (1e-3,)),
        "sliding rod, 10 N": (partial(bodies.sliding, 10.0), (1e-2, 5e-3), (1e-3,)),
        "slope": (bodies.slope, (5e-3,), (2e-3,)),
        "conveyor": (bodies.conveyor, (5e-3, 1e-3), ()),
    },
    "drums, pegs and walls": {
        "capstan, pi/2": (partial(bodies.capstan, 0.5 * math.pi), (23, 43), (83,)),
        "capstan, pi": (partial(bodies.capstan, math.pi), (43, 83), (123,)),
        "capstan, 2 pi": (partial(bodies.capstan, 2.0 * math.pi), (83,), (166,)),
        "chain over pegs": (bodies.pegs, (60, 100), ()),
        "column between walls": (bodies.column, (43,), (83,)),
    },
    "the cable and itself": {
        "loose overhand knot": (strands.knot, (140,), (200,)),
        "linked loops": (strands.linked, (70,), (100,)),
        "plectoneme": (strands.plectoneme, (40,), (60,)),
    },
    "throws": {
        "random throws at 20 m/s": (throws, (60,), (1000,)),
        "of two cables": (throws_of_two, (30,), (500,)),
    },
}
HEADER = (
    "test | resolution | quantity | exact | measured | error [%] | allowed | verdict | run time [s]"
)
CHART = "panel | test | run time [s] | largest error [%]"


def run_study(request: Request) -> Outcome:
    """Run the study into a folder."""
    report = Report(request, "Contact and friction: known answers", {})
    rows: list[tuple[object, ...]] = []
    loops: list[tuple[object, ...]] = []
    points: list[tuple[str, str, float, float]] = []
    verdicts = {}
    tests = [(panel, *item) for panel, those in PANELS.items() for item in those.items()]
    for number, (panel, name, (test, few, more)) in enumerate(tests):
        for resolution in few if request.quick else few + more:
            try:
                found = test(resolution)
            except RuntimeError as failure:
                verdicts[name] = f"misses: {failure}"
                rows.append((name, resolution, str(failure), *[None] * 4, "misses", None))
                continue
            verdicts[name] = verdict(found)
            rows += [row(name, resolution, answer, found.seconds) for answer in found.answers]
            loops += found.loops
            relative = [abs(answer.error) for answer in found.answers if answer.exact]
            points += [(panel, name, found.seconds, max(relative))] if relative else []
        request.progress((number + 1.0) / len(tests))
    report.text(
        """The resolution is a step [s], a number of control points or of throws; a test is judged
        at the last one. Run time is processor time of the steps with energy_momentum, without
        building the simulator. Lengths of lifted ends include the (4 EI / k)^(1/4) by which a table
        of finite stiffness lets go earlier. What should be 0 is allowed to be up to the number
        given.""",
        """A quick study makes 60 of the 1,000 throws. One passes if the surface that the axis
        sweeps meets the middle of a body, or if the writhe of the axis jumps as where strands
        cross. The energy is open by a share of what is exchanged, the momentum by one of what the
        cable has at the start: all of it at itself; at bodies without friction what they keep,
        along a bar and about the centre of a sphere.
        """,
    )
    report.table("contact", HEADER, rows, "Known answers")
    report.chart("contact_cost", CHART, points, "Error against run time", log="xy", marker="o")
    report.text(
        """The pull of a knot is a mean between two loops, from their difference in energy; that at
        the ends ripples about it. Factor and exponent of the loose limit are those of square
        polynomials in (D / e)^(1/2) at 0."""
    )
    report.table(
        "knots", strands.LOOPS, loops, "Overhand knots: means of the pull between two loops"
    )
    return report.outcome(verdicts)


def verdict(found: Answers) -> str:
    """Whether all answers are within what is allowed: the one that is nearest to it or beyond."""
    worst = max(found.answers, key=lambda one: abs(one.error) / (one.allowed or 1e-300))
    words = "meets" if all(answer.meets for answer in found.answers) else "misses"
    return f"{words}: {worst.words}, in {found.seconds:.2g} s"


def row(name: str, resolution: float, answer: Answer, seconds: float) -> tuple[object, ...]:
    """Row of HEADER."""
    allowed = f"{100.0 * answer.allowed:.3g} %" if answer.exact else f"{answer.allowed:.3g}"
    error = answer.error if answer.exact else None
    words = "meets" if answer.meets else "misses"
    shown = (answer.quantity, answer.exact, answer.value, error, allowed, words)
    return name, resolution, *shown, seconds
