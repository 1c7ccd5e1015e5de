"""Grasps through which the cable slides: known answers, the energy account, and what keeps u."""

import numpy as np
import pytest
from scipy import optimize

from dlo_sim.core.end_motion import EndMotion
from dlo_sim.scene.description import Scene
from dlo_sim.scene.loading import scene_from_values
from dlo_sim.simulation.simulator import Simulator

MASS, PRESSED, FRICTION = 0.03, 2.0, 0.3  # [kg/m], [N]
LYING = {
    "cable.length": 1.0,
    "cable.diameter": 0.006,
    "cable.linear_density": MASS,
    "cable.axial_stiffness": 2e3,
    "cable.bending_stiffness": 1e-3,
    "gravity": [0.0, 0.0, 0.0],
    "start.fixed": [False] * 3,
    "end.fixed": [False] * 3,
    "end.position": [1.0, 0.0, 0.0],
    "grasps.names": ["guide"],
    "grasps.guide.slides": True,
    "grasps.guide.at": 0.5,
    "grasps.guide.position": [0.5, 0.0, 0.0],
    "loads.names": ["pull"],
    "loads.pull.position": 1.0,
    "initial.shape": "straight",
    "terms.out_of_plane": "off",
    "integrator.tolerance": 1e-10,
    "discretization.control_points": 13,
}
PINCHED = LYING | {"grasps.guide.friction": FRICTION, "grasps.guide.grip": PRESSED}
HUNG = LYING | {
    "gravity": [0.0, 0.0, -9.81],
    "start.fixed": [True] * 3,
    "damping.mass": 4.0,
    "damping.bend": 1e-2,
}


def scene(values: dict[str, object], **changes: object) -> Scene:
    """The scene of these values, with changed ones of the guide."""
    return scene_from_values(values | {f"grasps.guide.{k}": v for k, v in changes.items()})


def pulled(force: float, duration: float) -> Simulator:
    """A cable that lies in a pinching guide, after a pull at its end; a wave to it takes 0.2 ms."""
    simulator = Simulator(scene(PINCHED | {"cable.axial_stiffness": 2e5}))
    simulator.set_load("pull", force=[force, 0.0, 0.0])
    assert simulator.advance(duration).status.ok
    return simulator


def test_below_the_friction_of_the_jaws_it_sticks() -> None:
    simulator = Simulator(scene(PINCHED | {"damping.stretch": 1e-3}))
    for share in (0.5, 0.8, 0.93, 0.98):  # a sudden pull swings beyond what it ends at
        simulator.set_load("pull", force=[share * FRICTION * PRESSED, 0.0, 0.0])
        assert simulator.advance(0.5).status.ok
    assert simulator.held_at("guide") == pytest.approx(0.5, abs=1e-6)
    assert simulator.reaction("guide")[0][0] == pytest.approx(-0.98 * FRICTION * PRESSED, rel=1e-3)


def test_above_it_slides_with_what_is_left() -> None:
    # Faster than the waves in its tail, after 0.2 s, a straight cable would begin to flutter.
    simulator = pulled(0.9, 0.1)
    limit = FRICTION * PRESSED
    rate = (0.9 - limit) / MASS
    assert simulator.velocities[:, 0].mean() == pytest.approx(0.1 * rate, rel=5e-3)
    assert simulator.held_at("guide") == pytest.approx(0.5 - 0.5 * rate * 0.01, rel=5e-3)
    assert simulator.slides["guide"].u == simulator.held_at("guide")
    assert simulator.energy_error < 1e-9
    # The loss is the friction along the way.
    lost = simulator.cable.account.dissipated
    assert lost == pytest.approx(limit * 0.5 * rate * 0.01, rel=1e-2)


def test_the_free_end_of_what_hangs_over_a_smooth_guide() -> None:
    """Along a cable that rests in equilibrium, T + EI kappa^2 / 2 - w z is constant, over a smooth
    guide too; T is the tension, z the height. From a free end to one that is pinned: the tension
    there is the weight of a cable as long as the free end is below it.
    """
    values = HUNG | {"discretization.control_points": 41}
    simulator = Simulator(scene(values, position=[0.4, 0.0, 0.0], at=0.45))
    assert simulator.advance(6.0).status.ok
    u = simulator.held_at("guide")
    assert u is not None
    assert 0.4 < u < 0.41
    force, _ = simulator.reaction("start")
    first, second, last = simulator.centerline([0.0, 1e-4, 1.0])
    tension = -force @ (second - first) / np.linalg.norm(second - first)
    assert tension == pytest.approx(MASS * 9.81 * -last[2], rel=0.01)


@pytest.mark.parametrize("way", [1.0, -1.0])
def test_a_cable_that_slips_out_is_not_held_to_the_last(way: float) -> None:
    """It falls freely through a smooth gripper, and out of it within a step of 2.5 ms."""
    values = LYING | {"gravity": [9.81 * way, 0.0, 0.0], "integrator.step": 2.5e-3}
    simulator = Simulator(scene(values, friction=0.0, grip=5.0))
    simulator.advance(0.4)
    assert simulator.held_at("guide") is None
    assert simulator.velocities[:, 0] == pytest.approx(9.81 * way * simulator.time, rel=1e-9)
    assert simulator.energy_error < 1e-9


def test_a_gripper_that_follows_a_cable_and_beyond_it() -> None:
    values = HUNG | {"end.position": [0.0, 0.0, -1.0], "damping.mass": 0.0, "damping.bend": 0.0}
    limits = {"friction": 0.5, "grip": 0.1, "tangent_spring": 0.01}
    simulator = Simulator(scene(values, position=[0.0, 0.0, -0.3], at=0.3, **limits))
    position, turned = simulator.end_pose("guide")
    path = EndMotion.resting(position, turned).then(1.0, velocity=[0.05, 0.0, -0.8])
    simulator.set_motion("guide", path)
    assert simulator.advance(0.5).status.ok
    assert simulator.held_at("guide") == pytest.approx(0.7, abs=2e-3)
    assert simulator.reaction("guide")[0][2] < -0.5 * 0.1  # the limit, or more where it deflects
    assert simulator.advance(0.5).status.ok
    assert simulator.held_at("guide") is None
    assert simulator.slides == {}
    assert np.array_equal(simulator.reaction("guide")[0], np.zeros(3))
    assert simulator.energy_error < 1e-8
    with pytest.raises(ValueError, match="does not hold the cable"):
        simulator.release("guide")
    assert simulator.reconfigured(simulator.scene).held_at("guide") is None
    simulator.take("guide", at=0.9)
    assert simulator.held_at("guide") == pytest.approx(0.9)
    assert simulator.advance(0.01).status.ok


@pytest.mark.parametrize("other_slides", [False, True])
def test_a_gripper_stops_beside_another_one(other_slides: bool) -> None:
    """It follows the cable down to one that holds it fast, or that slides with more friction."""
    other = {"at": 0.5, "position": [0.0, 0.0, -0.5], "slides": other_slides}
    values = HUNG | {"end.position": [0.0, 0.0, -1.0], "grasps.names": ["guide", "other"]}
    values |= {f"grasps.other.{key}": value for key, value in other.items()}
    if other_slides:
        values |= {"grasps.other.friction": 0.5, "grasps.other.grip": 100.0}
    simulator = Simulator(scene(values, position=[0.0, 0.0, -0.3], at=0.3))
    path = EndMotion.resting(*simulator.end_pose("guide"))
    simulator.set_motion("guide", path.then(0.25, velocity=[0.0, 0.0, -0.9]))
    for _ in range(10):
        assert simulator.advance(0.025).status.ok
        assert simulator.held_at("guide") < (simulator.held_at("other") or 0.0) <= 0.5 + 1e-3
    assert simulator.held_at("guide") == pytest.approx(0.5, abs=1e-3)
    assert simulator.reaction("guide")[0][2] < -1.0  # it draws at the cable, which it cannot pass
    assert simulator.energy_error < 1e-8


def friction_at_a_bend(tension: float, turn: float, grip: float) -> float:
    """Pull T2 [N] that draws a cable through a guide against a pull T1 = `tension`.

    Beyond what bends, the cable runs at angles b1 and b2, of sum `turn`, to its direction in the
    guide. The moment has no jump there, and friction is that of the force across:
        EI kappa^2 / 2 = T1 (1 - cos b1) = T2 (1 - cos b2),
        T2 cos b2 - T1 cos b1 = mu (T1 sin b1 + T2 sin b2 + grip).
    """

    def lacking(unknown: np.ndarray) -> list[float]:
        b1, pull = unknown
        b2 = turn - b1
        across = tension * np.sin(b1) + pull * np.sin(b2)
        return [
            tension * (1.0 - np.cos(b1)) - pull * (1.0 - np.cos(b2)),
            pull * np.cos(b2) - tension * np.cos(b1) - FRICTION * (across + grip),
        ]

    found, _, done, _ = optimize.fsolve(lacking, [0.5 * turn, 1.5 * tension], full_output=True)
    assert done == 1
    return float(found[1])


@pytest.mark.parametrize("grip", [0.0, 1.0])
def test_drawn_round_a_bend_it_feels_the_friction_of_guide_and_jaws(grip: float) -> None:
    """60 degrees, both arms much longer than what bends."""
    x, z, tension = 0.5 * np.cos(np.pi / 6), -0.25, 1.0
    values = LYING | {"start.position": [-x, 0.0, z], "end.position": [x, 0.0, z]}
    values |= {"end.fixed": [True] * 3, "grasps.guide.grip": grip, "cable.bending_stiffness": 4e-3}
    values |= {"loads.pull.position": 0.0, "loads.pull.signal": "constant"}
    values |= {"loads.pull.force": [-2.0 * x * tension, 0.0, 2.0 * z * tension]}
    values |= {"damping.mass": 5.0, "damping.stretch": 1e-2, "damping.bend": 1e-2}
    values |= {"initial.shape": "equilibrium", "discretization.control_points": 43}
    simulator = Simulator(scene(values, position=[0.0, 0.0, 0.0], friction=FRICTION))
    path = EndMotion.resting(*simulator.end_pose("end"))
    simulator.set_motion("end", path.then(2.0, velocity=[0.1 * x, 0.0, 0.1 * z]))
    pulls, told = [], []
    for _ in range(20):
        assert simulator.advance(0.05).status.ok
        pulls.append(np.linalg.norm(simulator.reaction("end")[0]))
        told.append((simulator.slides["guide"].before, simulator.slides["guide"].after))
    first, last = np.diff(simulator.centerline([0.0, 1e-3, 1.0 - 1e-3, 1.0]), axis=0)[[0, 2]]
    turn = np.arccos(first @ last / np.linalg.norm(first) / np.linalg.norm(last))
    exact = friction_at_a_bend(tension, turn, grip)
    assert np.mean(pulls[8:]) == pytest.approx(exact, rel=0.01)
    np.testing.assert_allclose(np.mean(told[8:], axis=0), [tension, exact], rtol=0.02)
    assert simulator.energy_error < 1e-8


def test_what_has_slid_is_kept_in_another_scene() -> None:
    simulator = pulled(0.9, 0.1)
    scene = simulator.scene.with_values({"discretization.control_points": 21})
    finer = simulator.reconfigured(scene)
    assert finer.held_at("guide") == simulator.held_at("guide")
    simulator.set_end("start", [0.0, 0.0, 0.0])  # rows are built anew
    simulator.release("guide")
    assert simulator.held_at("guide") is None
