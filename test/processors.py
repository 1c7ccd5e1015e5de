"""What the processor changes in simulations: bits that depend on the kernels of BLAS.

    python test/processors.py [CORE ...] [--scenes SCENE ...]

computes the shipped scenes once with each OPENBLAS_CORETYPE, by default with Prescott and with that
of the processor ("own"), and ends with status 1 if a start or a short run differs in a bit.
"""

from __future__ import annotations

import argparse
import hashlib
import json
import os
import subprocess
import sys
from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from dlo_sim.scene.loading import load_scene, shipped_scene, shipped_scenes
from dlo_sim.simulation.simulator import Simulator

OWN = "own"
CORES = ("Prescott", OWN)
CABLES = shipped_scene("table").with_name("cables")
SCENES = (*sorted(shipped_scenes()), *map(str, sorted(CABLES.glob("*.yaml"))))
STEPS = 300  # more than between two looks at a plane cable that may fall over
VARIABLE = "OPENBLAS_CORETYPE"

Hashes = dict[str, str]


def by_core(cores: Sequence[str], scenes: Sequence[str]) -> dict[str, Hashes]:
    """For each core the hash of each scene, and of a product that goes through BLAS ("BLAS"): with
    the same one, two cores have the same kernels.
    """
    found = {}
    for core in cores:
        command = [sys.executable, __file__, "--here", "--scenes", *scenes]
        environment = {key: value for key, value in os.environ.items() if key != VARIABLE}
        environment |= {VARIABLE: core} if core != OWN else {}
        done = subprocess.run(command, env=environment, check=True, stdout=subprocess.PIPE)
        found[core] = json.loads(done.stdout.splitlines()[-1])
    return found


def hashes(scenes: Sequence[str]) -> Hashes:
    """The same for this process."""
    one, other = np.random.default_rng(0).standard_normal((2, 37, 37))
    return {"BLAS": _digest(one @ other)} | {name: _fingerprint(name) for name in scenes}


def _fingerprint(scene: str) -> str:
    simulator = Simulator(load_scene(scene))
    start = simulator.control_points, simulator.velocities
    simulator.advance_steps(STEPS)
    return _digest(*start, simulator.control_points, simulator.velocities)


def _digest(*arrays: NDArray[np.float64]) -> str:
    found = hashlib.sha256()
    for array in arrays:
        found.update(np.ascontiguousarray(array).tobytes())
    return found.hexdigest()[:12]


def main() -> int:
    """Print the hashes; 1 if those of a scene differ."""
    parser = argparse.ArgumentParser(description="Bits of simulations by the kernels of BLAS.")
    parser.add_argument("cores", nargs="*", default=CORES)
    parser.add_argument("--scenes", nargs="*", default=SCENES)
    parser.add_argument("--here", action="store_true", help="of this process, as JSON")
    given = parser.parse_args()
    if given.here:
        print(json.dumps(hashes(given.scenes)))
        return 0
    found = by_core(given.cores, given.scenes)
    for name in ("BLAS", *given.scenes):
        print(name, *(rows[name] for rows in found.values()))
    return int(any(len({rows[name] for rows in found.values()}) > 1 for name in given.scenes))


if __name__ == "__main__":
    sys.exit(main())
