"""`dlo_sim study contact --quick`, run once, and rows that miss their answers."""

import pytest
from study_tables import quick, rows_of

from dlo_sim.studies import contact
from dlo_sim.studies.contact import PANELS
from dlo_sim.studies.known_answers import Answer, Answers


def studied(folder, shares=None):
    progress = (lambda share: None) if shares is None else shares.append
    return quick(contact, folder, progress=progress), rows_of(folder, "contact")


@pytest.mark.slow
def test_every_known_answer_is_met(tmp_path):
    shares = []
    outcome, rows = studied(tmp_path, shares)
    assert (
        set(outcome.verdicts)
        == {name for those in PANELS.values() for name in those}
        == {row["test"] for row in rows}
    )
    assert all(verdict.startswith("meets: ") for verdict in outcome.verdicts.values())
    assert shares[-1] == 1.0 and (tmp_path / "contact_cost.png").is_file()
    last = {row["test"]: row["resolution"] for row in rows}
    judged = [row for row in rows if row["resolution"] == last[row["test"]]]
    assert {row["verdict"] for row in judged} == {"meets"}
    assert {float(row["allowed"].split()[0]) > 0.0 for row in judged} == {True, False}
    assert sum(row["exponent"] != "" for row in rows_of(tmp_path, "knots")) == 6


def test_a_test_that_misses_or_fails_says_so(tmp_path, monkeypatch):
    """The study goes on, and judges the last resolution."""

    def answered(answers):
        return lambda resolution: Answers(answers, 0.1, None)

    def fails(resolution):
        raise RuntimeError("contact: it failed")

    good, off = Answer("force [N]", 2.0, 2.01, 0.01), Answer("force [N]", 2.0, 2.04, 0.01)
    still, crept = Answer("crept [m]", 0.0, 0.0, 0.0), Answer("crept [m]", 0.0, -1e-8, 1e-9)
    tests = {"good": (good, still), "off": (good, off, still), "crept": (good, crept)}
    known = {name: (answered(answers), (1e-3,), ()) for name, answers in tests.items()}
    known["fails"] = fails, (1e-3,), ()
    monkeypatch.setattr(contact, "PANELS", {"panel": known})
    outcome, rows = studied(tmp_path)
    assert outcome.verdicts == {
        "good": "meets: force [N] off by 0.5 %, allowed 1 %, in 0.1 s",
        "off": "misses: force [N] off by 2 %, allowed 1 %, in 0.1 s",
        "crept": "misses: crept [m] 1e-08, allowed 1e-09, in 0.1 s",
        "fails": "misses: contact: it failed",
    }
    words = ["meets", "meets", "meets", "misses", "meets", "meets", "misses", "misses"]
    assert [row["verdict"] for row in rows] == words
