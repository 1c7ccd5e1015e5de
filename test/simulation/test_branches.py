"""Several branches in one set of arrays, and what joins them."""

import numpy as np
import pytest
from branches import Joint, joined
from cables import move, scene_of, solve_held

from dlo_sim.core import bspline, mass
from dlo_sim.core.methods import METHODS
from dlo_sim.engine.arrays import CURVED
from dlo_sim.engine.arrays import TOUCHING as TOUCHING_ENERGY
from dlo_sim.scene.refusal import SceneError
from dlo_sim.simulation.cable import Cable
from dlo_sim.simulation.curve import Curve
from dlo_sim.simulation.natural_shape import NaturalShape
from dlo_sim.simulation.obstacles import Beside, contact_with
from dlo_sim.simulation.self_contact import (
    Joined,
    Watch,
    check_start,
    contacts_of,
    nearest,
    warnings,
)
from dlo_sim.simulation.simulator import Simulator
from dlo_sim.simulation.statics import _Search
from dlo_sim.simulation.stepper import Stepper

WIRE = {
    "cable.diameter": 0.01,
    "cable.linear_density": 0.1,
    "cable.axial_stiffness": 2e3,
    "cable.bending_stiffness": 0.01,
    "start.fixed": [True] * 3,
    "end.fixed": [False] * 3,
    "initial.shape": "straight",
    "terms.out_of_plane": "on",
    "discretization.control_points": 13,
    "discretization.stretch": "sample",
}


class Branched:
    """Branches, each first placed as a cable of its own, on one set of arrays."""

    def __init__(self, scenes, joints, method="energy_momentum", step=1e-3, driven=(), **more):
        self.parts = [Simulator(scene) for scene in scenes]
        for part, drive in zip(self.parts, driven, strict=False):
            drive(part)
        self.cable = Cable(joined([part.model for part in self.parts], joints, **more))
        self.stepper = Stepper(self.cable, METHODS[method], step)
        self.cable.motion[:] = np.concatenate([part.cable.motion for part in self.parts])
        loads = [part.cable.loads for part in self.parts]
        self.cable.loads[:] = np.concatenate(loads)
        self.cable.pull(0.0)
        self.cable.point_grasps(0.0)
        frames = [part.cable.arrays.state.frame for part in self.parts]
        self.cable.arrays.state.frame[:] = np.concatenate(frames)
        self.steps, self.curves = 0, []
        self.put(np.concatenate([part.cable.points for part in self.parts]))
        if self.cable.model.has(CURVED):
            self.lay_natural_shape()

    def lay_natural_shape(self):
        begun = np.cumsum([0, *(part.model.n for part in self.parts)])[:-1]
        grasps = np.cumsum([0, *(len(part.cable.motion) for part in self.parts)])[:-1]
        strands = [(part.model, int(first)) for part, first in zip(self.parts, begun, strict=True)]
        starts = [part.start_orientation for part in self.parts]
        natural = NaturalShape(self.cable, starts[0], strands)
        laid = []
        for k, (model, first) in enumerate(strands):
            tangent = model.geometries["start"].tangent
            self.curves.append(Curve(self.cable, tangent, model.knots, first, int(grasps[k])))
            laid.append((starts[k], self.curves[k].frames(natural.places(k), 0.0)))
        natural.lay(*laid[0], *laid[1:])
        self.cable.open_account()

    def put(self, points, rates=None):
        self.cable.put(points, np.zeros_like(points) if rates is None else rates)
        self.cable.open_account()

    def advance(self, steps):
        done = self.stepper.advance(self.steps, steps)
        assert done.status.ok and done.steps == steps
        self.steps += steps

    def branch(self, k):
        begin = sum(part.model.n for part in self.parts[:k])
        return self.cable.points[begin : begin + self.parts[k].model.n, :3]

    def at(self, k, u, order=0):
        column, values = bspline.active_basis(self.parts[k].model.knots, [u], order)
        return values[0] @ self.branch(k)[column[0] : column[0] + 4]


def whole_and_cut(method, step, **more):
    """A cable of 1 m clamped at its start and pinned at its end, and the same cut at 0.4 m, at a
    knot, with joints that keep r, r' and r'' together: the same space of curves."""
    soft = {"cable.axial_stiffness": 60.0, "integrator.method": method, "integrator.step": step}
    values = WIRE | soft | more | {"end.fixed": [True] * 3, "end.position": [0.95, 0.0, 0.1]}
    held = {"start.clamped": True, "start.tangent": [1.0, 0.0, 0.0]}
    whole = scene_of(values, held, {"cable.length": 1.0})
    loose = {"end.fixed": [False] * 3}
    begin = {"start.fixed": [False] * 3, "start.position": [0.4, 0.0, 0.0], "cable.length": 0.6}
    first = scene_of(values, held, loose, {"cable.length": 0.4}, n=7)
    second = scene_of(values, begin, n=9)
    sim = Simulator(whole)
    cut = Branched([first, second], [Joint((0, 1), (0.4, 0.0), (0, 1, 2))], method, step)
    stepper = Stepper(sim.cable, METHODS[method], step)
    return sim, stepper, cut


def test_a_cable_cut_in_two_and_joined_moves_as_uncut(method="energy_momentum", step=2e-3):
    """To round-off, as long as the motion does not amplify it."""
    sim, stepper, cut = whole_and_cut(method, step, **{"integrator.tolerance": 1e-13})
    knots, u = sim.model.knots, np.linspace(0.0, 1.0, 41)
    shape = sim.cable.points.copy()
    bump = np.sin(np.pi * np.arange(len(shape)) / (len(shape) - 1)) ** 2
    shape[:, :3] += bump[:, None] * [0.0, 0.05, -0.1]
    shape[:2, :3] = sim.cable.points[:2, :3]
    sim.cable.put(shape, np.zeros_like(shape))
    sim.cable.open_account()
    pieces = []
    for k, begin in enumerate((0.0, 0.4)):
        own = cut.parts[k].model
        greville = bspline.greville(own.knots) + begin
        pieces.append(bspline.interpolate(own.knots, bspline.evaluate(shape, knots, greville)))
    cut.put(np.concatenate(pieces))
    start = bspline.evaluate(shape[:, :3], knots, u)
    steps = round(0.2 / step)
    assert stepper.advance(0, steps).steps == steps
    cut.advance(steps)
    expected = bspline.evaluate(sim.cable.points[:, :3], knots, u)
    got = [cut.at(0, min(one, 0.4)) if one <= 0.4 else cut.at(1, one - 0.4) for one in u]
    assert np.abs(expected - start).max() > 0.05
    assert np.abs(np.array(got) - expected).max() < 1e-10


def three_strings(**more):
    """Ends on a circle of 0.4 m, strings of 0.5 m, 0.5 N/m, hinged where they meet."""
    scenes = []
    for angle in (0.0, 2.0 * np.pi / 3.0, 4.0 * np.pi / 3.0):
        place = 0.4 * np.array([np.cos(angle), np.sin(angle), 0.0])
        values = {
            "cable.length": 0.5,
            "cable.linear_density": 0.5 / 9.81,
            "cable.axial_stiffness": 3e3,
            "cable.bending_stiffness": 1e-6,
            "cable.diameter": 0.004,
            "damping.mass": 4.0,
            "discretization.control_points": 25,
            "discretization.stretch": "span",
            "start.position": place.tolist(),
            "end.position": [0.0, 0.0, -0.3],
        }
        scenes.append(scene_of(WIRE, values, more))
    return scenes


def test_three_heavy_strings_hang_as_catenaries():
    """Far ends on a circle of 0.4 m, arms of 0.5 m, 0.5 N/m, 0.3 N where they meet: each arm is a
    catenary with a horizontal force of 0.2995 N, a sag of 0.2898 m and 0.4607 N at its far end."""
    scenes = three_strings()
    scenes[0] = scenes[0].with_values({"end.mass": 0.3 / 9.81})
    joints = [Joint((0, k), (0.5, 0.5)) for k in (1, 2)]
    tree = Branched(scenes, joints, step=5e-3)
    tree.advance(2000)
    sag = -tree.at(0, 0.5)[2]
    assert sag == pytest.approx(0.2898, rel=5e-3)
    for k in range(3):
        np.testing.assert_allclose(tree.at(k, 0.5), tree.at(0, 0.5), atol=1e-12)
    forces = tree.cable.arrays.state.reaction[:9].reshape(3, 3)
    np.testing.assert_allclose(np.linalg.norm(forces, axis=1), 0.4607, rtol=5e-3)
    np.testing.assert_allclose(np.linalg.norm(forces[:, :2], axis=1), 0.2995, rtol=5e-3)


@pytest.mark.parametrize("stiffness", [np.inf, 50.0], ids=["rigid", "giving"])
def test_the_energy_of_joined_branches_is_kept(stiffness):
    joints = [Joint((0, k), (0.5, 0.5), stiffness=stiffness) for k in (1, 2)]
    tree = Branched(three_strings(**{"damping.mass": 0.0}), joints)
    tree.advance(500)
    assert tree.cable.account.exchanged > 1e-2 and tree.cable.share_open() < 1e-6
    apart = max(np.linalg.norm(tree.at(k, 0.5) - tree.at(0, 0.5)) for k in (1, 2))
    assert apart < 1e-10 if stiffness == np.inf else apart > 1e-4


def test_a_joint_that_gives_is_drawn_apart_by_what_hangs_on_it():
    """A branch on a joint of 20 N/m hangs lower by its weight over the stiffness."""
    values = {"cable.length": 0.3, "damping.mass": 8.0, "integrator.tolerance": 1e-13}
    first = scene_of(WIRE, values, {"end.position": [0.0, 0.0, -0.3]}, n=7)
    hanging = {"start.fixed": [False] * 3, "start.position": [0.0, 0.0, -0.3]}
    second = scene_of(WIRE, values, hanging, {"end.position": [0.0, 0.0, -0.6]}, n=7)
    pair = Branched([first, second], [Joint((0, 1), (0.3, 0.0), stiffness=20.0)], step=1e-3)
    pair.advance(5000)
    apart = pair.at(0, 0.3) - pair.at(1, 0.0)
    np.testing.assert_allclose(apart, [0.0, 0.0, 0.1 * 0.3 * 9.81 / 20.0], rtol=1e-6, atol=1e-9)


@pytest.mark.parametrize("transposed", [False, True], ids=["", "transposed"])
@pytest.mark.parametrize("stiffness", [np.inf, 20.0], ids=["rigid", "giving"])
def test_the_system_of_joined_branches_is_that_of_dense_algebra(stiffness, transposed):
    """Z^T (K + k b^T b) Z y = Z^T r with the columns of Z that span what is free."""
    joints = [Joint((0, k), (0.5, 0.2 * k), stiffness=stiffness) for k in (1, 2)]
    tree = Branched(three_strings(), joints)
    cable, model = tree.cable, tree.cable.model
    n, half, rng = model.n, 11, np.random.default_rng(4)
    branch = cable.arrays.mesh.branch
    near = np.abs(np.subtract.outer(np.arange(n), np.arange(n))) <= 3
    alike = np.kron(near & np.equal.outer(branch, branch), np.ones((3, 3)))
    full = (rng.normal(size=(3 * n, 3 * n)) + 40.0 * np.eye(3 * n)) * alike
    cable.band[:] = 0.0
    for r in range(3 * n):
        low, high = max(0, r - half), min(3 * n, r + half + 1)
        cable.band[r, low - r + half : high - r + half] = full[r, low:high]
    held = model.holding
    rows = np.array([np.kron(held.points[r.point].values(n), np.eye(3)[r.line]) for r in held.rows])
    for spring in held.springs:
        b = np.kron(held.points[spring.point].values(n), np.eye(3)[spring.line])
        full += spring.stiffness * np.outer(b, b)
    assert len(held.springs) == (0 if stiffness == np.inf else 6)
    right = rng.normal(size=3 * n)
    got = right.copy()
    assert solve_held(cable, got, transposed) >= 0
    full = full.T if transposed else full
    free = np.linalg.svd(rows)[2][len(rows) :].T
    expected = free @ np.linalg.solve(free.T @ full @ free, free.T @ right)
    assert np.abs(got - expected).max() < 1e-12 * np.abs(expected).max()


TWISTED = {
    "terms.twist": "bishop",
    "start.clamped": True,
    "end.fixed": [True] * 3,
    "damping.stiffness": 2e-3,
    "damping.mass": 0.5,
    "integrator.tolerance": 1e-13,
    "initial.shape": "auto",
}
HELD = {"end.clamped": True}
GIVING = {
    "end.clamped": False,
    "end.tangent_spring": 0.05,
    "end.roll_spring": 0.01,
}
COILED = {"cable.rest_curvature": [-3.0], "cable.rest_curvature_axis": [0.0, 0.0, 1.0]}
BENT = {
    "cable.rest_curvature": [1.0, 4.0],
    "cable.rest_twist": [2.0],
    "cable.torsional_stiffness": 0.02,
}


def twisted(k, *values):
    """The first or second of two unlike rods, not parallel."""
    rods = [
        {
            "cable.length": 0.5,
            "cable.torsional_stiffness": 0.008,
            "end.position": [0.42, 0.03, 0.0],
        },
        {
            "cable.length": 0.8,
            "cable.torsional_stiffness": 0.013,
            "cable.bending_stiffness": 0.02,
            "discretization.control_points": 18,
            "start.position": [0.0, 1.0, 0.2],
            "start.tangent": [0.0, 1.0, 0.0],
            "end.position": [0.1, 1.65, 0.0],
            "end.tangent": [0.0, 0.8, 0.6],
        },
    ]
    return scene_of(WIRE, TWISTED, rods[k], *values)


def turn_and_move(sim):
    """Twist the end by a turn, and move it."""
    axis = sim.ends.tangent("end", sim.time) + [0.0, 0.1, -0.2]
    move(sim, "end", 0.4, velocity=[-0.2, 0.1, 0.1], angular_velocity=14.0 * axis)


@pytest.mark.parametrize("ends", [HELD, GIVING], ids=["clamped", "giving"])
@pytest.mark.parametrize("natural", [{}, BENT], ids=["straight", "curved"])
def test_strands_twisted_apart_move_as_two_cables(ends, natural, step=2e-3):
    scenes = [twisted(0, ends, natural), twisted(1, HELD, natural and COILED)]
    pair = Branched(scenes, [], step=step, driven=[turn_and_move] * 2)
    alone = [Simulator(scene) for scene in scenes]
    steps = 150
    pair.advance(steps)
    lost = 0.0
    for k, sim in enumerate(alone):
        start = sim.cable.points[:, :3].copy()
        turn_and_move(sim)
        sim.cable.open_account()
        done = Stepper(sim.cable, METHODS["energy_momentum"], step).advance(0, steps)
        assert done.status.ok and done.steps == steps
        begin = sum(part.model.n for part in pair.parts[:k])
        got = pair.cable.points[begin : begin + sim.model.n]
        assert np.ptp(sim.cable.points[:, 3]) > 1.0
        assert np.abs(sim.cable.points[:, :3] - start).max() > 0.02
        np.testing.assert_allclose(got, sim.cable.points, rtol=0.0, atol=1e-12)
        lost += sim.cable.account.dissipated
        if pair.curves:
            u = np.linspace(0.0, sim.model.knots[-1], 30)
            now = steps * step
            frames = sim.curve.frames(u, now)
            np.testing.assert_allclose(pair.curves[k].frames(u, now), frames, atol=1e-10)
    assert pair.cable.account.dissipated == pytest.approx(lost, rel=1e-10)


def test_strands_come_to_rest_as_two_cables():
    """In as many iterations, where both are pushed aside, twisted, and what holds their rolls turns
    with the frames."""
    scenes = [twisted(0, HELD), twisted(1, HELD)]
    pair, rng = Branched(scenes, []), np.random.default_rng(3)
    alone = [Simulator(scene).cable for scene in scenes]
    pushed = []
    for cable in alone:
        points, n = cable.points, cable.model.n
        points[2:-2, :3] += 0.03 * rng.normal(size=(1, 3)) * np.hanning(n - 4)[:, None]
        points[:, 3] = np.linspace(0.0, rng.normal(), n)
        pushed.append(points)
    pseudo, counts = 1e-7 * 2.5 ** np.arange(24), []
    for cable, points in ((pair.cable, np.concatenate(pushed)), *zip(alone, pushed, strict=True)):
        cable.put(points, np.zeros_like(points))
        cable.take_tension(True)
        search = _Search(cable, twist=True, rolls=True)
        counts.append([search.step(one)[0] for one in pseudo])
    assert np.all(counts) and np.all(counts[0] <= np.maximum(*counts[1:]))
    expected = np.concatenate([cable.points for cable in alone])
    assert np.abs(expected - np.concatenate(pushed)).max() > 0.01
    np.testing.assert_allclose(pair.cable.points, expected, rtol=0.0, atol=1e-7)


FALLING = {
    "start.fixed": [False] * 3,
    "damping.mass": 0.2,
    "contact.friction": 0.3,
    "contact.stiffness": 2e4,
    "integrator.tolerance": 1e-12,
    "obstacles.names": ["floor", "bar", "eye"],
    "obstacles.floor.shape": "plane",
    "obstacles.floor.position": [0.0, 0.0, -0.06],
    "obstacles.bar.shape": "cylinder",
    "obstacles.bar.size": [0.03, 0.03, 0.6],
    "obstacles.bar.orientation": [0.7071067811865476, 0.0, 0.0, 0.7071067811865476],
    "obstacles.bar.position": [0.2, 0.15, -0.03],
    "obstacles.eye.shape": "ring",
    "obstacles.eye.size": [0.05, 0.005, 0.0],
    "obstacles.eye.orientation": [0.0, 0.7071067811865476, 0.0, 0.7071067811865476],
    "obstacles.eye.position": [0.4, 0.0, 0.0],
}


def falling(k, *values):
    """The first or second of two unlike cables beside each other, over a floor and across a bar."""
    cables = [
        {"cable.length": 0.5, "end.position": [0.5, 0.0, 0.0]},
        {
            "cable.length": 0.7,
            "cable.diameter": 0.016,
            "cable.linear_density": 0.3,
            "start.position": [-0.1, 0.3, 0.0],
            "end.position": [0.6, 0.3, 0.0],
        },
    ]
    return scene_of(WIRE, FALLING, cables[k], *values)


@pytest.mark.parametrize("twist", ["off", "bishop"])
@pytest.mark.parametrize("lands", [0, 1])
@pytest.mark.parametrize("friction, steps", [(0.0, 90), (0.3, 50)])
def test_a_strand_falls_on_obstacles_as_a_cable(lands, friction, steps, twist, step=2e-3):
    """Both are of unlike thickness and mass; while the other one falls freely, since steps and
    impulses of both are decided together. The first one also goes through a ring. Where friction
    begins to hold a landing cable, round-off grows."""
    free = {"start.position": [0.0, 0.0, 9.0], "end.position": [0.7 - 0.2 * lands, 0.0, 9.0]}
    rest = {"terms.twist": twist, "contact.friction": friction}
    scenes = [falling(k, rest, {} if k == lands else free) for k in range(2)]
    pair, sim = Branched(scenes, [], step=step), Simulator(scenes[lands])
    pair.advance(steps)
    done = Stepper(sim.cable, METHODS["energy_momentum"], step).advance(0, steps)
    assert done.status.ok and done.steps == steps
    np.testing.assert_allclose(pair.branch(lands), sim.cable.points[:, :3], rtol=0.0, atol=1e-6)
    touching = 0
    for number in range(3):
        both, own = (contact_with(one, number, None) for one in (pair.cable, sim.cable))
        assert np.all(both.strands == lands)
        touching += len(own.u)
        np.testing.assert_allclose(both.u, own.u, atol=1e-12)
        np.testing.assert_allclose(both.points, own.points, atol=1e-6)
        np.testing.assert_allclose(both.forces, own.forces, atol=1e-3)
        assert both.deepest == pytest.approx(own.deepest, abs=1e-6)
    assert touching > 4


def test_what_is_beside_a_strand_touches_obstacles():
    """A ball of 3 cm beyond the end of a cable that comes to rest on a floor, at 1.5 edges of its
    control polygon: its sample moves more than any control point."""
    away = {"obstacles.bar.position": [9.0, 0.0, 0.0], "obstacles.eye.position": [0.0, 9.0, 0.0]}
    scenes = [falling(k, {"damping.mass": 4.0}, away) for k in range(2)]
    values, n = np.zeros((1, 8, 12)), scenes[0].discretization.control_points
    values[0, 0, [2, 3, 4]] = -1.5, 2.5, 0.01
    values[0, :, 10:] = 0.03 - 0.008, 2.0
    pair = Branched(scenes, [], step=5e-3, beside=Beside(np.array([n - 4]), values))
    assert pair.cable.arrays.contact.leverage == 4.0
    pair.advance(600)
    first = pair.branch(0)
    ball = 2.5 * first[-1] - 1.5 * first[-2]
    floor = contact_with(pair.cable, 0, None)
    on_ball = floor.forces[np.linalg.norm(floor.points - ball, axis=1) < 1e-9]
    assert len(on_ball) == 1 and on_ball[0, 2] > 0.01
    assert ball[2] + 0.06 == pytest.approx(0.03 - on_ball[0, 2] / (2e4 * 0.01), abs=1e-6)
    assert floor.force[2] == pytest.approx(9.81 * (0.5 * 0.1 + 0.7 * 0.3), rel=1e-3)
    assert pair.cable.account.contact_deep == 0.0


TOUCHING = {
    "contact.self_contact": "on",
    "cable.bending_stiffness": 1e-5,
    "gravity": [0.0, 0.0, 0.0],
    "discretization.control_points": 21,
    "discretization.stretch": "span",
}
THICK, THIN = 0.01, 0.004


def crossing(k, height, *values, tight=1.0, **more):
    """One of two strings of 0.4 m that cross at a right angle, the thin one along y."""
    along = np.eye(3)[k] * 0.2 * tight
    places = {
        "start.position": (-along + [0.0, 0.0, k * height]).tolist(),
        "end.position": (along + [0.0, 0.0, k * height]).tolist(),
        "cable.length": 0.4,
        "cable.diameter": (THICK, THIN)[k],
        "cable.linear_density": (0.1, 0.02)[k],
    }
    return scene_of(WIRE, TOUCHING, places, *values, **more)


def lower_ends(sim):
    """By 3 cm."""
    for end in ("start", "end"):
        move(sim, end, 0.5, velocity=[0.0, 0.0, -0.06])


def test_tight_strands_that_cross_press_as_their_sags_say():
    """Strings of EA = 2 kN, 0.4 m long, 0.404 m between their ends, 28 mm through each other: a sag
    of 14 mm each, 24.8 N along them, and 3.436 N between them. Control points round the corners."""
    held = {"end.fixed": [True] * 3, "damping.mass": 20.0, "discretization.control_points": 61}
    scenes = [crossing(k, 0.009, held, tight=1.01) for k in range(2)]
    pair = Branched(scenes, [], step=2e-3, driven=[lambda sim: None, lower_ends])
    pair.advance(750)
    touching = contacts_of(pair.cable)["itself"]
    assert set(touching.strands) == {0}
    force = -touching.forces[:, 2].sum()
    for k in range(2):
        middle = pair.at(k, 0.2)
        sag = abs(middle[2] - pair.branch(k)[0, 2])
        half = np.hypot(0.202, sag)
        tension = 2e3 * (half / 0.2 - 1.0)
        assert sag == pytest.approx(0.014, rel=1e-2)
        assert 2.0 * tension * sag / half == pytest.approx(force, rel=1e-2)
    assert force == pytest.approx(3.436, rel=1e-2)
    gap = pair.at(1, 0.2)[2] - pair.at(0, 0.2)[2] - 0.5 * (THICK + THIN)
    assert -0.05 * THIN < gap < 0.0
    assert pair.cable.account.crossed == 0.0


@pytest.mark.parametrize("friction", [0.0, 0.5])
def test_strands_thrown_at_each_other_do_not_pass(friction):
    """They keep momentum and energy."""
    free = {"start.fixed": [False] * 3, "damping.mass": 0.0, "contact.damping": 0.0}
    scenes = [crossing(k, 0.02, free, {"contact.friction": friction}) for k in range(2)]
    pair = Branched(scenes, [], step=5e-4)
    points = pair.cable.points
    rates = np.zeros_like(points)
    rates[21:, 2], rates[:21, 1] = -2.0, 0.3
    pair.put(points, rates)
    weights = mass.multiply(pair.cable.model.mass(0), np.ones(pair.cable.model.n))
    flow = pair.cable.velocities(0.0)[:3] @ weights
    least = np.inf
    for _ in range(80):
        pair.advance(1)
        least = min(least, nearest(pair.cable.model, pair.cable.points).clearance)
    now = pair.cable.velocities(0.0)[:3] @ weights
    np.testing.assert_allclose(now, flow, atol=1e-10 * np.linalg.norm(flow))
    assert -0.5 * THIN < least < 0.0
    assert pair.cable.account.crossed == pair.cable.account.pairs_lost == 0.0
    assert pair.at(1, 0.2)[2] - pair.at(0, 0.2)[2] > 0.5 * THICK
    assert pair.cable.share_open() < 1e-6


def test_strands_in_line_meet_tip_to_tip():
    """Nothing turns between them, as along one straight cable."""
    free = {"start.fixed": [False] * 3, "damping.mass": 0.0, "cable.bending_stiffness": 0.1}
    ahead = {"start.position": [0.23, 0.0, 0.0], "end.position": [0.63, 0.0, 0.0]}
    pair = Branched([crossing(0, 0.0, free), crossing(1, 0.0, free, ahead)], [], step=2e-4)
    points, rates = pair.cable.points, np.zeros_like(pair.cable.points)
    rates[21:, 0] = -2.0
    pair.put(points, rates)
    pair.advance(200)
    gap = pair.at(1, 0.0) - pair.at(0, 0.4)
    assert np.linalg.norm(gap) > 0.4 * (THICK + THIN) and gap[0] > 0.0
    assert rates[21:, 0].mean() + 2.5 < pair.cable.velocities(0.0)[0, 21:].mean()
    assert pair.cable.account.crossed == 0.0


def test_strands_do_not_touch_near_their_joint():
    """A thin branch that leaves a thick cable across it."""
    free = {"start.fixed": [False] * 3}
    scenes = [crossing(0, 0.0), crossing(1, 0.0, free)]
    scenes[1] = scenes[1].with_values(
        {"start.position": [0.0] * 3, "end.position": [0.0, 0.4, 0.0]}
    )
    hinge, near = [Joint((0, 1), (0.2, 0.0))], [Joined((0, 0.2), (1, 0.0))]
    pair, bare = Branched(scenes, hinge, touching=near), Branched(scenes, hinge)
    assert not np.any(pair.cable.strands()[:, 0] < 0.0)
    assert np.any(bare.cable.strands()[:, 0] < -0.9 * THIN)
    places = [nearest(one.cable.model, one.cable.points) for one in (pair, bare)]
    assert places[0].clearance > 0.0 > places[1].clearance
    pair.advance(50)
    assert pair.cable.arrays.state.energy[TOUCHING_ENERGY] == 0.0


def test_a_strand_in_two_parts_presses_as_one():
    """Cut at a knot, at 0.15 m, and joined again smoothly."""
    held = {"end.fixed": [True] * 3, "damping.mass": 20.0, "contact.stiffness": 3e6}
    held, n = held | {"discretization.stretch": "sample"}, "discretization.control_points"
    whole, across = (crossing(k, 0.009, held, tight=1.01, n=43) for k in range(2))
    place = {"start.fixed": [False] * 3, "start.position": [-0.0505, 0.0, 0.0]}
    parts = [
        whole.with_values({"cable.length": 0.15, n: 18, "end.fixed": [False] * 3}),
        whole.with_values({"cable.length": 0.25, n: 28} | place),
    ]
    cut = {"joints": [Joint((0, 1), (0.15, 0.0), (0, 1, 2))]}
    cut |= {"touching": [Joined((0, 0.15), (1, 0.0))]}
    forces = []
    for scenes, how in (([*parts, across], cut), ([whole, across], {"joints": []})):
        drive = [lambda sim: None] * (len(scenes) - 1) + [lower_ends]
        net = Branched(scenes, step=2e-3, driven=drive, **how)
        points = net.cable.points
        u = [bspline.greville(part.model.knots) for part in net.parts[:-1]]
        u = np.concatenate([u[0], *(one + 0.15 for one in u[1:])])
        points[: len(u), 0] = 1.01 * (u - 0.2)
        net.put(points)
        net.advance(750)
        assert net.cable.account.crossed == 0.0
        forces.append(contacts_of(net.cable)["itself"].forces[:, 2].sum())
    assert forces[1] < -3.0 and forces[0] == pytest.approx(forces[1], rel=1e-5)


def test_strands_that_pass_through_each_other_are_seen():
    """Without contact between them; a start inside each other is refused where both are held."""
    off = {"contact.self_contact": "off"}
    pair, watch = Branched([crossing(k, 0.006, off) for k in range(2)], []), Watch()
    watch.look(pair.cable.model, pair.cable.x[:3], 0.5)
    assert "up to 0.001 m deep (at 0.2 m and 0.2 m)" in watch.warning
    deep = Branched([crossing(k, 0.001) for k in range(2)], [])
    for held in ([[], []], [[0.2], []], [[0.0], [0.0, 0.4]]):
        check_start(deep.cable, held)
    with pytest.raises(SceneError, match="begins 0.006 m inside itself, at 0.2 m and 0.2 m, where"):
        check_start(deep.cable, [[0.0, 0.2], [0.2]])
    found = list(warnings(deep.cable, contacts_of(deep.cable)["itself"], ""))
    assert sum("the cable began up to 0.006 m inside itself" in line for line in found) == 1


@pytest.mark.parametrize("gap", [0.02, 0.006])
def test_the_nearest_places_of_two_strands_are_found(gap):
    pair = Branched([crossing(k, gap) for k in range(2)], [])
    found = nearest(pair.cable.model, pair.cable.points)
    assert found.clearance == pytest.approx(gap - 0.5 * (THICK + THIN), abs=0.02 * THIN)
    assert found.strands == (0, 1) and found.u == pytest.approx((0.2, 0.2), abs=1e-3)


def test_branches_must_be_alike():
    scenes = three_strings()
    planar = scene_of(WIRE, {"terms.out_of_plane": "auto"})
    for other in (planar, scenes[0].with_values({"terms.bend": "off"})):
        with pytest.raises(ValueError, match="branches: need the same lines, terms"):
            joined([Simulator(scenes[0]).model, Simulator(other).model], [])
