"""Recorded harnesses: cables with branches, one of them held amid the cable."""

import os
from pathlib import Path

import numpy as np
import pytest

import dlo_sim
from dlo_sim.core import bspline, rotations
from dlo_sim.identification.measurement import GRIP, TANGENT, MeasurementError
from dlo_sim.identification.prediction import COMPUTATION, begin, marker_basis, predict, score
from dlo_sim.identification.problem import STIFFER, prepared, unknowns_of
from dlo_sim.identification.readers import read_recordings
from dlo_sim.simulation.simulator import Simulator
from dlo_sim.studies.validation import moved, scene_for

ROOT = Path(__file__).resolve().parents[2]
PLACE = Path(os.environ.get("DLO_SIM_DATA", ROOT.parent / "shared" / "data" / "real")) / "deft_bdlo"
ANGLE, BEND, LENGTH = np.radians(70.0), 5.0, 0.18  # of branch a: to the cable, [1/m], [m]
ROLL = np.radians(35.0)  # of both branches about the cable
LAST = (0.3, -0.2, 0.1)  # of the motion [m]


def arc(s):
    """Branch a, an arc that leaves a cable along x from the origin, in the plane of x and -z."""
    turned = ANGLE + BEND * s
    x = (np.sin(turned) - np.sin(ANGLE)) / BEND
    y = (np.cos(ANGLE) - np.cos(turned)) / BEND
    return np.stack([x, 0.0 * s, -y], axis=-1)


def shape():
    """A straight cable with 9 markers and two branches, of 4 and 3 markers."""
    main = np.stack([0.1 * np.arange(9), np.zeros(9), np.zeros(9)], axis=-1)
    first = main[3] + arc(LENGTH * np.array([0.25, 0.5, 0.75, 1.0]))
    second = main[6] - 0.06 * np.array([[0.0, 0.0, 1.0]]) * np.arange(1, 4)[:, None]
    branches = np.concatenate([first, second])
    branches = rotations.rotate(rotations.from_rotation_vector([ROLL, 0.0, 0.0]), branches)
    return np.concatenate([main, branches])


def harness(**changes):
    """Arrays of a file: the shape moves and turns as a whole, in two pieces of 20 frames."""
    share = np.linspace(0.0, 1.0, 20)
    turns = rotations.from_rotation_vector(np.outer(share, [0.4, -0.3, 0.5]))
    moving = [rotations.rotate(turn, shape()) for turn in turns]
    frames = np.array(moving) + share[:, None, None] * np.array(LAST)
    given = {
        "pos_um": 1e6 * np.stack([frames, frames[::-1]]),
        "rate_hz": 100,
        "clamped": [0, 1, -2, -1],
        "branch": [0] * 9 + [1] * 4 + [2] * 3,
        "attached_to": [3, 6],
    }
    return {key: value for key, value in {**given, **changes}.items() if value is not None}


@pytest.fixture
def read(tmp_path):
    def reading(**changes):
        np.savez(tmp_path / "run.npz", **harness(**changes))
        return read_recordings(tmp_path / "run.npz")

    return reading


def test_branches_are_found_with_their_natural_shape(read):
    """In the frame of the start; they bend away from it in the plane in which they leave."""
    pieces = read()
    assert len(pieces) == 2
    one = pieces[0]
    assert one.strands == ("cable",) * 5 + ("a",) * 4 + ("b",) * 3
    assert one.counted == 4
    known = one.known
    assert known["branches.names"] == ["a", "b"]
    # The grippers hold the cable midway between their markers: 0.05 to 0.75 m.
    assert known["cable.length"] == pytest.approx(0.7)
    assert known["branches.a.at"] == pytest.approx(0.25 / 0.7)
    assert known["branches.a.cable.length"] == pytest.approx(LENGTH, rel=0.01)
    assert one.shares[5:9] == pytest.approx([0.25, 0.5, 0.75, 1.0], abs=0.01)
    assert one.along[5:] == pytest.approx([0.25 / 0.7] * 4 + [0.55 / 0.7] * 3)
    direction, axis = (
        np.array(known[f"branches.a.{name}"]) for name in ("direction", "cable.rest_curvature_axis")
    )
    assert direction @ np.array(TANGENT) == pytest.approx(np.cos(ANGLE), abs=0.03)
    assert direction @ axis == pytest.approx(0.0, abs=1e-9)
    # Positive curvature turns the branch about the axis, here away from the cable's tangent.
    bends = np.cross(axis, direction) @ np.array(TANGENT)
    assert (np.array(known["branches.a.cable.rest_curvature"]) * bends < 0.0).all()
    assert np.abs(known["branches.a.cable.rest_curvature"]) == pytest.approx(BEND, rel=0.2)
    assert np.abs(known["branches.a.cable.rest_curvature_2"]).max() < 0.05
    assert known["branches.b.direction"] == pytest.approx([0.0, 0.0, 1.0], abs=1e-6)
    assert np.abs(known["branches.b.cable.rest_curvature"]).max() < 1e-6


def test_a_gripper_amid_the_cable_keeps_its_orientation(read):
    one = read(clamped=[2, -2, -1])[0]
    assert set(one.poses) == {GRIP, "end"}
    assert one.held_at == {GRIP: pytest.approx(0.2 / 0.75), "end": 1.0}
    assert one.counted == 3
    assert len(one.shares) == 6 + 7
    assert np.ptp(one.poses[GRIP][:, 3:], axis=0).max() == 0.0
    assert one.poses[GRIP][-1, :3] == pytest.approx(one.markers[-1, [1, 2]].mean(axis=0))
    assert one.known["start.fixed"] == [False] * 3
    assert one.known["grasps.grip.roll"]


def test_the_first_shape_moves_with_what_its_branch_begins_at(read):
    """A branch is blended as the place where it begins."""
    one = read()[0]
    shift = moved(one)[-1] - one.markers[0]
    ends = [one.poses[end][-1, :3] - one.poses[end][0, :3] for end in ("start", "end")]
    share = 0.25 / 0.7
    assert shift[5:9] == pytest.approx(np.tile((1 - share) * ends[0] + share * ends[1], (4, 1)))


FITTED = {
    **COMPUTATION,
    "discretization.control_points": 9,
    "cable.linear_density": 0.03,
    "cable.axial_stiffness": 500.0,
    "cable.bending_stiffness": 1e-3,
}


def test_branches_begin_as_their_markers_are(read):
    """Rolled about the cable by 35 degrees, which the grippers then hold without twist."""
    one = read()[0]
    scene = prepared(dlo_sim.load_scene({**FITTED, **one.known, "terms.twist": "bishop"}))
    simulator = Simulator(scene, one.ends_at(0))
    rolled = begin(simulator, one, slice(2))
    apart = marker_basis(simulator, rolled) @ simulator.control_points[:, :3] - rolled.markers[0]
    assert np.abs(apart).max() < 3e-3
    assert simulator.energy().spring < 1e-9  # no joint is strained
    main = simulator.model.parts[0]
    places = np.linspace(0.0, main.length, 20)
    twist = bspline.evaluate(simulator.control_points[main.here, 3:], main.model.knots, places)
    assert np.ptp(twist) < 0.03
    turned = rotations.multiply(
        rotations.conjugate(one.poses["start"][:, 3:]), rolled.poses["start"][:, 3:]
    )
    angles = rotations.to_rotation_vector(turned) @ np.array(TANGENT)
    # The frame of the start has the branches at its z axis, which is along x of the world.
    assert np.ptp(angles) < 1e-9
    assert np.abs(angles[0]) > 0.5
    report, _ = simulator.follow(rolled.times, rolled.poses, rolled.times[1:])
    assert report.status.ok


def test_bodies_at_joints_of_a_bent_cable_begin_without_strain(read):
    """A body there has directors of unit length, so that r' has, too."""
    radius, (x, y, z) = 0.2, shape().T
    bent = [(radius - z) * np.sin(x / radius), y, radius - (radius - z) * np.cos(x / radius)]
    one = read(pos_um=1e6 * np.tile(np.stack(bent, axis=-1), (1, 3, 1, 1)))[0]
    scene = prepared(dlo_sim.load_scene({**FITTED, **one.known}))
    simulator = Simulator(scene, one.ends_at(0))
    begin(simulator, one, slice(2))
    main = simulator.model.parts[0]
    points, at = (
        simulator.control_points[main.here, :3],
        [join.at for join in simulator.model.joins],
    )
    slopes = bspline.evaluate(points, main.model.knots, at, 1)
    assert np.linalg.norm(slopes, axis=1) == pytest.approx([1.0, 1.0], abs=1e-9)
    assert simulator.energy().spring < 1e-9


def test_branches_are_stiffer_to_begin_with_and_turn_with_their_curvature(read):
    one = read()[0]
    scene = prepared(dlo_sim.load_scene({**FITTED, **one.known}))
    assert scene.branches[0].cable.EI == pytest.approx(STIFFER * 1e-3)
    assert prepared(scene).branches[0].cable.EI == pytest.approx(STIFFER * 1e-3)
    labels = {unknown.label for unknown in unknowns_of(scene, one)}
    assert {"branches.a.cable.linear_density", "branches.b.direction[1]"} <= labels
    # The roll of the first branch against that of the grippers is not known.
    assert "branches.a.direction[1]" not in labels
    assert {"damping.bend", "damping.twist", "cable.rest_curvature_2[3]"} <= labels
    assert not {"damping.stiffness", "cable.rest_curvature_2[4]"} & labels


def test_what_damps_all_strains_of_a_harness_damps_bending_and_twist(read):
    damped = {"damping.stiffness": 0.1, "damping.stretch": 0.2, "damping.twist": 0.3}
    scene = prepared(dlo_sim.load_scene({**FITTED, **read()[0].known, **damped}))
    assert scene.damping.internal == pytest.approx((0.0, 0.1, 0.4))


def test_a_begin_that_is_repeated_is_the_same(read):
    """Kept curves are told apart by all that they are made of."""
    one, other = read()
    scene = prepared(dlo_sim.load_scene({**FITTED, **one.known}))
    points = []
    for recording in (one, other, one):
        simulator = Simulator(scene, recording.ends_at(0))
        begin(simulator, recording, slice(2))
        points.append(simulator.control_points)
    assert np.array_equal(points[0], points[2])
    assert np.abs(points[0] - points[1]).max() > 0.1


@pytest.mark.parametrize(
    ("changes", "words"),
    [
        ({"attached_to": None}, "has no attached_to; it needs pos_um, rate_hz, clamped, branch"),
        ({"branch": None}, "has no branch; it needs"),
        ({"branch": [0] * 9 + [1] * 7}, r"branch: holds \[0.0, 1.0\] for 2 branches"),
        ({"branch": [0] * 16}, "branch: holds .* for 2 branches of attached_to; give each marker"),
        ({"branch": [0] * 9}, "branch: needs"),
        ({"attached_to": [0, 6]}, "attached_to: 0 is no marker between others .* give 1 to 7"),
        ({"attached_to": [3.5, 6]}, "attached_to: 3.5 is no marker between others"),
        ({"attached_to": [1, 6]}, "pos_um: branch a begins at marker 1, on a gripper; leave it"),
        ({"clamped": [3, -2, -1]}, "pos_um: branch a begins at marker 3, on a gripper; leave it"),
        ({"clamped": [8, -2, -1]}, r"clamped: \[8.0, -2.0, -1.0\]; give .*, or one marker amid"),
        ({"rate_hz": 0}, "rate_hz: 0 is out of range"),
    ],
)  # fmt: skip
def test_harnesses_that_cannot_be_are_refused_by_their_key(read, tmp_path, changes, words):
    with pytest.raises(MeasurementError, match=f"^{tmp_path / 'run.npz'}: {words}"):
        read(**changes)


recorded = pytest.mark.skipif(
    not PLACE.is_dir(),
    reason=f"no recordings in {PLACE}: set DLO_SIM_DATA to the folder that holds deft_bdlo",
)


@recorded
def test_recorded_harnesses_are_read():
    found = {}
    for path in sorted(PLACE.glob("*.npz")):
        pieces = read_recordings(path)
        known = pieces[0].known
        sizes = known["cable.length"], *(known[f"branches.{one}.cable.length"] for one in "ab")
        found[path.stem] = len(pieces), pieces[0].markers.shape[1], np.round(sizes, 2).tolist()
    assert found == {
        "BDLO1_calib": (12, 16, [0.91, 0.25, 0.19]),
        "BDLO1_mid_calib": (6, 17, [0.92, 0.25, 0.19]),
        "BDLO2_calib": (12, 16, [0.71, 0.24, 0.2]),
        "BDLO3_calib": (12, 13, [0.8, 0.15, 0.18]),
        "BDLO4_calib": (12, 12, [0.8, 0.15, 0.15]),
    }


@recorded
@pytest.mark.parametrize(
    ("cable", "most"), [("BDLO1", 0.85), ("BDLO2", 1.0), ("BDLO3", 0.8), ("BDLO4", 0.65)]
)
def test_fitted_scenes_predict_a_recorded_harness(cable, most):
    """Pieces to which they are not fitted."""
    scene = scene_for(cable, PLACE)
    pieces = read_recordings(PLACE / f"{cable}_calib.npz")[3:8:2]
    predicted = [predict(scene, piece) for piece in pieces]
    assert not any(one.failure for one in predicted)
    errors = [
        1e2 * score(piece, one.markers).l1 for piece, one in zip(pieces, predicted, strict=True)
    ]
    assert np.mean(errors) < most
