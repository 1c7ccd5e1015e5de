"""Scratch and state arrays of one simulator, allocated once.

What has to be remembered before every advance lies together, so that one copy takes all of it.
"""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from dlo_sim.core import arguments
from dlo_sim.kernels import layout, tangent
from dlo_sim.simulation.model import Model

Array = NDArray[np.float64]


def new_state(model: Model) -> layout.State:
    """All-zero state."""
    shape = (model.rows, model.width)
    return layout.State(*_together(shape, shape, (3, *shape), shape, (layout.LEDGER_SIZE,)))


def memory(terms: layout.Terms, state: layout.State, work: layout.Work) -> list[Array]:
    """What a state consists of: the blocks that hold all of State, what Work carries over from step
    to step, and what changes in the terms.
    """
    kept, carried = state.position.base, work.load.base
    assert kept is not None and carried is not None, "both are parts of a block (`_together`)"
    arrays = [kept, carried]
    if terms.loads is not None:
        arrays += [terms.loads.force, terms.loads.torque, terms.loads.frequency]
    if terms.springs is not None:
        arrays.append(terms.springs.anchor)
    if terms.rest is not None:
        arrays.append(terms.rest.axis)
    if terms.plastic is not None:
        arrays += [terms.plastic.curvature, terms.plastic.tangent]
    return arrays


def new_work(model: Model) -> layout.Work:
    """Scratch of the explicit loop and of observation."""
    blocks = model.terms.lattice.xi.shape[0]
    dim = len(model.terms.axes)
    shape = (model.rows, model.width)
    spans = (blocks, 3 * dim, layout.LANES)
    load, before, pull, anchors = _together(shape, shape, (2, model.rows, 4), (2, dim))
    return layout.Work(
        coefficients=np.zeros(spans),
        gradient=np.zeros(spans),
        force=np.zeros(shape),
        load=load,
        load_before=np.zeros(shape),
        before=before,
        ends=np.zeros((model.rows, 4)),
        pull=pull,
        anchors=anchors,
        v0=np.zeros(shape),
        v1=np.zeros(shape),
    )


def new_solver(model: Model) -> layout.Solver:
    """Scratch of the implicit loop."""
    blocks = model.terms.lattice.xi.shape[0]
    dim = len(model.terms.axes)
    n = model.n
    shape = (model.rows, model.width)
    spans = (blocks, 3 * dim, layout.LANES)
    return layout.Solver(
        start=np.zeros(shape),
        start_w=np.zeros(shape),
        middle=np.zeros(shape),
        p0=np.zeros(spans),
        p1=np.zeros(spans),
        dp=np.zeros(spans),
        scratch=np.zeros(tangent.SCRATCH_ROWS * layout.LANES),
        jacobian=np.zeros((blocks, 9 * dim * dim * layout.LANES)),
        matrices=np.zeros((blocks, 16 * dim * dim * layout.LANES)),
        band=np.zeros((n * dim, 8 * dim)),
        moved=np.zeros(shape),
        coast=np.zeros(shape),
        residual=np.zeros(n * dim),
        rhs=np.zeros(n * dim),
        corrections=np.zeros((layout.MAX_CORRECTIONS, n * dim + 1)),
        loss=np.zeros(layout.LANES),
        damping_force=np.zeros(shape),
        twist_band=np.zeros((4, n)),
        twist_lower=np.zeros((3, n)),
        twist_diagonal=np.zeros(n),
    )


def new_recorder(model: Model, times: NDArray[np.float64]) -> layout.Recorder:
    """Room for a sample of the state at each of these times [s]."""
    return layout.Recorder(
        times=times,
        positions=np.zeros((len(times), model.rows, model.n)),
        energies=np.zeros(len(times)),
        next=np.zeros(1, dtype=np.int64),
        before=np.zeros((model.rows, model.width)),
    )


def check_recorder(recorder: layout.Recorder, model: Model) -> None:
    """Refuse what kernels would write beyond.

    Raises:
        TypeError: no recorder. ValueError: one of another model.
    """
    arguments.instance("recorder", recorder, layout.Recorder, "new_recorder of the present model")
    fits = (model.rows, model.n), (model.rows, model.width)
    found = recorder.positions.shape[1:], recorder.before.shape
    if found != fits:
        raise ValueError(f"recorder: has room for {found}, the model needs {fits}; make a new one")


def _together(*shapes: tuple[int, ...]) -> list[Array]:
    """Zeros of these shapes, one behind the other in one block of memory."""
    sizes = [math.prod(shape) for shape in shapes]
    block = np.zeros(sum(sizes))
    parts = np.split(block, np.cumsum(sizes)[:-1])
    return [part.reshape(shape) for part, shape in zip(parts, shapes, strict=True)]
