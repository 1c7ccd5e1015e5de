"""`dlo_sim doctor [SCENE]`: is everything in order, and what to do if not."""

import argparse
from typing import TYPE_CHECKING

from dlo_sim.cli import FAILED
from dlo_sim.cli.arguments import CommandError, Parser, add_scene, positive_seconds, read_scene
from dlo_sim.cli.output import print_json, tell

if TYPE_CHECKING:
    from dlo_sim.doctor.findings import Finding

HELP = "check the installation, a scene and its topics, and suggest fixes"


def add_arguments(parser: Parser) -> None:
    """Say what the subcommand does and takes."""
    parser.description = (
        "Check versions, compiler, cache and the ROS environment; with a scene, also its terms, "
        "method and step, whether this machine keeps up, and its live topics. Exit status 3 if "
        "there is a problem."
    )
    add_scene(parser, nargs="?")
    text = "how long to listen to the topics [s] (default: 3)"
    parser.option("--seconds S", text, type=positive_seconds, default=3.0)


def run(options: argparse.Namespace) -> int:
    """Look and print; returns the exit status."""
    scene = read_scene(options) if options.scene else None
    try:
        from dlo_sim.doctor.findings import examined
    except ImportError as error:
        if not (error.name or "").startswith("rosbags"):
            raise
        raise CommandError("messages need rosbags; install it with: pip install rosbags") from None
    found = []
    for finding in examined(scene, options.seconds, tell):
        found.append(finding)
        if not options.json:
            _print(finding)
    if options.json:
        print_json({"findings": [finding._asdict() for finding in found]})
    return FAILED if any(finding.level == "problem" for finding in found) else 0


def _print(finding: "Finding") -> None:
    print(f"{finding.level:<7}  {finding.what}", flush=True)
    if finding.cure:
        print(f"{'':<7}  -> {finding.cure}", flush=True)
