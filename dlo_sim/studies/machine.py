"""On what, with what and from what a study was made."""

from __future__ import annotations

import importlib.metadata
import os
import platform
import subprocess
from pathlib import Path

from dlo_sim import __version__

ROOT = Path(__file__).resolve().parents[2]
PACKAGES = ("numpy", "numba", "llvmlite", "matplotlib")


def facts() -> dict[str, str]:
    """Machine, versions and commit, as lines of a table."""
    return {
        "processor": f"{processor()}, {os.cpu_count()} logical cores",
        "system": platform.platform(),
        "Python": f"{platform.python_version()} ({platform.python_implementation()})",
        **{name: _version(name) for name in PACKAGES},
        "dlo_sim": __version__,
        "commit": commit(),
    }


def processor() -> str:
    """Name of the processor as the system gives it."""
    try:
        for line in Path("/proc/cpuinfo").read_text(encoding="utf-8").splitlines():
            if line.startswith("model name"):
                return line.partition(":")[2].strip()
    except OSError:
        pass
    return platform.processor() or platform.machine()


def commit() -> str:
    """Commit of the checkout that runs; says so if there is none or files were changed."""
    if not (ROOT / ".git").exists():
        return "not run from a checkout"
    try:
        name = _git("rev-parse", "--short=12", "HEAD")
        changed = _git("status", "--porcelain", "--untracked-files=no")
    except (OSError, subprocess.TimeoutExpired):
        return "unknown (git did not answer)"
    if name.returncode:
        return "unknown (git does not know this checkout)"
    return name.stdout.strip() + (" with uncommitted changes" if changed.stdout.strip() else "")


def _git(*words: str) -> subprocess.CompletedProcess[str]:
    command = ["git", "-C", str(ROOT), *words]
    return subprocess.run(command, capture_output=True, text=True, timeout=10)


def _version(name: str) -> str:
    try:
        return importlib.metadata.version(name)
    except importlib.metadata.PackageNotFoundError:
        return "not installed"
