"""A short run to look at: what it is, and a bag of it."""

from __future__ import annotations

from pathlib import Path
from typing import NamedTuple

import numpy as np

from dlo_sim.replay.bags import BagWriter
from dlo_sim.scene.description import Scene
from dlo_sim.session import cdr

VALUES = {
    "cable.length": 0.4,
    "start.clamped": True,
    "start.tangent": [1.0, 0.0, 0.0],
    "discretization.control_points": 7,
    "damping.stiffness": 0.01,
}
TIMES = 21
PERIOD = 0.02  # s
EPOCH_NS = 1_700_000_000 * 10**9


class Made(NamedTuple):
    scene: Scene
    bag: Path
    recording: Path
    centerline: np.ndarray
    tension: np.ndarray
    frames: np.ndarray


def write_bag(
    path: Path,
    states: list[np.ndarray],
    forces: list[tuple],
    node: str,
    knots: str = "0 0 1",
) -> None:
    points, reaction = f"{node}/control_points", f"{node}/start/reaction"
    poses = cdr.PoseArrayEncoder("world", len(states[0]))
    wrench = cdr.StampedEncoder(cdr.WRENCH_STAMPED, "world")
    topics = {points: cdr.POSE_ARRAY, reaction: cdr.WRENCH_STAMPED}
    writer = BagWriter(path, {**topics, "/diagnostics": cdr.DIAGNOSTIC_ARRAY}, "mcap")
    for k, (state, force) in enumerate(zip(states, forces, strict=True)):
        stamp = EPOCH_NS + round(k * PERIOD * 1e9)
        writer.write(points, stamp, poses.encode(stamp, state))
        writer.write(reaction, stamp, wrench.encode(stamp, force))
        error = "unknown" if k == 0 else f"{1e-4 * k}"
        values = (
            ("energy [J]", f"{0.1 * k}"),
            ("error estimate [m]", error),
            ("knot density", knots),
        )
        told = [
            cdr.DiagnosticStatus(0, "other", "", (("energy [J]", "7"),)),
            cdr.DiagnosticStatus(0, "session", "running", values),
        ]
        writer.write("/diagnostics", stamp, cdr.encode_diagnostic_array(stamp, node, told))
    writer.finish()
