"""The cases: cables and motions on which settings and simulators are compared."""

from __future__ import annotations

from dataclasses import dataclass, replace

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
        components: world axes of the error. scale: length [m] that errors are a share of.
        scale_words: what that length is. fine: n_u of the two reference runs.
        damped: damping excludes methods with negative sub-steps.
    """

    name: str
    title: str
    job: Job
    components: tuple[int, ...]
    scale: float
    scale_words: str
    fine: tuple[int, int]
    damped: bool = False

    @property
    def scene(self) -> Scene:
        """The cable and its world."""
        return self.job.scene

    def shortened(self, duration: float, fine: tuple[int, int]) -> Case:
        """The same case for a shorter time [s], with coarser references."""
        return replace(self, job=replace(self.job, duration=duration), fine=fine)


def rod_of(scene: Scene) -> elastica.Rod:
    """The cable's constants for the static shapes."""
    cable = scene.cable
    weight = cable.mu * float(np.linalg.norm(scene.gravity))
    return elastica.Rod(cable.EI, cable.EA, weight)


def wire(number: int) -> Case:
    """Scenario 1 or 2 of Khalifa & Palli, the middle of the wire over 2 s."""
    name = {1: "paper_wire", 2: "paper_wire_force"}[number]
    scene = load_scene(shipped_scene(name))
    sag = elastica.wire_sag(rod_of(scene), scene.cable.length, scene.start.spring[0])
    title = {1: "Scenario 1: wire, gravity", 2: "Scenario 2: wire, gravity and a force"}[number]
    return Case(
        f"scenario_{number}",
        title,
        Job(scene, 2.0, (0.5,)),
        (2,) if number == 1 else (1, 2),
        sag,
        "the static sag",
        (33, 41),
    )


def soft_cable(duration: float = 4.0) -> Case:
    """A soft cable between two clamps 1 m apart, of which one comes 0.2 m closer within 2 s."""
    scene = scene_from_values(
        {
            "cable.length": 1.0,
            "cable.diameter": 0.006,
            "cable.density": 1200.0,
            "cable.youngs_modulus": 1.0e7,
            "cable.shear_modulus": 1.0e7 / 3.0,
            "damping.mass": 2.0,
            **_clamped("start", (0.0, 0.0, 0.0)),
            **_clamped("end", (1.0, 0.0, 0.0)),
            "initial.shape": "straight",
        }
    )
    job = Job(scene, duration, (0.5,), 2e-3, closing())
    title = "Soft cable, one gripper moving"
    return Case("soft_grippers", title, job, (0, 2), 1.0, "the length", (33, 41), damped=True)


def closing() -> tuple[tuple[str, EndMotion], ...]:
    """The gripper's way of the soft cable: two parabolas, at rest before and after."""
    half = 0.5 * CLOSING
    push = 0.5 * CLOSED / half**2
    first = np.array([[1.0, 0.0, 0.0], [0.0, 0.0, 0.0], [-push, 0.0, 0.0]])
    second = first.copy()
    second[0, 0] -= 0.5 * CLOSED
    second[1, 0] = -2.0 * push * half
    second[2, 0] = push
    still = np.array([0.0, 0.0, 0.0, 1.0]), np.zeros((2, 3))
    return (
        ("end", EndMotion(0.0, half, first, *still)),
        ("end", EndMotion(half, half, second, *still)),
    )


def gap_at(t: float) -> float:
    """Distance [m] of the soft cable's grippers at time t [s]."""
    motions = [motion for _, motion in closing()]
    motion = motions[0] if t < motions[1].start else motions[1]
    return float(motion.position_at(t)[0])


def cantilever() -> Case:
    """A rubber cord let go from a straight line, clamped at one end: it falls by 0.9 of itself."""
    scene = scene_from_values(
        {
            "cable.length": 0.3,
            "cable.diameter": 0.005,
            "cable.density": 1100.0,
            "cable.youngs_modulus": 5.0e6,
            "cable.shear_modulus": 5.0e6 / 3.0,
            **_clamped("start", (0.0, 0.0, 0.0)),
            "end.position": [0.3, 0.0, 0.0],
            "initial.shape": "straight",
        }
    )
    job = Job(scene, 1.0, (1.0,))
    title = "Cantilever, large deflection"
    return Case("cantilever", title, job, (0, 2), 0.3, "the length", (33, 41))


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
    return Case("hanging_chain", "Hanging chain", job, (0, 2), 1.0, "the length", (49, 65))


def steel() -> Case:
    """A steel wire, 0.5 m by 1 mm, clamped at one end and let go from a straight line."""
    scene = scene_from_values(
        {
            "cable.length": 0.5,
            "cable.diameter": 0.001,
            "cable.density": 7850.0,
            "cable.youngs_modulus": 2.1e11,
            "cable.shear_modulus": 8.0e10,
            **_clamped("start", (0.0, 0.0, 0.0)),
            "end.position": [0.5, 0.0, 0.0],
            "initial.shape": "straight",
        }
    )
    job = Job(scene, 1.0, (1.0,))
    return Case("steel_wire", "Stiff steel wire", job, (0, 2), 0.5, "the length", (25, 33))


def all_cases(quick: bool) -> list[Case]:
    """The six cases; a quick study runs them for a quarter of the time on coarser references."""
    cases = [wire(1), wire(2), soft_cable(), cantilever(), chain(), steel()]
    if not quick:
        return cases
    return [case.shortened(0.25 * case.job.duration, (17, 21)) for case in cases]


def _clamped(end: str, position: tuple[float, float, float]) -> dict[str, object]:
    return {
        f"{end}.position": list(position),
        f"{end}.fixed": [True] * 3,
        f"{end}.clamped": True,
        f"{end}.tangent": [1.0, 0.0, 0.0],
    }
