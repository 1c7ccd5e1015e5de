"""`dlo_sim demo`: the main job on input that the package makes itself."""

import argparse
import dataclasses
from pathlib import Path

from dlo_sim.cli.arguments import Parser, add_json_option
from dlo_sim.cli.output import check_output_folder, print_json, print_rows, readable

FAILED = 3


def add_parser(subparsers: "argparse._SubParsersAction[Parser]") -> None:
    """Register the subcommand."""
    parser = subparsers.add_parser(
        "demo",
        help="predict a cable from a generated bag; leaves a bag, a picture and a summary",
        description="Generate a bag of gripper poses and wrenches, predict the cable from it, and "
        "write the predicted bag, a picture of the motion and a short summary.",
    )
    parser.add_argument(
        "--output",
        metavar="DIR",
        type=Path,
        default=Path("dlo_sim_demo"),
        help="folder for the results (default: ./dlo_sim_demo)",
    )
    add_json_option(parser)
    parser.set_defaults(run=run)


def run(options: argparse.Namespace) -> int:
    """Run the demo and print its summary; returns the exit status."""
    check_output_folder(options.output)

    from dlo_sim.demo.demo import run_demo

    summary = run_demo(options.output)
    if options.json:
        print_json(dataclasses.asdict(summary))
    else:
        print(f"{options.output}: {summary.status}")
        values = dataclasses.asdict(summary)
        print_rows({name.replace("_", " "): readable(value) for name, value in values.items()})
    return 0 if summary.ok else FAILED
