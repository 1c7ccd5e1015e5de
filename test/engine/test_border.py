"""Rows between two places, whose branches nothing else may support, against dense algebra."""

import numpy as np
import pytest
import scipy.linalg
from cables import scene_of, solve_held
from nets import WEIGHTLESS, net, system
from numba import boolean, int64, void

from dlo_sim.compiling.groups import grid
from dlo_sim.compiling.kernels import ARRAY_2D, kernel
from dlo_sim.engine.arrays import BETWEEN, IN_SKYLINE, IN_STATE, cable_at
from dlo_sim.engine.band import eliminate, hold
from dlo_sim.engine.border import negative_eigenvalues, set_border, solve_border
from dlo_sim.engine.skyline import (
    begin_skyline,
    eliminate_skyline,
    open_skyline,
    reach_to,
)
from dlo_sim.simulation.simulator import Simulator

WIRE = {
    "cable.length": 0.5,
    "cable.diameter": 0.01,
    "cable.linear_density": 0.1,
    "cable.axial_stiffness": 2e3,
    "cable.bending_stiffness": 0.05,
    "start.clamped": True,
    "start.tangent": [1.0, 0.0, 0.0],
    "end.fixed": [False] * 3,
    "initial.shape": "straight",
    "terms.out_of_plane": "on",
    "discretization.stretch": "sample",
    "discretization.control_points": 8,
}


def tree(giving, across):
    """A clamped cable, one that a rigid joint alone supports, and one on that, whose direction and
    roll are held by springs; in line, or across, with twist and bodies."""
    joint = {"joint": "elastic", "joint_stiffness": giving} if np.isfinite(giving) else {}
    a, b = {"at": 0.4}, {"at": 0.6, "from": "a"} | joint
    if across:
        a, b = a | {"direction": [0.0, 1.0, 0.0]}, b | {"direction": [0.6, 0.0, 0.8]}
    points = {"discretization.control_points": 7}
    twist = {"terms.twist": "bishop" if across else "off"}
    return net(WEIGHTLESS, WIRE, twist, a=a | points, b=b | points)


@pytest.mark.parametrize("transposed", [False, True], ids=["", "transposed"])
@pytest.mark.parametrize("compression", [0.0, 0.02, 0.1])
@pytest.mark.parametrize("giving", [np.inf, 40.0, 1e-2], ids=["rigid", "gives", "soft"])
@pytest.mark.parametrize("across", [False, True], ids=["in line", "across"])
def test_what_only_joints_support_is_solved_and_its_unstable_modes_counted(
    across, giving, compression, transposed
):
    """Without compression the matrix of two cables is singular, and no strand is unstable."""
    sim = tree(giving, across)
    points = sim.cable.points
    points[:, 0] *= 1.0 - compression
    sim.cable.put(points, np.zeros_like(points))
    full, _, rows = system(sim)
    basis = scipy.linalg.null_space(rows)
    within = basis.T @ full @ basis
    right = np.random.default_rng(5).normal(size=len(full))
    x = right.copy()
    negative = int((np.linalg.eigvalsh(within) < 0.0).sum())
    assert (negative > 0) == (compression > 0.0)
    sim.cable.stiffness()
    assert solve_held(sim.cable, x, transposed) == negative
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


@kernel(int64, ARRAY_2D, int64, family=BETWEEN)
def count_negative(matrix, size):
    return negative_eigenvalues(grid(matrix), size)


def test_counting_reads_and_writes_only_the_matrix():
    """Also where a search for a shape went so far that its entries are no numbers."""
    whole = np.arange(25.0).reshape(5, 5)
    for inside in (np.full((3, 3), np.nan), np.array([[1.0, 2, 0], [2, 1, 0], [0, 0, -1]])):
        matrix = whole.copy()
        matrix[:3, :3] = inside
        count = count_negative.code(0)(matrix, 3)
        assert np.isnan(inside).all() or count == 2
        assert np.array_equal(matrix[3:], whole[3:]) and np.array_equal(matrix[:, 3:], whole[:, 3:])


def test_a_cable_cut_in_two_and_joined_rests_as_uncut():
    """Only the joint supports its second half: K alone is singular there."""
    soft = WIRE | {"cable.axial_stiffness": 60.0, "cable.length": 1.0, "terms.twist": "off"}
    soft |= {"initial.shape": "equilibrium", "discretization.control_points": 13}
    whole = net(soft, {"discretization.knots": "uniform"})
    short = {"cable.length": 0.4, "discretization.control_points": 7}
    cut = net(soft, short, b={"at": 1.0, "cable.length": 0.6, "discretization.control_points": 9})
    u = np.linspace(0.0, 0.4, 11)
    assert np.abs(whole.centerline([1.0])[0, 2]) > 0.2
    assert np.abs(cut.centerline(u) - whole.centerline(u)).max() < 1e-8
    beyond = cut.centerline(1.5 * u, "b")
    assert np.abs(beyond - whole.centerline(0.4 + 1.5 * u)).max() < 1e-8
