"""Small motions of straight beams joined rigidly: a dense finite-element program of its own, with
Euler-Bernoulli bending, stretching and twist without inertia, that nets are compared with."""

from collections.abc import Iterable

import numpy as np
import scipy.linalg
from numpy.typing import NDArray

Array = NDArray[np.float64]
ELEMENTS = 24  # of a beam


def element(length: float, mu: float, EA: float, EI: float, GJ: float) -> tuple[Array, Array]:
    """Stiffness and mass of a beam along x; displacements and rotations of both ends, (12, 12)."""
    K, M = np.zeros((12, 12)), np.zeros((12, 12))
    h = length
    rod, wave = np.array([[1.0, -1.0], [-1.0, 1.0]]) / h, np.array([[2.0, 1.0], [1.0, 2.0]]) * h / 6
    K[np.ix_([0, 6], [0, 6])] = EA * rod
    M[np.ix_([0, 6], [0, 6])] = mu * wave
    K[np.ix_([3, 9], [3, 9])] = GJ * rod
    bend = np.array(
        [
            [12, 6 * h, -12, 6 * h],
            [6 * h, 4 * h * h, -6 * h, 2 * h * h],
            [-12, -6 * h, 12, -6 * h],
            [6 * h, 2 * h * h, -6 * h, 4 * h * h],
        ]
    )
    inertia = np.array(
        [
            [156, 22 * h, 54, -13 * h],
            [22 * h, 4 * h * h, 13 * h, -3 * h * h],
            [54, 13 * h, 156, -22 * h],
            [-13 * h, -3 * h * h, -22 * h, 4 * h * h],
        ]
    )
    for place, turn, sign in ((1, 5, 1.0), (2, 4, -1.0)):
        at = [place, turn, 6 + place, 6 + turn]
        signs = np.outer([1.0, sign, 1.0, sign], [1.0, sign, 1.0, sign])
        K[np.ix_(at, at)] = EI / h**3 * bend * signs
        M[np.ix_(at, at)] = mu * h / 420.0 * inertia * signs
    return K, M


def frequencies(
    beams: Iterable[tuple], held: Iterable[Array], count: int, light: float = 1e-9
) -> Array:
    """Lowest angular frequencies [rad/s].

    Args:
        beams: both ends [m], then mu, EA, EI, GJ of each; ends that coincide are joined rigidly.
        held: places [m] that are clamped. light: rotary inertia about the axis [kg m^2] at a node.
    """
    nodes: list[np.ndarray] = []

    def node(place: Array) -> int:
        for k, other in enumerate(nodes):
            if np.linalg.norm(other - place) < 1e-9:
                return k
        nodes.append(place)
        return len(nodes) - 1

    parts = []
    for begin, end, *numbers in beams:
        places = np.linspace(begin, end, ELEMENTS + 1)
        ends = [node(place) for place in places]
        x = (places[-1] - places[0]) / np.linalg.norm(places[-1] - places[0])
        y = np.cross(np.eye(3)[np.argmin(np.abs(x))], x)
        y /= np.linalg.norm(y)
        turn = np.kron(np.eye(4), np.stack((x, y, np.cross(x, y))))
        length = float(np.linalg.norm(places[1] - places[0]))
        K, M = (turn.T @ one @ turn for one in element(length, *numbers))
        parts += [(a, b, K, M) for a, b in zip(ends[:-1], ends[1:], strict=True)]
    size = 6 * len(nodes)
    K, M = np.zeros((size, size)), light * np.eye(size)
    for a, b, stiff, mass in parts:
        at = np.concatenate((6 * a + np.arange(6), 6 * b + np.arange(6)))
        K[np.ix_(at, at)] += stiff
        M[np.ix_(at, at)] += mass
    clamped = [node(np.array(place)) for place in held]
    free = np.setdiff1d(
        np.arange(size), np.concatenate([6 * k + np.arange(6) for k in clamped]) if clamped else []
    )
    values = scipy.linalg.eigh(K[np.ix_(free, free)], M[np.ix_(free, free)], eigvals_only=True)
    return np.sqrt(np.maximum(values, 0.0))[:count]
