"""A long run of a session with messages, as fast as possible.

    python test/endurance/soak.py [SECONDS]

simulates a cable between two moving grippers for so many seconds (default: a day) and prints a
line for every tenth of it. After the first tenth nothing may grow.
"""

import gc
import os
import sys
from pathlib import Path
from typing import NamedTuple

import numpy as np

from dlo_sim.scene.loading import load_scene
from dlo_sim.session import cdr
from dlo_sim.session.session import Session
from dlo_sim.session.time_base import SECOND

RATE = 10  # [Hz] of ticks and poses
LAP = 10.0  # [s]; all motions are periodic in it
VALUES = {
    "discretization.control_points": 9,
    "integrator.step": 0.02,
    "rate": float(RATE),
    "inputs.latency": 0.25,
    "outputs.marker_rate": 1.0,
}


class Look(NamedTuple):
    """Simulated time [s], energy error as a share of the energy exchanged, resident memory [KB],
    open files, threads, allocated blocks of Python, refused messages."""

    time: float
    energy_error: float
    resident: float
    files: float
    threads: float
    blocks: float
    refused: float


def resident_bytes():
    """Resident memory of this process [B], in whole pages."""
    pages = Path("/proc/self/statm").read_text(encoding="ascii").split()[1]
    return int(pages) * os.sysconf("SC_PAGE_SIZE")


def gripper(end, time):
    """Pose of a swinging and rotating gripper of two_grippers: x, y, z [m] and quaternion."""
    turn, side = 2.0 * np.pi * time / LAP, 1.0 if end == "start" else -1.0
    x = (0.0 if end == "start" else 0.8) + side * 0.05 * np.sin(3 * turn)
    half = 0.15 * np.sin(2 * turn)
    z = 0.5 + 0.04 * np.cos(2 * turn) * side
    return x, 0.08 * np.sin(turn + side), z, 0.0, np.sin(half), 0.0, np.cos(half)


def soak(seconds, looks=10):
    """Run the session; yields a `Look` after every part of the run."""
    session = Session(load_scene("two_grippers", VALUES))
    encoder = cdr.StampedEncoder(cdr.POSE_STAMPED, "world")
    every = round(seconds * RATE / looks)
    gc.freeze()  # as the node does: collections then skip the objects from start-up
    for k in range(1, looks * every + 1):
        now = 1000 * SECOND + k * SECOND // RATE
        for end in ("start", "end"):
            pose = encoder.encode(now, gripper(end, k / RATE))
            session.receive(f"/dlo_sim/{end}/pose", pose, now)
        session.tick(now)
        if k % RATE == 0:
            session.messages()
            session.diagnostics(now)
        if k % every == 0:
            gc.collect()
            yield Look(
                session.simulator.time,
                session.simulator.energy_error,
                resident_bytes() / 1e3,
                len(os.listdir("/proc/self/fd")),
                len(os.listdir("/proc/self/task")),
                sys.getallocatedblocks(),
                session.journal.refused.total(),
            )


if __name__ == "__main__":
    print(" | ".join(Look._fields))
    for found in soak(float(sys.argv[1] if sys.argv[1:] else 86_400)):
        print(" | ".join(f"{number:.6g}" for number in found), flush=True)
