"""Many cables at once (`simulate_batch`), and many plans for one cable (`forecast_batch`).

The results do not depend on which process computes what.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from contextlib import nullcontext
from dataclasses import dataclass
from functools import partial
from typing import Any, TypeVar

import numpy as np
from numpy.typing import ArrayLike, NDArray

from dlo_sim.batch.workers import Workers, open_workers
from dlo_sim.core import arguments
from dlo_sim.scene.description import Scene
from dlo_sim.scene.loading import SceneError
from dlo_sim.simulation.forecast import EVERY, Forecast, Plan
from dlo_sim.simulation.play import play
from dlo_sim.simulation.recorder import Recorder
from dlo_sim.simulation.recording import energies_at, sample_times, steps_of
from dlo_sim.simulation.report import Report
from dlo_sim.simulation.resolution import resolved
from dlo_sim.simulation.simulator import Simulator

Array = NDArray[np.float64]
_TOGETHER = 16  # plans that a worker gets at a time
Start = tuple[ArrayLike, ArrayLike]
Given = TypeVar("Given")
Path = tuple[ArrayLike, Mapping[str, ArrayLike]]
Asked = tuple[int, Scene, Start | None, Path | None]
"""A scene of the batch: its number, it, its start, and its path."""


@dataclass(frozen=True)
class BatchResult:
    """Outcomes of all scenes, in their order.

    Attributes:
        time: of the samples [s], shape (T,).
        control_points: x, y, z [m] and theta [rad], shape (scenes, T, n_u, 4), of nets as
            `Simulator.control_points`. After a scene's last
            good state that state is repeated, so every number is finite.
        samples: how many of the T samples are no repetitions, shape (scenes,).
        energy: kinetic and potential [J], shape (scenes, T), as `Recording.energy`.
        energy_error: largest |energy - work done + energy lost| as a share of the energy exchanged,
            up to the last good state, shape (scenes,).
        status: ok, diverged, not_converged or unresolved; message: one line, empty if all is well.
        method: of each scene; step [s] and simulated [s]: shape (scenes,).
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
    """Run scenes of one number of control points from their initial states, each as
    `simulation.recording.record` runs it. Where scenes leave the number open, it is the largest
    that one of them needs. Errors are not estimated (accuracy.estimate).

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
    opened = open_workers(scheduler, processes) if workers is None else nullcontext(workers)
    with opened as crew:
        runs = list(crew.map(partial(_run, duration, every), asked))
    for k, run in enumerate(runs):
        (_, here, _), (_, count, _) = (one["control_points"].shape for one in (run, runs[0]))
        if here != count:
            what = f"scene {k} has {here} control points with those of bodies, scene 0 has {count}"
            raise ValueError(f"{what}; give nets with the same joints and connectors")
    entries: dict[str, Any] = {name: np.array([run[name] for run in runs]) for name in runs[0]}
    for name in ("status", "message", "method"):
        entries[name] = tuple(run[name] for run in runs)
    return BatchResult(time=sample_times(duration, every), **entries)


def _check(scenes: Sequence[Scene], duration: float, every: float) -> None:
    if not scenes:
        raise ValueError("scenes: there are none; give at least one")
    for name, value in (("duration", duration), ("every", every)):
        if not (np.isfinite(value) and value > 0.0):
            raise ValueError(f"{name}: {value:g} s is not above 0")


def _alike(scenes: Sequence[Scene]) -> list[Scene]:
    """The scenes with one number of control points, of each cable of a net: those that leave it
    open get the number that others ask for, or else the largest that is chosen for one of them.

    Raises:
        ValueError: scenes ask for different numbers, or have other cables.
    """
    names = [tuple(strand.name for strand in scene.strands) for scene in scenes]
    for k, own in enumerate(names):
        if own != names[0]:
            what = f"scene {k} has the cables {', '.join(own)}, scene 0 {', '.join(names[0])}"
            raise ValueError(f"{what}; give nets of the same cables")
    values: dict[str, object] = {}
    for place, strand in enumerate(scenes[0].strands):
        numbers = [_points(scene, place) for scene in scenes]
        count = max(numbers) or max(_points(resolved(scene)[0], place) for scene in scenes)
        for k, number in enumerate(numbers):
            if number not in (0, count):
                of = f" of {strand.name}" * bool(strand.key)
                raise ValueError(
                    f"scene {k} has {number} control points{of}, scene {numbers.index(count)} has "
                    f"{count}; give scenes of one number of control points"
                )
        values[strand.key_of("discretization.control_points")] = count
    return [scene.with_values(values) for scene in scenes]


def _points(scene: Scene, place: int) -> int:
    """Number of control points that a scene gives to one of its cables; 0 = open."""
    return int(scene.strands[place].scene.discretization.control_points)


def _each(
    name: str, given: Sequence[Given | None] | None, scenes: Sequence[Scene]
) -> Sequence[Given | None]:
    """What is given for each scene, or None for each."""
    if given is not None and len(given) != len(scenes):
        raise ValueError(f"{name}: {len(given)} for {len(scenes)} scenes; give one each, or None")
    return [None] * len(scenes) if given is None else given


def _run(duration: float, every: float, asked: Asked) -> dict[str, Any]:
    """The entries of one scene in `BatchResult`; after its last good state that state is
    repeated.
    """
    k, scene, start, path = asked
    try:
        simulator = Simulator(scene)
        if start is not None:
            simulator.start_from(*start)
    except SceneError as refusal:
        raise SceneError(f"scene {k}: {refusal}") from None
    except (TypeError, ValueError) as refusal:
        raise ValueError(f"initial {k}: {refusal}") from None
    times, first = sample_times(duration, every), simulator.control_points[None]
    energy = simulator.energy().total
    if path is None:
        recorder = Recorder(simulator.model, times[1:])
        report = play(simulator, steps_of(duration, simulator.step), recorder)
    else:
        report, recorder = _along(simulator, duration, path, times[1:], k)
    points = np.concatenate([first, recorder.control_points])
    energies = np.append(energy, recorder.energies[: recorder.count])
    energies = energies_at(times[: len(points)], energies, simulator.step, every)
    repeated, last = len(times) - len(points), simulator.control_points
    return {
        "control_points": np.concatenate([points, np.repeat(last[None], repeated, axis=0)]),
        "samples": len(points),
        "energy": np.concatenate([energies, np.repeat(energies[-1:], repeated)]),
        "energy_error": simulator.energy_error,
        "status": report.status.name.lower(),
        "message": report.message,
        "method": simulator.method,
        "step": simulator.step,
        "simulated": simulator.time,
    }


def _along(
    simulator: Simulator, duration: float, path: Path, samples: Array, k: int
) -> tuple[Report, Recorder]:
    """A run of scene k, whose end effectors follow poses."""
    try:
        stamps = arguments.numbers("times", path[0], (None,), "s")
        if len(stamps) and abs(stamps[-1] - duration) > 1e-9 * duration:
            raise ValueError(
                f"times: end at {stamps[-1]:g} s, the batch at {duration:g} s; give poses up to "
                "its end"
            )
        return simulator.record_along(stamps, path[1], samples)
    except (TypeError, ValueError) as refusal:
        raise ValueError(f"poses {k}: {refusal}") from None


def forecast_batch(
    simulator: Simulator,
    plans: Sequence[Plan],
    every: float = EVERY,
    *,
    workers: Workers | None = None,
    processes: int | None = None,
    scheduler: str | None = None,
) -> list[Forecast]:
    """What `Simulator.forecast` gives for each plan, in their order.

    Args:
        workers, processes, scheduler: as of `simulate_batch`.

    Raises:
        TypeError, ValueError: as `Simulator.forecast`, with the number of the plan.
    """
    numbered = list(enumerate(plans))
    pieces = [numbered[k : k + _TOGETHER] for k in range(0, len(plans), _TOGETHER)]
    opened = open_workers(scheduler, processes) if workers is None else nullcontext(workers)
    with opened as crew:
        done = crew.map(partial(_forecasts, simulator, every), pieces)
        return [found for part in done for found in part]


def _forecasts(
    simulator: Simulator, every: float, plans: Sequence[tuple[int, Plan]]
) -> list[Forecast]:
    found = []
    for k, plan in plans:
        try:
            found.append(simulator.forecast(plan, every))
        except (TypeError, ValueError) as refusal:
            raise type(refusal)(f"plan {k}: {refusal}") from None
    return found
