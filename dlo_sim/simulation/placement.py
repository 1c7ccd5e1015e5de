"""Putting a cable into its first shape: straight, an arc, or at rest under its loads."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np

from dlo_sim.kernels import layout
from dlo_sim.kernels.instant import stiffness_band
from dlo_sim.scene.description import Scene
from dlo_sim.scene.loading import SceneError
from dlo_sim.scene.needs import frenet_wanted, inextensible, needs_of
from dlo_sim.simulation import statics, workspace
from dlo_sim.simulation.ends import EndDrive
from dlo_sim.simulation.geometry import EndGeometry, first_shape
from dlo_sim.simulation.inextensible import (
    largest_constrained_frequency,
    to_equilibrium,
    to_rest_length,
)
from dlo_sim.simulation.model import Model, build_model


def place(
    scene: Scene,
    geometries: Mapping[str, EndGeometry],
    ends: EndDrive,
    model: Model,
    state: layout.State,
    work: layout.Work,
    solver: layout.Solver,
) -> None:
    """Write a scene's first shape, at rest, into `state`.

    Raises:
        SceneError: no equilibrium was found, or an inextensible cable cannot reach both ends.
    """
    points = np.zeros((model.n, 4))
    points[:, :3] = first_shape(scene, geometries, model.knots)
    ends.put(points, 0.0)
    state.position[:, : model.n] = model.to_rows(points)
    constrained = inextensible(scene)
    if wants_equilibrium(scene, geometries):
        if frenet_wanted(scene):
            raise SceneError(
                "initial.shape: no equilibrium is available with terms.twist frenet; use straight"
            )
        if constrained:
            _relax_elastic(scene, geometries, model, state)
        elif not statics.relax(model, state, work, solver):
            raise SceneError(
                "initial.shape: no equilibrium found from the first guess; use straight, or check "
                "the ends' positions, tangents and the stiffness"
            )
    if constrained and not to_rest_length(model, state):
        raise SceneError(
            "integrator.method: rattle keeps the cable at its length, which does not fit between "
            "its ends; move the ends or use energy_momentum and terms.stretch auto"
        )
    if constrained and wants_equilibrium(scene, geometries):
        frequency = _frequency(model, state, work, solver)
        if not to_equilibrium(model, state, work, min(0.5 / frequency, 5e-3)):
            raise SceneError(
                "initial.shape: no equilibrium of the inextensible cable found; use straight, more "
                "control points, or energy_momentum"
            )
    state.w[:] = 0.0
    state.history[:] = 0.0


def wants_equilibrium(scene: Scene, geometries: Mapping[str, EndGeometry]) -> bool:
    """Whether the first shape is the one at rest: as the scene says, or for a slack held cable."""
    if scene.initial.shape != "auto":
        return scene.initial.shape == "equilibrium"
    if not (scene.start.held and scene.end.held):
        return False
    gap = float(np.linalg.norm(geometries["end"].attachment - geometries["start"].attachment))
    return gap < scene.cable.length * (1.0 - 1e-6)


def _frequency(
    model: Model, state: layout.State, work: layout.Work, solver: layout.Solver
) -> float:
    """Largest frequency [rad/s] of motion that keeps the length."""
    stiffness_band(state.position, model.stiffness_terms, model.viscosity, work, solver)
    return max(largest_constrained_frequency(model, solver.band, state.position), 1e-3)


def _relax_elastic(
    scene: Scene, geometries: Mapping[str, EndGeometry], model: Model, state: layout.State
) -> None:
    """Equilibrium with the true axial stiffness, close to that of the inextensible cable."""
    elastic = scene.with_values({"integrator.method": "energy_momentum", "terms.stretch": "auto"})
    twin = build_model(elastic, needs_of(elastic), geometries)
    shape = workspace.new_state(twin)
    shape.position[:, :] = state.position
    statics.relax(twin, shape, workspace.new_work(twin), workspace.new_solver(twin))
    state.position[:, :] = shape.position
