"""Estimate of the discretisation error while the simulation runs.

Two companions with the same loads and end motions follow the simulator in threads of their own, as
compiled steps release the interpreter's lock: one with half the step, one with 1.5 times as many
spans. The simulator does not wait for them; who reads the errors does, unless it is live. The
distance between the centerlines gives the error: with e(h) = C h^p, a companion that is q times
finer is at the distance D = e(h) - e(h/q), so e(h) = D q^p / (q^p - 1).

In time p is the order of the method. In space p = 2: the largest errors come from loads between
knots, which are of second order, and from a coarse mesh beside a clamp. Where the spline does
better (a wire on pinned ends) the estimate is too large, at most 1.8 times. Compared with runs with
three or four times as many spans it was 0.8 to 1.8 times the true error, in twenty runs of the
shipped scenes with 5 to 25 control points. A coarser companion would take half the time but was off
by factors from 0.3 to 6: with so few spans the error does not follow the power of h yet.

A grasp that holds the direction of the cable makes the curvature jump where there is no knot. There
p = 1, and the error depends on where in its span the grasp is, which a companion with 1.5 times the
spans often shares: of 80 estimates of four such cables at rest with 21 to 78 control points, 21
were less than half the true error, the least a ninth. With three times the spans they are 0.7 to
2.4 times the true error; the companion then takes twice as long.

Explicit steps at the stability limit are often far shorter than accuracy needs. Halving them would
be most of the cost for no information: with a step of 13 us the shipped paper scenes err by 5e-6 m
in time and by 3e-3 m in space. In such a case only the companion in space runs. Its step is shorter
too, for stability, so its distance includes the error in time.

Of several equilibria the companions begin in that of the original. Where symmetry leaves open to
which side a cable falls, all fall to the same one (`buckling`, `Simulator.notes`): what the side
does to the shape is no error of the discretisation.

The estimate is the error of the run so far, not of one step: the phase errors of an undamped cable
accumulate, and the estimate grows with them. It excludes errors of the quadrature and of the model.
"""

from __future__ import annotations

import math
import time
from collections import deque
from collections.abc import Callable
from concurrent.futures import Future, ThreadPoolExecutor
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from dlo_sim.core import bspline
from dlo_sim.core.methods import IMPLICIT, METHODS
from dlo_sim.scene.description import Scene
from dlo_sim.scene.loading import SceneError
from dlo_sim.scene.needs import needs_of
from dlo_sim.simulation.report import DiscretizationError, Report
from dlo_sim.simulation.resolution import MOST_CONTROL_POINTS, raised
from dlo_sim.simulation.selection import SAFETY, accurate_step
from dlo_sim.simulation.simulator import Simulator
from dlo_sim.simulation.timeline import Change

Array = NDArray[np.float64]

PARTS = "time", "space"  # of the error
POINTS = 20  # of the centerline, equally spaced in u, that are compared
LOOK = 0.02  # [s] of simulated time between two comparisons
MOST_BEHIND = 2.0  # [s] of simulated time by which companions may be behind the simulator
TOGETHER = 32  # comparisons and changes for which a thread is woken: switching to it takes 50 us
WINDOW = 1.0  # [s] whose largest error is the recent one
TIME_FACTOR = 2  # refinement of the companions
SPACE_FACTOR = 1.5
SPACE_FACTOR_OFF_KNOTS = 3.0  # where a grasp holds the direction of the cable
SHORT = 0.1  # of the accurate step; below it the time error is below 1 % of accuracy.target
# EA h^2 / EI of a knot span h above which stretching by span was more accurate for strongly bent
# cables (cantilever of the work-precision study: 225 to 3600).
THIN = 200.0
SMALL = 0.25  # of the target: a part of the error below it can stay as it is
# Of the length: error from which the finer runs have gone other ways, so that it does not follow
# the powers of step and span. Of eleven swings and falls below it, the advised settings met the
# target in seven and left 1.2 to 4.7 times it in four; an error of 3 lengths led to 1081 points
# where a difference of 1e-9 m grows to 1 mm in 3.4 s.
LOST = 0.5
_SPARE = 1.2  # safety factor of the advice, so that the error ends up below the target
# The same for where in its span a grasp is: errors with the grasp on a knot were 1.3 to 1.7 times
# those with it amid a span, for equal spans.
_UNEVEN = 1.7

_Place = Callable[[Scene], Simulator]
_Change = Callable[[Simulator], object]


class _Finer(NamedTuple):
    """A finer run of a scene.

    Attributes:
        scene: what it simulates. per_step: its steps per step of the original.
        gain: ratio of the error of the original to its own.
    """

    scene: Scene
    per_step: int
    gain: float

    @property
    def factor(self) -> float:
        """Ratio of the error of the original to its distance from the finer run."""
        return self.gain / (self.gain - 1.0)


class ErrorEstimate:
    """A simulator whose changes its two companions repeat, and a watcher of its run (`play`).

    Args:
        simulator: its error is estimated; from now on it is followed until `end`.
        place: builds a companion from its scene; the default begins in the simulator's equilibrium.

    Attributes:
        simulator: see above. order: of convergence in time.
        waits: whether who reads errors waits for the companions, so that they are those of the
            present (the default); else, live, they are the latest known, and companions that fall
            too far behind are given up.
    """

    def __init__(self, simulator: Simulator, place: _Place | None = None) -> None:
        self.simulator, self.waits = simulator, True
        place = place or _placing(simulator)
        self._begun = simulator.steps
        self.order = _order_in_time(simulator)
        self._look = max(1, round(LOOK / simulator.step))
        kept = max(1, round(WINDOW / (self._look * simulator.step)))
        self._finer = tuple(_Companion(simulator, part, place, kept) for part in PARTS)
        self._shares = np.linspace(0.0, 1.0, POINTS)
        simulator.follower = self._repeat
        self._compare()

    @classmethod
    def continued(cls, simulator: Simulator) -> ErrorEstimate:
        """An estimate whose companions start from the present shape, motion and ends of a
        simulator, with its motions; earlier errors do not count. The caller sets loads again.
        """
        return cls(simulator, simulator.reconfigured)

    def take_over(self) -> None:
        """Restart the companions from the present state of the simulator."""
        self._begun = self.simulator.steps
        for companion in self._finer:
            companion.take_over(self.simulator)
        self._compare()

    @property
    def companions(self) -> tuple[_Companion, ...]:
        """The finer runs, in time and in space, at the present time if errors are waited for."""
        if self.waits:
            for companion in self._finer:
                if companion.behind(self._steps):
                    companion.change(self._steps, lambda _: None)
                companion.follow(fewest=1)
            for companion in self._finer:
                companion.wait()
        return self._finer

    @property
    def seconds(self) -> float:
        """Processor time spent on the companions so far [s]."""
        return sum(companion.seconds for companion in self._finer)

    @property
    def recent(self) -> DiscretizationError:
        """The largest error of the last second."""
        in_time, in_space = (companion.recent for companion in self.companions)
        return DiscretizationError(in_time, in_space, self._failure)

    @property
    def largest(self) -> DiscretizationError:
        """The largest error of the run."""
        in_time, in_space = (companion.largest for companion in self.companions)
        since = min(companion.since for companion in self._finer) + self._begun
        return DiscretizationError(in_time, in_space, self._failure, since * self.simulator.step)

    def advice(self, error: DiscretizationError) -> str:
        """An error that exceeds accuracy.target, and what cures it, one line; else empty."""
        simulator, needed, stiffness = self.simulator, 0, 0.0
        if error.total > simulator.scene.accuracy.target:  # contacts take long to compute
            needed = simulator.control_points_needed
            stiffness = simulator.contact_stiffness_needed
        given = simulator.scene, simulator.method, simulator.step, self.order
        return advice(*given, error, needed, stiffness)

    def end(self) -> None:
        """Follow the simulator no longer."""
        self.simulator.follower = None

    def next_look(self, steps: int) -> int:
        """The next step at which it compares."""
        return steps + self._look - steps % self._look

    def look(self, report: Report) -> str:
        """Give the companions the present shape to compare with, where it is time to."""
        if report.status.advanced and report.steps and self.simulator.steps % self._look == 0:
            self._compare()
        return ""

    @property
    def _failure(self) -> str:
        return next((one.failure for one in self._finer if one.failure), "")

    @property
    def _steps(self) -> int:
        """Steps of the simulator since its companions began."""
        return self.simulator.steps - self._begun

    def _repeat(self, change: Change) -> None:
        """Let the companions repeat a change of the simulator when they are at this time."""
        began = self._begun * self.simulator.step
        for companion in self._finer:
            companion.change(self._steps, lambda one: change.repeat(one, began))

    def _compare(self) -> None:
        points, steps = self.simulator.outline(self._shares), self._steps
        for companion in self._finer:
            companion.compare(steps, points, self._shares)
            companion.follow()
            if companion.behind(steps) > self._most_behind:
                if self.waits:
                    companion.wait()
                else:
                    companion.give_up()

    @property
    def _most_behind(self) -> int:
        """Steps by which a companion may be behind."""
        return round(MOST_BEHIND / self.simulator.step)


def error_along(
    simulator: Simulator,
    places: Array,
    predicted: Callable[[Scene], Array],
    needed: int = 0,
    stiffness: float = 0.0,
) -> tuple[DiscretizationError, str]:
    """Error of a prediction that finer simulators of the same kind can repeat, and the advice.

    Args:
        simulator: that predicted; its method is implicit.
        places: predicted places [m], shape (T, K, 3).
        predicted: makes the same prediction with another scene; shorter if it failed.
        needed, stiffness: as for `advice`.
    """
    found, unknown = {"time": 0.0, "space": 0.0}, ""
    for part in PARTS:
        try:
            if finer := _finer(simulator, part, Simulator):
                other = predicted(finer.scene)
                if len(other) < len(places):
                    raise SceneError("it failed")
                gaps = np.linalg.norm(other[: len(places)] - places, axis=-1)
                found[part] = finer.factor * float(gaps.max(initial=0.0))
        except SceneError as refusal:
            found[part] = math.inf
            unknown = unknown or f"no finer run to compare with: {refusal}"
    error, order = DiscretizationError(**found, unknown=unknown), _order_in_time(simulator)
    given = simulator.scene, simulator.method, simulator.step, order
    return error, advice(*given, error, needed, stiffness)


class _Companion:
    """One finer simulator, which a thread of its own advances, and the errors estimated from its
    distance.

    Attributes:
        simulator: None if none is needed or possible; it is at rest between `wait` and `follow`.
        failure: why it is impossible, or why it stopped; empty otherwise.
        largest: largest error [m] so far; infinite after a failure. since: step of the original
            from which its error is more than half of accuracy.target; infinite if it never was.
        seconds: processor time of the thread so far [s].
    """

    def __init__(self, original: Simulator, part: str, place: _Place, kept: int) -> None:
        self.simulator: Simulator | None = None
        self.failure, self.largest, self.seconds, self.since = "", 0.0, 0.0, math.inf
        self._errors: deque[float] = deque(maxlen=kept)
        self._log: list[tuple[int, _Change]] = []  # to be done after these steps
        self._reached = 0  # step of the original up to which it has followed
        self._thread = ThreadPoolExecutor(1, f"error in {part}")
        self._work: deque[Future[None]] = deque()
        try:
            if finer := _finer(original, part, place):
                self.simulator = place(finer.scene)
                self._per_step, self._factor = finer.per_step, finer.factor
        except SceneError as refusal:
            self._fail(f"no finer run to compare with: {refusal}")

    @property
    def recent(self) -> float:
        """Largest error [m] of the last WINDOW; infinite after a failure."""
        return math.inf if self.failure else max(tuple(self._errors), default=0.0)

    def change(self, steps: int, change: _Change) -> None:
        """Make a change when it is at the time of the original after these steps."""
        if self.simulator is not None and not self.failure:
            self._log.append((steps, change))

    def compare(self, steps: int, points: Array, shares: Array) -> None:
        """Estimate the error from the distance to the original's `outline` at these shares after
        these steps.
        """

        def estimate(simulator: Simulator) -> None:
            gap = simulator.outline(shares) - points
            error = self._factor * math.sqrt(float(np.einsum("ij,ij->i", gap, gap).max()))
            self._errors.append(error)
            if error > 0.5 * simulator.scene.accuracy.target:
                self.since = min(self.since, steps)
            self.largest = max(self.largest, error)

        self.change(steps, estimate)

    def follow(self, fewest: int = TOGETHER) -> None:
        """Let the thread do what is logged, unless there is too little."""
        while self._work and self._work[0].done():
            self._work.popleft().result()
        if len(self._log) >= fewest:
            self._work.append(self._thread.submit(self._do_all, self._log))
            self._log = []

    def wait(self) -> None:
        """Until it has done all that is logged."""
        self.follow(fewest=1)
        while self._work:
            self._work.popleft().result()

    def behind(self, steps: int) -> int:
        """By how many steps of the original it is behind the time after these steps."""
        stopped = self.simulator is None or self.failure
        return 0 if stopped else steps - self._reached

    def give_up(self) -> None:
        """Stop, since it is too far behind."""
        self._log.clear()
        self._fail(f"the finer run is more than {MOST_BEHIND:g} s behind")

    def take_over(self, original: Simulator) -> None:
        """Start from the present state of the original."""
        self._forget()
        if self.simulator is not None:
            self.simulator.take_over(original)

    def _do_all(self, logged: list[tuple[int, _Change]]) -> None:
        began = time.thread_time()
        for at, change in logged:
            if self.simulator is not None and not self.failure:
                self._do(self.simulator, at, change)
                self._reached = at
        self.seconds += time.thread_time() - began

    def _do(self, simulator: Simulator, at: int, change: _Change) -> None:
        """Make a change at the time of the original after so many steps."""
        try:
            report = simulator.advance_steps(at * self._per_step - simulator.steps)
            if report.status.advanced:
                change(simulator)
            else:
                self._fail(f"the finer run failed: {report.message}")
        except ValueError as refusal:
            self._fail(f"the finer run failed: {refusal}")

    def _forget(self) -> None:
        self._log.clear()
        self.wait()
        if self.simulator is not None:
            self.failure, self.largest, self._reached, self.since = "", 0.0, 0, math.inf
        self._errors.clear()

    def _fail(self, reason: str) -> None:
        self.failure, self.largest = reason, math.inf


def _placing(simulator: Simulator) -> _Place:
    """What builds companions that begin in the equilibrium of a simulator that has not advanced."""
    poses = {
        name: simulator.end_pose(name) for name in simulator.scene.holders | simulator.scene.moved
    }

    def place(scene: Scene) -> Simulator:
        if scene.discretization != simulator.scene.discretization:
            return Simulator(scene, poses, near=simulator)
        return simulator.reconfigured(scene)

    return place


def _finer(original: Simulator, part: str, place: _Place) -> _Finer | None:
    """The finer run for a part of the error. None in time for explicit steps so short that their
    error is negligible.

    The method is that of the original, fixed even where its scene has `auto`. In space, an explicit
    method takes as many more steps as stability requires.

    Raises:
        SceneError: finer spans are not possible.
    """
    scene, step, explicit = original.scene, original.step, original.choice.method.family != IMPLICIT
    values: dict[str, object] = {"integrator.method": original.method, "integrator.step": step}
    if part == "time":
        if explicit and step < SHORT * accurate_step(scene)[0]:
            return None
        finer = scene.with_values(values | {"integrator.step": step / TIME_FACTOR})
        return _Finer(finer, TIME_FACTOR, float(TIME_FACTOR) ** _order_in_time(original))
    choice, per_step = scene.discretization, 1
    spans = choice.control_points - bspline.DEGREE
    factor = SPACE_FACTOR_OFF_KNOTS if _bent_off_knots(scene) else SPACE_FACTOR
    finer_spans = min(math.ceil(factor * spans), MOST_CONTROL_POINTS - bspline.DEGREE)
    if finer_spans <= spans:
        raise SceneError(f"discretization.control_points: {choice.control_points} is the most")
    for strand in scene.strands:
        own = strand.scene.discretization.control_points - bspline.DEGREE
        key = strand.key_of("discretization.control_points")
        values[key] = math.ceil(own * finer_spans / spans) + bspline.DEGREE
    if choice.quadrature == "uniform":
        values["discretization.samples"] = max(choice.samples, 2 * finer_spans)
    if explicit:
        limit = place(scene.with_values(values | {"integrator.step": 0.0})).choice.limit
        per_step = math.ceil(step / (SAFETY * limit) - 1e-6)
        values["integrator.step"] = step / per_step
    return _Finer(scene.with_values(values), per_step, (finer_spans / spans) ** _space_order(scene))


def _order_in_time(simulator: Simulator) -> int:
    """The order of the method, or 1 for plastic bending with an explicit method."""
    method = simulator.choice.method
    stepwise = simulator.scene.is_plastic and method.family != IMPLICIT
    return 1 if stepwise else method.order


def _bent_off_knots(scene: Scene) -> bool:
    """Whether a grasp holds the direction of the cable, now or when it is taken.

    The curvature jumps at such a grasp, which is usually no knot: the error decreases with the
    first power of the span, and unevenly, by where in its span the grasp is.
    """
    return any(grasp.holds_direction for grasp in scene.grasps)


def _space_order(scene: Scene) -> int:
    """Order of convergence in the number of spans."""
    return 1 if _bent_off_knots(scene) else 2


def advice(
    scene: Scene,
    method: str,
    step: float,
    order: int,
    error: DiscretizationError,
    needed: int = 0,
    stiffness: float = 0.0,
) -> str:
    """An estimated error that exceeds the target, and settings that would do, one line; else empty.

    Args:
        scene: as it was simulated. method, step: with this method and this step [s].
        order: of convergence in time.
        needed: control points below which the error does not follow that order yet, since the cable
            bends within a knot span (`Simulator.control_points_needed`); 0 if there are enough.
        stiffness: of contact (`Simulator.contact_stiffness_needed`); 0 if it is stiff enough.
    """
    target = scene.accuracy.target
    if error.unknown:
        return f"the position error is unknown: {error.unknown}"
    if error.total <= target:
        return ""
    if not math.isfinite(error.total):
        return "the position error is too large to be estimated; shorten integrator.step"
    since = f" from {error.since:.3g} s on" if 0.0 < error.since < math.inf else ""
    said = f"position error of some {error.total:.2g} m exceeds accuracy.target {target:g} m{since}"
    length = max(strand.scene.cable.length for strand in scene.strands)
    if error.total > LOST * length and not needed:
        return (
            f"{said}; finer runs have gone other ways, as where a motion amplifies any difference: "
            "no settings are known that keep the target to the end"
        )
    smaller = min(error.time, error.space)
    allowed = (target - smaller if smaller < SMALL * target else 0.5 * target) / _SPARE
    cures, finer = (
        [],
        (needed - bspline.DEGREE) / (scene.discretization.control_points - bspline.DEGREE),
    )
    if error.space > allowed:
        uneven = _UNEVEN if _bent_off_knots(scene) else 1.0
        finer = max(finer, (uneven * error.space / allowed) ** (1.0 / _space_order(scene)))
    if finer > 1.0:
        cures.append(_cure_in_space(scene, method, finer))
    if error.time > allowed:
        shorter = step / (error.time / allowed) ** (1.0 / order)
        cures.append(f"lower integrator.step to {_rounded_down(shorter):g} s")
    if stiffness:
        cures.append(f"raise contact.stiffness to {stiffness:.2g}")
    if error.time < error.space:
        cures[0] += "; discretization.stretch: span may do as well, since the cable is thin" * (
            _locks(scene) and len(cures) == 1
        )
    most = "space" if error.space >= error.time else "time"
    return f"{said}, mostly of {most}; {' and '.join(cures)}"


def _cure_in_space(scene: Scene, method: str, finer: float) -> str:
    """The change of the scene by which spans are so many times shorter."""
    choice = scene.discretization
    spans = (choice.control_points - bspline.DEGREE) * finer
    number = math.ceil(spans - 1e-6) + bspline.DEGREE
    if number > MOST_CONTROL_POINTS:
        return (
            f"raise accuracy.target, since {number} control points would be needed and "
            f"{MOST_CONTROL_POINTS} are the most"
        )
    return raised(scene, number, METHODS[method].family == IMPLICIT)


def _rounded_down(step: float) -> float:
    """With two digits."""
    digit = 10.0 ** (math.floor(math.log10(step)) - 1)
    return math.floor(step / digit + 1e-9) * digit


def _locks(scene: Scene) -> bool:
    """Whether the cable is so thin for its spans that stretching at every sample may keep it from
    bending freely (locking), and discretization.stretch can be set to span.
    """
    needs, cable = needs_of(scene), scene.cable
    span = cable.length / max(scene.discretization.control_points - 3, 1)
    thin = "stretch" in needs and "bend" in needs and cable.EA * span**2 > THIN * cable.EI
    if not thin or scene.discretization.stretch_by_span:
        return False
    try:
        scene.with_values({"discretization.stretch": "span"})
    except SceneError:
        return False
    return True
