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
from collections.abc import Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from dlo_sim.studies.catalogue import Request
from dlo_sim.studies.report import Report
from dlo_sim.studies.work_precision.cases import CLOSED, CLOSING, Case
from dlo_sim.studies.work_precision.peers.runs import PeerRun
from dlo_sim.tuning.trial import error

Array = NDArray[np.float64]
KINDS = {
    "scenario_1": "pinned",
    "scenario_2": "pinned",
    "cantilever": "cantilever",
    "steel_wire": "cantilever",
    "hanging_chain": "hanging",
    "soft_grippers": "clamped",
    "soft_settled": "clamped",
}
TIMEOUT = 900.0  # [s] for all runs of a simulator on a case


@dataclass(frozen=True)
class Peer:
    """Another simulator.

    Attributes:
        variable: environment variable that names its Python; empty = the one that runs us.
        script: beside this file. settings: case -> (elements, step [s]); step 0 = its own.
        without: case -> why it is not measured there.
    """

    name: str
    variable: str
    script: str
    settings: dict[str, tuple[tuple[int, float], ...]]
    without: dict[str, str] = field(default_factory=dict)


_WIRE_3 = ((10, 1e-3), (20, 5e-4), (22, 5e-4), (40, 2e-4))
_WIRE_4 = ((20, 2e-4), (40, 1e-4))
_SOFT = ((12, 1e-2), (20, 1e-2), (20, 5e-3), (40, 5e-3))
_OWN_DAMPING = "its damping is another one; only the settled shape is comparable"
_NO_GRIPPER = "its runner moves no gripper"
PEERS = (
    Peer(
        "naive chain",
        "",
        "chain_peer.py",
        {
            "scenario_1": ((20, 0.0), (34, 0.0), (60, 0.0), (128, 0.0)),
            "scenario_2": ((20, 0.0), (34, 0.0), (60, 0.0)),
            "cantilever": ((10, 0.0), (20, 0.0), (40, 0.0)),
            "steel_wire": ((10, 0.0), (20, 0.0), (40, 0.0)),
            "hanging_chain": ((10, 0.0), (20, 0.0), (40, 0.0)),
            "soft_grippers": ((12, 0.0), (20, 0.0), (40, 0.0)),
            "soft_settled": ((12, 0.0), (20, 0.0), (40, 0.0)),
        },
    ),
    Peer(
        "MuJoCo 3 cable",
        "DLO_SIM_MUJOCO3_PYTHON",
        "mujoco_peer.py",
        {
            "scenario_1": _WIRE_3,
            "scenario_2": ((20, 5e-4), (22, 2e-4), (40, 2e-4)),
            "cantilever": ((10, 2e-4), (20, 1e-4)),
            "steel_wire": ((10, 2e-4), (20, 1e-4)),
            "hanging_chain": ((10, 1e-3), (20, 5e-4), (40, 2e-4)),
            "soft_settled": _SOFT,
        },
        {"soft_grippers": _OWN_DAMPING},
    ),
    Peer(
        "MuJoCo 4 rod",
        "DLO_SIM_MUJOCO4_PYTHON",
        "mujoco_peer.py",
        {
            "scenario_1": _WIRE_4,
            "scenario_2": _WIRE_4,
            "cantilever": ((10, 5e-4), (20, 5e-4), (40, 2e-4)),
            "steel_wire": ((10, 5e-4), (20, 2e-4), (40, 1e-4)),
            "hanging_chain": ((10, 1e-3), (20, 5e-4), (40, 2e-4)),
            "soft_settled": _SOFT,
        },
        {"soft_grippers": _OWN_DAMPING},
    ),
    Peer(
        "PyElastica",
        "DLO_SIM_PYELASTICA_PYTHON",
        "elastica_peer.py",
        {
            "scenario_1": ((20, 3e-7),),
            "cantilever": ((10, 1e-5), (20, 1e-5), (40, 5e-6)),
            "steel_wire": ((20, 1.2e-7),),
            "hanging_chain": ((20, 1e-6),),
        },
        {
            "scenario_2": "too slow to run to its end, as on scenario_1, which is the same wire",
            "soft_grippers": _NO_GRIPPER,
            "soft_settled": _NO_GRIPPER,
        },
    ),
)


@dataclass(frozen=True, eq=False)
class Motion:
    """What a simulator sent back: step [s], times [s], observed points (T, m, 3) [m], run times."""

    peer: str
    case: str
    elements: int
    step: float
    duration: float
    times: Array
    points: Array
    walls: list[float]
    message: str

    def judged(self, truth: Array, every: float, case: Case, last: bool = False) -> PeerRun:
        """Its error against a truth (T, m, 3) at the case's times, as far as that goes."""
        # A run that failed on its way has no time per simulated second.
        walls = [] if self.message else sorted(self.walls)
        wall = min(walls, default=np.inf) / self.duration
        middle = walls[len(walls) // 2] / self.duration if walls else np.inf
        off, message = float("nan"), self.message
        index = np.round(self.times / every).astype(int)
        wanted = index < len(truth)
        if len(self.points) and not message:
            shown = self.points[wanted]
            off = error(shown, truth[index[wanted]], case.components, last) / case.scale
        elif not message:
            message = "too slow to run to its end"
        spread = middle / wall - 1.0 if 0.0 < wall < np.inf else 0.0
        return PeerRun(self.peer, self.elements, self.step, wall, spread, off, message)


@dataclass
class Others:
    """All other simulators' motions, and why some were not measured."""

    motions: list[Motion] = field(default_factory=list)
    absent: list[str] = field(default_factory=list)

    def judged(self, case: Case, truth: Array, last: bool = False, name: str = "") -> list[PeerRun]:
        """Their runs on a case (or on the one called `name`)."""
        chosen = [m for m in self.motions if m.case == (name or case.name)]
        return [m.judged(truth, case.job.every, case, last) for m in chosen]

    def add(self, report: Report) -> None:
        """What was not measured, and which case is not the same for everybody."""
        if not self.motions and not self.absent:
            return
        report.section("Other simulators")
        report.text(
            """The chain and MuJoCo 4 observe the same material point as ours. MuJoCo 3 damps the
            soft cable by its joints (0.1 s times their stiffness), MuJoCo 4 by Euler's method
            alone; the others by 2 /s of the mass: only its settled shape is comparable.
            MuJoCo's cables are inextensible; on the wire their end springs take over the
            stretch."""
        )
        for line in self.absent:
            report.text(f"Not measured: {line}")


def measured(request: Request, cases: Sequence[Case]) -> Others:
    """Run every simulator there is on every case that it knows; nobody without `--peers`."""
    others = Others()
    if not request.peers:
        return others
    for peer in PEERS:
        python = os.environ.get(peer.variable, "") if peer.variable else sys.executable
        if not python:
            others.absent.append(
                f"{peer.name} ({peer.variable} does not name a Python that has it)"
            )
            continue
        for case in cases:
            settings = peer.settings.get(case.name, ())
            if request.quick:
                settings = settings[:1]
            if case.name in peer.without:
                others.absent.append(f"{peer.name} on {case.name}: {peer.without[case.name]}")
            if settings:
                others.motions += _run(others, peer, python, case, settings)
    return others


def _run(
    others: Others, peer: Peer, python: str, case: Case, settings: Sequence[tuple[int, float]]
) -> list[Motion]:
    jobs = [_job(case, n, step) for n, step in settings]
    script = Path(__file__).with_name(peer.script)
    try:
        # MuJoCo leaves a log where it runs.
        with tempfile.TemporaryDirectory(prefix="dlo_sim_") as folder:
            done = subprocess.run(
                [python, str(script)],
                input=json.dumps(jobs),
                capture_output=True,
                text=True,
                timeout=TIMEOUT,
                cwd=folder,
                env={**os.environ, "OMP_NUM_THREADS": "1", "OPENBLAS_NUM_THREADS": "1"},
            )
        output, trouble = done.stdout, done.stderr.strip().splitlines()[-1:]
    except (OSError, subprocess.TimeoutExpired) as failure:
        others.absent.append(f"{peer.name} on {case.name}: {type(failure).__name__}")
        return []
    # Libraries may print lines of their own.
    replies = [json.loads(line) for line in output.splitlines() if line.startswith('{"version"')]
    if len(replies) < len(jobs):
        others.absent.append(f"{peer.name} on {case.name}: {' '.join(trouble) or 'no answer'}")
    return [
        Motion(
            f"{peer.name} {reply['version']}".strip(),
            case.name,
            job["n"],
            reply.get("step", job["step"]),
            job["duration"],
            np.array(reply["times"]),
            np.array(reply["points"]),
            [wall for wall in reply["walls"] if wall > 0.0],
            reply["message"],
        )
        for job, reply in zip(jobs, replies, strict=False)
    ]


def _job(case: Case, n: int, step: float) -> dict[str, Any]:
    cable = case.scene.cable
    along = np.subtract(case.scene.end.position, case.scene.start.position)
    # The round section whose stiffnesses and mass are the cable's, given directly or not.
    diameter = 4.0 * np.sqrt(cable.EI / cable.EA)
    area = 0.25 * np.pi * diameter**2
    modulus = cable.EA / area
    load = case.scene.loads[0] if case.scene.loads else None
    return {
        "kind": KINDS[case.name],
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
