"""A scene with and without each of its terms."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from dlo_sim.core import rotations
from dlo_sim.core.end_motion import EndMotion
from dlo_sim.scene.description import Scene
from dlo_sim.scene.loading import SceneError
from dlo_sim.simulation.simulator import Simulator
from dlo_sim.tuning.trial import Job

FREE = {"start.spring": [0.0] * 3, "end.spring": [0.0] * 3}
# Term -> what puts it in, what takes it out; None where there is no such thing.
Values = dict[str, object]
TERMS: dict[str, tuple[Values | None, Values]] = {
    "stretch": ({"terms.stretch": "on"}, {"integrator.method": "rattle", "integrator.step": 0.0}),
    "bend": ({"terms.bend": "on"}, {"terms.bend": "off"}),
    "twist": ({"terms.twist": "on", "terms.out_of_plane": "on"}, {"terms.twist": "off"}),
    "gravity": ({"terms.gravity": "on"}, {"terms.gravity": "off"}),
    "damping": (None, {"terms.damping": "off"}),
    "out_of_plane": ({"terms.out_of_plane": "on"}, {"terms.out_of_plane": "off"}),
    "springs": (None, {"start.fixed": [True] * 3, "end.fixed": [True] * 3, **FREE}),
    "loads": (None, {"loads.names": []}),
}
MOVED, TURNED, MOVING = 0.15, 1.0, 0.5  # [m], [rad], [s]: what grippers do


@dataclass(frozen=True, eq=False)
class Variant:
    """A term of a scene, with and without.

    Attributes:
        term: its name. automatic: whether the scene's own step contains it.
        reason: why it was left out, or empty.
        full, bare: the scene with it and without it; None where that does not exist.
    """

    term: str
    automatic: bool
    reason: str
    full: Scene | None
    bare: Scene | None


def variants(scene: Scene) -> list[Variant]:
    """Every term of a scene with and without; one of the two is the scene as it is."""
    simulator = Simulator(scene)
    active = set(simulator.active_terms)
    if len(simulator.model.axes) == 3:
        active.add("out_of_plane")
    found = []
    for term, (put_in, take_out) in TERMS.items():
        if term in active:
            if term == "out_of_plane" and scene.gravity[1] == 0.0 and scene.loads:
                take_out = {**take_out, "loads.names": []}
            found.append(Variant(term, True, "", scene, _changed(scene, take_out)))
        else:
            reason = simulator.left_out.get(term, "")
            full = None if put_in is None else _changed(scene, put_in)
            found.append(Variant(term, False, reason, full, scene))
    return found


def _changed(scene: Scene, values: Values) -> Scene | None:
    try:
        return scene.with_values(values)
    except SceneError:
        return None


def job(scene: Scene, duration: float) -> Job:
    """A scene's run: grippers that are driven move sideways and turn about the cable."""
    motions = []
    if scene.start.driven and scene.start.held:
        path = np.zeros((3, 3))
        path[0] = scene.start.position
        path[1, 1] = MOVED / MOVING
        axis = np.asarray(scene.start.tangent, dtype=float)
        turn = np.zeros((2, 3))
        turn[0] = TURNED / MOVING * axis / max(float(np.linalg.norm(axis)), 1e-300)
        still = np.asarray(rotations.IDENTITY, dtype=float)
        motions.append(("start", EndMotion(0.0, MOVING, path, still, turn)))
    return Job(scene, duration, tuple(np.linspace(0.0, 1.0, 21)), 2e-3, tuple(motions))
