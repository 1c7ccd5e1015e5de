"""What the paper claims, and what was measured: the record of a claim, and their table."""

from __future__ import annotations

from dataclasses import dataclass

from dlo_sim.studies.arithmetic import Arithmetic
from dlo_sim.studies.paper.accuracy import Accuracy
from dlo_sim.studies.paper.energy import Energies
from dlo_sim.studies.paper.extras import Extras
from dlo_sim.studies.paper.motion import Motion
from dlo_sim.studies.paper.resolution import Resolution
from dlo_sim.studies.paper.stability import Limits
from dlo_sim.studies.paper.stuck import Stuck
from dlo_sim.studies.paper.sweep import Sweep
from dlo_sim.studies.paper.timing import Timings
from dlo_sim.studies.report import Report

HOLDS, PARTLY, FAILS = "holds", "holds in part", "does not hold"


@dataclass(frozen=True)
class Claim:
    """One claim.

    Attributes:
        name: short. words: the paper's own.
        verdict: holds, holds in part, does not hold. evidence: the numbers behind it, in words.
        number: the one that decides; meaning: what it is.
        shown: names of the tables and figures with the evidence.
    """

    name: str
    words: str
    verdict: str
    evidence: str
    number: float
    meaning: str
    shown: tuple[str, ...]


@dataclass(frozen=True)
class Results:
    """Everything that was measured."""

    motion: Motion
    timings: Timings
    limits: Limits
    stuck: Stuck
    sweep: Sweep
    energies: Energies
    accuracy: Accuracy
    resolution: Resolution
    extras: Extras
    arithmetic: Arithmetic


def add(report: Report, claims: list[Claim]) -> None:
    """The table of claims; the evidence in words is on the report's first page."""
    report.section("Claims")
    report.table(
        "claims",
        ["claim", "in the paper's words", "verdict", "number", "what the number is", "shown in"],
        [
            [
                c.name,
                f'"{c.words}"',
                f"**{c.verdict}**",
                c.number,
                c.meaning,
                ", ".join(f"`{name}`" for name in c.shown),
            ]
            for c in claims
        ],
        "What the paper claims and what this run says; the evidence in words is on the first page",
    )


def summary(claims: list[Claim]) -> str:
    """A line of markdown for every claim: verdict and evidence."""
    return "\n".join(f"- {c.name}: **{c.verdict}**. {' '.join(c.evidence.split())}" for c in claims)
