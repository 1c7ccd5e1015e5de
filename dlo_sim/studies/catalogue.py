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
    "paper": "the tables, figures and claims of Khalifa & Palli, next to our results",
    "stability": "stability limits and energy errors of every method, also for extreme cables",
    "work-precision": "error against run time of methods, resolutions and steps, also of other "
    "simulators",
    "batch": "many cables at once: speed-up by vector lanes and by all cores",
    "omission": "time per step with and without each term of the shipped scenes, and the error "
    "of omitting it",
    "scaling": "time per step against number of control points, memory over many steps",
    "endurance": "a day of messages offline, half an hour of a disturbed node, random bad input, "
    "rates and overload",
    "validation": "predictions compared with recorded cables (--data), trivial references and the "
    "noise floor",
}
STUDIES = {name: Study(name, what, name == "work-precision") for name, what in _WHAT.items()}
