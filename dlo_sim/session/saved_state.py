"""The state of a session in a file, to go on from after its process was ended, however it was.

The file is written beside its place and put there whole, so that it is never half a state.
"""

from __future__ import annotations

import dataclasses
import json
import os
import re
import time
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from dlo_sim import __version__
from dlo_sim.core.arguments import count, number, numbers
from dlo_sim.process.atomic_output import write_atomically
from dlo_sim.scene.description import Scene, scene_values
from dlo_sim.scene.needs import Needs
from dlo_sim.scene.refusal import SceneError, brief

if TYPE_CHECKING:
    from dlo_sim.simulation.simulator import Snapshot

Array = NDArray[np.float64]
_VECTORS = {"position": 3, "orientation": 4, "attachment": 3, "tangent": 3}  # of a geometry
# Groups whose parameters may differ: they do not change what the state means.
_FREE = ("inputs.", "outputs.", "state.")
_TAKEN = re.compile(r"grasps\..*\.taken")  # is part of the state


def save_state(path: Path, state: Snapshot) -> None:
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


def load_state(path: Path, scene: Scene) -> tuple[Snapshot, float] | None:
    """The state that was saved of this scene, and how long ago [s]; None if there is no file.

    The grasps of its scene hold the cable as they did.

    Raises:
        SceneError: it is no state, or one of another scene or version; with the cure.
    """
    cure = "remove the file, or give state.save_to another name"
    try:
        with np.load(path, allow_pickle=False) as file:
            head, state, inputs = json.loads(str(file["head"])), file["state"], file["inputs"]
        unfit = _unfit(head, scene)
        if not unfit:
            return _snapshot(head, scene, state, inputs), time.time() - head["saved_at"]
    except FileNotFoundError:
        return None
    except OSError as error:
        raise SceneError(
            f"state.save_to: {path} cannot be read ({error.strerror or error}); {cure}"
        ) from None
    except Exception:  # there is no end of what numpy, zipfile and json make of a damaged file
        raise SceneError(
            f"state.save_to: {path} is no saved state, or a damaged one; {cure}"
        ) from None
    raise SceneError(f"state.save_to: {path} is of {unfit}; {cure}")


def _unfit(head: dict[str, Any], scene: Scene) -> str:
    """What a state is of that is not of this program and scene; empty if it is."""
    if head["version"] != __version__:
        return f"dlo_sim {head['version']}"
    saved, now = head["scene"], json.loads(json.dumps(scene_values(scene)))
    for key in sorted(saved.keys() | now.keys()):
        before, value = saved.get(key), now.get(key)
        if before != value and not (key.startswith(_FREE) or _TAKEN.fullmatch(key)):
            return f"another scene ({key} was {brief(before)}, is {brief(value)})"
    return ""


def _snapshot(head: dict[str, Any], scene: Scene, state: Array, inputs: Array) -> Snapshot:
    """The state of a file.

    Raises:
        ValueError, TypeError, KeyError: its numbers do not fit together.
    """
    from dlo_sim.simulation.build_model import build_model
    from dlo_sim.simulation.geometry import Geometry  # these bring the compiler along
    from dlo_sim.simulation.simulator import Snapshot

    plain: dict[str, Any] = {
        k: tuple(v) if isinstance(v, list) else v for k, v in head["needs"].items()
    }
    needs = Needs(**plain)
    geometries = {}
    for name in scene.holders:
        *vectors, u = head["geometries"][name]
        shaped = {
            key: numbers(key, vector, (size,))
            for (key, size), vector in zip(_VECTORS.items(), vectors, strict=True)
        }
        geometries[name] = Geometry(**shaped, u=None if u is None else number("u", u))
    taken = (replace(g, taken=geometries[g.name].u is not None) for g in scene.grasps)
    scene = replace(scene, grasps=tuple(taken))
    sizes = build_model(scene, needs, geometries).sizes
    return Snapshot(
        scene,
        count("steps", head["steps"]),
        number("remainder", head["remainder"]),
        needs,
        numbers("state", state, (sizes["state"],)),
        numbers("inputs", inputs, (sizes["inputs"],)),
        geometries,
    )
