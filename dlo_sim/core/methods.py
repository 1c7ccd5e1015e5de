"""Time integrators as data: what each one is, and which scenes it is valid for.

A drift/kick (splitting) method is a pair of weight rows that one loop executes. An implicit method
is a choice of force for the one Newton loop. Everything that speaks of a method - the loops, the
checks of a scene, the command line's list, the studies - reads it here.
"""

from __future__ import annotations

from dataclasses import dataclass

SPLITTING = "splitting"
IMPLICIT = "implicit"


@dataclass(frozen=True)
class Method:
    """One integrator.

    Attributes:
        name: key of `integrator.method`.
        family: `splitting` or `implicit`: which loop executes it.
        order: global order of accuracy in the step.
        symmetric: reversing the velocities and stepping on returns to the start.
        symplectic: conserves a nearby energy at fixed step.
        conserves_energy: conserves the energy itself, to the solver's tolerance, at any step.
        stability_limit: largest stable omega * tau on an undamped oscillator; inf if there is none.
        drift_weights, kick_weights: c_i and d_i in units of the step, executed drift first.
        mass_damping, stiffness_damping: whether the method is valid with such damping.
        source: where it comes from.
    """

    name: str
    family: str
    order: int
    symmetric: bool
    symplectic: bool
    conserves_energy: bool
    stability_limit: float
    mass_damping: bool
    stiffness_damping: bool
    source: str
    drift_weights: tuple[float, ...] = ()
    kick_weights: tuple[float, ...] = ()

    def __post_init__(self) -> None:
        if self.family != SPLITTING:
            return
        if len(self.drift_weights) != len(self.kick_weights):
            raise ValueError(f"{self.name}: {len(self.drift_weights)} drifts, other number of kicks")
        for kind, weights in (("drift", self.drift_weights), ("kick", self.kick_weights)):
            if abs(sum(weights) - 1.0) > 1e-14:
                raise ValueError(f"{self.name}: {kind} weights sum to {sum(weights)}, not 1")
        if self.mass_damping and min(self.drift_weights + self.kick_weights) < 0.0:
            raise ValueError(f"{self.name}: negative sub-steps make damping grow")

    @property
    def force_evaluations(self) -> int:
        """Force evaluations per step of a splitting method in a long run; Newton decides otherwise."""
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
        conserves_energy=False,
        stability_limit=1.5734,
        mass_damping=False,
        stiffness_damping=False,
        source="Forest & Ruth 1990; Neri 1987; Khalifa & Palli eqs. 18-19",
        drift_weights=(0.5 * outer, 0.5 * (1.0 - beta) * outer, 0.5 * (1.0 - beta) * outer, 0.5 * outer),
        kick_weights=(outer, -beta * outer, outer, 0.0),
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
            conserves_energy=False,
            stability_limit=2.0,
            mass_damping=True,
            stiffness_damping=False,
            source="Verlet 1967, kick-drift-kick form (Swope et al. 1982)",
            drift_weights=(0.0, 1.0),
            kick_weights=(0.5, 0.5),
        ),
        Method(
            name="implicit_midpoint",
            family=IMPLICIT,
            order=2,
            symmetric=True,
            symplectic=True,
            conserves_energy=False,
            stability_limit=float("inf"),
            mass_damping=True,
            stiffness_damping=True,
            source="one-stage Gauss collocation; Hairer, Lubich & Wanner 2006, II.1",
        ),
        Method(
            name="energy_momentum",
            family=IMPLICIT,
            order=2,
            symmetric=True,
            symplectic=False,
            conserves_energy=True,
            stability_limit=float("inf"),
            mass_damping=True,
            stiffness_damping=True,
            source="discrete gradient per quadrature point; Simo & Tarnow 1992, Gonzalez 1996",
        ),
    )
}
