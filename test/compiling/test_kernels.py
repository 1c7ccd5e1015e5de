"""Pieces call each other by address, and only those that a scene needs are loaded."""

import os
import pickle
import subprocess
import sys

import numpy as np
import pytest
from numba import cfunc, config, float64, int64

from dlo_sim.compiling.groups import Group, Reals, grid, group_at
from dlo_sim.compiling.kernels import ARRAY, inline, kernel


class Numbers(Group):
    x = Reals("n")


@kernel(float64, Numbers.kind, float64)
def first_plus(numbers, value):
    """x[0] + value."""
    return numbers.x[0] + value


@kernel((float64, int64), Numbers.kind, terms=4)
def last_and_count(numbers):
    """Last entry, and how many there are."""
    return numbers.x[len(numbers.x) - 1], len(numbers.x)


@inline
def halved(numbers, value):
    return 0.5 * first_plus(numbers, value)


@kernel(float64, int64, int64)
def entry(address, more):
    """Calls the first directly and through an inline function, the second if asked."""
    numbers = numbers_at(address)
    sum_ = halved(numbers, 3) + first_plus(numbers, 1.0)
    if more:
        last, count = last_and_count(numbers)
        sum_ += last * count
    return sum_


@kernel(float64, ARRAY, int64)
def sum_of(values, count):
    """Sum of the first entries."""
    whole, sum_ = grid(values), 0.0
    for k in range(count):
        sum_ += whole[k]
    return sum_


numbers_at = group_at(Numbers)


def run(script, **variables):
    """A script that may import this file, in a process of its own."""
    return subprocess.run(
        [sys.executable, "-c", script],
        capture_output=True,
        text=True,
        check=False,
        cwd=os.path.dirname(__file__),
        env=os.environ | variables,
    )


@pytest.fixture
def numbers():
    made = Numbers({"n": 4})
    made.x[:] = [1.0, 2.0, 3.0, 5.0]
    return made


def test_a_kernel_calls_others_itself_and_through_inline_functions(numbers):
    assert entry(numbers.address, 0) == 0.5 * 4.0 + 2.0
    numbers.x[0] = 11.0
    assert entry(numbers.address, 0) == 0.5 * 14.0 + 12.0


def test_a_kernel_of_a_term_is_loaded_with_the_term(numbers):
    assert entry.code(4)(numbers.address, 1) == 4.0 + 20.0


@pytest.mark.skipif("NUMBA_DISABLE_JIT" in os.environ, reason="asks for machine code")
def test_without_the_term_it_is_not():
    done = run(
        "from test_kernels import Numbers, entry, first_plus, last_and_count\n"
        "entry.code(3)\n"
        "print(first_plus._native is not None, last_and_count._native is not None)\n"
        "entry.code(4)\n"
        "print(last_and_count._native is not None)\n"
    )
    assert done.returncode == 0, done.stderr
    assert done.stdout.split() == ["True", "False", "True"]


@pytest.mark.skipif("NUMBA_DISABLE_JIT" in os.environ, reason="asks for machine code")
def test_a_call_of_what_is_not_loaded_ends_with_its_reason():
    done = run(
        "from test_kernels import Numbers, entry\n"
        "entry.code(3)(Numbers({'n': 4}).address, 1)\n"
        "print('went on')\n"
    )
    assert done.returncode < 0 and "went on" not in done.stdout
    assert "not loaded for its terms" in done.stderr


def test_a_copy_in_another_process_is_the_same_piece():
    assert pickle.loads(pickle.dumps(first_plus)) is first_plus


@pytest.mark.skipif("NUMBA_DISABLE_JIT" in os.environ, reason="numpy checks other bounds")
def test_every_index_is_checked_on_demand():
    done = run(
        "import numpy as np\n"
        "from test_kernels import sum_of\n"
        "print(sum_of(np.ones(3), 3))\n"
        "sum_of(np.ones(3), 4)\n",
        DLO_SIM_CHECK="1",
    )
    assert done.stdout.strip() == "3.0" and done.returncode == 1
    assert "IndexError: index outside of dimension 0" in done.stderr
    assert np.isfinite(sum_of(np.ones(3), 3))


@inline
def _long(x, n):
    """Too long to be inlined unasked where it is called several times."""
    a = b = c = d = x
    for k in range(n):
        a, b, c, d = b * c + k, c * d - a, d * a + b / (1.0 + k), a * b - c
        if a > 1e3:
            a, b = np.sqrt(a), np.sin(b)
        if c > 1e3:
            c, d = np.sqrt(c), np.cos(d)
    return a + b + c + d


@pytest.mark.skipif(config.DISABLE_JIT, reason="nothing is compiled")
def test_a_kernel_contains_no_functions_of_its_parts():
    """Pieces that had a copy each would share the one that is loaded first, in any order."""

    def several(x, n):
        return _long(x, n) + _long(2.0 * x, n + 1) + _long(3.0 * x, n + 2) + _long(x, n * n)

    options = {"error_model": "numpy", "fastmath": {"contract"}}
    code = cfunc(float64(float64, int64), **options)(several).inspect_llvm()
    assert "_long" not in "".join(line for line in code.splitlines() if line.startswith("define"))
