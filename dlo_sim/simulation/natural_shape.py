"""Natural curvature and rest twist of a scene at the samples of its model: rows of the curvature
vector [1/m] (3) and the twist [rad/m], shape (spans, samples, 4).
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from dlo_sim.core import rotations
from dlo_sim.engine.arrays import CURVED, MATERIAL
from dlo_sim.scene.description import Scene
from dlo_sim.scene.refusal import SceneError
from dlo_sim.simulation.model import Model

Array = NDArray[np.float64]
LEAST_ACROSS = 1e-3  # share of the axis


def has_natural_shape(scene: Scene, model: Model) -> bool:
    """Whether the cable is bent or twisted at rest, apart from what plastic flow makes of it."""
    return model.has(CURVED) and scene.cable.shaped


def natural_rows(scene: Scene, model: Model, tangent: Array) -> Array:
    """Rows where the cable leaves the start's end effector, in whose frame it has this unit
    tangent.

    Raises:
        SceneError: the axis lies along the cable.
    """
    cable, share = scene.cable, model.sample_shares

    def along(values: tuple[float, ...]) -> Array:
        return np.interp(share, np.linspace(0.0, 1.0, len(values)), values)[..., None]

    axis = np.array(cable.rest_curvature_axis)
    aside = np.cross(tangent, axis)
    across = float(np.linalg.norm(aside))
    if across < LEAST_ACROSS and (model.has(MATERIAL) or any(cable.rest_curvature_2)):
        raise SceneError(
            f"cable.rest_curvature_axis: {axis.tolist()} lies along the cable where it leaves the "
            "start, and bends nothing; give an axis across it"
        )
    bent = along(cable.rest_curvature) * axis / np.linalg.norm(axis)
    bent = bent + along(cable.rest_curvature_2) * aside / max(across, LEAST_ACROSS)
    return np.concatenate([bent, along(cable.rest_twist)], axis=-1)


def weighted(model: Model, rows: Array) -> Array:
    """Rows of `Cable.natural`: the vectors times quadrature weight and EI; of a plastic cable with
    h EI, the stiffness of its elastic part (`engine.plasticity`).
    """
    weights = model.elastic_share * model.moment_weights
    return np.concatenate([weights * rows[..., :3], rows[..., 3:]], axis=-1)


def unslipped(model: Model, rows: Array, tangents: Array) -> Array:
    """Rows of `Cable.plastic` before any plastic flow, at no curvature; tangents: unit, shape
    (spans, samples, 3).
    """
    bent = rows[..., :3]
    across = bent - tangents * (tangents * bent).sum(axis=-1, keepdims=True)
    plastic = (1.0 - model.elastic_share) * across
    return np.concatenate([plastic, tangents, np.zeros_like(tangents)], axis=-1)


def turned_rows(rows: Array, turn: Array) -> Array:
    """The rows with their vectors turned by a matrix (3, 3)."""
    return np.concatenate([rows[..., :3] @ turn.T, rows[..., 3:]], axis=-1)


def local_turn(turn: Array, axes: tuple[int, ...]) -> Array:
    """A rotation matrix whose results are in the coordinates of the lines.

    In planar motion the third component is the one about the normal e_a x e_b of the two lines.
    """
    if len(axes) == 3:
        return turn
    normal = np.cross(np.eye(3)[axes[0]], np.eye(3)[axes[1]])
    return np.array([np.zeros(3), np.zeros(3), normal @ turn])


def rows_in_frames(rows: Array, start: Array, first: Array, frames: Array) -> Array:
    """The rows with their vectors carried along the cable by its material frames.

    Args:
        start: orientation (4,) of the end effector in whose frame they are; first: of the material
            frame there, x along the cable. frames: at the samples, (spans, samples, 4).
    """
    inside = rotations.multiply(rotations.conjugate(first), start)
    vectors = rows[..., :3] @ rotations.to_matrix(inside).T
    vectors[..., 0] = 0.0  # what points along the cable does not bend it
    turn = rotations.to_matrix(frames.reshape(-1, 4)).reshape(*frames.shape[:2], 3, 3)
    return np.concatenate([np.einsum("smij,smj->smi", turn, vectors), rows[..., 3:]], axis=-1)
