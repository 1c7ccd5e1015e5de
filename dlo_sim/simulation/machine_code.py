"""Whether machine code is on disk, and who compiles it, for rooms that know no compiler.

Run as a program, this compiles the stepping loop of the scene on its standard input.
"""

from __future__ import annotations

import contextlib
import json
import logging
import subprocess
import sys
from collections.abc import Callable, Iterator

from dlo_sim.kernels.cache import LOGGER, NotCompiledError, on_first_miss, only_loading
from dlo_sim.process import stopping
from dlo_sim.scene.description import Scene
from dlo_sim.scene.loading import SceneError, scene_from_values, scene_values
from dlo_sim.simulation.processors import processors


def done_without_compiling(work: Callable[[], None]) -> bool:
    """Do some work, unless it needs machine code that another process could leave on disk first.

    Returns:
        Whether it was done; if not, it stopped where the machine code is missing.
    """
    try:
        with only_loading():
            work()
    except NotCompiledError:
        return False
    return True


@contextlib.contextmanager
def compiled_by_two(scene: Scene) -> Iterator[None]:
    """Inside, if anything must be compiled, another process compiles the scene's stepping loop.

    That is more than half of all. When this process comes to it, it waits for that code. At the end
    nobody waits for the other process: what it has finished is on disk, what not was not needed.
    """

    def begin() -> None:
        stopping.check()  # nobody would end another process any more
        helper = subprocess.Popen(
            [sys.executable, "-m", "dlo_sim.simulation.machine_code"],
            stdin=subprocess.PIPE,
            stdout=subprocess.DEVNULL,
            stderr=subprocess.DEVNULL,
        )
        helpers.append(helper)
        assert helper.stdin is not None
        with contextlib.suppress(OSError):  # it ended at once: this process compiles all
            with helper.stdin as stream:
                stream.write(json.dumps(scene_values(scene)).encode())

    def end() -> None:
        for helper in helpers:
            helper.terminate()
            helper.wait()

    helpers: list[subprocess.Popen[bytes]] = []
    if processors() < 2:
        yield
        return
    with stopping.cleanup(end), on_first_miss(begin):
        yield


def compile_loop(scene: Scene) -> None:
    """Compile the stepping loop of a scene. Where `auto` would have to look at the scene's spectrum
    to choose the method, an implicit one is compiled.
    """
    import numpy as np

    from dlo_sim.scene.needs import needs_of
    from dlo_sim.simulation import workspace
    from dlo_sim.simulation.geometry import end_geometries
    from dlo_sim.simulation.model import build_model
    from dlo_sim.simulation.selection import choose
    from dlo_sim.simulation.stepper import Stepper

    model = build_model(scene, needs_of(scene), end_geometries(scene, None))
    stepper = Stepper(scene, model, choose(scene, np.inf, unchecked_step=True))
    stepper.compile(
        workspace.new_state(model),
        workspace.new_work(model),
        workspace.new_solver(model),
        workspace.new_recorder(model, np.zeros(0)),
    )


@contextlib.contextmanager
def compiling_told_to(tell: Callable[[str], object]) -> Iterator[None]:
    """Inside, `tell` gets one line when this process begins to compile; none on a warm start."""
    log = logging.getLogger(LOGGER)
    handler = _Teller(tell)
    before = log.level
    log.addHandler(handler)
    log.setLevel(logging.INFO)
    try:
        yield
    finally:
        log.setLevel(before)
        log.removeHandler(handler)


class _Teller(logging.Handler):
    def __init__(self, tell: Callable[[str], object]) -> None:
        super().__init__()
        self._tell = tell

    def emit(self, record: logging.LogRecord) -> None:
        self._tell(record.getMessage())


if __name__ == "__main__":
    try:
        compile_loop(scene_from_values(json.load(sys.stdin)))
    except SceneError:  # the other process says so
        sys.exit(2)
