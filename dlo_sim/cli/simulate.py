"""`dlo_sim simulate SCENE`: run a scene without ROS and record it."""

import argparse
import math
from pathlib import Path
from typing import TYPE_CHECKING

from dlo_sim.cli import FAILED
from dlo_sim.cli.arguments import CommandError, Parser, add_scene, positive_seconds, read_scene
from dlo_sim.cli.output import (
    check_output_file,
    error_rows,
    print_json,
    print_rows,
    progress_bar,
    run_time,
    tell,
    write_arrays,
)
from dlo_sim.process.stopping import exit_status
from dlo_sim.scene.description import Scene

if TYPE_CHECKING:
    from dlo_sim.simulation.recording import Recording

_LARGEST_RECORDING = 2 * 1024**3  # bytes
_SHAPES = ("control_points", "centerline", "centerline_u", "tension", "curvature")
_CONTROLS = ".control_points"  # of a further cable of a net
_ARRAYS = ("time", *_SHAPES, "energy")
_REPORT = (
    *("status", "message", "simulated_s", "wall_s", "compile_s", "steps", "step_s", "method"),
    *("choice", "resolution", "force_evaluations", "real_time_factor", "energy_error_max"),
    *("error_estimate", "advice", "active_terms", "left_out", "notes", "contacts", "slides"),
    "peak_tension",
)

HELP = "run a scene without ROS and record it"


def add_arguments(parser: Parser) -> None:
    """Say what the subcommand does and takes."""
    parser.description = (
        "Run a scene and report run time, steps and energy error. Exit status 3 if the run fails, "
        "130 if Ctrl-C ends it; the results up to then are kept."
    )
    add_scene(parser)
    parser.option("--duration S", "simulated time [s]", type=positive_seconds, required=True)
    text = "time between recorded samples [s] (default: 0.001)"
    parser.option("--every S", text, type=positive_seconds, default=1e-3)
    text = "write time, control points, centerline, tension, curvature and energy to this file"
    parser.option("--output FILE.npz", text, type=Path)


def run(options: argparse.Namespace) -> int:
    """Simulate, write and print; returns the exit status."""
    scene = read_scene(options)
    _check_size(scene, options.duration, options.every)
    if options.output is not None:
        check_output_file(options.output, options.scene)

    from dlo_sim.simulation.recording import record

    with progress_bar("simulate", keeps=True) as progress:
        recording = record(scene, options.duration, options.every, progress=progress, tell=tell)
    if options.output is not None:
        arrays = {name: getattr(recording, name) for name in _ARRAYS}
        write_arrays(options.output, arrays | recording.obstacles | recording.net)
    if options.json:
        print_json({name: getattr(recording, name) for name in _REPORT})
    else:
        _print_report(options.scene, options.output, recording)
    if recording.interrupted:
        return exit_status()
    return 0 if recording.ok else FAILED


def _check_size(scene: Scene, duration: float, every: float) -> None:
    """Refuse a recording that would not fit into memory."""
    from dlo_sim.simulation.resolution import resolved  # imports numpy

    samples = duration / every + 1.0
    strands = resolved(scene)[0].strands
    points = sum(strand.scene.discretization.control_points for strand in strands)
    numbers = 4 * points + 5 * len(strands) * scene.outputs.centerline_samples + 2
    size = 8.0 * samples * numbers
    if size > _LARGEST_RECORDING:
        cure = every * size / _LARGEST_RECORDING
        raise CommandError(
            f"--every {every:g} s for --duration {duration:g} s would record {size / 1e9:.3g} GB; "
            f"give --every {cure:.1e} or more"
        )


def _print_report(scene: str, output: Path | None, recording: "Recording") -> None:
    print(f"{scene}: {recording.status}, {recording.simulated_s:g} s simulated")
    if recording.message:
        print(f"  {recording.message}")
    error = recording.energy_error_max
    left_out = [f"{name}: {reason}" for name, reason in recording.left_out.items()]
    rows = {
        "method": f"{recording.method}, step {recording.step_s * 1e6:.4g} us, "
        f"{recording.steps} steps, {recording.force_evaluations} {_counted(recording.method)}",
        "chosen": f"{recording.choice}\n{recording.resolution}",
        "time": run_time(recording),
        "energy error": "-" if error is None else f"{error:.2e} of the largest energy exchanged",
        "active": ", ".join(recording.active_terms) or "-",
        "left out": "\n".join(left_out) or "-",
    }
    if recording.contacts:
        lines = [
            f"{name}: {one['exerted']:.3g} N, "
            f"at most {one['pressure']:.3g} N/m, clearance "
            + (f"{one['clearance']:.3g} m" if math.isfinite(one["clearance"]) else "large")
            for name, one in recording.contacts.items()
        ]
        rows["contact"] = "\n".join(lines)
    if recording.slides:
        lines = [
            f"{name}: holds {one['u']:.6g} m, tension {one['before']:.3g} N before, "
            f"{one['after']:.3g} N after it"
            for name, one in recording.slides.items()
        ]
        rows["slides"] = "\n".join(lines)
    rows |= error_rows(recording.error_estimate, recording.advice)
    if recording.notes:
        rows["note"] = "\n".join(recording.notes)
    if output is not None:
        shapes = [recording.control_points.shape]
        shapes += [one.shape for name, one in recording.net.items() if name.endswith(_CONTROLS)]
        points = sum(shape[1] for shape in shapes)
        rows["output"] = f"{output} ({shapes[0][0]} times, {points} control points)"
    print_rows(rows)


def _counted(method: str) -> str:
    """What a method's force evaluations are, for people."""
    from dlo_sim.core.methods import IMPLICIT, METHODS

    return "Newton iterations" if METHODS[method].family == IMPLICIT else "force evaluations"
