"""With numba switched off, all runs as Python, for a debugger: every method, and its numbers."""

from __future__ import annotations

import json
import os
import subprocess
import sys
from pathlib import Path

import numpy as np
from cables import FULL, SOFT

from dlo_sim.core.methods import METHODS
from dlo_sim.scene.loading import scene_from_values
from dlo_sim.simulation.simulator import Simulator

# Of 9 control points: a vector that reads past the end of a row is an error in Python.
SCENES = {"plane": SOFT | {"discretization.control_points": 9}, "space": FULL}
STEPS = 3


def moved(scene: str, method: str) -> list[list[float]]:
    """The control points after a few steps that went well."""
    values = SCENES[scene] | {"integrator.method": method, "integrator.step": 1e-4}
    simulator = Simulator(scene_from_values(values))
    before = simulator.control_points.copy()
    report = simulator.advance_steps(STEPS)
    assert report.status.ok and report.steps == STEPS, (scene, method, report)
    assert np.isfinite(simulator.energy().total)
    assert not np.array_equal(simulator.control_points, before), (scene, method)
    found: list[list[float]] = simulator.control_points.tolist()
    return found


def test_every_method_runs_as_python_and_gives_the_numbers_of_the_machine_code() -> None:
    paths = (str(Path(__file__).parents[1]), os.environ.get("PYTHONPATH", ""))
    done = subprocess.run(
        [sys.executable, str(Path(__file__))],
        env=os.environ | {"NUMBA_DISABLE_JIT": "1", "PYTHONPATH": os.pathsep.join(paths)},
        capture_output=True,
        text=True,
        check=False,
    )
    assert done.returncode == 0, done.stderr
    found = json.loads(done.stdout)
    assert found.keys() == {f"{scene} {method}" for scene in SCENES for method in METHODS}
    for scene in SCENES:
        for method in ("velocity_verlet", "energy_momentum"):  # others use their machine code too
            np.testing.assert_allclose(
                found[f"{scene} {method}"], moved(scene, method), rtol=1e-9, atol=1e-12
            )


if __name__ == "__main__":
    print(json.dumps({f"{s} {method}": moved(s, method) for s in SCENES for method in METHODS}))
