"""Terms that only some scenes ask for: Frenet torsion and plastic bending."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from dlo_sim.core import bspline, mass, spectrum
from dlo_sim.core.methods import RUNGE_KUTTA, SPLITTING, ZHAI, Method
from dlo_sim.kernels import layout
from dlo_sim.scene.description import Scene
from dlo_sim.scene.loading import SceneError
from dlo_sim.scene.needs import Needs, frenet_wanted, inextensible, plasticity_wanted
from dlo_sim.simulation.report import UndefinedTorsion

Array = NDArray[np.float64]


def frenet_term(scene: Scene, lattice: layout.Lattice) -> layout.Frenet:
    """Twist against the Frenet torsion."""
    shape = (lattice.xi.shape[0], 3, layout.LANES)
    return layout.Frenet(
        stiffness=scene.cable.GJ,
        floor=scene.curvature_floor**2,
        angle=np.zeros(shape),
        angle_gradient=np.zeros(shape),
    )


def plastic_term(scene: Scene, lattice: layout.Lattice) -> layout.Plastic:
    """Plastic bending of a virgin cable; H = EI h / (1 - h) gives the tangent stiffness h EI."""
    share = scene.plasticity.hardening
    blocks, samples, lanes = lattice.xi.shape
    return layout.Plastic(
        stiffness=scene.cable.EI,
        hardening=scene.cable.EI * share / (1.0 - share),
        yield_moment=scene.cable.EI * scene.plasticity.yield_curvature,
        curvature=np.zeros((blocks, samples, 3, lanes)),
        tangent=np.zeros((blocks, samples, 3, lanes)),
    )


def sample_coordinates(lattice: layout.Lattice) -> Array:
    """Material coordinate of every sample as a share of the length, shape like Lattice.xi."""
    n_spans = lattice.n - bspline.DEGREE
    blocks = lattice.xi.shape[0]
    span = np.arange(blocks * layout.LANES).reshape(blocks, 1, layout.LANES)
    return np.asarray(np.clip((span + 0.5 * (lattice.xi + 1.0)) / n_spans, 0.0, 1.0))


def carry_plastic(old: layout.Terms, new: layout.Terms) -> None:
    """Take over another model's plastic curvature, linear between its samples."""
    if old.plastic is None or new.plastic is None:
        return
    source, target = sample_coordinates(old.lattice), sample_coordinates(new.lattice)
    known = old.lattice.weights != 0.0
    order = np.argsort(source[known], kind="stable")
    for values, out in (
        (old.plastic.curvature, new.plastic.curvature),
        (old.plastic.tangent, new.plastic.tangent),
    ):
        for axis in range(3):
            out[:, :, axis] = np.interp(
                target, source[known][order], values[:, :, axis][known][order]
            )


def with_torsion(value: float, frenet: layout.Frenet, knots: Array, inertia: layout.Mass) -> float:
    """Upper bound of the largest frequency [rad/s] once the Frenet torsion is there.

    For a bent cable gamma is linear in the third derivative across the plane of bending, with the
    factor kappa / (kappa^2 + delta^2) <= 1 / (2 delta). So the torsion adds at most
    GJ / (4 delta^2) integral y'''^2 and GJ integral theta'^2, and the largest eigenvalue of a sum
    is at most the sum of the largest ones. The geometric part, which grows with the torque and
    without bound as delta -> 0, is left out: where it matters the run diverges and says so.
    """
    across = frenet.stiffness / (4.0 * frenet.floor) * mass.gram(knots, 3)
    twist = frenet.stiffness * mass.gram(knots, 1)
    squares = value * value
    for band, row in ((across, 0), (twist, -1)):
        squares += _frequency(band, inertia.band[row]) ** 2
    return float(np.sqrt(squares))


def _frequency(stiffness: Array, inertia: Array) -> float:
    """Largest frequency [rad/s] of one row of control points, all free; lower diagonals (4, n)."""
    n = inertia.shape[1]
    rows = np.zeros((n, 7))
    for k in range(4):
        rows[: n - k, 3 + k] = stiffness[k, : n - k]
        rows[k:, 3 - k] = stiffness[k, : n - k]
    return spectrum.largest_frequency(rows, inertia[None], np.ones((1, n), dtype=bool))


def undefined_torsion(terms: layout.Terms, ledger: Array) -> UndefinedTorsion:
    """What the ledger says about samples without torsion."""
    if terms.frenet is None:
        return UndefinedTorsion(0, 0, 0.0, 0, 0.0)
    return UndefinedTorsion(
        samples=int(np.count_nonzero(terms.lattice.weights)),
        last=int(ledger[layout.TORSION_LAST]),
        mean=float(ledger[layout.TORSION_SUM] / max(ledger[layout.TORSION_LOOKS], 1.0)),
        worst=int(ledger[layout.TORSION_WORST]),
        floor=float(np.sqrt(terms.frenet.floor)),
    )


def check_terms(scene: Scene, needs: Needs) -> None:
    """Refuse terms, and combinations of them, that have no meaning here.

    Raises:
        SceneError: naming the key and the cure.
    """
    if scene.terms.contact == "on":
        raise SceneError("terms.contact: 'on' is not available in this version; use auto or off")
    if scene.terms.twist == "quasistatic":
        raise SceneError(
            "terms.twist: 'quasistatic' is not available in this version; use auto, on or frenet"
        )
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
