"""A small cable, simulated, replayed and viewed by the commands: does it run with these versions?

python .ci/smoke.py, in an environment with dlo_sim and in a folder that may be written to.
"""

import contextlib
import io
import json
import sys
from pathlib import Path
from typing import Any

import numba
import numpy as np

from dlo_sim.cli.main import main
from dlo_sim.replay.bags import BagWriter
from dlo_sim.session import cdr

SCENE = """\
/**:
  ros__parameters:
    cable:
      {length: 0.4, diameter: 0.01, linear_density: 0.2, bending_stiffness: 0.02,
       axial_stiffness: 50.0}
    discretization: {control_points: 6}
    terms: {twist: "off", out_of_plane: "off"}
    start: {position: [0.0, 0.0, 0.0], clamped: true, pose_topic: /gripper}
    end: {position: [0.4, 0.0, 0.0]}
    integrator: {method: velocity_verlet, step: 0.0}
"""


def run(*arguments: str) -> dict[str, Any]:
    """The report of one command, which has to end well."""
    with contextlib.redirect_stdout(io.StringIO()) as printed:
        status = main([*arguments, "--json"])
    print(printed.getvalue())
    if status:
        sys.exit(status)
    report: dict[str, Any] = json.loads(printed.getvalue())
    return report


Path("smoke.yaml").write_text(SCENE)
encoder = cdr.StampedEncoder(cdr.POSE_STAMPED, "world")
bag = BagWriter(Path("smoke_in"), {"/gripper": cdr.POSE_STAMPED}, "mcap")
for k in range(30):
    stamp = 10**9 + k * 2 * 10**7
    bag.write("/gripper", stamp, encoder.encode(stamp, (1e-6 * k**2, 0, 0, 0, 0, 0, 1)))
bag.finish()

simulated = run("simulate", "smoke.yaml", "--duration", "0.5")
assert simulated["simulated_s"] > 0.49 and simulated["energy_error_max"] < 1e-3
replayed = run("replay", "smoke_in", "--params", "smoke.yaml", "--output", "smoke_out")
assert replayed["messages_used"] == 30 and replayed["ticks"] > 100
run("view", "smoke_out", "--params", "smoke.yaml", "--output", "smoke.html")
assert Path("smoke.html").stat().st_size > 20_000
print(f"numba {numba.__version__}, numpy {np.__version__}, Python {sys.version.split()[0]}")
