"""Runs a scene for a given time and samples it; used by `dlo_sim simulate`."""

from __future__ import annotations

import os
import time
from collections.abc import Callable
from dataclasses import dataclass, field
from typing import Any

import numpy as np
from numpy.typing import NDArray

from dlo_sim.scene.description import Scene
from dlo_sim.simulation.error_estimate import ErrorEstimate
from dlo_sim.simulation.play import play
from dlo_sim.simulation.recorder import TENSION, Recorder, largest
from dlo_sim.simulation.remarks import look_back
from dlo_sim.simulation.report import Report, Status, newton_note
from dlo_sim.simulation.selection import less_work
from dlo_sim.simulation.simulator import Simulator

Array = NDArray[np.float64]

_ROUNDING = 1e-9  # share of a step or sample interval that counts as round-off
_PARTS = 100  # parts of a run whose Newton iterations are assessed separately
_FEWEST_STEPS = 256  # of a part: calling the stepping loop costs some 10 us
LONG = 5.0  # [s]: remaining time from which an estimate of it is shown
_UNITS = (("days", 86400.0), ("h", 3600.0), ("min", 60.0), ("s", 1.0))
_SMALL = (("s", 1.0), ("ms", 1e-3), ("us", 1e-6), ("ns", 1e-9))
_NOTABLE = 1.0  # [s]: time of an error estimate from which it is said
_BRIEF, _TOO_LONG = 0.05, 0.2  # [s]: after a shorter call twice the steps, after a longer one half


@dataclass(frozen=True)
class Recording:
    """A run and its samples.

    Attributes:
        time: k * every [s], shape (T,).
        control_points: x, y, z [m] and theta [rad], shape (T, n_u, 4); of a net, as what follows
            up to `curvature`, of the main cable.
        centerline: points of the cable [m] at `centerline_u`, shape (T, n_c, 3).
        centerline_u: material coordinates [m], shape (n_c,).
        tension: [N] there, shape (T, n_c), None if the shape does not determine it.
        curvature: [1/m] there, shape (T, n_c).
        energy: kinetic and potential energy [J], shape (T,): at the end of the step that contains
            the sample; interpolated between steps if samples are closer than steps.
        status: ok, diverged, not_converged or interrupted; message: one line, empty if all is well.
        simulated_s: duration [s] rounded up to whole steps, or time of the last good state.
        wall_s: time for stepping [s]; compile_s: for building the simulator before it [s].
        steps, step_s, method, force_evaluations: of the run; implicit methods count Newton
            iterations as force evaluations.
        choice: why this method and step; resolution: how many control points, and why.
        real_time_factor: simulated_s / wall_s.
        energy_error_max: largest |energy - work done + energy lost| relative to the largest energy
            exchanged; None if it is not finite.
        error_estimate: largest estimated position errors [m] of the run: `time`, `space`, `total`
            (None = unknown); None if errors were not estimated (accuracy.estimate).
        advice: the error if it exceeds accuracy.target, and what cures it, one line; else empty.
        active_terms, left_out: terms in the step, and the other terms with the reason.
        notes: what a reader of the results should know, one line each.
        contacts: obstacle -> `clearance` [m], `force` on the cable (3) [N], largest force per
            length `pressure` [N/m], material coordinates [m] at which the cable `passes` through a
            ring or channel, and `tensions` [N] on both sides, and sum of the sizes of all forces
            `total` [N], and the size of their sum `exerted` [N], `total` where they cancel, at the
            end of the run; "itself" -> the same of the cable with itself.
        obstacles: what `drawn_obstacles` says of them and of contact.
        net: of a net, what `Recorder.net` says of the other cables and of connectors.
        slides: grasp through which the cable slides -> material coordinate `u` [m] that it holds
            at the end of the run, tension `before` and `after` it [N].
    """

    time: Array
    control_points: Array
    centerline: Array
    centerline_u: Array
    tension: Array | None
    curvature: Array
    energy: Array
    status: str
    message: str
    simulated_s: float
    wall_s: float
    compile_s: float
    steps: int
    step_s: float
    method: str
    choice: str
    resolution: str
    force_evaluations: int
    real_time_factor: float
    energy_error_max: float | None
    error_estimate: dict[str, float | None] | None
    advice: str
    active_terms: tuple[str, ...]
    left_out: dict[str, str]
    notes: tuple[str, ...] = ()
    contacts: dict[str, dict[str, Any]] = field(default_factory=dict)
    obstacles: dict[str, Array] = field(default_factory=dict)
    slides: dict[str, dict[str, float]] = field(default_factory=dict)
    net: dict[str, Array] = field(default_factory=dict)

    @property
    def peak_tension(self) -> float | None:
        """The largest tension of the run [N], of any cable; None if the shape does not determine
        it.
        """
        return largest(TENSION, self.tension, self.net)

    @property
    def ok(self) -> bool:
        """Whether the run was completed."""
        return self.status == Status.OK.name.lower()

    @property
    def interrupted(self) -> bool:
        """Whether the run was ended from outside."""
        return self.status == Status.INTERRUPTED.name.lower()


def record(
    scene: Scene,
    duration: float,
    every: float,
    progress: Callable[[float], None] | None = None,
    tell: Callable[[str], object] | None = None,
) -> Recording:
    """Run a scene from its initial shape and sample it.

    A sample within a step is interpolated by the cubic through the positions and velocities at the
    ends of the step. A run that fails or is interrupted keeps the samples up to its last good
    state.

    Args:
        scene: what to simulate; ends with a pose topic rest at their poses in the scene.
        duration: simulated time [s], above 0; rounded up to whole steps.
        every: time between samples [s], above 0.
        progress: called from time to time with the fraction done; may raise KeyboardInterrupt to
            end the run.
        tell: called early in a long run with one line: how long it will take, and what is faster.

    Raises:
        SceneError: the scene cannot be simulated.
    """
    began = time.perf_counter()
    simulator = Simulator(scene)
    estimate = ErrorEstimate(simulator) if scene.estimates_errors else None
    compile_s = time.perf_counter() - began
    recorder = Recorder(simulator.model, sample_times(duration, every))
    recorder.put(simulator.cable, simulator.energy().total)
    watch = _Progress(simulator, duration, progress, tell)
    watchers = (watch,) if estimate is None else (watch, estimate)
    report = play(simulator, watch.total, recorder, watchers=watchers)
    wall_s, error_found = watch.wall, None if estimate is None else estimate.largest
    count = recorder.count
    shapes = recorder.along()
    error = simulator.energy_error
    drawn = look_back(simulator, recorder, recorder.times[:count])
    return Recording(
        time=recorder.times[:count],
        control_points=shapes.control_points,
        centerline=shapes.centerline,
        centerline_u=shapes.u,
        tension=shapes.tension,
        curvature=shapes.curvature,
        energy=energies_at(
            recorder.times[:count], recorder.energies[:count], simulator.step, every
        ),
        status=report.status.name.lower(),
        message=report.message,
        simulated_s=simulator.time,
        wall_s=wall_s,
        compile_s=compile_s,
        steps=simulator.steps,
        step_s=simulator.step,
        method=simulator.method,
        choice=simulator.choice.reason,
        resolution=simulator.resolution,
        force_evaluations=watch.evaluations,
        real_time_factor=simulator.time / wall_s,
        energy_error_max=error if np.isfinite(error) else None,
        error_estimate=None if error_found is None else error_found.numbers,
        advice="" if estimate is None or error_found is None else estimate.advice(error_found),
        active_terms=simulator.active_terms,
        left_out=simulator.left_out,
        notes=simulator.notes + watch.notes + _cost(estimate),
        obstacles=drawn,
        net=recorder.net(),
        contacts={
            name: {
                "clearance": one.clearance,
                "force": one.force.tolist(),
                "pressure": one.pressure,
                "passes": one.passes.tolist(),
                "tensions": one.tensions.tolist(),
                "total": one.total,
                "exerted": one.exerted,
            }
            for name, one in simulator.contacts.items()
        },
        slides={name: one._asdict() for name, one in simulator.slides.items()},
    )


def _cost(estimate: ErrorEstimate | None) -> tuple[str, ...]:
    """One line about the time of an estimate that had no core of its own, if it was long."""
    if estimate is None or estimate.seconds < _NOTABLE or _cores() > 1:
        return ()
    return (
        f"the error estimate took {estimate.seconds:.2g} s beside the run on the only core; "
        "accuracy.estimate: off saves them",
    )


def _cores() -> int:
    if hasattr(os, "sched_getaffinity"):  # not on every platform
        return len(os.sched_getaffinity(0))
    return os.cpu_count() or 1


def steps_of(duration: float, step: float) -> int:
    """Whole steps [s] that cover a duration [s]."""
    return max(1, int(np.ceil(duration / step - _ROUNDING)))


def sample_times(duration: float, every: float) -> Array:
    """Multiples of `every` [s] from 0 up to the duration."""
    count = int(np.floor(duration / every + _ROUNDING)) + 1
    return np.arange(count, dtype=float) * every


class _Progress:
    """Watches a run: how far it is, how long that took, and where Newton's method was slow.

    Attributes:
        evaluations: force evaluations so far. wall: time for stepping [s].
    """

    def __init__(
        self,
        simulator: Simulator,
        duration: float,
        progress: Callable[[float], None] | None,
        tell: Callable[[str], object] | None,
    ) -> None:
        self._simulator, self._duration = simulator, duration
        self._progress, self._tell = progress, tell
        self.total = steps_of(duration, simulator.step)
        self._part, self._piece = max(self.total // _PARTS, _FEWEST_STEPS), 1
        self.evaluations, self.wall = 0, 0.0
        self._assessed, self._slow = np.zeros((2, 2), dtype=np.int64)
        self._began = time.perf_counter()

    def next_look(self, steps: int) -> int:
        """After a piece that takes neither too little time nor too much."""
        return steps + min(self._piece, self._part - steps % self._part)

    def look(self, report: Report) -> str:
        """Measure, assess a part, and tell."""
        simulator = self._simulator
        took = time.perf_counter() - self._began
        self.wall += took
        self.evaluations += report.force_evaluations
        ended = simulator.steps >= self.total or not report.status.advanced
        if ended or simulator.steps % self._part == 0:
            now = np.array([simulator.steps, self.evaluations])
            if self._note(now - self._assessed):
                self._slow += now - self._assessed
            self._assessed = now
        if took < _BRIEF:
            self._piece = min(2 * self._piece, self._part)
        elif took > _TOO_LONG:
            self._piece = max(report.steps // 2, 1)
        if self._tell is not None and self.wall >= _BRIEF and not ended:
            left = self.wall * (self.total / simulator.steps - 1.0)
            if left > LONG:
                self._tell(_run_time_estimate(simulator, self.total, left))
            self._tell = None
        try:
            if self._progress is not None:
                self._progress(simulator.steps / self.total)
        except KeyboardInterrupt:
            return f"interrupted at {simulator.time:.6g} s of {self._duration:g} s"
        finally:
            self._began = time.perf_counter()
        return ""

    @property
    def notes(self) -> tuple[str, ...]:
        """One line about the slow parts, if there are any."""
        note = self._note(self._slow)
        return (f"in {self._slow[0]} of {self._simulator.steps} steps {note}",) if note else ()

    def _note(self, part: NDArray[np.int64]) -> str:
        sim = self._simulator
        steps, iterations = part.tolist()
        return newton_note(sim.choice.method, sim.step, steps, iterations, sim.scene.touches)


def energies_at(times: Array, energies: Array, step: float, every: float) -> Array:
    """Energy [J] at the samples, from that at the ends of the steps that contain them."""
    if every >= step:
        return energies
    return np.interp(times, np.ceil(times / step - _ROUNDING) * step, energies)


def _run_time_estimate(simulator: Simulator, steps: int, seconds: float) -> str:
    """One line: the number of steps, their approximate time, and a method with less work if any.

    Args:
        steps: of the whole run. seconds: approximate time that is left.
    """
    line = f"{steps} steps of {_shown(simulator.step, _SMALL)}, about {_shown(seconds, _UNITS)}"
    other = less_work(simulator.scene, simulator.choice)
    if other is None:
        return line
    fewer = max(round(steps * simulator.step / other.step), 1)
    return (
        f"{line}; {other.method.name} would take {fewer} steps of {_shown(other.step, _SMALL)} "
        "(--set integrator.method=auto --set integrator.step=0)"
    )


def _shown(seconds: float, units: tuple[tuple[str, float], ...]) -> str:
    """A time in the largest unit that does not exceed it."""
    name, size = next((unit for unit in units if seconds >= unit[1]), units[-1])
    return f"{seconds / size:.3g} {name}"
