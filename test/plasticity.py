"""Plastic bending of one section: yield, flow and set. Plain numpy; the oracle for
`dlo_sim.engine.plasticity`.

The curvature vector kappa splits into an elastic part and the plastic curvature p. The moment is
M = EI (kappa - p), the back moment of linear kinematic hardening is H p, and with the yield moment
M_y = EI kappa_y
    |M - H p| <= M_y,        p' in the direction of M - H p,
independent of the rate. The stored energy is EI/2 |kappa - p|^2 + H/2 |p|^2 and flow dissipates M_y
per plastic curvature. Along one axis this is the closed form
    M = EI kappa up to kappa_y, then M_y + h EI (kappa - kappa_y)       (`moment`),
with h = H / (EI + H); after unloading from kappa the set (1 - h) (kappa - kappa_y) remains
(`set_after`), and the other way the cable yields again after 2 M_y of unloading (Bauschinger).
Source: linear kinematic hardening, Prager 1956; return mapping, Simo & Hughes 1998, ch. 1.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike, NDArray

Array = NDArray[np.float64]


@dataclass(frozen=True)
class Law:
    """Plastic bending of a section.

    Attributes:
        EI: elastic bending stiffness [N m^2].
        yield_curvature: kappa_y [1/m].
        hardening: h, tangent over elastic stiffness beyond yield, in [0, 1).
    """

    EI: float
    yield_curvature: float
    hardening: float

    @property
    def H(self) -> float:
        """Hardening modulus [N m^2]: EI and H in series have the stiffness h EI."""
        return self.EI * self.hardening / (1.0 - self.hardening)

    @property
    def yield_moment(self) -> float:
        """M_y [N m]."""
        return self.EI * self.yield_curvature

    def moment(self, curvature: float) -> float:
        """Moment [N m] of a virgin section bent once, monotonically, to a curvature [1/m]."""
        beyond = max(abs(curvature) - self.yield_curvature, 0.0)
        elastic = min(abs(curvature), self.yield_curvature)
        return float(np.sign(curvature)) * self.EI * (elastic + self.hardening * beyond)

    def set_after(self, curvature: float) -> float:
        """Curvature [1/m] that remains when the moment is taken off again.

        Raises:
            ValueError: if unloading would yield the other way.
        """
        if abs(self.moment(curvature)) > 2.0 * self.yield_moment:
            raise ValueError(
                f"unloading from {curvature:g} 1/m yields again; the closed form ends at "
                f"a moment of {2.0 * self.yield_moment:g} N m"
            )
        return curvature - self.moment(curvature) / self.EI

    def flow(self, curvature: ArrayLike, plastic: ArrayLike) -> tuple[Array, float]:
        """Plastic curvature after bending to `curvature`, both (3,) [1/m]; energy lost [J/m]."""
        curvature, plastic = np.asarray(curvature, float), np.asarray(plastic, float)
        relative = self.EI * (curvature - plastic) - self.H * plastic
        size = float(np.linalg.norm(relative))
        if size <= self.yield_moment:
            return plastic, 0.0
        amount = (size - self.yield_moment) / (self.EI + self.H)
        lost = amount * (self.yield_moment + 0.5 * (self.EI + self.H) * amount)
        return plastic + amount * relative / size, lost

    def energy(self, curvature: ArrayLike, plastic: ArrayLike) -> float:
        """Stored energy per rest length [J/m]."""
        elastic = np.asarray(curvature, float) - plastic
        plastic = np.asarray(plastic, float)
        return float(0.5 * self.EI * elastic @ elastic + 0.5 * self.H * plastic @ plastic)


def carried(plastic: ArrayLike, before: ArrayLike, after: ArrayLike) -> Array:
    """Plastic curvature turned by the smallest rotation between two unit tangents, all (3,)."""
    plastic, before, after = (np.asarray(x, float) for x in (plastic, before, after))
    axis = np.cross(before, after)
    cosine = float(before @ after)
    return np.asarray(
        cosine * plastic + np.cross(axis, plastic) + axis * (axis @ plastic) / (1.0 + cosine)
    )
