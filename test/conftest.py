"""What every test may use: the checkout's folder, and child processes that import the same code."""

import os
from pathlib import Path

import pytest

ROOT = Path(__file__).resolve().parents[1]

# A child process imports what this process imports, whatever else is installed.
os.environ["PYTHONPATH"] = os.pathsep.join(
    [str(ROOT), *filter(None, [os.environ.get("PYTHONPATH")])]
)


@pytest.fixture(scope="session")
def checkout() -> Path:
    """The folder that holds package.xml."""
    return ROOT
