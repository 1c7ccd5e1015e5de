"""What every test may use: the checkout's folder, and child processes that import the same code.

`pytest -n auto --dist loadfile --no-loadscope-reorder` (pytest-xdist) gives whole files
to one process per core, in the order below; so the fixtures of a file are built once.
"""

from __future__ import annotations

import os
from pathlib import Path

import pytest

ROOT = Path(__file__).resolve().parents[1]

# A child process imports what this process imports, whatever else is installed.
os.environ["PYTHONPATH"] = os.pathsep.join(
    [str(ROOT), *filter(None, [os.environ.get("PYTHONPATH")])]
)


def pytest_collection_modifyitems(items: list[pytest.Item]) -> None:
    """Files with slow tests first, so that no process goes on long after the others."""
    slow = {item.path for item in items if item.get_closest_marker("slow")}
    items.sort(key=lambda item: item.path not in slow)


@pytest.fixture(scope="session")
def checkout() -> Path:
    """The folder that holds package.xml."""
    return ROOT
