"""A short run before the first message, so that what is compiled on first use is ready then."""

import contextlib
import json
import math
import subprocess
import sys
from collections.abc import Callable

from dlo_sim.process.stopping import cleanup
from dlo_sim.scene.description import Scene
from dlo_sim.scene.loading import scene_values
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
    # The first pose comes out of the smoothing, and the cable is placed, half a window later.
    smoothing = max((end.pose_smoothing for end in scene.ends.values() if end.driven), default=0.0)
    now = _SECOND
    for _ in range(_MESSAGES + math.ceil(smoothing * _SECOND / _PERIOD)):
        for source in session.inputs:
            session.receive(source.topic, _still(scene, source, now), now)
        session.tick(now + latency)
        session.messages()
        now += _PERIOD
    session.diagnostics(now)
    session.reset()


def rehearse_elsewhere(scene: Scene) -> None:
    """Rehearse a scene in a process of its own, so that its machine code is on disk afterwards.

    Compiling holds the interpreter for up to a tenth of a second at a time; loading does not. A
    process that fails leaves the work to whoever needs the code next.
    """
    process = subprocess.Popen(
        [sys.executable, "-m", "dlo_sim.session.rehearsal_process"],
        stdin=subprocess.PIPE,
        stdout=subprocess.DEVNULL,
        stderr=subprocess.DEVNULL,
    )
    with cleanup(process.kill), process:
        process.communicate(json.dumps(scene_values(scene)).encode())


def make_ready(build: Callable[[], None], scene: Scene, note: Callable[[str], object]) -> None:
    """Rehearse a scene and build what is wanted of it, without compiling here if it can be helped.

    Which machine code a scene needs shows when it is asked for: the method of a scene may depend on
    its stiffness, what is left out on its loads.

    Args:
        build: may be called twice, if it stops halfway for want of machine code.
        note: gets a line if something must be compiled.
    """

    def work() -> None:
        with contextlib.suppress(ValueError):  # not from the file's poses: no refusal
            rehearse(scene, live=True)
        build()

    from dlo_sim.simulation.machine_code import done_without_compiling

    if not done_without_compiling(work):
        note("compiling what is new in this scene in another process, some 10 to 30 s")
        rehearse_elsewhere(scene)
        work()


def _still(scene: Scene, source: InputTopic, stamp_ns: int) -> bytes:
    """A message that moves nothing: an end where the scene has it, a load of zero."""
    encoder = StampedEncoder(source.type, scene.frame_id)
    if source.kind == "pose":
        at_rest = (*scene.ends[source.target].position, 0.0, 0.0, 0.0, 1.0)
        return encoder.encode(stamp_ns, at_rest)
    return encoder.encode(stamp_ns, (0.0,) * (3 if source.kind == "force" else 6))
