"""Many cables at once: `simulate_batch`.

Scenes that fit go eight at a time to the vector lanes (`lanes`), the others one by one; both are
spread over workers. Who computes what never changes a number.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from contextlib import nullcontext
from dataclasses import dataclass, replace
from functools import partial
from typing import TypeVar

import numpy as np
from numpy.typing import ArrayLike, NDArray

from dlo_sim.batch.lanes import LANES, Lane, Run, new_lane, reason_against, run_lanes
from dlo_sim.batch.workers import Workers, open_workers
from dlo_sim.core import arguments
from dlo_sim.scene.description import Scene
from dlo_sim.scene.loading import SceneError
from dlo_sim.simulation.recording import energies_at, record_simulator, sample_times
from dlo_sim.simulation.report import Status
from dlo_sim.simulation.resolution import resolved
from dlo_sim.simulation.simulator import Simulator

Array = NDArray[np.float64]
Start = tuple[ArrayLike, ArrayLike]
Given = TypeVar("Given")
Path = tuple[ArrayLike, Mapping[str, ArrayLike]]
Asked = tuple[int, Scene, Start | None, Path | None]
"""A scene of the batch: its number, it, its start and its path."""
FOLLOWS = "its end effectors follow poses"


@dataclass(frozen=True)
class BatchResult:
    """What came of every scene, in their order.

    Attributes:
        time: of the samples [s], shape (T,).
        control_points: x, y, z [m] and theta [rad], shape (scenes, T, n_u, 4). After a scene's last
            good state that state is repeated, so every number is finite.
        samples: how many of the T samples are no repetitions, shape (scenes,).
        energy: kinetic and potential [J], shape (scenes, T), as `Recording.energy`.
        energy_error: largest |energy - work done + energy lost| as a share of the energy exchanged,
            up to the last good state, shape (scenes,).
        status: ok, diverged, not_converged or unresolved; message: one line, empty if all is well.
        method: of each scene; step [s] and simulated [s]: shape (scenes,).
        one_by_one: why a scene was not on a vector lane, empty if it was.
    """

    time: Array
    control_points: Array
    samples: NDArray[np.int64]
    energy: Array
    energy_error: Array
    status: tuple[str, ...]
    message: tuple[str, ...]
    method: tuple[str, ...]
    step: Array
    simulated: Array
    one_by_one: tuple[str, ...]

    @property
    def ok(self) -> bool:
        """Whether every scene got to its end."""
        return all(status == "ok" for status in self.status)


def simulate_batch(
    scenes: Sequence[Scene],
    duration: float,
    *,
    initial: Sequence[Start | None] | None = None,
    poses: Sequence[Path | None] | None = None,
    every: float | None = None,
    workers: Workers | None = None,
    processes: int | None = None,
    scheduler: str | None = None,
) -> BatchResult:
    """Run scenes of one number of control points from their initial states. Where scenes leave it
    open, it is the largest that one of them needs.

    Scenes of one structure (method, terms, quadrature, number of loads) with a drift/kick method
    (velocity_verlet, forest_ruth) and nothing but stretching, bending, gravity, springs, point
    forces, held ends and mass-proportional damping share the vector unit. Such a stack takes ONE
    step: where integrator.step is 0, the smallest of the steps that its scenes would choose; where
    steps are given, scenes of different steps are different stacks. All other scenes run one by one
    as `simulation.recording.record` runs them; `BatchResult.one_by_one` says why. Errors are not
    estimated (accuracy.estimate).

    A scene on a lane and the same scene (with that step) in a `Simulator` differ by round-off and
    what the motion makes of it. A scene whose energy grows without cause is stopped at its last
    sane state, which is one of those at which the energy is looked at (every 16 steps and at
    samples), and marked; its neighbours do not notice.

    Args:
        duration: simulated time [s], above 0; covered by whole steps.
        initial: for each scene None (as the scene says) or (control points, velocities), each of
            shape (n_u, 4) [m, rad; m/s, rad/s].
        poses: for each scene None (its end effectors rest) or (times, {end or grasp: poses}) as for
            `Simulator.follow`, which the scene then does: times from 0 to the duration [s], an
            implicit method. The first sample is the state before.
        every: time between samples [s]; default: the start and the end.
        workers: from `open_workers`, to be used again; else they are opened for this call:
        processes: on this machine, default one per core, 1 = none but this one; scheduler: address
            of a Dask scheduler. New processes import the calling script: it needs the usual guard
            `if __name__ == "__main__":`.

    Raises:
        ValueError: no scenes, different numbers of control points, times that are not above 0, or
            an initial state that does not fit. SceneError: a scene that cannot be simulated, with
            its number. WorkersError: nobody at the address.
    """
    every = duration if every is None else every
    _check(scenes, duration, every)
    scenes = _alike(scenes)
    starts, paths = _each("initial", initial, scenes), _each("poses", poses, scenes)
    asked = list(zip(range(len(scenes)), scenes, starts, paths, strict=True))
    pieces = [asked[k : k + LANES] for k in range(0, len(asked), LANES)]
    opened = open_workers(scheduler, processes) if workers is None else nullcontext(workers)
    with opened as crew:
        looking = crew.map(partial(_look_at, duration, every), pieces)
        looked = [found for part in looking for found in part]
        lanes = {k: found for k, found in enumerate(looked) if isinstance(found, Lane)}
        runs = {k: found for k, found in enumerate(looked) if isinstance(found, Run)}
        stacks = _stacks(lanes)
        running = crew.map(partial(_run_stack, duration, every), stacks)
        for stack, results in zip(stacks, running, strict=True):
            runs.update(zip(stack, results, strict=True))
    return _gathered([runs[k] for k in range(len(scenes))], sample_times(duration, every))


def _check(scenes: Sequence[Scene], duration: float, every: float) -> None:
    if not scenes:
        raise ValueError("scenes: there are none; give at least one")
    for name, value in (("duration", duration), ("every", every)):
        if not (np.isfinite(value) and value > 0.0):
            raise ValueError(f"{name}: {value:g} s is not above 0")


def _alike(scenes: Sequence[Scene]) -> list[Scene]:
    """The scenes with one number of control points: those that leave it open get the number that
    others ask for, or else the largest that is chosen for one of them.

    Raises:
        ValueError: scenes ask for different numbers.
    """
    numbers = [scene.discretization.control_points for scene in scenes]
    count = max(numbers) or max(
        resolved(scene)[0].discretization.control_points for scene in scenes
    )
    for k, number in enumerate(numbers):
        if number not in (0, count):
            raise ValueError(
                f"scene {k} has {number} control points, scene {numbers.index(count)} has {count}; "
                "give scenes of one number of control points"
            )
    return [scene.with_values({"discretization.control_points": count}) for scene in scenes]


def _each(
    name: str, given: Sequence[Given | None] | None, scenes: Sequence[Scene]
) -> Sequence[Given | None]:
    """What is given for each scene, or None for each."""
    if given is not None and len(given) != len(scenes):
        raise ValueError(f"{name}: {len(given)} for {len(scenes)} scenes; give one each, or None")
    return [None] * len(scenes) if given is None else given


def _look_at(duration: float, every: float, asked: Sequence[Asked]) -> list[Lane | Run]:
    """Lanes of the scenes that fit; the others are run at once."""
    found: list[Lane | Run] = []
    for k, scene, start, path in asked:
        try:
            simulator = Simulator(scene)
            if start is not None:
                simulator.start_from(*start)
        except SceneError as refusal:
            raise SceneError(f"scene {k}: {refusal}") from None
        except (TypeError, ValueError) as refusal:
            raise ValueError(f"initial {k}: {refusal}") from None
        reason = reason_against(simulator)
        if path is not None:
            found.append(_run_along(simulator, duration, every, path, k))
        elif reason:
            found.append(_run_alone(simulator, duration, every, reason))
        else:
            found.append(new_lane(simulator))
    return found


def _run_along(simulator: Simulator, duration: float, every: float, path: Path, k: int) -> Run:
    """The run of scene k, whose end effectors follow poses."""
    times = sample_times(duration, every)
    first, energy = simulator.control_points[None], simulator.energy().total
    try:
        stamps = arguments.numbers("times", path[0], (None,), "s")
        if len(stamps) and abs(stamps[-1] - duration) > 1e-9 * duration:
            raise ValueError(
                f"times: end at {stamps[-1]:g} s, the batch at {duration:g} s; give poses up to "
                "its end"
            )
        report, recorder = simulator.record_along(stamps, path[1], times[1:])
    except (TypeError, ValueError) as refusal:
        raise ValueError(f"poses {k}: {refusal}") from None
    points = np.concatenate([first, recorder.control_points])
    energies = np.append(energy, recorder.energies[: recorder.count, 0])
    energies = energies_at(times[: len(points)], energies, simulator.step, every)
    return _single(simulator, points, energies, report.status, report.message, times, FOLLOWS)


def _run_alone(simulator: Simulator, duration: float, every: float, reason: str) -> Run:
    done, times = record_simulator(simulator, duration, every), sample_times(duration, every)
    status = Status[done.status.upper()]
    samples = done.control_points, done.energy
    return _single(simulator, *samples, status, done.message, times, reason)


def _single(
    simulator: Simulator,
    points: Array,
    energy: Array,
    status: Status,
    message: str,
    times: Array,
    reason: str,
) -> Run:
    """The run of a simulator of its own; after its samples the last good state is repeated."""
    repeated = len(times) - len(points)
    last = simulator.control_points[None]
    return Run(
        control_points=np.concatenate([points, np.repeat(last, repeated, axis=0)]),
        energy=np.concatenate([energy, np.repeat(energy[-1:], repeated)]),
        good=len(points),
        energy_error=simulator.energy_error,
        status=status,
        message=message,
        method=simulator.method,
        step=simulator.step,
        simulated=simulator.time,
        one_by_one=reason,
    )


def _stacks(lanes: dict[int, Lane]) -> list[dict[int, Lane]]:
    """Lanes of one structure together, up to LANES in a stack, all with the shortest step."""
    groups: dict[tuple[object, ...], list[int]] = {}
    for k, lane in lanes.items():
        groups.setdefault(lane.structure, []).append(k)
    stacks = []
    for members in groups.values():
        step = min(lanes[k].step for k in members)
        for first in range(0, len(members), LANES):
            part = members[first : first + LANES]
            stacks.append({k: replace(lanes[k], step=step) for k in part})
    return stacks


def _run_stack(duration: float, every: float, stack: dict[int, Lane]) -> list[Run]:
    lanes, times = list(stack.values()), sample_times(duration, every)
    runs = run_lanes(lanes, lanes[0].step, duration, times)
    return [replace(run, energy=energies_at(times, run.energy, run.step, every)) for run in runs]


def _gathered(runs: Sequence[Run], time: Array) -> BatchResult:
    return BatchResult(
        time=time,
        control_points=np.stack([run.control_points for run in runs]),
        samples=np.array([run.good for run in runs]),
        energy=np.stack([run.energy for run in runs]),
        energy_error=np.array([run.energy_error for run in runs]),
        status=tuple(run.status.name.lower() for run in runs),
        message=tuple(run.message for run in runs),
        method=tuple(run.method for run in runs),
        step=np.array([run.step for run in runs]),
        simulated=np.array([run.simulated for run in runs]),
        one_by_one=tuple(run.one_by_one for run in runs),
    )
