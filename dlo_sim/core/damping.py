"""Rayleigh damping C = alpha M + beta K: coefficients <-> damping ratios of vibration modes.

A mode of natural frequency omega [rad/s] decays as exp(-zeta omega t) with the damping ratio
    zeta(omega) = alpha / (2 omega) + beta omega / 2,
smallest at omega = sqrt(alpha / beta), where zeta = sqrt(alpha beta).
"""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike, NDArray


def damping_ratio(omega: ArrayLike, alpha: float, beta: float) -> NDArray[np.float64]:
    """Damping ratio zeta [-] of modes with natural frequencies omega [rad/s], shape of omega.

    Args:
        alpha: mass-proportional coefficient [1/s], `damping.mass`.
        beta: stiffness-proportional coefficient [s], `damping.stiffness`.

    Raises:
        ValueError: a frequency that is not positive.
    """
    omega = np.asarray(omega, dtype=float)
    if not (omega > 0.0).all():
        raise ValueError(f"damping ratio: omega {omega} rad/s is not positive")
    return np.asarray(0.5 * (alpha / omega + beta * omega))


def rayleigh_coefficients(
    omega_1: float, zeta_1: float, omega_2: float, zeta_2: float
) -> tuple[float, float]:
    """alpha [1/s] and beta [s] that give two modes their damping ratios.

    Solves zeta_i = alpha / (2 omega_i) + beta omega_i / 2 for both modes. Modes between the two are
    damped less, modes outside more.

    Args:
        omega_1, omega_2: natural frequencies [rad/s], different.
        zeta_1, zeta_2: damping ratios [-].

    Raises:
        ValueError: a frequency that is not positive, equal frequencies, or ratios that would need a
            negative coefficient (which feeds energy to some mode).
    """
    if not (omega_1 > 0.0 and omega_2 > 0.0 and omega_1 != omega_2):
        raise ValueError(
            f"Rayleigh damping: omega {omega_1:g} and {omega_2:g} rad/s; give two different "
            "positive frequencies"
        )
    gap = omega_2**2 - omega_1**2
    alpha = 2.0 * omega_1 * omega_2 * (zeta_1 * omega_2 - zeta_2 * omega_1) / gap
    beta = 2.0 * (zeta_2 * omega_2 - zeta_1 * omega_1) / gap
    if not (alpha >= 0.0 and beta >= 0.0):  # written so that NaN fails
        low, high = sorted((omega_1 / omega_2, omega_2 / omega_1))
        raise ValueError(
            f"Rayleigh damping: zeta {zeta_1:g} and {zeta_2:g} need alpha {alpha:g} 1/s and beta "
            f"{beta:g} s; zeta_2 / zeta_1 must lie between {low:g} and {high:g}, or both be 0"
        )
    return float(alpha), float(beta)
