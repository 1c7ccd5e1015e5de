"""Putting a cable into its first shape: straight, an arc, or at rest under its loads."""

from __future__ import annotations

from collections.abc import Callable
from itertools import pairwise

import numpy as np
from numpy.typing import NDArray

from dlo_sim.core import bspline
from dlo_sim.core.methods import METHODS
from dlo_sim.engine import layout
from dlo_sim.methods import rattle
from dlo_sim.scene.description import Scene
from dlo_sim.scene.loading import SceneError
from dlo_sim.scene.needs import frenet_wanted, inextensible, needs_of
from dlo_sim.simulation import statics
from dlo_sim.simulation.build_model import build_model, grading
from dlo_sim.simulation.cable import Cable
from dlo_sim.simulation.ends import EndDrive
from dlo_sim.simulation.frequency import largest_frequency
from dlo_sim.simulation.geometry import Geometries, first_shape, held_places
from dlo_sim.simulation.model import Model
from dlo_sim.simulation.settling import settle
from dlo_sim.simulation.stepper import loop_of

Array = NDArray[np.float64]
PLACES = 101  # of the cable that are looked at
SHARE_OF_FALL = (
    0.01  # step of the relaxation, in units of the time in which a cable falls its length
)
TO_REST = 1e-8, 5_000  # movement between two stops, as a share of the length; most steps
INEXTENSIBLE = 1e-7, 40_000
MOST_TURNS, CONTRACTING = 30, 0.7
TURNED = 1e-9  # of the length or of 1 rad, movement after which twist and shape fit


def place(
    scene: Scene,
    geometries: Geometries,
    ends: EndDrive,
    cable: Cable,
    lay: Callable[[], None] | None = None,
) -> None:
    """Put a cable into the scene's first shape, at rest. `lay` aligns the natural shape with the
    material frames of the present shape and lets plastic flow follow; None if there is neither.

    Raises:
        SceneError: no equilibrium was found, an inextensible cable cannot reach both ends, or the
            cable begins in an obstacle.
    """

    def stop() -> None:
        points = cable.model.to_columns(cable.x)
        ends.put(points, 0.0)
        cable.put(points, np.zeros_like(points))
        if lay:
            lay()
        cable.open_account(scene)

    points = np.zeros((cable.model.n, 4))
    points[:, :3] = first_shape(scene, geometries, cable.model.knots)
    ends.put(points, 0.0, anew=True)
    cable.put(points, np.zeros_like(points), 0.0)
    if lay:
        lay()
    constrained, resting = inextensible(scene), wants_equilibrium(scene, geometries)
    if resting:
        if frenet_wanted(scene):
            raise SceneError(
                "initial.shape: no equilibrium is available with terms.twist frenet; use straight"
            )
        if constrained:
            _relax_elastic(scene, geometries, cable)
            if lay:
                lay()
        elif not (_relax(scene, cable, lay, stop) if lay else statics.relax(cable)):
            raise SceneError(
                "initial.shape: no equilibrium found from the first guess; use straight, more "
                "control points or discretization.stretch sample, or check the ends' positions, "
                "tangents and the stiffness"
            )
        if not cable.model.has(layout.MATERIAL):
            statics.relax_twist(cable)
    if constrained and not rattle.to_rest_length(cable.arrays):
        raise SceneError(
            "integrator.method: rattle keeps the cable at its length, which does not fit between "
            "its ends; move the ends or use energy_momentum and terms.stretch auto"
        )
    if constrained and resting:
        frequency = max(largest_frequency(scene, cable), 1e-3)
        loop = loop_of(METHODS["rattle"], scene)
        if not settle(cable, loop, min(0.5 / frequency, 5e-3), stop, *INEXTENSIBLE):
            raise SceneError(
                "initial.shape: no equilibrium of the inextensible cable found; use straight, more "
                "control points, or energy_momentum"
            )
    if lay:
        lay()
    points = cable.model.to_columns(cable.x)
    _check_obstacles(scene, cable.model, points[:, :3])
    cable.put(points, np.zeros_like(points))


def _relax(scene: Scene, cable: Cable, lay: Callable[[], None], stop: Callable[[], None]) -> bool:
    """Whether an equilibrium was found, with plastic flow up to it and, as far as that converges,
    with the twist that natural curvature causes.
    """
    flow = lay if cable.model.has(layout.PLASTICITY) else None
    if not statics.relax(cable, flow):
        flow = None  # of a stiff wire the search with flow may go round in circles
        if not statics.relax(cable):
            return False
    if not cable.model.has(layout.MATERIAL):
        return True
    untwisted = cable.state.copy()
    if not _twisted(cable, stop, flow):
        turned = cable.state.copy()
        cable.state[:] = untwisted
        loop = loop_of(METHODS["energy_momentum"], scene)
        if not settle(cable, loop, SHARE_OF_FALL * _fall(scene), stop, *TO_REST):
            cable.state[:] = turned
    return True


def _twisted(cable: Cable, stop: Callable[[], None], flow: Callable[[], None] | None) -> bool:
    """Solve in turn for the twist that natural curvature causes and for the shape; whether that
    converged.
    """
    last = np.inf
    for _ in range(MOST_TURNS):
        before = cable.x.copy()
        statics.relax_twist(cable)
        stop()
        if not statics.relax(cable, flow):
            return False
        moved = np.abs(cable.x - before).max()
        if moved < TURNED * max(1.0, float(cable.model.knots[-1])):
            return True
        if moved > CONTRACTING * last:
            return False
        last = moved
    return False


def _fall(scene: Scene) -> float:
    """Time [s] in which a cable falls by its length, or its slowest bending vibration."""
    cable = scene.cable
    bending = np.sqrt(cable.EI / cable.mu) / cable.length**2
    gravity = np.sqrt(float(np.linalg.norm(scene.gravity)) / cable.length)
    return float(1.0 / np.hypot(bending, gravity))


def _check_obstacles(scene: Scene, model: Model, points: Array) -> None:
    """Refuse a cable that begins deeper in an obstacle than it is thick: it would be flung out."""
    if not model.has(layout.CONTACT):
        return
    u = np.linspace(0.0, scene.cable.length, PLACES)
    line = bspline.evaluate(points, model.knots, u)
    for obstacle in scene.obstacles:
        depth = -(line - np.array(obstacle.position)) @ np.array(obstacle.normal)
        worst = int(np.argmax(depth))
        if depth[worst] > scene.cable.diameter:
            raise SceneError(
                f"obstacles.{obstacle.name}.position: the cable begins {depth[worst]:.3g} m inside "
                f"it, at {u[worst]:.3g} m; move the obstacle or the cable's ends"
            )


def wants_equilibrium(scene: Scene, geometries: Geometries) -> bool:
    """Whether the first shape is the one at rest: as the scene says, or for a slack held cable."""
    if scene.initial.shape != "auto":
        return scene.initial.shape == "equilibrium"
    for (begin, one), (end, other) in pairwise(held_places(scene, geometries)):
        gap = float(np.linalg.norm(other.attachment - one.attachment))
        if gap < (end - begin) * (1.0 - 1e-6):
            return True
    return False


def _relax_elastic(scene: Scene, geometries: Geometries, cable: Cable) -> None:
    """Equilibrium with the true axial stiffness, close to that of the inextensible cable."""
    elastic = scene.with_values({"integrator.method": "energy_momentum", "terms.stretch": "auto"})
    twin = Cable.new(build_model(elastic, needs_of(elastic), geometries, grading(scene)))
    twin.inputs[:] = cable.inputs
    twin.point_grasps(0.0)
    if twin.anchors.size:
        twin.anchors[:] = cable.anchors
    points = cable.model.to_columns(cable.x)
    twin.put(points, np.zeros_like(points))
    if twin.model.has(layout.CURVED):
        natural = cable.model.samples(cable.state, layout.NATURAL, layout.NATURAL_ROWS)
        twin.model.put_samples(twin.state, layout.NATURAL, natural)
    statics.relax(twin)
    statics.relax_twist(twin)
    cable.x[:] = twin.x
