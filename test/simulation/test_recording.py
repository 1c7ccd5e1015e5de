"""`record`: samples at exact times, numbers about the run, and what is left of a failed one."""

import dataclasses
import json
from types import SimpleNamespace

import numpy as np
import pytest
from cables import merged

from dlo_sim.core import bspline
from dlo_sim.scene.description import Scene
from dlo_sim.scene.loading import load_scene
from dlo_sim.simulation import recording
from dlo_sim.simulation.recording import record
from dlo_sim.simulation.simulator import Simulator


def wire(**changes: object) -> Scene:
    """The paper's wire, implicit at 2 ms unless told otherwise."""
    return load_scene("paper_wire", merged(**{"method": "energy_momentum", "step": 2e-3} | changes))


def states(scene: Scene, steps: int) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Control points, their velocities and the energy after 0, 1, ..., `steps` single steps."""
    simulator = Simulator(scene)
    points, rates = [simulator.control_points], [simulator.velocities]
    energies = [simulator.energy().total]
    for _ in range(steps):
        simulator.advance_steps(1)
        points.append(simulator.control_points)
        rates.append(simulator.velocities)
        energies.append(simulator.energy().total)
    return np.array(points), np.array(rates), np.array(energies)


@pytest.fixture(scope="module")
def swinging() -> recording.Recording:
    """0.1 s of the wire: 50 steps of 2 ms, a sample every 0.5 ms."""
    return record(wire(), 0.1, 5e-4)


def test_the_first_sample_is_the_start_of_a_cable_that_is_not_level():
    """In the plane a state's rows are x and z; the sample at the start once had y for z."""
    scene = wire().with_values({"start.position": [0.0, 0.0, 0.5], "end.position": [2.0, 0.0, 0.5]})
    made = record(scene, 0.01, 2e-3)
    assert len(made.control_points[0]) == 9
    assert np.array_equal(made.control_points[0], Simulator(scene).control_points)
    assert made.control_points[0, :, 2] == pytest.approx(np.full(9, 0.5), abs=1e-12)


def test_samples_are_at_exact_multiples(swinging):
    assert swinging.time.tolist() == [k * 5e-4 for k in range(201)]
    assert swinging.control_points.shape == (201, 9, 4)
    assert swinging.centerline.shape == (201, 50, 3)
    assert swinging.energy.shape == (201,)
    np.testing.assert_allclose(swinging.centerline_u, np.linspace(0.0, 2.0, 50), atol=1e-15)


def test_samples_are_the_states_and_the_cubic_between_them(swinging):
    points, rates, energies = states(wire(), 50)
    assert np.ptp(points[:, 4, 2]) > 0.01, "the wire must have moved"
    np.testing.assert_array_equal(swinging.control_points[::4], points)
    np.testing.assert_allclose(swinging.energy[::4], energies, rtol=0, atol=1e-12)
    for s in (0.25, 0.5, 0.75):
        tau = 2e-3
        cubic = (1 + 2 * s) * (1 - s) ** 2 * points[:-1] + s * (1 - s) ** 2 * tau * rates[:-1]
        cubic += s**2 * (3 - 2 * s) * points[1:] + s**2 * (s - 1) * tau * rates[1:]
        inside = swinging.control_points[int(4 * s) :: 4]
        np.testing.assert_allclose(inside, cubic, rtol=0, atol=1e-14)


def test_energy_between_two_states_is_between_theirs():
    force: dict[str, object] = {"loads__names": ["pull"], "loads__pull__type": "force"}
    force |= {"loads__pull__signal": "constant", "loads__pull__force": [0.0, 5.0, 0.0]}
    force |= {"loads__pull__position": 0.5}
    # High up, so that the energy in the field of gravity does not begin at zero.
    scene = wire(**force, start__position=[0.0, 0.0, 1.0], end__position=[2.0, 0.0, 1.0])
    run = record(scene, 0.02, 5e-4)
    _, _, energies = states(scene, 10)
    assert energies[0] > 0.1
    assert energies[-1] - energies[0] > 1e-3, "the load must do work"
    expected = np.interp(run.time, 2e-3 * np.arange(11), energies)
    np.testing.assert_allclose(run.energy, expected, rtol=0, atol=1e-12)


def test_centerline_is_the_spline_of_the_control_points(swinging):
    knots = bspline.clamped_knots(9, 2.0)
    for k in (0, 100, 200):
        line = bspline.evaluate(swinging.control_points[k, :, :3], knots, swinging.centerline_u)
        np.testing.assert_allclose(swinging.centerline[k], line, rtol=0, atol=1e-14)


def test_whole_steps_cover_a_duration_that_they_do_not_divide():
    run = record(wire(), 0.0093, 1e-3)
    assert run.steps == 5
    assert run.simulated_s == 5 * 2e-3
    assert run.time.tolist() == [k * 1e-3 for k in range(10)]
    assert np.abs(run.control_points[-1]).sum() > 0.0, "the last sample was taken"


def test_report_agrees_with_the_simulator(swinging):
    simulator = Simulator(wire())
    report = simulator.advance_steps(50)
    assert (swinging.status, swinging.message, swinging.ok) == ("ok", "", True)
    assert (swinging.steps, swinging.step_s, swinging.simulated_s) == (50, 2e-3, 50 * 2e-3)
    assert swinging.method == "energy_momentum"
    assert swinging.force_evaluations == report.force_evaluations > 50
    assert swinging.energy_error_max == pytest.approx(simulator.energy_error, rel=0.5)
    assert swinging.active_terms == simulator.active_terms
    assert swinging.left_out == simulator.left_out
    assert swinging.real_time_factor == swinging.simulated_s / swinging.wall_s


def test_tension_and_curvature_are_those_of_the_simulator(swinging):
    simulator = Simulator(wire())
    simulator.advance_steps(50)
    u = swinging.centerline_u
    np.testing.assert_allclose(swinging.tension[-1], simulator.tension(u), rtol=1e-9, atol=1e-9)
    np.testing.assert_allclose(swinging.curvature[-1], simulator.curvature(u), rtol=1e-9)


def test_report_is_json(swinging):
    values = dataclasses.asdict(swinging).items()
    report = {k: v for k, v in values if not isinstance(v, np.ndarray)}
    assert json.loads(json.dumps(report, allow_nan=False))["steps"] == 50


def test_recording_and_progress_change_nothing(swinging):
    fractions: list[float] = []
    scene = wire(step=1e-4)
    run = record(scene, 0.1, 1e-2, progress=fractions.append)
    assert len(fractions) > 2, "more than one piece"
    assert fractions == sorted(set(fractions)) and fractions[-1] == 1.0
    simulator = Simulator(scene)
    simulator.advance_steps(1000)
    np.testing.assert_array_equal(run.control_points[-1], simulator.control_points)


def test_failed_run_keeps_what_was_good():
    scene = wire(method="implicit_midpoint", step=2e-2)
    run = record(scene, 4.0, 1e-3)
    assert (run.status, run.ok) == ("diverged", False)
    assert "the last good state is kept" in run.message and "\n" not in run.message
    assert 0.0 < run.simulated_s < 4.0
    assert run.simulated_s == run.steps * 2e-2
    assert run.time[-1] == pytest.approx(run.simulated_s, abs=1e-3)
    assert run.time[-1] <= run.simulated_s + 1e-9
    assert len(run.time) == len(run.control_points) == len(run.centerline) == len(run.energy)
    assert np.isfinite(run.control_points).all() and np.isfinite(run.energy).all()
    again = record(scene, 4.0, 1e-3)
    np.testing.assert_array_equal(again.control_points, run.control_points)
    simulator = Simulator(scene)
    simulator.advance_steps(run.steps)
    np.testing.assert_array_equal(run.control_points[-1], simulator.control_points)


HEAVY = {"gravity": [0.0, 0.0, -10000.0], "step": 1e-2}  # [m/s^2], [s]


def test_a_run_of_far_too_many_newton_iterations_says_so(swinging):
    assert swinging.notes == ()
    made = record(wire(**HEAVY), 0.2, 1e-2)
    (note,) = made.notes
    mean = made.force_evaluations / made.steps
    assert made.ok and mean > 20.0
    assert f"in 20 of 20 steps Newton's method took {mean:.0f} iterations per step" in note
    assert "integrator.step 0.01 s" in note
    report = Simulator(wire(**HEAVY)).advance_steps(20)
    assert report.status.ok and f"{mean:.0f} iterations" in report.note


@pytest.mark.parametrize("cost", [1e-5, 0.03, 1.0])
def test_a_run_looks_up_in_time_whatever_a_step_takes(monkeypatch, cost):
    """By a clock that is made up: `cost` [s] is the time of a step."""
    now, looks, told = 0.0, [], []
    simulator = Simulator(wire(step=1e-4))
    advance = simulator.advance_steps

    def advance_steps(steps, recorder=None):
        nonlocal now
        now += cost * steps
        return advance(steps, recorder)

    monkeypatch.setattr(simulator, "advance_steps", advance_steps)
    monkeypatch.setattr(recording, "time", SimpleNamespace(perf_counter=lambda: now))
    monkeypatch.setattr(recording, "Simulator", lambda scene: simulator)
    record(
        simulator.scene.with_values({"accuracy.estimate": "off"}),
        0.04,
        1e-2,
        progress=lambda fraction: looks.append(now),
        tell=lambda line: told.append(now),
    )
    assert simulator.steps == 400
    assert np.diff(looks, prepend=0.0).max() <= max(0.2, cost)
    assert (len(looks) < 20) == (cost == 1e-5), "quick steps are done many at a time"
    assert told == [] if cost == 1e-5 else told[0] <= max(0.2, cost)


def test_an_interrupted_run_keeps_what_it_has():
    def interrupt(fraction: float) -> None:
        if fraction >= 0.5:
            raise KeyboardInterrupt

    run = record(wire(step=1e-4), 0.2, 1e-2, progress=interrupt)
    whole = record(wire(step=1e-4), 0.2, 1e-2)
    assert (run.status, run.ok) == ("interrupted", False)
    assert run.message == f"interrupted at {run.simulated_s:.6g} s of 0.2 s"
    assert 0.1 <= run.simulated_s < 0.2
    assert len(run.time) == int(run.simulated_s / 1e-2) + 1
    np.testing.assert_array_equal(run.control_points, whole.control_points[: len(run.time)])


def test_a_run_that_is_done_is_not_interrupted():
    def interrupt(fraction: float) -> None:
        if fraction >= 1.0:
            raise KeyboardInterrupt

    assert record(wire(), 0.02, 1e-3, progress=interrupt).status == "ok"


def test_only_a_long_run_is_told_beforehand(monkeypatch):
    told: list[str] = []
    record(wire(), 0.02, 1e-3, tell=told.append)
    assert told == []
    monkeypatch.setattr(recording, "LONG", 0.0)
    monkeypatch.setattr(recording, "_BRIEF", 0.0)
    record(wire(step=1e-5), 0.02, 1e-3, tell=told.append)
    (line,) = told
    assert line.startswith("2000 steps of 10 us, about ")
