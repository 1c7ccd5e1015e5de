"""What changes a cable and when: the changes that are made to a simulator, which finer runs of it
repeat, and the motions of end effectors and obstacles that have not begun.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from copy import deepcopy
from functools import wraps
from typing import Any, Concatenate, NamedTuple, ParamSpec, Protocol, TypeVar

import numpy as np
from numpy.typing import NDArray

from dlo_sim.core import one_rotation
from dlo_sim.core.end_motion import EndMotion

Array = NDArray[np.float64]
Waiting = Mapping[str, tuple[EndMotion, ...]]
"""End effector or obstacle -> its motions that have not begun, in their order."""
Given = ParamSpec("Given")
Result = TypeVar("Result")


class Change(NamedTuple):
    """A call that changed a simulator: name of the method, arguments."""

    name: str
    given: tuple[Any, ...]
    named: dict[str, Any]

    def repeat(self, simulator: object, began: float) -> None:
        """Make it on another simulator, which began at a time [s] of the first one."""
        earlier = [one.later(-began) if isinstance(one, EndMotion) else one for one in self.given]
        getattr(simulator, self.name)(*earlier, **self.named)


class Followed(Protocol):
    """A simulator, and what is told of every change of it."""

    follower: Callable[[Change], object] | None


Simulating = TypeVar("Simulating", bound=Followed)


def recorded(
    method: Callable[Concatenate[Simulating, Given], Result],
) -> Callable[Concatenate[Simulating, Given], Result]:
    """A method that changes a simulator and then tells its follower; what it calls itself does
    not.
    """

    @wraps(method)
    def call(simulator: Simulating, *given: Given.args, **named: Given.kwargs) -> Result:
        follower, simulator.follower = simulator.follower, None
        try:
            result = method(simulator, *given, **named)
        finally:
            simulator.follower = follower
        if follower is not None:
            follower(Change(method.__name__, *deepcopy((given, named))))
        return result

    return call


class WaitingMotions:
    """Motions that have not begun.

    Attributes:
        by_name: end effector or obstacle -> its motions that have not begun, in their order; its
            entries are replaced, never changed.
    """

    def __init__(self) -> None:
        self.by_name: dict[str, tuple[EndMotion, ...]] = {}

    def of(self, name: str) -> tuple[EndMotion, ...]:
        """Those of one name, in their order."""
        return self.by_name.get(name, ())

    def keep(self, name: str, t: float, motion: EndMotion, moves: bool) -> bool:
        """Keep a motion until its start, if until then something else moves at time t (`moves`) or
        waits; returns whether it is kept. It replaces those that begin later.

        What is at rest needs no waiting: it rests until the motion starts.
        """
        rests = not moves and not self.of(name)
        if rests or motion.start <= t + _rounding(motion.start):
            return False
        earlier = (one for one in self.of(name) if one.start < motion.start)
        self.by_name[name] = (*earlier, motion)
        return True

    def take_due(self, t: float) -> dict[str, EndMotion]:
        """Those that start up to time t, the last one of each name; they wait no more."""
        due = {}
        for name, motions in list(self.by_name.items()):
            begun = [one for one in motions if one.start <= t + _rounding(t)]
            if begun:
                due[name] = begun[-1]
                self.by_name[name] = motions[len(begun) :]
                if not self.by_name[name]:
                    del self.by_name[name]
        return due

    def steps_until_begin(self, t: float, step: float) -> int:
        """Number of whole steps [s] from time t until one begins; 0 if it does within the next
        step. One has to wait.
        """
        first = min(motions[0].start for motions in self.by_name.values())
        return int((first - t + _rounding(t)) / step)

    def leading(
        self, t: float, step: float, pose: Callable[[str, float], tuple[Array, Array]]
    ) -> dict[str, EndMotion]:
        """Of those that begin within the step from time t, a motion from the present pose to where
        it is at the end of the step: with constant acceleration, to the position and velocity
        there.
        """
        until, found = t + step, {}
        for name, motions in self.by_name.items():
            begun = [one for one in motions if one.start < until - _rounding(until)]
            if not begun:
                continue
            place, turned = pose(name, t)
            there, facing = begun[-1].position_at(until), begun[-1].orientation_at(until)
            turn = np.array(one_rotation.turn_between(turned.tolist(), facing.tolist()))
            path = _parabola(place, there - place, begun[-1].velocity_at(until), step)
            spin = _parabola(turn, turn, begun[-1].angular_velocity_at(until), step)[1:]
            found[name] = EndMotion.from_coefficients(t, step, path, turned, spin)
        return found


def _rounding(t: float) -> float:
    """Two times near t that are closer than this to each other [s] are the same."""
    return 1e-12 * max(abs(t), 1e-3)


def _parabola(first: Array, way: Array, last_rate: Array, duration: float) -> Array:
    """Coefficients (3, 3) of the parabola that begins at `first`, covers `way` within a duration
    [s] and has the rate `last_rate` at its end.
    """
    mean = way / duration
    return np.stack((first, 2.0 * mean - last_rate, (last_rate - mean) / duration))
