"""Terms that are switched off: obeyed, explained, with a warning where the scene loses by it."""

import numpy as np
import pytest
from cables import merged, move

from dlo_sim.core import bspline
from dlo_sim.scene.loading import SceneError, load_scene, scene_from_values
from dlo_sim.scene.needs import needs_of
from dlo_sim.simulation.simulator import Simulator

YIELDING = {"plasticity.yield_curvature": 2.0, "cable.rest_curvature": [0.0]}
FLAT = {"terms.out_of_plane": "off"}
HAND = {"loads.names": ["hand"], "initial.shape": "straight"}
WRUNG = HAND | {"loads.hand.signal": "constant", "loads.hand.torque": [0.0, 0.0, 0.1]}


def shipped(name, *more):
    return load_scene(name, merged(*more))


@pytest.mark.parametrize(
    ("name", "term", "more", "cure"),
    [
        ("paper_wire", "bend", {}, "set it to auto"),
        ("paper_wire", "gravity", {}, "set it to auto"),
        ("hanging_cable", "twist", WRUNG, "set it to auto"),
        ("hanging_cable", "damping", {}, "set it to auto"),
        ("hanging_cable", "plasticity", YIELDING, "set it to auto"),
        ("two_grippers", "out_of_plane", {}, "set it to auto"),
        ("paper_wire_force", "out_of_plane", {}, "set it to auto"),
    ],
)
def test_off_is_obeyed_and_warns_where_the_scene_needs_the_term(name, term, more, cure):
    key = f"terms.{term}"
    assert needs_of(shipped(name, more)).warnings == ()
    needs = needs_of(shipped(name, more, {key: "off"}))
    assert needs.left_out[term] == f"{key} is off"
    assert term not in needs.active
    (warning,) = needs.warnings
    assert warning.startswith(f"{key}: off, so ") and cure in warning and "\n" not in warning


def test_twist_that_is_off_warns_once_something_twists():
    """A gripper that can turn, and a moment that can come, are no loss yet."""
    sim = Simulator(shipped("hanging_cable", HAND, {"terms.twist": "off"}))
    assert sim.warnings == ()
    across = [0.0, 0.4, 0.0]
    move(sim, "start", 0.01, velocity=[0.1, 0.0, 0.0], angular_velocity=across)
    sim.set_load("hand", force=[0.0, 1.0, 0.0], torque=[0.0, 0.0, 0.0])
    assert sim.warnings == ()
    about_the_cable = [0.0, 0.0, 0.4]
    move(sim, "start", 0.01, velocity=[0.1, 0.0, 0.0], angular_velocity=about_the_cable)
    (warning,) = sim.warnings
    assert warning.startswith("terms.twist: off, so nothing turns")
    sim.reset()
    assert sim.warnings == ()
    sim.set_load("hand", torque=[0.1, 0.0, 0.0])
    assert sim.warnings == (warning,)


def test_off_is_no_loss_where_nothing_needs_the_term():
    wire = shipped("paper_wire", {"gravity": [0.0, 0.0, 0.0]})
    off = ("twist", "gravity", "damping", "plasticity", "contact", "out_of_plane")
    needs = needs_of(wire.with_values({f"terms.{term}": "off" for term in off}))
    assert needs.warnings == ()
    assert {needs.left_out[term] for term in off} == {f"terms.{term} is off" for term in off}


def test_contact_is_left_out_with_its_reason():
    assert needs_of(shipped("paper_wire")).left_out["contact"] == "no obstacles"


# -- the plane ----------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("values", "axes"),
    [
        ({"end.position": [0.0, 1.0, 0.0]}, (1, 2)),
        ({"end.position": [0.8, 0.6, 0.0]}, (0, 1)),
        ({"end.position": [0.8, 0.0, 0.6]}, (0, 2)),
        ({"gravity": [0.0, -9.81, 0.0]}, (0, 1)),
    ],
)
def test_off_keeps_the_plane_in_which_the_ends_lie_and_the_weight_if_possible(values, axes):
    ends = {"end.fixed": [True] * 3, "loads.names": ["push"]} | values
    assert needs_of(scene_from_values(ends)).axes == (0, 1, 2)
    assert needs_of(scene_from_values(ends | FLAT)).axes == axes


@pytest.mark.parametrize(
    ("values", "named"),
    [
        ({"end.position": [0.6, 0.5, 0.5], "end.fixed": [True] * 3}, "one coordinate plane"),
        ({"terms.twist": "frenet"}, "Frenet"),
        (YIELDING, "plasticity"),
    ],
)
def test_off_is_refused_where_no_plane_can_be_kept(values, named):
    with pytest.raises(SceneError, match=named) as refusal:
        Simulator(scene_from_values(values | FLAT))
    assert "terms.out_of_plane" in str(refusal.value) and "\n" not in str(refusal.value)


def test_grippers_that_leave_the_plane_are_followed_in_it():
    """Position and turn of the pose, projected; the cable goes on as if nothing led across."""
    sim = Simulator(shipped("two_grippers", FLAT))
    assert len(sim.model.axes) == 2 and len(sim.notes) == 1
    move(sim, "start", 1.0, velocity=[0.1, 0.3, 0.05], angular_velocity=[0.0, 0.0, 0.4])
    assert sim.advance(0.2).status.ok
    points = sim.control_points
    assert np.all(points[:, 1] == 0.0)
    assert points[0, :3] == pytest.approx([0.02, 0.0, 0.51])
    third = bspline.breaks(sim.model.knots)[1] / 3.0
    arm = points[1, :3] - points[0, :3]
    assert arm[1:] == pytest.approx([0.0, 0.0], abs=1e-15) and 0.9 * third < arm[0] < 1.1 * third
    assert len(sim.notes) == 1


def test_a_plane_that_is_kept_against_later_inputs_warns_then():
    push = {"end.fixed": [False] * 3, "loads.names": ["push"], "loads.push.signal": "constant"}
    sim = Simulator(
        scene_from_values(push | FLAT | {"terms.twist": "off", "loads.push.type": "force"})
    )
    assert sim.notes == ()
    sim.set_load("push", force=[0.0, 1.0, 0.0])
    assert len(sim.model.axes) == 2
    (note,) = sim.notes
    assert note.startswith("terms.out_of_plane: off")
    sim.set_load("push", force=[0.0, 2.0, 0.0])
    assert sim.notes == (note,)


# -- the length ---------------------------------------------------------------------------------
