"""A cable started from measured points: noise, gaps, spikes, velocities, found coordinates."""

import numpy as np
import pytest

import dlo_sim

SCENE = {
    "cable.length": 1.0,
    "cable.diameter": 0.006,
    "start.clamped": True,
    "start.tangent": [0.0, 0.0, -1.0],
    "end.position": [0.5, 0.0, 0.0],
    "end.fixed": [True, True, True],
    "end.clamped": True,
    "end.tangent": [0.0, 0.0, 1.0],
    "terms.out_of_plane": "on",
    "discretization.control_points": 17,
    "discretization.stretch": "span",
    "integrator.method": "energy_momentum",
    "integrator.step": 0.01,
}
U = np.linspace(0.08, 0.92, 12)
LINE = np.linspace([0.0, 0.0, 0.0], [0.5, 0.0, -0.1], 4)


@pytest.fixture(scope="module")
def swinging():
    """A cable in motion with its points, velocities there, and points a few frames on."""
    sim = dlo_sim.Simulator(dlo_sim.load_scene(SCENE))
    points = sim.control_points
    rates = np.zeros_like(points)
    rates[:, 1] = 1.5 * np.sin(np.pi * sim.greville) ** 2
    sim.start_from(points, rates)
    frames, times = [], []
    for _ in range(6):
        frames.append(sim.centerline(U))
        times.append(sim.time)
        assert sim.advance_steps(1).status.ok
    return np.array(frames), np.array(times), 1.5 * np.sin(np.pi * U) ** 2


def started(points, times=None, coordinates=None, **changes):
    sim = dlo_sim.Simulator(dlo_sim.load_scene(SCENE, changes))
    sim.start_from_points(points, times, coordinates)
    return sim


def lengthened(sim):
    line = sim.centerline(np.linspace(0.0, 1.0, 2001))
    return np.linalg.norm(np.diff(line, axis=0), axis=1).sum() - 1.0


def test_markers_at_known_coordinates(swinging):
    frames, _, _ = swinging
    sim = started(frames[0], coordinates=U)
    assert np.abs(sim.centerline(U) - frames[0]).max() < 2e-3
    assert abs(lengthened(sim)) < 2e-3
    assert not sim.velocities.any()
    position, _ = sim.end_pose("end")
    assert np.abs(sim.control_points[-1, :3] - position).max() < 1e-12
    below = sim.control_points[0, :3] - sim.control_points[1, :3]
    assert below[2] > 0.0
    assert np.abs(below[:2]).max() < 1e-12


def test_velocities_of_several_frames(swinging):
    frames, times, speed = swinging
    sim = started(frames, times, U)
    moved = sim.centerline(U)
    assert sim.advance_steps(1).status.ok
    measured = (sim.centerline(U) - moved) / sim.step
    assert np.abs(measured[:, 1] - speed).max() < 0.15
    assert np.abs(measured[:, [0, 2]]).max() < 0.15


def test_the_state_is_that_of_time_zero(swinging):
    frames, times, _ = swinging
    sim = started(frames, times - times[-1], U)
    assert np.abs(sim.centerline(U) - frames[-1]).max() < 3e-3


def test_found_coordinates_missing_points_and_too_many(swinging):
    frames, _, _ = swinging
    dense = started(frames[0], coordinates=U).centerline(np.linspace(0.01, 0.99, 150))
    noisy = dense + np.random.default_rng(1).normal(0.0, 1e-3, dense.shape)
    sim = started(noisy)
    assert np.abs(sim.centerline(U) - frames[0]).max() < 8e-3
    gaps = frames[0].copy()
    gaps[[3, 7]] = np.nan
    sim = started(gaps, coordinates=U)
    assert np.abs(sim.centerline(U) - frames[0]).max() < 1e-2


@pytest.mark.parametrize("marker", [3, 6, 9])
def test_a_spike_is_left_out(swinging, marker):
    frames, _, _ = swinging
    spoiled = frames[0].copy()
    spoiled[marker] += [0.0, 0.09, 0.0]
    clean, sim = started(frames[0], coordinates=U), started(spoiled, coordinates=U)
    assert np.abs(sim.centerline(U) - clean.centerline(U)).max() < 6e-3


def test_a_cable_with_a_free_end_starts_from_points(swinging):
    hanging = {"end.fixed": [False] * 3, "end.clamped": False, "end.position": [0.0, 0.0, -1.0]}
    angle = 0.8 * U
    points = np.stack([np.sin(angle) ** 2, np.zeros(12), -np.sin(angle) * np.cos(angle)], 1) / 0.8
    sim = started(points, coordinates=U, **hanging)
    assert np.abs(sim.centerline(U) - points).max() < 3e-3
    assert abs(lengthened(sim)) < 2e-3


@pytest.mark.parametrize(
    ("arguments", "words"),
    [
        ((np.zeros((4, 2)),), "points: shape"),
        ((np.full((4, 3), np.nan),), "0 of 4 are known"),
        ((np.zeros((2, 4, 3)), [0.0]), "times: 1 for 2 frames"),
        ((np.eye(4, 3), None, [0.1, 0.2, 0.3, 1.3]), "leave the cable"),
        ((np.eye(4, 3), None, [0.1, 0.2]), "coordinates"),
        ((np.ones((4, 3)),), "points: lie 0 m from their middle .* give points along it"),
        ((1e3 * LINE,), "points: lie .* m from their middle .* give points along it"),
        (([LINE, LINE], [0.0, -0.01]), "times: .* do not rise by 1e-06 s or more; give"),
        (([LINE, LINE], [0.0, 0.0]), "times: .* do not rise by 1e-06 s or more; give"),
        (([LINE, LINE], [0.0, 1e-12]), "times: .* do not rise by 1e-06 s or more; give"),
        ((LINE, None, [0.9, 0.6, 0.3, 0.1]), "coordinates: .* do not rise; give the points"),
        ((LINE, None, [0.1, 0.1, 0.3, 0.4]), "coordinates: .* do not rise; give the points"),
    ],
)
def test_refusals_name_the_argument_and_change_nothing(arguments, words):
    sim = dlo_sim.Simulator(dlo_sim.load_scene(SCENE))
    before = sim.control_points
    with pytest.raises(ValueError, match=words):
        sim.start_from_points(*arguments)
    assert np.array_equal(sim.control_points, before)


@pytest.mark.parametrize("kept", [[0, 1, 2, 4, 5, 6], [0, 6], [1, 3]])
def test_points_in_the_plane_start_a_planar_scene(kept):
    flat = {"terms.out_of_plane": "off", "terms.twist": "off"}
    u = np.linspace(0.0, 1.0, 7)
    points = np.stack([0.5 * u, 0.0 * u, -0.3 * np.sin(np.pi * u)], axis=1)
    given = np.full_like(points, np.nan)
    given[kept] = points[kept]
    sim = started(given, **flat)
    assert not sim.control_points[:, 1].any()
    with pytest.raises(ValueError, match="control points: leave the coordinates"):
        started(given + [0.0, 1e-3, 0.0], **flat)


def test_points_that_are_too_near_each_other_do_not_shorten_the_cable(swinging):
    frames, _, _ = swinging
    near = frames[0] * [1.0, 1.0, 0.96]
    # Without the length term 0.026.
    assert abs(lengthened(started(near, coordinates=U))) < 0.016


@pytest.mark.filterwarnings("error")  # nothing has to be moved back
@pytest.mark.parametrize("clamped", [False, True], ids=["position", "direction"])
def test_a_grasp_holds_the_cable_where_it_is(swinging, clamped):
    """Though the markers say that the cable is 4 mm beside it and points elsewhere."""
    frames, times, _ = swinging
    here = 0.5 * (frames[0][5] + frames[0][6]) + [0.0, 0.004, 0.0]
    hand = {"position": here.tolist(), "at": 0.5, "clamped": clamped, "tangent": [0.9, 0.1, 0.1]}
    changes = {"grasps.names": ["hand"], **{f"grasps.hand.{k}": v for k, v in hand.items()}}
    sim = started(frames, times, U, **changes)
    assert sim.centerline([0.5])[0] == pytest.approx(here, abs=1e-9)
    assert np.abs(sim.centerline(U) - frames[0]).max() < 8e-3
    edge = np.diff(sim.centerline([0.5 - 1e-5, 0.5 + 1e-5]), axis=0)[0]
    across = np.linalg.norm(np.cross(edge, [0.9, 0.1, 0.1])) / np.linalg.norm(edge)
    assert across < 1e-4 if clamped else across > 0.01
    before = sim.control_points
    assert sim.advance_steps(1).status.ok
    assert sim.centerline([0.5])[0] == pytest.approx(here, abs=1e-9)
    assert np.abs(sim.control_points - before)[:, :3].max() < 0.03
