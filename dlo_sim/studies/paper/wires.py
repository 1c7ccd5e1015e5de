"""The paper's two scenarios, their variants, and what the sections of the study share."""

from __future__ import annotations

from dataclasses import dataclass, field
from functools import cache

from dlo_sim.batch.workers import Workers
from dlo_sim.scene.description import Scene
from dlo_sim.scene.loading import load_scene, shipped_scene
from dlo_sim.simulation.simulator import Simulator
from dlo_sim.studies.report import Report
from dlo_sim.studies.runs import at_method, bisected

SCENES = {1: "paper_wire", 2: "paper_wire_force"}
SCENARIOS = {1: "scenario 1 (gravity)", 2: "scenario 2 (gravity and a force)"}
COMPARED = ("forest_ruth", "rk4", "zhai", "velocity_verlet")
NEGLIGIBLE = 1e-12  # factor that makes a stiffness negligible


@dataclass
class Paper:
    """One run of the study. `factor`: division of axial stiffness and springs that makes 2 ms
    stable with Forest-Ruth; `found`: findings, name with unit -> value, on which verdicts rest.
    """

    report: Report
    workers: Workers
    quick: bool
    factor: float
    found: dict[str, float] = field(default_factory=dict)

    @property
    def comparison(self) -> float:
        """Simulated time of runs that are compared with finer ones [s]."""
        return 1.0 if self.quick else 10.0


@cache
def scenario(number: int, **values: object) -> Scene:
    """A scenario of the paper with values changed; their dots as `__`: `cable__length=2.0`."""
    dotted = {key.replace("__", "."): value for key, value in values.items()}
    return load_scene(shipped_scene(SCENES[number]), dotted)


def softened(scene: Scene, factor: float) -> Scene:
    """The scene with axial stiffness and end springs divided by a factor: constants CHANGED."""
    axial = {"cable.axial_stiffness": scene.cable.EA / factor}
    return scene.with_values({**axial, **springs_over(scene, factor)})


def springs_over(scene: Scene, factor: float) -> dict[str, object]:
    """Values of the end springs divided by a factor."""
    return {f"{k}.spring": [x / factor for x in end.spring] for k, end in scene.ends.items()}


def bending_alone(scene: Scene) -> Scene:
    """The scene with negligible axial stiffness and end springs: constants CHANGED."""
    return softened(scene, 1.0 / NEGLIGIBLE)


def step_limit(scene: Scene, method: str = "forest_ruth") -> float:
    """Largest stable step [s] of the linearised scene."""
    return Simulator(at_method(scene, method)).choice.limit


def softening(scene: Scene, step: float) -> float:
    """Division of axial stiffness and springs that makes a step [s] stable with Forest-Ruth.

    Infinite if the step is unstable with bending alone.
    """
    if step_limit(bending_alone(scene)) < step:
        return float("inf")
    unstable = lambda factor: step_limit(softened(scene, factor)) < step  # noqa: E731
    return (1.0 + 1e-6) * bisected(unstable, 1.0, 1e9, 1e-6)
