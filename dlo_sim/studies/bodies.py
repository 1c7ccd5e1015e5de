"""Tests of study contact in which the cable touches obstacles.

Each is a function of its resolution, a step or a number of control points.
"""

from __future__ import annotations

import math
from collections.abc import Callable

import numpy as np

from dlo_sim.core import mass
from dlo_sim.scene.loading import flat_keys
from dlo_sim.simulation.obstacles import BRISTLES, stiffness
from dlo_sim.simulation.simulator import Simulator
from dlo_sim.studies.known_answers import (
    CLAMPED,
    Answer,
    Answers,
    Array,
    Values,
    along,
    answered,
    laid_along,
    simulator,
    with_tails,
)
from dlo_sim.studies.runs import Timed

FREE: Values = {"fixed": [False] * 3}
WEIGHTLESS: Values = {"gravity": [0.0, 0.0, 0.0]}
ALONG_Y = [math.sqrt(0.5), 0.0, 0.0, math.sqrt(0.5)]  # orientation of a cylinder
ROD_FRICTION, ROD_GRAVITY = 0.4, 9.8
ROD: Values = flat_keys(
    {
        "cable": {"length": 1.0, "diameter": 0.05, "linear_density": 1.0, "axial_stiffness": 1e7},
        "gravity": [0.0, 0.0, -ROD_GRAVITY],
        "start": FREE | {"position": [0.0, 0.0, 0.025]},
        "end": {"position": [1.0, 0.0, 0.025]},
        "obstacles": {"names": ["table"], "table": {"friction": ROD_FRICTION}},
        "terms": {"out_of_plane": "off"},
        "discretization": {"control_points": 13},
    }
)
EI, WEIGHT, LIFT, STIFF = 0.01, 0.5, 5e-3, 1e6  # [N m^2], [N/m], [m], [N/m^2]
LYING: Values = {
    "cable": {
        **{"length": 0.6, "diameter": 0.005, "linear_density": WEIGHT / 9.81},
        **{"axial_stiffness": 5e3, "bending_stiffness": EI},
    },
    "start": {**FREE, "position": [0.0, 0.0, 0.0025]},
    "end": {"position": [0.6, 0.0, 0.0025]},
    "obstacles": {"names": ["table"]},
    "contact": {"stiffness": STIFF},
    "terms": {"out_of_plane": "off"},
    "discretization": {"knots": "uniform"},
}
LIFTED: Values = {"end.tangent": [1.0, 0.0, 0.0], "damping.mass": 3.0, "damping.bend": 1e-3}
BELT_FRICTION, DRUM_FRICTION = 0.5, 0.3
# Radius of the drum, straight ends, radius of the cable [m].
DRUM, TAIL, THICK = 0.05, 0.15, 0.0025


def mean(sim: Timed, count: int, every: float, look: Callable[[], float]) -> float:
    """Mean of what is looked at so many times, with a time [s] between."""
    found = []
    for _ in range(count):
        sim.run(every)
        found.append(float(look()))
    return float(np.mean(found))


def pulled(force: float, step: float) -> Timed:
    """A rod that lies on a table, pulled along itself."""
    load = {"signal": "constant", "force": [force, 0.0, 0.0]}
    return simulator(ROD, {"loads": {"names": ["pull"], "pull": load}}, step=step)


def sliding(force: float, step: float) -> Answers:
    """Kinetic energy (F - mu m g)^2 t^2 / (2 m) of a rod that is pulled for 1 s."""
    sim = pulled(force, step)
    sim.run(1.0)
    exact = 0.5 * (force - ROD_FRICTION * ROD_GRAVITY) ** 2
    return answered(sim, Answer("kinetic energy [J]", exact, sim.energy().kinetic, 0.01))


def pull_slowly(sim: Simulator, force: float) -> None:
    """Let the pull of `pulled` grow to a force [N] within a tenth of a second."""
    for share in np.linspace(0.02, 1.0, 50):
        sim.set_load("pull", force=(force * float(share), 0.0, 0.0))
        sim.advance(0.002)


def sticking(force: float, step: float) -> Answers:
    """A rod that is pulled with less than its friction moves by the bristles' deflection alone."""
    sim = pulled(0.0, step)
    before = sim.centerline([0.5])[0]
    pull_slowly(sim, force)
    sim.run(60.0)
    moved = float((sim.centerline([0.5])[0] - before)[0])
    elastic = force / (BRISTLES * stiffness(sim.scene, sim.scene.bodies[0]))
    return answered(sim, Answer("slid in 60 s [m]", 0.0, moved - elastic, 1e-6))


YAW = math.pi / 18.0  # [rad]
FALLEN: Values = {
    "cable": {"length": 0.5, "diameter": 0.01, "density": 1200.0, "youngs_modulus": 1e7},
    "start": {**FREE, "position": [0.0, 0.0, 0.05]},
    "obstacles": {"names": ["table"]},
    "discretization": {"control_points": 13},
    "damping": {"mass": 5.0, "stiffness": 0.01},
}


def rest(yaw: float, step: float) -> Answers:
    """A cable that has fallen on a table lies still: the table carries its weight. Seen from above,
    it is at an angle to the x axis.
    """
    end = {"end.position": [0.45 * math.cos(yaw), 0.45 * math.sin(yaw), 0.15]}
    sim = simulator(FALLEN, end, step=step)
    sim.run(30.0)
    weight = sim.scene.cable.mu * 9.81 * 0.5
    return answered(
        sim,
        Answer("force [N]", weight, float(sim.contact("table").force[2]), 0.001),
        Answer("kinetic energy after 30 s [J]", 0.0, sim.energy().kinetic, 1e-9),
    )


RESTITUTION, HEIGHT = 0.6, 0.2  # height [m] from which a rod bounces


def level(height: float) -> Values:
    """Places of both ends of a level cable of 1 m, at a height [m]."""
    return {"start.position": [0.0, 0.0, height], "end.position": [1.0, 0.0, height]}


def bounce(step: float) -> Answers:
    """A rod that falls flat from a height h rises to restitution^2 h again. A step lands it up to a
    step late, so that it is up to that times its speed too low.
    """
    elastic: Values = {"contact.restitution": RESTITUTION, "integrator.tolerance": 1e-12}
    sim = simulator(ROD, elastic, level(0.025 + HEIGHT), step=step)
    landing = math.sqrt(2.0 * HEIGHT / ROD_GRAVITY)
    sim.run(1.2 * landing)
    risen = 0.0
    while sim.time < landing * (1.0 + 1.5 * RESTITUTION):
        sim.run(step)
        risen = max(risen, float(sim.centerline([0.5])[0, 2]) - 0.025)
    return answered(
        sim,
        Answer("height [m]", RESTITUTION**2 * HEIGHT, risen, 0.01),
        Answer("energy account open by", 0.0, sim.energy_error, 1e-8),
    )


HEIGHTS = (0.02, 0.05, 0.1, 0.2, 0.4, 0.6)  # [m]
ROPE: Values = {
    "cable": {"length": 1.0, "diameter": 0.006},
    "start": FREE,
    "contact": {"friction": 0.5, "self_contact": "on"},
    "obstacles": {"names": ["table"]},
}


def drop(step: float) -> Answers:
    """A rope that falls flat on a table moves as at an eighth of the step, and lies where it
    lands.
    """
    sims, apart, weight, kinetic = [], 0.0, 0.0, 0.0
    for height in HEIGHTS:
        sim, finer = (simulator(ROPE, level(height), step=one) for one in (step, 0.125 * step))
        for _ in range(round(0.6 / step)):
            sim.run(step)
            finer.run(step)
            way = centre_of_mass(sim) - centre_of_mass(finer)
            apart = max(apart, float(np.linalg.norm(way)))
        weight = sim.scene.cable.mu * 9.81
        kinetic = max(kinetic, sim.energy().kinetic / (weight * height))
        sims.append(sim)
    return answered(
        sims,
        Answer("centre of mass, at an eighth of the step elsewhere by [m]", 0.0, apart, 5e-3),
        Answer("kinetic energy afterwards, of that of the fall", 0.0, kinetic, 1e-9),
        Answer("force [N]", weight, float(sim.contact("table").force[2]), 0.001),
    )


def centre_of_mass(sim: Simulator) -> Array:
    """Of the cable [m], shape (3,)."""
    shares = mass.dense(sim.model.mass(0)).sum(axis=0)
    return np.asarray(shares @ sim.control_points[:, :3] / shares.sum())


def plug(modulus: float, points: int) -> Answers:
    """A rod of 5 cm that is pushed 0.2 mm against a face, beyond its round tip: EA d / L."""
    length, thick, pushed, gap = 0.05, 0.01, 2e-4, 1e-4
    cable = {"length": length, "diameter": thick, "density": 1000.0, "youngs_modulus": modulus}
    face = {
        "shape": "cylinder",
        "size": [0.1, 0.1, 0.05],
        "position": [length + 0.5 * thick + gap + 0.025, 0.0, 0.0],
        "orientation": [0.0, math.sqrt(0.5), 0.0, math.sqrt(0.5)],
    }
    sim = simulator(
        WEIGHTLESS,
        {
            "cable": cable,
            "damping": {"mass": 20.0, "stiffness": 1e-3},
            "start": {"clamped": True},
            "end": {**FREE, "position": [length, 0.0, 0.0]},
            "obstacles": {"names": ["face"], "face": face},
            "discretization": {"control_points": points},
        },
        step=1e-3,
    )
    sim.move("start", 1.5, [(pushed + gap) / 1.5, 0.0, 0.0])
    sim.run(3.0)
    exact = sim.scene.cable.EA * pushed / length
    pressed = -float(sim.contact("face").force[0])
    return answered(sim, Answer("force [N]", exact, pressed, 0.05))


def slope(step: float) -> Answers:
    """The coefficient of friction, from what a rod slides down a slope 5 % too steep for it, in the
    seconds from 5 to 10, and what it creeps in these on one 0.5 % less steep than it can hold.
    """
    sims, slid = [], []
    for share in (0.995, 1.05):
        angle = math.atan(ROD_FRICTION * share)
        cosine, sine = math.cos(angle), math.sin(angle)
        start, along = 0.025 * np.array([-sine, 0.0, cosine]), np.array([cosine, 0.0, sine])
        tilted: Values = {
            "obstacles.table.orientation": [
                0.0,
                -math.sin(0.5 * angle),
                0.0,
                math.cos(0.5 * angle),
            ],
            "start.position": start.tolist(),
            "end.position": (start + along).tolist(),
        }
        sim = simulator(ROD, tilted, step=step)
        sim.run(5.0)
        place = sim.centerline([0.5])[0] @ along
        sim.run(5.0)
        slid.append(float(place - sim.centerline([0.5])[0] @ along))
        sims.append(sim)
    found = (sine - slid[1] / (0.5 * (10.0**2 - 5.0**2) * ROD_GRAVITY)) / cosine
    return answered(
        sims,
        Answer("coefficient of friction", ROD_FRICTION, found, 0.005),
        Answer("crept below the friction angle [m]", 0.0, slid[0], 1e-9),
    )


def lifted(clamped: bool, points: int) -> Answers:
    """The end of a lying cable lifted by delta, and held horizontal or pinned: it lifts off over
    a = (72 EI delta / w)^(1/4) or (24 EI delta / w)^(1/4). A stiffness k of the table lets it lift
    off earlier, by (4 EI / k)^(1/4).
    """
    held: Values = {"discretization.control_points": points, "end.fixed": [False, False, True]}
    if clamped:
        held |= {"end.fixed": [True] * 3, "end.clamped": True}
    sim = simulator(LYING, LIFTED, held, step=1e-3)
    sim.move("end", 0.5, [0.0, 0.0, LIFT / 0.5])
    sim.run(6.0)
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
    return answered(sim, *answers)


# A flexible cable in its plane.
CORD: Values = {
    "cable": {"diameter": 2.0 * THICK, "linear_density": 0.05, "axial_stiffness": 500.0},
    "cable.bending_stiffness": 1e-6,
    "start": FREE,
    "end": FREE,
    "initial": {"shape": "straight"},
    "terms": {"out_of_plane": "off"},
    "discretization": {"knots": "uniform"},
}


def capstan(wrap: float, points: int, drum: Values | None = None) -> Answers:
    """A flexible cable drawn slowly over a drum against 1 N: the pull is exp(mu wrap) N.

    `drum`: what else than a cylinder it is, of diameter 0.1 m about the y axis.
    """
    angle = np.linspace(-0.5 * wrap, 0.5 * wrap, 4000)
    round_it = np.stack((np.sin(angle), 0.0 * angle, np.cos(angle)), axis=1)
    length, place = laid_along(with_tails((DRUM + THICK) * round_it, TAIL), points)
    cosine, sine = math.cos(0.5 * wrap), math.sin(0.5 * wrap)
    cylinder = {"shape": "cylinder", "size": [2.0 * DRUM, 2.0 * DRUM, 0.2], "orientation": ALONG_Y}
    sim = along(
        place,
        length,
        1e-3,
        CORD,
        WEIGHTLESS,
        {
            "start.fixed": [True] * 3,
            "loads.names": ["weight"],
            "loads.weight": {"signal": "constant", "force": [cosine, 0.0, -sine]},
            "obstacles.names": ["drum"],
            "obstacles.drum": {**cylinder, "friction": DRUM_FRICTION},
            "contact.stiffness": STIFF,
        },
        drum or {},
    )
    sim.move("start", 4.0, -0.02 * np.array([cosine, 0.0, sine]))
    sim.run(1.8)
    pull = mean(sim, 40, 0.03, lambda: float(np.linalg.norm(sim.reaction("start")[0])))
    return answered(sim, Answer("pull [N]", math.exp(DRUM_FRICTION * wrap), pull, 0.01))


def conveyor(step: float) -> Answers:
    """A rope held at one end on a belt that runs below it: the belt pulls with mu w L."""
    soft: Values = {"cable.bending_stiffness": 1e-4, "discretization.control_points": 40}
    rough: Values = {"start.fixed": [True] * 3, "obstacles.table.friction": BELT_FRICTION}
    sim = simulator(LYING, {"end": FREE}, soft, rough, step=step)
    sim.move("table", 10.0, [0.2, 0.0, 0.0])
    sim.run(1.0)
    pull = mean(sim, 100, 0.01, lambda: -sim.reaction("start")[0][0])
    return answered(sim, Answer("force [N]", BELT_FRICTION * 0.6 * WEIGHT, pull, 0.01))


def column(points: int) -> Answers:
    """A clamped column between walls, pressed along itself: where the load reaches
    16 pi^2 EI / L^2, its middle lies flat on a wall that it touched at a point before.

    Up to there the curvature at that point is, with k^2 = load / EI, y = k L / 2 and the gap h,
    k^2 h / (1 - cos y - (y - sin y) / tan(y / 2)). The load at which it vanishes is that of the law
    with which the measured curvatures agree, from 0.4 to 0.75 of it: near the end, the column
    escapes to the other wall.
    """
    length, gap, thick, axial = 0.5, 1e-3, 0.005, 1e5
    flat_at = 16.0 * math.pi**2 * EI / length**2
    bow = (math.pi * gap) ** 2 / (4.0 * length)  # by which it is shorter than the wall it touches
    begun = bow + 0.4 * flat_at * length / axial
    u, wall = np.linspace(0.0, length, 2000), 0.5 * thick + gap
    height = 0.5 * gap * (1.0 - np.cos(2.0 * math.pi * u / length))
    _, place = laid_along(np.stack((u * (1.0 - begun / length), 0.0 * u, height), axis=1), points)
    sim = along(
        place,
        length,
        1e-3,
        CORD,
        WEIGHTLESS,
        {
            "start": CLAMPED,
            "end": CLAMPED,
            "cable": {"diameter": thick, "axial_stiffness": axial, "bending_stiffness": EI},
            "damping": {"mass": 20.0, "bend": 2e-3},
            "obstacles.names": ["floor", "roof"],
            "obstacles.floor.position": [0.0, 0.0, -wall],
            "obstacles.roof": {"position": [0.0, 0.0, wall], "orientation": [1.0, 0.0, 0.0, 0.0]},
            "contact.stiffness": 1e8,
        },
    )
    sim.run(0.3)
    sim.move("end", 2.0, [-0.15 * flat_at * length / axial, 0.0, 0.0])
    shares = np.linspace(0.3, 0.98, 1001)
    y = 2.0 * math.pi * np.sqrt(shares)
    law = 1.0 - np.cos(y) - (y - np.sin(y)) / np.tan(0.5 * y)
    law = (2.0 * y / length) ** 2 * gap / law  # falls with the load

    def load() -> float:
        """Where the middle would lie flat, from its curvature."""
        before, there, after = sim.centerline(0.5 * length + np.array([-1e-3, 0.0, 1e-3]))[:, 2]
        curvature = (2.0 * there - before - after) / 1e-6
        return float(-sim.reaction("end")[0][0] / np.interp(-curvature, -law, shares))

    return answered(sim, Answer("load [N]", flat_at, mean(sim, 40, 0.05, load), 0.02))


def pegs(points: int) -> Answers:
    """The shortest chain that stays on two smooth pegs 2 b apart: 2 b e long, if they are thin.

    On pegs with the distance rho of its axis from theirs, the chain leaves the inner side at the
    slope phi. The tension T of a smooth chain in equilibrium changes by w per height, so its tails
    are a / cos(phi) - rho cos(phi) long, a = (b - rho sin(phi)) / asinh(tan(phi)). The length,
    2 (a tan(phi) + rho (phi + pi / 2) + tail), is smallest at some phi. A chain that is started in
    this shape stays or runs off; which length does is found by bisection.
    """
    half, radius = 0.25, 0.025
    rho = radius + THICK
    slopes = np.linspace(0.5, 1.2, 7001)
    sags = (half - rho * np.sin(slopes)) / np.arcsinh(np.tan(slopes))
    tails = sags / np.cos(slopes) - rho * np.cos(slopes)
    lengths = 2.0 * (sags * np.tan(slopes) + rho * (slopes + 0.5 * math.pi) + tails)
    least = int(np.argmin(lengths))
    shortest, a, phi = (float(one[least]) for one in (lengths, sags, slopes))

    # The chain from its middle to where it hangs from the right peg, without its tail.
    s, slope = np.linspace(0.0, a * math.tan(phi), 999), np.linspace(phi, -0.5 * math.pi, 4000)[1:]
    x = np.append(a * np.arcsinh(s / a), half - rho * np.sin(slope))
    top = rho * math.cos(phi) - a / math.cos(phi)
    z = np.append(np.hypot(a, s) + top, rho * np.cos(slope))
    right = np.stack((x, 0.0 * x, z), axis=1)
    over = np.vstack((right[:0:-1] * [-1.0, 1.0, 1.0], right))
    inside = 2.0 * (a * math.tan(phi) + rho * (phi + 0.5 * math.pi))
    peg = {"shape": "cylinder", "size": [2.0 * radius, 2.0 * radius, 0.2], "orientation": ALONG_Y}
    chain: Values = {
        "damping": {"mass": 1.0, "bend": 1e-2},
        "obstacles": {
            "names": ["left", "right"],
            "left": {**peg, "position": [-half, 0.0, 0.0]},
            "right": {**peg, "position": [half, 0.0, 0.0]},
        },
        "contact": {"stiffness": 1e5},
    }
    low, high, sims = 0.98 * shortest, 1.02 * shortest, []
    while high - low > 2.5e-3 * shortest:
        length = 0.5 * (low + high)
        _, place = laid_along(with_tails(over, 0.5 * (length - inside)), points)
        sim = along(place, length, 2e-3, CORD, chain)
        sim.run(3.0)
        runs_off = sim.centerline([0.5 * length])[0, 2] < -2.0 * half
        low, high = (length, high) if runs_off else (low, length)
        sims.append(sim)
    found = Answer("shortest length [m]", shortest, 0.5 * (low + high), 0.005)
    return answered(sims, found)
