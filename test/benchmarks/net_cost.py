"""Time of a step of nets against their control points, and of a harness against one cable.

    python test/benchmarks/net_cost.py [REPEATS]

Prints, for a cable with three branches, microseconds and force evaluations per step with 20 to 2000
control points, the exponent of the time, and its ratio to a single cable with as many.
"""

import sys
import time

import numpy as np

from dlo_sim.scene.loading import scene_from_values
from dlo_sim.simulation.simulator import Simulator

COUNTS = (20, 48, 100, 200, 500, 1000, 2000)
BRANCHES = ("a", "b", "c")
JOINTS = 19  # control points that the joints bring
BASE = {
    "cable.diameter": 0.006,
    "cable.youngs_modulus": 1e7,
    "damping.stiffness": 0.01,
    "damping.mass": 0.2,
    "integrator.step": 5e-3,
    "terms.twist": "bishop",
    "terms.out_of_plane": "on",
    "initial.shape": "equilibrium",
    "discretization.knots": "uniform",
    "accuracy.estimate": "off",
    "start.clamped": True,
    "start.tangent": [1.0, 0.0, 0.0],
    "end.fixed": [True] * 3,
    "end.clamped": True,
    "end.tangent": [1.0, 0.0, 0.0],
    "end.pose_topic": "/end",
}


def single(points: int) -> Simulator:
    """A cable of 2.05 m between two grippers."""
    more = {"cable.length": 2.05, "end.position": [1.6, 0.0, 0.0]}
    return Simulator(scene_from_values(BASE | more | {"discretization.control_points": points}))


def harness(points: int) -> Simulator:
    """A cable of 1 m with three branches of 0.35 m rigidly across, with so many points in all."""
    own = max((points - JOINTS) // len((*BRANCHES, "cable")), 4)
    values = {
        "cable.length": 1.0,
        "end.position": [0.8, 0.0, 0.0],
        "branches.names": list(BRANCHES),
    }
    values |= {"discretization.control_points": own}
    for k, name in enumerate(BRANCHES):
        branch = {"at": 0.25 * (k + 1), "joint": "rigid", "direction": [0.0, (-1.0) ** k, 0.0]}
        branch |= {"cable.length": 0.35, "discretization.control_points": own}
        values |= {f"branches.{name}.{key}": value for key, value in branch.items()}
    return Simulator(scene_from_values(BASE | values))


def cost(sim: Simulator) -> tuple[float, float]:
    """Microseconds and force evaluations per step while the end moves round, for a second."""
    place, turn = sim.end_pose("end")
    times = np.linspace(0.0, 1.0, 21)
    poses = np.tile(np.append(place, turn), (len(times), 1))
    poses[:, 1] += 0.1 * (1.0 - np.cos(2.0 * np.pi * times))
    poses[:, 2] += 0.1 * np.sin(2.0 * np.pi * times)
    started = time.perf_counter()
    report, _ = sim.follow(sim.time + times, {"end": poses}, sim.time + times[-1:])
    seconds = time.perf_counter() - started
    assert report.status.ok, report.note
    return 1e6 * seconds / report.steps, report.force_evaluations / report.steps


def main(repeats: int) -> None:
    """Print the table."""
    names = "points", "harness us", "evaluations", "single us", "evaluations", "ratio"
    print(" ".join(f"{name:>11}" for name in names))
    counts, costs = [], []
    for points in COUNTS:
        net = harness(points)
        alone = single(net.model.n)
        (us, evaluations), (other, fewer) = (
            min(cost(sim) for _ in range(repeats)) for sim in (net, alone)
        )
        counts.append(net.model.n)
        costs.append(us)
        row = counts[-1], us, evaluations, other, fewer, us / other
        print(" ".join(f"{number:11.2f}" for number in row))
    exponent = np.log(costs[-1] / costs[0]) / np.log(counts[-1] / counts[0])
    print(f"exponent of the time: {exponent:.2f}")


if __name__ == "__main__":
    main(int(sys.argv[1]) if len(sys.argv) > 1 else 4)
