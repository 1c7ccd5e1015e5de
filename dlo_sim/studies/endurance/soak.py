"""A simulated day of a cable between two moving grippers, with messages, as fast as possible."""

from __future__ import annotations

import gc
import os
import sys
from collections.abc import Callable
from typing import NamedTuple

import numpy as np

from dlo_sim.scene.description import Scene
from dlo_sim.session import cdr
from dlo_sim.session.session import Session
from dlo_sim.session.time_base import SECOND
from dlo_sim.studies.plotting import Panel, chart
from dlo_sim.studies.report import Report, columns
from dlo_sim.studies.runs import shipped
from dlo_sim.studies.scaling.study import resident_bytes

DURATION = {True: 600.0, False: 86_400.0}  # [s]
RATE = 10  # [Hz] of ticks and poses
LOOKS, WARM = 100, 10
LAP = 10.0  # [s]; all motions are periodic in it
CHANGES: dict[str, object] = {
    "discretization__control_points": 9,
    "integrator__step": 0.02,
    "rate": float(RATE),
    "inputs__latency": 0.25,
    "outputs__marker_rate": 1.0,
}


class Look(NamedTuple):
    """A sample of the run: simulated time [s], energy error as a share of the energy exchanged,
    resident memory [B], open files, threads, allocated blocks of Python, messages refused.
    """

    time: float
    energy_error: float
    resident: float
    files: float
    threads: float
    blocks: float
    refused: float


def gripper(end: str, time: float) -> tuple[float, ...]:
    """Pose of a swinging and rotating gripper of two_grippers: x, y, z [m] and quaternion."""
    turn, side = 2.0 * np.pi * time / LAP, 1.0 if end == "start" else -1.0
    x = (0.0 if end == "start" else 0.8) + side * 0.05 * np.sin(3 * turn)
    half = 0.15 * np.sin(2 * turn)
    z = 0.5 + 0.04 * np.cos(2 * turn) * side
    return x, 0.08 * np.sin(turn + side), z, 0.0, np.sin(half), 0.0, np.cos(half)


def scene() -> Scene:
    """The scene of the run."""
    return shipped("two_grippers", **CHANGES)


def soaked(quick: bool, progress: Callable[[float], None]) -> list[Look]:
    """Run the scene and return its samples."""
    session, encoder = Session(scene()), cdr.StampedEncoder(cdr.POSE_STAMPED, "world")
    begin, period = 1000 * SECOND, SECOND // RATE
    count = round(DURATION[quick] * RATE)
    poses = [[gripper(end, k / RATE) for end in ("start", "end")] for k in range(round(LAP) * RATE)]
    looks = np.zeros((LOOKS + 1, len(Look._fields)))  # holds no Python objects
    gc.freeze()  # as the node does: collections then skip the objects from start-up
    for k in range(count + 1):
        now = begin + k * period
        for end, pose in zip(("start", "end"), poses[k % len(poses)], strict=True):
            session.receive(f"/dlo_sim/{end}/pose", encoder.encode(now, pose), now)
        session.tick(now)
        if k % RATE == 0:
            session.messages()
            session.diagnostics(now)
        if k % (count // LOOKS) == 0:
            looks[k // (count // LOOKS)] = _look(session)
            progress(k / count)
    return [Look(*look) for look in looks[1:].tolist()]


def _look(session: Session) -> Look:
    simulator = session.simulator
    gc.collect()
    return Look(
        simulator.time,
        simulator.energy_error,
        resident_bytes(),
        len(os.listdir("/proc/self/fd")),
        len(os.listdir("/proc/self/task")),
        sys.getallocatedblocks(),
        session.journal.refused.total(),
    )


def describe(report: Report, looks: list[Look]) -> dict[str, str]:
    """Add section, table and figure; returns the verdict."""
    used = scene()
    report.section("A day of messages, offline")
    report.text(
        f"""`two_grippers` with {used.discretization.control_points} control points and a step of
        {used.integrator.step:g} s, both grippers swinging and rotating, poses and ticks at {RATE}
        Hz, all outputs once a second, in one process. A hundred samples; the first ten are the
        warm-up."""
    )
    warm, last = looks[WARM], looks[-1]
    header = (
        "sample | simulated [s] | energy error | resident [KB] | open files | threads | "
        "Python's blocks | refused"
    )
    rows = [("first", *looks[0]), ("after the warm-up", *warm), ("last", *last)]
    report.table("soak_looks", header, rows, "The run at three times")
    hours = "simulated time [h]"
    seen = [(x.time / 3600.0, (x.resident - warm.resident) / 1024.0, x.energy_error) for x in looks]
    data = columns((hours, "change [KiB]", "energy error [-]"), seen)
    panels = [
        Panel(hours, "resident memory, change [KiB]", ["change [KiB]"]),
        Panel(hours, "energy error, share of the energy exchanged", ["energy error [-]"]),
    ]
    caption = "Change of resident memory after the warm-up, and error of the energy account"
    chart(report, "soak", data, panels, caption, (9.0, 3.6))
    grown = (last.resident - warm.resident) / 1024.0
    return {
        f"{last.time / 3600.0:.3g} h offline": (
            f"energy error {last.energy_error:.1e} of what was exchanged; memory {grown:+.0f} KiB, "
            f"files {last.files - warm.files:+g}, threads {last.threads - warm.threads:+g} after "
            f"the warm-up; {last.refused:g} messages refused"
        )
    }
