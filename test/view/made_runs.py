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
BOX = (0.1, 0.2, 0.04)  # m
EPOCH_NS = 1_700_000_000 * 10**9


class Made(NamedTuple):
    scene: Scene
    bag: Path
    recording: Path
    centerline: np.ndarray
    tension: np.ndarray
    frames: np.ndarray


def write_bag(
    path: Path, states: list[np.ndarray], forces: list[tuple], node: str, knots: str = "0 0 1"
) -> None:
    points, reaction = f"{node}/control_points", f"{node}/start/reaction"
    poses = cdr.PoseArrayEncoder("world", len(states[0]))
    wrench = cdr.StampedEncoder(cdr.WRENCH_STAMPED, "world")
    contacts = f"{node}/contacts"
    topics = {points: cdr.POSE_ARRAY, reaction: cdr.WRENCH_STAMPED, contacts: cdr.MARKER_ARRAY}
    writer = BagWriter(path, {**topics, "/diagnostics": cdr.DIAGNOSTIC_ARRAY}, "mcap")
    for k, (state, force) in enumerate(zip(states, forces, strict=True)):
        stamp = EPOCH_NS + round(k * PERIOD * 1e9)
        writer.write(points, stamp, poses.encode(stamp, state))
        writer.write(reaction, stamp, wrench.encode(stamp, force))
        if k % 2 == 0:  # a box that moves along x and is gone after 0.2 s
            gray = (0.5,) * 4
            box = cdr.Body(cdr.CUBE, gray, [0.2 + 0.01 * k, 0, -0.15, 0, 0, 0, 1], BOX)
            lines = np.array([[0.1 * k, 0.0, 0.0], [0.1 * k, 0.0, 0.05]])
            force = cdr.Body(cdr.LINE_LIST, gray, cdr.NO_POSE, (0.001, 0, 0), lines)
            bodies = [force, *[box] * (k <= 10)]
            shown = cdr.encode_bodies("world", "contacts", stamp, 0, bodies)
            writer.write(contacts, stamp, shown)
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
