"""Run jobs on a simulator, JSON on stdin, results on stdout, one line each: `serve.py PEER`.

Run by the simulator's Python interpreter, whose environment need not have dlo_sim: nothing of it is
imported. A peer is a module in this folder with the name of its `PACKAGE` and a class `Cable` of a
job:
    step: time step [s].
    look(first, steps): observed points [m], shape (m, 3), before so many steps from step number
        `first`, which may be prepared here; raises if the previous steps failed.
    advance(first, steps): these steps and nothing else, because they are timed.
A slow peer may set `MOST_STEPS`, the largest number of steps of a complete run.
"""

import importlib
import json
import sys
import time
from typing import Any

import numpy as np

PIECES = 3  # timed pieces of a run that is too slow to be completed


def run(peer: Any, job: dict[str, Any]) -> tuple[dict[str, Any], float]:
    """One run: times, observed points (T, m, 3) and run time of stepping, without the first piece,
    which may compile. A run that is too slow has a few pieces only, and no points.
    """
    cable = peer.Cable(job)
    chunk = max(1, round(job["every"] / cable.step))
    pieces = round(job["duration"] / (chunk * cable.step))
    whole = pieces * chunk <= getattr(peer, "MOST_STEPS", np.inf)
    times, points, walls = [], [], []
    for k in range((pieces if whole else PIECES) + 1):
        times.append(k * chunk * cable.step)
        points.append(cable.look(k * chunk, chunk).tolist())
        if not np.abs(points[-1]).max() < 10 * job["length"]:
            raise RuntimeError(f"diverged at {times[-1]:g} s")
        began = time.perf_counter()
        cable.advance(k * chunk, chunk)
        walls.append(time.perf_counter() - began)
    wall = float(np.mean(walls[1:])) * pieces
    return {"times": times, "points": points if whole else [], "step": cable.step}, wall


def main() -> None:
    """Repeat every job within its time budget; the reply has a message if a run failed."""
    peer = importlib.import_module(sys.argv[1])
    try:
        package = importlib.import_module(peer.PACKAGE) if peer.PACKAGE else None
    except ModuleNotFoundError as absent:
        sys.exit(f"{sys.executable} has no {absent.name}")
    version = getattr(package, "__version__", "")
    for job in json.load(sys.stdin):
        found: dict[str, Any] = {"times": [], "points": [], "step": job["step"]}
        walls: list[float] = []
        message = ""
        try:
            while not walls or (len(walls) < job["repeats"] and sum(walls) < job["budget"]):
                found, wall = run(peer, job)
                walls.append(wall)
        except Exception as refusal:  # whatever the simulator raises
            message = str(refusal).split("\n")[0]
        reply = {"version": version, **found, "walls": walls, "message": message}
        print(json.dumps(reply), flush=True)


if __name__ == "__main__":
    main()
