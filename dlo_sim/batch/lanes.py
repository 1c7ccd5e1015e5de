"""Which scenes go to the vector lanes, eight at a time, and their stacks of arrays.

`kernels.batch_splitting` steps `layout.LANES` cables of one structure together. What it cannot do
is computed one by one; `reason_against` is the one place that decides.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from dlo_sim.core.methods import METHODS, SPLITTING
from dlo_sim.kernels import layout
from dlo_sim.kernels.batch_layout import (
    PARTS,
    LaneLoads,
    LaneSpanStretch,
    LaneSprings,
    Stack,
    StackRecorder,
    StackState,
    StackWork,
)
from dlo_sim.kernels.batch_splitting import advance_stack
from dlo_sim.simulation.model import Model
from dlo_sim.simulation.report import Status
from dlo_sim.simulation.simulator import Simulator
from dlo_sim.simulation.stepper import GUARD_STEPS

Array = NDArray[np.float64]
LANES = layout.LANES
_OTHER_TERMS = {
    "rest": "natural curvature",
    "twist": "twist",
    "frenet": "Frenet torsion",
    "plastic": "plasticity",
    "drive": "driven ends",
}


@dataclass(frozen=True)
class Lane:
    """One scene ready for a lane: its arrays, its state at the start, method and step.

    given_step: integrator.step, 0 where the step was chosen.
    """

    model: Model
    state: layout.State
    method: str
    step: float
    given_step: float

    @property
    def structure(self) -> tuple[object, ...]:
        """What all lanes of a stack have in common."""
        terms = self.model.terms
        present = tuple(field is not None for field in terms)
        loads = 0 if terms.loads is None else len(terms.loads.first)
        samples = terms.lattice.xi.tobytes()
        return (
            self.method,
            self.given_step,
            self.model.n,
            terms.axes,
            present,
            loads,
            terms.lattice.xi.shape,
            samples,
        )


@dataclass(frozen=True)
class Run:
    """What came of one scene.

    Attributes:
        control_points: at the samples, shape (T, n_u, 4); energy [J], shape (T,). After a failure
            the last good state is repeated.
        good: samples that are not repetitions.
        energy_error: see `Simulator.energy_error`. status, message, method, step [s], simulated [s]
            as in a report. one_by_one: why the scene was not on a vector lane, empty if it was.
    """

    control_points: Array
    energy: Array
    good: int
    energy_error: float
    status: Status
    message: str
    method: str
    step: float
    simulated: float
    one_by_one: str


def reason_against(simulator: Simulator) -> str:
    """Why a scene cannot be on a vector lane; empty if it can."""
    method = simulator.choice.method
    if method.family != SPLITTING:
        return f"method {method.name}"
    terms = simulator.model.terms
    for name, words in _OTHER_TERMS.items():
        if getattr(terms, name) is not None:
            return words
    if terms.loads is not None and terms.loads.torque.any():
        return "loads with a torque"
    return ""


def new_lane(simulator: Simulator) -> Lane:
    """The lane of a simulator at its start."""
    return Lane(
        simulator.model,
        simulator.state,
        simulator.method,
        simulator.step,
        simulator.scene.integrator.step,
    )


def run_lanes(lanes: Sequence[Lane], step: float, duration: float, times: Array) -> list[Run]:
    """Run up to LANES scenes of one structure in one stack.

    Args:
        step: of all lanes [s]. duration: [s], covered by whole steps. times: of the samples [s],
            rising, the first one 0.
    """
    full = [*lanes, *[lanes[-1]] * (LANES - len(lanes))]
    stack, state, work = _stack(full, step), _state(full), _work(full[0])
    recorder = _recorder(state, len(times), times)
    recorder.energies[0] = state.ledger[layout.ENERGY_START]
    method = METHODS[lanes[0].method]
    steps = max(1, int(np.ceil(duration / step - 1e-9)))
    advance_stack(
        state,
        stack,
        work,
        np.array(method.drift_weights),
        np.array(method.kick_weights),
        0,
        steps,
        step,
        GUARD_STEPS,
        recorder,
    )
    return [_result(lane, k, step, state, recorder) for k, lane in enumerate(lanes)]


def _side_by_side(arrays: Sequence[Array]) -> Array:
    """Arrays (dim, ..., n) of all lanes as (n, ..., dim LANES)."""
    stacked = np.moveaxis(np.stack(arrays, axis=-1), 0, -2)
    rows = np.moveaxis(stacked, -3, 0)
    return np.ascontiguousarray(rows.reshape(*rows.shape[:-2], -1))


def _of_lane(rows: Array, dim: int, k: int) -> Array:
    """(..., n, dim LANES) of all lanes -> (..., dim, n) of lane k."""
    apart = rows.reshape(*rows.shape[:-1], dim, LANES)[..., k]
    return np.ascontiguousarray(np.swapaxes(apart, -1, -2))


def _stack(lanes: Sequence[Lane], step: float) -> Stack:
    every = [lane.model.terms for lane in lanes]
    one = every[0]
    n, dim = one.lattice.n, len(one.axes)
    spans = n - 3
    lower = _side_by_side([terms.mass.lower for terms in every])
    upper = np.zeros_like(lower)
    for k in range(1, 4):
        upper[: n - k, k - 1] = lower[k:, k - 1]
    weights = [_by_spans(terms.lattice.weights, spans) for terms in every]
    gravity = [terms.gravity for terms in every if terms.gravity is not None]
    decay = [terms.decay for terms in every if terms.decay is not None]
    return Stack(
        xi=_by_spans(one.lattice.xi, spans),
        weights=np.ascontiguousarray(np.stack(weights, axis=-1)),
        extraction=_by_spans(one.lattice.extraction, spans) / one.lattice.slope,
        slope=np.tile([terms.lattice.slope for terms in every], dim),
        band=_side_by_side([terms.mass.band for terms in every]),
        lower=lower,
        upper=upper,
        inverse_diagonal=_side_by_side([terms.mass.inverse_diagonal for terms in every]),
        stretch=_values([term and term.stiffness for term in (t.stretch for t in every)]),
        span_stretch=_span_stretch(every),
        bend=_values([term and term.stiffness for term in (t.bend for t in every)]),
        gravity=_side_by_side(gravity) if gravity else None,
        springs=_springs(every),
        loads=_loads(every),
        keep=np.exp(-0.5 * step * np.stack(decay, axis=-1)).ravel() if decay else None,
        axes=one.axes,
    )


def _values(values: Sequence[float | None]) -> Array | None:
    return None if values[0] is None else np.array(values, dtype=float)


def _by_spans(blocks: Array, spans: int) -> Array:
    """(blocks, rows, LANES) of one cable, whose lanes are spans, as (spans, rows)."""
    rows = blocks.transpose(0, 2, 1).reshape(-1, blocks.shape[1])
    return np.ascontiguousarray(rows[:spans])


def _span_stretch(every: Sequence[layout.Terms]) -> LaneSpanStretch | None:
    means = [terms.span_stretch for terms in every if terms.span_stretch is not None]
    if not means:
        return None
    linear = means[0].linear.reshape(-1)[: every[0].lattice.n - 3]
    stiffness = np.array([term.stiffness for term in means])
    return LaneSpanStretch(stiffness, linear.copy(), np.zeros(2 * LANES))


def _springs(every: Sequence[layout.Terms]) -> LaneSprings | None:
    springs = [terms.springs for terms in every if terms.springs is not None]
    if not springs:
        return None
    return LaneSprings(
        _side_by_side([spring.stiffness.T for spring in springs]),
        _side_by_side([spring.anchor.T for spring in springs]),
    )


def _loads(every: Sequence[layout.Terms]) -> LaneLoads | None:
    """Each load spread on the control points, so that lanes may have it at different places."""
    loads = [terms.loads for terms in every if terms.loads is not None]
    if not loads:
        return None
    n, dim = every[0].lattice.n, len(every[0].axes)
    spread = np.zeros((len(loads[0].first), n, dim, len(loads)))
    for lane, load in enumerate(loads):
        for k, first in enumerate(load.first):
            spread[k, first : first + 4, :, lane] = np.outer(load.basis[k], load.force[k])
    frequency = np.stack([load.frequency for load in loads], axis=-1)
    return LaneLoads(spread.reshape(*spread.shape[:2], -1), np.ascontiguousarray(frequency))


def _state(lanes: Sequence[Lane]) -> StackState:
    n = lanes[0].model.n
    position = _side_by_side([lane.state.position[:, :n] for lane in lanes])
    w = _side_by_side([lane.state.w[:, :n] for lane in lanes])
    return StackState(
        position=position,
        w=w,
        good_position=position.copy(),
        good_w=w.copy(),
        good_step=np.zeros(LANES, dtype=np.int64),
        failed_step=np.full(LANES, -1, dtype=np.int64),
        ledger=np.ascontiguousarray(np.stack([lane.state.ledger for lane in lanes], axis=-1)),
        booked=np.zeros(1, dtype=np.int64),
    )


def _work(lane: Lane) -> StackWork:
    width = len(lane.model.axes) * LANES
    shape = (lane.model.n, width)
    return StackWork(
        force=np.zeros(shape),
        load=np.zeros(shape),
        load_before=np.zeros(shape),
        before=np.zeros(shape),
        coefficients=np.zeros(3 * width),
        gradient=np.zeros(3 * width),
        chain=np.zeros((3, width)),
        sums=np.zeros((2, width)),
        parts=np.zeros((PARTS, LANES)),
    )


def _recorder(state: StackState, count: int, times: Array) -> StackRecorder:
    """Room for the samples; the first is the present state."""
    recorder = StackRecorder(
        times=times,
        positions=np.zeros((count, *state.position.shape)),
        energies=np.zeros((count, LANES)),
        next=np.ones(1, dtype=np.int64),
        before=np.zeros_like(state.position),
        before_w=np.zeros_like(state.w),
    )
    recorder.positions[0] = state.position
    return recorder


def _result(
    lane: Lane,
    k: int,
    step: float,
    state: StackState,
    recorder: StackRecorder,
) -> Run:
    """The run of lane k. Samples after its last sane state are that state again."""
    failed = int(state.failed_step[k])
    simulated = float(state.good_step[k] * step)
    reached = simulated + 1e-9 * step
    good = min(int(recorder.next[0]), int(np.searchsorted(recorder.times, reached, side="right")))
    dim = len(lane.model.axes)
    rows = _of_lane(recorder.positions, dim, k)
    rows[good:] = _of_lane(state.good_position, dim, k)
    energy = recorder.energies[:, k].copy()
    energy[good:] = energy[good - 1]
    ledger = state.ledger[:, k]
    status = Status.OK if failed < 0 else Status.DIVERGED
    return Run(
        control_points=lane.model.to_columns(rows),
        energy=energy,
        good=good,
        energy_error=float(
            ledger[layout.ENERGY_ERROR] / max(ledger[layout.EXCHANGED], ledger[layout.FLOOR])
        ),
        status=status,
        message=""
        if failed < 0
        else f"{status.value} (at {failed * step:.6g} s; method {lane.method}, step {step:g} s)",
        method=lane.method,
        step=step,
        simulated=simulated,
        one_by_one="",
    )
