"""Machine code is loaded while a simulator is built, so that no tick has to compile it."""

import subprocess
import sys

import pytest

SCRIPT = """
import sys
from dlo_sim.compiling.kernels import Kernel
from dlo_sim.scene.loading import load_scene
from dlo_sim.simulation.simulator import Simulator

simulator = Simulator(load_scene(sys.argv[1]))
compiled = Kernel._compiled
def told(kernel, *given, **more):
    print(kernel.name)
    return compiled(kernel, *given, **more)
Kernel._compiled = told
simulator.advance_steps(1)
"""


@pytest.mark.parametrize("name", ["hanging_cable", "table"])
def test_the_first_step_loads_no_code(name):
    """A look at whether the cable falls over among it, which table has in its first step."""
    command = [sys.executable, "-c", SCRIPT, name]
    done = subprocess.run(command, capture_output=True, text=True, check=True)
    assert done.stdout == ""
