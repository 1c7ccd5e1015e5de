"""The state of a simulator: same bits in pieces and after restoring, resets, failures."""

import numpy as np
import pytest
from cables import FULL, FULLY_DAMPED, MOTIONS, SINE_LOAD, SOFT, scene_of, set_state, simulator
from test_contact import DAMPED, falling
from test_self_contact import thrown
from test_sliding import pulled
from test_symmetry import pressed

from dlo_sim.core.methods import METHODS
from dlo_sim.scene.description import Obstacle
from dlo_sim.simulation.report import Status
from dlo_sim.simulation.simulator import Simulator

LOAD = SINE_LOAD | {"loads.tip.position": 0.6}
CONSTANT = LOAD | {"loads.tip.signal": "constant"}
NAMES = list(METHODS)
CASES = [(name, FULL) for name in NAMES] + [("energy_momentum", FULLY_DAMPED)]
IDS = [*NAMES, "damped"]


def moving(method, scene, load=LOAD):
    sim = simulator(scene, load, n=6, method=method, step=3e-4)
    sim.set_motion("start", MOTIONS["start"])
    return sim


def everything(sim):
    """All that a caller can see, as one array of numbers to compare bit by bit."""
    u = np.linspace(0.0, 1.0, 9)
    parts = [
        [sim.time, sim.steps, sim.energy_error],
        sim.control_points,
        sim.velocities,
        sim.frames(u),
        *sim.end_pose("start"),
        *sim.reaction("start"),
        *sim.reaction("end"),
        list(vars(sim.energy()).values()),
    ]
    return np.concatenate([np.ravel(part) for part in parts])


def same(a, b):
    return np.array_equal(a, b)


@pytest.mark.parametrize(("method", "scene"), CASES, ids=IDS)
def test_pieces_give_the_same_bits(method, scene):
    """With a moved clamp, and a load and an end that change on the way."""
    whole, pieces = (moving(method, scene, CONSTANT) for _ in range(2))
    for sim, counts in ((whole, (200, 300)), (pieces, [1, 3, 7, 189, *100 * [3]])):
        for count in counts:
            assert sim.advance_steps(count).status.ok
            if sim.steps == 200:
                sim.set_load("tip", force=[0.2, 0.0, 0.1])
                sim.set_end("start", position=sim.end_pose("start")[0])
    assert whole.steps == pieces.steps == 500
    assert whole.energy().kinetic > 1e-3
    assert same(everything(whole), everything(pieces))


@pytest.mark.parametrize("method", NAMES)
def test_pieces_give_the_same_bits_with_a_swinging_load(method):
    """The time of a step's end must round as that of the next step's start: three steps a piece,
    which meets times that do not."""
    whole, pieces = moving(method, FULL), moving(method, FULL)
    whole.advance_steps(120)
    for _ in range(40):
        pieces.advance_steps(3)
    assert same(everything(whole), everything(pieces))


@pytest.mark.parametrize(("method", "scene"), CASES, ids=IDS)
def test_restoring_goes_on_with_the_same_bits(method, scene):
    sim = moving(method, scene)
    sim.advance_steps(123)
    saved, seen = sim.snapshot(), everything(sim)
    sim.advance_steps(77)
    sim.set_load("tip", force=[1.0, 0.0, 0.0])
    sim.set_end("start", orientation=[0.1, 0.2, 0.3, 0.9])
    sim.advance_steps(50)
    assert not same(everything(sim), seen)
    sim.restore(saved)
    assert same(everything(sim), seen)
    sim.advance_steps(77)
    other = moving(method, scene)
    other.advance_steps(200)
    assert same(sim.control_points, other.control_points)
    assert same(sim.velocities, other.velocities)
    assert sim.energy_error == other.energy_error


@pytest.mark.parametrize(("method", "scene"), CASES, ids=IDS)
def test_a_reset_starts_over_with_the_same_bits(method, scene):
    sim = moving(method, scene)
    sim.advance_steps(60)
    expected = everything(sim)
    sim.set_load("tip", force=[1.0, 0.0, 0.0])
    sim.advance(0.1)
    sim.reset()
    assert (sim.time, sim.steps) == (0.0, 0)
    assert same(sim.control_points, simulator(scene, LOAD, n=6, method=method).control_points)
    sim.set_motion("start", MOTIONS["start"])
    sim.advance_steps(60)
    assert same(everything(sim), expected)


@pytest.mark.parametrize(("method", "scene"), CASES, ids=IDS)
def test_looking_changes_nothing(method, scene):
    watched, alone = moving(method, scene), moving(method, scene)
    for _ in range(40):
        watched.advance_steps(3)
        everything(watched)
        watched.snapshot()
        alone.advance_steps(3)
    assert same(everything(watched), everything(alone))


EVENTFUL = {  # a simulator, the time before what happens [s], and its steps then
    "sticks to a table": (lambda: falling({"obstacles.table.friction": 0.5}, DAMPED), 0.4, 60),
    "strands collide": (lambda: thrown({"contact.friction": 0.4}), 0.0104, 20),
    "buckles": (lambda: pressed(3.0), 0.0, 60),
    "slides in a guide": (lambda: pulled(0.9, 0.05), 0.0, 40),
}


@pytest.mark.parametrize("name", EVENTFUL)
def test_contact_slides_and_buckling_go_on_with_the_same_bits(name):
    """In pieces and after restoring; friction and pushes are not told by the present shape."""
    make, begin, steps = EVENTFUL[name]
    whole, pieces = make(), make()
    for sim in (whole, pieces):
        sim.advance(begin)
    kept, moved = pieces.snapshot(), whole.control_points
    whole.advance_steps(steps)
    for part in (1, 6, steps - 7):
        pieces.advance_steps(part)
    assert same(pieces.cable.state, whole.cable.state)
    assert np.abs(whole.control_points - moved).max() > 0.0
    pieces.restore(kept)
    pieces.advance_steps(steps)
    assert same(pieces.cable.state, whole.cable.state)


def test_what_came_in_on_the_way_leaves_again_with_a_restore():
    """A taut cable without drive, which nothing leads out of its plane until it may touch."""
    plane = SOFT | {"loads.names": [], "start.clamped": False, "end.fixed": [True] * 3}
    sim = simulator(plane, n=6, method="energy_momentum", step=1e-3)
    assert "out_of_plane" in sim.left_out
    sim.advance_steps(20)
    saved, seen = sim.snapshot(), sim.control_points
    for jump in ({"position": [0.0, 0.01, 0.0]}, {"position": [0.0, 0.0, np.nan]}):
        with pytest.raises(ValueError):
            sim.set_end("start", **jump)
    with pytest.raises(ValueError, match="terms.out_of_plane: auto .* set it to on"):
        sim.set_end("start", position=[0.0, 0.01, 0.0])
    assert sim.end_pose("start")[0].tolist() == [0.0, 0.0, 0.0]
    sim.add_obstacles([Obstacle("far", "sphere", position=(0.0, 0.0, 9.0))])
    assert "out_of_plane" not in sim.left_out
    assert same(sim.control_points[2:], seen[2:])
    sim.set_end("start", position=[0.0, 0.01, 0.0])
    sim.advance_steps(20)
    assert abs(sim.control_points[1, 1]) > 1e-3
    sim.restore(saved)
    assert "out_of_plane" in sim.left_out
    sim.advance_steps(20)
    other = simulator(plane, n=6, method="energy_momentum", step=1e-3)
    other.advance_steps(40)
    assert same(sim.control_points, other.control_points)


def test_advance_makes_whole_steps_and_carries_the_rest():
    sim = simulator(SOFT, n=6, method="velocity_verlet", step=2e-4)
    made = []
    for _ in range(10):
        report = sim.advance(0.00035)
        made.append(report.steps)
        assert report.simulated == pytest.approx(report.steps * 2e-4)
    assert sum(made) == 17  # 3.5 ms
    assert set(made) == {1, 2}
    assert sim.time == 17 * 2e-4
    # Rounding costs no step: 0.6 ms are three steps although 0.6e-3 / 2e-4 is less than 3.
    assert simulator(SOFT, n=6, method="velocity_verlet", step=2e-4).advance(6e-4).steps == 3


def test_a_diverging_run_keeps_all_that_was_good():
    """In one call as in many: a long call does not take back what came before the failure."""
    limit = simulator(SOFT, n=6, method="velocity_verlet").choice.limit
    scene = scene_of(SOFT, n=6, method="velocity_verlet", step=1.01 * limit)
    whole, pieces = (Simulator(scene, unchecked_step=True) for _ in range(2))
    report = whole.advance_steps(4000)
    while pieces.advance_steps(16).status.ok:
        pass
    assert report.status is Status.DIVERGED
    assert report.steps == whole.steps == pieces.steps > 30
    assert same(everything(whole), everything(pieces))


def test_a_step_that_gains_energy_is_refused():
    """An end effector that jumps, at a step that the midpoint rule cannot bear for that."""
    sim = simulator(
        SOFT, {"cable.axial_stiffness": 1e4}, n=8, method="implicit_midpoint", step=5e-3
    )
    sim.advance_steps(10)
    sim.set_end("start", position=[0.01, 0.0, 0.01])
    report = sim.advance_steps(20)
    assert report.status is Status.DIVERGED and "use a smaller integrator.step" in report.message
    assert report.steps < 20


def test_a_step_that_turns_the_cable_over_is_done_in_smaller_ones():
    """Pushed together by 30 N: Newton's method may find a fold that the motion does not go to."""
    push = {"loads.tip.signal": "constant", "loads.tip.force": [-30.0, 0.0, 3.0]}
    ends = []
    for step in (2.5e-5, 1e-2):
        sim = simulator(SOFT, push, n=12, method="energy_momentum", step=step)
        assert sim.advance(0.03).status.ok
        ends.append(sim.control_points[:, :3])
    assert np.abs(ends[1] - ends[0]).max() < 0.1  # m; 0.18 m without


def test_a_step_that_cannot_be_solved_keeps_the_state():
    """A load of 1e80 N: Newton's method fails however short the step."""
    sim = simulator(SOFT, n=6, method="energy_momentum", step=1e-2)
    sim.advance_steps(10)
    before = sim.control_points, sim.velocities
    sim.set_load("tip", force=[0.0, 0.0, 1e80])
    report = sim.advance_steps(3)
    assert report.status is Status.NOT_CONVERGED
    assert "(at 0.1 s, u = 1 m; method energy_momentum, step 0.01 s)" in report.message
    assert (report.steps, report.simulated, sim.steps) == (0, 0.0, 10)
    assert same(sim.control_points, before[0])
    assert same(sim.velocities, before[1])
    sim.set_load("tip", force=[0.0, 0.0, 0.0])
    assert sim.advance_steps(3).status.ok


def test_a_step_that_is_solved_in_part_keeps_the_state_before_it(monkeypatch):
    monkeypatch.setattr("dlo_sim.methods.implicit.MAX_HALVINGS", 1)
    values = {"loads.tip.signal": "sine", "terms.out_of_plane": "on"}
    force = {"loads.tip.force": [0.0, 0.0, 10**0.25]}
    sim = simulator(SOFT, values, force, n=12, method="energy_momentum", step=0.1)
    report = sim.advance_steps(0)
    while report.status.ok:
        before = sim.control_points
        report = sim.advance_steps(1)
        assert sim.steps < 20
    assert report.steps == 0
    assert same(sim.control_points, before)


def test_fields_of_the_state_are_copies():
    sim = simulator(SOFT, n=6, method="velocity_verlet")
    sim.control_points[:] = 7.0
    sim.velocities[:] = 7.0
    sim.greville[:] = 7.0
    assert sim.control_points[0, 0] == 0.0
    assert not sim.velocities.any()
    assert sim.greville[-1] == pytest.approx(1.0)


def test_velocities_are_those_that_were_set():
    sim = simulator(SOFT, n=6, method="velocity_verlet")
    rates = np.random.default_rng(0).normal(size=(6, 4)) * [1, 1, 1, 0]
    rates[:2] = 0.0
    set_state(sim, rates=rates)
    assert same(sim.velocities, rates)
