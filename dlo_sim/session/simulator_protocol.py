"""What sessions, node and replay know of a simulator; `dlo_sim.Simulator` is one.

The meaning of each member is documented there.
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any, Protocol, Self

import numpy as np
from numpy.typing import ArrayLike, NDArray

from dlo_sim.core.end_motion import EndMotion
from dlo_sim.scene.description import Scene
from dlo_sim.scene.needs import Needs

Array = NDArray[np.float64]
Pose = tuple[Array, Array]
"""Position [m], quaternion x, y, z, w."""


class Outcome(Protocol):
    """How an advance ended."""

    @property
    def ok(self) -> bool: ...


class Advanced(Protocol):
    """What an advance reports; `message` and `note` are one line, or empty."""

    @property
    def status(self) -> Outcome: ...
    @property
    def steps(self) -> int: ...
    @property
    def message(self) -> str: ...
    @property
    def note(self) -> str: ...


class Energies(Protocol):
    """Energies [J]."""

    @property
    def kinetic(self) -> float: ...
    @property
    def total(self) -> float: ...


class Chosen(Protocol):
    """Why this method and step."""

    @property
    def reason(self) -> str: ...


class Stepped(Protocol):
    """What takes motions, loads and steps: a simulator, alone or with its companions."""

    def set_motion(self, end: str, motion: EndMotion) -> None: ...
    def set_load(
        self, name: str, force: ArrayLike | None = None, torque: ArrayLike | None = None
    ) -> None: ...
    def end_pose(self, end: str) -> tuple[Array, Array]: ...
    def advance_steps(self, steps: int) -> Advanced: ...


class Observable(Protocol):
    """What outputs are made from."""

    @property
    def control_points(self) -> Array: ...
    def centerline(self, u: ArrayLike) -> Array: ...
    def tension(self, u: ArrayLike) -> Array: ...
    def curvature(self, u: ArrayLike) -> Array: ...
    def control_poses(self, out: Array) -> None: ...
    def reaction_wrench(self, end: str) -> tuple[float, ...]: ...


class State(Protocol):
    """All that a simulator needs to go on from."""

    @property
    def scene(self) -> Scene: ...
    @property
    def steps(self) -> int: ...
    @property
    def remainder(self) -> float: ...
    @property
    def needs(self) -> Needs: ...
    @property
    def state(self) -> Array: ...
    @property
    def inputs(self) -> Array: ...


class CableSimulator(Stepped, Observable, Protocol):
    """A simulator of one cable."""

    @property
    def time(self) -> float: ...
    @property
    def step(self) -> float: ...
    @property
    def method(self) -> str: ...
    @property
    def choice(self) -> Chosen: ...
    @property
    def greville(self) -> Array: ...
    @property
    def active_terms(self) -> tuple[str, ...]: ...
    @property
    def left_out(self) -> Mapping[str, str]: ...
    @property
    def warnings(self) -> tuple[str, ...]: ...
    def energy(self) -> Energies: ...
    def reset(self) -> None: ...
    def snapshot(self) -> Any: ...
    def restore(self, snapshot: Any) -> None: ...
    def reconfigured(self, scene: Scene) -> Self: ...
    def take_over(self, other: Self) -> None: ...


class SimulatorFactory(Protocol):
    """Builds a simulator, its ends at these poses: position [m], quaternion x, y, z, w."""

    def __call__(
        self, scene: Scene, end_poses: Mapping[str, Pose] | None = None
    ) -> CableSimulator: ...
