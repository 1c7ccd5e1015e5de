"""Tests of study contact in which the cable touches itself: linked loops, a knot, a plectoneme."""

from __future__ import annotations

import math

import numpy as np

from dlo_sim.core import bspline
from dlo_sim.scene.loading import flat_keys
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

LEG, BOW = 0.15, 0.03  # length of the legs of a loop, and its radius [m]


STRANDS: Values = {  # held at both ends, and touch each other
    "cable": {"linear_density": 0.05, "bending_stiffness": 1e-3},
    "damping": {"air_drag": 0.3, "bend": 5e-3, "stretch": 1e-3},
    "gravity": [0.0, 0.0, 0.0],
    "contact": {"self_contact": "on"},
    "terms": {"twist": "off", "out_of_plane": "on"},
    "start": {"fixed": [True] * 3},
    "end": {"fixed": [True] * 3},
    "discretization": {"knots": "uniform"},
}


def linked(points: int) -> Answers:
    """Two loops of one cable, one through the other, are pulled apart: the force between them is
    the tension of both legs of a loop.
    """
    t = np.linspace(0.0, 1.0, 400)[:, None]
    angle, none = np.pi * (0.5 - t), 0.0 * t
    loop = np.vstack(
        (
            np.hstack((LEG * (t - 1.0), BOW + none, none)),
            BOW * np.hstack((np.cos(angle), np.sin(angle), none)),
            np.hstack((-LEG * t, none - BOW, none)),
        )
    )
    other = -loop[:, [0, 2, 1]]  # opens to the other side, in the plane across
    ends, ways = (loop[-1], other[0]), ([-0.6, -0.15, 0.0], [-0.6, 0.15, -0.1])
    between = (
        ends[0] * (2.0 * t**3 - 3.0 * t**2 + 1.0)
        + ways[0] * (t**3 - 2.0 * t**2 + t)
        + ends[1] * (3.0 * t**2 - 2.0 * t**3)
        + ways[1] * (t**3 - t**2)
    )
    between[:, 1] -= 0.25 * np.sin(np.pi * t[:, 0]) ** 2
    length, place = laid_along(np.vstack((loop, between, other)), points)
    leg = 2.0 * LEG + math.pi * BOW
    knots = bspline.clamped_knots(points, length)
    held = {"near": leg, "far": length - leg}
    grasps: Values = {"grasps.names": list(held)}
    for name, u in held.items():
        there = bspline.evaluate(place, knots, [u])[0].tolist()
        grasps |= flat_keys({"grasps": {name: {"at": u / length, "position": there}}})
    cable: Values = {"cable.diameter": 0.005, "cable.axial_stiffness": 500.0, "damping.bend": 2e-3}
    sim = along(place, length, 2e-3, STRANDS, grasps, cable)
    for name in ("far", "end"):
        sim.move(name, 0.6, [0.1, 0.0, 0.0])
    sim.run(2.0)
    found = sim.contacts["itself"]
    force = np.linalg.norm(found.forces[found.u < leg].sum(axis=0))
    tension = float(sim.tension(np.array([0.1, leg - 0.1])).sum())
    return answered(sim, Answer("force [N]", tension, float(force), 0.01))


KNOT_EI = 1e-3  # [N m^2]
KNOT_DIAMETERS, KNOT_SHORTER = (2e-3, 5e-4), (0.5, 0.42, 0.35, 0.3, 0.25)  # [m], end shortenings
LOOPS = (
    "control points | diameter [mm] | end shortening e [m] | (D / e)^(1/2) {:.4f} | "
    "pull F [N] | F e^2 / (2 pi^2 EI) {:.4f} | of the pull at an end {:.4f} | exponent {:.3f}"
)


def knot(points: int) -> Answers:
    """Pull F of an overhand knot without friction: F e^2 / (2 pi^2 EI) = 1 with the end shortening
    e, where the loop is much larger than the cable is thick.

    The braid, in which the strands lie on each other over a length of about (D e)^(1/2) at the
    diameter D, adds a share of about (D / e)^(1/2) (Audoly, Clauvelin and Neukirch 2007). Hence the
    factor, and the exponent d(log F) / d(log e), are measured on loops of several sizes and
    diameters, and extrapolated by a square polynomial in (D / e)^(1/2) to zero.

    The pull between two loops is their difference in energy over that in end shortening, which is
    its mean, at the geometric mean of e. An end feels a pull that ripples by 1 % about it while the
    segments of one strand pass those of the other.
    """
    sims, rows, found = [], [], []
    for diameter in KNOT_DIAMETERS:
        (e, energy, felt, apart), sim = tightened(points, diameter)
        sims.append(sim)
        mean = np.sqrt(e[1:] * e[:-1])
        pull = np.diff(energy) / np.diff(apart)
        thin = np.sqrt(diameter / mean)
        scale = 2.0 * math.pi**2 * KNOT_EI
        factor = pull * mean**2 / scale
        power = np.diff(np.log(pull)) / np.diff(np.log(mean))
        found.append((thin, factor, np.sqrt(thin[1:] * thin[:-1]), power))
        ends = felt * e**2 / scale
        ends = 0.5 * (ends[1:] + ends[:-1])
        for k, values in enumerate(zip(mean, thin, pull, factor, ends, strict=True)):
            rows.append((points, diameter, *values, power[k - 1] if k else None))
    thins, factors, middles, powers = (np.concatenate(one) for one in zip(*found, strict=True))
    return answered(
        sims,
        Answer("F e^2 / (2 pi^2 EI)", 1.0, extrapolated(thins, factors), 0.05),
        Answer("exponent", -2.0, extrapolated(middles, powers), 0.025),
    )._replace(loops=tuple(rows))


def extrapolated(x: Array, y: Array) -> float:
    """At x = 0, by the square polynomial that fits best."""
    return float(np.polynomial.Polynomial.fit(x, y, 2)(0.0))


def tightened(points: int, diameter: float) -> tuple[Array, Timed]:
    """An overhand knot that is tightened from one of KNOT_SHORTER to the next.

    Returns:
        Of each loop the end shortening of the stretched cable [m], energy [J], pull at an end [N]
        and distance of the ends [m], shape (4, loops); the simulator.
    """
    t = np.linspace(-2.05, 2.05, 4000)
    x, y = 0.05 * (t**3 - 3.0 * t), 0.04 * (t**4 - 4.0 * t**2)
    loop = np.stack((x, y, 0.003 * (t**5 - 10.0 * t)), axis=1)
    length, place = laid_along(with_tails(loop, 0.25), points)
    axial = 2e3
    cable: Values = {"cable.diameter": diameter, "cable.axial_stiffness": axial}
    sim = along(place, length, 4e-3, STRANDS, cable, {"damping.air_drag": 0.5})
    chord = place[-1] - place[0]
    way_out, apart = chord / np.linalg.norm(chord), float(np.linalg.norm(chord))
    loops = []
    for wanted in KNOT_SHORTER:
        way = length - wanted - apart
        moving = way / 0.3
        for name, sign in (("start", -0.5), ("end", 0.5)):
            sim.move(name, moving, sign * 0.3 * way_out)
        sim.run(moving + 5.0)
        apart += way
        pull, energy = abs(float(sim.reaction("end")[0] @ way_out)), sim.energy()
        shorter = wanted + pull * length / axial
        loops.append((shorter, energy.total - energy.kinetic, pull, apart))
    return np.array(loops).T, sim


TURNS, COILED = 8, 0.6  # turns of one end, length [m]
COIL_STIFFNESS, COIL_WEIGHT = 1e-3, 0.05 * 0.5  # of torsion [N m^2]; a small lateral load [N/m]


def plectoneme(points: int) -> Answers:
    """A cable that is twisted by 8 turns and coils about itself as its clamps approach.

    Link, the sum of twist and writhe, is the turns of its end. The torque of the end clamp is that
    of the twist that the writhe leaves, GJ 2 pi (turns - writhe) / L; that of the other balances it
    and the moment of the small lateral load about the x axis, on which the clamps are; and it
    does not creep away while the cable rests.
    """
    sim = simulator(
        STRANDS,
        {
            "cable.length": COILED,
            "cable.diameter": 0.004,
            "cable.axial_stiffness": 1e3,
            "cable.torsional_stiffness": COIL_STIFFNESS,
            "damping.twist": 1e-3,
            "gravity": [0.0, 0.0, COIL_WEIGHT / 0.05],
            "contact.friction": 0.1,
            "terms": {"twist": "quasistatic", "out_of_plane": "auto"},
            "start": CLAMPED,
            "end": {**CLAMPED, "position": [0.97 * COILED, 0.0, 0.0]},
            "discretization.control_points": points,
        },
        step=2e-3,
    )
    for duration, way, turned in ((1.0, 0.0, TURNS), (1.5, -0.2, 0), (2.0, 0.0, 0)):
        turning = [2.0 * math.pi * turned / duration, 0.0, 0.0]
        sim.move("end", duration, [way / duration, 0.0, 0.0], turning)
        sim.run(duration)
    line = sim.centerline(np.linspace(0.0, COILED, 8 * points + 1))
    far = np.array([[40.0 * COILED, 0.0, 0.0]])
    coils = writhe(np.vstack((line[:1] - far, line, line[-1:] + far)))
    twist = float(np.diff(sim.control_points[[0, -1], 3])[0]) / (2.0 * math.pi)
    start, end = (float(sim.reaction(name)[1][0]) for name in ("start", "end"))
    load = COIL_WEIGHT * COILED * float(np.mean(0.5 * (line[1:, 1] + line[:-1, 1])))
    sim.run(3.0)
    kept, account = float(sim.reaction("end")[1][0]), sim.cable.account
    left = COIL_STIFFNESS * 2.0 * math.pi * (TURNS - coils) / COILED
    return answered(
        sim,
        Answer("link [turns]", TURNS, twist + coils, 0.01 / TURNS),
        Answer("torque of the end [N m]", left, end, 0.01),
        Answer("torque of the start [N m]", -end - load, start, 0.01),
        Answer("torque of the end, 3 s later [N m]", end, kept, 0.001),
        Answer("crossings", 0.0, float(account.crossed + account.pairs_lost), 0.0),
    )


def writhe(line: Array, cut: int = 0) -> float:
    """Writhe of a polygon (m, 3): of all pairs of its edges, the solid angle of the directions in
    which they are seen to cross, over 2 pi (Klenin and Langowski 2000, method 1a); of two polygons
    one after the other, that of the first `cut` points with the others.
    """
    first, second = np.triu_indices(len(line) - 1, 2)
    if cut:
        apart = (first < cut - 1) & (second >= cut)
        first, second = first[apart], second[apart]
    begin, end = line[:-1], line[1:]
    corners = [
        begin[second] - begin[first],
        end[second] - begin[first],
        end[second] - end[first],
        begin[second] - end[first],
    ]
    normals = [
        np.cross(one, other) for one, other in zip(corners, corners[1:] + corners[:1], strict=True)
    ]
    units = [n / (np.linalg.norm(n, axis=1)[:, None] + 1e-300) for n in normals]
    angles = np.zeros(len(first))
    for one, other in zip(units, units[1:] + units[:1], strict=True):
        angles += np.arcsin(np.clip(np.sum(one * other, axis=1), -1.0, 1.0))
    edges = np.cross(end[second] - begin[second], end[first] - begin[first])
    return float(np.sum(angles * np.sign(np.sum(edges * corners[0], axis=1)))) / (2.0 * math.pi)
