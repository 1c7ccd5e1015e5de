"""The rehearsal: every input is taken and every output made once, before anything counts."""

from collections.abc import Callable

import pytest
from fake_simulator import FakeSimulator

from dlo_sim.kernels.cache import NotCompiledError
from dlo_sim.scene.description import Scene
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

        def messages(self):
            found = super().messages()
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


@pytest.fixture
def done(monkeypatch) -> list[str]:
    """What `make_ready` has done; rehearsals are only noted."""
    found: list[str] = []
    monkeypatch.setattr(rehearsal, "rehearse", lambda scene, *, live: found.append("rehearsed"))
    monkeypatch.setattr(rehearsal, "rehearse_elsewhere", lambda scene: found.append("elsewhere"))
    return found


def making(done: list[str], scene: Scene, build: Callable[[], None]) -> list[str]:
    """What was done to make a scene ready."""
    rehearsal.make_ready(build, scene, lambda line: done.append("noted"))
    return done


def test_what_is_on_disk_is_built_at_once(loaded, done):
    assert making(done, loaded.scene, lambda: done.append("built")) == ["rehearsed", "built"]


def test_what_must_be_compiled_is_compiled_elsewhere_before_it_is_built(loaded, done):
    def build() -> None:
        if "elsewhere" not in done:
            raise NotCompiledError("the step")
        done.append("built")

    expected = ["rehearsed", "noted", "elsewhere", "rehearsed", "built"]
    assert making(done, loaded.scene, build) == expected


def test_what_cannot_be_compiled_elsewhere_is_compiled_here(loaded, done):
    """A process that fails must not keep the node from the change."""
    compiled = []

    def build() -> None:
        if not compiled:
            compiled.append(True)
            raise NotCompiledError("the step")
        done.append("built")

    assert making(done, loaded.scene, build)[-1] == "built"


def test_a_scene_that_is_refused_is_refused(loaded, done):
    def refuse() -> None:
        raise ValueError("too stiff")

    with pytest.raises(ValueError, match="too stiff"):
        making(done, loaded.scene, refuse)
    assert done == ["rehearsed"]
