"""Scratch and state arrays of one simulator, allocated once."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from dlo_sim.kernels import layout, tangent
from dlo_sim.simulation.model import Model


def new_state(model: Model) -> layout.State:
    """All-zero state."""
    shape = (model.rows, model.width)
    return layout.State(
        position=np.zeros(shape),
        w=np.zeros(shape),
        history=np.zeros((3, *shape)),
        reaction=np.zeros(shape),
        ledger=np.zeros(layout.LEDGER_SIZE),
    )


def new_work(model: Model) -> layout.Work:
    """Scratch of the explicit loop and of observation."""
    blocks = model.terms.lattice.xi.shape[0]
    dim = len(model.terms.axes)
    shape = (model.rows, model.width)
    spans = (blocks, 3 * dim, layout.LANES)
    return layout.Work(
        coefficients=np.zeros(spans),
        gradient=np.zeros(spans),
        force=np.zeros(shape),
        load=np.zeros(shape),
        load_before=np.zeros(shape),
        before=np.zeros(shape),
        ends=np.zeros((model.rows, 4)),
        pull=np.zeros((2, model.rows, 4)),
        anchors=np.zeros((2, dim)),
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
