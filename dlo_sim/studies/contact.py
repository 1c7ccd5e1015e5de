"""`dlo_sim study contact`: contact and friction with known answers, error against run time.

Each test is a function of its resolution, a step or a number of control points, that returns what
was measured beside the exact value, and the processor time of the steps.
"""

from __future__ import annotations

import math
import time
from collections.abc import Callable
from functools import partial
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from dlo_sim.core import bspline, rotations
from dlo_sim.core.end_motion import EndMotion
from dlo_sim.scene.loading import scene_from_values
from dlo_sim.simulation.simulator import Simulator
from dlo_sim.studies import Outcome, Request
from dlo_sim.studies.report import Report

Array = NDArray[np.float64]
Values = dict[str, object]

ROD_FRICTION, ROD_GRAVITY = 0.4, 9.8
ROD: Values = {
    "cable.length": 1.0,
    "cable.diameter": 0.05,
    "cable.linear_density": 1.0,
    "cable.axial_stiffness": 1e7,
    "gravity": [0.0, 0.0, -ROD_GRAVITY],
    "start.fixed": [False] * 3,
    "start.position": [0.0, 0.0, 0.02495],
    "end.position": [1.0, 0.0, 0.02495],
    "obstacles.names": ["table"],
    "obstacles.table.friction": ROD_FRICTION,
    "terms.out_of_plane": "off",
    "discretization.control_points": 13,
}
EI, WEIGHT, LIFT, STIFF = 0.01, 0.5, 5e-3, 1e6  # [N m^2], [N/m], [m], [N/m^2]
LYING: Values = {
    "cable.length": 0.6,
    "cable.diameter": 0.005,
    "cable.linear_density": WEIGHT / 9.81,
    "cable.axial_stiffness": 5e3,
    "cable.bending_stiffness": EI,
    "start.fixed": [False] * 3,
    "start.position": [0.0, 0.0, 0.0025],
    "end.position": [0.6, 0.0, 0.0025],
    "obstacles.names": ["table"],
    "contact.stiffness": STIFF,
    "terms.out_of_plane": "off",
    "discretization.knots": "uniform",
}
LIFTED: Values = {"end.tangent": [1.0, 0.0, 0.0], "damping.mass": 3.0, "damping.bend": 1e-3}
BELT_FRICTION, DRUM_FRICTION = 0.5, 0.3


class Answer(NamedTuple):
    """A measured quantity beside its exact value."""

    quantity: str
    exact: float
    value: float

    @property
    def error(self) -> float:
        """Relative error."""
        return self.value / self.exact - 1.0


class Measured(NamedTuple):
    """Answers of one run, and the processor time [s] of its steps."""

    answers: tuple[Answer, ...]
    seconds: float
    simulator: Simulator


def simulator(*values: Values, step: float, method: str = "energy_momentum") -> Simulator:
    """A simulator of merged values."""
    merged: Values = {"integrator.method": method, "integrator.step": step}
    for one in values:
        merged |= one
    return Simulator(scene_from_values(merged))


def advanced(sim: Simulator, seconds: float) -> float:
    """Advance; returns the processor time [s]."""
    began = time.process_time()
    report = sim.advance(seconds)
    if not report.status.ok:
        raise RuntimeError(f"contact: {report.message}")
    return time.process_time() - began


def pulled(force: float, step: float, method: str = "energy_momentum") -> Simulator:
    """A rod that lies on a table, pulled along itself."""
    load: Values = {"loads.names": ["pull"], "loads.pull.signal": "constant"}
    return simulator(ROD, load, {"loads.pull.force": [force, 0.0, 0.0]}, step=step, method=method)


def sliding(force: float, step: float) -> Measured:
    """Kinetic energy (F - mu m g)^2 t^2 / (2 m) of a rod that is pulled for 1 s."""
    sim = pulled(force, step)
    seconds = advanced(sim, 1.0)
    exact = 0.5 * (force - ROD_FRICTION * ROD_GRAVITY) ** 2
    return Measured((Answer("kinetic energy [J]", exact, sim.energy().kinetic),), seconds, sim)


def motion(seconds: float, position: Array, velocity: Array) -> EndMotion:
    """A motion at constant velocity from time 0."""
    return EndMotion(
        start=0.0,
        duration=seconds,
        position=position,
        orientation=rotations.IDENTITY,
        velocity=velocity,
    )


def lifted(clamped: bool, points: int) -> Measured:
    """The end of a lying cable lifted by delta, and held horizontal or pinned: it lifts off over
    a = (72 EI delta / w)^(1/4) or (24 EI delta / w)^(1/4). A stiffness k of the table lets it lift
    off earlier, by (4 EI / k)^(1/4).
    """
    held: Values = {"discretization.control_points": points, "end.fixed": [False, False, True]}
    if clamped:
        held |= {"end.fixed": [True] * 3, "end.clamped": True}
    sim = simulator(LYING, LIFTED, held, step=1e-3)
    way = np.array([0.0, 0.0, LIFT / 0.5])
    sim.set_motion("end", motion(0.5, np.array([0.6, 0.0, 0.0025]), way))
    seconds = advanced(sim, 6.0)
    length = ((72.0 if clamped else 24.0) * EI * LIFT / WEIGHT) ** 0.25
    u = np.linspace(sim.contact("table").u.max(), 0.6, 20_001)
    off = u[np.flatnonzero(sim.centerline(u)[:, 2] > 0.0025)[0]]
    force, moment = sim.reaction("end")
    answers = [
        Answer("length [m]", length, 0.6 - off + (4.0 * EI / STIFF) ** 0.25),
        Answer("force [N]", WEIGHT * length * (2.0 / 3.0 if clamped else 0.5), force[2]),
    ]
    if clamped:
        answers.append(Answer("moment [N m]", WEIGHT * length**2 / 6.0, abs(moment[1])))
    return Measured(tuple(answers), seconds, sim)


def capstan(wrap: float, points: int, drum: Values | None = None) -> Measured:
    """A flexible cable drawn slowly over a drum against 1 N: the pull is exp(mu wrap) N.

    `drum`: what else than a cylinder it is, of diameter 0.1 m about the y axis.
    """
    radius, tail, thick, half = 0.05, 0.15, 0.0025, 0.5 * wrap
    bend = radius + thick  # of the axis of the cable
    length = wrap * bend + 2.0 * tail
    cosine, sine = math.cos(half), math.sin(half)

    def place(u: float) -> tuple[float, float, float]:
        """Wound over the top of the drum, with straight tails along the tangents."""
        beyond = max(tail - u, 0.0), max(u - length + tail, 0.0)
        angle = min(max((u - tail) / bend, 0.0), wrap) - half
        x = bend * math.sin(angle) + (beyond[1] - beyond[0]) * cosine
        return x, 0.0, bend * math.cos(angle) - (beyond[0] + beyond[1]) * sine

    sim = simulator(
        {
            "cable.length": length,
            "cable.diameter": 2.0 * thick,
            "cable.linear_density": 0.05,
            "cable.axial_stiffness": 500.0,
            "cable.bending_stiffness": 1e-6,
            "gravity": [0.0, 0.0, 0.0],
            "start.position": list(place(0.0)),
            "end.position": list(place(length)),
            "end.fixed": [False] * 3,
            "initial.shape": "straight",
            "loads.names": ["weight"],
            "loads.weight.signal": "constant",
            "loads.weight.force": [cosine, 0.0, -sine],
            "obstacles.names": ["drum"],
            "obstacles.drum.shape": "cylinder",
            "obstacles.drum.size": [2.0 * radius, 2.0 * radius, 0.2],
            "obstacles.drum.orientation": [math.sqrt(0.5), 0.0, 0.0, math.sqrt(0.5)],
            "obstacles.drum.friction": DRUM_FRICTION,
            "contact.stiffness": STIFF,
            "discretization.control_points": points,
            "terms.out_of_plane": "off",
        },
        drum or {},
        step=1e-3,
    )
    wound = np.zeros((points, 4))
    wound[:, :3] = bspline.interpolate(sim.model.knots, np.array([place(u) for u in sim.greville]))
    sim.start_from(wound)
    sim.set_motion("start", motion(4.0, wound[0, :3], -0.02 * np.array([cosine, 0.0, sine])))
    seconds, pulls = advanced(sim, 1.8), []
    for _ in range(40):
        seconds += advanced(sim, 0.03)
        pulls.append(float(np.linalg.norm(sim.reaction("start")[0])))
    exact = math.exp(DRUM_FRICTION * wrap)
    return Measured((Answer("pull [N]", exact, float(np.mean(pulls))),), seconds, sim)


def conveyor(step: float, method: str = "energy_momentum") -> Measured:
    """A rope held at one end on a belt that runs below it: the belt pulls with mu w L."""
    soft: Values = {"cable.bending_stiffness": 1e-4, "discretization.control_points": 40}
    rough: Values = {"start.fixed": [True] * 3, "obstacles.table.friction": BELT_FRICTION}
    sim = simulator(LYING, {"end.fixed": [False] * 3}, soft, rough, step=step, method=method)
    sim.move_obstacle("table", motion(10.0, np.zeros(3), np.array([0.2, 0.0, 0.0])))
    seconds, pulls = advanced(sim, 1.0), []
    for _ in range(100):
        seconds += advanced(sim, 0.01)
        pulls.append(-sim.reaction("start")[0][0])
    exact = BELT_FRICTION * 0.6 * WEIGHT
    return Measured((Answer("force [N]", exact, float(np.mean(pulls))),), seconds, sim)


# Name -> test as a function of its resolution, the resolutions, and the largest error allowed.
TESTS: dict[str, tuple[Callable[..., Measured], tuple[float, ...], float]] = {
    "sliding rod, 5 N": (partial(sliding, 5.0), (1e-2, 5e-3, 1e-3), 0.01),
    "sliding rod, 8 N": (partial(sliding, 8.0), (1e-2, 5e-3, 1e-3), 0.01),
    "sliding rod, 10 N": (partial(sliding, 10.0), (1e-2, 5e-3, 1e-3), 0.01),
    "lifted end, held": (partial(lifted, True), (20, 40, 80), 0.005),
    "lifted end, pinned": (partial(lifted, False), (20, 40, 80), 0.005),
    "capstan, pi/2": (partial(capstan, 0.5 * math.pi), (23, 43, 83), 0.01),
    "capstan, pi": (partial(capstan, math.pi), (43, 83, 123), 0.01),
    "capstan, 2 pi": (partial(capstan, 2.0 * math.pi), (83, 166), 0.01),
    "conveyor": (conveyor, (5e-3, 1e-3), 0.01),
}
HEADER = "test | resolution | quantity | exact | measured | error [%] | allowed [%] | run time [s]"
CHART = "test | run time [s] | largest error [%]"


def run_study(request: Request) -> Outcome:
    """Run the study into a folder."""
    report = Report(request, "Contact and friction: known answers", {})
    rows: list[tuple[object, ...]] = []
    points: list[tuple[str, float, float]] = []
    verdicts = {}
    for number, (name, (test, resolutions, allowed)) in enumerate(TESTS.items()):
        used = resolutions[:2] if request.quick else resolutions
        best = math.inf
        for resolution in used:
            found = test(resolution)
            errors = [answer.error for answer in found.answers]
            best = min(best, max(map(abs, errors)))
            points.append((name, found.seconds, max(map(abs, errors))))
            rows += [
                (name, resolution, one.quantity, one.exact, one.value, one.error, allowed)
                + (found.seconds,)
                for one in found.answers
            ]
        good = "meets" if best <= allowed else "misses"
        verdicts[name] = f"error {best:.2%}, {good} {allowed:.2%}"
        request.progress((number + 1.0) / len(TESTS))
    report.text(
        "The resolution is a step [s] or a number of control points. Run time is processor time of "
        "the steps with energy_momentum, without building the simulator. Lengths of lifted ends "
        "include the (4 EI / k)^(1/4) by which a table of finite stiffness lets go earlier."
    )
    report.table("contact", HEADER, rows, "Known answers")
    report.chart("contact_cost", CHART, points, "Error against run time", log="xy", marker="o")
    return report.outcome(verdicts)
