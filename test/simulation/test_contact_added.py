"""Obstacles that are added and removed while a cable is simulated."""

from dataclasses import replace

import numpy as np
import pytest
from cables import LYING, advance, move, weight

from dlo_sim import Obstacle, Simulator
from dlo_sim.compiling.groups import Group
from dlo_sim.scene.loading import load_scene, scene_from_values
from dlo_sim.simulation.build_model import build_model, with_obstacles
from dlo_sim.simulation.error_estimate import ErrorEstimate

TABLE = Obstacle("table", position=(0.0, 0.0, -0.004))
BOX = Obstacle("box", "box", (0.04, 0.04, 0.02), (0.15, 0.03, 0.006))


def lying(**values):
    return Simulator(scene_from_values(LYING | values))


@pytest.mark.parametrize("room", [0, 4])
def test_a_cable_falls_on_a_table_that_comes_and_on_when_it_goes(room):
    """With room for it in the scene, or with memory that grows; a snapshot has what was there."""
    sim = lying(**{"contact.markers": room})
    assert "contact" not in sim.active_terms
    assert sim.left_out["contact"] == "no obstacles"
    before = sim.snapshot()
    sim.add_obstacles([TABLE])
    assert "contact" in sim.active_terms
    sim.advance(0.5)
    assert sim.contact("table").force[2] == pytest.approx(weight(sim), rel=1e-3)
    resting = sim.snapshot()
    sim.remove_obstacles(["table"])
    assert "contact" not in sim.active_terms
    assert sim.left_out["contact"] == "no obstacles"
    sim.advance(0.1)
    fallen = sim.centerline([0.15])[0, 2]
    assert fallen == pytest.approx(-0.001 - 0.5 * 9.81 * 0.1**2, rel=0.1)
    assert sim.energy_error < 1e-6
    sim.restore(resting)
    sim.advance(0.1)
    assert sim.centerline([0.15])[0, 2] == pytest.approx(-0.001, abs=1e-4)
    sim.restore(before)
    assert not sim.scene.bodies
    sim.add_obstacles([TABLE])
    sim.advance(0.5)
    assert np.array_equal(sim.snapshot().state, resting.state)


def test_what_touches_stays_as_it_is_when_others_come():
    """The bristles that hold the cable on a moving table are kept, and its motion."""
    sim = lying()
    sim.add_obstacles([TABLE])
    sim.advance(0.3)
    move(sim, "table", 1.0, velocity=[0.1, 0.0, 0.0])
    sim.advance(0.5)
    before, place = sim.contact("table").force, sim.end_pose("table")[0]
    thin = Obstacle("thin", "cylinder", (0.004, 0.004, 0.1), (0.9, 0.0, 0.0))
    sim.add_obstacles([thin])
    assert sim.model.arrays.contact.pieces > 1
    assert np.array_equal(sim.end_pose("table")[0], place)
    np.testing.assert_allclose(sim.contact("table").force, before, rtol=1e-2, atol=1e-4)
    sim.advance(0.2)
    assert sim.end_pose("table")[0][0] == pytest.approx(0.07)
    assert sim.centerline([0.15])[0, 0] == pytest.approx(0.15 + 0.07, abs=2e-3)
    assert sim.energy_error < 1e-4


def test_a_box_that_comes_pushes_the_cable_aside():
    sim = lying()
    sim.add_obstacles([TABLE, BOX])
    sim.advance(0.3)
    move(sim, "box", 0.2, velocity=[0.0, -0.1, 0.0])
    sim.advance(0.5)
    assert sim.centerline([0.15])[0, 1] == pytest.approx(-0.01 - 0.003, abs=1e-3)
    assert sim.energy_error < 1e-4


def test_one_that_grows_where_it_is_is_as_close_as_a_new_one():
    """Distances that are kept from step to step are those of the obstacle before."""
    sim = lying()
    for thick in (0.02, 0.03, 0.02):
        box = Obstacle("box", "box", (0.4, 0.4, thick), (0.15, 0.0, -0.02))
        sim.replace_added((box,))
        assert sim.contact("box").clearance == pytest.approx(0.02 - 0.5 * thick - 0.003, abs=1e-9)


@pytest.mark.parametrize(
    ("obstacle", "problem"),
    [
        (Obstacle("ball", "ball"), "obstacles.ball.shape: 'ball' is unknown"),
        (Obstacle("ball", "sphere", (0.0, 0.0, 0.0)), "obstacles.ball.size: .* has a zero"),
        (Obstacle("ball", "sphere", (np.nan,) * 3), r"obstacles.ball.size\[0\]: nan is not finite"),
        (Obstacle("start", "sphere"), "obstacles: 'start' is there already"),
        (Obstacle("itself", "sphere"), "obstacles: 'itself' means the cable itself"),
        (Obstacle("ball", "sphere", position=(0.1, 0, 0)), "the cable begins 0.049 m inside it"),
        (Obstacle("ball", "sphere", pose_topic="/ball"), "ball: is moved by Simulator.move_obs"),
    ],
)
def test_what_cannot_be_added_is_refused_and_nothing_else_is_added(obstacle, problem):
    sim = lying()
    with pytest.raises(ValueError, match=problem):
        sim.add_obstacles([TABLE, obstacle])
    assert not sim.scene.bodies


def test_unknown_ones_and_explicit_methods_are_refused():
    sim = lying(**{"integrator.method": "velocity_verlet", "integrator.step": 0.0})
    with pytest.raises(ValueError, match="obstacle: 'table' is not known"):
        sim.remove_obstacles(["table"])
    floor = lying(**{"obstacles.names": ["floor"], "obstacles.floor.position": [0.0, 0.0, -1.0]})
    with pytest.raises(ValueError, match="'floor' is of the scene, and only added ones can be"):
        floor.remove_obstacles(["floor"])
    with pytest.raises(ValueError, match="none can be added with integrator.method velocity_ve"):
        sim.add_obstacles([TABLE])
    with pytest.raises(
        ValueError,
        match=r"velocity_verlet is not valid with terms.contact auto \(contact.markers\)",
    ):
        lying(**{"integrator.method": "velocity_verlet", "contact.markers": 4})
    with pytest.raises(ValueError, match="contact.markers: 4 obstacles would do nothing"):
        lying(**{"terms.contact": "off", "contact.markers": 4})


def test_an_obstacle_that_yields_goes_on_when_a_grasp_takes_the_cable():
    """Taking makes all arrays anew."""
    sim = lying(**{"grasps.names": ["hand"], "grasps.hand.taken": False})
    sim.add_obstacles([TABLE])
    sim.advance(0.2)
    sim.set_obstacle("table", [0.0, 0.0, 0.05])
    sim.advance(0.05)
    before = sim.cable.arrays.state.overlap.copy()
    assert before.max() > 0.03
    sim.take("hand")
    assert np.array_equal(sim.cable.arrays.state.overlap, before)
    sim.advance(0.05)
    assert np.linalg.norm(sim.velocities[:, :3], axis=1).max() < 2.0


def test_the_error_estimate_takes_obstacles_up():
    """It does not depend on how steps are divided into calls."""
    found = []
    for each in (1, 4, 40):
        estimate = ErrorEstimate(lying())
        advance(estimate, 8)
        estimate.simulator.replace_added((TABLE,))
        move(estimate.simulator, "table", 1.0, velocity=[0.1, 0.0, 0.0])
        for _ in range(40 // each):
            advance(estimate, each)
        for one in (companion.simulator for companion in estimate.companions):
            assert one.time == pytest.approx(estimate.simulator.time)
            assert one.end_pose("table")[0][0] == pytest.approx(0.02)
        found.append(estimate.largest)
    assert found[0].time > 0.0
    assert found[0] == found[1] == found[2]


def test_an_obstacle_that_goes_takes_its_motions_along():
    """One of the same name that comes after it rests."""
    sim = lying()
    sim.add_obstacles([BOX])
    first = move(sim, "box", 0.02, velocity=[0.0, 1.0, 0.0])
    sim.move_obstacle("box", first.then(0.02))
    sim.remove_obstacles(["box"])
    sim.add_obstacles([BOX])
    assert sim.advance(0.1).status.ok
    assert sim.end_pose("box")[0].tolist() == list(BOX.position)


def test_an_obstacle_that_comes_leaves_the_others_what_they_carry():
    """Though the cable is pressed in; a changed parameter, and one that is new, likewise."""
    sim = lying(**{"contact.stiffness": 1e3})
    sim.add_obstacles([replace(TABLE, position=(0.0, 0.0, -0.003))])
    sim.advance(1.0)
    carried = sim.contact("table").force[2]
    assert carried == pytest.approx(weight(sim), rel=1e-2)
    assert sim.contact("table").clearance < -0.03 * sim.scene.cable.diameter
    sim.add_obstacles([replace(BOX, position=(7.0, 0.0, 0.0))])
    assert sim.contact("table").force[2] == pytest.approx(carried, rel=1e-9)
    more = {"obstacles.names": ["ball"], "obstacles.ball.shape": "sphere"}
    far = {"obstacles.ball.size": [0.1, 0.1, 0.1], "obstacles.ball.position": [0.0, 5.0, 0.0]}
    other = sim.reconfigured(scene_from_values(LYING | {"contact.stiffness": 1e3} | more | far))
    assert other.contact("table").force[2] == pytest.approx(carried, rel=1e-9)
    assert other.advance(0.1).status.ok


def test_a_reset_forgets_that_an_obstacle_jumped():
    sim = lying(**{"contact.markers": 1})
    sim.add_obstacles([TABLE])
    kept = sim.snapshot()
    sim.set_obstacle("table", [0.0, 0.0, 0.003])
    assert any("jumped into the cable once" in line for line in sim.warnings)
    sim.restore(kept)
    assert not any("jumped" in line for line in sim.warnings)


def test_a_body_from_a_marker_has_samples_beside_those_of_a_ring():
    """Its samples are others than those of the ring."""
    ring = {"shape": "ring", "size": [0.02, 0.004, 0.0], "position": [0.1, 0.0, 0.0]}
    ring = {f"obstacles.clip.{key}": value for key, value in ring.items()}
    sim = lying(**{"contact.markers": 1, "obstacles.names": ["clip"]} | ring)
    assert sim.model.arrays.contact.guide_pieces > 4
    sim.add_obstacles([replace(BOX, size=(0.001, 0.04, 0.02))])
    assert sim.model.arrays.contact.pieces > 1
    assert sim.advance_steps(5).status.ok


def constants(group, of=""):
    """All numbers of a group of arrays by name."""
    found = {}
    for name in group.kind.fields:
        value = getattr(group, name)
        if isinstance(value, Group):
            found |= constants(value, f"{of}{name}.")
        elif value is not None:
            found[of + name] = np.array(value)
    return found


@pytest.mark.parametrize("name", ["table", "harness"])
def test_constants_with_other_obstacles_are_those_of_a_scene_that_has_them(name):
    """With more, with fewer that are larger and of another shape, and with none."""
    model = Simulator(load_scene(name, {"contact.markers": 2})).model
    ball = Obstacle("ball", "sphere", (0.1,) * 3, position=(0.0, 5.0, 0.0))
    drum = Obstacle("drum", "cylinder", (0.2,) * 3, position=(0.0, 6.0, 0.0))
    for added in ((ball, drum), (replace(ball, size=(0.3,) * 3),), ()):
        scene = replace(model.scene, added=added)
        anew = build_model(scene, model.needs, model.geometries, model.origin)
        model = with_obstacles(model, scene, model.needs)
        assert model.arrays.sizes == anew.arrays.sizes
        assert list(model.obstacles) == list(anew.obstacles)
        there, here = constants(anew.arrays), constants(model.arrays)
        wrong = [one for one in there if not np.array_equal(here[one], there[one])]
        assert not wrong
