"""`dlo_sim tune SCENE`: the fastest setting on this machine that is within a tolerance."""

import argparse
import math
from pathlib import Path
from typing import TYPE_CHECKING, Any

from dlo_sim.cli import FAILED
from dlo_sim.cli.arguments import (
    CommandError,
    Parser,
    add_scene,
    as_typed,
    number,
    positive_seconds,
    read_scene,
)
from dlo_sim.cli.output import check_output_file, print_json, print_rows, progress_bar, write_scene
from dlo_sim.scene.loading import find_scene

if TYPE_CHECKING:
    from dlo_sim.tuning.search import Tuned


HELP = "find the fastest setting within a tolerance"


def add_arguments(parser: Parser) -> None:
    """Say what the subcommand does and takes."""
    parser.description = (
        "Try methods, steps, resolutions, quadratures and stretching by span, and write the scene "
        "with the fastest setting that stays within the tolerance of the converged motion of the "
        "same scene. Grippers rest at their initial positions. Exit "
        "status 3 if no setting is within the tolerance; then nothing is written."
    )
    add_scene(parser)
    fault = "a tolerance; give metres above zero"
    above_zero = number("metres", lambda value: 0.0 < value < math.inf, fault)
    text = "largest distance of the cable from its converged motion [m]"
    parser.option("--tolerance METRES", text, type=above_zero, required=True)
    text = "simulated time over which this must hold [s]"
    parser.option("--duration S", text, type=positive_seconds, required=True)
    parser.option("--output TUNED.yaml", "scene file to write", type=Path, required=True)


def run(options: argparse.Namespace) -> int:
    """Search, write and print; returns the exit status."""
    scene = read_scene(options)
    source = find_scene(options.scene)
    check_output_file(options.output, source)
    if options.tolerance >= scene.cable.length:
        raise CommandError(
            f"--tolerance {options.tolerance:g} m is not below the cable's length "
            f"{scene.cable.length:g} m; give metres, such as 2e-4"
        )

    from dlo_sim.tuning.reference import NoReference
    from dlo_sim.tuning.search import tune

    try:
        with progress_bar("tune") as progress:
            tuned = tune(scene, options.tolerance, options.duration, progress)
    except NoReference as trouble:
        return _failed(options, str(trouble))
    if tuned.best is None:
        return _failed(
            options,
            f"none of {tuned.tried} settings is within {options.tolerance:g} m; the best is "
            f"{tuned.least:.2g} m off; raise --tolerance",
        )
    facts = _facts(tuned, options)
    write_scene(options.output, tuned.best.taken.applied(scene), *_comments(options, facts))
    if options.json:
        print_json(facts)
    else:
        print(f"{options.scene}: tuned")
        print_rows({**_rows(options, facts), "output": str(options.output)})
    return 0


def _failed(options: argparse.Namespace, message: str) -> int:
    if options.json:
        print_json({"status": "failed", "message": message})
    else:
        print(f"{options.scene}: not tuned: {message}")
    return FAILED


def _facts(tuned: "Tuned", options: argparse.Namespace) -> dict[str, Any]:
    best, present = tuned.best, tuned.present
    assert best is not None
    return {
        "status": "ok",
        "output": str(options.output),
        "setting": best.taken.words,
        "method": best.setting.method,
        "control_points": best.setting.control_points,
        "quadrature": best.setting.quadrature,
        "samples": best.setting.samples,
        "stretch": best.setting.stretch,
        "step_s": best.step,
        "terms_off": best.setting.off,
        "error_m": tuned.error,
        "reference_error_m": tuned.reference.error,
        "reference": tuned.reference.setting.words,
        "tolerance_m": options.tolerance,
        "duration_s": options.duration,
        "wall_s_per_s": best.wall,
        "spread": best.spread,
        "repeats": best.repeats,
        "real_time_factor": 1.0 / best.wall,
        "present_error_m": tuned.present_error,
        "present_wall_s_per_s": present.wall,
        "faster_than_present": present.wall / best.wall if present.ok else None,
        "tried": tuned.tried,
    }


def _rows(options: argparse.Namespace, facts: dict[str, Any]) -> dict[str, str]:
    """What was measured, for people and as the head of the file."""
    present = "failed"
    if facts["faster_than_present"] is not None:
        present = f"{facts['present_wall_s_per_s']:.3g} s, error {facts['present_error_m']:.2g} m"
    return {
        "setting": f"{facts['setting']}; the fastest of {facts['tried']} tried",
        "error": f"{facts['error_m']:.2g} m: largest distance from the converged motion at any of "
        f"21 points within {options.duration:g} s",
        "reference": f"{facts['reference']}; "
        f"itself uncertain by {facts['reference_error_m']:.2g} m",
        "time": f"{facts['wall_s_per_s']:.3g} s per simulated second, least of {facts['repeats']} "
        f"runs (median {100 * facts['spread']:.0f} % above), "
        f"{facts['real_time_factor']:.3g} x real time",
        "before": present,
    }


def _comments(options: argparse.Namespace, facts: dict[str, Any]) -> tuple[str, list[str]]:
    """How the scene was made, and lines about it."""
    words = ["dlo_sim", "tune", options.scene, "--tolerance", f"{options.tolerance:g}"]
    words += ["--duration", f"{options.duration:g}"]
    rows = [f"{label:<10} {text}" for label, text in _rows(options, facts).items()]
    last = "Grippers rested. Times hold for the machine that measured them."
    return f"Tuned by {as_typed(words, options.assignments)}", [*rows, last]
