"""Tests of study contact in which the cable touches obstacles.

Each is a function of its resolution, a step or a number of control points.
"""

from __future__ import annotations

import math
import warnings
from collections.abc import Callable
from functools import partial

import numpy as np

from dlo_sim.core import bspline, mass, rotations
from dlo_sim.core.end_motion import EndMotion
from dlo_sim.simulation.obstacles import BRISTLES, stiffness
from dlo_sim.simulation.simulator import Simulator
from dlo_sim.studies.known_answers import (
    Answer,
    Array,
    Measured,
    Values,
    advanced,
    motion,
    simulator,
)

ROD_FRICTION, ROD_GRAVITY = 0.4, 9.8
ROD: Values = {
    "cable.length": 1.0,
    "cable.diameter": 0.05,
    "cable.linear_density": 1.0,
    "cable.axial_stiffness": 1e7,
    "gravity": [0.0, 0.0, -ROD_GRAVITY],
    "start.fixed": [False] * 3,
    "start.position": [0.0, 0.0, 0.025],
    "end.position": [1.0, 0.0, 0.025],
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
# Radius of the drum, straight ends, radius of the cable [m].
DRUM, TAIL, THICK = 0.05, 0.15, 0.0025


def pulled(force: float, step: float, method: str = "energy_momentum") -> Simulator:
    """A rod that lies on a table, pulled along itself."""
    load: Values = {"loads.names": ["pull"], "loads.pull.signal": "constant"}
    return simulator(ROD, load, {"loads.pull.force": [force, 0.0, 0.0]}, step=step, method=method)


def sliding(force: float, step: float) -> Measured:
    """Kinetic energy (F - mu m g)^2 t^2 / (2 m) of a rod that is pulled for 1 s."""
    sim = pulled(force, step)
    seconds = advanced(sim, 1.0)
    exact = 0.5 * (force - ROD_FRICTION * ROD_GRAVITY) ** 2
    answer = Answer("kinetic energy [J]", exact, sim.energy().kinetic, 0.01)
    return Measured((answer,), seconds, sim)


def pull_slowly(sim: Simulator, force: float) -> None:
    """Let the pull of `pulled` grow to a force [N] within a tenth of a second."""
    for share in np.linspace(0.02, 1.0, 50):
        sim.set_load("pull", force=(force * float(share), 0.0, 0.0))
        sim.advance(0.002)


def sticking(force: float, step: float) -> Measured:
    """A rod that is pulled with less than its friction moves by the bristles' deflection alone."""
    sim = pulled(0.0, step)
    before = sim.centerline([0.5])[0]
    pull_slowly(sim, force)
    seconds = advanced(sim, 60.0)
    moved = float((sim.centerline([0.5])[0] - before)[0])
    elastic = force / (BRISTLES * stiffness(sim.scene, sim.scene.bodies[0]))
    answer = Answer("slid in 60 s [m]", 0.0, moved - elastic, 1e-6)
    return Measured((answer,), seconds, sim)


YAW = math.pi / 18.0  # [rad]
FALLEN: Values = {
    "cable.length": 0.5,
    "cable.diameter": 0.01,
    "cable.density": 1200.0,
    "cable.youngs_modulus": 1e7,
    "start.fixed": [False] * 3,
    "start.position": [0.0, 0.0, 0.05],
    "obstacles.names": ["table"],
    "discretization.control_points": 13,
}


def fallen(yaw: float) -> Values:
    """A cable above a table, seen from above at an angle to the x axis."""
    return FALLEN | {"end.position": [0.45 * math.cos(yaw), 0.45 * math.sin(yaw), 0.15]}


def rest(yaw: float, step: float) -> Measured:
    """A cable that has fallen on a table lies still: the table carries its weight."""
    sim = simulator(fallen(yaw), {"damping.mass": 5.0, "damping.stiffness": 0.01}, step=step)
    seconds = advanced(sim, 30.0)
    weight = sim.scene.cable.mu * 9.81 * 0.5
    answers = (
        Answer("force [N]", weight, float(sim.contact("table").force[2]), 0.001),
        Answer("kinetic energy after 30 s [J]", 0.0, sim.energy().kinetic, 1e-9),
    )
    return Measured(answers, seconds, sim)


RESTITUTION, HEIGHT = 0.6, 0.2  # height [m] from which a rod bounces


def bounce(step: float) -> Measured:
    """A rod that falls flat from a height h rises to restitution^2 h again. A step lands it up to a
    step late, so that it is up to that times its speed too low.
    """
    fallen: Values = {"contact.restitution": RESTITUTION, "integrator.tolerance": 1e-12}
    level: Values = {
        f"{end}.position": [x, 0.0, 0.025 + HEIGHT] for end, x in (("start", 0.0), ("end", 1.0))
    }
    sim = simulator(ROD, fallen, level, step=step)
    landing = math.sqrt(2.0 * HEIGHT / ROD_GRAVITY)
    seconds = advanced(sim, 1.2 * landing)
    risen = 0.0
    while sim.time < landing * (1.0 + 1.5 * RESTITUTION):
        seconds += advanced(sim, step)
        risen = max(risen, float(sim.centerline([0.5])[0, 2]) - 0.025)
    answers = (
        Answer("height [m]", RESTITUTION**2 * HEIGHT, risen, 0.01),
        Answer("energy account open by", 0.0, sim.energy_error, 1e-8),
    )
    return Measured(answers, seconds, sim)


HEIGHTS = (0.02, 0.05, 0.1, 0.2, 0.4, 0.6)  # [m]
ROPE: Values = {
    "cable.length": 1.0,
    "cable.diameter": 0.006,
    "start.fixed": [False] * 3,
    "contact.friction": 0.5,
    "contact.self": "on",
    "obstacles.names": ["table"],
}


def drop(step: float) -> Measured:
    """A rope that falls flat on a table moves as at an eighth of the step, and lies where it
    lands.
    """
    apart, seconds, weight, kinetic = 0.0, 0.0, 0.0, 0.0
    for height in HEIGHTS:
        places: Values = {"start.position": [0.0, 0.0, height], "end.position": [1.0, 0.0, height]}
        sim = simulator(ROPE, places, step=step)
        finer = simulator(ROPE, places, step=0.125 * step)
        for _ in range(round(0.6 / step)):
            seconds += advanced(sim, step)
            advanced(finer, step)
            way = centre_of_mass(sim) - centre_of_mass(finer)
            apart = max(apart, float(np.linalg.norm(way)))
        weight = sim.scene.cable.mu * 9.81
        kinetic = max(kinetic, sim.energy().kinetic / (weight * height))
    answers = (
        Answer("centre of mass, at an eighth of the step elsewhere by [m]", 0.0, apart, 5e-3),
        Answer("kinetic energy afterwards, of that of the fall", 0.0, kinetic, 1e-9),
        Answer("force [N]", weight, float(sim.contact("table").force[2]), 0.001),
    )
    return Measured(answers, seconds, sim)


def centre_of_mass(sim: Simulator) -> Array:
    """Of the cable [m], shape (3,)."""
    shares = mass.dense(sim.model.mass(0)).sum(axis=0)
    return np.asarray(shares @ sim.control_points[:, :3] / shares.sum())


def plug(modulus: float, points: int) -> Measured:
    """A rod of 5 cm that is pushed 0.2 mm against a face, beyond its round tip: EA d / L."""
    length, thick, pushed, gap = 0.05, 0.01, 2e-4, 1e-4
    sim = simulator(
        {
            "cable.length": length,
            "cable.diameter": thick,
            "cable.density": 1000.0,
            "cable.youngs_modulus": modulus,
            "gravity": [0.0, 0.0, 0.0],
            "damping.mass": 20.0,
            "damping.stiffness": 1e-3,
            "start.clamped": True,
            "end.position": [length, 0.0, 0.0],
            "end.fixed": [False] * 3,
            "obstacles.names": ["face"],
            "obstacles.face.shape": "cylinder",
            "obstacles.face.size": [0.1, 0.1, 0.05],
            "obstacles.face.position": [length + 0.5 * thick + gap + 0.025, 0.0, 0.0],
            "obstacles.face.orientation": [0.0, math.sqrt(0.5), 0.0, math.sqrt(0.5)],
            "discretization.control_points": points,
        },
        step=1e-3,
    )
    way = np.array([pushed + gap, 0.0, 0.0])
    sim.set_motion("start", motion(1.5, np.zeros(3), way / 1.5))
    seconds = advanced(sim, 3.0)
    exact = sim.scene.cable.EA * pushed / length
    answer = Answer("force [N]", exact, -float(sim.contact("face").force[0]), 0.05)
    return Measured((answer,), seconds, sim)


def slope(step: float) -> Measured:
    """The coefficient of friction, from what a rod slides down a slope 5 % too steep for it, in the
    seconds from 5 to 10, and what it creeps in these on one 0.5 % less steep than it can hold.
    """
    seconds, slid = 0.0, []
    for share in (0.995, 1.05):
        angle = math.atan(ROD_FRICTION * share)
        cosine, sine = math.cos(angle), math.sin(angle)
        turned = rotations.from_rotation_vector(np.array([0.0, -angle, 0.0]))
        start = 0.025 * np.array([-sine, 0.0, cosine])
        along = np.array([cosine, 0.0, sine])
        tilted: Values = {
            "obstacles.table.orientation": turned.tolist(),
            "start.position": start.tolist(),
            "end.position": (start + along).tolist(),
        }
        sim = simulator(ROD, tilted, step=step)
        seconds += advanced(sim, 5.0)
        before = sim.centerline([0.5])[0] @ along
        seconds += advanced(sim, 5.0)
        slid.append(float(before - sim.centerline([0.5])[0] @ along))
    found = (sine - slid[1] / (0.5 * (10.0**2 - 5.0**2) * ROD_GRAVITY)) / cosine
    answers = (
        Answer("coefficient of friction", ROD_FRICTION, found, 0.005),
        Answer("crept below the friction angle [m]", 0.0, slid[0], 1e-9),
    )
    return Measured(answers, seconds, sim)


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
    free = 0.6 - off + (4.0 * EI / STIFF) ** 0.25
    share = 2.0 / 3.0 if clamped else 0.5
    pressed = float(sim.contact("table").force[2]) - WEIGHT * (0.6 - free)
    answers = [
        Answer("length [m]", length, free, 0.005),
        Answer("force [N]", WEIGHT * length * share, force[2], 0.005),
        Answer("touch-down [N]", WEIGHT * length * (1.0 - share), pressed, 0.005),
    ]
    if clamped:
        answers.append(Answer("moment [N m]", WEIGHT * length**2 / 6.0, abs(moment[1]), 0.005))
    return Measured(tuple(answers), seconds, sim)


def wound(wrap: float) -> tuple[float, Callable[[float], tuple[float, float, float]]]:
    """Length of a cable over the top of the drum, with straight ends along the tangents, and its
    place by material coordinate.
    """
    bend, half = DRUM + THICK, 0.5 * wrap
    length = wrap * bend + 2.0 * TAIL
    cosine, sine = math.cos(half), math.sin(half)

    def place(u: float) -> tuple[float, float, float]:
        beyond = max(TAIL - u, 0.0), max(u - length + TAIL, 0.0)
        angle = min(max((u - TAIL) / bend, 0.0), wrap) - half
        x = bend * math.sin(angle) + (beyond[1] - beyond[0]) * cosine
        return x, 0.0, bend * math.cos(angle) - (beyond[0] + beyond[1]) * sine

    return length, place


def capstan(wrap: float, points: int, drum: Values | None = None) -> Measured:
    """A flexible cable drawn slowly over a drum against 1 N: the pull is exp(mu wrap) N.

    `drum`: what else than a cylinder it is, of diameter 0.1 m about the y axis.
    """
    length, place = wound(wrap)
    cosine, sine = math.cos(0.5 * wrap), math.sin(0.5 * wrap)
    sim = simulator(
        {
            "cable.length": length,
            "cable.diameter": 2.0 * THICK,
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
            "obstacles.drum.size": [2.0 * DRUM, 2.0 * DRUM, 0.2],
            "obstacles.drum.orientation": [math.sqrt(0.5), 0.0, 0.0, math.sqrt(0.5)],
            "obstacles.drum.friction": DRUM_FRICTION,
            "contact.stiffness": STIFF,
            "discretization.control_points": points,
            "terms.out_of_plane": "off",
        },
        drum or {},
        step=1e-3,
    )
    shape = np.zeros((points, 4))
    shape[:, :3] = bspline.interpolate(sim.model.knots, np.array([place(u) for u in sim.greville]))
    sim.start_from(shape)
    sim.set_motion("start", motion(4.0, shape[0, :3], -0.02 * np.array([cosine, 0.0, sine])))
    seconds, pulls = advanced(sim, 1.8), []
    for _ in range(40):
        seconds += advanced(sim, 0.03)
        pulls.append(float(np.linalg.norm(sim.reaction("start")[0])))
    exact = math.exp(DRUM_FRICTION * wrap)
    return Measured((Answer("pull [N]", exact, float(np.mean(pulls)), 0.01),), seconds, sim)


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
    return Measured((Answer("force [N]", exact, float(np.mean(pulls)), 0.01),), seconds, sim)


def bent(sim: Simulator, place: Callable[[float], tuple[float, float, float]]) -> None:
    """Start from a shape given by material coordinate."""
    points = np.zeros((len(sim.greville), 4))
    line = np.array([place(u) for u in sim.greville])
    points[:, :3] = bspline.interpolate(sim.model.knots, line)
    with warnings.catch_warnings():
        warnings.filterwarnings("ignore", message="control points: those held")
        sim.start_from(points)


def column(points: int) -> Measured:
    """A clamped column between walls, pressed along itself: where the load reaches
    16 pi^2 EI / L^2, its middle lies flat on a wall that it touched at a point before.

    Up to there the curvature at that point is, with k^2 = load / EI, y = k L / 2 and the gap h,
    k^2 h / (1 - cos y - (y - sin y) / tan(y / 2)). The load at which it vanishes is that of the law
    with which the measured curvatures agree, from 0.4 to 0.75 of it: near the end, the column
    escapes to the other wall.
    """
    length, gap, thick, axial, seconds = 0.5, 1e-3, 0.005, 1e5, 0.0
    flat = 16.0 * math.pi**2 * EI / length**2
    bow = (math.pi * gap) ** 2 / (4.0 * length)  # by which it is shorter than the wall it touches
    begun = bow + 0.4 * flat * length / axial
    sim = simulator(
        {
            "cable.length": length,
            "cable.diameter": thick,
            "cable.linear_density": 0.05,
            "cable.axial_stiffness": axial,
            "cable.bending_stiffness": EI,
            "gravity": [0.0, 0.0, 0.0],
            "damping.mass": 20.0,
            "damping.bend": 2e-3,
            "start.clamped": True,
            "start.tangent": [1.0, 0.0, 0.0],
            "end.position": [length - begun, 0.0, 0.0],
            "end.fixed": [True] * 3,
            "end.clamped": True,
            "end.tangent": [1.0, 0.0, 0.0],
            "initial.shape": "straight",
            "obstacles.names": ["floor", "roof"],
            "obstacles.floor.position": [0.0, 0.0, -0.5 * thick - gap],
            "obstacles.roof.position": [0.0, 0.0, 0.5 * thick + gap],
            "obstacles.roof.orientation": [1.0, 0.0, 0.0, 0.0],
            "contact.stiffness": 1e8,
            "discretization.control_points": points,
            "terms.out_of_plane": "off",
        },
        step=1e-3,
    )

    def place(u: float) -> tuple[float, float, float]:
        height = 0.5 * gap * (1.0 - math.cos(2.0 * math.pi * u / length))
        return u * (1.0 - begun / length), 0.0, height

    bent(sim, place)
    seconds += advanced(sim, 0.3)
    way = np.array([0.3 * flat * length / axial, 0.0, 0.0])
    path = EndMotion.resting([length - begun, 0.0, 0.0], start=sim.time)
    sim.set_motion("end", path.then(2.0, velocity=-0.5 * way))
    shares = np.linspace(0.3, 0.98, 1001)
    y = 2.0 * math.pi * np.sqrt(shares)
    law = 1.0 - np.cos(y) - (y - np.sin(y)) / np.tan(0.5 * y)
    law = (2.0 * y / length) ** 2 * gap / law  # falls with the load
    loads = []
    for _ in range(40):
        seconds += advanced(sim, 0.05)
        before, there, after = sim.centerline(0.5 * length + np.array([-1e-3, 0.0, 1e-3]))[:, 2]
        curvature = (2.0 * there - before - after) / 1e-6
        loads.append(-sim.reaction("end")[0][0] / np.interp(-curvature, -law, shares))
    return Measured((Answer("load [N]", flat, float(np.mean(loads)), 0.02),), seconds, sim)


def pegs(points: int) -> Measured:
    """The shortest chain that stays on two smooth pegs 2 b apart: 2 b e long, if they are thin.

    On pegs with the distance rho of its axis from theirs, the chain leaves the inner side at the
    slope phi. The tension T of a smooth chain in equilibrium changes by w per height, so its tails
    are a / cos(phi) - rho cos(phi) long, a = (b - rho sin(phi)) / asinh(tan(phi)). The length,
    2 (a tan(phi) + rho (phi + pi / 2) + tail), is smallest at some phi. A chain that is started in
    this shape stays or runs off; which length does is found by bisection.
    """
    half, radius, thick, seconds = 0.25, 0.025, 0.005, 0.0
    rho = radius + 0.5 * thick
    slopes = np.linspace(0.5, 1.2, 7001)
    sags = (half - rho * np.sin(slopes)) / np.arcsinh(np.tan(slopes))
    tails = sags / np.cos(slopes) - rho * np.cos(slopes)
    lengths = 2.0 * (sags * np.tan(slopes) + rho * (slopes + 0.5 * math.pi) + tails)
    least = int(np.argmin(lengths))
    shortest, a, phi = (float(one[least]) for one in (lengths, sags, slopes))

    def over(middle: float, u: float) -> tuple[float, float, float]:
        """Place at u of a chain with this middle."""
        side, s = math.copysign(1.0, u - middle), abs(u - middle)
        inside = a * math.tan(phi)
        over_peg = inside + rho * (phi + 0.5 * math.pi)
        if s < inside:
            height = math.hypot(a, s) + rho * math.cos(phi) - a / math.cos(phi)
            return side * a * math.asinh(s / a), 0.0, height
        if s < over_peg:
            slope = phi - (s - inside) / rho
            return side * (half - rho * math.sin(slope)), 0.0, rho * math.cos(slope)
        return side * (half + rho), 0.0, over_peg - s

    low, high = 0.98 * shortest, 1.02 * shortest
    peg: Values = {
        f"obstacles.{name}.{key}": value
        for name, x in (("left", -half), ("right", half))
        for key, value in (
            ("shape", "cylinder"),
            ("size", [2.0 * radius, 2.0 * radius, 0.2]),
            ("position", [x, 0.0, 0.0]),
            ("orientation", [math.sqrt(0.5), 0.0, 0.0, math.sqrt(0.5)]),
        )
    }
    while high - low > 2.5e-3 * shortest:
        length = 0.5 * (low + high)
        sim = simulator(
            {
                "cable.length": length,
                "cable.diameter": thick,
                "cable.linear_density": 0.05,
                "cable.axial_stiffness": 500.0,
                "cable.bending_stiffness": 1e-6,
                "damping.mass": 1.0,
                "damping.bend": 1e-2,
                "start.fixed": [False] * 3,
                "start.position": [-half - rho, 0.0, -0.3],
                "end.position": [half + rho, 0.0, -0.3],
                "initial.shape": "straight",
                "obstacles.names": ["left", "right"],
                "contact.stiffness": 1e5,
                "discretization.control_points": points,
                "discretization.knots": "uniform",
                "terms.out_of_plane": "off",
            },
            peg,
            step=2e-3,
        )
        bent(sim, partial(over, 0.5 * length))
        seconds += advanced(sim, 3.0)
        runs_off = sim.centerline([0.5 * length])[0, 2] < -2.0 * half
        low, high = (length, high) if runs_off else (low, length)
    found = Answer("shortest length [m]", shortest, 0.5 * (low + high), 0.005)
    return Measured((found,), seconds, sim)
