"""Starts everyday scenes at rest and judges the shapes.

    python test/simulation/everyday_scenes.py COUNT [SEED] [table]

starts COUNT scenes from SEED (default 0) on, free ones or with `table` those above one, prints how
they fared and every scene that went wrong, and ends with status 1 if one did.
"""

import math
import sys
import time
import warnings
from dataclasses import dataclass
from functools import partial
from typing import Any

import numpy as np
from numba.core.errors import NumbaWarning

from dlo_sim.batch.workers import open_workers
from dlo_sim.core import bspline
from dlo_sim.scene.loading import SceneError, scene_from_values
from dlo_sim.simulation.buckling import SLOWEST
from dlo_sim.simulation.obstacles import gaps
from dlo_sim.simulation.self_contact import nearest
from dlo_sim.simulation.simulator import Simulator

Values = dict[str, Any]
Rng = np.random.Generator
AT_REST = 1e-6  # of the length, by which a further correction may move a shape
DEEPEST = 0.1  # diameters that a cable may be in an obstacle or in itself
UNEXPLAINED = 0.4  # local stretch beyond that of the tension: no resolution of a bend causes it

# Young's modulus [Pa], shear modulus [Pa], density [kg/m^3], EI as a share of the solid section's.
MATERIALS = {
    "rope": (1e9, 3e8, 1100.0, 1e-3),
    "soft cable": (2e6, 7e5, 1150.0, 1.0),
    "hose": (1e7, 3.5e6, 1200.0, 0.6),
    "cable": (1.2e8, 4e7, 2500.0, 1.0),
    "nylon": (2.5e9, 9e8, 1150.0, 1.0),
    "steel wire": (2e11, 7.9e10, 7800.0, 1.0),
}


def log_uniform(rng: Rng, low: float, high: float) -> float:
    """A number whose logarithm is uniform."""
    return float(np.exp(rng.uniform(np.log(low), np.log(high))))


def direction(rng: Rng) -> np.ndarray:
    """A random unit vector."""
    v = rng.standard_normal(3)
    return v / math.hypot(*v)


def turned(rng: Rng, along: np.ndarray, angle: float) -> np.ndarray:
    """A unit vector at an angle to `along`, towards a random side."""
    side = np.cross(along, direction(rng))
    return np.cos(angle) * along + np.sin(angle) * side / math.hypot(*side)


def draw_scene(seed: int) -> tuple[str, Values]:
    """Its kind and flat scene values, from a seed alone."""
    rng = np.random.default_rng(seed)
    material = str(rng.choice(list(MATERIALS)))
    modulus, shear, density, share = MATERIALS[material]
    length = 100.0 if rng.uniform() < 0.04 else log_uniform(rng, 0.1, 3.0)
    diameter = min(log_uniform(rng, 1e-3, 3e-2), length / 20.0)
    values: Values = {
        "cable.length": length,
        "cable.diameter": diameter,
        "cable.density": density,
        "cable.youngs_modulus": modulus,
        "cable.shear_modulus": shear,
        "start.clamped": bool(rng.uniform() < 0.9),
        "initial.shape": "equilibrium",
        "discretization.control_points": 13,
    }
    if share < 1.0:
        values["cable.bending_stiffness"] = share * modulus * np.pi * diameter**4 / 64.0
        values["cable.torsional_stiffness"] = share * shear * np.pi * diameter**4 / 32.0
    if rng.uniform() < 0.2:
        values["gravity"] = (9.81 * direction(rng)).tolist()
    weight = 9.81 * density * np.pi / 4.0 * diameter**2 * length
    start = rng.uniform(-1.0, 1.0, 3)
    if rng.uniform() < 0.15:
        start = start + direction(rng) * log_uniform(rng, 1e3, 5e6)
    way = direction(rng)
    if rng.uniform() < 0.5:
        way[2] = 0.1 * way[2]
        way /= math.hypot(*way)
    most = 0.5 if rng.uniform() < 0.8 else np.pi
    values["start.position"] = start.tolist()
    values["start.tangent"] = turned(rng, way, rng.uniform(0.0, most)).tolist()
    grippers = 1 if rng.uniform() < 0.2 else 2
    span = rng.uniform(0.02, 1.0)
    if rng.uniform() < 0.04:
        span = rng.uniform(1.0, 1.002)
    values["end.position"] = (start + span * length * way).tolist()
    if grippers == 1:
        values |= {"end.fixed": [False] * 3, "start.clamped": True}
        if rng.uniform() < 0.5:
            values["end.mass"] = log_uniform(rng, 0.03, 30.0) * weight / 9.81
    else:
        values |= {"end.fixed": [True] * 3, "end.clamped": bool(rng.uniform() < 0.9)}
        values["end.tangent"] = turned(rng, way, rng.uniform(0.0, most)).tolist()
    if rng.uniform() < 0.1:
        values |= {"loads.names": ["push"], "loads.push.signal": "constant"}
        values["loads.push.position"] = rng.uniform()
        values["loads.push.force"] = (rng.uniform(0.0, 3.0) * weight * direction(rng)).tolist()
    if grippers == 2 and not values["end.clamped"] and rng.uniform() < 0.3:
        values |= {"end.fixed": [False] * 3, "end.spring": [log_uniform(rng, 10.0, 1e4)] * 3}
    if grippers == 2 and rng.uniform() < 0.05:
        share = rng.uniform(0.2, 0.8)
        place = start + share * span * length * way + 0.1 * (1.0 - span) * length * direction(rng)
        values |= {"grasps.names": ["hand"], "grasps.hand.at": share}
        values["grasps.hand.position"] = place.tolist()
    if rng.uniform() < 0.15:
        values["cable.rest_curvature"] = [rng.uniform(-2.0, 2.0) / length]
    turn = "turned" if most > 0.5 else "core"
    return f"{grippers} {material} {turn}", values


def draw_above_table(seed: int) -> tuple[str, Values]:
    """As `draw_scene`, above a table of height 0: drag chains, slack between grippers, a box below
    it, one gripper that points down or ahead with a cable longer than its height.
    """
    rng = np.random.default_rng(seed)
    material = str(rng.choice(list(MATERIALS)))
    modulus, shear, density, share = MATERIALS[material]
    length = log_uniform(rng, 0.3, 3.0)
    diameter = min(log_uniform(rng, 2e-3, 2e-2), length / 40.0)
    values: Values = {
        "cable.length": length,
        "cable.diameter": diameter,
        "cable.density": density,
        "cable.youngs_modulus": modulus,
        "cable.shear_modulus": shear,
        "cable.bending_stiffness": share * modulus * np.pi * diameter**4 / 64.0,
        "cable.torsional_stiffness": share * shear * np.pi * diameter**4 / 32.0,
        "start.clamped": True,
        "initial.shape": "equilibrium",
        "obstacles.names": ["table"],
        "obstacles.table.shape": "plane",
        "damping.mass": 2.0,
    }
    kind = str(rng.choice(["drag chain", "slack", "end on table", "box", "down", "ahead"]))
    aside = 0.0 if rng.uniform() < 0.5 else rng.uniform(-0.1, 0.1) * length
    low, high = 0.5 * diameter, rng.uniform(0.1, 0.3) * length
    ends: Values = {"end.fixed": [True] * 3, "end.clamped": True}
    tilt = rng.uniform(-0.3, 0.3)
    if kind == "drag chain":
        begin, end = [0.0, 0.0, low], [rng.uniform(0.1, 0.5) * length, aside, high]
        tangents = [1.0, 0.0, 0.0], [-np.cos(tilt), np.sin(tilt) * (aside != 0.0), 0.0]
    elif kind == "end on table":
        begin, end = [0.0, 0.0, low], [rng.uniform(0.4, 0.8) * length, aside, high]
        tangents = [1.0, 0.0, 0.0], [abs(np.sin(tilt)), 0.0, np.cos(tilt)]
    elif kind in ("slack", "box"):
        begin = [0.0, 0.0, high]
        end = [rng.uniform(0.4, 0.9) * length, aside, high * rng.uniform(0.5, 1.5)]
        down = rng.uniform(-1.5, 0.3, 2)
        tangents = [np.cos(down[0]), 0.0, np.sin(down[0])], [np.cos(down[1]), 0.0, -np.sin(down[1])]
    else:
        begin, end = [0.0, 0.0, high + 0.2 * length], [0.0, 0.0, high - 0.8 * length]
        ends = {"end.fixed": [False] * 3}
        angle = tilt if kind == "down" else rng.uniform(1.0, 1.7)
        tangents = [np.sin(angle), 0.0, -np.cos(angle)], [0.0, 0.0, 0.0]
    if kind == "box":
        top = 0.5 * min(begin[2], end[2])
        values |= {"obstacles.names": ["table", "box"], "obstacles.box.shape": "box"}
        values["obstacles.box.size"] = [0.2 * end[0], length, top]
        values["obstacles.box.position"] = [rng.uniform(0.3, 0.7) * end[0], 0.0, 0.5 * top]
    values |= {"start.position": begin, "start.tangent": tangents[0], "end.position": end, **ends}
    if "end.clamped" in ends:
        values["end.tangent"] = tangents[1]
    return f"{kind}, {material}", values


@dataclass(frozen=True)
class Outcome:
    """problem: empty if the shape is right. seconds: of the start."""

    seed: int
    kind: str
    problem: str
    seconds: float
    points: Any = None


def run_seed(seed: int, more: Values | None = None, table: bool = False) -> Outcome:
    """Start the scene of a seed and judge the shape."""
    kind, values = draw_above_table(seed) if table else draw_scene(seed)
    began = time.process_time()
    try:
        with warnings.catch_warnings(record=True) as said:
            warnings.simplefilter("always")
            sim = Simulator(scene_from_values(values | (more or {})))
    except SceneError as refusal:
        return Outcome(seed, kind, f"refused: {refusal}", time.process_time() - began)
    seconds = time.process_time() - began - sim.compile_seconds
    warned = [str(one.message) for one in said if not issubclass(one.category, NumbaWarning)]
    problem = "; ".join(warned) or judge(sim) or judge_above_table(sim)
    return Outcome(seed, kind, problem, seconds, sim.control_points)


def judge(sim: Simulator) -> str:
    """What is wrong with the shape; empty if it is right.

    It must be stable, at rest, and stretched by its tension alone, which is computed from the
    reaction at the start and the weight. Where a bend is sharper than the cable is thick nothing
    is asked of the stretch: such a cable is none that grippers can hold.
    """
    cable, scene = sim.cable, sim.scene
    length = scene.cable.length
    correction = cable.forces()[: len(sim.model.axes)].T.ravel()
    band = cable.stiffness()
    if scene.loads:
        cable.add_moment_stiffness()
    if scene.bodies:  # a cable that is free to turn on a table grows slower than SLOWEST
        dim = len(sim.model.axes)
        band[:, 4 * dim - 1] += SLOWEST**2 * np.repeat(sim.model.mass(0)[0], dim)
    negative = cable.solve_held(correction)
    if negative != 0:
        return f"unstable: {negative} negative pivots"
    if np.abs(correction).max() > AT_REST * length:
        return f"not at rest: {np.abs(correction).max():.2g} m off"
    u = np.linspace(0.0, length, 201)
    slope = bspline.evaluate(cable.points[:, :3], sim.model.knots, u, 1)
    stretch = np.linalg.norm(slope, axis=1)
    weight = scene.cable.mu * np.array(scene.gravity)
    inside = sim.reaction("start")[0] + np.outer(u, weight)
    tension = -(inside * slope).sum(axis=1) / stretch
    excess = stretch - 1.0 - tension / scene.cable.EA
    worst = int(np.argmax(np.abs(excess)))
    if abs(excess[worst]) > UNEXPLAINED and sim.curvature(u).max() * scene.cable.diameter < 1.0:
        return f"stretch {stretch[worst]:.3g} at {u[worst] / length:.2g} L, unexplained"
    return ""


def judge_above_table(sim: Simulator) -> str:
    """Whether the cable is in an obstacle or crosses itself; empty if not, or without obstacles."""
    scene, diameter = sim.scene, sim.scene.cable.diameter
    line = sim.centerline(np.linspace(0.0, scene.cable.length, 1001))
    for body in scene.bodies:
        depth = -float(gaps(body, diameter, line).min()) / diameter
        if depth > DEEPEST:
            return f"{depth:.2g} diameters in {body.name}"
    if (
        scene.bodies
        and nearest(sim.model, sim.cable.points, diameter).clearance < -DEEPEST * diameter
    ):
        return "crosses itself"
    return ""


def main(count: int, first: int = 0, *, table: bool = False) -> int:
    """Start so many scenes on all cores and print how they fared; the exit status."""
    run = partial(run_seed, table=table)
    with open_workers() as workers:
        outcomes = list(workers.map(run, range(first, first + count)))
    wrong = [one for one in outcomes if one.problem]
    for one in wrong:
        print(one.seed, one.kind, one.problem)
    times = sorted(one.seconds for one in outcomes)
    print(
        f"{len(wrong)} of {count} wrong; start {times[count // 2]:.4f} s median, {times[-1]:.3f} s"
    )
    return 1 if wrong else 0


if __name__ == "__main__":
    count, *first = (int(argument) for argument in sys.argv[1:] if argument != "table")
    sys.exit(main(count, *first, table="table" in sys.argv))
