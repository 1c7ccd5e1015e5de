"""A Kalman filter for how far a predicted curve is from the real one."""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]
_NUGGET = 1e-6  # of the variance, for a covariance that can be inverted


class ErrorFilter:
    """Error e(u, t) of the control points of a curve, alike and independent in x, y, z.

    Without measurements e is a stationary Gaussian process: covariance error^2 exp(-d^2 / 2 l^2) at
    a distance d along the curve, l = `length`, zero where the curve is held; in time a critically
    damped oscillator e'' + 2 a e' + a^2 e = white noise with a = sqrt(3) / time (a Matern process).
    The gains follow from it: a point seen after a long silence moves the curve by
    error^2 / (error^2 + noise^2) of its distance, points of short intervals by less.

    Args:
        u: material coordinates of the control points [m], shape (n,).
        held: rows of basis values, shape (h, n): held e = 0.
        error: standard deviation of e [m]. length, time: over which it is alike [m], [s].
        noise: standard deviation of a coordinate of a measured point [m].
    """

    def __init__(
        self, u: Array, held: Array, error: float, length: float, time: float, noise: float
    ) -> None:
        n = len(u)
        space = np.exp(-0.5 * ((u[:, None] - u) / length) ** 2) + _NUGGET * np.eye(n)
        if len(held):
            space = space - space @ held.T @ np.linalg.solve(held @ space @ held.T, held @ space)
        self._rate, self._noise = math.sqrt(3.0) / time, noise
        nothing = np.zeros((n, n))
        self._stationary = error**2 * np.block([[space, nothing], [nothing, self._rate**2 * space]])
        self._covariance = self._stationary

    def advance(self, duration: float) -> None:
        """Let time [s] pass without a measurement."""
        a = self._rate * duration
        step = [[1.0 + a, duration], [-self._rate * a, 1.0 - a]]
        move = np.kron(math.exp(-a) * np.array(step), np.eye(len(self._stationary) // 2))
        lost = self._covariance - self._stationary
        self._covariance = self._stationary + move @ lost @ move.T

    def update(self, seen: Array, distances: Array) -> tuple[Array, Array]:
        """What to add to the control points [m] and their velocities [m/s], each of shape (n, 3).

        Args:
            seen: rows of basis values of the measured points, shape (k, n).
            distances: from the curve to the measured points [m], shape (k, 3).
        """
        # The gain P H^T (H P H^T + R)^-1 as P (1 + H^T R^-1 H P)^-1 H^T R^-1: the points, however
        # many, count by two sums.
        size, n = len(self._covariance), seen.shape[1]
        told, pulled = np.zeros((size, size)), np.zeros((size, 3))
        told[:n, :n] = seen.T @ seen / self._noise**2
        pulled[:n] = seen.T @ distances / self._noise**2
        gain = np.linalg.solve((np.eye(size) + told @ self._covariance).T, self._covariance).T
        left = self._covariance - gain @ told @ self._covariance
        # Otherwise round-off makes it asymmetric, 20 times more so every five updates.
        self._covariance = 0.5 * (left + left.T)
        position, velocity = np.split(gain @ pulled, 2)
        return position, velocity
