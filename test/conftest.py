"""What every test may use: the checkout's folder, and child processes that import the same code.

`pytest -n auto --dist loadfile --no-loadscope-reorder` (pytest-xdist) gives whole files
to one process per core and one more, in the order below; so the fixtures of a file are built once.
"""

from __future__ import annotations

import os
import shutil
import subprocess
import sys
from pathlib import Path

import pytest

ROOT = Path(__file__).resolve().parents[1]
MADE_BY_BUILDS = {"build", "dist", "install", "log", "dlo_sim.egg-info", "dlo_sim_demo"}

# Tests run beside each other: with threads of BLAS that wait for a core, a fit of 150 points took
# 9 s of processor time, not 0.1 s. Set before anything imports numpy.
os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")
# A child process imports what this process imports, whatever else is installed.
os.environ["PYTHONPATH"] = os.pathsep.join(
    [str(ROOT), *filter(None, [os.environ.get("PYTHONPATH")])]
)


@pytest.hookimpl(optionalhook=True)
def pytest_xdist_auto_num_workers() -> int:
    """One process more than cores: about one of three waits for a node."""
    return len(os.sched_getaffinity(0)) + 1


def pytest_collection_modifyitems(items: list[pytest.Item]) -> None:
    """Files with slow tests first, so that no process goes on long after the others. Files that
    wait for nodes are spread among those that compute, so that no core is idle meanwhile.
    """
    slow = {item.path for item in items if item.get_closest_marker("slow")}
    files = sorted(dict.fromkeys(item.path for item in items), key=lambda path: path not in slow)
    waiting = [path for path in files if path.parent.name == "ros"]
    computing = [path for path in files if path.parent.name != "ros"]
    place = {path: k / len(some) for some in (waiting, computing) for k, path in enumerate(some)}
    items.sort(key=lambda item: place[item.path])


@pytest.fixture(scope="session")
def checkout() -> Path:
    """The folder that holds package.xml."""
    return ROOT


@pytest.fixture
def incomplete_machine_code(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """A directory of machine code for this test and its child processes: what has been compiled so
    far, but for a piece that every scene needs.
    """
    from dlo_sim.compiling import directory
    from dlo_sim.methods.between_steps import kinetic_energy

    kept = directory.base_directory() / directory.digest()
    own = tmp_path / "machine_code" / "dlo_sim" / kept.name
    own.mkdir(parents=True)
    for path in kept.glob("dlo_sim.*"):
        if path.name != kinetic_energy.name:
            shutil.copy(path, own)
    monkeypatch.setenv("DLO_SIM_CACHE", str(own.parents[1]))


@pytest.fixture(scope="session")
def top_level(checkout: Path) -> set[str]:
    """What belongs to the checkout: all but dot-files and what builds leave behind."""
    listing = subprocess.run(
        ["git", "ls-files", "--cached", "--others", "--exclude-standard"],
        cwd=checkout,
        capture_output=True,
        text=True,
    )
    if listing.returncode == 0 and listing.stdout:
        names = {line.split("/")[0] for line in listing.stdout.splitlines()}
    else:
        names = {path.name for path in checkout.iterdir()} - MADE_BY_BUILDS
    return {name for name in names if not name.startswith(".") and (checkout / name).exists()}


@pytest.fixture(scope="session")
def installed(
    checkout: Path, top_level: set[str], tmp_path_factory: pytest.TempPathFactory
) -> Path:
    """The package installed by setup.py into a folder, as colcon does it; returns the prefix."""
    folder = tmp_path_factory.mktemp("install")
    for name in top_level - {"test"}:
        (folder / name).symlink_to(checkout / name)
    prefix = folder / "prefix"
    subprocess.run(
        [sys.executable, "setup.py", "--quiet", "install", "--prefix", str(prefix)]
        + ["--single-version-externally-managed", "--record", str(folder / "record")],
        cwd=folder,
        capture_output=True,
        check=True,
    )
    return prefix
