"""`dlo_sim parameters`: the parameter table, as config/README.md shows it."""

import argparse
import dataclasses

from dlo_sim.cli.arguments import Parser
from dlo_sim.cli.output import print_json
from dlo_sim.scene.description import markdown_table, placeholder_parameters

HELP = "list all parameters with type, default, unit, range and meaning"


def add_arguments(parser: Parser) -> None:
    """Say what the subcommand does and takes."""
    parser.description = "Print the parameter table as markdown."


def run(options: argparse.Namespace) -> int:
    """Print the table; returns the exit status."""
    if options.json:
        rows = [dataclasses.asdict(row) for row in placeholder_parameters()]
        print_json({"parameters": rows})
    else:
        print(markdown_table())
    return 0
