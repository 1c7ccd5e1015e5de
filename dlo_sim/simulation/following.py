"""Trajectories of end effectors, split into one motion per step for one compiled call."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np
from numpy.typing import ArrayLike, NDArray

from dlo_sim.core import arguments, rotations
from dlo_sim.core.methods import IMPLICIT
from dlo_sim.core.two_points import LEAST_APART, poses_of_two_points
from dlo_sim.simulation.bodies import write_steps
from dlo_sim.simulation.geometry import known_holder
from dlo_sim.simulation.play import stretch
from dlo_sim.simulation.recorder import Recorder
from dlo_sim.simulation.report import Report
from dlo_sim.simulation.running import Running
from dlo_sim.simulation.soundness import judged
from dlo_sim.simulation.stepper import Along

Array = NDArray[np.float64]

UNEVEN = 4.0  # ratio of neighbouring intervals from which the slope is that of the longer one


def record_along(
    sim: Running, times: ArrayLike, poses: Mapping[str, ArrayLike], samples: ArrayLike
) -> tuple[Report, Recorder]:
    """`Simulator.follow`, but returns the recorder of the samples, which has their energies too."""
    if sim.choice.method.family != IMPLICIT:
        raise ValueError(
            f"integrator.method: {sim.choice.method.name} follows no poses; give energy_momentum"
        )
    if not isinstance(poses, Mapping):
        raise TypeError(f"poses: needs {{'start': numbers (T, 7)}}, got {arguments.given(poses)}")
    for name in sim.scene.holders:
        waiting = sim.ends.queue.of(name)
        if waiting and name not in poses:
            raise ValueError(
                f"poses: none of {name}, whose next motion begins at {waiting[0].start:g} s, "
                "while poses can only be followed beside motions that have begun; give poses "
                f"of {name} too, or follow them after that time"
            )
    stamps, grid = checked_times(times, sim.steps, sim.step)
    wanted = checked_samples(samples, sim.time, stamps[-1])
    away = np.append(sim.origin, np.zeros(4))
    rows = {
        name: checked_path(sim, name, given, len(stamps)) - away for name, given in poses.items()
    }
    paths = {name: on_grid(grid, stamps, given) for name, given in rows.items()}
    for name, path in paths.items():
        sim.move_along(name, path)
    for name, path in paths.items():
        sim.put_end(name, path[0, :3], path[0, 3:])
    cable = sim.cable
    recorder = Recorder(sim.model, wanted)
    motions = np.repeat(cable.motion[None], len(grid) - 1, axis=0)
    for name, path in paths.items():
        row = list(sim.scene.holders).index(name)
        write_steps(motions[:, row], grid, path)
    along = Along(motions, *sim.natural.turns_along(motions))
    report = stretch(sim, len(motions), recorder, along)
    sim.ends.restored()
    return judged(report, recorder), recorder


def checked_path(sim: Running, name: str, given: ArrayLike, count: int) -> Array:
    """Poses (count, 7) of an end effector from poses or pairs of points (count, 2, 3), which do not
    determine the roll: it goes on from the present one.

    Raises:
        TypeError, ValueError: no such end effector, not such numbers, a zero quaternion, or points
            that coincide.
    """
    before, tangent = sim.end_pose(known_holder(sim.scene, name))[1], sim.geometries[name].tangent
    try:
        are_points = np.ndim(given) == 3
    except ValueError:  # rows of unequal length
        are_points = False
    if are_points:
        points = arguments.numbers(f"poses of {name}", given, (count, 2, 3), "m")
        apart = np.linalg.norm(points[:, 1] - points[:, 0], axis=1)
        worst = int(np.argmin(apart))
        if apart[worst] < LEAST_APART:
            raise ValueError(
                f"points of {name}: row {worst} has two points {apart[worst]:.3g} m apart, which "
                "give no direction; give two apart"
            )
        x, y, z, w = before.tolist()
        return poses_of_two_points(points, (x, y, z, w), tangent.tolist())
    rows = arguments.numbers(f"poses of {name}", given, (count, 7))
    turned = rows[:, 3:].any(axis=1)
    if not turned.all():
        raise ValueError(
            f"poses of {name}: row {np.argmin(turned)} has a quaternion of zero; give x, y, z, w "
            "of an orientation, 0, 0, 0, 1 for none"
        )
    return rows


def checked_times(given: ArrayLike, steps: int, step: float) -> tuple[Array, Array]:
    """Times of the poses, and of the steps from the present to the last pose [s].

    Args:
        steps: number of steps up to the present. step: [s].

    Raises:
        TypeError, ValueError: not numbers, not rising, the first after the present, or the last
            not after it.
    """
    times, present = arguments.numbers("times", given, (None,), "s"), steps * step
    if len(times) < 2 or not np.all(np.diff(times) > 0.0):
        raise ValueError("times: needs two or more, each later than the one before")
    if times[0] > present + 1e-9 * step:
        raise ValueError(f"times: needs a first time of {present!r} s, the present, or less")
    last = int(np.ceil(times[-1] / step - 1e-9))
    if last <= steps:
        raise ValueError(
            f"times: end at {times[-1]:g} s, not after the present, {present:g} s; "
            "give a later last time"
        )
    return times, step * np.arange(steps, last + 1, dtype=float)


def checked_samples(given: ArrayLike, present: float, end: float) -> Array:
    """Times of samples [s].

    Raises:
        TypeError, ValueError: not numbers, not rising, or not between the present and the end.
    """
    samples = arguments.numbers("samples", given, (None,), "s")
    if not np.all(np.diff(samples, prepend=present) > 0.0) or np.any(samples > end):
        raise ValueError(
            f"samples: {arguments.given(samples.tolist())} s do not rise from after the present, "
            f"{present:g} s, to at most the last of times, {end:g} s; give such"
        )
    return samples


def on_grid(grid: Array, times: Array, poses: Array) -> Array:
    """Poses (T, 7) at the times of a grid: cubic Hermite interpolation, quaternions normalised."""
    signs = np.sign(np.sum(poses[1:, 3:] * poses[:-1, 3:], axis=1))
    poses = poses.copy()
    poses[1:, 3:] *= np.cumprod(np.where(signs < 0.0, -1.0, 1.0))[:, None]
    slopes = _slopes(times, poses)
    k = np.clip(np.searchsorted(times, grid, side="right") - 1, 0, len(times) - 2)
    h = (times[k + 1] - times[k])[:, None]
    s = np.clip((grid - times[k])[:, None] / h, 0.0, 1.0)
    a, b = (1.0 + 2.0 * s) * (1.0 - s) ** 2, s**2 * (3.0 - 2.0 * s)
    path = a * poses[k] + b * poses[k + 1]
    path += h * (s * (1.0 - s) ** 2 * slopes[k] - s**2 * (1.0 - s) * slopes[k + 1])
    path[:, 3:] = rotations.normalized(path[:, 3:])
    return np.asarray(path)


def _slopes(times: Array, poses: Array) -> Array:
    """Slopes of the poses at their times: those of the parabola through three neighbours.

    Where one interval is over UNEVEN times longer than the other, the slope of its chord; with the
    slope of the short one the path would overshoot in the long one.
    """
    slopes: Array = np.gradient(poses, times, axis=0)
    lengths = np.diff(times)
    before, after = lengths[:-1], lengths[1:]
    uneven = np.flatnonzero(np.maximum(before, after) > UNEVEN * np.minimum(before, after))
    longer = uneven + (after[uneven] > before[uneven])
    slopes[uneven + 1] = np.diff(poses, axis=0)[longer] / lengths[longer, None]
    return slopes
