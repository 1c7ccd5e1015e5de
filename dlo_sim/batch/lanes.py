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
from dlo_sim.simulation.arrays import Table, from_blocks, line_view, new_shape, rooms
from dlo_sim.simulation.model import Model
from dlo_sim.simulation.report import Status
from dlo_sim.simulation.simulator import Simulator
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
    stack = _Stack([*lanes, *[lanes[-1]] * (LANES - len(lanes))], times)
    method = METHODS[lanes[0].method]
    advance_splitting(
        (stack.shape, stack.model, stack.inputs, stack.state, stack.scratch),
        engine_of(stack.shape[layout.TERMS]).code,
        *(np.array(method.drift_weights), np.array(method.kick_weights)),
        *(0, max(1, int(np.ceil(duration / step - 1e-9))), step, GUARD_STEPS),
        (times, stack.samples.ravel(), stack.energies.ravel(), stack.marks),
    )
    return [stack.run(lane, k, step) for k, lane in enumerate(lanes)]


class _Stack:
    """The arrays of eight cables side by side, and a recorder that holds their start."""

    def __init__(self, lanes: Sequence[Lane], times: Array) -> None:
        one = lanes[0].model.shape
        self._narrow = lanes[0].model.counts
        self._wide = replace(self._narrow, stride=LANES)
        self._one = one
        shape, self._sizes = new_shape(self._wide, lanes[0].model.axes, {})
        tables = slice(layout.POINT_TABLE, layout.LOAD_TABLE + 1)
        shape[tables] = one[tables]
        self.shape: Table = np.concatenate((shape, one[layout.TABLES_START :]))
        self.model = self._stacked("model", [lane.model.values for lane in lanes])
        self.inputs = self._stacked("inputs", [lane.inputs for lane in lanes])
        self.state = self._stacked("state", [lane.state for lane in lanes])
        self.scratch = np.zeros(self._sizes["scratch"])
        self._keep_start()
        self.times = times
        self.samples = np.zeros((len(times), self._wide.size))
        self.samples[0] = self._at(self.state, layout.X, self._wide.size)
        self.energies = np.zeros((len(times), LANES))
        self.energies[0] = self._ledger[layout.ENERGY_START]
        self.marks = np.array([1, len(times)])

    @property
    def _ledger(self) -> Array:
        size = layout.LEDGER_ROWS * LANES
        return self._at(self.state, layout.LEDGER, size).reshape(-1, LANES)

    def _at(self, array: Array, offset: int, size: int) -> Array:
        at = int(self.shape[offset])
        return array[at : at + size]

    def _stacked(self, name: str, arrays: Sequence[Array]) -> Array:
        """An array of all cables from those of each."""
        whole = np.zeros(self._sizes[name])
        narrow, wide = rooms(self._narrow)[name], rooms(self._wide)[name]
        for offset, size in narrow.items():
            start, room = int(self._one[offset]), self._at(whole, offset, wide[offset])
            parts = [array[start : start + size] for array in arrays]
            if not len(room):
                continue
            if offset in _SHARED:
                room[:] = parts[0]
            elif offset in _LINES:
                self._view(room)[:] = np.stack([self._lines(part) for part in parts], axis=-1)
            elif offset in _BLOCKS and size:
                spans = [from_blocks(part, self._narrow.n - bspline.DEGREE) for part in parts]
                room[:] = np.stack(spans, axis=-1).ravel()
            else:
                room[:] = np.stack([part[::LANES] for part in parts], axis=-1).ravel()
        return whole

    def _lines(self, part: Array) -> Array:
        return line_view(self._one, part, 0, len(part) // self._narrow.line)

    def _view(self, lines: Array) -> Array:
        """Lines of all cables without margins, shape (lines, n, LANES), a view."""
        n = self._wide.n
        by_points = lines.reshape(-1, self._wide.line // LANES, LANES)
        return by_points[:, layout.MARGIN : layout.MARGIN + n]

    def _keep_start(self) -> None:
        """The start is the last good state so far."""
        size = self._wide.size
        good = self._at(self.scratch, GOOD, 2 * size + GOOD_ROWS * LANES)
        good[:size] = self._at(self.state, layout.X, size)
        good[size : 2 * size] = self._at(self.state, layout.W, size)
        rows = good[2 * size :].reshape(GOOD_ROWS, LANES)
        counted = (layout.ENERGY_ERROR, layout.EXCHANGED, layout.FLOOR)
        rows[GOOD_LEDGER:] = self._ledger[list(counted)]

    def run(self, lane: Lane, k: int, step: float) -> Run:
        """The run of lane k. Samples after its last sane state are that state again."""
        size = self._wide.size
        kept = self._at(self.scratch, GOOD, 2 * size + GOOD_ROWS * LANES)
        rows = kept[2 * size :].reshape(GOOD_ROWS, LANES)[:, k]
        failed, simulated = int(rows[FAILED_STEP]), float(rows[GOOD_STEP] * step)
        reached = np.searchsorted(self.times, simulated + 1e-9 * step, side="right")
        good = min(int(self.marks[0]), int(reached))
        samples, count = self.samples, len(self.times)
        lines = self._view(samples.ravel())[..., k].reshape(count, -1, self._wide.n)
        lines[good:] = self._view(kept[:size])[..., k]
        energy = self.energies[:, k].copy()
        energy[good:] = energy[good - 1]
        error, exchanged, floor = rows[GOOD_LEDGER:]
        status = Status.DIVERGED if failed else Status.OK
        method = f"method {lane.method}, step {step:g} s"
        return Run(
            control_points=lane.model.to_columns(lines),
            energy=energy,
            good=good,
            energy_error=float(error / max(exchanged, floor)),
            status=status,
            message=f"{status.value} (at {failed * step:.6g} s; {method})" if failed else "",
            method=lane.method,
            step=step,
            simulated=simulated,
            one_by_one="",
        )
