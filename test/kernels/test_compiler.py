"""The compiler of kernels: its numbers, from disk too, and that others are left alone."""

from __future__ import annotations

import os
import subprocess
import sys
from pathlib import Path

import numba
import pytest

PROGRAM = """
import collections
import numba
import numpy as np

Box = collections.namedtuple("Box", "values weights")
Pair = collections.namedtuple("Pair", "box ledger")

@numba.njit
def early(x):
    y = np.zeros(x.shape[0])
    for i in range(x.shape[0]):
        y[i] = x[i].sum()
    return y[y > 0.0]

strided = np.arange(24.0).reshape(4, 6)[:, ::2]
assert early(strided).tolist() == strided.sum(axis=1).tolist()

from dlo_sim.kernels.jit import entry, kernel, shared

@kernel
def swap(pair, upward):
    # Variables of one, of two and of no certain assignment; carried around a loop and swapped.
    a, b = 1.0, 2.0
    last = -1
    for i in range(len(pair.box.values)):
        row = pair.box.values[i]
        if upward:
            picked = row[-1]
        else:
            picked = row[0]
        a, b = b, a + picked
        if picked > 4.0:
            continue
        last = i
        row[0] = b
    return a, b, last

@shared
def weighted(box, shift):
    total = 0.0
    k = 0
    while True:
        if k == box.weights.shape[0]:
            break
        total += box.weights[k] * box.values[k, 1]
        k += 1
    if shift is not None:
        total = shift[0] - total
    return total

@kernel
def replaced(pair, other):
    # A tuple that is one of two, and one put together from parts.
    box = pair.box
    for k in range(3):
        if k == 1:
            box = other
        pair.ledger[k] += weighted(box, None)
    return Pair(other, pair.ledger)

@entry
def run(pair, other, shift, upward, rounds):
    a, b, last = 0.0, 0.0, 0
    for _ in range(rounds):
        a, b, last = swap(pair, upward)
        mixed = replaced(pair, other)
        mixed.ledger[3] += weighted(mixed.box, shift) * a
    return a, b, last

def outcome(function, shift, upward):
    box = Box(np.arange(12.0).reshape(4, 3), np.array([0.5, 1.5, -2.0, 3.0]))
    other = Box(np.arange(12.0)[::-1].copy().reshape(4, 3), np.array([1.0, -1.0, 0.25, 2.0]))
    pair = Pair(box, np.zeros(4))
    return (*function(pair, other, shift, upward, 3), *box.values.ravel(), *pair.ledger)

def plain():
    global swap, weighted, replaced
    kernels = swap, weighted, replaced
    swap, weighted, replaced = (f.py_func for f in kernels)
    numbers = [outcome(run.py_func, s, u) for s in (None, np.array([2.0])) for u in (True, False)]
    swap, weighted, replaced = kernels
    return numbers

compiled = [outcome(run, s, u) for s in (None, np.array([2.0])) for u in (True, False)]
hits = sum(run.stats.cache_hits.values())
expected = plain()
assert np.allclose(compiled, expected, rtol=1e-14, atol=0.0), (compiled, expected)

@numba.njit
def late(x):
    return [row.sum() for row in x] + [early(x)[0], (x[0].copy() * x[1]).sum()]

@kernel
def doubled(box):
    return 2.0 * weighted(box, None)

@numba.njit
def foreign(box):
    return doubled(box)

box = Box(np.arange(12.0).reshape(4, 3), np.array([0.5, 1.5, -2.0, 3.0]))
assert foreign(box) == 2.0 * weighted.py_func(box, None)
assert late(strided) == [*strided.sum(axis=1), strided[0].sum(), strided[0] @ strided[1]]
print(hits, [float(value).hex() for numbers in compiled for value in numbers])
"""


def outcome(directory: Path, before: str = "") -> tuple[int, str, str]:
    """Run the program with its cache in `directory`: (entries read from disk, numbers, stderr)."""
    program = directory / "program.py"
    if not program.exists():  # machine code is kept for a file as old as this one
        program.write_text(PROGRAM)
    path = os.pathsep.join([str(directory), *filter(None, [os.environ.get("PYTHONPATH")])])
    environment = {**os.environ, "DLO_SIM_CACHE": str(directory), "PYTHONPATH": path}
    environment.pop("NUMBA_DISABLE_JIT", None)
    done = subprocess.run(
        [
            sys.executable,
            "-c",
            f"{before}\nimport program",
        ],  # a tuple type of a main program is never cached
        env=environment,
        capture_output=True,
        text=True,
        check=False,
    )
    assert done.returncode == 0, done.stderr
    hits, numbers = done.stdout.split(" ", 1)
    return int(hits), numbers, done.stderr


def test_kernels_and_foreign_functions_give_the_numbers_of_python_also_from_disk(
    tmp_path: Path,
) -> None:
    """Every way in which a variable can be assigned, and numba's own code before and after."""
    hits, fresh, said = outcome(tmp_path)
    assert hits == 0
    if numba.version_info.short >= (0, 62):
        assert said == "", "the fast pipeline supports these releases"
    hits, from_disk, _ = outcome(tmp_path)
    assert hits == 2
    assert from_disk == fresh


@pytest.mark.parametrize(
    "other_internals",
    [
        "from dlo_sim.kernels.compiler import _Whole; _Whole._optimize_functions = None",
        "from dlo_sim.kernels.compiler import EntryCompiler; EntryCompiler._library = None",
    ],
    ids=["every kernel", "only entries"],
)
def test_a_numba_with_other_internals_compiles_alone_with_one_warning(
    tmp_path: Path, other_internals: str
) -> None:
    _, _, said = outcome(tmp_path, before=other_internals)
    (line,) = said.splitlines()
    assert f"does not support numba {numba.__version__}" in line and "install numba 0.62" in line


def test_a_numba_whose_cache_is_another_warns_once_that_nothing_is_kept(tmp_path: Path) -> None:
    lacking = "import numba.core.caching as caching; del caching.CompileResultCacheImpl"
    for _ in range(2):
        hits, _, said = outcome(tmp_path, before=lacking)
        (line,) = said.splitlines()
        assert hits == 0
        assert f"numba {numba.__version__} cannot keep" in line and "install numba 0.62" in line
