"""The cases: cables and motions on which settings and simulators are compared."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import NamedTuple

import numpy as np

from dlo_sim.core.end_motion import EndMotion
from dlo_sim.scene.description import Scene
from dlo_sim.scene.loading import load_scene, scene_from_values, shipped_scene
from dlo_sim.studies.work_precision import elastica
from dlo_sim.tuning.trial import Job

CLOSED = 0.2  # [m] by which the gripper of the soft cable closes
CLOSING = 2.0  # [s] it takes: half of it speeding up, half slowing down


@dataclass(frozen=True, eq=False)
class Case:
    """A job and how its error is measured.

    Attributes:
        name: for files. title: for people. job: what is computed.
        hold: how the ends are held, a word of the other simulators' scripts.
        components: world axes of the error. scale: length [m] that errors are a share of.
        scale_words: what that length is. fine: n_u of the two reference runs.
    """

    name: str
    title: str
    job: Job
    hold: str
    components: tuple[int, ...] = (0, 2)
    scale: float = 1.0
    scale_words: str = "the length"
    fine: tuple[int, int] = (33, 41)

    @property
    def scene(self) -> Scene:
        """The cable and its world."""
        return self.job.scene

    def shortened(self, duration: float, fine: tuple[int, int]) -> Case:
        """The same case for a shorter time [s], with coarser references."""
        return replace(self, job=replace(self.job, duration=duration), fine=fine)


class Run(NamedTuple):
    """A run on a case, here or by another simulator: a row of the diagram's data.

    Attributes:
        who: method, or simulator. stretch: where stretching counts; empty of other simulators.
        n_u: control points, or elements. step: [s]. status: `ok`, or why there is no result.
        words: the setting for people. error: as a share of the case's scale; nan without a result.
        wall: least run time of the repeats [s per simulated s]; of one that was too slow to run to
            its end an estimate; nan if it failed. spread: (median - least) / least.
        evaluations: of the force, or Newton iterations, per simulated second.
    """

    who: str
    stretch: str
    n_u: int
    step: float
    status: str
    words: str
    error: float = np.nan
    wall: float = np.nan
    spread: float = np.nan
    evaluations: float = np.nan
    energy_error: float = np.nan

    @property
    def ok(self) -> bool:
        """Whether there is a result."""
        return self.status == "ok"

    @property
    def line(self) -> str:
        """Its line in the diagram."""
        return self.who + (
            f", stretch {self.stretch}" if self.stretch.startswith("by span") else ""
        )


def rod_of(scene: Scene, deformed: bool = False) -> elastica.Rod:
    """The cable's constants for the static shapes."""
    cable = scene.cable
    weight = cable.mu * float(np.linalg.norm(scene.gravity))
    return elastica.Rod(cable.EI, cable.EA, weight, deformed)


def wire(number: int) -> Case:
    """Scenario 1 or 2 of Khalifa & Palli, the middle of the wire over 2 s."""
    name, title, axes = {
        1: ("paper_wire", "Scenario 1: wire, gravity", (2,)),
        2: ("paper_wire_force", "Scenario 2: wire, gravity and a force", (1, 2)),
    }[number]
    scene = load_scene(shipped_scene(name))
    sag = elastica.wire_sag(rod_of(scene), scene.cable.length, scene.start.spring[0])
    job = Job(scene, 2.0, (0.5,))
    return Case(f"scenario_{number}", title, job, "pinned", axes, sag, "the static sag")


def soft_cable() -> Case:
    """A soft cable between two clamps 1 m apart, of which one comes 0.2 m closer within 2 s."""
    values = {**_material(1.0, 0.006, 1200.0, 1e7), "damping.mass": 2.0}
    scene = scene_from_values({**values, **_clamped("start", 0.0), **_clamped("end", 1.0)})
    job = Job(scene, 4.0, (0.5,), 2e-3, closing())
    return Case("soft_grippers", "Soft cable, one gripper moving", job, "clamped")


def closing() -> tuple[tuple[str, EndMotion], ...]:
    """The gripper's way of the soft cable: two parabolas, at rest before and after."""
    half = 0.5 * CLOSING
    push = 0.5 * CLOSED / half**2
    first = np.array([[1.0, 0.0, 0.0], [0.0, 0.0, 0.0], [-push, 0.0, 0.0]])
    second = first.copy()
    second[:, 0] = 1.0 - 0.5 * CLOSED, -2.0 * push * half, push
    still = np.array([0.0, 0.0, 0.0, 1.0]), np.zeros((2, 3))
    return (
        ("end", EndMotion(0.0, half, first, *still)),
        ("end", EndMotion(half, half, second, *still)),
    )


def cantilever() -> Case:
    """A rubber cord let go from a straight line, clamped at one end: it falls by 0.9 of itself."""
    values = {**_material(0.3, 0.005, 1100.0, 5e6), **_clamped("start", 0.0)}
    scene = scene_from_values({**values, "end.position": [0.3, 0.0, 0.0]})
    job = Job(scene, 1.0, (1.0,))
    return Case("cantilever", "Cantilever, large deflection", job, "cantilever", scale=0.3)


def steel() -> Case:
    """A steel wire, 0.5 m by 1 mm, clamped at one end and let go from a straight line."""
    values = {**_material(0.5, 0.001, 7850.0, 2.1e11, 8e10), **_clamped("start", 0.0)}
    job = Job(scene_from_values({**values, "end.position": [0.5, 0.0, 0.0]}), 1.0, (1.0,))
    title = "Stiff steel wire"
    return Case("steel_wire", title, job, "cantilever", scale=0.5, fine=(25, 33))


def chain() -> Case:
    """A hanging rope, let go at 30 degrees: no stiffness to speak of but its own tension."""
    angle = np.radians(30.0)
    scene = scene_from_values(
        {
            "cable.length": 1.0,
            "cable.linear_density": 0.1,
            "cable.axial_stiffness": 1.0e4,
            "cable.bending_stiffness": 1.0e-4,
            "end.position": [float(np.sin(angle)), 0.0, -float(np.cos(angle))],
            "initial.shape": "straight",
        }
    )
    job = Job(scene, 2.0, (0.5, 1.0))
    return Case("hanging_chain", "Hanging chain", job, "hanging", fine=(49, 65))


def all_cases(quick: bool) -> list[Case]:
    """The six cases; a quick study has four for a quarter of the time, on coarser references."""
    if not quick:
        return [wire(1), wire(2), soft_cable(), cantilever(), chain(), steel()]
    cases = [wire(1), soft_cable(), cantilever(), steel()]
    return [case.shortened(0.25 * case.job.duration, (17, 21)) for case in cases]


def _material(
    length: float, diameter: float, density: float, modulus: float, shear: float | None = None
) -> dict[str, object]:
    return {
        "cable.length": length,
        "cable.diameter": diameter,
        "cable.density": density,
        "cable.youngs_modulus": modulus,
        "cable.shear_modulus": shear or modulus / 3.0,
        "initial.shape": "straight",
    }


def _clamped(end: str, x: float) -> dict[str, object]:
    return {
        f"{end}.position": [x, 0.0, 0.0],
        f"{end}.fixed": [True] * 3,
        f"{end}.clamped": True,
        f"{end}.tangent": [1.0, 0.0, 0.0],
    }
