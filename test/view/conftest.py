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
    # A triangle that is carried along x, and a force of 2 N at two of the times of looks.
    poses = np.tile([0.0, 0.1, -0.2, 0.0, 0.0, 0.0, 1.0], (TIMES, 1, 1))
    poses[:, 0, 0] = 0.01 * np.arange(TIMES)
    arrays |= {"obstacle_triangles": 0.1 * np.eye(3)[None], "obstacle_of": np.zeros(1)}
    arrays |= {"obstacle_poses": poses, "contact_samples": np.array([5.0, 10.0])}
    arrays |= {"contact_points": np.zeros((2, 3)), "contact_forces": 2.0 * np.eye(3)[:2]}
    arrays |= {"contact_looks": np.array([0.0, 5.0, 10.0, 20.0])}
    arrays |= {"contact_total": np.array([0.0, 2.0, 2.0, 0.0])}
    arrays |= {"contact_clearance": np.array([np.inf, -1e-3, -1e-3, 0.01])}
    np.savez(folder / "run.npz", **arrays)
    return Made(
        scene,
        folder / "bag",
        folder / "run.npz",
        np.array(lines),
        np.array(tensions),
        np.array(states)[:, [0, -1], 3:],
    )
