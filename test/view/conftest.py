"""A short run to look at, made once: a recording, and a bag with its scene."""

from __future__ import annotations

import numpy as np
import pytest
from made_runs import PERIOD, TIMES, VALUES, Made, write_bag

from dlo_sim.scene.loading import scene_from_values
from dlo_sim.simulation.simulator import Simulator


@pytest.fixture(scope="session")
def made(tmp_path_factory: pytest.TempPathFactory) -> Made:
    folder = tmp_path_factory.mktemp("runs")
    scene = scene_from_values(VALUES)
    sim = Simulator(scene)
    u = np.linspace(0.0, 0.4, 60)
    states, lines, tensions, curvatures, forces, points = [], [], [], [], [], []
    for _ in range(TIMES):
        state = np.empty((7, 7))
        sim.control_poses(state)
        states.append(state)
        points.append(sim.control_points)
        lines.append(sim.centerline(u))
        tensions.append(sim.tension(u))
        curvatures.append(sim.curvature(u))
        forces.append(sim.reaction_wrench("start"))
        sim.advance(PERIOD)
    start, end, reach = sim.scene.discretization.grading
    assert start > 0.1, "the view has to know that spans differ in length"
    write_bag(folder / "bag", states, forces, "/dlo_sim", f"{start!r} {end!r} {reach / 0.4!r}")
    arrays = {"time": PERIOD * np.arange(TIMES), "control_points": points, "centerline": lines}
    arrays |= {"tension": tensions, "curvature": curvatures, "energy": np.zeros(TIMES)}
    np.savez(folder / "run.npz", **arrays)
    return Made(
        scene,
        folder / "bag",
        folder / "run.npz",
        np.array(lines),
        np.array(tensions),
        np.array(states)[:, [0, -1], 3:],
    )
