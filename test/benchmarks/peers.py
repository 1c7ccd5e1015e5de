"""Other simulators on the cases of `dlo_sim study work-precision`, and what takes us as long.

    python test/benchmarks/peers.py FOLDER [--quick]

writes a report into the folder: every simulator with its settings, and the fastest setting of
dlo_sim whose error is not larger. Simulators run as child processes (`peer.py`). The variables
DLO_SIM_MUJOCO3_PYTHON (a Python with `mujoco<4`), DLO_SIM_MUJOCO4_PYTHON (`mujoco>=4`) and
DLO_SIM_PYELASTICA_PYTHON (`pyelastica`) name their interpreters; a naive chain of point masses
needs none. Simulators whose variable is not set, or that fail, are reported as not measured.
"""

from __future__ import annotations

import json
import os
import subprocess
import sys
import tempfile
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np

from dlo_sim.batch.workers import HERE
from dlo_sim.studies import Request
from dlo_sim.studies.report import Array, Report
from dlo_sim.studies.work_precision import (
    CLOSED,
    CLOSING,
    Case,
    Tried,
    all_cases,
    fastest,
    references,
    swept,
)

TIMEOUT = 900.0  # [s] for all settings of a simulator on a case
SCRIPT = Path(__file__).with_name("peer.py")
# Name -> its argument of peer.py, and the variable that names its Python; empty: the present one.
PEERS = {
    "naive chain": ("chain", ""),
    "MuJoCo 3 cable": ("mujoco", "DLO_SIM_MUJOCO3_PYTHON"),
    "MuJoCo 4 rod": ("mujoco", "DLO_SIM_MUJOCO4_PYTHON"),
    "PyElastica": ("elastica", "DLO_SIM_PYELASTICA_PYTHON"),
}
_DAMPED = "it has a different damping"
_SLOW = "too slow to run to its end, as on scenario_1, which is the same wire"
_ROPE = "10/1e-3 20/5e-4 40/2e-4"
# Case -> for each of PEERS: numbers of elements, each with its step [s] unless it chooses its own;
# or why it is not measured there.
TRIED = {
    "scenario_1": ("20 34 60 128", "10/1e-3 20/5e-4 22/5e-4 40/2e-4", "20/2e-4 40/1e-4", "20/3e-7"),
    "scenario_2": ("20 34 60", "20/5e-4 22/2e-4 40/2e-4", "20/2e-4 40/1e-4", _SLOW),
    "cantilever": (
        "10 20 40 80 160",
        "10/2e-4 20/1e-4",
        "10/5e-4 20/5e-4 40/2e-4",
        "10/1e-5 20/1e-5 40/5e-6",
    ),
    "steel_wire": ("10 20 40", "10/2e-4 20/1e-4", "10/5e-4 20/2e-4 40/1e-4", "20/1.2e-7"),
    "hanging_chain": ("10 20 40", _ROPE, _ROPE, "20/1e-6"),
    "soft_grippers": ("12 20 24 40 64 80", _DAMPED, _DAMPED, "its runner moves no gripper"),
}


def peer_runs(case: Case, truth: Array, quick: bool, absent: list[str]) -> list[Tried]:
    """Run every simulator on a case, a quick study only the first setting. Errors are relative to
    the reference `truth` (T, m, 3); what was not measured is added to `absent` with the reason.
    """
    found = []
    for (name, (peer, variable)), words in zip(PEERS.items(), TRIED[case.name], strict=True):
        python = os.environ.get(variable, "") if variable else sys.executable
        missing = f"{name} ({variable} does not name a Python that has it)"
        if not python:
            absent += [] if missing in absent else [missing]
            continue
        if not words[0].isdigit():
            absent.append(f"{name} on {case.name}: {words}")
            continue
        settings = [one.partition("/") for one in words.split()[: 1 if quick else None]]
        jobs = [_job(case, int(n), float(step or 0.0)) for n, _, step in settings]
        found_there, trouble = replies(python, peer, jobs)
        absent += [f"{name} on {case.name}: {trouble}"] if trouble else []
        for job, reply in zip(jobs, found_there, strict=False):
            found.append(_judged(f"{name} {reply['version']}".strip(), case, truth, job, reply))
    return found


def replies(
    python: str, peer: str, jobs: Sequence[dict[str, Any]]
) -> tuple[list[dict[str, Any]], str]:
    """Results of jobs, and what went wrong if there are fewer."""
    try:
        # MuJoCo writes a log to its working directory.
        with tempfile.TemporaryDirectory(prefix="dlo_sim_") as folder:
            done = subprocess.run(
                [python, str(SCRIPT), peer],
                input=json.dumps(jobs),
                capture_output=True,
                text=True,
                timeout=TIMEOUT,
                cwd=folder,
                env={**os.environ, "OMP_NUM_THREADS": "1", "OPENBLAS_NUM_THREADS": "1"},
            )
    except (OSError, subprocess.TimeoutExpired) as failure:
        return [], type(failure).__name__
    # Libraries may print lines of their own.
    lines = [line for line in done.stdout.splitlines() if line.startswith('{"version"')]
    said = done.stderr.strip().splitlines()[-1:] or ["no answer"]
    return [json.loads(line) for line in lines], said[0] if len(lines) < len(jobs) else ""


def _judged(
    who: str, case: Case, truth: Array, job: dict[str, Any], reply: dict[str, Any]
) -> Tried:
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
    return Tried(who, "", job["n"], reply["step"], status, "", off, wall, spread)


def _job(case: Case, n: int, step: float) -> dict[str, Any]:
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


def row_of(case: Case, runs: list[Tried], peer: Tried) -> list[Any]:
    """Row of the table: another simulator's run, and the fastest setting of `runs` whose error is
    not larger."""
    measured = [value if np.isfinite(value) else None for value in (peer.error, peer.wall)]
    found = fastest(runs, peer.error)
    ours: list[Any] = [None] * 4
    if found:
        ours = [found.words, found.error, found.wall, peer.wall / found.wall]
    return [case.name, peer.who, peer.n_u, peer.step, peer.status, *measured, *ours]


def compare(folder: Path, quick: bool) -> dict[str, str]:
    """Write the report; returns the verdicts."""
    request = Request(folder, quick, "python test/benchmarks/peers.py", HERE)
    report, cases = Report(request, "Other simulators", {}), all_cases(quick)
    truths = references(cases, HERE)
    rows: list[list[Any]] = []
    absent: list[str] = []
    verdicts = {}
    for case in cases:
        runs = swept(case, truths[case.name], quick)
        peers = peer_runs(case, truths[case.name].points, quick, absent)
        own = [row_of(case, runs, peer) for peer in peers]
        ratios = [row[-1] for row in own if row[-1] is not None]
        if ratios:
            words = f"take {min(ratios):.3g} to {max(ratios):.3g} times as long"
            verdicts[f"{case.name}, others at their errors"] = words
        rows += own
    report.text(
        """The chain and MuJoCo 4 observe the same material point. MuJoCo's cables are inextensible;
        on the wire their end springs include its axial compliance."""
    )
    report.table(
        "peers",
        "case | simulator | elements | step [ms] | status | error [%] | s per simulated s | "
        "setting within that error | its error [%] | its s per simulated s | times faster",
        rows,
        "Other simulators, and the fastest dlo_sim setting whose error is not larger",
    )
    report.text(*(f"Not measured: {line}" for line in absent))
    report.outcome(verdicts)
    return verdicts


if __name__ == "__main__":
    for name, verdict in compare(Path(sys.argv[1]), "--quick" in sys.argv).items():
        print(f"{name}: {verdict}")
