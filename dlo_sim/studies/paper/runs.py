"""The paper's two scenarios, and how this study runs them."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from typing import Any, TypeVar

import numpy as np
from numpy.typing import NDArray

from dlo_sim.batch.workers import Workers
from dlo_sim.core.methods import METHODS
from dlo_sim.scene.description import Scene
from dlo_sim.scene.loading import load_scene, shipped_scene
from dlo_sim.simulation.recording import Recording, record
from dlo_sim.simulation.simulator import Simulator

Array = NDArray[np.float64]
Result = TypeVar("Result")

SCENES = {1: "paper_wire", 2: "paper_wire_force"}
SCENARIOS = {1: "scenario 1 (gravity)", 2: "scenario 2 (gravity and a force)"}
COMPARED = ("forest_ruth", "rk4", "zhai", "velocity_verlet")
SHARE = 0.9  # of the stability limit, in every comparison at "its own step"
NEGLIGIBLE = 1e-12  # a stiffness times this is as good as absent
OFF_STEP = 0.01037  # [s] between samples of energies: no multiple of any step


@dataclass(frozen=True)
class Settings:
    """Length of the study: `quick` keeps every table and figure and shortens the runs."""

    quick: bool

    @property
    def duration(self) -> float:
        """Simulated time of the runs whose motion is shown [s]."""
        return 2.0 if self.quick else 10.0

    @property
    def short(self) -> float:
        """Simulated time of runs that end before rounding errors have grown [s]."""
        return 0.5 if self.quick else 1.0

    @property
    def comparison(self) -> float:
        """Simulated time of runs that are compared with finer ones [s]."""
        return 1.0 if self.quick else 10.0


def scenario(number: int, **values: object) -> Scene:
    """A scenario of the paper; keyword `axial_stiffness=...` etc. by `values` with dots as `__`."""
    dotted = {key.replace("__", "."): value for key, value in values.items()}
    return load_scene(shipped_scene(SCENES[number]), dotted)


def scene_files() -> dict[str, Path]:
    """Scene files of both scenarios by name."""
    return {name: shipped_scene(name) for name in SCENES.values()}


def at_method(scene: Scene, method: str, step: float = 0.0) -> Scene:
    """The scene with this method and step; 0 = its own step, `SHARE` of the stability limit."""
    return scene.with_values({"integrator.method": method, "integrator.step": step})


def softened(scene: Scene, factor: float) -> Scene:
    """The scene with axial stiffness and end springs divided by a factor: constants CHANGED."""
    springs = {
        f"{name}.spring": [value / factor for value in end.spring]
        for name, end in scene.ends.items()
    }
    return scene.with_values({"cable.axial_stiffness": scene.cable.EA / factor, **springs})


def bending_alone(scene: Scene) -> Scene:
    """The scene with axial stiffness and end springs as good as absent: constants CHANGED."""
    return softened(scene, 1.0 / NEGLIGIBLE)


def step_limit(scene: Scene, method: str = "forest_ruth") -> float:
    """Largest stable step [s] of the linearised scene."""
    return Simulator(at_method(scene, method)).choice.limit


def highest_frequency(scene: Scene) -> float:
    """Largest natural frequency [rad/s] of the linearised scene."""
    return METHODS["rk4"].stability_limit / step_limit(scene, "rk4")


def softening(scene: Scene, step: float) -> float:
    """Factor by which axial stiffness and springs must fall for Forest-Ruth to bear a step [s].

    Infinite if bending alone forbids the step.
    """
    if step_limit(bending_alone(scene)) < step:
        return float("inf")
    low, high = 1.0, 1e9
    while high / low > 1.0 + 1e-6:
        middle = float(np.sqrt(low * high))
        stable = step_limit(softened(scene, middle)) >= step
        low, high = (low, middle) if stable else (middle, high)
    return high


def run(scene: Scene, duration: float, every: float) -> Recording:
    """A recorded run that has to reach its end.

    Raises:
        RuntimeError: it failed, with the simulator's own line.
    """
    recording = record(scene, duration, every)
    if not recording.ok:
        raise RuntimeError(f"a run of the study failed: {recording.message}")
    return recording


def each(
    workers: Workers, function: Callable[..., Result], arguments: Sequence[tuple[Any, ...]]
) -> list[Result]:
    """What a function of a module gives for each tuple of arguments; for what is not timed."""
    return list(workers.map(partial(_called, function), arguments))


def _called(function: Callable[..., Result], arguments: tuple[Any, ...]) -> Result:
    return function(*arguments)


def distance(one: Recording, other: Recording) -> Array:
    """Largest distance [m] between two centerlines over time, shape (T,)."""
    count = min(len(one.time), len(other.time))
    gap = one.centerline[:count] - other.centerline[:count]
    return np.asarray(np.linalg.norm(gap, axis=2).max(axis=1))


def growth_exponent(time: Array, error: Array, start: float, end: float) -> float:
    """Exponent of t in the running maximum of an error, fitted between two times [s]."""
    envelope = np.maximum.accumulate(error)
    chosen = (time >= start) & (time <= end) & (envelope > 0.0)
    return float(np.polyfit(np.log(time[chosen]), np.log(envelope[chosen]), 1)[0])
