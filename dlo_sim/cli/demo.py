"""`dlo_sim demo`: the main job on input that the package makes itself."""

import argparse
import dataclasses
import sys
from pathlib import Path
from typing import TYPE_CHECKING

from dlo_sim.cli import FAILED
from dlo_sim.cli.arguments import CommandError, Parser
from dlo_sim.cli.output import print_json, print_rows, progress_bar, readable, run_time

if TYPE_CHECKING:
    from dlo_sim.demo.demo import DemoSummary


HELP = "predict a cable from a generated bag; writes a bag, a web page and a picture"


def add_arguments(parser: Parser) -> None:
    """Say what the subcommand does and takes."""
    parser.description = (
        "Generate a bag of gripper poses and wrenches, predict the cable from it, and "
        "write the predicted bag, a web page that plays it and a picture; print a summary."
    )
    text = "folder for the results (default: ./dlo_sim_demo)"
    parser.option("--output DIR", text, type=Path, default=Path("dlo_sim_demo"))


def run(options: argparse.Namespace) -> int:
    """Run the demo and print its summary; returns the exit status."""
    from dlo_sim.demo.demo import DemoError, DemoFailed, run_demo

    try:
        with progress_bar("demo") as progress:
            summary = run_demo(options.output, progress=progress)
    except DemoError as refusal:
        raise CommandError(f"--output: {refusal}") from None
    except DemoFailed as failure:
        if options.json:
            print_json({"status": "failed", "message": str(failure)})
        print(f"dlo_sim: error: {failure}", file=sys.stderr)
        return FAILED
    if options.json:
        print_json(dataclasses.asdict(summary))
    else:
        _print_summary(summary)
    return 0 if summary.ok else FAILED


def _print_summary(summary: "DemoSummary") -> None:
    print(f"A cable hangs from a moving gripper; prediction from a bag: {summary.status}.")
    if summary.message:
        print(f"  {summary.message}")
    rows = {
        "scene": summary.scene,
        "input bag": f"{summary.input} ({summary.messages_used} messages used)",
        "predicted": f"{summary.predicted} ({summary.messages_written} messages)",
        "page": f"{summary.page} (open it in a browser)",
        "picture": summary.picture or "-",
        "time": f"{summary.simulated_s:.3g} s simulated in {run_time(summary)}",
        "tip": f"up to {summary.tip_speed_max:.3g} m/s",
        "reaction": f"up to {summary.reaction_max:.3g} N at the gripper, "
        f"{summary.reaction_rest:.3g} N at rest",
    }
    if summary.notes:
        rows["notes"] = readable(summary.notes)
    print_rows(rows)
    print("Try next:")
    print_rows(summary.try_next)
