"""A short run before the first message, so that what is compiled on first use is ready then."""

from dlo_sim.scene.description import Scene
from dlo_sim.session.cdr import StampedEncoder
from dlo_sim.session.session import InputTopic, Session

_SECOND = 1_000_000_000
_MESSAGES = 6
_PERIOD = _SECOND // 50


def rehearse(scene: Scene, *, live: bool = False) -> None:
    """Take a session of this scene through poses, loads, ticks, every output, a report and a reset.

    Without it the first message of each kind and the first report would each hold up a tick, or
    be counted as time of a replay.
    """
    session = Session(scene, live=live)
    latency = round(scene.inputs.latency * _SECOND)
    now = _SECOND
    for _ in range(_MESSAGES):
        for source in session.inputs:
            session.receive(source.topic, _still(scene, source, now), now)
        session.tick(now + latency)
        session.messages()
        now += _PERIOD
    session.diagnostics(now)
    session.reset()


def _still(scene: Scene, source: InputTopic, stamp_ns: int) -> bytes:
    """A message that moves nothing: an end where the scene has it, a load of zero."""
    encoder = StampedEncoder(source.type, scene.frame_id)
    if source.kind == "pose":
        at_rest = (*scene.ends[source.target].position, 0.0, 0.0, 0.0, 1.0)
        return encoder.encode(stamp_ns, at_rest)
    return encoder.encode(stamp_ns, (0.0,) * (3 if source.kind == "force" else 6))
