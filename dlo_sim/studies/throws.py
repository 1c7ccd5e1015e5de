"""Random throws of a thin cable at small bodies, itself and another cable, and whether it passed
through.

That is found from the simulated shapes alone, not from what the simulator knows of contact. Points
of the axis are taken to move straight between two looks:
    bodies: the surface that the axis sweeps may not meet needles that cross the middle of the body
        in all directions.
    itself: where two strands pass through each other, the writhe of the axis jumps by two.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping
from typing import NamedTuple

import numpy as np

from dlo_sim.core import mass, rotations
from dlo_sim.scene.description import Obstacle
from dlo_sim.simulation.simulator import Simulator
from dlo_sim.studies.known_answers import (
    Answer,
    Answers,
    Array,
    Values,
    along,
    laid_along,
    simulator,
)
from dlo_sim.studies.runs import Timed
from dlo_sim.studies.strands import writhe

KINDS = ("box", "sphere", "edge", "itself")
# What smooth contact keeps of the momentum, and what of it may be open. Where a step passes from a
# face to a rounded edge, its discrete gradient has a part along the edge.
Kept = Mapping[str, tuple[str, float]]
KEPT: Kept = {
    "itself": ("at itself", 1e-9),
    "sphere": ("about a sphere", 1e-6),
    "edge": ("along a bar", 2e-3),
}
SPEED, THICK, SIZE = 20.0, 1e-3, 5e-3  # [m/s], diameter of the cable and size of the bodies [m]
LENGTH, POINTS = 0.2, 26
AWAY = 0.03  # distance of the bodies and, halved, of the strands that meet [m]
# [s]. In longer steps the cable moves further than a body is thick, and ways round it would look as
# if they cut across.
STEPS = (1e-5, 1e-4, 2e-4)
RESTITUTIONS = (1.0, 0.0, 0.5)  # in turn, after all kinds and steps
LOOK, DURATION = 1e-4, 4e-3  # [s]; a look at least every step
PLACES = 101  # of the axis, at a look
MIDDLE = 0.6  # share of a body that needles cross
HIT = 1e-6  # share of the momentum that a body changes
JUMP = 1.0  # change of the writhe between two looks, far less than that unless strands pass
FREE = {"fixed": [False] * 3}
THROWN: Values = {
    "cable": {"diameter": THICK, "density": 1200.0, "youngs_modulus": 1e8},
    "start": FREE,
    "end": FREE,
    "gravity": [0.0, 0.0, 0.0],
    "terms": {"twist": "off", "out_of_plane": "on"},
    "discretization": {"knots": "uniform"},
}


class Throw(NamedTuple):
    """A throw.

    Attributes:
        kind: of KINDS. passed: whether the cable passed through something. finite: whether all
            numbers are. hit: whether anything touched. energy: error of the account, of what is
            exchanged. momentum: by how much what contact keeps of it (`kept_momentum`) has changed,
            of that at the start; None if it keeps nothing. seconds: processor time [s] of the
            steps.
    """

    kind: str
    passed: bool
    finite: bool
    hit: bool
    energy: float
    momentum: float | None
    seconds: float


def throws(count: int) -> Answers:
    """`count` throws, in turn at all of KINDS."""
    return attempted(count, thrown, KEPT)


def throws_of_two(count: int) -> Answers:
    """`count` throws of a cable at another one."""
    return attempted(count, thrown_at_another, {"itself": ("of both", 1e-9)})


def attempted(count: int, throw: Callable[[int, Values], Throw], kept: Kept) -> Answers:
    """Answers of `count` throws, of which some may fail."""
    found, failed = [], 0
    for number in range(count):
        try:
            found.append(throw(number, {}))
        except RuntimeError:
            failed += 1
    return judged(count, found, failed, kept)


def thrown_at_another(number: int, settings: Values) -> Throw:
    """The throw of this number, of a straight cable down at another one; both begin to swing."""
    rng, step = np.random.default_rng(number), STEPS[number % len(STEPS)]
    angle, shift = rng.uniform(0.3, 2.8), rng.uniform(-0.3, 0.3, 2) * LENGTH
    over, way = np.array([*shift, 0.5 * AWAY]), np.array([math.cos(angle), math.sin(angle), 0.0])
    ends: Values = {"cables.names": ["other"], "contact.self_contact": "on"}
    for key, at, axis in (("", np.zeros(3), np.eye(3)[0]), ("cables.other.", over, way)):
        for end, side in (("start", -0.5), ("end", 0.5)):
            ends[f"{key}{end}.position"] = (at + side * LENGTH * axis).tolist()
            ends[f"{key}{end}.fixed"] = [False] * 3
        ends[f"{key}cable.length"] = LENGTH
        ends[f"{key}discretization.control_points"] = POINTS
    rough: Values = {"contact.friction": float(rng.choice([0.0, 0.3]))}
    sim = simulator(THROWN, ends, rough, settings, step=step)
    rates = np.zeros_like(sim.velocities)
    for part, speed in zip(sim.model.parts, (0.0, SPEED), strict=True):
        waves = np.sin(math.pi * rng.uniform(0.5, 2.0) * np.linspace(0.0, 1.0, POINTS))
        rates[part.here, :3] = np.outer(waves, rng.normal(0.0, 1.0, 3)) - [0.0, 0.0, speed]
    sim.start_from(sim.control_points, rates)
    u, passed, hit, thrust = np.linspace(0.0, LENGTH, PLACES), False, False, momentum(sim)

    def both() -> Array:
        return np.concatenate([curve.points(u) for curve in sim.curves.values()])

    line = both()
    for _ in range(round(DURATION / max(step, LOOK))):
        sim.run(max(step, LOOK))
        hit = hit or sim.energy().contact > 0.0
        before, line = line, both()
        passed = passed or abs(writhe(line, PLACES) - writhe(before, PLACES)) > JUMP
    changed = float(np.linalg.norm(momentum(sim) - thrust) / np.linalg.norm(thrust))
    finite = bool(np.isfinite(sim.velocities).all())
    return Throw("itself", passed, finite, hit, sim.energy_error, changed, sim.seconds)


def judged(count: int, found: list[Throw], failed: int, kept: Kept = KEPT) -> Answers:
    """Answers of `count` throws. They are not met by NaN, or where all throws failed.

    Args:
        kept: kind of a throw -> of which momentum `Throw.momentum` is, and how far it may be open.
    """
    energy = largest([one.energy for one in found])
    open_by = {
        kind: largest([t.momentum for t in found if t.kind == kind and t.momentum is not None])
        for kind in kept
    }
    answers = (
        Answer(f"of {count} throws pass", 0.0, sum(one.passed for one in found), 0.0),
        Answer(f"of {count} fail or are NaN", 0.0, failed + sum(not t.finite for t in found), 0.0),
        Answer(f"of {count} touch nothing", 0.0, sum(not one.hit for one in found), 0.1 * count),
        Answer(f"energy of {count} throws, open by", 0.0, energy, 1e-4),
    ) + tuple(
        Answer(f"momentum of {count} throws, {words}, open by", 0.0, open_by[kind], allowed)
        for kind, (words, allowed) in kept.items()
    )
    return Answers(answers, sum(one.seconds for one in found), None)


def largest(values: list[float]) -> float:
    """NaN if any of them is, infinite if there are none."""
    return float(np.max(values)) if values else math.inf


def thrown(number: int, settings: Values) -> Throw:
    """The throw of this number."""
    rng = np.random.default_rng(number)
    kind, step = KINDS[number % len(KINDS)], STEPS[number // len(KINDS) % len(STEPS)]
    restitution = RESTITUTIONS[number // (len(KINDS) * len(STEPS)) % len(RESTITUTIONS)]
    rough: Values = {"contact.friction": float(rng.choice([0.0, 0.3]))}
    rough["contact.restitution"] = restitution
    if restitution == 1.0:
        rough["contact.damping"] = 0.0
    if kind == "itself":
        sim, needles = at_itself(rng, step, rough | settings), np.zeros((0, 2, 3))
    else:
        sim = at_body(kind, rng, step, rough | settings)
        needles = in_the_middle(sim.scene.bodies[0])
    u = np.linspace(0.0, sim.scene.cable.length, PLACES)
    line, begun, thrust = sim.centerline(u), kept_momentum(kind, sim), momentum(sim)
    passed, hit = False, False
    for _ in range(round(DURATION / max(step, LOOK))):
        sim.run(max(step, LOOK))
        hit = hit or sim.energy().contact > 0.0
        before, line = line, sim.centerline(u)
        if kind == "itself":
            passed = passed or abs(writhe(line) - writhe(before)) > JUMP
        else:
            passed = passed or swept(before, line, needles)
    # What bounces off a body may touch it between two looks, but has another momentum afterwards.
    hit = hit or bool(np.linalg.norm(momentum(sim) - thrust) > HIT * np.linalg.norm(thrust))
    changed = np.linalg.norm(kept_momentum(kind, sim) - begun) / np.linalg.norm(thrust)
    known = kind == "itself" or (kind in KEPT and sim.scene.contact.friction == 0.0)
    finite = bool(np.isfinite(sim.control_points).all() and np.isfinite(sim.velocities).all())
    off = float(changed) if known else None
    return Throw(kind, passed, finite, hit, sim.energy_error, off, sim.seconds)


def at_body(kind: str, rng: np.random.Generator, step: float, settings: Values) -> Timed:
    """A wavy cable that flies down at a body, turned at random; an edge is that of a long bar
    across its way.
    """
    t = np.linspace(0.0, 1.0, 400)
    waves = [
        rng.uniform(0.0, 4e-3) * np.sin(2.0 * math.pi * (rng.uniform(0.3, 2.0) * t + rng.random()))
        for _ in range(2)
    ]
    path = np.stack((LENGTH * t, *waves), axis=1)
    length, points = laid_along(path, POINTS)
    place = path[rng.integers(40, 360)] + [0.0, rng.uniform(-1e-3, 1e-3), -AWAY]
    turn, half = rotations.normalized(rng.standard_normal(4)), np.full(3, 0.5 * SIZE)
    if kind == "edge":
        half[2] = 0.5 * LENGTH
        angle, roll = rng.uniform(-1.0, 1.0), 0.25 * math.pi + rng.uniform(-0.3, 0.3)
        lies = rotations.from_rotation_vector(np.array([0.5 * math.pi, 0.0, 0.0]))
        across = rotations.multiply(rotations.from_rotation_vector(np.array([0, 0, angle])), lies)
        turn = rotations.multiply(across, rotations.from_rotation_vector(np.array([0, 0, roll])))
    body = {
        "shape": "sphere" if kind == "sphere" else "box",
        "size": (2.0 * half).tolist(),
        "position": place.tolist(),
        "orientation": turn.tolist(),
    }
    velocities = np.tile([*rng.normal(0.0, 0.2, 2), -SPEED], (POINTS, 1))
    touched: Values = {"obstacles": {"names": ["body"], "body": body}}
    return along(points, length, step, THROWN, touched, settings, velocities=velocities)


def at_itself(rng: np.random.Generator, step: float, settings: Values) -> Timed:
    """A hairpin, one strand of which flies at the other; seen along their way, they cross."""
    t = np.linspace(0.0, 1.0, 300)[:, None]
    angle = np.pi * np.linspace(0.5, -0.5, 200)[1:-1, None]
    gap, waves = 0.25 * AWAY, []
    for turns, most in ((1.0, 0.02), (2.0, 0.03)):
        height, phase = rng.uniform(0.5, 1.0) * most, rng.uniform(-0.3, 0.3)
        waves.append(height * np.sin(math.pi * turns * t) * np.cos(phase * t))
    leg = 0.5 * LENGTH
    path = np.vstack(
        (
            np.hstack((leg * (t - 1.0), 0.0 * t + gap, waves[0])),
            gap * np.hstack((np.cos(angle), np.sin(angle), 0.0 * angle)),
            np.hstack((-leg * t, 0.0 * t - gap, -waves[1])),
        )
    )
    length, points = laid_along(path, POINTS)
    velocities = np.tile(rng.normal(0.0, 1.0, 3), (POINTS, 1))
    thrown = np.clip((-0.01 - points[:, 0]) / 0.02, 0.0, 1.0) * (points[:, 1] > 0.0)
    velocities[:, 1] -= SPEED * thrown
    touched = {"contact.self_contact": "on"} | settings
    return along(points, length, step, THROWN, touched, velocities=velocities)


def momentum(sim: Simulator) -> Array:
    """Of the cable [kg m/s]."""
    return np.asarray((mass.dense(sim.model.mass(0)) @ sim.velocities[:, :3]).sum(axis=0))


def kept_momentum(kind: str, sim: Simulator) -> Array:
    """What smooth contact keeps of the momentum [kg m/s]: all of it at itself, that along a bar,
    and the moment about the centre of a sphere, over the length of the cable.
    """
    if kind == "itself":
        return momentum(sim)
    body = sim.scene.bodies[0]
    if kind == "edge":
        return momentum(sim) @ rotations.to_matrix(np.array(body.orientation))[:, 2:]
    arms = (sim.control_points[:, :3] - body.position) / LENGTH
    shares = mass.dense(sim.model.mass(0)) @ sim.velocities[:, :3]
    return np.asarray(np.cross(arms, shares).sum(axis=0))


def in_the_middle(body: Obstacle) -> Array:
    """Needles (k, 2, 3) that cross the middle of a body in all directions; along a bar everywhere
    on its long axis, and the axis itself.
    """
    half = 0.5 * MIDDLE * np.array(body.size)
    ways = np.array(list(np.ndindex(3, 3, 3)), dtype=float)[:13] - 1.0
    if body.shape == "sphere":
        ways /= np.linalg.norm(ways, axis=1)[:, None]
    needles = half * np.stack((-ways, ways), axis=1)
    if half[2] > half[0]:
        along = half * [0.0, 0.0, 1.0]
        across = needles[ways[:, 2] == 0.0]
        slices = [across + share * along for share in np.linspace(-1.0, 1.0, 15)]
        needles = np.concatenate((*slices, np.stack((-along, along))[None]))
    turn = rotations.to_matrix(np.array(body.orientation))
    return np.asarray(needles @ turn.T + body.position)


def swept(before: Array, after: Array, needles: Array) -> bool:
    """Whether the surface that a polygon (m, 3) sweeps on its way meets needles (k, 2, 3)."""
    near = needles.reshape(-1, 3)
    reach = float(np.linalg.norm(near - near.mean(axis=0), axis=1).max())
    corners = np.stack((before[:-1], before[1:], after[1:], after[:-1]), axis=1)
    middle = corners.mean(axis=1)
    sizes = np.linalg.norm(corners - middle[:, None], axis=2).max(axis=1)
    corners = corners[np.linalg.norm(middle - near.mean(axis=0), axis=1) < reach + sizes]
    a, b, c = np.concatenate((corners[:, [0, 1, 2]], corners[:, [2, 3, 0]])).transpose(1, 0, 2)
    p, q = needles[:, None, 0], needles[:, None, 1]
    # A line meets a triangle if it passes all sides in the same sense.
    sides = np.stack([volume(q - p, one - p, other - p) for one, other in ((a, b), (b, c), (c, a))])
    inside = (sides > 0.0).all(axis=0) | (sides < 0.0).all(axis=0)
    apart = volume(b - a, c - a, p - a) * volume(b - a, c - a, q - a) < 0.0
    return bool((inside & apart).any())


def volume(a: Array, b: Array, c: Array) -> Array:
    """Triple product of vectors (..., 3)."""
    return np.asarray(np.sum(a * np.cross(b, c), axis=-1))
