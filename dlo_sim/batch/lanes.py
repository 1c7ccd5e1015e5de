"""Which scenes go to the vector lanes, eight at a time, and their stacks of arrays.

The loop of the drift/kick methods steps LANES cables of one structure together: the same code whose
lanes are the spans of one cable. What it cannot do is computed one by one; `reason_against` is the
one place that decides.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from dlo_sim.compiling.lanes import LANES
from dlo_sim.core import bspline
from dlo_sim.core.methods import METHODS, SPLITTING
from dlo_sim.engine import layout
from dlo_sim.engine.grasps import ACTIVE
from dlo_sim.methods.explicit_layout import FAILED_STEP, GOOD, GOOD_LEDGER, GOOD_ROWS, GOOD_STEP
from dlo_sim.methods.splitting import advance_splitting, engine_of
from dlo_sim.simulation.arrays import aligned_zeros, from_blocks, new_shape, rooms
from dlo_sim.simulation.cable import Cable
from dlo_sim.simulation.model import Model
from dlo_sim.simulation.recorder import Recorder
from dlo_sim.simulation.report import Status, explained
from dlo_sim.simulation.simulator import Simulator
from dlo_sim.simulation.soundness import unexplained_stretch
from dlo_sim.simulation.stepper import GUARD_STEPS

Array = NDArray[np.float64]
_OTHER_TERMS = {
    layout.TWISTED: "twist",
    layout.TORSION: "Frenet torsion",
    layout.PLASTICITY: "plasticity",
    layout.CONTACT: "contact",
}
# How the rooms of the arrays are laid out (`engine.layout`); all others are rows.
_LINES = (
    *(layout.MASS, layout.FACTORS, layout.WEIGHT, layout.TWIST, layout.VISCOUS),
    *(layout.HELD_SHIFT, layout.LOAD_BASIS),
    *(layout.X, layout.W, layout.HISTORY, layout.LOADED, layout.BOOKED),
)
_BLOCKS = (layout.MESH, layout.NATURAL, layout.PLASTIC)
_SHARED = (layout.MOTION,)


@dataclass(frozen=True)
class Lane:
    """One scene ready for a lane: its arrays, its state at the start, method and step.

    given_step: integrator.step, 0 where the step was chosen.
    """

    model: Model
    inputs: Array
    state: Array
    method: str
    step: float
    given_step: float

    @property
    def structure(self) -> tuple[object, ...]:
        """What all lanes of a stack have in common. Loads may be at different places."""
        shape = self.model.shape.copy()
        start = int(shape[layout.LOAD_TABLE])
        shape[start : start + int(shape[layout.LOADS])] = 0
        return (self.method, self.given_step, shape.tobytes())


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
    method, model, cable = simulator.choice.method, simulator.model, simulator.cable
    if method.family != SPLITTING:
        return f"method {method.name}"
    for bit, words in _OTHER_TERMS.items():
        if model.has(bit):
            return words
    if cable.motion[:, ACTIVE].any():
        return "driven ends"
    if cable.loads[:, 3:6].any():
        return "loads with a torque"
    return ""


def new_lane(simulator: Simulator) -> Lane:
    """The lane of a simulator at its start."""
    return Lane(
        simulator.model,
        simulator.cable.inputs.copy(),
        simulator.cable.state.copy(),
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
    cable = _stacked([*lanes, *[lanes[-1]] * (LANES - len(lanes))])
    recorder = Recorder(cable.model, times)
    recorder.put(cable, cable.ledger[layout.ENERGY_START])
    method = METHODS[lanes[0].method]
    advance_splitting(
        *(cable.arrays, engine_of(cable.terms).code),
        *(np.array(method.drift_weights), np.array(method.kick_weights)),
        *(0, max(1, int(np.ceil(duration / step - 1e-9))), step, GUARD_STEPS, recorder.arrays),
    )
    return [_run(cable, recorder, lane, k, step) for k, lane in enumerate(lanes)]


def _stacked(lanes: Sequence[Lane]) -> Cable:
    """The arrays of eight cables side by side; their start is the last good state so far."""
    one = lanes[0].model
    counts = replace(one.counts, stride=LANES)
    shape, sizes = new_shape(counts, one.axes, {})
    shape[layout.TERMS] = one.shape[layout.TERMS]
    tables = slice(layout.POINT_TABLE, layout.LOAD_TABLE + 1)
    shape[tables] = one.shape[tables]
    shape = np.concatenate((shape, one.shape[layout.TABLES_START :]))
    model = replace(one, shape=shape, sizes=sizes, counts=counts)
    values = _side_by_side(model, "model", one, [lane.model.values for lane in lanes])
    inputs = _side_by_side(model, "inputs", one, [lane.inputs for lane in lanes])
    state = _side_by_side(model, "state", one, [lane.state for lane in lanes])
    cable = Cable(replace(model, values=values), inputs, state, model.new("scratch"))
    good, rows = _good(cable)
    at = int(shape[layout.X])
    good[:] = state[at : at + good.size]  # with w, which is behind x
    counted = (layout.ENERGY_ERROR, layout.EXCHANGED, layout.FLOOR)
    rows[GOOD_LEDGER:] = cable.ledger[list(counted)]
    return cable


def _side_by_side(model: Model, name: str, one: Model, arrays: Sequence[Array]) -> Array:
    """An array of all cables from those of each, which are like `one`."""
    whole = aligned_zeros(model.sizes[name])
    wide, each = rooms(model.counts)[name], np.stack(arrays, axis=-1)
    for offset, size in rooms(one.counts)[name].items():
        at, start = int(model.shape[offset]), int(one.shape[offset])
        room, parts = whole[at : at + wide[offset]], each[start : start + size]
        if not len(room):
            continue
        if offset in _SHARED:
            room[:] = parts[:, 0]
        elif offset in _LINES:
            lines = parts.reshape(-1, one.counts.line, LANES)
            begin = layout.MARGIN
            _points(room, model)[:] = lines[:, begin : begin + one.n]
        elif offset in _BLOCKS:
            room[:] = from_blocks(parts, one.n - bspline.DEGREE).ravel()
        else:
            room[:] = parts[::LANES].ravel()
    return whole


def _points(lines: Array, model: Model) -> Array:
    """Lines of all cables without margins, shape (lines, n, LANES), a view."""
    by_points = lines.reshape(-1, model.counts.line // LANES, LANES)
    return by_points[:, layout.MARGIN : layout.MARGIN + model.n]


def _good(cable: Cable) -> tuple[Array, Array]:
    """The last good states: lines of x and w, and rows behind them; views."""
    at, size = int(cable.model.shape[GOOD]), 2 * cable.model.counts.size
    rows = cable.scratch[at + size : at + size + GOOD_ROWS * LANES]
    return cable.scratch[at : at + size], rows.reshape(GOOD_ROWS, LANES)


def _run(cable: Cable, recorder: Recorder, lane: Lane, k: int, step: float) -> Run:
    """The run of lane k. Samples after its last sane state are that state again."""
    model, (kept, rows) = cable.model, _good(cable)
    failed, simulated = int(rows[FAILED_STEP, k]), float(rows[GOOD_STEP, k] * step)
    reached = np.searchsorted(recorder.times, simulated + 1e-9 * step, side="right")
    good = min(recorder.count, int(reached))
    samples, energies = recorder.arrays[1:3]
    lines = _points(samples, model)[..., k].reshape(len(recorder.times), -1, model.n)
    lines[good:] = _points(kept[: model.counts.size], model)[..., k]
    energy = energies.reshape(-1, LANES)[:, k].copy()
    energy[good:] = energy[good - 1]
    error, exchanged, floor = rows[GOOD_LEDGER:, k]
    method = f"method {lane.method}, step {step:g} s"
    status = Status.DIVERGED
    message = f"{explained(status, METHODS[lane.method])} (at {failed * step:.6g} s; {method})"
    if not failed:
        message = unexplained_stretch(lane.model, lane.model.to_columns(lines))
        status = Status.UNRESOLVED if message else Status.OK
    return Run(
        control_points=lane.model.in_world(lane.model.to_columns(lines)),
        energy=energy,
        good=good,
        energy_error=float(error / max(exchanged, floor)),
        status=status,
        message=message,
        method=lane.method,
        step=step,
        simulated=simulated,
        one_by_one="",
    )
