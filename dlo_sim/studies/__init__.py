"""Studies: measurements with a report, tables, figures and their data.

Each is data over shared parts: `runs.py` runs, compares and times scenes, `report.py` writes rows
as tables, charts and CSV files. The heavy imports of a study happen when it is run.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path

from dlo_sim.batch.workers import Workers

# Name -> what it measures. The module of that name has `run_study(request) -> Outcome`.
STUDIES = {
    "paper": "the tables, figures and claims of Khalifa & Palli, next to our results",
    "stability": "stability limits and energy errors of every method",
    "work-precision": "error against run time of methods, resolutions and steps",
    "omission": "time per step with and without each term of the shipped scenes, and the error "
    "of omitting it",
    "contact": "known answers of contact and friction, error against run time",
    "validation": "predictions compared with recorded cables (--data), trivial references and the "
    "noise floor",
}


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
        data: folder of recordings, for validation. progress: called with the fraction done.
    """

    folder: Path
    quick: bool
    command: str
    workers: Workers
    data: Path | None = None
    progress: Callable[[float], None] = lambda fraction: None
