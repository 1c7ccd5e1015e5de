"""Findings about an installation, a scene and its topics, each with what to do about it."""

from __future__ import annotations

import math
import os
import platform
import time
from collections.abc import Callable, Iterator, Mapping
from importlib import metadata
from pathlib import Path
from typing import TYPE_CHECKING, NamedTuple

import numpy as np

from dlo_sim import __version__
from dlo_sim.process.children import processors
from dlo_sim.scene.refusal import SceneError
from dlo_sim.session.topics import InputTopic, input_topics, resolved

if TYPE_CHECKING:
    from dlo_sim.ros.survey import Heard, Survey
    from dlo_sim.scene.description import Scene
    from dlo_sim.session.session import Session
    from dlo_sim.simulation.simulator import Simulator

OK, NOTE, PROBLEM = "ok", "note", "problem"
_CACHE_CURE = "set DLO_SIM_CACHE to a directory of your own"
_LAST_DOMAIN, _LAST_SAFE_DOMAIN = 232, 101
_RANGES = ("SUBNET", "LOCALHOST", "OFF", "SYSTEM_DEFAULT")
_TICKS = 100  # for which the time of a step is measured
_COMFORTABLE = 0.5  # share of a timer period that steps may take
_SAME_EPOCH = 1.0  # [s]; the node takes stamps that are farther off for those of another epoch


class Finding(NamedTuple):
    """What was found, and what to do about it; a problem keeps the node from doing its work."""

    level: str
    what: str
    cure: str = ""


def ok(what: str) -> Finding:
    """A finding that needs no action."""
    return Finding(OK, what)


def note(what: str, cure: str = "") -> Finding:
    """A finding that is worth knowing."""
    return Finding(NOTE, what, cure)


def problem(what: str, cure: str) -> Finding:
    """A finding that has to be corrected."""
    return Finding(PROBLEM, what, cure)


def examined(
    scene: Scene | None, seconds: float, tell: Callable[[str], object]
) -> Iterator[Finding]:
    """All findings.

    Args:
        scene: if any. seconds: how long to listen to its topics. tell: gets lines about compiling.
    """
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
    yield from of_ros(session, seconds)


def of_ros(session: Session | None, seconds: float) -> Iterator[Finding]:
    """Whether ROS 2 is there, and what is heard on the topics of a session within seconds."""
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


def installation() -> Iterator[Finding]:
    """The versions, the cache of machine code, the processors."""
    versions = f"dlo_sim {__version__}, Python {platform.python_version()}, numpy {np.__version__}"
    try:
        from dlo_sim.compiling import directory
    except ImportError as error:
        yield problem(f"{versions}; numba cannot be imported: {error}", "pip install numba")
        return
    yield ok(f"{versions}, numba {metadata.version('numba')}")
    try:
        base = directory.base_directory()
    except OSError as error:
        yield problem(f"{error}; every start compiles", _CACHE_CURE)
    else:
        mine = base / directory.digest()
        yield cache(base, mine, directory.trust_problem(mine))
    cores = processors()
    if cores > 1:
        yield ok(f"{cores} cores")
    else:
        cure = "keep it free: the prediction and the error estimate share it"
        yield note("only one core", cure)


def cache(base: Path, mine: Path, untrusted: str) -> Finding:
    """Whether machine code is cached, and that of this version is present.

    Args:
        untrusted: why what is kept there must not be loaded; may be empty.
    """
    if untrusted:
        why = f"the cache {base} is not used: {untrusted}; every start compiles"
        return problem(why, _CACHE_CURE)
    if not os.access(_existing(base), os.W_OK):
        return problem(f"the cache {base} cannot be written; every start compiles", _CACHE_CURE)
    if mine.is_dir() and any(mine.iterdir()):
        return ok(f"the cache {base} holds this version's machine code")
    what = f"the cache {base} has no machine code of this version"
    return note(what, "nothing to do: the first start compiles once, for about 25 s")


def _existing(path: Path) -> Path:
    """The path, or the nearest directory above that exists."""
    return next(place for place in (path, *path.parents) if place.exists())


def ros_environment(environment: Mapping[str, str]) -> Iterator[Finding]:
    """Domain and discovery as these variables set them."""
    domain = environment.get("ROS_DOMAIN_ID", "") or "0"
    if not domain.isdecimal() or int(domain) > _LAST_DOMAIN:
        cure = f"set it to a whole number from 0 to {_LAST_SAFE_DOMAIN}"
        yield problem(f"ROS_DOMAIN_ID is {domain!r}, which is not a domain", cure)
    elif int(domain) > _LAST_SAFE_DOMAIN:
        cure = f"prefer 0 to {_LAST_SAFE_DOMAIN}: ports of higher domains can be in use already"
        yield note(f"ROS_DOMAIN_ID is {domain}", cure)
    else:
        yield ok(f"ROS_DOMAIN_ID is {domain}")
    reach = environment.get("ROS_AUTOMATIC_DISCOVERY_RANGE", "")
    if reach == "OFF":
        cure = "unset it, or set it to LOCALHOST or SUBNET"
        yield problem("ROS_AUTOMATIC_DISCOVERY_RANGE is OFF: nodes cannot find each other", cure)
    elif reach and reach not in _RANGES:
        cure = f"give one of {', '.join(_RANGES)}"
        yield problem(f"ROS_AUTOMATIC_DISCOVERY_RANGE is {reach!r}, which ROS does not know", cure)
    elif reach == "LOCALHOST" or environment.get("ROS_LOCALHOST_ONLY") == "1":
        cure = "for publishers on other machines, set ROS_AUTOMATIC_DISCOVERY_RANGE to SUBNET"
        yield note("only nodes on this machine are visible", cure)


def of_scene(simulator: Simulator) -> Iterator[Finding]:
    """Findings about a simulator as it was built, without messages."""
    left_out = "; ".join(f"{name} ({why})" for name, why in simulator.left_out.items())
    computed = ", ".join(simulator.active_terms)
    yield ok(f"active terms: {computed}; inactive: {left_out or 'none'}")
    choice = simulator.choice
    limit = "no stability limit"
    if math.isfinite(choice.limit):
        limit = f"{choice.step / choice.limit:.0%} of the stability limit {choice.limit:.3g} s"
    yield ok(f"{simulator.method}, step {choice.step:.3g} s ({choice.reason}); {limit}")
    yield ok(simulator.resolution)
    for line in simulator.scene.assumptions:
        yield ok(line)
    for line in simulator.warnings:
        yield note(line)
    yield keeping_up(simulator.scene.rate, measured_load(simulator))


def measured_load(simulator: Simulator) -> float:
    """Time that steps take as a share of the time they simulate, without forces or motion.

    Raises:
        SceneError: a step fails.
    """
    steps = max(1, round(1.0 / (simulator.scene.rate * simulator.step)))
    took = []
    for _ in range(_TICKS):
        begin = time.perf_counter()
        report = simulator.advance_steps(steps)
        if not report.status.advanced:
            raise SceneError(report.message)
        took.append(time.perf_counter() - begin)
    return sorted(took)[_TICKS // 2] / (steps * simulator.step)


def keeping_up(rate: float, load: float) -> Finding:
    """Whether steps fit into the timer's periods.

    Args:
        rate: of the timer [Hz]. load: from `measured_load`.
    """
    what = f"steps take {load:.0%} of a timer period ({1e3 / rate:.3g} ms at rate {rate:g} Hz)"
    if load < _COMFORTABLE:
        return ok(what)
    cure = "lower discretization.control_points, or try dlo_sim tune"
    if load < 1.0:
        return note(f"{what}; there may be no time for the error estimate", cure)
    return problem(f"{what}; the node cannot keep up", cure)


def of_topics(scene: Scene, found: Survey) -> Iterator[Finding]:
    """Each input topic, then the clock."""
    entries = {resolved(entry.topic): entry for entry in input_topics(scene)}
    if not found.heard:
        yield ok("the scene has no input topics")
    if scene.tf_keys:
        yield note(
            "tf2 is not used here; messages in tf2 frames are counted as refused",
            f"check each frame with: ros2 run tf2_ros tf2_echo {scene.frame_id} FRAME",
        )
    for heard in found.heard:
        yield from _topic(heard, entries[heard.sources.topic])
    if found.simulated_time:
        yield note("/clock is published", "start the node with --ros-args -p use_sim_time:=true")
    if found.offset is not None:
        yield epoch(found.offset, found.simulated_time)


def _topic(heard: Heard, entry: InputTopic) -> Iterator[Finding]:
    topic, kind = heard.sources.topic, heard.sources.type
    for line in heard.sources.problems:
        yield problem(line, "correct the publisher, or the topic name in the scene")
    for line in heard.incompatible:
        yield problem(line, "correct the publisher's QoS")
    if not heard.sources.count:
        cure = f"publish {kind} on it, or change the topic name in the scene"
        if entry.is_pose:
            yield problem(f"nobody publishes {topic}; the node waits for it", cure)
        elif entry.kind == "markers":
            yield note(f"nobody publishes {topic}; no obstacle is added", cure)
        elif entry.kind == "taken":
            yield note(f"nobody publishes {topic}; '{entry.target}' keeps its state", cure)
        else:
            yield note(f"nobody publishes {topic}; the load is zero", cure)
        return
    if entry.kind in ("taken", "markers"):
        yield ok(f"{topic} is published")
        return
    if not heard.rate:
        yield problem(f"{topic} has a publisher, but too few messages arrived", "check it")
        return
    frames = ", ".join(repr(frame) for frame in heard.frames)
    what = f"{topic}: {heard.rate:.3g} Hz, frame {frames or 'unknown'}"
    if heard.record.refusals:
        refused = f"{heard.record.refusals} refused, last {heard.record.last_refusal}"
        yield problem(f"{what}; {refused}", "see 'Bad input' in config/NODE.md")
    else:
        yield ok(what)
    if heard.record.unframed:
        key = f"loads.{entry.target}.frame"
        yield note(
            f"{topic}: messages without a frame_id are taken in {heard.record.unframed!r}",
            f"set {key} to the frame of an end effector if the sensor turns with it",
        )


def epoch(offset: float, simulated_time: bool) -> Finding:
    """In which time the stamps are; offset: clock minus stamps [s]."""
    clock = "/clock" if simulated_time else "the wall clock"
    if abs(offset) < _SAME_EPOCH:
        return ok(f"stamps agree with {clock}")
    side = "behind" if offset > 0.0 else "ahead of"
    return note(
        f"stamps are {abs(offset):.6g} s {side} {clock}",
        "with inputs.time auto the node uses the time base of the stamps; to use one clock, play "
        "bags with --clock and set use_sim_time",
    )
