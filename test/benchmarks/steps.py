"""Time of a step: against the number of control points, on vector lanes, and on all cores.

    python test/benchmarks/steps.py [sizes] [lanes] [cores]

prints a table for each of the named parts, for all of them by default. Times are the least of
repeats that run in turn, so that other load on the machine affects all of them alike.
"""

import sys
import time

import numpy as np

from dlo_sim.batch import simulate_batch
from dlo_sim.batch.lanes import LANES, new_lane, run_lanes
from dlo_sim.batch.workers import HERE, open_workers
from dlo_sim.core.methods import IMPLICIT, METHODS
from dlo_sim.scene.loading import load_scene
from dlo_sim.simulation.simulator import Simulator

SIZES = (9, 13, 19, 40, 80, 200, 500, 1000, 2000)
FINE = 100  # control points from which the second exponent is fitted
SIZED = (
    *("forest_ruth", "velocity_verlet", "rattle"),
    *("energy_momentum", "energy_momentum_4", "implicit_midpoint", "generalized_alpha"),
)
ON_LANES = (("paper_wire", "forest_ruth"), ("paper_wire_force", "velocity_verlet"))
LANE_SIZES = (7, 13, 25, 41)
PIECE = 512  # steps of one timed piece


def wire(name, method, n, diameter=0.002):
    """A shipped wire with Gauss quadrature, three points per span."""
    values = {
        "cable.diameter": diameter,
        "discretization.control_points": n,
        "discretization.quadrature": "gauss",
        "discretization.samples": 3,
        "integrator.method": method,
        "integrator.step": 2e-3 if METHODS[method].family == IMPLICIT else 0.0,
    }
    return load_scene(name, values)


def least(repeats, *works):
    """Least time [s] of each function, called in turn, after a call to warm up."""
    times = np.full(len(works), np.inf)
    for repeat in range(repeats + 1):
        for k, work in enumerate(works):
            began = time.perf_counter()
            work()
            if repeat:
                times[k] = min(times[k], time.perf_counter() - began)
    return times.tolist()


def advance(simulator, steps):
    """Run so many steps from the start."""
    simulator.reset()
    report = simulator.advance_steps(steps)
    assert report.status.ok, report.message


def sizes():
    """Time of a step against n_u and exponents p of time ~ n_u^p. Implicit methods take 100 steps
    of 2 ms, the same motion at every size."""
    print("\nmethod | " + " | ".join(f"{n} [us]" for n in SIZES) + f" | p | p from {FINE} on")
    for method in SIZED:
        runs = [Simulator(wire("paper_wire", method, n)) for n in SIZES]
        steps = [100 if METHODS[method].family == IMPLICIT else max(64, 40_000 // n) for n in SIZES]
        works = [
            lambda r=run, s=count: advance(r, s) for run, count in zip(runs, steps, strict=True)
        ]
        times = 1e6 * np.array(least(7, *works)) / steps
        n, logs = np.log(SIZES), np.log(times)
        fine = np.array(SIZES) >= FINE
        p = [np.polyfit(n, logs, 1)[0], np.polyfit(n[fine], logs[fine], 1)[0]]
        print(" | ".join([method, *(f"{one:.4g}" for one in (*times, *p))]), flush=True)


def lanes():
    """Eight scenes, one per vector lane, against the same one by one, where the lanes are the knot
    spans of one cable."""
    print("\nscene, method | n_u | one by one [us/step] | lanes [us/step] | times faster")
    for (name, method), n in ((kind, n) for kind in ON_LANES for n in LANE_SIZES):
        diameters = 0.002 * (1.0 + 0.2 * np.arange(LANES) / LANES)
        simulators = [Simulator(wire(name, method, n, d)) for d in diameters.tolist()]
        step = min(simulator.step for simulator in simulators)
        stack, span = [new_lane(simulator) for simulator in simulators], PIECE * step

        def one_by_one(simulators=simulators):
            for simulator in simulators:
                advance(simulator, PIECE)

        def on_lanes(stack=stack, step=step, span=span):
            runs = run_lanes(stack, step, span, np.array([0.0, span]))
            assert all(run.status.ok for run in runs)

        one, other = (t / (PIECE * LANES) * 1e6 for t in least(15, one_by_one, on_lanes))
        print(f"{name}, {method} | {n} | {one:.3f} | {other:.3f} | {one / other:.2f}", flush=True)


def cores():
    """A batch on all workers against the same in this process, and whether the bits agree."""
    diameters = 0.002 * (1.0 + 0.2 * np.arange(128) / 128)
    scenes = [wire("paper_wire", "forest_ruth", 13, d) for d in diameters.tolist()]
    found = {}
    with open_workers() as crew:

        def run(workers):
            found[workers] = simulate_batch(scenes, 0.25, workers=workers).control_points

        one, every = least(5, lambda: run(HERE), lambda: run(crew))
        same = found[HERE].tobytes() == found[crew].tobytes()
        print(f"\n{crew.count} workers: {one / every:.2f} times as fast as one, same bits: {same}")


PARTS = {"sizes": sizes, "lanes": lanes, "cores": cores}
if __name__ == "__main__":
    for part in sys.argv[1:] or PARTS:
        PARTS[part]()
