"""The rehearsal: every input is taken and every output made once, before anything counts."""

import pytest
from fake_simulator import FakeSimulator

from dlo_sim.session import rehearsal
from dlo_sim.session.outputs import DIAGNOSTICS, output_topics
from dlo_sim.session.session import Session


@pytest.mark.parametrize(("latency", "smoothing"), [(0.06, 0.0), (0.3, 0.0), (0.3, 0.14)])
def test_every_input_is_taken_and_every_output_made(monkeypatch, loaded, latency, smoothing):
    scene = loaded.scene.with_values(
        {
            "inputs.latency": latency,
            "start.position": [1, 2, 3],
            "start.pose_smoothing": smoothing,
        }
    )
    made: list[Session] = []
    topics: set[str] = set()
    reports: list[bytes] = []

    class Watched(Session):
        def __init__(self, scene, *, live=False):
            super().__init__(scene, FakeSimulator)
            made.append(self)

        def messages(self, wanted=None):
            found = super().messages(wanted)
            topics.update(message.topic for message in found)
            return found

        def diagnostics(self, now_ns, extra=None):
            reports.append(super().diagnostics(now_ns, extra))
            return reports[-1]

    monkeypatch.setattr(rehearsal, "Session", Watched)
    rehearsal.rehearse(scene)
    (session,) = made
    assert topics == set(output_topics(scene)) - {DIAGNOSTICS}
    assert len(reports) == 1
    assert session.journal.refused == {}
    assert all(record.accepted for record in session.journal.topics.values())
    kinds = {call[0] for call in session.simulator.calls if call[1] > 0}
    assert kinds >= {"load", "motion"}, "loads and motions took effect while stepping"
