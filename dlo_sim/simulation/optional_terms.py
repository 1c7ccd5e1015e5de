"""Terms that only some scenes ask for: what they leave behind, and which combinations exist."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from dlo_sim.compiling.lanes import LANES
from dlo_sim.core import bspline
from dlo_sim.core.methods import CONSTRAINED, RUNGE_KUTTA, SPLITTING, ZHAI, Method
from dlo_sim.engine import layout
from dlo_sim.scene.description import Scene
from dlo_sim.scene.loading import SceneError
from dlo_sim.scene.needs import Needs, frenet_wanted, inextensible, plasticity_wanted
from dlo_sim.simulation.cable import Cable
from dlo_sim.simulation.model import Model
from dlo_sim.simulation.report import UndefinedTorsion

Array = NDArray[np.float64]


def sample_coordinates(model: Model) -> Array:
    """Material coordinate of every sample as a share of the length, shape (spans, samples)."""
    ends = bspline.breaks(model.knots)
    u = ends[:-1, None] + 0.5 * (model.rule.xi + 1.0) * np.diff(ends)[:, None]
    return np.asarray(u / ends[-1])


def _by_sample(cable: Cable, offset: int, rows: int) -> Array:
    """Rows of every sample, a copy of shape (spans, samples, rows)."""
    shape = cable.model.shape
    blocks, samples = int(shape[layout.BLOCKS]), int(shape[layout.SAMPLES])
    at = int(shape[offset])
    values = cable.state[at : at + blocks * samples * rows * LANES]
    lanes = values.reshape(blocks, samples, rows, LANES).transpose(0, 3, 1, 2)
    return lanes.reshape(-1, samples, rows)[: cable.model.n - bspline.DEGREE]


def _put_by_sample(cable: Cable, offset: int, values: Array) -> None:
    """Write what `_by_sample` reads."""
    shape = cable.model.shape
    blocks, (_, samples, rows) = int(shape[layout.BLOCKS]), values.shape
    padded = np.zeros((blocks * LANES, samples, rows))
    padded[: len(values)] = values
    lanes = padded.reshape(blocks, LANES, samples, rows).transpose(0, 2, 3, 1)
    at = int(shape[offset])
    cable.state[at : at + lanes.size] = lanes.ravel()


def carry_plastic(old: Cable, new: Cable) -> None:
    """Take over another cable's plastic curvature, linear between its samples."""
    if not (old.model.has(layout.PLASTICITY) and new.model.has(layout.PLASTICITY)):
        return
    source, target = sample_coordinates(old.model), sample_coordinates(new.model)
    known = old.model.rule.weights != 0.0
    order = np.argsort(source[known], kind="stable")
    values = _by_sample(old, layout.PLASTIC, layout.PLASTIC_ROWS)
    out = np.empty((*target.shape, layout.PLASTIC_ROWS))
    for row in range(layout.PLASTIC_ROWS):
        out[..., row] = np.interp(target, source[known][order], values[..., row][known][order])
    _put_by_sample(new, layout.PLASTIC, out)
    stiffness = new.model.bending_stiffness[:, None, None]
    moments = stiffness * new.model.rule.weights[..., None] * out[..., :3]
    _put_by_sample(new, layout.NATURAL, moments)


def undefined_torsion(scene: Scene, cable: Cable) -> UndefinedTorsion:
    """What the ledger says about samples without torsion."""
    if not cable.model.has(layout.TORSION):
        return UndefinedTorsion(0, 0, 0.0, 0, 0.0)
    return UndefinedTorsion(
        samples=int(np.count_nonzero(cable.model.rule.weights)),
        last=int(cable.entry(layout.TORSION_LAST)),
        mean=cable.entry(layout.TORSION_SUM) / max(cable.entry(layout.TORSION_LOOKS), 1.0),
        worst=int(cable.entry(layout.TORSION_WORST)),
        floor=scene.curvature_floor,
    )


def check_terms(scene: Scene, needs: Needs) -> None:
    """Refuse terms, and combinations of them, that have no meaning here.

    Raises:
        SceneError: naming the key and the cure.
    """
    if needs.contact and not scene.obstacles:
        raise SceneError("terms.contact: 'on' needs obstacles; name one in obstacles.names")
    if scene.terms.twist == "quasistatic":
        raise SceneError("terms.twist: 'quasistatic' is not available in this version; use bishop")
    if scene.terms.stretch == "on" and inextensible(scene):
        raise SceneError(
            "terms.stretch: 'on' contradicts integrator.method rattle, whose constraints keep the "
            "length; set terms.stretch to auto or use another method"
        )
    if scene.terms.out_of_plane == "off" and len(needs.axes) == 3:
        if needs.frenet or needs.plasticity:
            raise SceneError(
                "terms.out_of_plane: 'off' is not available with Frenet torsion or plasticity; set "
                "it to auto"
            )
        raise SceneError(
            "terms.out_of_plane: 'off' needs ends that lie, and point, in one coordinate plane; "
            "move them or set it to auto"
        )
    if needs.plasticity and not scene.plasticity.yield_curvature:
        raise SceneError(
            "terms.plasticity: 'on' needs plasticity.yield_curvature above 0; give one or set "
            "terms.plasticity off"
        )
    if needs.plasticity and not needs.bend:
        raise SceneError(
            "terms.plasticity: bends nothing, since terms.bend is off; set one of them"
        )
    if needs.plasticity and any(scene.cable.rest_curvature):
        raise SceneError(
            "cable.rest_curvature: is not available together with terms.plasticity; set it to "
            "[0.0] or terms.plasticity to off"
        )


def check_method(scene: Scene, method: Method) -> None:
    """Refuse a method that does not know the scene's terms.

    Raises:
        SceneError: naming the key and the cure.
    """
    if method.family == CONSTRAINED and scene.measured.type != "none":
        raise SceneError(
            f"measured.type: {scene.measured.type} is not available with integrator.method "
            f"{method.name}, whose constraints a correction breaks; use energy_momentum"
        )
    if method.family in (SPLITTING, RUNGE_KUTTA, ZHAI):
        return
    for wanted, key, value in (
        (frenet_wanted(scene), "terms.twist", "frenet"),
        (plasticity_wanted(scene), "terms.plasticity", "on"),
    ):
        if wanted:
            raise SceneError(
                f"integrator.method: {method.name} does not know {key} {value}; use "
                f"velocity_verlet, rk4 or forest_ruth"
            )
