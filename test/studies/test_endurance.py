"""Small versions of what `dlo_sim study endurance` does, and its parts that judge."""

import pickle
import signal
from types import SimpleNamespace

import numpy as np
import pytest

from dlo_sim.session import cdr
from dlo_sim.session.intake import Intake
from dlo_sim.session.outputs import Outputs
from dlo_sim.studies.endurance import fuzz, soak, study
from dlo_sim.studies.endurance.bad_messages import messages
from dlo_sim.studies.endurance.live import Case, Played
from dlo_sim.studies.report import Report


def test_bad_messages():
    made = messages(600, seed=7)
    assert sum(made.values()) == 600
    assert made["used"] > 60 and made["refused: undecodable"] > 100
    assert {"refused: not_finite", "refused: out_of_order", "waits for its time"} <= made.keys()


def test_a_session_that_raises_is_noticed(monkeypatch):
    def fails(self, *given):
        raise struct_error

    struct_error = IndexError("of a reader")
    monkeypatch.setattr(Intake, "accept", fails)
    with pytest.raises(fuzz.Broken, match="IndexError: of a reader; given /"):
        messages(100, seed=7)


def test_a_number_that_is_not_finite_is_noticed(monkeypatch):
    bad = cdr.StampedEncoder(cdr.WRENCH_STAMPED, "world").encode(0, [0, np.nan, 0, 0, 0, 0])
    message = SimpleNamespace(topic="~/x", type=cdr.WRENCH_STAMPED, stamp_ns=0, data=bad)
    monkeypatch.setattr(Outputs, "messages", lambda self, *given: [message])
    with pytest.raises(fuzz.Broken, match="~/x is not finite"):
        messages(100, seed=7)


def test_a_refusal_is_one_line():
    fuzz.check_line("start.pose: 'a\\nb' is no name")
    for text in ("two\nlines", "an escape \x1b[31m", "x" * 5000):
        with pytest.raises(fuzz.Broken, match="not one line"):
            fuzz.check_line(text)


def test_bad_parameters():
    made = fuzz.parameters(60, seed=3)
    assert made["refused"] > 15 and made["taken"] > 10


def test_damaged_bags(tmp_path):
    made = fuzz.bags(12, seed=3, folder=tmp_path)
    assert sum(made.values()) == 12 and len(made) > 1
    assert not (tmp_path / "damaged").exists()


def test_signals(tmp_path, monkeypatch):
    monkeypatch.setattr(fuzz, "COMMANDS", ("simulate", "replay"))
    assert sum(fuzz.signals(4, seed=1, folder=tmp_path).values()) == 4
    monkeypatch.setattr(fuzz, "ENDINGS", set())
    with pytest.raises(fuzz.Broken, match="simulate, SIG.* after .* s"):
        case = tmp_path, 9, "simulate", signal.SIGTERM, 0.0
        fuzz._signalled(case)


def test_soak_and_its_section(tmp_path, monkeypatch):
    monkeypatch.setattr(soak, "DURATION", {True: 20.0})
    looks = soak.soaked(True, lambda share: None)
    assert len(looks) == soak.LOOKS
    assert looks[-1].time == pytest.approx(20.0, abs=0.5) and looks[-1].refused == 0
    assert 0.0 < looks[-1].energy_error < 1e-4
    ((_, verdict),) = soak.describe(Report(tmp_path, "", "", {}), looks).items()
    assert "files +0, threads +0" in verdict
    assert (tmp_path / "soak.png").stat().st_size > 10_000


def test_messages_of_a_lap_join():
    case = Case(200.0, 13, 1.0)
    times = [at for _, _, at, _ in case.messages]
    assert times == sorted(times) and len(times) == 10 * (100 + 100 + 200)
    for end in ("start", "end"):
        np.testing.assert_allclose(soak.gripper(end, 0.0), soak.gripper(end, soak.LAP), atol=1e-12)


def played(case: Case, refused) -> Played:
    """A node that counted so many refused messages after each second."""
    log = [
        f'{{"time": {round(at * 1e9)}, "/dlo_sim: session": {{"messages refused": "{count}"}}}}'
        for at, count in enumerate(refused)
    ]
    source = {"log": log, "begin": 0}
    return Played(case, source, {}, np.zeros((2, 5)), 0)


def test_messages_that_are_refused_for_no_reason_are_told_from_the_others():
    case = Case(200.0, 13, 9.0, task={"jumps": [(2.0, 5.0, 3600.0)]})
    assert study._refused(played(case, [0, 0, 4, 4, 4, 7, 7, 7])) == (7, 0)
    assert study._refused(played(case, [0, 1, 4, 4, 4, 7, 7, 9])) == (9, 3)


def test_a_disturbed_node_ends_as_it_began():
    case = study.soak_case(120.0, 60.0)
    assert pickle.loads(pickle.dumps(case)) == case
    assert len(case.task["changes"]) < 120.0 - study.REST
    assert case.task["changes"][-1]["damping.air_drag"] == case.scene.damping.air_drag
    assert max(end for _, end, _ in case.task["silences"]) < 120.0
