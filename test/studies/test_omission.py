"""`dlo_sim study omission --quick`, run once; and which variants a scene has."""

from dataclasses import replace

import pytest
from study_tables import quick, rows_of

from dlo_sim.scene import needs
from dlo_sim.scene.loading import load_scene
from dlo_sim.simulation.simulator import Simulator
from dlo_sim.studies import omission as study_module
from dlo_sim.studies.omission import QUICK_TERMS, TERMS, Row, has, single_cables, variants
from dlo_sim.tuning.trial import attempt

pytestmark = pytest.mark.slow


@pytest.fixture(scope="module")
def study(tmp_path_factory):
    """Folder and outcome of one quick study."""
    folder = tmp_path_factory.mktemp("omission")
    return folder, quick(study_module, folder)


@pytest.fixture(scope="module")
def rows(study):
    return {row["term"]: row for row in rows_of(study[0], "omission")}


def test_every_term_is_known():
    """The Bishop frame comes with all twist but that relative to the Frenet frame."""
    assert {*TERMS, "bishop"} == {*needs.NAMES, "out_of_plane", "air_drag"}


def test_every_term_is_timed_with_and_without(rows):
    assert tuple(rows) == QUICK_TERMS
    for row in rows.values():
        assert 0.0 < float(row["with [us/step]"]) < 1e4
        assert 0.0 < float(row["without [us/step]"]) < 1e4
        assert 0.0 <= float(row["error without it [mm]"]) < 1e3
        assert (row["in its step"] == "left out") == bool(row["note"])


def test_what_is_left_out_does_not_matter_and_the_rest_does(rows):
    error = "error without it [mm]"
    for row in rows.values():
        if row["in its step"] == "left out":  # measured: at most 6e-8
            assert float(row[error]) < 1e-6
    assert rows["out_of_plane"]["in its step"] == "left out"
    for term in ("bend", "gravity"):
        assert rows[term]["in its step"] == "yes"
        assert float(rows[term][error]) > 1.0
    assert 0.1 < float(rows["stretch"][error]) < 1.0  # measured 0.39
    assert rows["loads"]["note"] == "no loads; both with terms.out_of_plane on"


@pytest.mark.parametrize("name", single_cables())
def test_every_shipped_scene_has_every_term_with_and_without(name):
    """Nothing is compiled here: scenes alone."""
    scene = load_scene(name)
    found = variants(scene)
    assert [variant.term for variant in found] == list(TERMS)
    for variant in found:
        assert has(variant.full, variant.term) and not has(variant.bare, variant.term)
        assert variant.automatic == has(scene, variant.term)
        assert variant.automatic != bool(variant.reason)
        if name == "paper_wire" and variant.term == "damping":
            note = "no damping; both with integrator.method energy_momentum"
            assert variant.note == note
        for other in TERMS:
            if scene in (variant.full, variant.bare):
                assert not variant.shared
            if other not in (variant.term, *TERMS[variant.term].along):
                assert has(variant.full, other) == has(variant.bare, other), (variant.term, other)


def test_a_term_that_nothing_can_put_in_says_so(monkeypatch):
    nothing = study_module.Term(lambda scene: {}, lambda scene: {}, reason="not wanted")
    monkeypatch.setitem(TERMS, "plasticity", nothing)
    with pytest.raises(RuntimeError, match="no two scenes differ in the term plasticity alone"):
        variants(load_scene("paper_wire"))


def test_a_run_that_fails_at_its_own_step_is_done_at_a_smaller_one(monkeypatch):
    """The hanging cable without stretch, as if that diverged at its own step."""

    def diverging(job, setting, timed):
        trial = attempt(job, setting, timed=timed)
        fails = job.scene.terms.stretch == "off" and setting.step == 0.0
        return replace(trial, message="the energy grew") if fails else trial

    monkeypatch.setattr(study_module, "attempt", diverging)
    scene = load_scene("hanging_cable")
    (stretch,) = (variant for variant in variants(scene) if variant.term == "stretch")
    full, bare = (study_module.motion(*piece) for piece in study_module.pieces(stretch, 0.02))
    assert full.ok and full.setting.step == 0.0
    assert bare.ok and 0.0 < bare.setting.step < Simulator(scene).step
    row = study_module.row_of("hanging_cable", stretch, full, bare)
    assert row.note.endswith("without it: fails at its own step, run at 0.1 of it")
    assert 0.0 < row.error < 1e-3


def test_what_is_left_out_is_judged_without_the_other_model_of_twist():
    rows = [
        Row("wire", "loads", "left out", 1e-6, 1e-6, 0.0, 2e-6, "no loads"),
        Row("wire", "frenet", "left out", 1e-6, 1e-6, 0.0, 5e-2, "terms.twist is not frenet"),
        Row("wire", "gravity", "yes", 1e-6, 1e-6, 0.0, 3e-2, ""),
    ]
    (line,) = study_module.verdicts_of(rows).values()
    assert line.endswith(": 0.002 mm")
