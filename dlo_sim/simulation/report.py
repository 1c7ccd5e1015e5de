"""Results that a simulator reports: outcome of an advance, errors, energies."""

from __future__ import annotations

import math
from dataclasses import dataclass
from enum import Enum
from typing import NamedTuple

from dlo_sim.core.methods import IMPLICIT, Method
from dlo_sim.methods.implicit import ROOM

# Newton iterations per sub-step. In one second of energy_momentum with 9 and 41 control points,
# paper_wire and paper_wire_force took 4.0 to 5.3 on average, two_grippers at rest took 1.
MOST_USUAL = 10
FAR_ABOVE = 2 * MOST_USUAL
USUAL_IN_CONTACT = 2  # times as many are usual where what touches and slides changes
# Energy error of an explicit method that is said, and from which its motion is not ok. The paper's
# wire has 1e-11 to 7e-6 at 0.9 of the stability limits; free swings that go on beyond it diverge
# sooner or later.
MOST_OPEN, WRONG = 1e-3, 1e-2


class Status(Enum):
    """Outcome of an advance; the value is a readable sentence."""

    OK = "advanced as asked"
    DIVERGED = (
        "the energy grew beyond what was put in; use a smaller integrator.step; the last good "
        "state is kept"
    )
    NOT_CONVERGED = (
        "Newton's method did not converge even with small steps, or would take too long; use a "
        "smaller integrator.step; the last good state is kept"
    )
    INTERRUPTED = "ended from outside"
    UNRESOLVED = (
        "advanced as asked, but the stretch of the cable is not what its tension explains, or the "
        "energy balance is open"
    )

    @property
    def ok(self) -> bool:
        """Whether the advance was completed with a shape and an energy that a cable can have."""
        return self is Status.OK

    @property
    def advanced(self) -> bool:
        """Whether all steps were made, so that the next ones can follow."""
        return self in (Status.OK, Status.UNRESOLVED)


class Report(NamedTuple):
    """Outcome of one advance.

    Attributes:
        status: what happened; message: one line, empty if all is well.
        steps: whole steps done; simulated: their time [s].
        force_evaluations: force evaluations, or Newton iterations of an implicit method.
        note: one line if all is well but was unusually slow (`newton_note`), else empty.
    """

    status: Status
    message: str
    steps: int
    simulated: float
    force_evaluations: int
    note: str = ""

    def after(self, before: Report) -> Report:
        """This one with the steps and evaluations of the run before it, too."""
        if not before.steps:
            return self
        return self._replace(
            steps=before.steps + self.steps,
            simulated=before.simulated + self.simulated,
            force_evaluations=before.force_evaluations + self.force_evaluations,
        )


class Slide(NamedTuple):
    """A grasp through which the cable slides.

    Attributes:
        u: material coordinate that it holds now [m]. before, after: how hard the cable is pulled
            on both sides of it [N]: T + EI kappa^2 / 2 of tension T and curvature kappa, which does
            not change along what bends near the gripper, two knot spans away.
    """

    u: float
    before: float
    after: float


def explained(status: Status, method: Method) -> str:
    """What happened, with a cure that this method leaves open."""
    if status is Status.DIVERGED and method.family != IMPLICIT:
        return status.value.replace("integrator.step;", "integrator.step or energy_momentum;")
    return status.value


def balance_warning(method: Method, tolerance: float, error: float) -> str:
    """One line if a method left more of the energy open than it promises, an explicit one more than
    MOST_OPEN, else empty.

    Args:
        error: of the energy balance, relative to the energy exchanged.
    """
    implicit = method.family == IMPLICIT
    bound = ROOM * tolerance if implicit else MOST_OPEN
    if error <= bound or (implicit and not method.conserves_energy):
        return ""
    other = "" if implicit else " or energy_momentum"
    return (
        f"energy balance: open by {error:.2g} of the energy exchanged, more than {bound:g}; the "
        f"motion may be wrong: use a smaller integrator.step{other}"
    )


def newton_note(method: Method, step: float, steps: int, iterations: int, touches: bool) -> str:
    """One line if Newton's method took far more iterations than usual per step, else empty.
    touches: whether there are obstacles.
    """
    done, usual = steps * len(method.substeps), USUAL_IN_CONTACT if touches else 1
    if method.family != IMPLICIT or iterations <= usual * FAR_ABOVE * done:
        return ""
    each = f"{iterations / max(done, 1):.0f} iterations per {'sub-' * (done > steps)}step"
    return (
        f"Newton's method took {each} where up to {usual * MOST_USUAL} are usual: the cable moves "
        f"far within integrator.step {step:g} s; a smaller one is more accurate, and may be faster"
    )


@dataclass(frozen=True)
class DiscretizationError:
    """Estimated position errors [m] of the centerline due to the discretisation.

    Attributes:
        time: due to the step; 0 if the step is so short that its part is not estimated.
        space: due to the number of control points. Both are infinite if unknown.
        unknown: why an error is unknown, one line; empty otherwise.
        since: time [s] from which one of both exceeds half of accuracy.target, so that their sum
            may exceed it; infinite if that is not known.
    """

    time: float
    space: float
    unknown: str = ""
    since: float = math.inf

    @property
    def total(self) -> float:
        """Sum of both [m]."""
        return self.time + self.space

    @property
    def numbers(self) -> dict[str, float | None]:
        """`time`, `space` and `total` [m], for JSON; None if unknown."""
        parts = {"time": self.time, "space": self.space, "total": self.total}
        return {name: part if math.isfinite(part) else None for name, part in parts.items()}


@dataclass(frozen=True)
class Energy:
    """Energies [J]; that of gravity is zero at the world's origin."""

    kinetic: float
    stretch: float
    bend: float
    twist: float
    gravity: float
    spring: float
    contact: float = 0.0

    @property
    def total(self) -> float:
        """Sum of all parts [J]."""
        elastic = self.stretch + self.bend + self.twist + self.spring + self.contact
        return self.kinetic + elastic + self.gravity
