"""Running other simulators as child processes, and measuring the error of their motion.

Environment variables name the Python interpreter of each simulator; simulators whose variable is
not set, or that fail, are reported as not measured.
"""

from __future__ import annotations

import json
import os
import subprocess
import sys
import tempfile
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from dlo_sim.studies import Request
from dlo_sim.studies.runs import Array
from dlo_sim.studies.work_precision.cases import CLOSED, CLOSING, Case, Run

Reply = dict[str, Any]  # JSON: a job, or the answer of a simulator
TIMEOUT = 900.0  # [s] for all runs of a simulator on a case


@dataclass(frozen=True)
class Peer:
    """Another simulator: the environment variable that names its Python interpreter, empty for the
    present one, and its module in this folder, see `serve`.
    """

    name: str
    variable: str
    module: str

    @property
    def python(self) -> str:
        """The Python interpreter that has it; empty if none is named."""
        return os.environ.get(self.variable, "") if self.variable else sys.executable


PEERS = (
    Peer("naive chain", "", "chain_peer"),
    Peer("MuJoCo 3 cable", "DLO_SIM_MUJOCO3_PYTHON", "mujoco_peer"),
    Peer("MuJoCo 4 rod", "DLO_SIM_MUJOCO4_PYTHON", "mujoco_peer"),
    Peer("PyElastica", "DLO_SIM_PYELASTICA_PYTHON", "elastica_peer"),
)
_DAMPED = "it has a different damping"
_SLOW = "too slow to run to its end, as on scenario_1, which is the same wire"
_ROPE = "10/1e-3 20/5e-4 40/2e-4"
# Case -> for each of PEERS: numbers of elements, each with its step [s] unless it chooses its own;
# or why it is not measured there.
TRIED = {
    "scenario_1": ("20 34 60 128", "10/1e-3 20/5e-4 22/5e-4 40/2e-4", "20/2e-4 40/1e-4", "20/3e-7"),
    "scenario_2": ("20 34 60", "20/5e-4 22/2e-4 40/2e-4", "20/2e-4 40/1e-4", _SLOW),
    "cantilever": (
        "10 20 40",
        "10/2e-4 20/1e-4",
        "10/5e-4 20/5e-4 40/2e-4",
        "10/1e-5 20/1e-5 40/5e-6",
    ),
    "steel_wire": ("10 20 40", "10/2e-4 20/1e-4", "10/5e-4 20/2e-4 40/1e-4", "20/1.2e-7"),
    "hanging_chain": ("10 20 40", _ROPE, _ROPE, "20/1e-6"),
    "soft_grippers": ("12 20 24 40 64", _DAMPED, _DAMPED, "its runner moves no gripper"),
}


class Peers:
    """The available simulators, none unless requested; `absent` lists what was not measured, and
    why.
    """

    def __init__(self, request: Request) -> None:
        asked = PEERS if request.peers else ()
        self._quick, self._there = request.quick, [peer for peer in asked if peer.python]
        self.absent = [
            f"{peer.name} ({peer.variable} does not name a Python that has it)"
            for peer in asked
            if not peer.python
        ]

    def runs(self, case: Case, truth: Array) -> list[Run]:
        """Run every simulator on a case; errors are relative to the reference `truth` (T, m, 3)."""
        found = []
        for peer, words in zip(PEERS, TRIED[case.name], strict=True):
            if peer not in self._there:
                continue
            if not words[0].isdigit():
                self.absent.append(f"{peer.name} on {case.name}: {words}")
                continue
            settings = [one.partition("/") for one in words.split()[: 1 if self._quick else None]]
            jobs = [_job(case, int(n), float(step or 0.0)) for n, _, step in settings]
            for job, reply in zip(jobs, self._replies(peer, case, jobs), strict=False):
                found.append(_judged(peer, case, truth, job, reply))
        return found

    def _replies(self, peer: Peer, case: Case, jobs: list[Reply]) -> list[Reply]:
        serve = str(Path(__file__).with_name("serve.py"))
        try:
            # MuJoCo writes a log to its working directory.
            with tempfile.TemporaryDirectory(prefix="dlo_sim_") as folder:
                done = subprocess.run(
                    [peer.python, serve, peer.module],
                    input=json.dumps(jobs),
                    capture_output=True,
                    text=True,
                    timeout=TIMEOUT,
                    cwd=folder,
                    env={**os.environ, "OMP_NUM_THREADS": "1", "OPENBLAS_NUM_THREADS": "1"},
                )
        except (OSError, subprocess.TimeoutExpired) as failure:
            self.absent.append(f"{peer.name} on {case.name}: {type(failure).__name__}")
            return []
        # Libraries may print lines of their own.
        lines = [line for line in done.stdout.splitlines() if line.startswith('{"version"')]
        if len(lines) < len(jobs):
            trouble = " ".join(done.stderr.strip().splitlines()[-1:]) or "no answer"
            self.absent.append(f"{peer.name} on {case.name}: {trouble}")
        return [json.loads(line) for line in lines]


def _judged(peer: Peer, case: Case, truth: Array, job: Reply, reply: Reply) -> Run:
    """The run of a reply, with its error against the reference at the times that it reached."""
    status, points = reply["message"].replace("|", "/") or "ok", np.array(reply["points"])
    wall = spread = off = float("nan")
    if status == "ok":  # a run that failed on its way has no time per simulated second
        walls = np.array(reply["walls"]) / job["duration"]
        wall, spread = float(walls.min()), float(np.median(walls) / walls.min() - 1.0)
        if not len(points):
            status = "too slow to run to its end"
    if len(points):
        index = np.round(np.array(reply["times"]) / case.job.every).astype(int)
        wanted = index < len(truth)
        off = case.error(points[wanted], truth[index[wanted]])
    who = f"{peer.name} {reply['version']}".strip()
    return Run(who, "", job["n"], reply["step"], status, "", off, wall, spread)


def _job(case: Case, n: int, step: float) -> Reply:
    cable = case.scene.cable
    along = np.subtract(case.scene.end.position, case.scene.start.position)
    # The round section with the stiffnesses and the mass of the cable.
    diameter = 4.0 * np.sqrt(cable.EI / cable.EA)
    area = 0.25 * np.pi * diameter**2
    modulus = cable.EA / area
    load = case.scene.loads[0] if case.scene.loads else None
    return {
        "kind": case.hold,
        "n": n,
        "step": step,
        "duration": case.job.duration,
        "every": case.job.every,
        "length": cable.length,
        "direction": (along / np.linalg.norm(along)).tolist(),
        "observed": list(case.job.u),
        "diameter": diameter,
        "density": cable.mu / area,
        "youngs_modulus": modulus,
        "shear_modulus": modulus * cable.shear_modulus / cable.youngs_modulus,
        "mu": cable.mu,
        "EA": cable.EA,
        "EI": cable.EI,
        "spring": case.scene.start.spring[0],
        "damping": case.scene.damping.mass,
        "force": list(load.force) if load else [0.0, 0.0, 0.0],
        "frequency": load.frequency if load else 1.0,
        "closed": CLOSED,
        "closing": CLOSING,
        "repeats": 3,
        "budget": 3.0,
    }
