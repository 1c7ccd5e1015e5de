"""Natural and plastic curvature of a simulated cable, and how they move with it.

The natural shape of a scene is rows of the curvature vector [1/m] (3) and the twist [rad/m] at the
samples of its model, shape (spans, samples, 4), in the frame of the start's end effector. Where
twist acts on the shape it follows the material frames along the cable; else it turns with the
start's end effector as a whole. Of several strands each has rows in a frame at its own start; as a
whole they turn with the start of the first one.
"""

from __future__ import annotations

import math
from collections.abc import Callable

import numpy as np
from numpy.typing import NDArray

from dlo_sim.compiling.lanes import LANES
from dlo_sim.core import rotations
from dlo_sim.engine import grasps
from dlo_sim.engine.arrays import CURVED, MATERIAL, PLASTICITY
from dlo_sim.methods import between_steps
from dlo_sim.scene.refusal import SceneError
from dlo_sim.simulation.arrays import to_blocks
from dlo_sim.simulation.cable import Cable
from dlo_sim.simulation.model import Model

Array = NDArray[np.float64]
LEAST_ACROSS = 1e-3  # share of the axis


class NaturalShape:
    """The natural shape of a scene in the arrays of its cable.

    Args:
        orientation: of the start's end effector, quaternion x, y, z, w.

    Attributes:
        follows: whether it follows the cable, all of it or that of its plastic part, so that `lay`
            must be called after a change of the shape that is no motion.

    Raises:
        SceneError: the axis of the curvature lies along the cable.
    """

    def __init__(self, cable: Cable, orientation: Array) -> None:
        self._cable, model = cable, cable.model
        self._parts = model.parts
        self._rows = np.zeros((*model.rule.xi.shape, 4))
        self._turning: Array | None = None  # rows that turn with the start, as `turn_natural` wants
        self.follows = model.has(MATERIAL) or model.has(PLASTICITY)
        shaped = [part for part in self._parts if part.model.scene.cable.shaped]
        if not (model.has(CURVED) and shaped):
            return
        for part in shaped:
            tangent = part.model.geometries["start"].tangent
            if model.layout is not None:
                tangent = part.drawn[:, 0]
            self._rows[part.spans] = natural_rows(part.model, tangent)
        if not model.has(MATERIAL):
            rows = weighted(model, self._rows)
            self._turning = to_blocks(rows)
            cable.natural = turned_rows(rows, self._turn(orientation))
            between_steps.turn_natural.code()  # a tick must not have to compile it

    def turn(self, orientation: Callable[[], Array]) -> None:
        """Turn with the start's end effector, which does the work."""
        if self._turning is not None:
            self._cable.turn_natural(self._turning, self._turn(orientation()))

    def turns_along(self, motions: Array) -> tuple[Array, Array]:
        """What turns with the start's end effector, for `stepper.Along`.

        Args:
            motions: of the end effectors in every step, shape (steps, holders, MOTION_SIZE).

        Returns:
            The rows, and the rotation matrix of every step, shape (steps, 9); no rows if nothing
            turns.
        """
        if self._turning is None:
            return np.zeros((0, 0, 4, LANES)), np.zeros((len(motions), 9))
        frames = motions[:, 0, grasps.FRAME : grasps.TURN].reshape(-1, 3, 3)
        turns = np.array([local_turn(one, self._cable.model.axes) for one in frames])
        return self._turning, turns.reshape(-1, 9)

    def places(self, strand: int = 0) -> Array:
        """Material coordinates [m] of a strand whose material frames `lay` needs: the start and the
        samples.
        """
        model = self._parts[strand].model
        return np.append(0.0, model.sample_shares.ravel() * model.knots[-1])

    def lay(self, orientation: Array, frames: Array, *others: tuple[Array, Array]) -> None:
        """Lay it along the present shape, without plastic flow yet.

        Args:
            orientation: of the start's end effector. frames: at `places`, quaternions (m, 4).
            others: both for each further strand, an orientation in whose frame are its rows.
        """
        cable, model = self._cable, self._cable.model
        rows = turned_rows(self._rows, self._turn(orientation))
        samples = np.tile([0.0, 0.0, 0.0, 1.0], (*model.rule.xi.shape, 1))
        strands = zip(self._parts, ((orientation, frames), *others), strict=True)
        for here, (start, own) in ((part.spans, given) for part, given in strands):
            samples[here] = own[1:].reshape(samples[here].shape)
            if model.has(MATERIAL):
                rows[here] = rows_in_frames(self._rows[here], start, own[0], samples[here])
        if model.has(MATERIAL):
            cable.natural = weighted(model, rows)
        if model.has(PLASTICITY):
            tangents = rotations.rotate(samples.reshape(-1, 4), np.array([1.0, 0.0, 0.0]))
            cable.plastic = unslipped(model, rows, tangents.reshape(*rows.shape[:2], 3))
        cable.open_frame()

    def equals(self, other: NaturalShape) -> bool:
        """Whether `Cable.take_over_samples` takes over the natural shape from the other one."""
        both = self, other
        terms = {one._cable.terms & (MATERIAL | PLASTICITY) for one in both}
        cables = ([part.model.scene.cable for part in one._parts] for one in both)
        shapes = {tuple((c.natural_shape, c.rest_curvature_axis) for c in of) for of in cables}
        shares = [one._cable.model.elastic_share for one in both]
        same = len(terms) == len(shapes) == 1
        return same and (min(shares) > 0.0 or max(shares) == 0.0)

    def _turn(self, orientation: Array) -> Array:
        """Rotation matrix of the start's end effector, in the coordinates of the lines."""
        return local_turn(rotations.to_matrix(orientation), self._cable.model.axes)


def natural_rows(model: Model, tangent: Array) -> Array:
    """Rows where the cable leaves the start's end effector, in whose frame it has this unit
    tangent.

    Raises:
        SceneError: the axis lies along the cable.
    """
    cable, share = model.scene.cable, model.sample_shares

    def along(values: tuple[float, ...]) -> Array:
        return np.interp(share, np.linspace(0.0, 1.0, len(values)), values)[..., None]

    axis = np.array(cable.rest_curvature_axis)
    aside = np.cross(tangent, axis)
    across = math.hypot(*aside)
    if across < LEAST_ACROSS and (model.has(MATERIAL) or any(cable.rest_curvature_2)):
        raise SceneError(
            f"cable.rest_curvature_axis: {axis.tolist()} lies along the cable where it leaves the "
            "start, and bends nothing; give an axis across it"
        )
    bent = along(cable.rest_curvature) * axis / math.hypot(*axis)
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
    return np.concatenate([_turned(rows, turn), rows[..., 3:]], axis=-1)


def _turned(rows: Array, turn: Array) -> Array:
    return np.asarray(np.einsum("ij,smj->smi", turn, rows[..., :3]))


def local_turn(turn: Array, axes: tuple[int, ...]) -> Array:
    """A rotation matrix whose results are in the coordinates of the lines.

    In planar motion the third component is the one about the normal e_a x e_b of the two lines.
    """
    if len(axes) == 3:
        return turn
    normal = np.cross(np.eye(3)[axes[0]], np.eye(3)[axes[1]])
    return np.array([np.zeros(3), np.zeros(3), (normal[:, None] * turn).sum(axis=0)])


def rows_in_frames(rows: Array, start: Array, first: Array, frames: Array) -> Array:
    """The rows with their vectors carried along the cable by its material frames.

    Args:
        start: orientation (4,) of the end effector in whose frame they are; first: of the material
            frame there, x along the cable. frames: at the samples, (spans, samples, 4).
    """
    inside = rotations.multiply(rotations.conjugate(first), start)
    vectors = _turned(rows, rotations.to_matrix(inside))
    vectors[..., 0] = 0.0  # what points along the cable does not bend it
    turn = rotations.to_matrix(frames.reshape(-1, 4)).reshape(*frames.shape[:2], 3, 3)
    return np.concatenate([np.einsum("smij,smj->smi", turn, vectors), rows[..., 3:]], axis=-1)
