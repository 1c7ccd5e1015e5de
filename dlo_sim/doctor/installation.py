"""Python, the compiler and its cache, processors, and the environment of ROS."""

from __future__ import annotations

import os
import platform
from collections.abc import Iterator, Mapping
from importlib import metadata
from pathlib import Path

import numpy as np

from dlo_sim import __version__
from dlo_sim.doctor.finding import Finding, note, ok, problem
from dlo_sim.process.children import processors

_CACHE_CURE = "set DLO_SIM_CACHE to a directory of your own"
_LAST_DOMAIN, _LAST_SAFE_DOMAIN = 232, 101
_RANGES = ("SUBNET", "LOCALHOST", "OFF", "SYSTEM_DEFAULT")


def installation() -> Iterator[Finding]:
    """The versions, the cache of machine code, the processors."""
    versions = f"dlo_sim {__version__}, Python {platform.python_version()}, numpy {np.__version__}"
    try:
        from dlo_sim.compiling import directory
    except ImportError as error:
        yield problem(f"{versions}; numba cannot be imported: {error}", "pip install numba")
        return
    yield ok(f"{versions}, numba {metadata.version('numba')}")
    try:
        base = directory.base_directory()
    except OSError as error:
        yield problem(f"{error}; every start compiles", _CACHE_CURE)
    else:
        yield cache(base, base / directory.digest(), directory.trust_problem(_existing(base)))
    cores = processors()
    if cores > 1:
        yield ok(f"{cores} cores")
    else:
        cure = "keep it free: the prediction and the error estimate share it"
        yield note("only one core", cure)


def cache(base: Path, mine: Path, untrusted: str) -> Finding:
    """Whether machine code is kept, and that of this version is there.

    Args:
        untrusted: why what is kept there must not be loaded; may be empty.
    """
    if untrusted:
        why = f"the cache {base} is not used: {untrusted}; every start compiles"
        return problem(why, _CACHE_CURE)
    if not os.access(_existing(base), os.W_OK):
        return problem(f"the cache {base} cannot be written; every start compiles", _CACHE_CURE)
    if mine.is_dir() and any(mine.iterdir()):
        return ok(f"the cache {base} holds this version's machine code")
    what = f"the cache {base} has no machine code of this version"
    return note(what, "nothing to do: the first start compiles once, for about 45 s")


def _existing(path: Path) -> Path:
    """The path, or the nearest directory above that exists."""
    return next(place for place in (path, *path.parents) if place.exists())


def ros_environment(environment: Mapping[str, str]) -> Iterator[Finding]:
    """Domain and discovery as these variables set them."""
    domain = environment.get("ROS_DOMAIN_ID", "") or "0"
    if not domain.isdecimal() or int(domain) > _LAST_DOMAIN:
        cure = f"set it to a whole number from 0 to {_LAST_SAFE_DOMAIN}"
        yield problem(f"ROS_DOMAIN_ID is {domain!r}, which is not a domain", cure)
    elif int(domain) > _LAST_SAFE_DOMAIN:
        cure = f"prefer 0 to {_LAST_SAFE_DOMAIN}: ports of higher domains can be in use already"
        yield note(f"ROS_DOMAIN_ID is {domain}", cure)
    else:
        yield ok(f"ROS_DOMAIN_ID is {domain}")
    reach = environment.get("ROS_AUTOMATIC_DISCOVERY_RANGE", "")
    if reach == "OFF":
        cure = "unset it, or set it to LOCALHOST or SUBNET"
        yield problem("ROS_AUTOMATIC_DISCOVERY_RANGE is OFF: nodes cannot find each other", cure)
    elif reach and reach not in _RANGES:
        cure = f"give one of {', '.join(_RANGES)}"
        yield problem(f"ROS_AUTOMATIC_DISCOVERY_RANGE is {reach!r}, which ROS does not know", cure)
    elif reach == "LOCALHOST" or environment.get("ROS_LOCALHOST_ONLY") == "1":
        cure = "for publishers on other machines, set ROS_AUTOMATIC_DISCOVERY_RANGE to SUBNET"
        yield note("only nodes on this machine are visible", cure)
