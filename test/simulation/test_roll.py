"""The roll of a cable held at a grasp between its ends, and through springs."""

import numpy as np
import pytest
from cables import move, simulator
from test_bishop import LENGTH, SHAFT, SLACK, turn

from dlo_sim.core import bspline, rotations

AT = 0.3
HELD = {
    "gravity": [0.0, 0.0, 0.0],
    "grasps.names": ["hand"],
    "grasps.hand.at": AT,
    "grasps.hand.position": [AT, 0.0, 0.0],
    "grasps.hand.clamped": True,
    "grasps.hand.roll": True,
    "damping.mass": 5.0,
}
HANGING = SLACK | {
    "grasps.hand.position": [0.2, 0.0, -0.12],
    "grasps.hand.tangent": [1.0, 0.2, -0.3],
    "damping.mass": 3.0,
}


def held(**more):
    changed = {key.replace("__", "."): value for key, value in more.items()}
    return simulator(SHAFT, HELD, changed, method="energy_momentum", step=0.01)


def hanging(**more):
    changed = {key.replace("__", "."): value for key, value in more.items()}
    return simulator(SHAFT, HELD, HANGING, changed, method="energy_momentum", step=0.005)


def roll(sim, grasp, angle, duration=2.0):
    """Turn a gripper about the cable."""
    turn(sim, grasp, angle * sim.ends.tangent(grasp, sim.time), duration)


def slip(sim, rest=rotations.IDENTITY):
    """Rotation of the cable's material frame against the grasp, beyond `rest`, and the latter."""
    frame = sim.frames(np.linspace(0.0, LENGTH, 1001))[round(1000 * AT)]
    own = rotations.multiply(rotations.conjugate(sim.end_pose("hand")[1]), frame)
    beyond = rotations.multiply(own, rotations.conjugate(rest))
    return np.linalg.norm(rotations.to_rotation_vector(beyond * np.sign(beyond[3]))), own


def angle_at(sim, share):
    """Angle of the cable at a share of its length [rad]."""
    return bspline.evaluate(sim.control_points, sim.model.knots, [share * LENGTH])[0, 3]


def test_a_shaft_turned_in_its_middle_holds_against_both_ends():
    """GJ phi / u from one end, GJ phi / (L - u) from the other, and the grasp bears both: 3 % more,
    as the spline has no kink in its twist."""
    sim = held()
    roll(sim, "hand", 1.0)
    assert sim.advance(6.0).status.ok
    stiffness = sim.scene.cable.GJ
    left, right = stiffness / AT, stiffness / (LENGTH - AT)
    found = {name: sim.reaction(name)[1] for name in ("start", "hand", "end")}
    assert sum(found.values()) == pytest.approx(np.zeros(3), abs=1e-4 * left)
    assert found["start"] == pytest.approx([-left, 0.0, 0.0], rel=0.035)
    assert found["end"] == pytest.approx([-right, 0.0, 0.0], rel=0.035)
    assert sim.energy_error < 1e-10


@pytest.mark.parametrize("end", ["start", "end"])
def test_a_soft_roll_at_an_end_adds_its_turn_to_the_shaft(end):
    """phi / (L / GJ + 1 / k)."""
    soft = {f"{end}.clamped": False, f"{end}.tangent_spring": 1.0, f"{end}.roll_spring": 0.01}
    level = {"gravity": [0.0, 0.0, 0.0], "damping.mass": 5.0}
    sim = simulator(SHAFT, soft, level, method="energy_momentum", step=0.01)
    roll(sim, end, 2.0)
    assert sim.advance(8.0).status.ok
    moment = 2.0 / (LENGTH / sim.scene.cable.GJ + 1.0 / 0.01)
    assert sim.reaction(end)[1] == pytest.approx([moment, 0.0, 0.0], rel=1e-4, abs=1e-9)
    other = "start" if end == "end" else "end"
    assert sim.reaction(other)[1] == pytest.approx([-moment, 0.0, 0.0], rel=1e-4, abs=1e-9)
    assert sim.energy_error < 1e-10


@pytest.mark.parametrize("rigid", [True, False], ids=["rigid", "springs"])
def test_a_full_turn_of_the_middle_keeps_the_material_frame(rigid):
    """Also while it is swung; twist of opposite signs on both sides stays."""
    springs = {"grasps.hand.clamped": False, "grasps.hand.roll": False}
    springs |= {"grasps.hand.tangent_spring": 10.0, "grasps.hand.roll_spring": 10.0}
    sim = hanging(integrator__tolerance=1e-7, **({} if rigid else springs))
    sim.advance(0.5)
    _, rest = slip(sim)
    before = sim.control_points[:, 3]
    for rotation in ([2.0 * np.pi, 0.0, 0.0], [0.0, 0.4, -0.3]):
        turn(sim, "hand", rotation, 2.0)
        for _ in range(5):
            assert sim.advance(0.5).status.ok
            assert slip(sim, rest)[0] < (0.015 if rigid else 0.03)
    assert slip(sim, rest)[0] < (3e-3 if rigid else 0.02)  # 0.1 N m on 10 N m/rad
    turned = sim.control_points[:, 3] - before
    assert turned[5] > 4.0
    assert sim.energy_error < 1e-6


@pytest.mark.parametrize("natural", ["rest_twist", "rest_curvature"])
def test_a_search_for_the_shape_at_rest_leaves_a_soft_roll_no_work(natural):
    """The energy is kept from the first step on."""
    soft = {"end.clamped": False, "end.tangent_spring": 0.05, "end.roll_spring": 0.01}
    values = soft | {f"cable.{natural}": [1.0, 4.0]}
    sim = simulator(SHAFT, SLACK, values, method="energy_momentum", step=2e-3)
    move(sim, "end", 0.5, velocity=[-0.2, 0.1, 0.1])
    assert sim.advance_steps(20).status.ok
    assert sim.energy_error < 1e-6


def test_a_roll_is_taken_as_it_is_and_released():
    sim = held()
    roll(sim, "hand", 2.0)
    sim.advance(3.0)
    sim.release("hand")
    sim.advance(0.02)
    assert abs(angle_at(sim, AT) - 2.0) > 0.1
    sim.take("hand", 0.5)
    taken = angle_at(sim, 0.5)
    assert abs(taken) > 0.1
    assert sim.energy().spring == pytest.approx(0.0, abs=1e-15)
    sim.advance(1.0)
    assert angle_at(sim, 0.5) == pytest.approx(taken, abs=1e-4)
    roll(sim, "hand", -1.0)
    assert sim.advance(3.0).status.ok
    assert angle_at(sim, 0.5) == pytest.approx(taken - 1.0, abs=1e-4)
    assert sim.energy_error < 1e-10


@pytest.mark.parametrize("stiffness", [1.0, 100.0])
def test_a_stiff_spring_of_the_roll_does_not_ring_without_inertia(stiffness):
    """It prescribes the angle all but rigidly; the moment is that of the shaft, GJ phi / L."""
    springs = {"end.clamped": False, "end.tangent_spring": 10.0, "end.roll_spring": stiffness}
    values = {"gravity": [0.0] * 3, "terms.twist": "quasistatic"}
    sim = simulator(SHAFT, springs | values, method="energy_momentum", step=0.01)
    roll(sim, "end", 3.0, duration=0.05)
    seen = []
    for _ in range(20):
        assert sim.advance_steps(1).status.ok
        seen.append(sim.reaction("end")[1][0])
    series = 1.0 / (LENGTH / sim.scene.cable.GJ + 1.0 / stiffness)
    assert seen[-10:] == pytest.approx([3.0 * series] * 10, rel=1e-5)


@pytest.mark.parametrize(
    "key", ["grasps.hand.roll", "grasps.hand.roll_spring", "end.tangent_spring"]
)
def test_a_roll_that_is_held_from_now_on_is_held_where_it_is(key):
    values = {"grasps.hand.roll": False, "end.clamped": False, "terms.twist": "bishop"}
    values |= {"damping.twist": 0.05, "end.tangent_spring": 0.0}
    sim = simulator(SHAFT, HELD, values, method="energy_momentum", step=0.01)
    roll(sim, "start", 2.5)
    assert sim.advance(4.0).status.ok
    before = angle_at(sim, AT / LENGTH), sim.energy().total
    changed = {key: True if key == "grasps.hand.roll" else 1.0}
    if key == "end.tangent_spring":
        changed["end.roll_spring"] = 1.0
    other = sim.reconfigured(sim.scene.with_values(changed))
    assert other.advance(0.05).status.ok
    assert angle_at(other, AT / LENGTH) == pytest.approx(before[0], abs=1e-3)
    assert other.energy().total == pytest.approx(before[1], abs=1e-6)


def test_a_roll_that_is_switched_off_is_missed():
    assert any(line.startswith("terms.twist: off") for line in held(terms__twist="off").warnings)


def test_a_jump_of_a_roll_that_is_switched_off_is_missed():
    sim = simulator(SHAFT, {"terms.twist": "off"}, method="energy_momentum", step=0.01)
    before = sim.warnings
    turned = rotations.from_rotation_vector(0.5 * sim.ends.tangent("end", 0.0))
    sim.set_end("end", orientation=rotations.multiply(turned, sim.end_pose("end")[1]))
    assert any(line.startswith("terms.twist: off") for line in sim.warnings)
    assert not any(line.startswith("terms.twist: off") for line in before)
