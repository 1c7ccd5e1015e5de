"""Putting a cable into its first shape: straight, an arc, or at rest under its loads."""

from __future__ import annotations

from collections.abc import Callable
from itertools import pairwise

import numpy as np
from numpy.typing import NDArray

from dlo_sim.core import bspline
from dlo_sim.engine.arrays import CONTACT, CURVED
from dlo_sim.methods import rattle
from dlo_sim.scene.description import Scene
from dlo_sim.scene.loading import SceneError
from dlo_sim.scene.needs import frenet_wanted, inextensible, needs_of
from dlo_sim.simulation import statics
from dlo_sim.simulation.build_model import build_model
from dlo_sim.simulation.cable import Cable
from dlo_sim.simulation.ends import EndDrive
from dlo_sim.simulation.geometry import Geometries, first_shape, held_places
from dlo_sim.simulation.model import Model
from dlo_sim.simulation.soundness import leaves_clamp_backwards

Array = NDArray[np.float64]
PLACES = 101  # of the cable that are looked at


def place(
    scene: Scene,
    geometries: Geometries,
    ends: EndDrive,
    cable: Cable,
    lay: Callable[[], None] | None = None,
) -> None:
    """Put a cable into the scene's first shape, at rest. Without equilibrium it is straight, or an
    arc where its ends are nearer than its length; or where the arc would leave a clamp backwards,
    the shape of grippers that moved together. `lay` aligns the natural shape with the
    material frames of the present shape and lets plastic flow follow; None if there is neither.
    Where the twist that a natural shape causes is not found, the cable is only placed close to
    rest, with a UserWarning.

    Raises:
        SceneError: no equilibrium was found, an inextensible cable cannot reach both ends, or the
            cable begins in an obstacle.
    """
    points = np.zeros((cable.model.n, 4))
    points[:, :3] = first_shape(scene, geometries, cable.model.knots)
    backwards = leaves_clamp_backwards(points, ends)
    ends.put(points, 0.0, anew=True)
    cable.put(points, np.zeros_like(points), 0.0)
    if lay:
        lay()
    constrained, resting = inextensible(scene), wants_equilibrium(scene, geometries)
    if resting and frenet_wanted(scene):
        raise SceneError(
            "initial.shape: no equilibrium is available with terms.twist frenet; use straight"
        )
    if resting and constrained:
        _relax_elastic(scene, geometries, cable)
    elif resting:
        statics.find(scene, geometries, ends, cable, lay)
    elif backwards and not constrained and not frenet_wanted(scene):
        # An arc that is folded at a clamp would stay so.
        if not statics.follow(scene, geometries, ends, cable, lay):
            cable.put(points, np.zeros_like(points), 0.0)
    if constrained and not cable.call(rattle.to_rest_length):
        apart = float(np.linalg.norm(cable.points[-1, :3] - cable.points[0, :3]))
        raise SceneError(
            f"integrator.method: rattle keeps the cable at its length, {scene.cable.length:.6g} m, "
            f"which does not fit between its ends, {apart:.6g} m apart; move the ends or use "
            "energy_momentum and terms.stretch auto"
        )
    if constrained and resting and not statics.find_inextensible(scene, ends, cable, lay):
        raise SceneError(statics.cause(scene, cable))
    if lay:
        lay()
    points = cable.points
    _check_obstacles(scene, cable.model, points[:, :3])
    cable.put(points, np.zeros_like(points))


def _check_obstacles(scene: Scene, model: Model, points: Array) -> None:
    """Refuse a cable that begins deeper in an obstacle than it is thick: it would be flung out."""
    if not model.has(CONTACT):
        return
    u = np.linspace(0.0, scene.cable.length, PLACES)
    line = bspline.evaluate(points, model.knots, u)
    for obstacle in scene.obstacles:
        depth = -(line + model.origin - np.array(obstacle.position)) @ np.array(obstacle.normal)
        worst = int(np.argmax(depth))
        if depth[worst] > scene.cable.diameter:
            raise SceneError(
                f"obstacles.{obstacle.name}.position: the cable begins {depth[worst]:.3g} m inside "
                f"it, at {u[worst]:.3g} m; move the obstacle or the cable's ends"
            )


def wants_equilibrium(scene: Scene, geometries: Geometries) -> bool:
    """Whether the first shape is the one at rest: as the scene says, or for a cable that is held at
    places which are nearer together or farther apart than it is long.
    """
    if scene.initial.shape != "auto":
        return scene.initial.shape == "equilibrium"
    for (begin, one), (end, other) in pairwise(held_places(scene, geometries)):
        gap = float(np.linalg.norm(other.attachment - one.attachment))
        if abs(gap - (end - begin)) > 1e-6 * (end - begin):
            return True
    return False


def _relax_elastic(scene: Scene, geometries: Geometries, cable: Cable) -> None:
    """Equilibrium with the true axial stiffness, close to that of the inextensible cable."""
    elastic = scene.with_values({"integrator.method": "energy_momentum", "terms.stretch": "auto"})
    twin = Cable(build_model(elastic, needs_of(elastic), geometries, cable.model.origin))
    twin.inputs[:] = cable.inputs
    twin.point_grasps(0.0)
    if twin.anchors.size:
        twin.anchors[:] = cable.anchors
    points = cable.points
    twin.put(points, np.zeros_like(points))
    if twin.model.has(CURVED):
        twin.natural = cable.natural
    statics.relax(twin)
    statics.relax_twist(twin)
    cable.x[:] = twin.x
    cable.open_frame()
