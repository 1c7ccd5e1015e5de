"""Largest natural frequency of a cable, linearised at its present configuration."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from dlo_sim.core import mass, spectrum
from dlo_sim.engine.arrays import TORSION
from dlo_sim.scene.description import Scene
from dlo_sim.simulation.cable import Cable
from dlo_sim.simulation.model import Model

Array = NDArray[np.float64]
ITERATIONS = 120


def largest_frequency(scene: Scene, cable: Cable) -> float:
    """Largest natural frequency omega [rad/s] of K x = omega^2 M x at the present configuration,
    over the motions that satisfy the constraints of the grasps, by Lanczos iteration: an estimate
    from below, which converges first at this end of the spectrum.
    """
    model = cable.model
    dim = len(model.axes)
    value = _lanczos(cable)
    if model.twist:
        held = model.held_mask()[dim]
        twisting = spectrum.largest_of_line(model.twisting_stiffness, model.mass(dim), ~held)
        value = max(value, twisting)
    if model.has(TORSION):
        value = with_torsion(value, scene, model)
    # Ten digits: LAPACK rounds the others differently on another processor, and steps follow.
    return float(f"{value:.10g}")


def _spatial(cable: Cable) -> Array:
    """Band matrix of the stiffness of the spatial lines alone, shape (n dim, 8 dim)."""
    model, dim = cable.model, len(cable.model.axes)
    band = cable.stiffness().reshape(model.n, model.lines, -1)
    out = np.zeros((model.n, dim, 8 * dim))
    for d, e in np.ndindex(dim, dim):
        for k in range(-3, 4):
            out[:, d, (k + 4) * dim + e - d - 1] = band[:, d, (k + 4) * model.lines + e - d - 1]
    return out.reshape(model.n * dim, -1)


def _lanczos(cable: Cable) -> float:
    """Largest frequency [rad/s] by Lanczos iteration on w = P v in the M inner product, with
    reorthogonalisation.
    """
    model = cable.model
    dim, n = len(model.axes), model.n
    half = 4 * dim - 1
    band = _spatial(cable)[:, : 2 * half + 1]

    def apply(x: Array) -> Array:
        flat = np.concatenate((np.zeros(half), x[:dim].T.ravel(), np.zeros(half)))
        windows = np.lib.stride_tricks.sliding_window_view(flat, 2 * half + 1)
        force = np.zeros_like(x)
        force[:dim] = np.einsum("rc,rc->r", band, windows).reshape(n, dim).T
        return cable.free_acceleration(force)

    def weigh(x: Array) -> Array:
        return np.stack([mass.multiply(model.mass(d), x[d]) for d in range(len(x))])

    x = np.random.default_rng(0).standard_normal((model.lines, n))
    x[dim:] = 0.0
    x = cable.free_acceleration(weigh(x))
    pairs: list[tuple[Array, Array]] = []
    diagonal: list[float] = []
    beside: list[float] = []
    image = weigh(x)
    norm = float(np.sqrt(np.vdot(x, image)))
    if norm == 0.0:  # nothing is free to move
        return 0.0
    for _ in range(ITERATIONS):
        x, image = x / norm, image / norm
        pairs.append((x, image))
        x = apply(x)
        diagonal.append(float(np.vdot(x, image)))
        for old, old_image in pairs:
            x = x - np.vdot(x, old_image) * old
        image = weigh(x)
        norm = float(np.sqrt(max(float(np.vdot(x, image)), 0.0)))
        if norm < 1e-12 * abs(diagonal[-1]):
            break
        beside.append(norm)
    # eigvalsh reads only the lower triangle
    lower = np.diag(diagonal) + np.diag(beside[: len(diagonal) - 1], -1)
    return float(np.sqrt(max(np.linalg.eigvalsh(lower).max(), 0.0)))


def with_torsion(value: float, scene: Scene, model: Model) -> float:
    """Upper bound of the largest frequency [rad/s] with the Frenet torsion, from that without it.

    For a bent cable gamma is linear in the third derivative across the plane of bending, with the
    factor kappa / (kappa^2 + delta^2) <= 1 / (2 delta). By the Cauchy-Schwarz inequality the
    largest eigenvalue of the quadratic form GJ integral (theta' + gamma)^2 is at most the sum of
    those of GJ integral theta'^2 and GJ / (4 delta^2) integral y'''^2. The geometric stiffness,
    which grows with the torque and without bound as delta -> 0, is neglected: where it matters, the
    run diverges and reports so.
    """
    stiffness, floor = scene.cable.GJ, scene.curvature_floor**2
    across = stiffness / (4.0 * floor) * mass.gram(model.knots, 3)
    twist = stiffness * mass.gram(model.knots, 1)
    free = np.ones(model.n, dtype=bool)
    squares = value * value
    for band, line in ((across, 0), (twist, model.lines - 1)):
        squares += spectrum.largest_of_line(band, model.mass(line), free) ** 2
    return float(np.sqrt(squares))
