"""Keeps the state of a session in a file, beside the ticks."""

import os
from concurrent.futures import Future, ThreadPoolExecutor
from pathlib import Path
from typing import Any

from dlo_sim.ros.guarded_node import one_line
from dlo_sim.scene.description import Scene
from dlo_sim.scene.refusal import SceneError
from dlo_sim.session.saved_state import load_state, save_state
from dlo_sim.session.session import Session
from dlo_sim.simulation.simulator import Snapshot

_taken: set[Path] = set()  # files of the cables of this process


class StateKeeper:
    """Writes state.save_to, and reads it at the start; without that parameter it does nothing."""

    def __init__(self, scene: Scene, log: Any) -> None:
        # Path.resolve raises where symbolic links form a loop.
        place = scene.state.save_to
        self._path = Path(os.path.realpath(place)) if place else None
        self._log = log
        self._writer = ThreadPoolExecutor(1)
        self._writing: Future[None] | None = None

    def found(self, scene: Scene) -> Snapshot | None:
        """The state to go on from, if there is one. The file is this cable's until `release`.

        Raises:
            SceneError: nothing can be written there, another cable of this process writes there, or
                the file is not of this scene.
        """
        if self._path is None:
            return None
        folder = self._path.parent
        if not folder.is_dir():
            raise SceneError(f"state.save_to: the folder {folder} does not exist; create it first")
        if self._path.is_dir():
            raise SceneError(f"state.save_to: {self._path} is a folder; give a file in it")
        if os.path.lexists(self._path) and not self._path.is_file():
            raise SceneError(
                f"state.save_to: {self._path} is a device, a pipe or a link to nowhere; give the "
                "name of a file"
            )
        if not os.access(folder, os.W_OK):
            raise SceneError(
                f"state.save_to: nothing can be written in {folder}; give another folder"
            )
        if self._path in _taken:
            raise SceneError(
                f"state.save_to: {self._path} is the file of another cable; give each its own"
            )
        found = load_state(self._path, scene)
        _taken.add(self._path)
        if found is None:
            return None
        saved, age = found
        self._log.info(f"goes on from the state saved {age:.1f} s ago in {self._path}")
        return saved

    def keep(self, session: Session) -> None:
        """Write the present state, unless the last one is still being written."""
        if self._path is None or (self._writing is not None and not self._writing.done()):
            return
        saved = session.saved
        if saved is not None:
            self._writing = self._writer.submit(self._write, self._path, saved)

    def _write(self, path: Path, saved: Snapshot) -> None:
        try:
            save_state(path, saved)
        except Exception as error:  # of a thread that nobody waits for
            self._log.warning(
                f"state.save_to: {path} cannot be written ({one_line(error)}); free space or "
                "choose another folder",
                throttle_duration_sec=5.0,
            )

    def close(self, session: Session) -> None:
        """Write the last state, after the one that is being written."""
        if self._writing is not None:
            self._writing.exception()
        self.keep(session)
        self._writer.shutdown()

    def release(self) -> None:
        """Leave the file that `found` took to whoever comes next."""
        if self._path is not None:
            _taken.discard(self._path)
