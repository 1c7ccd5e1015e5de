"""`dlo_sim tune`: what it writes meets the tolerance, by a check that shares no code with it."""

import contextlib
import io
import json
from dataclasses import replace

import numpy as np
import pytest
from harness import harness
from progress import rises, shown_progress

from dlo_sim.cli.main import main
from dlo_sim.core.methods import IMPLICIT, METHODS
from dlo_sim.scene.loading import (
    load_scene,
    scene_from_values,
    scene_values,
    shipped_scenes,
)
from dlo_sim.scene.plain_yaml import parse_yaml
from dlo_sim.simulation.recording import record
from dlo_sim.tuning.reference import NoReference, Reference, _method_and_step, converged
from dlo_sim.tuning.scene_file import scene_text, written
from dlo_sim.tuning.search import (
    TRIED,
    _method,
    _Search,
    _steps,
    _without_terms,
)
from dlo_sim.tuning.setting import Setting, present_setting, ways_to_resolve
from dlo_sim.tuning.trial import Job, attempt, farthest, timed_again

TOLERANCE, DURATION = 1e-3, 0.3
IMPLICIT_TRIED = {name for name in TRIED if METHODS[name].family == IMPLICIT}
ARGUMENTS = ["tune", "paper_wire", "--tolerance", str(TOLERANCE), "--duration", str(DURATION)]


def _clock(monkeypatch, cost):
    """Have run times follow from the setting: what is tested is what the search makes of them."""

    def timed(trial, job, budget=0.0):
        return replace(trial, wall=cost(trial.taken), repeats=trial.repeats + 2)

    def tried(job, setting, timed=True):
        trial = attempt(job, setting, timed=False)
        if not trial.ok:
            return trial
        took = cost(trial.taken)
        return replace(trial, first=took, wall=took if timed else np.inf)

    monkeypatch.setattr("dlo_sim.tuning.search.timed_again", timed)
    monkeypatch.setattr("dlo_sim.tuning.search.attempt", tried)


def _cost(setting):
    """Seconds per simulated second: implicit steps take ten times as long, spans thrice."""
    step = 1e-6 * setting.control_points * (10.0 if setting.method in IMPLICIT_TRIED else 1.0)
    return step * (3.0 if setting.stretch == "span" else 1.0) / setting.step


@pytest.fixture(scope="module")
def tuned(tmp_path_factory):
    """The written file and the printed JSON. What is fastest is decided here: stretching by sample,
    while the reference stretches by span."""
    path = tmp_path_factory.mktemp("tune") / "tuned.yaml"
    out = io.StringIO()
    with contextlib.redirect_stdout(out), pytest.MonkeyPatch.context() as patch:
        _clock(patch, _cost)
        shown = shown_progress(patch, "tune")
        assert main([*ARGUMENTS, "--output", str(path), "--json"]) == 0
    assert rises(shown), shown
    return path, json.loads(out.getvalue().splitlines()[-1])


def test_tuned_scene_meets_its_tolerance(tuned):
    path, facts = tuned
    fine = {
        "discretization.control_points": 33,
        "discretization.quadrature": "gauss",
        "discretization.samples": 3,
        "integrator.method": "velocity_verlet",
    }
    runs = [record(s, DURATION, 1e-3) for s in (load_scene(path), _wire(fine))]
    gap = np.linalg.norm(runs[0].centerline - runs[1].centerline, axis=2)
    assert gap.shape == (301, 50)
    assert 0.0 < gap.max() <= TOLERANCE
    # What it says of itself is what an independent look finds.
    assert gap.max() == pytest.approx(facts["error_m"], abs=facts["reference_error_m"] + 2e-5)
    assert facts["error_m"] + facts["reference_error_m"] <= TOLERANCE


def test_tuned_scene_is_the_same_cable_and_faster(tuned):
    path, facts = tuned
    scene, before = load_scene(path), _wire({})
    changed = {
        key for key, value in scene_values(scene).items() if value != scene_values(before)[key]
    }
    assert changed <= {
        *("discretization.control_points", "discretization.quadrature"),
        *("discretization.samples", "discretization.stretch", "discretization.knots"),
        *("integrator.method", "integrator.step"),
        *("terms.bend", "terms.gravity", "terms.damping", "terms.out_of_plane"),
    }
    assert scene.integrator.method == facts["method"]
    assert scene.integrator.step == facts["step_s"]
    ratio = facts["present_wall_s_per_s"] / facts["wall_s_per_s"]
    assert facts["faster_than_present"] == pytest.approx(ratio) and ratio > 3.0
    assert facts["present_error_m"] < 0.01


def test_comments_say_what_was_measured(tuned):
    path, facts = tuned
    head = [line for line in path.read_text(encoding="utf-8").splitlines() if line.startswith("#")]
    text = "\n".join(head)
    for word in ("setting", "error", "reference", "time", "before", "--tolerance 0.001"):
        assert word in text
    assert f"{facts['error_m']:.2g} m" in text
    setting, reference = (
        line for word in ("setting", "reference") for line in head if line.startswith(f"# {word}")
    )
    assert facts["setting"] in setting
    assert load_scene(path).discretization.stretch == facts["stretch"] == "sample"
    assert "stretch by span" not in setting and "stretch by span" in reference


def test_nothing_within_the_tolerance_is_status_3_and_writes_nothing(tmp_path, capsys):
    path = tmp_path / "tuned.yaml"
    arguments = ["tune", "paper_wire", "--tolerance", "1e-13", "--duration", "0.01", "--json"]
    assert main([*arguments, "--output", str(path)]) == 3
    facts = json.loads(capsys.readouterr().out.splitlines()[-1])
    assert facts["status"] == "failed"
    assert "raise --tolerance" in facts["message"]
    assert not path.exists()


@pytest.mark.parametrize("name", shipped_scenes())
def test_written_scenes_read_back_the_same(name, tmp_path):
    scene = load_scene(name)
    path = tmp_path / "scene.yaml"
    path.write_text(scene_text(scene, ["a line", ""]), encoding="utf-8")
    assert load_scene(path) == scene


def test_doubles_have_a_decimal_point():
    assert written(2e-05) == "2.0e-05"
    assert written(1e22) == "1.0e+22"
    assert written([1.5, 2.0]) == "[1.5, 2.0]"
    assert written(True) == "true" and written(3) == "3"
    assert written('a "b"') == '"a \\"b\\""'


@pytest.mark.parametrize(
    "mark", ["\n", "\r", "\r\n", "\x85", "\u2028", "\u2029", "\x0b", "\x0c", "\0"]
)
def test_comment_and_text_cannot_become_parameters(tmp_path, mark):
    """As from the name of a file: what follows a line break stays in its comment or text."""
    name = f"a.yaml{mark}/**:{mark}  ros__parameters:{mark}    frame_id: planted #\udcff: '\""
    scene = load_scene("paper_wire", {"frame_id": "w'\"\\ #: {}"})
    path = tmp_path / "scene.yaml"
    path.write_text(scene_text(scene, [name]), encoding="utf-8")
    assert load_scene(path) == scene
    assert len(path.read_text(encoding="utf-8").splitlines()) == len(
        scene_text(scene, [""]).splitlines()
    )
    assert parse_yaml(written(f"a{mark}b\t'\"\\ #: {{}}")) == f"a{mark}b\t'\"\\ #: {{}}"


def test_timing_again_keeps_the_least():
    job = Job(_wire({}), 0.02, (0.5,))
    trial = attempt(job, Setting("energy_momentum", 7, 2e-3), budget=0.01)
    again = timed_again(trial, job, budget=0.01)
    assert again.wall <= trial.wall and again.repeats > trial.repeats >= 2
    assert farthest(again.points, trial.points) == 0.0
    assert farthest(again.points[:-1], trial.points) == np.inf
    assert farthest(again.points[:0], trial.points[:0]) == np.inf


def _wire(overrides):
    return load_scene("paper_wire", overrides)


def _quiet(fraction):
    """No progress is shown."""


def _heavy_cable(limit=1e-4):
    """A search whose cable swings a little: bending and damping do nothing, its weight does all.

    Returns the search and its best trial.
    """
    values = {
        "cable.bending_stiffness": 1e-9,
        "cable.axial_stiffness": 60.0,
        "cable.linear_density": 0.1,
        "damping.mass": 1e-9,
        "start.fixed": [True] * 3,
        "end.position": [0.9, 0.0, -0.1],
        "terms.twist": "off",
    }
    setting = Setting("velocity_verlet", 9, 1e-3)
    job = Job(scene_from_values(values), 0.2, (0.5, 1.0), 0.01)
    best = attempt(job, setting)
    return _Search(job, Reference(best.points, setting, 0.0), limit, [], _quiet), best


def test_terms_that_the_tolerance_can_do_without_are_switched_off(monkeypatch):
    _clock(monkeypatch, lambda setting: 1.0 - 0.1 * len(setting.off))
    search, best = _heavy_cable()
    found, error = _without_terms(search, best, 0.0)
    assert set(found.setting.off) == {"bend", "damping", "out_of_plane"}
    assert 0.0 < error < 1e-4
    assert found.setting.applied(search.job.scene).terms.bend == "off"
    assert "without bend" in found.setting.words


def test_terms_that_cost_nothing_stay(monkeypatch):
    _clock(monkeypatch, lambda setting: 1.0 - 0.01 * len(setting.off))
    search, best = _heavy_cable()
    found, error = _without_terms(search, best, 0.0)
    assert found.setting.off == () and error == 0.0


def test_a_stiff_wire_gets_along_with_fewer_control_points_by_span(monkeypatch):
    _clock(monkeypatch, lambda setting: float(setting.control_points))
    job = Job(_wire({}), 0.2, (0.25, 0.5, 0.75), 0.01)
    fine = attempt(job, Setting("energy_momentum", 33, 1e-3), timed=False)
    fewest = {}
    for stretch, _ in ways_to_resolve(job.scene, "energy_momentum"):
        search = _Search(job, Reference(fine.points, fine.setting, 0.0), 1e-3, [], _quiet)
        _method(search, Setting("energy_momentum", 0, samples=2, stretch=stretch))
        assert {trial.setting.stretch for trial, _ in search.good} == {stretch}
        fewest[stretch] = int(search.fastest)
    assert fewest == {"sample": 9, "span": 7}


def test_a_reference_counts_stretching_by_span_and_is_as_good_as_its_error_says():
    job = Job(_wire({}), 0.2, (0.25, 0.5, 0.75, 1.0), 0.01)
    reference = converged(job, 1e-3)
    assert reference.setting.stretch == "span"
    assert reference.error <= 0.5e-3
    fine = attempt(job, Setting("energy_momentum", 57, 2.5e-4), timed=False)
    assert farthest(fine.points, reference.points) <= reference.error + 1e-4


def test_a_reference_takes_an_implicit_step_with_an_implicit_method():
    """The clamp's first span converges slowly."""
    soft = scene_from_values(
        {
            **{"cable.length": 0.5, "cable.diameter": 0.01, "cable.density": 1000.0},
            **{"cable.youngs_modulus": 1e5, "accuracy.target": 0.05},
            **{"start.clamped": True, "start.tangent": [1.0, 0.0, 0.0]},
        }
    )
    job = Job(soft, 0.3, (0.5, 1.0), 0.01)
    setting, change = _method_and_step(job, 2.5e-6)
    assert setting.method == "energy_momentum" and 0.0 < setting.step <= 2.5e-4
    assert change <= 2.5e-6
    with pytest.raises(NoReference, match="n_u 57 and 81 still differ"):
        converged(job, 1e-5)


def test_a_reference_without_an_implicit_method_says_what_the_explicit_one_lacks():
    job = Job(_wire({"terms.twist": "frenet"}), 0.02, (0.5,), 0.01)
    assert converged(job, 1e-3).setting.method == "velocity_verlet"
    with pytest.raises(NoReference, match="does not converge to 1e-16 m in time"):
        _method_and_step(job, 1e-16)


def test_the_present_setting_is_the_scene_s_own():
    values = {"discretization.quadrature": "gauss", "discretization.samples": 2}
    scene = _wire({**values, "discretization.stretch": "span", "integrator.step": 1e-3})
    assert present_setting(scene).applied(scene) == scene


def test_stretching_that_is_left_out_is_tried_one_way():
    scene = _wire({})
    assert ways_to_resolve(_wire({"terms.stretch": "off"}), "velocity_verlet") == (
        ("sample", "uniform"),
    )
    assert ways_to_resolve(scene, "velocity_verlet") == (("sample", "uniform"), ("span", "uniform"))


def test_methods_that_mass_damping_refuses_are_only_left_out():
    """Compositions have negative sub-steps: a clamped cable with weight was refused for them."""
    values = {"cable.length": 0.6, "cable.diameter": 0.006, "cable.youngs_modulus": 2e6}
    held = {"start.clamped": True, "end.clamped": True, "end.fixed": [True] * 3}
    scene = scene_from_values(values | held | {"end.position": [0.5, 0, 0], "damping.mass": 2.0})
    graded = {name for name in TRIED if ("span", "auto") in ways_to_resolve(scene, name)}
    assert graded == {"energy_momentum", "implicit_midpoint"} < IMPLICIT_TRIED


def test_graded_knots_are_tried_where_a_heavy_cable_is_clamped():
    held = {"start.fixed": [True] * 3, "start.clamped": True, "start.spring": [0.0] * 3}
    clamped = held | {"gravity": [0.0, 0.0, -9.81], "cable.bending_stiffness": 1e-3}
    assert ways_to_resolve(_wire(clamped), "energy_momentum")[2:] == (("span", "auto"),)
    weightless = clamped | {"gravity": [0.0, 0.0, 0.0]}
    assert len(ways_to_resolve(_wire(weightless), "energy_momentum")) == 2
    assert len(ways_to_resolve(_wire({}), "energy_momentum")) == 2


def test_implicit_steps_beyond_a_timer_period_where_nothing_arrives_in_between():
    setting = Setting("energy_momentum", 9)
    for values, periods in (({}, 8), ({"end.pose_topic": "/pose"}, 1)):
        job = Job(_wire(values), 0.2, (0.5,), 0.01)
        search = _Search(job, Reference(np.zeros((0, 1, 3)), setting, 0.0), 1e-3, [], _quiet)
        steps = _steps(search, setting)
        assert steps[0] == pytest.approx(periods / job.scene.rate)
        assert steps == sorted(steps, reverse=True)
        assert steps[-1] == pytest.approx(1.0 / 32.0 / job.scene.rate)


def test_cables_of_a_net_are_refined_in_proportion_and_all_compared():
    """A change of a branch alone is an error of the net."""
    scene, u = harness(), (0.0, 0.5, 1.0)
    finer = Setting("energy_momentum", 15, 5e-3).applied(scene)
    assert [one.scene.discretization.control_points for one in finer.strands] == [15, 11, 13, 7]
    coarse = Setting("energy_momentum", 5, 5e-3).applied(scene)  # a single span may be too few
    assert [one.scene.discretization.control_points for one in coarse.strands] == [5, 5, 5, 5]
    own = Setting("energy_momentum", 9, 5e-3)
    assert own.applied(scene) == scene.with_values(own.values)
    softer = scene.with_values({"cables.c.cable.diameter": 0.02, "cables.c.start.clamped": True})
    one, other = (attempt(Job(of, 0.1, u), own, timed=False) for of in (scene, softer))
    assert one.points.shape == (101, 4 * 3, 3)
    assert farthest(one.points[:, :9], other.points[:, :9]) < 1e-9
    assert farthest(one.points, other.points) > 1e-3
