"""Where the arrays of a cable lie, and what copies of a cable share."""

import copy
import pickle

import numpy as np
import pytest
from cables import FULL, SOFT, Bench

from dlo_sim.engine.arrays import GUARDED
from dlo_sim.simulation.arrays import from_blocks, to_blocks

COPIES = {"deepcopy": copy.deepcopy, "pickle": lambda cable: pickle.loads(pickle.dumps(cable))}


@pytest.fixture
def cable():
    bench = Bench(FULL, n=12)
    bench.cable.put(np.random.default_rng(1).normal(size=(12, 4)), np.zeros((12, 4)))
    return bench.cable


def test_the_state_lies_in_one_array(cable):
    """A copy of the array is a snapshot of every array and number in it."""
    state, begin = cable.arrays.state, cable.state.copy()
    for name in state.fields:
        assert getattr(state, name).size == 0 or np.shares_memory(getattr(state, name), cable.state)
    before = cable.potentials()
    state.x[:] = 7.0
    state.balance.load_work = 3.0
    cable.state[:] = begin
    assert state.balance.load_work == 0.0 and not (cable.x == 7.0).any()
    assert np.array_equal(cable.potentials(), before)


def test_arrays_begin_with_whole_vectors():
    arrays = Bench(SOFT, n=9).cable.arrays
    for group in (arrays.mesh, arrays.linear, arrays.inputs, arrays.state, arrays.work):
        for name in group.fields:
            array = np.asarray(getattr(group, name))
            assert array.dtype == np.int64 or array.ctypes.data % 64 == 0, name


@pytest.mark.parametrize("how", COPIES)
def test_a_copy_has_arrays_of_its_own(cable, how):
    cable.leave_out(GUARDED)
    address, energies = cable.address, cable.potentials()
    other = COPIES[how](cable)
    assert other.address != address and other.terms == cable.terms
    assert np.array_equal(other.state, cable.state)
    other.x[:] *= 1.1
    assert np.array_equal(cable.potentials(), energies)
    assert not np.array_equal(other.potentials(), energies)


def test_terms_of_a_cable_reach_its_functions_and_no_other_cable():
    """Without its guard a span that has turned over costs less."""
    bench = Bench(SOFT, n=8)
    folded = np.zeros((8, 4))
    folded[:, 0] = bench.greville * np.where(np.arange(8) == 4, -1.0, 1.0)
    guarded = bench.potential(folded)
    bench.cable.leave_out(GUARDED)
    assert bench.potential(folded) < guarded and bench.model.has(GUARDED)
    assert type(bench.cable)(bench.model).terms & GUARDED


@pytest.mark.parametrize("spans", [1, 7, 8, 9, 17])
def test_blocks_hold_the_values_of_spans_in_their_lanes(spans):
    values = np.random.default_rng(spans).normal(size=(spans, 3, 4))
    blocks = to_blocks(values, beyond=5.0)
    assert blocks.shape == (-(-spans // 8), 3, 4, 8) and blocks.flags.c_contiguous
    assert (blocks[0, 2, 1, 0], blocks[-1, 2, 1, (spans - 1) % 8]) == tuple(values[[0, -1], 2, 1])
    assert (blocks == 5.0).sum() == 12 * (-spans % 8)
    assert np.array_equal(from_blocks(blocks, spans), values)
