"""PyElastica's Cosserat rod, run by a Python that has it; jobs and replies as in `mujoco_peer`.

Only the cantilever is run to its end. On the wire a step of 0.3 us is all that its shear stiffness
bears, so there the cost of a simulated second comes from a short piece, without an error.
"""

import json
import sys
import time

import numpy as np

try:
    import elastica
except ModuleNotFoundError:
    elastica = None  # the package may be imported where elastica is not


def build(job):
    """A simulator and its rod."""

    class Scene(elastica.BaseSystemCollection, elastica.Constraints, elastica.Forcing):
        pass

    scene = Scene()
    rod = elastica.CosseratRod.straight_rod(
        job["n"],
        np.zeros(3),
        np.array([1.0, 0.0, 0.0]),
        np.array([0.0, 0.0, 1.0]),
        job["length"],
        0.5 * job["diameter"],
        job["density"],
        youngs_modulus=job["youngs_modulus"],
        shear_modulus=job["shear_modulus"],
    )
    scene.append(rod)
    scene.add_forcing_to(rod).using(elastica.GravityForces, acc_gravity=np.array([0, 0, -9.81]))
    if job["kind"] == "cantilever":
        scene.constrain(rod).using(
            elastica.OneEndFixedBC, constrained_position_idx=(0,), constrained_director_idx=(0,)
        )
    scene.finalize()
    return scene, rod


def run(job):
    """One run, or a short piece of one."""
    scene, rod = build(job)
    stepper = elastica.PositionVerlet()
    tau = job["step"]
    chunk = max(1, round(job["every"] / tau))
    whole = job["kind"] == "cantilever"
    count = round(job["duration"] / (chunk * tau)) if whole else 3
    times, points, wall, now = [], [], 0.0, 0.0
    for k in range(count + 1):
        times.append(k * chunk * tau)
        points.append(rod.position_collection[:, -1].tolist())
        if not np.isfinite(points[-1]).all():
            return times, points, wall, f"not finite at {times[-1]:g} s"
        began = time.perf_counter()
        for _ in range(chunk):
            now = stepper.step(scene, now, tau)
        wall += (time.perf_counter() - began) if k else 0.0  # the first piece compiles
    return times, points, wall / count * job["duration"] / (chunk * tau), ""


def main():
    """Every job on stdin, one JSON line each on stdout."""
    if elastica is None:
        sys.exit(f"{sys.executable} has no elastica")
    for job in json.load(sys.stdin):
        try:
            times, points, wall, message = run(job)
        except (ValueError, RuntimeError, AssertionError) as refusal:
            times, points, wall, message = [], [], 0.0, str(refusal).split("\n")[0]
        if job["kind"] != "cantilever":
            points = []
        version = getattr(elastica, "__version__", "")
        reply = {"version": version, "times": times, "points": points}
        print(json.dumps({**reply, "walls": [wall], "message": message}), flush=True)


if __name__ == "__main__":
    main()
