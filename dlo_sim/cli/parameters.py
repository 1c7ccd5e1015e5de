"""`dlo_sim parameters`: the parameter table, as the README shows it."""

import argparse
import dataclasses

from dlo_sim.cli.arguments import Parser, add_json_option
from dlo_sim.cli.output import print_json
from dlo_sim.scene.parameters import markdown_table, scene_parameters


def add_parser(subparsers: "argparse._SubParsersAction[Parser]") -> None:
    """Register the subcommand."""
    parser = subparsers.add_parser(
        "parameters",
        help="print every parameter with type, default, unit, range and meaning",
        description="Print the parameter table as markdown.",
    )
    add_json_option(parser)
    parser.set_defaults(run=run)


def run(options: argparse.Namespace) -> int:
    """Print the table; returns the exit status."""
    if options.json:
        rows = [dataclasses.asdict(row) for row in scene_parameters(("<name>",))]
        print_json({"parameters": rows})
    else:
        print(markdown_table())
    return 0
