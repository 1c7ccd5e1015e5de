"""Jobs for a simulator as JSON on stdin, its motions on stdout, one line each: `serve.py PEER`.

Run by the Python that has the simulator, and nothing of dlo_sim is imported: that environment need
not have it. A peer is a module beside this one, with the name of its `PACKAGE` and a class `Cable`
of a job:
    step: time step [s].
    look(first, steps): observed points [m], shape (m, 3), before so many steps from step number
        `first`, which may be prepared here; raises if the steps before failed.
    advance(first, steps): these steps, and nothing else, as they are timed.
A peer that is slow may say in `MOST_STEPS` up to how many steps it runs to the end.
"""

import importlib
import json
import sys
import time
from typing import Any

import numpy as np

PIECES = 3  # timed of a run that is too slow to go to its end


def run(peer: Any, job: dict[str, Any]) -> tuple[dict[str, Any], float]:
    """One run: times, observed points (T, m, 3) and run time of stepping, first piece left out as
    it may compile. Of a run that is too slow a few pieces, without points.
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
            raise RuntimeError(f"left the room at {times[-1]:g} s")
        began = time.perf_counter()
        cable.advance(k * chunk, chunk)
        walls.append(time.perf_counter() - began)
    wall = float(np.mean(walls[1:])) * pieces
    return {"times": times, "points": points if whole else [], "step": cable.step}, wall


def main() -> None:
    """Repeat every job within its budget of time; the reply says why there is no motion."""
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
