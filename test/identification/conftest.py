"""Simulated recordings for every test of this room."""

import pytest


@pytest.fixture(scope="session")
def moving():
    """Two pieces of a cable in motion."""
    from simulated_cables import TRUTH, recorded

    return [recorded(TRUTH, seed) for seed in (1, 2)]
