"""`dlo_sim identify DATA`: a scene whose numbers are those of a recorded cable."""

import argparse
from math import isnan
from pathlib import Path
from typing import TYPE_CHECKING, Any

from dlo_sim.cli.arguments import (
    CommandError,
    Parser,
    add_scene,
    as_typed,
    needing_plots,
    number,
    pairs,
    positive_seconds,
    read_scene,
)
from dlo_sim.cli.output import (
    check_output_file,
    error_rows,
    print_json,
    print_rows,
    progress_bar,
    tell,
    write_scene,
)
from dlo_sim.scene.loading import parse_assignment

if TYPE_CHECKING:
    from dlo_sim.identification.identify import Identified

HELP = "fit the parameters of a scene to a recorded cable"


def add_arguments(parser: Parser) -> None:
    """Say what the subcommand does and takes."""
    parser.description = (
        "Fit a scene to a cable moved by grippers and write the scene with the fitted parameters. "
        "From markers: stiffness, damping, drag, length, natural curvature and where the grippers "
        "hold the cable. From the force on a gripper: stiffness, damping and drag. Each parameter "
        "has a 95 % interval; one that the data cannot determine keeps its value and is reported. "
        "Mass is not fitted: stiffness and drag are those for the given mass."
    )
    parser.option("data DATA", ".npz of markers, or a bag of markers or a force", type=Path)
    add_scene(parser, "--scene", required=True)
    parser.option("--output FITTED.yaml", "scene file to write", type=Path, required=True)
    text = "fit only this key; repeatable (default: all keys that the data can determine)"
    parser.option("--fit KEY", text, action="append", default=[])
    share = number("0.3", lambda value: 0.0 <= value < 1.0, "a share; give 0 or more, below 1")
    text = "share of the pieces, the last ones, held out from a first fit (default: 0.3)"
    parser.option("--leave-out SHARE", text, type=share, default=0.3)
    text = "length of the pieces of a recording [s]; each starts from its markers (default: 5)"
    parser.option("--piece S", text, type=positive_seconds, default=5.0)
    text = (
        "topic of a bag: markers=... or force=..., start=..., end=...; repeatable (default: found "
        "by type)"
    )
    parser.option("--topic NAME=TOPIC", text, action="append", default=[])
    parser.option("--plots DIR", "folder for plots of residuals", type=Path)


def run(options: argparse.Namespace) -> int:
    """Fit, write and print; returns the exit status."""
    scene = read_scene(options)
    check_output_file(options.output, options.scene, options.data)
    if options.plots is not None:
        with needing_plots("--plots needs matplotlib; install dlo_sim with the extra 'plots'"):
            from dlo_sim.cli.residuals import draw_residuals

    from dlo_sim.batch.workers import open_workers
    from dlo_sim.identification.identify import identify
    from dlo_sim.identification.readers import read_recordings

    names = ("markers", "force", "start", "end")
    topics = pairs("--topic", options.topic, "NAME=TOPIC", " or ".join(names) + "=/topic", names)
    asked = dict(parse_assignment(text) for text in options.assignments)
    both = next((key for key in options.fit if key in asked), "")
    if both:
        raise CommandError(
            f"--fit {both}: --set gives it, so it is not fitted; leave one of them out"
        )
    recordings = read_recordings(options.data, topics)
    with open_workers() as workers, progress_bar("identify") as progress:
        found = identify(
            scene, asked, recordings, workers, options.fit, options.leave_out, options.piece,
            progress, tell,
        )  # fmt: skip
    words = ["dlo_sim", "identify", options.data.name, "--scene", options.scene]
    words += [word for key in options.fit for word in ("--fit", key)]
    rows = [f"{label}: {text}" for label, text in _rows(found).items()]
    made = f"Fitted by {as_typed(words, options.assignments)}"
    write_scene(options.output, found.scene, made, [*rows, "", "In brackets: 95 % intervals."])
    facts = _facts(options, found)
    if options.plots is not None:
        draw_residuals(options.plots, found)
    if options.json:
        print_json(facts)
        return 0
    print(f"{options.data}: identified, {found.seconds:.0f} s")
    estimate = None if found.error is None else found.error.numbers
    print_rows(_rows(found) | error_rows(estimate, found.advice))
    print_rows({"output": str(options.output)})
    return 0


def _rows(found: "Identified") -> dict[str, str]:
    rows = {
        one.unknown.label: f"{one.value:.4g}  ({one.low:.4g} to {one.high:.4g})"
        for one in found.fit.numbers
    }
    rows |= {label: f"not fitted: {reason}" for label, reason in found.fit.left.items()}
    for axis in found.reactions:
        alike = "" if isnan(axis.correlation) else f"correlation {axis.correlation:.3f}, "
        rows[f"force {axis.axis}"] = (
            f"{alike}rms error {axis.rms_error:.3f} N of {axis.spread_measured:.3f} N"
        )
    if found.failures:
        rows["failed"] = "; ".join(found.failures)
    for name, score in found.scores.items():
        rows[name] = f"mean distance {1e3 * score.distance:.2f} mm, L1 {1e2 * score.l1:.3f} cm"
    return rows


def _facts(options: argparse.Namespace, found: "Identified") -> dict[str, Any]:
    return {
        "status": "ok",
        "output": str(options.output),
        "numbers": {one.unknown.label: [one.value, one.low, one.high] for one in found.fit.numbers},
        "left": found.fit.left,
        "scores": found.scores,
        "reactions": found.reactions,
        "failures": found.failures,
        "pieces": found.pieces,
        "left_out": found.left_out,
        "evaluations": found.fit.evaluations,
        "seconds": found.seconds,
        "error_estimate": None if found.error is None else found.error.numbers,
        "advice": found.advice,
    }
