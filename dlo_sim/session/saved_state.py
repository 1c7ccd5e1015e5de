"""The state of a session in a file, to go on from after its process was ended, however it was.

The file is written beside its place and put there whole, so that it is never half a state.
"""

from __future__ import annotations

import dataclasses
import json
import os
import re
import time
import zipfile
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np

from dlo_sim import __version__
from dlo_sim.process.atomic_output import write_atomically
from dlo_sim.scene.description import Scene, scene_values
from dlo_sim.scene.needs import Needs
from dlo_sim.scene.refusal import SceneError, brief
from dlo_sim.session.simulator_protocol import State

_VECTORS = ("position", "orientation", "attachment", "tangent")  # of a geometry
# Groups whose parameters may differ: they do not change what the state means.
_FREE = ("inputs.", "outputs.", "state.")
_TAKEN = re.compile(r"grasps\..*\.taken")  # is part of the state


def save_state(path: Path, state: State) -> None:
    """Write the state; what was there is replaced.

    Raises:
        OSError: the disk refuses; what was there is kept.
    """
    head = {
        "version": __version__,
        "saved_at": time.time(),
        "scene": scene_values(state.scene),
        "steps": state.steps,
        "remainder": state.remainder,
        "needs": dataclasses.asdict(state.needs),
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
            os.fsync(stream.fileno())  # or a power cut could leave the name without the content

    write_atomically(path, write)


def load_state(path: Path, scene: Scene) -> tuple[State, float] | None:
    """The state that was saved of this scene, and how long ago [s]; None if there is no file.

    The grasps of its scene hold the cable as they did.

    Raises:
        SceneError: it is no state, or one of another scene or version; with the cure.
    """
    cure = "remove the file, or give state.save_to another name"
    try:
        with np.load(path, allow_pickle=False) as file:
            head, state, inputs = json.loads(str(file["head"])), file["state"], file["inputs"]
    except FileNotFoundError:
        return None
    except (OSError, ValueError, KeyError, EOFError, zipfile.BadZipFile) as error:
        raise SceneError(f"state.save_to: {path} is no saved state ({error}); {cure}") from None
    if head["version"] != __version__:
        raise SceneError(f"state.save_to: {path} is of dlo_sim {head['version']}; {cure}")
    difference = _difference(head["scene"], json.loads(json.dumps(scene_values(scene))))
    if difference:
        raise SceneError(f"state.save_to: {path} is of another scene ({difference}); {cure}")
    from dlo_sim.simulation.geometry import Geometry  # these bring the compiler along
    from dlo_sim.simulation.simulator import Snapshot

    needs = Needs(**{key: _plain(value) for key, value in head["needs"].items()})
    geometries = {
        name: Geometry(**dict(zip(_VECTORS, map(np.array, vectors), strict=True)), u=u)
        for name, (*vectors, u) in head["geometries"].items()
    }
    taken = (replace(g, taken=geometries[g.name].u is not None) for g in scene.grasps)
    scene = replace(scene, grasps=tuple(taken))
    snapshot = Snapshot(scene, head["steps"], head["remainder"], needs, state, inputs, geometries)
    return snapshot, time.time() - head["saved_at"]


def _difference(saved: dict[str, Any], now: dict[str, Any]) -> str:
    """The first parameter that differs, empty if none does."""
    for key in sorted(saved.keys() | now.keys()):
        free = key.startswith(_FREE) or _TAKEN.fullmatch(key)
        if saved.get(key) != now.get(key) and not free:
            return f"{key} was {brief(saved.get(key))}, is {brief(now.get(key))}"
    return ""


def _plain(value: Any) -> Any:
    return tuple(value) if isinstance(value, list) else value
