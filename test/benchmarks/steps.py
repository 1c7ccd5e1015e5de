"""Time of a step: against the number of control points, at steps of milliseconds.

    python test/benchmarks/steps.py [sizes] [stiff]

prints a table for each of the named parts, for all by default. Times are the least of
repeats that run in turn, so that other load on the machine affects all of them alike.
"""

import sys
import time
from functools import partial
from itertools import product

import numpy as np

from dlo_sim.core.methods import IMPLICIT, METHODS
from dlo_sim.scene.loading import load_scene
from dlo_sim.simulation.simulator import Simulator
from dlo_sim.studies.runs import at_method

SIZES = (9, 13, 19, 40, 80, 200, 500, 1000, 2000)
FINE = 100  # control points from which the second exponent is fitted
STIFF = [("energy_momentum", step) for step in (2e-3, 5e-3, 1e-2, 2e-2, 5e-2, 1e-1)]
STIFF += [("energy_momentum_4", step) for step in (2e-3, 5e-3, 1e-2)]
SIZED = (
    *("forest_ruth", "velocity_verlet"),
    *("energy_momentum", "energy_momentum_4", "implicit_midpoint"),
)


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
    return report


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


def stiff():
    """10 s of energy-conserving methods at long steps, against Forest-Ruth at its own."""
    print("\nmethod | n_u | step [ms] | times faster | energy error | iterations per step")
    for n, (method, step) in product((9, 13, 19, 40), STIFF):
        sized = {"discretization.control_points": n, "integrator.tolerance": 1e-10}
        scene = load_scene("paper_wire", sized)
        explicit, simulator = Simulator(scene), Simulator(at_method(scene, method, step))
        count = round(10.0 / step)
        works = partial(advance, explicit, 2000), partial(advance, simulator, count)
        (own, theirs), report = least(5, *works), advance(simulator, count)
        ratio = own / 2000 * (10.0 / explicit.step) / theirs
        cells = f"{ratio:.3g}", f"{simulator.energy_error:.1e}"
        work = f"{report.force_evaluations / count:.3g}"
        print(" | ".join([method, str(n), f"{1e3 * step:g}", *cells, work]), flush=True)


PARTS = {"sizes": sizes, "stiff": stiff}
if __name__ == "__main__":
    for part in sys.argv[1:] or PARTS:
        PARTS[part]()
