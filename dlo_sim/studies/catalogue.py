"""The studies by name, with their purpose and module. Heavy imports are deferred."""

from __future__ import annotations

import importlib
from collections.abc import Callable
from dataclasses import dataclass, field
from pathlib import Path

from dlo_sim.batch.workers import Workers


@dataclass(frozen=True)
class Outcome:
    """Results of a study: path of report.md, names of the files beside it, tables with their
    numbers of rows, and verdicts, question -> short answer.
    """

    report: str
    figures: list[str]
    data: list[str]
    tables: dict[str, int]
    verdicts: dict[str, str]


@dataclass(frozen=True)
class Request:
    """A request to run a study.

    Attributes:
        folder: of the results. quick: shorter runs, with all tables and figures.
        command: as typed by the user. workers: for runs that are not timed.
        peers: measure other simulators too. data: folder of recordings, for validation.
        progress: called with the fraction done.
    """

    folder: Path
    quick: bool
    command: str
    workers: Workers
    peers: bool = False
    data: Path | None = None
    progress: Callable[[float], None] = field(default=lambda fraction: None)

    def part(self, low: float, high: float) -> Callable[[float], None]:
        """Progress callback of a part of the study, between two fractions of the whole."""
        return lambda fraction: self.progress(low + (high - low) * fraction)


@dataclass(frozen=True)
class Study:
    """A study, its name and purpose. Its module has `run_study(request) -> Outcome`."""

    name: str
    what: str
    peers: bool = False

    @property
    def module(self) -> str:
        """Dotted name of its module."""
        return f"dlo_sim.studies.{self.name.replace('-', '_')}.study"

    def run(self, request: Request) -> Outcome:
        """Import the study and run it."""
        outcome: Outcome = importlib.import_module(self.module).run_study(request)
        return outcome


_WHAT = {
    "paper": "Khalifa & Palli reproduced: their tables and figures beside ours, claims judged",
    "stability": "limits and energy errors of every method over maps, extreme cables",
    "work-precision": "error against run time: methods, resolutions, steps, beside other "
    "simulators",
    "batch": "many cables at once: vector lanes against one by one, all cores against one",
    "omission": "time per step with and without each term of the shipped scenes, and the error "
    "without",
    "scaling": "time per step against control points, memory over many steps",
    "endurance": "a day offline, half an hour of a disturbed node, bad input at random, rates and "
    "overload",
    "validation": "recorded cables (--data) beside predictions, trivial references and the noise "
    "floor",
}
STUDIES = {name: Study(name, what, name == "work-precision") for name, what in _WHAT.items()}
