"""A running simulator that gets another scene keeps its shape, its motion and its ends."""

from copy import deepcopy

import numpy as np
import pytest
from cables import FLAT, FULL, SOFT, move, scene_of, simulator

from dlo_sim import Simulator, load_scene
from dlo_sim.core import bspline
from dlo_sim.core.end_motion import EndMotion
from dlo_sim.scene.description import Obstacle

U = np.linspace(0.0, 1.0, 41)
STEPS = {"integrator.method": "energy_momentum", "integrator.step": 3e-3}
LYING = {
    "cable.diameter": 0.01,
    "discretization.control_points": 10,
    "start.position": [0.0, 0.0, 0.005],
    "end.position": [1.0, 0.0, 0.005],
    "start.fixed": [True] * 3,
    "end.fixed": [False] * 3,
    "contact.friction": 0.5,
    "obstacles.names": ["table"],
    "obstacles.table.shape": "plane",
    **STEPS,
}
SPATIAL = {"terms.out_of_plane": "on"}


def swinging(n, *values):
    """A soft cable in full swing."""
    sim = simulator(SOFT, SPATIAL, *values, n=n, method="velocity_verlet", step=4e-4)
    sim.set_load("tip", force=[0.0, 0.3, 0.1])
    assert sim.advance(0.3).status.ok
    return sim


def other_scene(n, *values):
    return scene_of(SOFT, SPATIAL, *values, n=n, method="velocity_verlet", step=4e-4)


def speed(sim):
    """Velocity of the points at U, shape (41, 3)."""
    return bspline.evaluate(sim.velocities[:, :3], sim.model.knots, U)


def test_the_same_scene_goes_on_as_before():
    sim = swinging(8)
    other = sim.reconfigured(other_scene(8))
    assert np.array_equal(other.control_points, sim.control_points)
    assert np.allclose(other.velocities, sim.velocities, rtol=0, atol=1e-13)  # as w, projected anew
    assert np.abs(sim.velocities).max() > 1.0
    sim.set_load("tip", force=[0.0, 0.0, 0.0])
    sim.advance_steps(100)
    other.advance_steps(100)
    assert np.allclose(other.control_points, sim.control_points, rtol=0, atol=1e-12)


@pytest.mark.parametrize(("n", "bound"), [(13, 1e-12), (15, 3e-3), (6, 6e-2)])
def test_another_number_of_control_points_keeps_the_shape(n, bound):
    """Exact when every span is halved (8 -> 13 control points), else as close as the new spline."""
    sim = swinging(8)
    other = sim.reconfigured(other_scene(n))
    assert len(other.control_points) == n
    assert np.abs(other.centerline(U) - sim.centerline(U)).max() < bound
    assert np.abs(speed(other) - speed(sim)).max() < bound * np.abs(speed(sim)).max() * 20
    assert np.allclose(other.control_points[0, :3], 0.0, atol=1e-15)
    assert other.advance_steps(100).status.ok


def test_a_simulator_built_before_takes_over_what_changed_since():
    """Shape, motion and the poses of the ends, as if it had been built now."""
    sim = swinging(8)
    early = sim.reconfigured(other_scene(13))
    sim.set_end("start", position=[0.01, 0.0, 0.02])
    sim.advance_steps(200)
    now = sim.reconfigured(other_scene(13))
    assert np.abs(early.control_points - now.control_points).max() > 1e-2
    early.take_over(sim)
    for one, other in ((early, now), (early.reconfigured(early.scene), now)):
        assert np.array_equal(one.control_points, other.control_points)
        assert np.allclose(one.velocities, other.velocities, rtol=0, atol=1e-14)
        assert np.array_equal(one.end_pose("start")[0], [0.01, 0.0, 0.02])
    assert early.advance_steps(100).status.ok
    now.advance_steps(100)
    assert np.array_equal(early.control_points, now.control_points)


def test_another_length_stretches_the_shape_along():
    pinned = {"start.clamped": False}  # a clamp's control points keep their distance
    sim = swinging(8, pinned)
    other = sim.reconfigured(other_scene(8, pinned, {"cable.length": 1.25}))
    assert np.allclose(other.centerline(1.25 * U), sim.centerline(U), rtol=0, atol=1e-12)


def test_ends_stay_where_they_were_moved_to():
    sim = swinging(8, {"start.tangent": [1.0, 0.0, 0.0]})
    sim.set_end("start", position=[0.05, 0.02, -0.01], orientation=[0.1, 0.2, 0.0, 1.0])
    sim.advance(0.05)
    other = sim.reconfigured(other_scene(8, {"start.tangent": [1.0, 0.0, 0.0]}))
    for before, after in zip(sim.end_pose("start"), other.end_pose("start"), strict=True):
        assert np.allclose(after, before, rtol=0, atol=1e-15)
    assert np.allclose(other.control_points, sim.control_points, rtol=0, atol=1e-14)
    arm = sim.control_points[1] - sim.control_points[0]
    other.advance_steps(1)
    assert np.allclose(other.control_points[0], sim.control_points[0], rtol=0, atol=1e-14)
    # The second control point may slide along the tangent.
    after = (other.control_points[1] - other.control_points[0])[:3]
    assert np.allclose(after / np.linalg.norm(after), arm[:3] / np.linalg.norm(arm), atol=1e-13)


CLAMPED = {
    "start.pose_topic": "/start",
    "end.clamped": True,
    "end.fixed": [True, True, True],
    "initial.shape": "straight",
}


def test_the_tangent_of_a_clamp_stays_although_the_scene_does_not_name_it():
    """Two clamps face each other along x; one is moved up, then a stiffness is changed."""
    sim = simulator(SOFT, FLAT, CLAMPED, n=8, method="energy_momentum")
    sim.set_end("end", position=[0.8, 0.0, 0.3])
    sim.advance(0.2)
    arm = sim.control_points[1, :3] - sim.control_points[0, :3]
    stiffer = {"cable.bending_stiffness": 0.03}
    other = sim.reconfigured(scene_of(SOFT, FLAT, CLAMPED, stiffer, n=8, method="energy_momentum"))
    after = other.control_points[1, :3] - other.control_points[0, :3]
    assert np.allclose(after / np.linalg.norm(after), arm / np.linalg.norm(arm), atol=1e-12)


def test_the_twist_of_a_clamp_stays():
    values = FULL | FLAT | {"terms.twist": "bishop"}
    sim = simulator(values, n=8, method="energy_momentum", step=1e-3)
    sim.set_end("start", orientation=[np.sin(0.4), 0.0, 0.0, np.cos(0.4)])
    sim.advance(0.05)
    assert sim.control_points[0, 3] == pytest.approx(0.8)
    stiffer = {"cable.bending_stiffness": 0.03}
    other = sim.reconfigured(scene_of(values, stiffer, n=8, method="energy_momentum", step=1e-3))
    assert np.allclose(other.control_points[:, 3], sim.control_points[:, 3], atol=1e-12)


def test_velocities_stay_while_an_end_moves():
    """The projected velocity of a cable with a driven end is not its velocity."""
    going = [0.7, 0.0, 0.3]
    sim = simulator(SOFT, SPATIAL, {"terms.twist": "auto"}, n=8, method="energy_momentum")
    move(sim, "start", 0.2, velocity=[0.5, 0, 0.3], acceleration=[2.0, 0, 0])
    sim.advance(0.1)
    before = sim.velocities
    assert np.abs(before[0, :3]).max() > 0.5
    move(sim, "start", 0.1, velocity=going, acceleration=[2.0, 0, 0])
    sim.add_obstacles([Obstacle("far", "sphere", position=(0.0, 0.0, 9.0))])  # a new model
    assert "contact" in sim.active_terms
    assert np.allclose(sim.velocities[:, :3], before[:, :3], rtol=0.0, atol=1e-9)


def test_what_moves_and_what_friction_holds_goes_on():
    """Also out of the plane of the scene, and with motions that wait for their start."""
    sim = Simulator(load_scene(LYING | {"integrator.tolerance": 1e-10}))
    for name, speed in (("start", [0.0, 0.1, 0.05]), ("table", [0.03, 0.0, 0.0])):
        place = dict(zip(("position", "orientation"), sim.end_pose(name), strict=True))
        first = EndMotion(start=0.0, duration=0.31, **place, velocity=speed)
        sim.set_motion(name, first)
        sim.set_motion(name, first.then(0.3))
    sim.advance(0.2)
    other = sim.reconfigured(sim.scene)
    assert np.ptp(other.control_points[:, 1]) > 0.01
    assert other.contact("table").force == pytest.approx(sim.contact("table").force, rel=1e-9)
    for one in (sim, other):
        one.advance(0.3)
    # Newton's first guesses differ, as the new one knows no step before.
    assert np.allclose(other.control_points, sim.control_points, rtol=0, atol=1e-6)
    assert sim.end_pose("table")[0][0] == pytest.approx(0.03 * sim.time)


def test_a_shape_that_a_belt_brought_out_of_the_plane_stays_there():
    sim = Simulator(load_scene(LYING))
    move(sim, "table", 9.0, velocity=[0.0, 0.1, 0.0])
    sim.advance(0.2)
    other = sim.reconfigured(sim.scene)
    assert np.ptp(sim.control_points[:, 1]) > 0.01
    assert np.allclose(other.control_points, sim.control_points, rtol=0, atol=1e-15)


HIGHER = {"obstacles.table.position": [0.4, 0.0, -0.0195]}


@pytest.fixture(scope="module")
def on_the_table():
    """The shipped scene `table`, whose cable has come to rest."""
    sim = Simulator(load_scene("table"))
    sim.advance(0.5)
    return sim


def highest_of(sim, duration):
    """Highest place of the axis [m] in a time to come, and the largest velocity [m/s]."""
    high = fast = 0.0
    for _ in range(round(duration / 0.01)):
        assert sim.advance(0.01).status.ok
        high = max(high, sim.control_points[:, 2].max())
        fast = max(fast, np.abs(sim.velocities[:, :3]).max())
    return high, fast


@pytest.mark.parametrize("changed", [{"cable.diameter": 0.007}, HIGHER, "jump"])
def test_what_comes_into_the_cable_a_little_does_not_fling_it(on_the_table, changed):
    """By half a millimetre, where a gripper holds it: at rest it then rises to 5.2 mm beside it."""
    if changed == "jump":
        sim = deepcopy(on_the_table)
        sim.set_obstacle("table", HIGHER["obstacles.table.position"])
    else:
        sim = on_the_table.reconfigured(on_the_table.scene.with_values(changed))
    (line,) = [line for line in sim.warnings if line.startswith("obstacles.table")]
    assert "0.0005 m at most; it yields and pushes the cable out at 0.2 m/s" in line
    assert sim.contact("table").pressure <= on_the_table.contact("table").pressure + 1e-6
    high, fast = highest_of(sim, 0.4)
    assert high < 6.5e-3
    assert fast < 0.4
    assert sim.centerline([0.7])[0, 2] == pytest.approx(0.0035, abs=2e-5)
    assert sim.energy_error < 1e-5


def test_a_stiffer_contact_presses_no_more_than_before():
    """Though the cable lies 2 % of its diameter deep in the soft one."""
    sim = simulator(LYING, {"contact.stiffness": 4e3})
    sim.advance(1.0)
    before = sim.contact("table")
    assert 0.01 < -before.clearance / 0.01 < 0.03
    other = sim.reconfigured(sim.scene.with_values({"contact.stiffness": 1e7}))
    assert other.contact("table").pressure == pytest.approx(before.pressure, rel=1e-6)
    high, fast = highest_of(other, 0.3)
    assert high < 0.006
    assert fast < 0.3
