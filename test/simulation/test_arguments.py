"""What is no argument of a simulator: refused in one line that names it, without a trace."""

import re

import numpy as np
import pytest
from cables import SOFT, simulator

from dlo_sim import EndMotion, Simulator
from dlo_sim.simulation.recorder import Recorder
from dlo_sim.simulation.running import Running

NAN, INF = float("nan"), float("inf")
EMPTY, NEGATIVE, HUGE = {}, -1.5, 1e300
STILL = [0.0, 0.0, 0.0, 1.0]
# No number, vector, name, mapping or simulator of any shape that is asked for anywhere.
WRONG = [None, True, "up", "", "start\nend", b"\0\1", object(), Simulator, len, slice(3)]
WRONG += [NAN, INF, NEGATIVE, HUGE, 1j, 10**400, np.datetime64("2020-01-01"), iter([1.0])]
WRONG += [EMPTY, {"start": 1}, {1, 2}, [[1.0, 2.0], [3.0]], [1.0, "2", 3.0], ["a"] * 3, [None] * 3]
WRONG += [[NAN] * 3, [INF] * 4, [[[]]], np.zeros((0, 3)), np.full((6, 4), NAN), np.array(["x"])]
POINTS = np.linspace([0.0, 0.0, 0.0], [0.0, 0.0, 0.1], 5)


def end_motion(**changes):
    given = {"start": 0.0, "duration": 1.0, "position": [0, 0, 0], "orientation": STILL}
    return EndMotion(**(given | changes))


# Method -> its arguments: how it is given, how a refusal names it, and what of WRONG is none.
CALLS = {
    "__init__": [
        (lambda sim, x: Simulator(x), "scene", ()),
        (lambda sim, x: Simulator(sim.scene, x), "end", (None, EMPTY)),
        (lambda sim, x: Simulator(sim.scene, {"start": x}), "end_poses['start']", ()),
        (lambda sim, x: Simulator(sim.scene, {"end": (x, STILL)}), "end_poses['end'] position", ()),
        (lambda sim, x: Simulator(sim.scene, {"end": ([0, 0, 1], x)}), "end_poses['end'] quat", ()),
    ],
    "advance": [(lambda sim, x: sim.advance(x), "duration", ())],
    "advance_steps": [
        (lambda sim, x: sim.advance_steps(x), "steps", ()),
        (lambda sim, x: sim.advance_steps(1, x), "recorder", (None,)),
    ],
    "set_load": [
        (lambda sim, x: sim.set_load(x, [0, 0, 1]), "load", ()),
        (lambda sim, x: sim.set_load("tip", x), "force of tip", (None,)),
        (lambda sim, x: sim.set_load("tip", [0, 0, 1], x), "torque of tip", (None,)),
    ],
    "set_end": [
        (lambda sim, x: sim.set_end(x, [0, 0, 1]), "end", ()),
        (lambda sim, x: sim.set_end("start", x), "position of start", (None,)),
        (lambda sim, x: sim.set_end("start", [0, 0, 1], x), "orientation of start", (None,)),
        (lambda sim, x: sim.set_end("end", tangent=x), "tangent of end", (None,)),
    ],
    "set_motion": [
        (lambda sim, x: sim.set_motion(x, EndMotion.resting([0, 0, 0], start=sim.time)), "end", ()),
        (lambda sim, x: sim.set_motion("start", x), "motion", ()),
        (lambda sim, x: EndMotion.resting(x), "end motion: position", ()),
        (lambda sim, x: EndMotion.resting([0, 0, 0], x), "end motion: orientation", ()),
        (lambda sim, x: end_motion(start=x), "end motion: start", (NEGATIVE, HUGE)),
        (lambda sim, x: end_motion(duration=x), "end motion: duration", (HUGE,)),
        (lambda sim, x: end_motion(position=x), "end motion: position", ()),
        (lambda sim, x: end_motion(orientation=x), "end motion: orientation", ()),
        (lambda sim, x: end_motion(velocity=x), "end motion: velocity", ()),
        (lambda sim, x: end_motion(acceleration=x), "end motion: acceleration", ()),
        (lambda sim, x: end_motion(angular_velocity=x), "end motion: angular_velocity", ()),
        (lambda sim, x: end_motion(angular_acceleration=x), "end motion: angular_acceleration", ()),
    ],
    "resumed": [(lambda sim, x: sim.resumed(x), "snapshot", ())],
    "restore": [(lambda sim, x: sim.restore(x), "snapshot", ())],
    "start_from": [
        (lambda sim, x: sim.start_from(x), "control points", ()),
        (lambda sim, x: sim.start_from(sim.control_points, x), "velocities", (None,)),
    ],
    "start_from_points": [
        (lambda sim, x: sim.start_from_points(x), "points", ()),
        (lambda sim, x: sim.start_from_points(POINTS, x), "times", (None,)),
        (lambda sim, x: sim.start_from_points(POINTS, None, x), "coordinates", (None, EMPTY)),
    ],
    "reconfigured": [(lambda sim, x: sim.reconfigured(x), "scene", ())],
    "record_along": [(lambda sim, x: sim.record_along(x, {}, [0.1]), "times", ())],
    "forecast": [(lambda sim, x: sim.forecast(x), "plan", ())],
    "correct": [
        (lambda sim, x: sim.correct(x, np.zeros((6, 3))), "shift", ()),
        (lambda sim, x: sim.correct(np.zeros((6, 3)), x), "speed", ()),
    ],
    "follow": [
        (lambda sim, x: sim.follow(x, {}, [0.1]), "times", ()),
        (lambda sim, x: sim.follow([0.0, 0.1], {"start": x}, [0.1]), "poses of start", ()),
    ],
    "take": [
        (lambda sim, x: sim.take(x), "grasp", ()),
        (lambda sim, x: sim.take("hand", x), "at", (None,)),
    ],
    "check_take": [(lambda sim, x: sim.check_take(x), "grasp", ())],
    "release": [(lambda sim, x: sim.release(x), "grasp", ())],
    "take_over": [(lambda sim, x: sim.take_over(x), "other", ())],
    "centerline": [(lambda sim, x: sim.centerline(x), "u", ())],
    "tension": [(lambda sim, x: sim.tension(x), "u", ())],
    "curvature": [(lambda sim, x: sim.curvature(x), "u", ())],
    "frames": [(lambda sim, x: sim.frames(x), "u", ())],
    "strand": [(lambda sim, x: sim.strand(x), "strand", ())],
    "connector_pose": [(lambda sim, x: sim.connector_pose(x), "connector", ())],
    "control_poses": [(lambda sim, x: sim.control_poses(x), "out", ())],
    "end_pose": [(lambda sim, x: sim.end_pose(x), "end", ())],
    "set_obstacle": [
        (lambda sim, x: sim.set_obstacle(x, [0.0, 0.0, 0.0]), "obstacle", ()),
        (lambda sim, x: sim.set_obstacle("floor", x), "end motion: position", ()),
    ],
    "move_obstacle": [(lambda sim, x: sim.move_obstacle(x, end_motion()), "obstacle", ())],
    "add_obstacles": [(lambda sim, x: sim.add_obstacles([x]), "obstacle", ())],
    "remove_obstacles": [(lambda sim, x: sim.remove_obstacles([x]), "obstacle", ())],
    "surface": [(lambda sim, x: sim.surface(x), "obstacle", ())],
    "held_at": [(lambda sim, x: sim.held_at(x), "grasp", ())],
    "contact": [(lambda sim, x: sim.contact(x), "obstacle", ())],
    "reaction": [(lambda sim, x: sim.reaction(x), "end", ())],
    "reaction_wrench": [(lambda sim, x: sim.reaction_wrench(x), "end", ())],
}
WITHOUT_ARGUMENTS = {"energy", "reset", "snapshot"}
# for other rooms of the package
CHECKED_BEFORE = {"check_obstacle", "replace_added", "warnings_with"}


def with_a_hand():
    values = {"grasps.names": ["hand"], "grasps.hand.taken": False, "terms.out_of_plane": "on"}
    return simulator(SOFT, values, n=6, method="energy_momentum", step=5e-4)


@pytest.fixture(scope="module")
def moving():
    sim = with_a_hand()
    assert sim.advance_steps(20).status.ok
    return sim


def everything(sim):
    poses = [np.concatenate(sim.end_pose(end)) for end in ("start", "end")]
    arrays = (sim.cable.state, sim.cable.inputs, *poses)
    return sim.time, sim.active_terms, [array.tobytes() for array in arrays]


@pytest.mark.parametrize("method", CALLS)
def test_wrong_arguments_are_refused_without_a_trace(method, moving):
    before = everything(moving)
    for call, name, meant in CALLS[method]:
        for value in WRONG:
            if any(value is each for each in meant):
                continue
            with pytest.raises((TypeError, ValueError)) as caught:
                call(moving, value)
            message = str(caught.value)
            case = f"{name} = {value!r}: {message}"
            assert message.startswith(name), case
            assert re.search("needs|give|\\[0, ", message), case
            assert "\n" not in message and len(message) < 200, case
            assert everything(moving) == before, case


def test_no_method_is_left_out():
    """`Running` has more, which only rooms of the package call."""
    methods = {name for name, one in vars(Simulator).items() if callable(one)}
    methods |= {name for name, one in vars(Simulator).items() if isinstance(one, classmethod)}
    public = {name for name in methods if not name.startswith("_")} | {"__init__"}
    known = set(CALLS) | WITHOUT_ARGUMENTS | CHECKED_BEFORE
    assert public <= known
    assert known - public == {name for name in known if hasattr(Running, name)} - {"__init__"}


def test_arrays_that_compiled_functions_write_are_of_the_model(moving):
    before = everything(moving)
    other = simulator(SOFT, n=7, method="velocity_verlet")
    for call in (
        lambda: moving.advance_steps(1, Recorder(other.model, np.zeros(1))),
        lambda: moving.control_poses(np.zeros((6, 7), dtype=np.float32)),
        lambda: moving.control_poses(np.zeros((7, 6)).T),
        lambda: moving.control_poses(np.broadcast_to(np.zeros(7), (6, 7))),
    ):
        with pytest.raises(
            (TypeError, ValueError), match=r"recorder: is of another|out: needs np.empty"
        ):
            call()
    assert everything(moving) == before


def test_numbers_of_any_kind_are_taken(moving):
    moving.set_load("tip", force=np.array([0, 1, 0], dtype=np.int8), torque=(0, 0, np.float32(0)))
    moving.set_end("end", position=range(3))
    assert moving.advance(np.float64(0.0)).steps == moving.advance_steps(np.int64(0)).steps == 0
    assert moving.centerline(np.array([0, 1])).shape == (2, 3)
    assert moving.centerline([]).shape == (0, 3)


# ------------------------------------------------------------------------- motions, first states


def path(sim, way=(0.0, 0.0, 0.0), turn=0.0, start=None):
    """A motion from so far beside the start's pose."""
    position, orientation = sim.end_pose("start")
    turned = orientation + np.array([np.sin(turn / 2), 0.0, 0.0, np.cos(turn / 2) - 1.0])
    return EndMotion(
        start=sim.time if start is None else start,
        duration=0.1,
        position=position + way,
        orientation=turned,
        velocity=[0.1, 0.0, 0.0],
    )


@pytest.mark.parametrize(
    ("wrong", "cure"),
    [
        ({"way": (5.0, 0.0, 0.0)}, r"starts 5 m and 0 rad away .* start it at end_pose\('start'\)"),
        ({"way": (0.0, 1e-4, 0.0)}, "or put the end there with set_end before"),
        ({"turn": 0.1}, r"starts 0 m and 0\.1 rad away"),
        ({"way": (5.0, 0.0, 0.0), "start": 2.0}, "starts 5 m"),
        ({"start": 0.0}, r"starts at 0.0 s, before the present; start it at the .* time, 0.01 s"),
    ],
)
def test_a_motion_begins_now_and_where_the_end_is(wrong, cure):
    sim = with_a_hand()
    sim.advance_steps(20)
    before = everything(sim)
    with pytest.raises(ValueError, match=cure):
        sim.set_motion("start", path(sim, **wrong))
    assert everything(sim) == before
    sim.set_motion("start", path(sim))
    assert sim.advance_steps(20).status.ok
    assert sim.end_pose("start")[0][0] == pytest.approx(1e-3)


def test_a_motion_may_be_up_to_a_step_late_and_follow_another():
    """As where a step does not divide the times between motions."""
    sim = with_a_hand()
    first = path(sim)
    sim.set_motion("start", first)
    sim.advance_steps(201)
    sim.set_motion("start", first.then(0.1, velocity=[0.0, 0.2, 0.0]))
    assert sim.end_pose("start")[0] == pytest.approx([0.01, 1e-4, 0.0])
    sim.advance_steps(1)
    assert sim.control_points[0, :3] == pytest.approx([0.01, 2e-4, 0.0])


def test_a_start_that_moves_held_points_warns(recwarn):
    sim = with_a_hand()
    points = sim.control_points
    points[3, 2] += 0.01
    sim.start_from(points)
    assert not recwarn
    points[:, 2] += 0.02
    with pytest.warns(UserWarning, match=r"held poses by 0\.02 m \(or rad\) and were moved back"):
        sim.start_from(points)
    assert sim.control_points[0, 2] == 0.0 and sim.control_points[3, 2] == pytest.approx(0.03)
