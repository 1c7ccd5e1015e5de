"""`dlo_sim study omission --quick`, run once; and which variants a scene has."""

import csv
import dataclasses

import pytest

from dlo_sim.batch.workers import Here
from dlo_sim.scene.loading import load_scene, shipped_scene
from dlo_sim.studies.catalogue import STUDIES, Request
from dlo_sim.studies.omission.variants import TERMS, job, variants

pytestmark = pytest.mark.slow


@pytest.fixture(scope="module")
def study(tmp_path_factory):
    """Folder and outcome of one quick study."""
    folder = tmp_path_factory.mktemp("omission")
    outcome = STUDIES["omission"].run(Request(folder, True, "dlo_sim study omission", Here()))
    return folder, dataclasses.asdict(outcome)


@pytest.fixture(scope="module")
def rows(study):
    with (study[0] / "omission.csv").open(encoding="utf-8", newline="") as stream:
        return {row["term"]: row for row in csv.DictReader(stream)}


def test_every_term_has_a_row_and_there_is_a_figure(study, rows):
    folder, outcome = study
    assert list(rows) == list(TERMS)
    assert outcome["tables"] == {"omission": len(TERMS)}
    assert outcome["figures"] == ["omission_bars.png"]
    assert (folder / "omission_bars.png").stat().st_size > 10_000
    assert "omission_bars.png)" in (folder / "report.md").read_text(encoding="utf-8")


def test_what_is_left_out_does_not_matter_and_the_rest_does(rows):
    error = "error without it [mm]"
    for term in ("twist", "out_of_plane"):
        assert rows[term]["in its step"] == "left out"
        assert float(rows[term][error]) < 1e-6
    for term in ("bend", "gravity", "springs"):
        assert rows[term]["in its step"] == "yes"
        assert float(rows[term][error]) > 1.0
    assert 0.1 < float(rows["stretch"][error]) < 1.0  # measured 0.39
    assert rows["loads"]["note"] == "no loads"
    for row in rows.values():
        assert float(row["without [us/step]"]) > 0.0


def test_a_driven_scene_is_driven_and_refusals_are_no_variant():
    scene = load_scene(shipped_scene("two_grippers"))
    found = {variant.term: variant for variant in variants(scene)}
    assert found["twist"].automatic and found["twist"].bare.terms.twist == "off"
    assert found["stretch"].bare.integrator.method == "rattle"
    assert found["springs"].full is None
    ((end, motion),) = job(scene, 1.0).motions
    assert end == "start"
    assert motion.position_at(0.5) == pytest.approx([0.0, 0.15, 0.5])
