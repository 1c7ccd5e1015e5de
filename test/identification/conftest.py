"""Makes the helpers beside the rooms importable, and simulated recordings for every test."""

import sys
from pathlib import Path

import pytest

sys.path += [str(Path(__file__).parents[1]), str(Path(__file__).parent)]
sys.path.append(str(Path(__file__).parents[1] / "benchmarks"))


@pytest.fixture(scope="session")
def moving():
    """Two pieces of a cable in motion."""
    from simulated_cables import TRUTH, recorded

    return [recorded(TRUTH, seed) for seed in (1, 2)]
