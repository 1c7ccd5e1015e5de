"""`dlo_sim replay BAG`: predict a cable offline from a recorded bag."""

import argparse
import dataclasses
from collections.abc import Sequence
from pathlib import Path

from dlo_sim.cli.arguments import (
    CommandError,
    Parser,
    add_json_option,
    add_scene_options,
    read_scene,
)
from dlo_sim.cli.output import check_output_folder, print_json, print_rows, readable

FAILED = 3


def add_parser(subparsers: "argparse._SubParsersAction[Parser]") -> None:
    """Register the subcommand."""
    parser = subparsers.add_parser(
        "replay",
        help="predict a cable offline from a bag of poses, wrenches and forces",
        description="Feed the messages of a bag to the same code as the node, as fast as it can, "
        "and write what the node would have published. Deterministic: the same bag and scene give "
        "the same bytes.",
    )
    parser.add_argument("bag", metavar="BAG", type=Path, help="rosbag2 folder (sqlite3 or MCAP)")
    parser.add_argument(
        "--params",
        metavar="SCENE",
        required=True,
        help="scene file, or a shipped scene's name",
    )
    parser.add_argument(
        "--output", metavar="OUTBAG", type=Path, help="bag to write; it must not exist yet"
    )
    parser.add_argument(
        "--compare",
        metavar="END=TOPIC",
        action="append",
        default=[],
        help="compare the predicted reaction at an end with a recorded wrench, such as "
        "start=/ft_compensated",
    )
    add_scene_options(parser)
    add_json_option(parser)
    parser.set_defaults(run=run)


def run(options: argparse.Namespace) -> int:
    """Replay and print the summary; returns the exit status."""
    scene = read_scene(options.params, options.assignments)
    compare = _comparisons(options.compare)
    if options.output is not None:
        check_output_folder(options.output)

    from dlo_sim.replay.replay import replay_bag

    summary = replay_bag(options.bag, scene, options.output, compare=compare)
    if options.json:
        print_json(dataclasses.asdict(summary))
    else:
        print(f"{options.bag}: {summary.status}")
        values = dataclasses.asdict(summary)
        print_rows({name.replace("_", " "): readable(value) for name, value in values.items()})
    return 0 if summary.ok else FAILED


def _comparisons(texts: Sequence[str]) -> dict[str, str] | None:
    """The pairs of `--compare`: end -> topic of the recorded wrench."""
    pairs: dict[str, str] = {}
    for text in texts:
        end, _, topic = text.partition("=")
        if end not in ("start", "end") or not topic:
            raise CommandError(f"--compare {text!r} is not END=TOPIC; give start=/topic or end=...")
        if end in pairs:
            raise CommandError(f"--compare {end} is given twice; keep one of them")
        pairs[end] = topic
    return pairs or None
