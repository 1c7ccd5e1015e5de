"""Of several processes that need the same machine code, one compiles it and the others load it."""

from __future__ import annotations

import threading
import time
from pathlib import Path

import numba
import pytest

from dlo_sim.kernels import turns
from dlo_sim.kernels.jit import entry
from dlo_sim.kernels.turns import Turn

WHOLE = turns.PATIENCE


def add_two(x: float) -> float:
    return x + 2.0


def test_the_second_waits_for_the_first(tmp_path: Path) -> None:
    lock = tmp_path / "code.lock"
    first = Turn(lock)
    assert not first.waited
    got: list[Turn] = []
    other = threading.Thread(target=lambda: got.append(Turn(lock)))
    other.start()
    time.sleep(0.2)
    assert not got
    first.give_back()
    other.join(timeout=60.0)
    assert got[0].waited
    got[0].give_back()
    assert not lock.exists()
    assert not Turn(lock).waited


def test_patience_ends(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    lock = tmp_path / "code.lock"
    first = Turn(lock)
    monkeypatch.setattr(turns, "PATIENCE", 0.1)
    began = time.monotonic()
    Turn(lock)
    assert 0.1 <= time.monotonic() - began < WHOLE
    first.give_back()


def test_a_directory_without_locks_is_no_hindrance(tmp_path: Path) -> None:
    turn = Turn(tmp_path / "missing" / "code.lock")
    assert not turn.waited
    turn.give_back()


def test_code_that_came_while_waiting_is_loaded(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setenv("DLO_SIM_CACHE", str(tmp_path))
    signature = (numba.float64,)
    assert entry(add_two)(1.0) == 3.0
    (code,) = tmp_path.rglob("*.nbc")
    assert not list(tmp_path.rglob("*.lock")), "given back after compiling"
    away = code.rename(tmp_path / "away")
    late = entry(add_two)
    turn = late._cache._cache_file.turn(signature)
    other = threading.Thread(target=late.compile, args=(signature,))
    other.start()
    time.sleep(0.2)
    away.rename(code)
    turn.give_back()
    other.join(timeout=60.0)
    assert late.stats.cache_hits[signature] == 1
    assert not late.stats.cache_misses
    assert not list(tmp_path.rglob("*.lock"))
