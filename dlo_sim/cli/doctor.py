"""`dlo_sim doctor [SCENE]`: is everything in order, and what to do if not."""

import argparse
import os
from collections.abc import Iterator
from typing import TYPE_CHECKING

from dlo_sim.cli import FAILED
from dlo_sim.cli.arguments import CommandError, Parser, add_scene, positive_seconds, read_scene
from dlo_sim.cli.output import print_json, tell
from dlo_sim.scene.refusal import SceneError

if TYPE_CHECKING:
    from dlo_sim.doctor.findings import Finding
    from dlo_sim.scene.description import Scene
    from dlo_sim.session.session import Session

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
    found = []
    for finding in _findings(scene, options.seconds):
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


def _findings(scene: "Scene | None", seconds: float) -> Iterator["Finding"]:
    try:
        from dlo_sim.doctor.findings import installation, of_scene, problem, ros_environment
    except ImportError as error:
        if not (error.name or "").startswith("rosbags"):
            raise
        raise CommandError("messages need rosbags; install it with: pip install rosbags") from None
    yield from installation()
    yield from ros_environment(os.environ)
    session = None
    if scene is not None:
        from dlo_sim.compiling.directory import compiling_told_to
        from dlo_sim.session.session import Session
        from dlo_sim.simulation.simulator import Simulator

        with compiling_told_to(tell):
            try:
                yield from of_scene(Simulator(scene))
                session = Session(scene.with_values({"accuracy.estimate": "off"}), live=True)
            except SceneError as refusal:
                yield problem("the scene cannot be simulated", str(refusal))
    yield from _of_ros(session, seconds)


def _of_ros(session: "Session | None", seconds: float) -> Iterator["Finding"]:
    from dlo_sim.doctor.findings import note, of_topics, ok, problem

    try:
        from dlo_sim.ros.survey import survey
        from dlo_sim.ros.transforms import tf2_for
    except ImportError as error:
        if (error.name or "").startswith("dlo_sim"):
            raise
        cure = "needed for the node: pip install 'dlo_sim[ros]', or source your ROS 2 Jazzy"
        yield note(f"no ROS 2: {error}", cure)
        return
    try:
        found = survey(session, seconds)
    except (RuntimeError, ImportError) as error:
        cure = "source your ROS 2 Jazzy, or pip install 'ros-jazzy-rclpy[fastrtps]'"
        yield problem(f"ROS 2 cannot be started: {' '.join(str(error).split())}", cure)
        return
    yield ok(f"rclpy with {found.rmw}")
    if session is not None:
        try:
            tf2_for(session.scene)
        except SceneError as refusal:
            yield problem("the node refuses the scene", str(refusal))
        yield from of_topics(session.scene, found)
