"""The model of twist that scenes have by default: right in space, against a boundary value problem.

Kirchhoff's rod in world coordinates, per rest length s: with the unit tangent d, tension n.d and
twisting moment m.d,
    r' = (1 + n.d / EA) d,   q' = 1/2 (kappa, 0) q,   n' = -mu g,   m' = -r' x n,
    kappa = (m - (m.d) d) / EI + (m.d) d / GJ,
with the position r and the quaternion q of the material frame given at both ends: 13 unknowns.
"""

import math

import numpy as np
import pytest
from cables import move
from scipy.integrate import solve_bvp
from scipy.spatial.transform import Rotation

from dlo_sim.scene.loading import load_scene, scene_from_values, shipped_scene
from dlo_sim.scene.needs import needs_of
from dlo_sim.simulation.simulator import Simulator

THICK = {
    "cable.length": 0.8,
    "cable.diameter": 0.008,
    "cable.youngs_modulus": 5.0e7,
    "cable.shear_modulus": 1.7e7,
    "end.position": [0.8, 0.0, 0.0],
    "damping.mass": 3.0,
    "damping.stiffness": 0.01,
}
CLAMPS = {"start.fixed": [True] * 3, "start.clamped": True, "start.tangent": [1.0, 0.0, 0.0]}
CLAMPS |= {"end.fixed": [True] * 3, "end.clamped": True, "end.tangent": [1.0, 0.0, 0.0]}
DRIVEN = {"start.pose_topic": "/left", "end.pose_topic": "/right"}
THICK |= CLAMPS | DRIVEN


def cross(a, b):
    return np.array(
        [a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0]]
    )


def rod(sim):
    """Solution of the boundary value problem close to a simulator's present shape."""
    cable, length = sim.scene.cable, sim.scene.cable.length
    weight = np.array(sim.scene.gravity) * cable.mu
    (p0, q0), (p1, q1) = sim.end_pose("start"), sim.end_pose("end")
    last = Rotation.from_quat(q1).inv()

    def slope(_, y):
        q, n, m = y[3:7], y[7:10], y[10:13]
        q = q / np.sqrt((q * q).sum(axis=0))
        a, b, c, w = q
        d = np.array([1 - 2 * (b * b + c * c), 2 * (a * b + c * w), 2 * (a * c - b * w)])
        along = (m * d).sum(axis=0) * d
        kappa = (m - along) / cable.EI + along / cable.GJ
        turn = 0.5 * np.vstack([w * kappa + cross(kappa, q[:3]), -(kappa * q[:3]).sum(axis=0)])
        way = (1.0 + (n * d).sum(axis=0) / cable.EA) * d
        return np.vstack([way, turn, -weight[:, None] + 0.0 * n, -cross(way, n)])

    def ends(a, b):
        left = (last * Rotation.from_quat(b[3:7])).as_rotvec()
        return np.concatenate([a[:3] - p0, a[3:7] - q0, b[:3] - p1, left])

    s = np.linspace(0.0, length, 61)
    frames = sim.frames(s)
    frames *= np.sign(frames[0] @ q0)
    for i in range(1, len(s)):
        frames[i] *= math.copysign(1.0, frames[i] @ frames[i - 1])
    guess = np.zeros((13, len(s)))
    guess[:3], guess[3:7] = sim.centerline(s).T, frames.T
    force, moment = sim.reaction("start")
    guess[7:10] = -force[:, None] - weight[:, None] * s
    guess[10:13] = -moment[:, None]
    found = solve_bvp(slope, ends, s, guess, tol=1e-6, max_nodes=5000)
    assert found.success
    return found.sol


def turned(sim, position, rotation):
    """Move the end to a pose within 6 s and wait for 12 s."""
    share = np.linspace(0.0, 1.0, 121) ** 2 * (3.0 - 2.0 * np.linspace(0.0, 1.0, 121))
    begin, before = sim.end_pose("end")
    way = begin + (np.asarray(position) - begin) * share[:, None]
    turn = Rotation.from_rotvec(np.asarray(rotation) * share[:, None]) * Rotation.from_quat(before)
    poses = np.hstack([way, turn.as_quat()])
    times = sim.time + np.append(np.linspace(0.0, 6.0, 121), 18.0)
    report, _ = sim.follow(times, {"end": np.vstack([poses, poses[-1:]])}, [times[-1]])
    assert report.status.ok, report.message
    return sim


def compare(sim, share, shape):
    """Loads of both ends, relative to the largest force and moment; and the shape [m]."""
    right, length = rod(sim), sim.scene.cable.length
    s = np.linspace(0.0, length, 101)
    assert np.abs(right(s)[:3].T - sim.centerline(s)).max() < shape
    first, last = right(0.0), right(length)
    for end, y, sign in (("start", first, -1.0), ("end", last, 1.0)):
        force, moment = sim.reaction(end)
        for got, wanted in ((force, sign * y[7:10]), (moment, sign * y[10:13])):
            assert np.abs(got - wanted).max() < share * np.linalg.norm(wanted)


def test_two_grippers_that_turn_in_space():
    """The right values were found by shooting, with another program."""
    sim = turned(scene := Simulator(scene_from_values(THICK)), [0.5, 0.2, 0.15], [1.2, 0.4, -0.5])
    assert scene.scene.terms.twist == "auto"
    wanted = {
        "start": ((0.41049, 0.16612, 0.36487), (0.00542, -0.06224, -0.04180)),
        "end": ((-0.41049, -0.16612, 0.10851), (0.03308, 0.06113, 0.04276)),
    }
    for end, loads in wanted.items():
        for got, right in zip(sim.reaction(end), loads, strict=True):
            assert np.abs(got - right).max() < 2e-3 * np.linalg.norm(right)
    compare(sim, 5e-3, 3e-4)


@pytest.mark.parametrize("seed", range(6))
def test_two_grippers_at_random_poses(seed):
    """Thick and soft cables whose end turns by up to 1.6 rad about any axis."""
    random = np.random.default_rng(seed)
    scene = scene_from_values(THICK | {"discretization.control_points": 25})
    if seed % 2:
        values = {"damping.mass": 3.0, "discretization.control_points": 41}
        scene = load_scene(shipped_scene("two_grippers"), values)
    sim = Simulator(scene)
    axis = random.normal(size=3)
    rotation = random.uniform(0.8, 1.6) * axis / np.linalg.norm(axis)
    way = random.uniform([-0.35, -0.3, -0.2], [-0.1, 0.3, 0.3]) * scene.cable.length
    compare(turned(sim, sim.end_pose("end")[0] + way, rotation), 1e-2, 1e-3)


def test_plane_bending_with_an_imposed_roll():
    """A slack cable in a plane leaves it when an end is rolled: the twist bends it."""
    scene = THICK | {"end.position": [0.6, 0.0, 0.0], "discretization.control_points": 25}
    sim = turned(Simulator(scene_from_values(scene)), [0.6, 0.0, 0.0], [1.5, 0.0, 0.0])
    assert np.abs(sim.centerline([0.2, 0.4, 0.6])[:, 1]).max() > 5e-3
    compare(sim, 1e-2, 1e-3)


# -- which model --------------------------------------------------------------------------------

SPRING = {"end.clamped": False, "end.tangent_spring": 1.0, "end.roll_spring": 1.0}
MOMENT = {"loads.names": ["hand"], "loads.hand.type": "wrench"}
TURNING = {"loads.hand.signal": "constant", "loads.hand.torque": [0.1, 0.0, 0.0]}
CURVED = {"cable.rest_curvature": [2.0]}
ONE = CLAMPS | {"start.pose_topic": "/left", "end.clamped": False, "end.fixed": [False] * 3}
FREE = {"start.clamped": False, "end.fixed": [False] * 3, "end.clamped": False}


@pytest.mark.parametrize(
    ("values", "model"),
    [
        (THICK, "quasistatic"),
        (THICK | {"integrator.method": "implicit_midpoint"}, "quasistatic"),
        (THICK | SPRING, "quasistatic"),
        (CLAMPS, "quasistatic"),
        (CLAMPS | SPRING, "quasistatic"),
        (ONE, ""),
        (ONE | CURVED, "quasistatic"),
        (ONE | MOMENT, "quasistatic"),
        (ONE | MOMENT | {"loads.hand.type": "force"}, ""),
        (ONE | MOMENT | TURNING, "quasistatic"),
        (ONE | {"plasticity.yield_curvature": 1.0}, "quasistatic"),
        (FREE | {"cable.rest_twist": [1.0]}, "bishop"),
        (FREE | CURVED | {"start.pose_topic": "/left"}, ""),
    ],
)
def test_the_model_follows_from_what_twists_the_cable(values, model):
    needs = needs_of(scene_from_values(values))
    found = next((one for one in ("quasistatic", "bishop") if one in needs), "")
    assert (found if "twist" in needs else "") == model
    assert ("bishop" in needs) == (model in ("bishop", "quasistatic"))
    assert "bishop" not in needs or len(needs.axes) == 3


SOFT = {
    "cable.youngs_modulus": 1e4,
    "cable.shear_modulus": 4e3,
    "cable.density": 1e4,
    "gravity": [0.0, 0.0, -1.0],
    "discretization.control_points": 13,  # more would be stiffer
}


def roll(sim, end, angle, duration=1.0):
    """Turn an end about the cable at a constant rate."""
    move(sim, end, duration, angular_velocity=[angle / duration, 0.0, 0.0])


@pytest.mark.parametrize("method", ["auto", "energy_momentum"])
def test_a_gripper_that_turns_later_meets_the_coupled_model(method):
    values = CLAMPS | SOFT | {"end.position": [0.9, 0.0, 0.0], "integrator.method": method}
    sim = Simulator(scene_from_values(values))
    roll(sim, "end", 1.0)
    assert "bishop" in sim.active_terms and len(sim.model.axes) == 3
    assert "quasistatic" in sim.active_terms
    assert sim.advance(1.5).status.ok
    assert sim.control_points[-1, 3] == pytest.approx(1.0, abs=1e-3)
    assert np.abs(sim.centerline([0.25])[:, 1]).max() > 1e-7


def test_a_gripper_that_leaves_the_plane_later_brings_the_coupled_model():
    """It does not turn about the cable; the writhe of the shape twists it."""
    stiff = {"cable.youngs_modulus": 5.0e8, "end.position": [0.8, 0.0, 0.0]}
    sim = Simulator(scene_from_values(CLAMPS | stiff))
    sim.set_end("end", position=[0.7, 0.2, 0.1])
    assert "quasistatic" in sim.active_terms


def test_only_a_moment_twists_a_cable_of_one_gripper():
    """Nothing takes up the moment of a gripper."""
    found = []
    for kind in ("force", "wrench"):
        sim = Simulator(scene_from_values(ONE | MOMENT | {"loads.hand.type": kind}))
        roll(sim, "start", 1.0)
        sim.set_load("hand", force=[0.0, 1e-3, 0.0])
        assert sim.advance(0.1).status.ok
        assert ("bishop" in sim.active_terms) == (kind == "wrench")
        found.append(sim.control_points)
    assert np.abs(found[1] - found[0])[:, :3].max() < 2e-8  # 5e-9 by the tolerance of Newton
    assert np.ptp(found[1][:, 3]) < 1e-6


def test_a_cable_that_nothing_can_twist_turns_with_its_gripper():
    """Its frames are those of the coupled model, whose twist is zero."""
    swung = {"cable.youngs_modulus": 5.0e7, "gravity": [0.0, -3.0, -9.0], "damping.mass": 1.0}
    frames = []
    for twist in ("auto", "quasistatic"):
        sim = Simulator(scene_from_values(ONE | swung | {"terms.twist": twist}))
        assert ("twist" in sim.active_terms) == (twist != "auto")
        roll(sim, "start", 2.0)
        assert sim.advance(1.0).status.ok
        assert np.abs(sim.reaction("start")[1][0]) < 1e-9
        frames.append(sim.frames(np.linspace(0.0, 1.0, 21)))
    apart = 2.0 * np.arccos(np.clip(np.abs((frames[0] * frames[1]).sum(axis=1)), 0.0, 1.0))
    assert apart.max() < 1e-3


def test_a_twist_that_grippers_at_rest_hold_stays():
    """A narrow U at rest; the held angle drifted, and the run ended as diverged after 0.43 s."""
    values = {
        "cable.length": 0.4,
        "cable.diameter": 0.005,
        "cable.linear_density": 0.05,
        "cable.axial_stiffness": 500.0,
        "cable.bending_stiffness": 1e-3,
        "damping.bend": 1e-3,
        "start.clamped": True,
        "end.clamped": True,
        "start.tangent": [0.0, 0.0, -1.0],
        "end.tangent": [0.0, 0.0, 1.0],
        "end.position": [0.0052, 0.0, 0.0],
        "terms.out_of_plane": "on",
        "start.fixed": [True] * 3,
        "end.fixed": [True] * 3,
        "discretization.control_points": 30,
        "integrator.step": 1e-3,
    }
    sim = Simulator(load_scene(values))
    before = sim.control_points
    assert sim.advance(0.6).status.ok
    assert np.allclose(sim.control_points, before, rtol=0, atol=1e-10)
