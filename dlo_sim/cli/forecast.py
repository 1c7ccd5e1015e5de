"""`dlo_sim forecast SCENE --plan FILE`: the future of a cable along a planned motion."""

import argparse
import math
from pathlib import Path
from typing import TYPE_CHECKING, Any

from dlo_sim.cli import FAILED
from dlo_sim.cli.arguments import CommandError, Parser, add_scene, positive_seconds, read_scene
from dlo_sim.cli.output import (
    check_output_file,
    error_rows,
    print_json,
    print_rows,
    progress_bar,
    write_arrays,
)

if TYPE_CHECKING:
    from dlo_sim.scene.description import Scene
    from dlo_sim.simulation.forecast import Array, Forecast
    from dlo_sim.simulation.simulator import Simulator

_SHOWN = 5  # points of the last shape, for people

HELP = "predict the effect of a planned motion on a cable"


def add_arguments(parser: Parser) -> None:
    """Say what the subcommand does and takes."""
    parser.description = (
        "Start a cable at rest where a planned motion begins, and predict its shape, tension and "
        "curvature along the motion. Obstacles, and ends and grasps that are not in the plan, stay "
        "where the scene puts them; loads are those of the scene. Exit status 3 if the run fails; "
        "the shapes up to then are kept."
    )
    add_scene(parser)
    text = (
        "bag with a MultiDOFJointTrajectory or with poses on the topics of the scene; or YAML or "
        "npz with times and poses (x, y, z, quaternion x, y, z, w) of start, end or grasps"
    )
    parser.option("--plan FILE", text, type=Path, required=True)
    parser.option("--number N", "if the bag has several: which one, from 1", type=int)
    text = "time between shapes [s] (default: 0.02)"
    parser.option("--every S", text, type=positive_seconds, default=0.02)
    text = "write time, control points, centerline, tension and curvature, for dlo_sim view"
    parser.option("--output FILE.npz", text, type=Path)


def run(options: argparse.Namespace) -> int:
    """Forecast, write and print; returns the exit status."""
    scene = read_scene(options)
    if options.output is not None:
        check_output_file(options.output, options.scene, options.plan)

    import numpy as np

    from dlo_sim.replay.planned import PlanError, read_plan
    from dlo_sim.simulation.error_estimate import error_along
    from dlo_sim.simulation.simulator import Simulator

    def along(scene: "Scene") -> "Array":
        finer = Simulator(scene, begin, near=simulator)
        return finer.forecast(plan, options.every).lines(scene)

    accuracy: dict[str, Any] = {"error_estimate": None, "advice": ""}
    with progress_bar("forecast"):
        try:
            plan = read_plan(options.plan, scene, options.number)
            first = {name: np.asarray(rows)[0] for name, rows in plan.poses.items()}
            begin = {name: (pose[:3], pose[3:]) for name, pose in first.items()}
            simulator = Simulator(scene, begin)
            found = simulator.forecast(plan, options.every)
            if scene.estimates_errors and len(found.times):
                needed = found.control_points_needed, found.contact_stiffness_needed
                error, advice = error_along(simulator, found.lines(scene), along, *needed)
                accuracy = {"error_estimate": error.numbers, "advice": advice}
        except (PlanError, ValueError) as refusal:
            raise CommandError(str(refusal)) from None
    if not len(found.times):
        raise CommandError(f"{options.plan}: {found.report.message}")
    if options.output is not None:
        arrays = {name: getattr(found, name) for name in ("control_points", "centerline")}
        arrays |= {"time": found.times, "centerline_u": found.u}
        arrays |= {"tension": found.tension, "curvature": found.curvature}
        write_arrays(options.output, arrays | found.obstacles | found.net)
    if options.json:
        print_json(_summary(found, simulator, list(plan.poses)) | accuracy)
    else:
        rows = {
            "chosen": _chosen(simulator),
            **error_rows(accuracy["error_estimate"], accuracy["advice"]),
        }
        _print_report(options, found, ", ".join(plan.poses), rows)
    return 0 if found.report.status.ok else FAILED


def _chosen(simulator: "Simulator") -> str:
    return f"{simulator.choice.reason}\n{simulator.resolution}"


def _summary(found: "Forecast", simulator: "Simulator", planned: list[str]) -> dict[str, object]:
    return {
        "status": found.report.status.name.lower(),
        "message": found.report.message,
        "planned": planned,
        "simulated_s": found.report.simulated,
        "shapes": len(found.times),
        "peak_tension": found.peak_tension,
        "contact": found.contact or None,
        "notes": found.warnings,
        "largest_curvature": found.largest_curvature,
        "end_shape": found.centerline[-1],
        "choice": simulator.choice.reason,
        "resolution": simulator.resolution,
    }


def _print_report(
    options: argparse.Namespace, found: "Forecast", planned: str, more: dict[str, str]
) -> None:
    report = found.report
    print(f"{options.scene}: {report.status.name.lower()}, {report.simulated:g} s along the plan")
    if report.message:
        print(f"  {report.message}")
    tension = "cannot be computed from the shape of such a cable"
    if found.tension is not None:
        tension = f"{found.peak_tension:.4g} N {_where(found, 'tension')}"
    curvature = f"{found.largest_curvature:.4g} 1/m {_where(found, 'curvature')}"
    last = [k * (len(found.u) - 1) // (_SHOWN - 1) for k in range(_SHOWN)]
    lines = [f"u = {found.u[k]:.3f} m: {found.centerline[-1, k].round(4).tolist()}" for k in last]
    rows = {
        "planned": planned,
        "peak tension": tension,
        "largest curvature": curvature,
        **_contact(found),
        f"shape at {found.times[-1]:g} s": "\n".join(lines),
    } | more
    if found.warnings:
        rows["note"] = "\n".join(found.warnings)
    if options.output is not None:
        rows["output"] = f"{options.output} ({len(found.times)} shapes)"
    print_rows(rows)


def _contact(found: "Forecast") -> dict[str, str]:
    contact = found.contact
    if not contact:
        return {}
    itself = contact["to_itself"]
    strands = f" ({itself:.3g} m between strands)" if math.isfinite(itself) else ""
    line = (
        f"{contact['total']:.3g} N in all, {contact['largest']:.3g} N by one obstacle or the cable "
        f"itself, clearance {contact['clearance']:.3g} m{strands}; without friction"
    )
    return {"contact": line}


def _where(found: "Forecast", what: str) -> str:
    """Time and place of the largest value of any cable."""
    rows = {"": (getattr(found, what), found.u)}
    for key in found.net:
        of, _, name = key.rpartition(".")
        if name == what:
            rows[f" of {of}"] = found.net[key], found.net[f"{of}.centerline_u"]
    of, (values, u) = max(rows.items(), key=lambda row: row[1][0].max())
    shape, point = divmod(int(values.argmax()), len(u))
    return f"at {found.times[shape]:.3f} s, u = {u[point]:.3f} m{of}"
