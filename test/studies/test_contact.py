"""`dlo_sim study contact --quick`, run once."""

import csv

import pytest

from dlo_sim.batch.workers import HERE
from dlo_sim.studies import Request
from dlo_sim.studies.contact import TESTS, run_study

pytestmark = pytest.mark.slow


def test_every_known_answer_is_met(tmp_path):
    shares = []
    request = Request(tmp_path, True, "dlo_sim study contact", HERE, progress=shares.append)
    outcome = run_study(request)
    assert set(outcome.verdicts) == set(TESTS)
    assert all("meets" in verdict for verdict in outcome.verdicts.values())
    assert shares[-1] == 1.0 and (tmp_path / "contact_cost.png").is_file()
    with (tmp_path / "contact.csv").open(encoding="utf-8", newline="") as stream:
        rows = list(csv.DictReader(stream))
    assert {row["test"] for row in rows} == set(TESTS)
    best = {}
    for row in rows:
        error, allowed = abs(float(row["error [%]"])), float(row["allowed [%]"])
        best[row["test"]] = min(best.get(row["test"], 1e9), error / allowed)
    assert max(best.values()) < 1.0
