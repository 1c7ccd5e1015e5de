"""Rows between two places, whose branches nothing else may support, against dense algebra."""

import numpy as np
import pytest
from bodies import relaxed
from branches import Joint, joined
from cables import scene_of, solve_held
from numba import boolean, int64, void

from dlo_sim.compiling.kernels import kernel
from dlo_sim.core import bspline, spectrum
from dlo_sim.engine.arrays import BETWEEN, IN_SKYLINE, IN_STATE, cable_at
from dlo_sim.engine.band import eliminate, hold, set_border, solve_border
from dlo_sim.engine.skyline import (
    begin_skyline,
    eliminate_skyline,
    open_skyline,
    reach_to,
)
from dlo_sim.simulation.cable import Cable
from dlo_sim.simulation.simulator import Simulator

WIRE = {
    "cable.length": 0.5,
    "cable.diameter": 0.01,
    "cable.linear_density": 0.1,
    "cable.axial_stiffness": 2e3,
    "cable.bending_stiffness": 0.05,
    "start.clamped": True,
    "start.tangent": [1.0, 0.0, 0.0],
    "start.fixed": [True] * 3,
    "end.fixed": [False] * 3,
    "initial.shape": "straight",
    "terms.out_of_plane": "on",
    "discretization.stretch": "sample",
}
LOOSE = {"start.clamped": False, "start.fixed": [False] * 3}


class Tree:
    """A clamped cable, one that a rigid joint alone supports, and one on that, by springs."""

    def __init__(self, giving, compression):
        begin = {"start.position": [0.2, 0.0, 0.0], "start.tangent": [1.0, 0.0, 0.0]}
        scenes = [scene_of(WIRE, n=8), *[scene_of(WIRE, LOOSE, begin, n=7)] * 2]
        joints = [
            Joint((0, 1), (0.2, 0.0), (0, 1)),
            Joint((1, 2), (0.3, 0.5), (0, 1), giving),
        ]
        self.parts = [Simulator(scene) for scene in scenes]
        self.cable = Cable(joined([part.model for part in self.parts], joints))
        motions = [part.cable.motion for part in self.parts]
        self.cable.motion[:] = np.concatenate(motions)
        self.cable.point_grasps(0.0)
        points = np.concatenate([part.cable.points for part in self.parts])
        points[:, 0] *= 1.0 - compression
        self.cable.put(points, np.zeros_like(points))

    def rows(self):
        """Rigid rows, and those that give with their stiffnesses, over all unknowns."""
        model, direction = self.cable.model, self.cable.arrays.state.direction
        out = []
        for k, row in enumerate([*model.holding.rows, *model.holding.springs]):
            line = direction[k] if row.line < 0 else np.eye(3)[row.line]
            out.append(np.outer(model.holding.points[row.point].values(model.n), line).ravel())
        count = len(model.holding.rows)
        springs = np.array([spring.stiffness for spring in model.holding.springs])
        return np.array(out[:count]), np.array(out[count:]).reshape(-1, model.n * 3), springs


@pytest.mark.parametrize("transposed", [False, True], ids=["", "transposed"])
@pytest.mark.parametrize("compression", [0.0, 0.02, 0.1])
@pytest.mark.parametrize("giving", [np.inf, 40.0, 1e-2], ids=["rigid", "gives", "soft"])
def test_what_only_joints_support_is_solved_and_its_unstable_modes_counted(
    giving, compression, transposed
):
    """Without compression the matrix of two cables is singular, and no strand is unstable."""
    tree = Tree(giving, compression)
    full = spectrum.dense(tree.cable.stiffness(), 11)
    rigid, springs, stiffness = tree.rows()
    full = 0.5 * (full + full.T) + springs.T * stiffness @ springs
    basis = np.linalg.svd(rigid)[2][len(rigid) :].T
    within = basis.T @ full @ basis
    right = np.random.default_rng(5).normal(size=len(full))
    x = right.copy()
    negative = int((np.linalg.eigvalsh(within) < 0.0).sum())
    assert (negative > 0) == (compression > 0.0)
    assert solve_held(tree.cable, x, transposed) == negative
    expected = basis @ np.linalg.solve(within, basis.T @ right)
    assert np.abs(x - expected).max() < 1e-6 * np.abs(expected).max()


@kernel(void, int64, boolean, family=BETWEEN)
def columns_with(address, skyline):
    cable = cable_at(address)
    band, directions = cable.work.band, cable.state.direction
    hold(cable, directions, directions, band)
    set_border(cable, directions, directions)
    if skyline:
        begin_skyline(cable)
        reach_to(cable, 1, 7)
        open_skyline(cable, band)
        eliminate_skyline(cable)
    else:
        eliminate(band, cable.n * cable.lines, cable.lines)
    cable.work.results.coupled = IN_SKYLINE if skyline else IN_STATE
    solve_border(cable, band, 1.0)


def test_the_columns_of_a_skyline_are_those_of_the_band():
    """Where it reaches farther than the band, but has only zeros there."""
    touching = {"contact.self_contact": "on", "grasps.names": ["a", "b"]}
    for k, name in enumerate("ab"):
        place = {"at": 0.31 + 0.1 * k, "position": [0.3 + 0.1 * k, 0.0, 0.0], "clamped": True}
        touching |= {f"grasps.{name}.{key}": value for key, value in place.items()}
    found = []
    for skyline in (False, True):
        cable = Simulator(scene_of(WIRE, touching, n=12)).cable
        cable.stiffness()
        cable.call(columns_with, skyline)
        work = cable.arrays.work
        found.append((work.border_shift.copy(), work.border_system.copy()))
    assert found[0][0].shape[1] >= 8 and np.abs(found[0][0]).max() > 0.0
    for one, other in zip(*found, strict=True):
        assert np.abs(one - other).max() < 1e-10 * np.abs(one).max()


def test_a_cable_cut_in_two_and_joined_rests_as_uncut():
    """Only the joint supports its second half: K alone is singular there."""
    soft = {"cable.axial_stiffness": 60.0, "cable.length": 1.0}
    sim = Simulator(scene_of(WIRE, soft, n=13))
    relaxed(sim.cable, 1.0)
    first = scene_of(WIRE, soft, {"cable.length": 0.4}, n=7)
    begin = {"start.position": [0.4, 0.0, 0.0], "cable.length": 0.6}
    second = scene_of(WIRE, soft, LOOSE, begin, n=9)
    parts = [Simulator(scene) for scene in (first, second)]
    cut = Cable(joined([part.model for part in parts], [Joint((0, 1), (0.4, 0.0), (0, 1, 2))]))
    cut.motion[:] = np.concatenate([part.cable.motion for part in parts])
    cut.point_grasps(0.0)
    points = np.concatenate([part.cable.points for part in parts])
    cut.put(points, np.zeros_like(points))
    relaxed(cut, 1.0)
    u = np.linspace(0.0, 1.0, 21)
    expected = bspline.evaluate(sim.cable.points[:, :3], sim.model.knots, u)
    got = np.concatenate(
        [
            bspline.evaluate(cut.points[:7, :3], parts[0].model.knots, u[u <= 0.4]),
            bspline.evaluate(cut.points[7:, :3], parts[1].model.knots, u[u > 0.4] - 0.4),
        ]
    )
    assert np.abs(expected[:, 2]).max() > 0.2
    assert np.abs(got - expected).max() < 1e-8
