"""`dlo_sim replay BAG`: predict a cable offline from a recorded bag."""

import argparse
import dataclasses
import sys
from pathlib import Path
from typing import TYPE_CHECKING

from dlo_sim.cli import FAILED
from dlo_sim.cli.arguments import Parser, add_scene, pairs, read_scene
from dlo_sim.cli.output import error_rows, print_json, print_rows, progress_bar, readable, run_time

if TYPE_CHECKING:
    from dlo_sim.replay.replay import ReplaySummary

HELP = "predict a cable offline from a bag of poses, wrenches and forces"


def add_arguments(parser: Parser) -> None:
    """Say what the subcommand does and takes."""
    parser.description = (
        "Feed the messages of a bag to the same code as the node, as fast as possible, "
        "and write what the node would have published. Deterministic: the same bag and scene give "
        "the same bytes. Exit status 3 if only part of the bag could be replayed or more than 5 % "
        "of a topic's messages were refused; the results so far are kept."
    )
    text = "rosbag2 folder or file (sqlite3 or MCAP, compressed or not)"
    parser.option("bag BAG", text, type=Path)
    add_scene(parser, "--params", required=True)
    text = "bag to write, in the same storage format; must not exist yet (default: none)"
    parser.option("--output OUTBAG", text, type=Path)
    text = (
        "compare the predicted reaction at an end with a recorded wrench, such as "
        "start=/ft_compensated"
    )
    parser.option("--compare END=TOPIC", text, action="append", default=[])


def run(options: argparse.Namespace) -> int:
    """Replay and print the summary; returns the exit status."""
    scene = read_scene(options)
    compare = pairs("--compare", options.compare, "END=TOPIC", "start=/topic or end=...")

    from dlo_sim.replay.replay import replay_bag

    with progress_bar("replay") as progress:
        summary = replay_bag(
            options.bag, scene, options.output, compare=compare or None, progress=progress
        )
    if options.json:
        print_json(dataclasses.asdict(summary))
    else:
        _print_summary(options.bag, summary)
    if summary.ok:
        return 0
    print(f"dlo_sim: {summary.status}: {summary.message}", file=sys.stderr)
    return FAILED


def _print_summary(bag: Path, summary: "ReplaySummary") -> None:
    from dlo_sim.replay.comparison import comparison_table

    print(f"{bag}: {summary.status}, {summary.simulated_s:.3f} s simulated")
    if summary.message:
        print(f"  {summary.message}")
    refused = readable(summary.refused_by_reason) if summary.refused_by_reason else "none"
    rows = {
        "used": f"{summary.messages_used} messages",
        "refused": f"{summary.messages_refused} messages ({refused})",
        "time": run_time(summary),
    }
    if summary.messages_copied:
        rows["copies"] = f"{summary.messages_copied} messages came again and were ignored"
    rows["chosen"] = summary.resolution
    rows |= error_rows(summary.error_estimate, summary.advice)
    if summary.output:
        rows["output"] = f"{summary.output} ({summary.messages_written} messages)"
    if summary.events:
        rows["events"] = readable(summary.events)
    if summary.warnings:
        rows["warnings"] = readable(summary.warnings)
    print_rows(rows)
    if summary.comparison:
        print()
        print(comparison_table(summary.comparison))
