"""Numbers of control points and knots that are chosen: errors, and what they depend on."""

import math
import warnings
from dataclasses import replace

import numpy as np
import pytest
from cables import scene_of
from corpus import EVERYDAY, checked, draw_at_rest

from dlo_sim.batch.batch import simulate_batch
from dlo_sim.core import bspline
from dlo_sim.scene.loading import load_scene, scene_from_values
from dlo_sim.simulation.recording import record
from dlo_sim.simulation.resolution import FEWEST, MOST, resolved
from dlo_sim.simulation.simulator import Simulator

OPEN = {"discretization.control_points": 0, "discretization.knots": "auto"}
ROPE = EVERYDAY["rope, level clamp"].values
NUMBER = "discretization.control_points"


def number_of(scene):
    return resolved(scene)[0].discretization.control_points


@pytest.mark.parametrize(
    "name", ["soft, turn in space", "rope, level clamp", "tube, between", "hose, hanging"]
)
def test_everyday_motions_are_as_accurate_as_asked(name):
    found = checked(EVERYDAY[name])
    assert found.true < 1e-3, found
    assert found.true < 1.3 * found.estimated < 1.3e-3, found
    assert not found.advice


def test_a_cable_of_100_m():
    """13 equal spans are 0.89 m off, and the report says so."""
    long = EVERYDAY["long cable"]
    found = checked(replace(long, seconds=1.0))
    assert found.true < 0.3e-3 and not found.advice, found


@pytest.mark.parametrize(
    ("name", "changes", "key"),
    [
        ("soft, approach", {NUMBER: 13}, NUMBER),
        ("hose, between", {NUMBER: 9, "discretization.knots": "uniform"}, NUMBER),
        ("USB, level clamp", {NUMBER: 9}, NUMBER),
        ("hose, hanging", {"integrator.step": 0.02}, "integrator.step"),
    ],
)
def test_what_is_too_coarse_is_told_with_a_setting_that_does(name, changes, key):
    found = checked(EVERYDAY[name], changes)
    assert found.true > 1e-3, "too coarse indeed"
    assert 0.7 * found.true < found.estimated < 3.0 * found.true
    assert key in found.advice and "exceeds accuracy.target 0.001 m" in found.advice
    assert found.after < 1e-3, found


def test_a_load_between_the_ends_is_told_where_it_resonates():
    """Most is chosen by equal spans that resolve the kink; what is left is told."""
    found = checked(EVERYDAY["soft, sway"])
    assert found.good and (found.true < 1e-3 or found.advice), found


def test_a_given_number_is_kept():
    for n in (4, 13, 60):
        scene, why = resolved(scene_of(ROPE, n=n))
        assert scene.discretization.control_points == n
        assert why.startswith(f"{n} control points as the scene asks")
    given = scene_of(ROPE, {"discretization.knots": "uniform"}, n=13)
    assert resolved(given)[0] == given
    again = resolved(resolved(scene_from_values(ROPE))[0])
    assert again[0] == resolved(scene_from_values(ROPE))[0]


def test_the_number_grows_with_the_fourth_to_fifth_root_of_the_target():
    """Errors are of order 4 elsewhere, of order 5 at clamps."""
    spans = {
        target: number_of(scene_of(ROPE, OPEN, {"accuracy.target": target})) - bspline.DEGREE
        for target in (1e-2, 1e-3, 1e-4, 1e-5)
    }
    for coarse, fine in ((1e-2, 1e-3), (1e-3, 1e-4), (1e-4, 1e-5)):
        assert 10.0 ** (1.0 / 5.0) - 0.05 < spans[fine] / spans[coarse] < 10.0**0.25 + 0.1


def test_the_same_number_whatever_the_units():
    """A cable ten times as long, thick and accurate, with the same shape: the same spans."""
    small = scene_of(ROPE, OPEN)
    values = {
        "cable.length": 20.0,
        "cable.bending_stiffness": small.cable.EI * 1e3,
        "accuracy.target": 1e-2,
        "end.position": [0.0, 0.0, -18.0],
    }
    assert number_of(small.with_values(values)) == number_of(small)


def drawn_round(radius, **changes):
    """A weightless cable of 0.6 m and radius 2 mm, pulled with 1 N round a peg below it."""
    values = {
        "cable.length": 0.6,
        "cable.diameter": 0.004,
        "cable.bending_stiffness": 1e-6,
        "gravity": [0.0, 0.0, 0.0],
        "start.position": [0.0, 0.0, 0.1],
        "end.position": [0.4, 0.0, 0.1],
        "loads.names": ["pull"],
        "loads.pull.signal": "constant",
        "loads.pull.force": [1.0, 0.0, 0.0],
        "obstacles.names": ["peg"],
        "obstacles.peg.shape": "cylinder",
        "obstacles.peg.size": [2.0 * radius, 2.0 * radius, 0.3],
        "obstacles.peg.position": [0.2, 0.0, -0.1],
    }
    return load_scene(values | changes)


def test_round_obstacles_within_reach_bound_the_spans():
    """To 0.8 of their radius with the cable's; friction round them is 31 % off with 13 points."""
    scene, why = resolved(drawn_round(0.023))
    assert scene.discretization.control_points == 30 + 3
    assert why == "33 control points: spans of 20 mm for the bend round obstacles.peg"
    ring = {"obstacles.peg.shape": "ring", "obstacles.peg.size": [0.03, 0.046, 0.0]}
    assert number_of(drawn_round(0.023, **ring)) == 33
    # a stiff cable bends over sqrt(EI / T) = 0.1 m, and what is far away does not bend it
    plain = number_of(drawn_round(0.023, **{"obstacles.peg.shape": "plane"}))
    assert plain < 15
    assert number_of(drawn_round(0.023, **{"cable.bending_stiffness": 1e-2})) < 15
    assert number_of(drawn_round(0.023, **{"obstacles.peg.position": [0.2, 0.9, 0.0]})) == plain
    assert "the bend round obstacles.peg wants 253" in resolved(drawn_round(1e-3))[1]


def test_what_grippers_can_pull_taut_bounds_the_spans():
    """Of a knot, through a ring and round a peg, with 100 N or to a strain of 0.1 %, if the cable
    is held at two places: it bends over sqrt(EI / (EA / 1000)) = 15.8 mm then. The weight alone
    pulls less.
    """
    loose = {"cable.axial_stiffness": 2e5, "cable.bending_stiffness": 0.05}
    loose |= {"loads.pull.force": [0.0, 0.0, 0.0]}
    held = loose | {"end.fixed": [True] * 3}
    ring = {"obstacles.peg.shape": "ring", "obstacles.peg.size": [0.02, 0.004, 0.0]}
    itself = {"contact.self_contact": "on"}
    assert number_of(drawn_round(0.002, **held)) == 51
    edge = {"obstacles.peg.shape": "box", "obstacles.peg.size": [0.004, 0.004, 0.3]}
    assert number_of(drawn_round(0.002, **held | edge)) == 19
    lifted = {"cable.axial_stiffness": 2e4, "cable.bending_stiffness": 0.025}
    assert number_of(drawn_round(0.002, **held | lifted)) == 51, "by the force"
    scene, why = resolved(drawn_round(0.002, **held | ring))
    assert scene.discretization.control_points == 48 + 3
    assert why == "51 control points: spans of 12 mm for the bend round obstacles.peg"
    assert (
        "12 mm for the bend round another strand" in resolved(drawn_round(2e-3, **held | itself))[1]
    )
    for values in (loose, loose | ring, loose | itself):
        assert number_of(drawn_round(0.002, **values)) == 12
    soft = {"cable.bending_stiffness": 1e-6}  # round another strand, not over 0.5 mm
    assert number_of(drawn_round(0.002, **held | itself | soft)) == math.ceil(0.6 / 0.0032) + 3


def test_the_number_stays_between_the_fewest_and_the_most():
    short = {"cable.length": 0.05, "end.position": [0.05, 0.0, 0.0]}
    assert number_of(scene_of(OPEN, short, {"accuracy.target": 0.01})) == FEWEST
    scene, why = resolved(scene_of(ROPE, OPEN, {"accuracy.target": 1e-9}))
    assert scene.discretization.control_points == MOST
    assert "250 control points: the most that are chosen, accuracy.target 1e-09 m wants " in why


@pytest.mark.parametrize("seed", [60, 471, 555, 570])
def test_a_scene_that_wants_more_than_can_be_given_gets_the_most(seed):
    """100 m of thin soft cable or hose between two grippers: thousands would be needed."""
    scene, why = resolved(scene_of(draw_at_rest(seed).values, OPEN))
    assert scene.discretization.control_points == MOST
    assert "250 control points: the most that are chosen, accuracy.target 0.001 m wants" in why
    assert int(why.split()[-1]) > 2000


def test_what_the_most_control_points_miss_is_told():
    scene = scene_of(draw_at_rest(555).values, OPEN)
    done = record(scene, 0.02, 0.02)
    assert done.ok and np.isfinite(done.control_points).all()
    assert done.error_estimate["total"] > 5.0 * scene.accuracy.target
    assert "exceeds accuracy.target 0.001 m, mostly of space" in done.advice
    assert "raise discretization.control_points to " in done.advice


def test_samples_of_a_uniform_quadrature_bound_the_number():
    uniform = {"discretization.quadrature": "uniform", "discretization.samples": 21}
    scene, why = resolved(scene_of(ROPE, OPEN, uniform))
    assert scene.discretization.control_points == 13, "ten spans, two samples each"
    assert "the most that discretization.samples allow" in why
    assert scene.discretization.knots == "uniform"


@pytest.mark.parametrize(
    ("finer", "changes"),
    [
        (True, {"cable.rest_curvature": [20.0]}),
        (True, {"cable.bending_stiffness": 2e-4}),
        (True, {"loads.names": ["hand"], "loads.hand.position": 0.4}),
        (True, {"grasps.names": ["hand"], "grasps.hand.position": [0.0, 0.0, 1.0]}),
        (False, {"cable.bending_stiffness": 0.02}),
        (False, {"start.clamped": False, "start.tangent": [0.0] * 3}),
    ],
)
def test_what_bends_the_cable_more_sharply_needs_more(finer, changes):
    usual, other = (number_of(scene_of(ROPE, OPEN, more)) for more in ({}, changes))
    assert (other > usual) is finer and other != usual


def test_poses_do_not_change_the_number():
    scene = load_scene("two_grippers", OPEN)
    poses = {"end": (np.array([0.3, 0.2, 0.4]), np.array([0.0, 0.0, 0.0, 1.0]))}
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        placed = Simulator(scene, poses)
    assert placed.model.n == Simulator(scene).model.n == number_of(scene)


def test_scenes_of_a_batch_have_the_largest_number_that_one_needs():
    soft, stiff = (
        scene_of(ROPE, OPEN, {"cable.bending_stiffness": EI, "initial.shape": "straight"})
        for EI in (2e-3, 2e-2)
    )
    assert number_of(stiff) < number_of(soft)
    result = simulate_batch([stiff, soft], 0.01, processes=1)
    assert result.control_points.shape[2] == number_of(soft)
    given = stiff.with_values({NUMBER: 11})
    assert simulate_batch([soft, given], 0.01, processes=1).control_points.shape[2] == 11
    with pytest.raises(ValueError, match="scene 1 has 9 control points, scene 0 has 11"):
        simulate_batch([given, stiff.with_values({NUMBER: 9})], 0.01, processes=1)
