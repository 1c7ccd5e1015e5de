"""Cables that start at rest, against boundary value problems, motion, and themselves elsewhere."""

import numpy as np
import pytest
from cables import move
from corpus import draw_at_rest
from scipy.integrate import solve_bvp

from dlo_sim.core.end_motion import EndMotion
from dlo_sim.scene.loading import load_scene
from dlo_sim.scene.refusal import SceneError
from dlo_sim.simulation import statics
from dlo_sim.simulation.simulator import Simulator

TWO = load_scene("two_grippers")
SHARES = np.linspace(0.0, 1.0, 101)
PLACES = [(0.0, 0.0, 0.0), (1e4, 0.0, 0.0), (5e5, 4.5e6, 0.0)]


def turned(angle):
    """Unit vector in the xz plane at an angle [rad] above x."""
    return [float(np.cos(angle)), 0.0, float(np.sin(angle))]


def tangents(start, end):
    return {"start.tangent": turned(start), "end.tangent": turned(end)}


def planar(sim):
    """Shape and end loads from the equations of the extensible elastica with weight.

    With u along the unstressed cable, force (h, v) of the rest of the cable on the part before u:
    x' = s cos a, z' = s sin a, EI a' = m, m' = s (h sin a - v cos a), h' = 0, v' = mu g with
    s = 1 + (h cos a + v sin a) / EA. The first guess is the shape to be checked.

    Returns:
        x, z at SHARES, shape (101, 2); force (2,) and moment about y on the cable at its start.
    """
    cable, g = sim.scene.cable, -sim.scene.gravity[2]
    length = cable.length
    u = length * np.linspace(0.0, 1.0, 201)
    line, frames = sim.centerline(u), np.diff(sim.centerline(u), axis=0)
    angle = np.unwrap(np.arctan2(frames[:, 2], frames[:, 0]))
    angle = np.interp(u, 0.5 * (u[1:] + u[:-1]), angle)
    ends = [sim.ends.tangent(name, 0.0) for name in ("start", "end")]
    first, last = (float(np.arctan2(t[2], t[0])) for t in ends)
    first += 2.0 * np.pi * np.round((angle[0] - first) / (2.0 * np.pi))
    last += 2.0 * np.pi * np.round((angle[-1] - last) / (2.0 * np.pi))
    bend, force = cable.EI * np.gradient(angle, u), -sim.reaction("start")[0]
    guess = [
        *(line[:, 0], line[:, 2], angle, bend),
        *(np.full_like(u, force[0]), force[2] + cable.mu * g * u),
    ]

    def slopes(u, y):
        _, _, a, m, h, v = y
        s = 1.0 + (h * np.cos(a) + v * np.sin(a)) / cable.EA
        turning = s * (h * np.sin(a) - v * np.cos(a))
        weight = np.full_like(u, cable.mu * g)
        return np.array([s * np.cos(a), s * np.sin(a), m / cable.EI, turning, 0.0 * u, weight])

    def held(one, other):
        begin = one[:3] - [*line[0, [0, 2]], first]
        return np.concatenate([begin, other[:3] - [*line[-1, [0, 2]], last]])

    found = solve_bvp(slopes, held, u, np.array(guess), tol=1e-8, max_nodes=20000)
    assert found.success, found.message
    begin = found.sol(0.0)
    return found.sol(length * SHARES)[:2].T, -begin[4:6], begin[3]


CASES = {
    "two grippers": {},
    "0.2 apart": {"end.position": [0.2, 0.0, 0.5]},
    "0.05 apart": {"end.position": [0.05, 0.0, 0.5]},
    "0.02 apart": {"end.position": [0.02, 0.0, 0.5]},
    "turned down": {"end.position": [0.6, 0.0, 0.3], **tangents(-0.5, 0.5)},
    "turned up": {"end.position": [0.6, 0.0, 0.5], **tangents(0.5, -0.5)},
    "opposed": {"end.position": [0.3, 0.0, 0.5], **tangents(0.0, np.pi)},
    "hose": {"cable.youngs_modulus": 1e7, "cable.diameter": 0.02},
    "100 m": {
        **{"cable.length": 100.0, "cable.diameter": 0.02, "cable.youngs_modulus": 1.2e11},
        **{"cable.density": 7000.0, "start.position": [0.0] * 3, "end.position": [95.0, 0, 0]},
        "discretization.control_points": 101,
    },
    "close wire": {
        **{"cable.youngs_modulus": 2e11, "cable.diameter": 0.003, "cable.density": 7800.0},
        **{"end.position": [0.15, 0.0, 0.5], "end.tangent": turned(0.2)},
    },
    "close hose": {
        **{"cable.youngs_modulus": 1e7, "cable.diameter": 0.02},
        **{"end.position": [0.1, 0.0, 0.55], "end.tangent": turned(0.3)},
    },
}


@pytest.mark.parametrize("name", CASES)
def test_planar_shapes_and_end_loads_solve_the_boundary_value_problem(name):
    """Shape as a share of the length, loads as shares of the weight and of weight times length:
    differences are half as large or less. A rope bends at the clamps within a few per cent of it.
    """
    tolerance = 1e-3
    sim = Simulator(TWO.with_values({"initial.shape": "equilibrium", **CASES[name]}))
    line, force, moment = planar(sim)
    length, weight = sim.scene.cable.length, 9.81 * sim.scene.cable.mu * sim.scene.cable.length
    found = sim.centerline(length * SHARES)[:, [0, 2]]
    assert np.abs(found - line).max() < tolerance * length
    push, turn = sim.reaction("start")
    assert np.abs(push[[0, 2]] - force).max() < 5.0 * tolerance * weight
    assert abs(turn[1] - moment) < tolerance * weight * length


@pytest.mark.parametrize("place", PLACES[1:], ids=["10 km", "4500 km"])
def test_a_cable_far_from_the_origin_is_the_one_at_the_origin_moved(place):
    """Shape at rest and in motion, to 1e-8 m; loads to 1e-8 N."""
    found = []
    for away in (np.zeros(3), np.array(place)):
        ends = {
            f"{end}.position": (away + way).tolist()
            for end, way in (("start", [0.0, 0.0, 0.5]), ("end", [0.8, 0.0, 0.5]))
        }
        sim = Simulator(TWO.with_values(ends))
        first = sim.control_points[:, :3] - away
        move(sim, "end", 0.2, velocity=[-0.2, 0.1, 0.1])
        assert sim.advance(0.2).status.ok
        parts = first, sim.centerline(SHARES) - away, sim.control_points[:, :3] - away
        found.append([*parts, *sim.reaction("start"), sim.tension(SHARES)])
    for near, far in zip(*found, strict=True):
        assert np.abs(near - far).max() < 1e-8


def test_an_obstacle_far_from_the_origin_carries_the_cable():
    """The cable rests on a plane, at the origin, and 500 km away and 5 km up."""
    found = []
    for x, z in ((0.0, 0.0), (5e5, 5e3)):
        sim = Simulator(
            TWO.with_values(
                {
                    "start.position": [x, 0.0, z + 0.5],
                    "end.position": [x + 0.8, 0.0, z + 0.5],
                    "obstacles.names": ["floor"],
                    "obstacles.floor.position": [x, 0.0, z + 0.3],
                }
            )
        )
        found.append(sim.centerline(SHARES) - [x, 0.0, z])
    assert found[0][:, 2].min() == pytest.approx(0.303, abs=1e-3)
    assert np.abs(found[1] - found[0]).max() < 1e-8


def test_motions_and_saved_places_far_away_are_in_the_world():
    x = 5e5
    ends = {"start.position": [x, 0.0, 0.5], "end.position": [x + 0.8, 0.0, 0.5]}
    sim = Simulator(TWO.with_values(ends))
    assert sim.end_pose("end")[0] == pytest.approx([x + 0.8, 0.0, 0.5], abs=1e-9)
    sim.set_end("end", position=[x + 0.801, 0.0, 0.5])
    assert sim.advance(0.01).status.ok
    assert sim.control_points[-1, 0] == pytest.approx(x + 0.801, abs=1e-9)
    with pytest.raises(ValueError, match=r"which is at \[500000.801, 0.0, 0.5\] m"):
        sim.set_motion(
            "end",
            EndMotion(start=0.01, duration=1.0, position=[x, 0, 0], orientation=[0, 0, 0, 1]),
        )
    other = Simulator(TWO.with_values(ends))
    first = other.control_points
    other.start_from(first)
    assert other.control_points == pytest.approx(first, abs=1e-9)
    seen = sim.centerline(np.linspace(0.0, 1.0, 9))
    other.start_from_points(seen)
    assert np.abs(other.centerline(SHARES) - sim.centerline(SHARES)).max() < 0.01
    poses = np.tile([x + 0.8, 0.0, 0.5, 0.0, 0.0, 0.0, 1.0], (2, 1))
    report, shapes = other.follow([0.0, 0.01], {"end": poses}, [0.01])
    assert report.status.ok
    assert shapes[-1, -1, :3] == pytest.approx([x + 0.8, 0.0, 0.5], abs=1e-9)
    near = Simulator(TWO)
    kept = Simulator(TWO, {name: sim.end_pose(name) for name in ("start", "end")}).snapshot()
    near.restore(kept)
    assert near.control_points[0, :3] == pytest.approx([x, 0.0, 0.5], abs=1e-9)
    near.reset()
    longer = other.reconfigured(TWO.with_values({**ends, "cable.length": 1.01}))
    assert longer.control_points[0, :3] == pytest.approx([x, 0.0, 0.5], abs=1e-9)


FREE_ENDS = {"start.clamped": False, "end.clamped": False}
NOTHING_HELD = FREE_ENDS | {"start.fixed": [False] * 3, "end.fixed": [False] * 3}
NOTHING_HELD |= {"start.pose_topic": "", "end.pose_topic": ""}
GUIDED = FREE_ENDS | {f"{end}.fixed": [True, True, False] for end in ("start", "end")}
STARTED, PINNED = {"initial.shape": "straight"}, {"end.fixed": [True] * 3}
FRENET = {"terms.twist": "frenet", "integrator.method": "rk4", "damping.stiffness": 0.0}
# Values, words, cures.
# Of a method that does not keep the length.
NO_STRETCH = {"terms.stretch": "off", "integrator.method": "implicit_midpoint"}
REFUSED = {
    "free": (NOTHING_HELD, "z, where .* pull with -0.319 N", [STARTED]),
    "guided": (GUIDED, "nothing holds the cable along z", [STARTED, PINNED]),
    "no stretch": (NO_STRETCH, "stretching", [{"terms.stretch": "auto"}]),
    "frenet": (FRENET, "frenet; use straight", [STARTED]),
}


@pytest.mark.parametrize("name", REFUSED)
def test_a_refusal_says_the_cause_and_each_of_its_cures_helps(name):
    values, words, cures = REFUSED[name]
    scene = TWO.with_values({"initial.shape": "equilibrium", **values})
    with pytest.raises(SceneError, match=words) as refusal:
        Simulator(scene)
    assert "\n" not in str(refusal.value)
    for cure in cures:
        assert Simulator(scene.with_values(cure)).advance(0.05).status.ok


def test_a_shape_that_is_not_found_is_refused_and_can_be_started_straight(monkeypatch):
    """The search is made to fail."""
    monkeypatch.setattr(statics, "relax", lambda *_, **__: False)
    with pytest.raises(SceneError, match="no equilibrium found; use straight"):
        Simulator(TWO)
    assert Simulator(TWO.with_values({"initial.shape": "straight"})).advance(0.1).status.ok


STIFF = {"cable.youngs_modulus": 2e8, "end.position": [0.5, 0.0, 0.55], "terms.twist": "off"}


@pytest.mark.parametrize("values", [{"end.position": [0.3, 0.0, 0.6]}, STIFF])
def test_grippers_that_move_together_from_the_straight_cable_end_in_the_same_shape(values):
    """A push to the side shows whether they rest: the stiff cable leaves the plane, in which it
    would stay for ever without one.
    """
    more = {"discretization.control_points": 21, "damping.air_drag": 0.2, "damping.stiffness": 0.02}
    more |= {"loads.names": ["push"], "loads.push.type": "force", "loads.push.position": 0.4}
    goal = Simulator(TWO.with_values({**values, **more}))
    there = goal.end_pose("end")[0]
    way = there - [0.0, 0.0, 0.5]
    begin = np.array([0.0, 0.0, 0.5]) + way / np.linalg.norm(way)
    straight = {**values, **more, "end.position": begin.tolist(), "initial.shape": "straight"}
    for name, end in goal.scene.ends.items():
        straight[f"{name}.tangent"] = list(end.tangent)
    sim = Simulator(TWO.with_values(straight))
    move(sim, "end", 4.0, velocity=(there - begin) / 4.0)
    assert sim.advance(4.0).status.ok
    sim.set_load("push", force=[0.0, 0.02, 0.0])
    assert sim.advance(2.0).status.ok
    sim.set_load("push", force=[0.0, 0.0, 0.0])
    for _ in range(80):
        assert sim.advance(0.5).status.ok
    assert np.abs(sim.control_points - goal.control_points)[:, :3].max() < 1e-4


def test_a_natural_curvature_against_the_sag_rests_beside_the_plane():
    """It would have to bend the wrong way in the plane of its ends: that is an equilibrium, too,
    but the cable turns about its own axis as soon as something pushes it.
    """
    values = {
        "cable.length": 1.0,
        "cable.diameter": 0.006,
        "cable.density": 1100.0,
        "cable.youngs_modulus": 1.0e7,
        "cable.rest_curvature": [4.0],
        "cable.rest_curvature_axis": [0.0, 1.0, 0.0],
        "start.clamped": True,
        "start.tangent": [1.0, 0.0, 0.0],
        "end.position": [0.8, 0.0, 0.0],
        "end.fixed": [True] * 3,
        "end.clamped": True,
        "end.tangent": [1.0, 0.0, 0.0],
        "end.pose_topic": "/right/pose",
        "damping.mass": 1.0,
        "damping.stiffness": 0.01,
        "discretization.control_points": 21,
    }
    sim = Simulator(load_scene(values))
    u = np.linspace(0.0, 1.0, 51)
    begun = sim.centerline(u)
    assert np.abs(begun[:, 1]).max() > 0.01  # m beside the plane
    points = sim.control_points
    points[3:-3, 1] += 1e-3
    sim.start_from(points)
    assert sim.advance(30.0).status.ok
    assert np.abs(sim.centerline(u) - begun).max() < 1e-4


def test_a_refusal_of_few_control_points_asks_for_the_number_that_finds_a_shape():
    """A rope of 0.62 m between grippers 26 mm apart, turned by half a radian."""
    values = draw_at_rest(1700).values
    with pytest.raises(SceneError, match="9 control points, too few .* to 0, which chooses"):
        Simulator(load_scene(values | {"discretization.control_points": 9}))
    sim = Simulator(load_scene(values | {"discretization.control_points": 0}))
    assert sim.advance(0.1).status.ok


BETWEEN = {
    "cable.density": 1200.0,
    "start.clamped": True,
    "start.pose_topic": "/left/pose",
    "end.fixed": [True] * 3,
    "end.clamped": True,
    "end.pose_topic": "/right/pose",
    "damping.mass": 1.0,
    "damping.stiffness": 0.01,
    "initial.shape": "equilibrium",
}
BUCKLED = {  # scenes that are symmetric about the plane y = 0, which the cable leaves
    "thick hose": {
        "cable.length": 1.16,
        "cable.diameter": 0.0163,
        "cable.youngs_modulus": 3.37e7,
        "cable.shear_modulus": 1.13e7,
        "start.tangent": [0.9829, 0.0, -0.1844],
        "end.position": [0.558, 0.0, 0.0],
        "end.tangent": [0.986, 0.0, -0.1668],
    },
    "natural curvature": {
        "cable.length": 1.2,
        "cable.diameter": 0.008,
        "cable.linear_density": 0.09,
        "cable.bending_stiffness": 0.006,
        "cable.torsional_stiffness": 0.0048,
        "cable.axial_stiffness": 1059.0,
        "cable.rest_curvature": [4.0],
        "cable.rest_curvature_axis": [0.0, 1.0, 0.0],
        "start.tangent": [1.0, 0.0, 0.0],
        "end.position": [0.8, 0.0, 0.0],
        "end.tangent": [1.0, 0.0, 0.0],
    },
}


@pytest.mark.parametrize("name", BUCKLED)
def test_a_cable_buckles_to_the_same_side_at_any_resolution(name):
    """Or else runs of two resolutions are compared that are mirror images of each other."""
    u = np.linspace(0.0, 1.0, 30) * BUCKLED[name]["cable.length"]
    shapes = []
    for knots, n in ("auto", 21), ("uniform", 61), ("uniform", 161):
        grid = {"discretization.control_points": n, "discretization.knots": knots}
        shapes.append(Simulator(load_scene(BETWEEN | BUCKLED[name] | grid)).centerline(u))
    assert np.abs(shapes[0][:, 1]).max() > 0.03  # m
    assert shapes[1] == pytest.approx(shapes[0], abs=1e-3)
    assert shapes[2] == pytest.approx(shapes[0], abs=1e-3)


def test_an_unstable_shape_that_is_left_slowly_does_not_count_as_rest():
    """The planar shape of this cable loses its stability so slowly that a search which waits for
    its steps to shrink sees them grow from 1e-9 to 1e-7 of the length, and may take them for
    round-off.
    """
    values = BETWEEN | {
        "cable.length": 0.574918648865506,
        "cable.diameter": 0.009177945605382666,
        "cable.density": 1419.036823724683,
        "cable.youngs_modulus": 43743188.938912034,
        "cable.shear_modulus": 16596234.548149178,
        "start.position": [-1.5315345797922273, 1.871776568685716, -0.7989204886791419],
        "start.tangent": [0.9917313349854764, 0.0, -0.12833144278751243],
        "end.position": [-1.048358566778003, 1.871776568685716, -0.7989204886791419],
        "end.tangent": [0.9140465979523948, 0.0, -0.40560919216858626],
        "discretization.control_points": 121,
    }
    sim = Simulator(load_scene(values))
    begun = sim.control_points
    assert sim.advance(20.0).status.ok
    assert sim.control_points == pytest.approx(begun, abs=1e-6)


FLOOR = {"obstacles.names": ["floor"], "obstacles.floor.shape": "plane", "damping.mass": 2.0}
CHAIN = FLOOR | {
    **{"cable.length": 2.0, "cable.diameter": 0.012, "cable.linear_density": 0.2},
    **{"cable.axial_stiffness": 1e5, "cable.bending_stiffness": 0.02, "start.clamped": True},
    **{"start.tangent": [1.0, 0.0, 0.0], "obstacles.floor.friction": 0.3},
    **{"start.position": [0.0, 0.0, 0.006], "start.fixed": [True] * 3, "end.clamped": True},
    **{"end.position": [0.4, 0.0, 0.25], "end.fixed": [True] * 3, "end.tangent": [-1.0, 0.0, 0.0]},
}
BACK = {
    **{"start.position": [0.4, 0.0, 0.25], "end.position": [0.0, 0.0, 0.006]},
    **{"start.tangent": [1.0, 0.0, 0.0], "end.tangent": [-1.0, 0.0, 0.0]},
}


@pytest.mark.parametrize("more", [{}, BACK], ids=["from the floor", "to the floor"])
def test_a_drag_chain_lies_along_the_floor_and_comes_back_in_a_loop(more):
    """A boundary value problem has the front of the loop at 1.137 m and the end of what lies on the
    floor at 0.963 m; spans are 83 mm long here. It stays there until it is pushed sideways."""
    sim = Simulator(load_scene(CHAIN | more))
    points = sim.centerline(np.linspace(0.0, 2.0, 2001))
    touching = sim.contacts["floor"].u
    lies = 2.0 - touching.min() if more else touching.max()
    assert points[:, 0].max() == pytest.approx(1.137, abs=2e-3)
    assert lies == pytest.approx(0.963, abs=0.03)
    assert points[:, 2].min() > 0.006 - 0.1 * 0.012
    before = sim.control_points
    assert sim.advance(0.5).status.ok
    assert np.abs(sim.control_points - before).max() < 1e-6


DOWN = FLOOR | {
    **{"cable.length": 1.0, "cable.diameter": 0.004, "cable.bending_stiffness": 0.002},
    **{"cable.linear_density": 0.03, "start.position": [0.0, 0.0, 0.4], "start.clamped": True},
    **{"start.tangent": [0.0, 0.0, -1.0], "end.position": [0.0, 0.0, -0.6]},
}


def test_a_cable_longer_than_its_gripper_is_high_lies_on_the_floor():
    """Straight it would begin 0.6 m inside, so it begins at rest."""
    sim = Simulator(load_scene(DOWN))
    points = sim.centerline(np.linspace(0.0, 1.0, 101))
    assert np.abs(points[60:, 2] - 0.002).max() < 0.1 * 0.004
    assert np.linalg.norm(points[-1, :2] - points[60, :2]) == pytest.approx(0.4, abs=1e-3)
    with pytest.raises(
        SceneError, match=r"0\.6 m inside it, .* or set initial.shape to equilibrium"
    ):
        Simulator(load_scene(DOWN | {"initial.shape": "straight"}))


def test_a_vertical_gripper_lays_the_cable_to_the_same_side_at_any_resolution():
    """Nothing decides between the directions, which were 90 degrees and more apart."""
    sims = (Simulator(load_scene(DOWN | {"discretization.control_points": n})) for n in (15, 40))
    few, many = (sim.centerline([1.0])[0] for sim in sims)
    assert few == pytest.approx(many, abs=1e-3)
    assert many[0] > 0.6
    assert many[1] == pytest.approx(0.0, abs=1e-3)


def test_a_first_shape_inside_of_something_is_said(monkeypatch):
    monkeypatch.setattr(statics.FirstShape, "_fault", lambda self: 0.5)
    with pytest.warns(UserWarning, match=r"0\.5 diameters deep in an obstacle or in itself; raise"):
        Simulator(load_scene(DOWN))


SHELF = {
    **{"cable.length": 1.2, "cable.diameter": 0.012, "cable.linear_density": 0.1},
    **{"cable.axial_stiffness": 2e4, "cable.bending_stiffness": 0.02, "start.fixed": [True] * 3},
    **{"start.position": [-0.45, 0.0, 0.05], "end.fixed": [True] * 3, "contact.friction": 0.2},
    **{"end.position": [0.45, 0.0, 0.05], "obstacles.names": ["shelf"]},
    **{"obstacles.shelf.shape": "box", "obstacles.shelf.size": [0.5, 0.3, 0.02]},
    "obstacles.shelf.position": [0.0, 0.0, -0.01],
}
UNDER_IT = {"start.position": [-0.45, 0.0, -0.05], "end.position": [0.45, 0.0, -0.05]}
DOWN_ON_IT = {
    **{"cable.length": 0.69, "cable.linear_density": 0.2, "cable.axial_stiffness": 1e5},
    **{"start.position": [0.0, 0.0, 0.122], "start.clamped": True, "start.tangent": [0.0, 0.0, -1]},
    **{"end.fixed": [False] * 3, "initial.shape": "equilibrium", "contact.friction": 0.0},
}
OVER_ITS_RIM = {
    **{"cable.length": 1.0, "cable.diameter": 0.004, "cable.linear_density": 0.03},
    **{"cable.bending_stiffness": 0.002, "start.position": [0.0, 0.0, 0.122]},
    **{"start.clamped": True, "start.tangent": [0.6, 0.8, 0.0], "end.fixed": [False] * 3},
    **{"initial.shape": "equilibrium"},
}


def over_the_shelf(more):
    """Points of the first shape, and how high [m] their axis is over a shelf of SHELF where they
    are over or in it; at its rim, how far from it.
    """
    sim = Simulator(load_scene(SHELF | more))
    points = sim.centerline(np.linspace(0.0, sim.scene.cable.length, 4001))
    outside = np.maximum(np.abs(points) - [0.25, 0.15, np.inf], 0.0)
    outside[:, 2] = points[:, 2]
    near = np.hypot(outside[:, 0], outside[:, 1]) < 0.5 * sim.scene.cable.diameter
    return points, outside[near]


@pytest.mark.parametrize("more", [{}, DOWN_ON_IT, OVER_ITS_RIM], ids=["two", "down", "over a rim"])
def test_a_thin_shelf_carries_the_cable_above_it(more):
    """It neither begins beneath the shelf, nor goes through it on the way, nor sinks in at a rim
    between two samples: nothing is deeper than 2 % of the diameter.
    """
    _, near = over_the_shelf(more)
    radius = 0.5 * (SHELF | more)["cable.diameter"]
    above = near[near[:, 2] > -radius]
    distance = np.linalg.norm(np.maximum(above, 0.0), axis=1)
    assert len(above) > 1
    assert distance.min() > radius - 0.02 * 2.0 * radius
    flat = near[(near[:, 0] == 0.0) & (near[:, 1] == 0.0)]
    assert flat[:, 2].min() > 0.0


def test_a_cable_held_beneath_a_shelf_hangs_there():
    points, _ = over_the_shelf(UNDER_IT)
    assert points[:, 2].max() < -0.02
