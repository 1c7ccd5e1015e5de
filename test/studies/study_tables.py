"""A quick study, and the tables that it writes."""

import csv
from pathlib import Path

from dlo_sim.batch.workers import HERE
from dlo_sim.studies import Outcome, Request


def quick(module, folder: Path, **more) -> Outcome:
    """Run a quick study into a folder."""
    return module.run_study(Request(folder, True, "dlo_sim study", HERE, **more))


def rows_of(folder: Path, name: str) -> list[dict[str, str]]:
    """The rows of a table or of the data of a figure."""
    with (folder / f"{name}.csv").open(encoding="utf-8", newline="") as stream:
        return list(csv.DictReader(stream))
