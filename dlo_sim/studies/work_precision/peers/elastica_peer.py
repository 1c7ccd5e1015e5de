"""PyElastica's Cosserat rod, run by a Python that has it; jobs and replies as in `mujoco_peer`.

Its shear stiffness and the rotation of its sections allow steps of 0.1 to 1 us on thin stiff
cables. Where the whole motion would take too many of them, the cost of a simulated second comes
from a short piece, without an error.
"""

import json
import sys
import time

import numpy as np

try:
    import elastica
except ModuleNotFoundError:
    elastica = None  # the package may be imported where elastica is not

MOST_STEPS = 400_000  # of a run to its end
PIECES = 3  # timed of one that is not


def build(job):
    """A simulator and its rod."""

    class Scene(elastica.BaseSystemCollection, elastica.Constraints, elastica.Forcing):
        """A rod that can be held and pulled, composed as PyElastica wants it."""

    scene = Scene()
    rod = elastica.CosseratRod.straight_rod(
        job["n"],
        np.zeros(3),
        np.array(job["direction"]),
        np.array([0.0, 1.0, 0.0]),
        job["length"],
        0.5 * job["diameter"],
        job["density"],
        youngs_modulus=job["youngs_modulus"],
        shear_modulus=job["shear_modulus"],
    )
    scene.append(rod)
    scene.add_forcing_to(rod).using(elastica.GravityForces, acc_gravity=np.array([0, 0, -9.81]))
    if job["kind"] in ("cantilever", "hanging"):
        held = {"constrained_position_idx": (0,)}
        if job["kind"] == "cantilever":
            scene.constrain(rod).using(
                elastica.OneEndFixedBC, constrained_director_idx=(0,), **held
            )
        else:
            scene.constrain(rod).using(elastica.GeneralConstraint, **held)
    scene.finalize()
    return scene, rod


def whole(job):
    """Whether the run goes to its end."""
    return job["duration"] / job["step"] <= MOST_STEPS


def run(job):
    """One run, or a short piece of one."""
    scene, rod = build(job)
    stepper = elastica.PositionVerlet()
    tau = job["step"]
    chunk = max(1, round(job["every"] / tau))
    count = round(job["duration"] / (chunk * tau)) if whole(job) else PIECES
    observed = [round(u * job["n"]) for u in job["observed"]]
    times, points, wall, now = [], [], 0.0, 0.0
    for k in range(count + 1):
        times.append(k * chunk * tau)
        points.append(rod.position_collection[:, observed].T.tolist())
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
        if not whole(job):
            points = []
        version = getattr(elastica, "__version__", "")
        reply = {"version": version, "times": times, "points": points}
        print(json.dumps({**reply, "walls": [wall], "message": message}), flush=True)


if __name__ == "__main__":
    main()
