"""Fixtures of this room."""

from __future__ import annotations

import pytest
from session_bench import FREE, GRIPPER, LOADED, Bench


@pytest.fixture
def gripper() -> Bench:
    return Bench(GRIPPER)


@pytest.fixture
def loaded() -> Bench:
    return Bench(LOADED)


@pytest.fixture
def free() -> Bench:
    return Bench(FREE)


@pytest.fixture
def bench():
    """Build a bench with changed parameters: bench(LOADED | {...})."""
    return Bench
