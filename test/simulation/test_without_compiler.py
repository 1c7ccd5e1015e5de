"""With numba switched off, all runs as Python, for a debugger, with the same numbers."""

from __future__ import annotations

import json
import os
import subprocess
import sys
from pathlib import Path

import numpy as np

from dlo_sim.scene.loading import load_scene, shipped_scene
from dlo_sim.simulation.simulator import Simulator

VALUES = {
    "discretization.control_points": 6,
    "damping.stiffness": 0.0,
    "damping.air_drag": 0.0,
    "integrator.step": 1e-4,
    "loads.names": ["tip"],
}
METHODS = ("energy_momentum", "velocity_verlet")
STEPS = 3


def moved(method: str) -> list[list[float]]:
    """The control points of a small cable after a few steps that went well."""
    scene = load_scene(shipped_scene("hanging_cable"))
    simulator = Simulator(scene.with_values(VALUES | {"integrator.method": method}))
    simulator.set_load("tip", force=(1.0, 2.0, 0.0), torque=(0.0, 0.0, 0.01))
    before = simulator.control_points.copy()
    report = simulator.advance_steps(STEPS)
    assert report.status.ok and report.steps == STEPS, (method, report)
    assert not np.array_equal(simulator.control_points, before)
    points: list[list[float]] = simulator.control_points.tolist()
    return [*points, [simulator.energy().total, *simulator.reaction_wrench("start")]]


def test_a_simulator_runs_as_python_and_gives_the_numbers_of_the_machine_code() -> None:
    done = subprocess.run(
        [sys.executable, str(Path(__file__))],
        env=os.environ | {"NUMBA_DISABLE_JIT": "1"},
        capture_output=True,
        text=True,
        check=False,
    )
    assert done.returncode == 0, done.stderr
    found = json.loads(done.stdout)
    for method in METHODS:
        for ours, wanted in zip(found[method], moved(method), strict=True):
            np.testing.assert_allclose(ours, wanted, rtol=1e-9, atol=1e-10)


if __name__ == "__main__":
    print(json.dumps({method: moved(method) for method in METHODS}))
