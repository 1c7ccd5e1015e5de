"""A quick study, and the tables that it writes."""

import csv
from pathlib import Path
from typing import Any

from dlo_sim.batch.workers import HERE
from dlo_sim.studies import Outcome, Request


def quick(module: Any, folder: Path, **more: Any) -> Outcome:
    """Run a quick study into a folder."""
    outcome: Outcome = module.run_study(Request(folder, True, "dlo_sim study", HERE, **more))
    return outcome


def rows_of(folder: Path, name: str) -> list[dict[str, str]]:
    """The rows of a table or of the data of a figure."""
    with (folder / f"{name}.csv").open(encoding="utf-8", newline="") as stream:
        return list(csv.DictReader(stream))
