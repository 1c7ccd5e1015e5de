"""The cases: cables and motions for the comparison of settings and simulators."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import NamedTuple

import numpy as np

from dlo_sim.core import rotations
from dlo_sim.core.end_motion import EndMotion
from dlo_sim.scene.description import Scene
from dlo_sim.scene.loading import load_scene, scene_from_values, shipped_scene
from dlo_sim.studies import analytic
from dlo_sim.studies.runs import Array
from dlo_sim.tuning.trial import Job, error

CLOSED = 0.2  # [m] by which the gripper of the soft cable closes
CLOSING = 2.0  # [s], duration of this motion: half of it accelerating, half decelerating


@dataclass(frozen=True, eq=False)
class Case:
    """A job and how its error is measured.

    Attributes:
        name: for files. hold: how the ends are held, a keyword for the other simulators.
        components: world axes of the error. scale: length [m] that errors are relative to.
        fine: n_u of the two reference runs.
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
        """The scene of the job."""
        return self.job.scene

    def error(self, points: Array, truth: Array) -> float:
        """Error of positions (T, m, 3) as a share of the scale; see `trial.error`."""
        return error(points, truth, self.components) / self.scale

    def shortened(self, duration: float, fine: tuple[int, int]) -> Case:
        """The same case for a shorter time [s], with coarser references."""
        return replace(self, job=replace(self.job, duration=duration), fine=fine)


class Run(NamedTuple):
    """A run of a case with a setting or by another simulator: a row of the diagram's data.

    Attributes:
        who: method, or simulator. stretch: evaluation of stretching; empty for other simulators.
        n_u: control points, or elements. step: [s]. status: `ok`, or why there is no result.
        words: the setting as text. error: relative to the case's scale; nan without a result.
        wall: least run time of the repeats [s per simulated s], estimated for a run that was too
            slow, nan for a failed one. spread: (median - least) / least.
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
        """Label of its line in the diagram."""
        by_span = self.stretch.startswith("by span")
        return f"{self.who}, stretch {self.stretch}" if by_span else self.who


def rod_of(scene: Scene, deformed: bool = False) -> analytic.Rod:
    """The cable's constants for `analytic`."""
    cable = scene.cable
    weight = cable.mu * float(np.linalg.norm(scene.gravity))
    return analytic.Rod(cable.EI, cable.EA, weight, deformed)


def wire(number: int) -> Case:
    """Scenario 1 or 2 of Khalifa & Palli, the middle of the wire over 2 s."""
    name, title, axes = {
        1: ("paper_wire", "Scenario 1: wire, gravity", (2,)),
        2: ("paper_wire_force", "Scenario 2: wire, gravity and a force", (1, 2)),
    }[number]
    job = Job(load_scene(shipped_scene(name)), 2.0, (0.5,))
    length, spring = job.scene.cable.length, job.scene.start.spring[0]
    sag = analytic.sag(rod_of(job.scene), length, length, spring)
    return Case(f"scenario_{number}", title, job, "pinned", axes, sag, "the static sag")


def soft_cable() -> Case:
    """A soft cable between two clamps 1 m apart, one of which moves 0.2 m closer within 2 s."""
    far = {"end.fixed": [True] * 3, "end.clamped": True, "end.tangent": [1.0, 0.0, 0.0]}
    scene = _clamped(1.0, 0.006, 1200.0, 1e7, **{"damping.mass": 2.0}, **far)
    job = Job(scene, 4.0, (0.5,), 2e-3, closing())
    return Case("soft_grippers", "Soft cable, one gripper moving", job, "clamped", fine=(49, 65))


def closing() -> tuple[tuple[str, EndMotion], ...]:
    """Motion of the soft cable's gripper: it speeds up and slows down, at rest before and after."""
    half = 0.5 * CLOSING
    pull = (CLOSED / half**2, 0.0, 0.0)  # [m/s^2]
    first = EndMotion(
        start=0.0,
        duration=half,
        position=(1.0, 0.0, 0.0),
        orientation=rotations.IDENTITY,
        acceleration=-np.array(pull),
    )
    return ("end", first), ("end", first.then(half, acceleration=pull))


def cantilever() -> Case:
    """A rubber cord clamped at one end, released straight: its tip falls by 0.9 of the length."""
    job, title = Job(_clamped(0.3, 0.005, 1100.0, 5e6), 1.0, (1.0,)), "Cantilever, large deflection"
    return Case("cantilever", title, job, "cantilever", scale=0.3, fine=(49, 65))


def steel() -> Case:
    """A steel wire, 0.5 m by 1 mm, clamped at one end and released straight."""
    steel_wire = _clamped(0.5, 0.001, 7850.0, 2.1e11, **{"cable.shear_modulus": 8e10})
    job = Job(steel_wire, 1.0, (1.0,))
    return Case("steel_wire", "Stiff steel wire", job, "cantilever", scale=0.5, fine=(25, 33))


def chain() -> Case:
    """A hanging rope, released at 30 degrees, with negligible bending stiffness."""
    angle = np.radians(30.0)
    scene = scene_from_values(
        {
            "cable.length": 1.0,
            "cable.linear_density": 0.1,
            "cable.axial_stiffness": 1.0e4,
            "cable.bending_stiffness": 1.0e-4,
            "end.position": [float(np.sin(angle)), 0.0, -float(np.cos(angle))],
            "initial.shape": "straight",
            "terms.twist": "off",
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


def _clamped(
    length: float, diameter: float, density: float, modulus: float, **more: object
) -> Scene:
    """A straight round cable along x, clamped at its start."""
    values = {
        "cable.length": length,
        "cable.diameter": diameter,
        "cable.density": density,
        "cable.youngs_modulus": modulus,
        "cable.shear_modulus": modulus / 3.0,
        "initial.shape": "straight",
        "start.clamped": True,
        "start.tangent": [1.0, 0.0, 0.0],
        "end.position": [length, 0.0, 0.0],
        "terms.twist": "off",
    }
    return scene_from_values(values | more)
