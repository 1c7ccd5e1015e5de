"""Studies: measurements with a report, tables, figures and their data.

`STUDIES` lists them. The heavy imports of a study happen when it is run.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path

from dlo_sim.batch.workers import Workers

# Name -> what it measures. The module of the same name has `run_study(request) -> Outcome`.
STUDIES = {
    "paper": "the tables, figures and claims of Khalifa & Palli, next to our results",
    "stability": "stability limits and energy errors of every method, also for extreme cables",
    "work-precision": "error against run time of methods, resolutions and steps, also of other "
    "simulators",
    "omission": "time per step with and without each term of the shipped scenes, and the error "
    "of omitting it",
    "validation": "predictions compared with recorded cables (--data), trivial references and the "
    "noise floor",
}
WITH_PEERS = ("work-precision",)


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
    progress: Callable[[float], None] = lambda fraction: None

    def part(self, low: float, high: float) -> Callable[[float], None]:
        """Progress callback of a part of the study, between two fractions of the whole."""
        return lambda fraction: self.progress(low + (high - low) * fraction)
