"""Balances of a random scene that do not read the simulator's own account.

What constant forces do is known at any time (`ConstantForces`, `Impulse`); `AngularImpulse` and
`EndWork` are sums over the steps, which have to be taken one at a time.
"""

from __future__ import annotations

from typing import Protocol

import numpy as np
from numpy.typing import NDArray

from dlo_sim.kernels import layout
from dlo_sim.simulation.account import balance
from dlo_sim.simulation.simulator import Simulator
from dlo_sim.studies.stability import truths

Array = NDArray[np.float64]
ENDS = ("start", "end")


def account_scale(sim: Simulator) -> float:
    """Energy [J] that errors are shares of: exchanged so far, or what round-off leaves uncertain.

    It is what the public `energy_error` is a quotient of.
    """
    return max(_exchanged(sim), _floor(sim))


def floor_share(sim: Simulator) -> float:
    """Energy that round-off leaves uncertain over the energy exchanged; above 1 nothing moved."""
    return _floor(sim) / max(_exchanged(sim), 1e-300)


def _exchanged(sim: Simulator) -> float:
    """An explicit loop keeps it up to date only now and then."""
    _, present = balance(sim.model, sim._state, sim._work)
    return float(max(sim._state.ledger[layout.EXCHANGED], present))


def _floor(sim: Simulator) -> float:
    return float(sim._state.ledger[layout.FLOOR])


def is_conservative(sim: Simulator) -> bool:
    """Whether nothing but constant forces does work while the ends rest, and nothing is lost."""
    loads = sim.scene.loads
    constant = all(load.signal == "constant" and not any(load.torque) for load in loads)
    damped = "damping" in sim.active_terms or sim.method == "generalized_alpha"
    return constant and not damped


def flies_freely(sim: Simulator) -> bool:
    """Whether constant loads are all that acts from outside."""
    scene = sim.scene
    steady = all(load.signal == "constant" for load in scene.loads)
    alone = "damping" not in sim.active_terms and not any(scene.gravity)
    return steady and alone and not scene.start.held and not scene.end.held


class Balance(Protocol):
    """Something that has to come out even."""

    def error(self) -> float:
        """How far it is open now, as a share of what went in and out."""


class ConstantForces:
    """Energy less the work of constant forces, which stays what it was."""

    def __init__(self, sim: Simulator) -> None:
        self._sim = sim
        self._first = self._energy()

    def error(self) -> float:
        """How far it is from what it was, as a share of the energy exchanged."""
        return abs(self._energy() - self._first) / account_scale(self._sim)

    def _energy(self) -> float:
        sim = self._sim
        work = sum(
            float(np.dot(load.force, sim.centerline([load.position * sim.scene.cable.length])[0]))
            for load in sim.scene.loads
        )
        return sim.energy().total - work


class Impulse:
    """Momentum of a cable that starts at rest against the impulse of constant forces."""

    def __init__(self, sim: Simulator) -> None:
        self._sim = sim
        self._force = np.sum([load.force for load in sim.scene.loads], axis=0)

    def error(self) -> float:
        """Largest difference, as a share of the impulse."""
        impulse = self._force * self._sim.time
        momentum, _ = truths.momenta(self._sim)
        size = max(float(np.linalg.norm(impulse)), 1e-300)
        return float(np.abs(momentum - impulse).max()) / size


class AngularImpulse:
    """Angular momentum about the first shape's centre against the angular impulse of the loads.

    dL/dt = sum r_i x f_i of constant forces, summed by the trapezoidal rule over the steps. That is
    what a kick-drift-kick step and a midpoint step do themselves, so with these methods the two
    agree to round-off and to the solver's tolerance, whatever the step. A step that was done in
    smaller pieces has seen places in between, which nobody knows: what it changes is taken as it
    is.
    """

    def __init__(self, sim: Simulator) -> None:
        length = sim.scene.cable.length
        self._sim = sim
        self._centre = sim.control_points[:, :3].mean(axis=0)
        self._places = np.array([load.position for load in sim.scene.loads]) * length
        self._forces = np.array([load.force for load in sim.scene.loads])
        self._size = length * float(np.linalg.norm(self._forces, axis=1).sum())
        self._moment = self._moment_now()
        self._impulse = np.zeros(3)
        self._found = np.zeros(3)

    def begin(self) -> None:
        """Nothing happens to the ends of a cable that nobody holds."""

    def add_step(self, in_pieces: bool) -> None:
        """Take in the step that was just done."""
        moment, found = self._moment_now(), self._found_now()
        trapezoid = 0.5 * self._sim.step * (self._moment + moment)
        self._impulse += found - self._found if in_pieces else trapezoid
        self._moment, self._found = moment, found

    def error(self) -> float:
        """Largest difference, as a share of force times length times time."""
        scale = max(self._size * self._sim.time, 1e-300)
        return float(np.abs(self._found_now() - self._impulse).max() / scale)

    def _found_now(self) -> Array:
        momentum, angular = truths.momenta(self._sim)
        return np.asarray(angular - np.cross(self._centre, momentum))

    def _moment_now(self) -> Array:
        arms = self._sim.centerline(self._places) - self._centre
        return np.asarray(np.cross(arms, self._forces).sum(axis=0))


class EndWork:
    """Energy of an undamped cable against reaction times way of its ends.

    An implicit method's reaction is the mean over its step. (An explicit one's are those of
    instants, and near its limit the mean of two is not the work.) Steps in which
    a motion begins or ends are left out: the velocity of an end jumps there, and no finite reaction
    does that work. So are those of a turning clamp, whose moment changes its arm within a step.
    """

    def __init__(self, sim: Simulator) -> None:
        self._sim = sim
        self._known: tuple[float, Array, Array] | None = None
        self._open = self._latest = 0.0  # [J] of all steps before the latest, and of that
        self._largest = 0.0  # [J] work of a step

    def begin(self) -> None:
        """The ends are given other motions now."""
        self._known = None
        self._latest = 0.0

    def add_step(self, in_pieces: bool) -> None:
        """Take in the step that was just done; in pieces or not, its reaction is their mean."""
        sim = self._sim
        poses = [sim.end_pose(end) for end in ENDS]
        places = np.array([place for place, _ in poses])
        turns = np.array([turn for _, turn in poses])
        forces = np.array([sim.reaction(end)[0] for end in ENDS])
        now = sim.energy().total, places, turns
        self._open += self._latest
        self._latest = 0.0
        if self._known is not None:
            energy, old_places, old_turns = self._known
            clamped = [getattr(sim.scene, end).clamped for end in ENDS]
            if not (turns != old_turns)[clamped].any():
                work = float((forces * (places - old_places)).sum())
                self._latest = now[0] - energy - work
                self._largest = max(self._largest, abs(work))
        self._known = now

    def error(self) -> float:
        """What is open of it, as a share of the energy exchanged."""
        return abs(self._open) / max(account_scale(self._sim), self._largest)
