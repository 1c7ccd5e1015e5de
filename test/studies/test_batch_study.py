"""`dlo_sim study batch`, as short as it goes."""

import csv

import pytest

from dlo_sim.batch.workers import open_workers
from dlo_sim.studies.batch import study
from dlo_sim.studies.catalogue import STUDIES, Request


@pytest.fixture(scope="module")
def outcome(tmp_path_factory):
    """A study of one kind of scene with as few repeats as possible, on two workers."""
    with pytest.MonkeyPatch.context() as patch, open_workers(processes=2) as crew:
        kind = "paper_wire, forest_ruth"
        patch.setattr(study, "KINDS", {kind: study.KINDS[kind]})
        patch.setattr(study, "RESOLUTIONS", {True: (9, 13)})
        for name in ("REPEATS", "CORE_REPEATS"):
            patch.setattr(study, name, {True: 2})
        patch.setattr(study, "CORE_SCENES", {True: 17})
        patch.setattr(study, "CORE_DURATION", 0.005)
        folder = tmp_path_factory.mktemp("batch")
        yield STUDIES["batch"].run(Request(folder, True, "dlo_sim study batch", crew))


def test_tables_have_what_was_asked(outcome):
    assert outcome.tables == {"vectors": 2, "cores": 1}
    assert outcome.figures == ["gain.png"] and len(outcome.verdicts) == 2
    folder = outcome.report.removesuffix("report.md")
    for name in ("vectors", "cores"):
        with open(folder + f"{name}.csv", encoding="utf-8") as stream:
            for row in csv.DictReader(stream):
                assert float(row["times"]) > 0.0 and float(row["median times"]) > 0.0
                assert row.get("same bits", "True") == "True"


def test_verdicts_follow_the_numbers(outcome):
    text = open(outcome.report, encoding="utf-8").read()
    for asked, answer in outcome.verdicts.items():
        limit = float(asked.split(">= ")[1].split()[0])
        word, times = answer.split(": ")
        assert (float(times.split()[0]) >= limit) == (word == "reached")
        assert f"{asked}: **{answer}**" in text
