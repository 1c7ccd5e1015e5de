"""`dlo_sim study NAME`: a measurement with a report, figures and their data."""

import argparse
import dataclasses
import importlib
import shlex
from pathlib import Path

from dlo_sim.batch.workers import open_workers
from dlo_sim.cli.arguments import CommandError, Parser, add_scheduler_option, needing_plots
from dlo_sim.cli.output import check_writable, print_json, print_rows, progress_bar
from dlo_sim.studies import STUDIES, Request

HELP = "run a study and write a report with figures and data"


def add_arguments(parser: Parser) -> None:
    """Say what the subcommand does and takes."""
    parser.description = (
        "Run a study and write report.md, figures (PNG) and their data (CSV): "
        + "; ".join(f"{name} ({what})" for name, what in STUDIES.items())
        + "."
    )
    parser.option("name NAME", ", ".join(STUDIES), choices=STUDIES)
    parser.option("--output DIR", "folder for the results", type=Path, required=True)
    text = "shorter runs; all tables and figures are made"
    parser.add_argument("--quick", action="store_true", help=text)
    parser.option("--data DIR", "folder of recordings, for validation", type=Path)
    add_scheduler_option(parser)


def run(options: argparse.Namespace) -> int:
    """Run the study and print where its report is; returns the exit status."""
    _check_folder(options.output)
    words = ["dlo_sim", "study", options.name, "--output", str(options.output)]
    if options.data is not None:
        words += ["--data", options.data.name]
    words += ["--quick"] if options.quick else []
    no_figures = "study needs matplotlib; install dlo_sim with the extra 'plots'"
    with (
        needing_plots(no_figures),
        open_workers(options.scheduler) as workers,
        progress_bar(f"study {options.name}") as progress,
    ):
        command = shlex.join(words)
        request = Request(options.output, options.quick, command, workers, options.data, progress)
        module = f"dlo_sim.studies.{options.name.replace('-', '_')}"
        outcome = importlib.import_module(module).run_study(request)
    if options.json:
        print_json(dataclasses.asdict(outcome))
        return 0
    print(f"{outcome.report}")
    print_rows(outcome.verdicts)
    return 0


def _check_folder(path: Path) -> None:
    """Refuse, before any work, a folder that could not be written; it need not exist yet.

    Raises:
        CommandError: naming the path, what is wrong and the cure.
    """
    folder = path.resolve()
    while not folder.exists():
        folder = folder.parent
    if not folder.is_dir():
        raise CommandError(f"--output {path}: {folder} is not a folder; choose another one")
    check_writable(path, folder)
