"""Time integrators as data: what each one is, and which scenes it is valid for.

A drift/kick (splitting) method is a pair of weight rows that one loop executes, a Runge-Kutta
method a Butcher table for another. An implicit method is a choice of force for the one Newton loop.
The loops, the checks of a scene, the command line's list and the studies read it here.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

SPLITTING = "splitting"
RUNGE_KUTTA = "runge_kutta"
ZHAI = "zhai"
IMPLICIT = "implicit"


@dataclass(frozen=True)
class Method:
    """One integrator.

    Attributes:
        name: key of `integrator.method`. family: which loop executes it.
        order: global order of accuracy in the step. source: where it comes from.
        symmetric: reversing the velocities and stepping on returns to the start.
        symplectic: conserves a nearby energy at fixed step.
        conserves_energy: conserves the energy itself, to the solver's tolerance, at any step.
        stability_limit: largest stable omega * tau on an undamped oscillator; inf if there is none.
        decay_weight: what a rate of decay counts as a frequency towards that limit: 0 where damping
            is solved exactly, not taken as a force.
        mass_damping, stiffness_damping: whether the method is valid with such damping.
        drift_weights, kick_weights: c_i and d_i in units of the step, executed drift first.
        stage_matrix, stage_weights: a_ij and b_j of a Runge-Kutta method.
        substeps: lengths of the sub-steps that make up a step of an implicit method.
        phase_error: k of the error k omega T (omega tau)^order of the phase of an oscillator after
            a time T, for an implicit method.
    """

    name: str
    family: str
    order: int
    source: str
    symmetric: bool = False
    symplectic: bool = False
    conserves_energy: bool = False
    stability_limit: float = math.inf
    decay_weight: float = 0.0
    mass_damping: bool = False
    stiffness_damping: bool = False
    drift_weights: tuple[float, ...] = ()
    kick_weights: tuple[float, ...] = ()
    stage_matrix: tuple[tuple[float, ...], ...] = ()
    stage_weights: tuple[float, ...] = ()
    substeps: tuple[float, ...] = (1.0,)
    phase_error: float = 1.0 / 12.0

    def __post_init__(self) -> None:
        """Raise ValueError, naming method and weights, for a table that cannot be right."""
        sums = {"sub-steps": self.substeps}
        if self.family == RUNGE_KUTTA:
            sums["stage weights"] = self.stage_weights
            if [len(row) for row in self.stage_matrix] != list(range(len(self.stage_weights))):
                raise ValueError(
                    f"{self.name}: stage i needs i coefficients, one per earlier stage"
                )
        if self.family == SPLITTING:
            sums |= {"drift weights": self.drift_weights, "kick weights": self.kick_weights}
            if len(self.drift_weights) != len(self.kick_weights):
                raise ValueError(
                    f"{self.name}: {len(self.drift_weights)} drifts, other number of kicks"
                )
        for what, weights in sums.items():
            if abs(sum(weights) - 1.0) > 1e-14:
                raise ValueError(f"{self.name}: {what} sum to {sum(weights)}, not 1")
            if self.mass_damping and min(weights) < 0.0:
                raise ValueError(f"{self.name}: negative sub-steps make damping grow")

    @property
    def force_evaluations(self) -> int:
        """Force evaluations per step of an explicit method in a long run; 0 for implicit ones."""
        if self.family == RUNGE_KUTTA:
            return len(self.stage_weights)
        if self.family == ZHAI:
            return 1
        kicks = sum(1 for weight in self.kick_weights if weight)
        # A kick at the very end and one at the very start see the same configuration.
        shared = bool(self.kick_weights and self.kick_weights[-1] and not self.drift_weights[0])
        return kicks - 1 if shared else kicks


def _forest_ruth() -> Method:
    beta = 2.0 ** (1.0 / 3.0)
    outer = 1.0 / (2.0 - beta)
    return Method(
        name="forest_ruth",
        family=SPLITTING,
        order=4,
        symmetric=True,
        symplectic=True,
        stability_limit=1.5734,
        source="Forest & Ruth 1990; Neri 1987; Khalifa & Palli eqs. 18-19",
        drift_weights=(
            0.5 * outer,
            0.5 * (1.0 - beta) * outer,
            0.5 * (1.0 - beta) * outer,
            0.5 * outer,
        ),
        kick_weights=(outer, -beta * outer, outer, 0.0),
    )


def _energy_momentum_4() -> Method:
    outer = 1.0 / (4.0 - 4.0 ** (1.0 / 3.0))
    substeps = (outer, outer, 1.0 - 4.0 * outer, outer, outer)
    return Method(
        # five steps of energy_momentum: worth it where errors well below a millimetre are asked for
        name="energy_momentum_4",
        family=IMPLICIT,
        order=4,
        symmetric=True,
        conserves_energy=True,
        source="energy_momentum composed after Suzuki 1990, Phys. Lett. A 146, 319-323",
        substeps=substeps,
        # 2 atan(x / 2) = x - x^3 / 12 + x^5 / 80; the cubes of the sub-steps cancel.
        phase_error=abs(sum(substep**5 for substep in substeps)) / 80.0,
    )


METHODS: dict[str, Method] = {
    method.name: method
    for method in (
        _forest_ruth(),
        Method(
            name="velocity_verlet",
            family=SPLITTING,
            order=2,
            symmetric=True,
            symplectic=True,
            stability_limit=2.0,
            mass_damping=True,
            source="Verlet 1967, kick-drift-kick form (Swope et al. 1982)",
            drift_weights=(0.0, 1.0),
            kick_weights=(0.5, 0.5),
        ),
        Method(
            name="rk4",
            family=RUNGE_KUTTA,
            order=4,
            stability_limit=2.0 * 2.0**0.5,
            decay_weight=1.016,
            mass_damping=True,
            source="Kutta 1901, the classical table",
            stage_matrix=((), (0.5,), (0.0, 0.5), (0.0, 0.0, 1.0)),
            stage_weights=(1.0 / 6.0, 1.0 / 3.0, 1.0 / 3.0, 1.0 / 6.0),
        ),
        Method(
            # with psi = phi = 1/2, the pair with the largest stable step (`methods.zhai`)
            name="zhai",
            family=ZHAI,
            order=2,
            stability_limit=2.0,
            decay_weight=2.0,
            mass_damping=True,
            source="Zhai 1996, Int. J. Numer. Meth. Eng. 39, 4199-4214",
        ),
        Method(
            name="implicit_midpoint",
            family=IMPLICIT,
            order=2,
            symmetric=True,
            symplectic=True,
            mass_damping=True,
            stiffness_damping=True,
            source="one-stage Gauss collocation; Hairer, Lubich & Wanner 2006, II.1",
        ),
        Method(
            name="energy_momentum",
            family=IMPLICIT,
            order=2,
            symmetric=True,
            conserves_energy=True,
            mass_damping=True,
            stiffness_damping=True,
            source="discrete gradient per quadrature point; Simo & Tarnow 1992, Gonzalez 1996",
        ),
        _energy_momentum_4(),
    )
}
