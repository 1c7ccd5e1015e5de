"""`dlo_sim node`: the ROS 2 node, the same as `ros2 run dlo_sim node`."""

import argparse
from collections.abc import Sequence
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from dlo_sim.cli.arguments import Parser

HELP = "run the ROS 2 node"


def add_arguments(parser: "Parser") -> None:
    """Nothing: what follows it, also --help, is read by the node (`run_node`)."""


def run(options: argparse.Namespace) -> int:
    """Run the node without arguments; returns its exit status."""
    return run_node([])


def run_node(arguments: Sequence[str]) -> int:
    """Run the node with these arguments for ROS; returns its exit status."""
    from dlo_sim.ros.main import main

    return main(list(arguments))
