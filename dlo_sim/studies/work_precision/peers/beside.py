"""Running other simulators as child processes, and judging their motion like our own.

Which Python has a simulator is said by environment variables; those that are not set, or do not
work, are reported as not measured.
"""

from __future__ import annotations

import json
import os
import subprocess
import sys
import tempfile
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from dlo_sim.studies.catalogue import Request
from dlo_sim.studies.work_precision.cases import CLOSED, CLOSING, Case, Run

Array = NDArray[np.float64]
Reply = dict[str, Any]  # JSON: a job given, or what a simulator sent back
Settings = tuple[tuple[int, float], ...]  # (elements, step [s]); step 0 = its own
TIMEOUT = 900.0  # [s] for all runs of a simulator on a case


@dataclass(frozen=True)
class Peer:
    """Another simulator.

    Attributes:
        variable: environment variable that names its Python; empty = the one that runs us.
        module: beside this file, see `serve`. settings: by case. without: case -> why it is not
            measured there.
    """

    name: str
    variable: str
    module: str
    settings: dict[str, Settings]
    without: dict[str, str] = field(default_factory=dict)


_CHAIN: Settings = ((10, 0.0), (20, 0.0), (40, 0.0))
_ROPE: Settings = ((10, 1e-3), (20, 5e-4), (40, 2e-4))
_OWN_DAMPING = "its damping is another one"
PEERS = (
    Peer(
        "naive chain",
        "",
        "chain_peer",
        {
            "scenario_1": ((20, 0.0), (34, 0.0), (60, 0.0), (128, 0.0)),
            "scenario_2": ((20, 0.0), (34, 0.0), (60, 0.0)),
            "cantilever": _CHAIN,
            "steel_wire": _CHAIN,
            "hanging_chain": _CHAIN,
            "soft_grippers": ((12, 0.0), (20, 0.0), (24, 0.0), (40, 0.0), (64, 0.0)),
        },
    ),
    Peer(
        "MuJoCo 3 cable",
        "DLO_SIM_MUJOCO3_PYTHON",
        "mujoco_peer",
        {
            "scenario_1": ((10, 1e-3), (20, 5e-4), (22, 5e-4), (40, 2e-4)),
            "scenario_2": ((20, 5e-4), (22, 2e-4), (40, 2e-4)),
            "cantilever": ((10, 2e-4), (20, 1e-4)),
            "steel_wire": ((10, 2e-4), (20, 1e-4)),
            "hanging_chain": _ROPE,
        },
        {"soft_grippers": _OWN_DAMPING},
    ),
    Peer(
        "MuJoCo 4 rod",
        "DLO_SIM_MUJOCO4_PYTHON",
        "mujoco_peer",
        {
            "scenario_1": ((20, 2e-4), (40, 1e-4)),
            "scenario_2": ((20, 2e-4), (40, 1e-4)),
            "cantilever": ((10, 5e-4), (20, 5e-4), (40, 2e-4)),
            "steel_wire": ((10, 5e-4), (20, 2e-4), (40, 1e-4)),
            "hanging_chain": _ROPE,
        },
        {"soft_grippers": _OWN_DAMPING},
    ),
    Peer(
        "PyElastica",
        "DLO_SIM_PYELASTICA_PYTHON",
        "elastica_peer",
        {
            "scenario_1": ((20, 3e-7),),
            "cantilever": ((10, 1e-5), (20, 1e-5), (40, 5e-6)),
            "steel_wire": ((20, 1.2e-7),),
            "hanging_chain": ((20, 1e-6),),
        },
        {
            "scenario_2": "too slow to run to its end, as on scenario_1, which is the same wire",
            "soft_grippers": "its runner moves no gripper",
        },
    ),
)


class Peers:
    """The simulators that there are; nobody unless the request asks for them.

    Attributes:
        absent: what was not measured, and why.
    """

    def __init__(self, request: Request) -> None:
        self._quick = request.quick
        self._pythons: dict[str, str] = {}
        self.absent: list[str] = []
        for peer in PEERS if request.peers else ():
            python = os.environ.get(peer.variable, "") if peer.variable else sys.executable
            if python:
                self._pythons[peer.name] = python
            else:
                why = f"({peer.variable} does not name a Python that has it)"
                self.absent.append(f"{peer.name} {why}")

    def runs(self, case: Case, truth: Array) -> list[Run]:
        """Run every simulator on a case and judge its motion against a truth (T, m, 3)."""
        found = []
        for peer in PEERS:
            if peer.name not in self._pythons:
                continue
            if case.name in peer.without:
                self.absent.append(f"{peer.name} on {case.name}: {peer.without[case.name]}")
            settings = peer.settings.get(case.name, ())[: 1 if self._quick else None]
            if settings:
                jobs = [_job(case, n, step) for n, step in settings]
                replies = self._replies(peer, case, jobs)
                found += [
                    _judged(peer, case, truth, job, reply)
                    for job, reply in zip(jobs, replies, strict=False)
                ]
        return found

    def _replies(self, peer: Peer, case: Case, jobs: list[Reply]) -> list[Reply]:
        serve = str(Path(__file__).with_name("serve.py"))
        try:
            # MuJoCo leaves a log where it runs.
            with tempfile.TemporaryDirectory(prefix="dlo_sim_") as folder:
                done = subprocess.run(
                    [self._pythons[peer.name], serve, peer.module],
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
    """A reply's error against a truth at the case's times, as far as that goes."""
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
    # The round section whose stiffnesses and mass are the cable's, given directly or not.
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
