"""Saves the state of a session to a file, to resume from after the process has ended in any way.

The file is written elsewhere and then moved into place, so that it is never incomplete; checksums
detect damage. It is refused unless it is of this version and scene; its numbers are not checked.
"""

from __future__ import annotations

import dataclasses
import json
import os
import re
import time
from concurrent.futures import Future, ThreadPoolExecutor
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from dlo_sim import __version__
from dlo_sim.core.arguments import numbers
from dlo_sim.core.methods import METHODS
from dlo_sim.core.npz import NpzUnreadable, read_npz
from dlo_sim.process.atomic_output import write_atomically
from dlo_sim.scene.description import Obstacle, Scene, check_added, scene_from_values, scene_values
from dlo_sim.scene.needs import Needs
from dlo_sim.scene.refusal import SceneError, brief, one_line
from dlo_sim.simulation.resolution import continued

if TYPE_CHECKING:
    from dlo_sim.session.session import Session
    from dlo_sim.simulation.running import Snapshot

Array = NDArray[np.float64]
_VECTORS = "position", "orientation", "attachment", "tangent"  # of a geometry
# Groups whose parameters may differ, since they do not affect the meaning of the state.
_FREE = ("inputs.", "outputs.", "state.")
_TAKEN = re.compile(r"grasps\..*\.taken")  # may differ, as it is part of the state

_in_use: set[Path] = set()  # files of the cables of this process


def save_state(path: Path, state: Snapshot) -> None:
    """Write the state, replacing an existing file, which is kept if the new one cannot be written.

    Raises:
        ValueError: a motion waits (`Snapshot.waiting`), which the file cannot hold. OSError: the
            file cannot be written.
    """
    if state.waiting:
        waiting = ", ".join(state.waiting)
        raise ValueError(
            f"state: motions of {waiting} wait for their start; save it once they began"
        )
    head = {
        "version": __version__,
        "saved_at": time.time(),
        "scene": scene_values(state.scene),
        "steps": state.steps,
        "remainder": state.remainder,
        "needs": dataclasses.asdict(state.needs),
        "origin": state.model.origin.tolist(),
        "choice": vars(state.choice) | {"method": state.choice.method.name},
        "added": [dataclasses.asdict(obstacle) for obstacle in state.scene.added],
        "geometries": {
            name: [*(getattr(one, vector).tolist() for vector in _VECTORS), one.u]
            for name, one in state.geometries.items()
        },
    }

    def write(partial: Path) -> None:
        with partial.open("wb") as stream:
            np.savez(
                stream, head=np.array(json.dumps(head)), state=state.state, inputs=state.inputs
            )
            stream.flush()
            os.fsync(stream.fileno())  # else a power cut could leave a name without content

    write_atomically(path, write)


def load_state(path: Path, scene: Scene) -> tuple[Snapshot, float] | None:
    """The saved state of this scene and its age [s]; None if there is no file.

    In its scene, grasps hold the cable as in the state; control points and knots that the scene
    leaves open are those of the state. Raises SceneError if the file is unusable, with the cure.
    """
    cure = "remove the file, or give state.save_to another name"
    try:
        file = read_npz(path, ("head", "state", "inputs"))
        head, state, inputs = json.loads(str(file["head"])), file["state"], file["inputs"]
        unfit = "" if head["version"] == __version__ else f"dlo_sim {head['version']}"
        if not unfit:
            scene = continued(scene, scene_from_values(head["scene"]))
            unfit = _of_another(head, scene)
        if not unfit:
            return _snapshot(head, scene, state, inputs), time.time() - head["saved_at"]
    except NpzUnreadable as refused:
        if refused.missing:
            return None
        raise SceneError(f"state.save_to: {path} {refused}; {cure}") from None
    except Exception:  # a damaged file makes json and what follows raise almost anything
        raise SceneError(
            f"state.save_to: {path} is no saved state, or a damaged one; {cure}"
        ) from None
    raise SceneError(f"state.save_to: {path} is of {unfit}; {cure}")


def _of_another(head: dict[str, Any], scene: Scene) -> str:
    """Which other scene a state is of; empty if it fits."""
    saved, now = head["scene"], json.loads(json.dumps(scene_values(scene)))
    for key in sorted(saved.keys() | now.keys()):
        before, value = saved.get(key), now.get(key)
        if before != value and not (key.startswith(_FREE) or _TAKEN.fullmatch(key)):
            return f"another scene ({key} was {brief(before)}, is {brief(value)})"
    return ""


def _snapshot(head: dict[str, Any], scene: Scene, state: Array, inputs: Array) -> Snapshot:
    """The state in the contents of a file; ValueError, TypeError, KeyError if inconsistent."""
    from dlo_sim.simulation.build_model import build_model
    from dlo_sim.simulation.geometry import Geometry  # these import the compiler
    from dlo_sim.simulation.running import Noticed, Snapshot
    from dlo_sim.simulation.selection import Choice

    needs = Needs(**_with_tuples(head["needs"]))
    geometries = {}
    for name in scene.holders:
        *vectors, u = head["geometries"][name]
        shaped = {key: np.array(one) for key, one in zip(_VECTORS, vectors, strict=True)}
        geometries[name] = Geometry(**shaped, u=u)
    taken = (replace(g, taken=geometries[g.name].u is not None) for g in scene.grasps)
    scene = replace(scene, grasps=tuple(taken), added=())
    for one in head["added"]:
        obstacle = Obstacle(**_with_tuples(one))
        check_added(scene, obstacle)
        scene = replace(scene, added=(*scene.added, obstacle))
    model = build_model(scene, needs, geometries, np.array(head["origin"]))
    choice = Choice(**head["choice"] | {"method": METHODS[head["choice"]["method"]]})
    of_inputs, of_state = model.rooms  # compiled code would read beyond arrays that are too short
    kept = numbers("state", state, (of_state,)), numbers("inputs", inputs, (of_inputs,))
    return Snapshot(model, needs, choice, head["steps"], head["remainder"], *kept, {}, Noticed())


def _with_tuples(values: dict[str, Any]) -> dict[str, Any]:
    return {k: tuple(v) if isinstance(v, list) else v for k, v in values.items()}


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
        """The saved state from which to continue, or None. Until `release`, no other cable of this
        process can use the file.

        Raises SceneError if the file cannot be written, is in use here, or is not of this scene.
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
        if self._path in _in_use:
            raise SceneError(
                f"state.save_to: {self._path} is the file of another cable; give each its own"
            )
        loaded = load_state(self._path, scene)
        _in_use.add(self._path)
        if loaded is None:
            return None
        saved, age = loaded
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
        except Exception as error:  # no one waits for this thread
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
        """Let another cable of this process use the file."""
        if self._path is not None:
            _in_use.discard(self._path)
