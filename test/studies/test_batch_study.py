"""`dlo_sim study batch`, as short as it goes."""

import csv
from pathlib import Path

import pytest

from dlo_sim.batch.workers import open_workers
from dlo_sim.studies.batch import study
from dlo_sim.studies.catalogue import STUDIES, Request

KIND = "paper_wire, forest_ruth"


@pytest.fixture(scope="module")
def outcome(tmp_path_factory):
    """A study of one kind of scene with as few repeats as possible, on two workers."""
    with pytest.MonkeyPatch.context() as patch, open_workers(processes=2) as crew:
        patch.setattr(study, "KINDS", (KIND,))
        patch.setattr(study, "RESOLUTIONS", {True: (9, 13)})
        for name in ("REPEATS", "CORE_REPEATS"):
            patch.setattr(study, name, {True: 2})
        patch.setattr(study, "CORE_SCENES", {True: 17})
        patch.setattr(study, "CORE_DURATION", 0.005)
        folder = tmp_path_factory.mktemp("batch")
        yield STUDIES["batch"].run(Request(folder, True, "dlo_sim study batch", crew))


def rows_of(outcome, name):
    with Path(outcome.report).with_name(f"{name}.csv").open(encoding="utf-8") as stream:
        return list(csv.DictReader(stream))


def test_ratios_are_those_of_the_times(outcome):
    assert outcome.tables == {"vectors": 2, "cores": 1}
    assert outcome.figures == ["gain.png"]
    for row in rows_of(outcome, "vectors"):
        ratio = float(row["one by one [us/step]"]) / float(row["lanes [us/step]"])
        assert float(row["times faster"]) == pytest.approx(ratio)
        assert float(row["median times"]) > 0.0
    (row,) = rows_of(outcome, "cores")
    assert float(row["times faster"]) == pytest.approx(
        float(row["one [s]"]) / float(row["all [s]"])
    )
    assert (row["workers"], row["same bits"]) == ("2", "True")


def test_verdicts_follow_the_numbers(outcome):
    gains = [float(row["times faster"]) for row in rows_of(outcome, "vectors")]
    words = outcome.verdicts[f"vector lanes, {KIND}"]
    assert words.startswith(f"{min(gains):.2f} to {max(gains):.2f} times")
    text = Path(outcome.report).read_text(encoding="utf-8")
    for asked, answer in outcome.verdicts.items():
        assert f"- {asked}: **{answer}**" in text
