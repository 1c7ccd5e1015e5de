"""Machine code that is missing is noticed before it is compiled, whatever chose it."""

from __future__ import annotations

import logging
import os
import subprocess
import sys
from typing import Any

import numba
import pytest
from cables import FULL, SOFT

from dlo_sim.kernels import cache, jit
from dlo_sim.kernels.implicit import advance_implicit
from dlo_sim.scene.loading import scene_from_values
from dlo_sim.simulation.machine_code import (
    compile_loop,
    compiled_by_two,
    compiling_told_to,
    done_without_compiling,
)
from dlo_sim.simulation.simulator import Simulator


def test_two_scenes_of_one_structure_that_choose_different_methods(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    """Both say `auto`; only the stiffness tells them apart, and only one is there."""
    soft = scene_from_values(SOFT)
    stiff = scene_from_values(SOFT | {"cable.axial_stiffness": 6e5})
    assert soft.integrator.method == stiff.integrator.method == "auto"
    assert Simulator(soft).method == "velocity_verlet"
    monkeypatch.setattr(jit, "_bound", {})
    monkeypatch.setattr(advance_implicit, "overloads", {})
    monkeypatch.setattr(advance_implicit._cache._cache_file, "load", lambda key: None)
    assert done_without_compiling(lambda: Simulator(soft))
    assert not done_without_compiling(lambda: Simulator(stiff))


def test_who_is_told_is_told_no_more_afterwards(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(cache, "_said", set())
    told: list[str] = []
    level = logging.getLogger(cache.LOGGER).level
    with compiling_told_to(told.append):
        cache.miss("step")
    assert len(told) == 1 and "compiling" in told[0]
    cache._said.clear()
    cache.miss("step")
    assert len(told) == 1
    assert logging.getLogger(cache.LOGGER).level == level


def test_other_errors_of_the_work_come_through() -> None:
    def fail() -> None:
        raise ValueError("refused")

    with pytest.raises(ValueError, match="refused"):
        done_without_compiling(fail)


@pytest.mark.parametrize("method", ["velocity_verlet", "energy_momentum", "rattle", "auto"])
@pytest.mark.parametrize("scene", [SOFT, FULL], ids=["plane", "space"])
def test_the_loop_compiled_apart_is_the_one_that_a_simulator_asks_for(
    method: str, scene: dict[str, object]
) -> None:
    gripper = {"start.pose_topic": "/gripper", "cable.axial_stiffness": 6e5}
    values = scene | gripper | {"integrator.method": method, "integrator.step": 0.0}
    found = scene_from_values(values)
    Simulator(found)
    known = set(jit._bound)
    compile_loop(found)
    assert set(jit._bound) == known


def test_the_other_process_is_started_once_and_only_if_something_is_missing(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    started: list[list[str]] = []
    real = subprocess.Popen

    def start(command: list[str], **options: Any) -> Any:
        started.append(command)
        return real([sys.executable, "-c", "import sys; sys.stdin.read()"], **options)

    monkeypatch.setattr(subprocess, "Popen", start)
    monkeypatch.setattr(os, "sched_getaffinity", lambda pid: {0, 1})
    scene = scene_from_values(SOFT)
    with compiled_by_two(scene):
        pass
    assert not started
    with compiled_by_two(scene):
        cache.miss("step")
        cache.miss("step")
    assert [command[-1] for command in started] == ["dlo_sim.simulation.machine_code"]
    cache.miss("step")
    monkeypatch.setattr(os, "sched_getaffinity", lambda pid: {0})
    with compiled_by_two(scene):
        cache.miss("step")
    assert len(started) == 1, "nobody to share with"


def test_what_looks_at_a_scene_is_compiled_once_for_all_that_look_the_same() -> None:
    """Damping and loads make other steps, not another account or stiffness."""
    space = SOFT | {"terms.out_of_plane": "on"}
    quiet = Simulator(scene_from_values(space | {"loads.names": []})).model
    loaded = Simulator(scene_from_values(space | {"damping.mass": 1.0})).model
    assert numba.typeof(quiet.terms) != numba.typeof(loaded.terms)
    for name in ("account_terms", "stiffness_terms"):
        kinds = {numba.typeof(getattr(model, name)) for model in (quiet, loaded)}
        assert len(kinds) == 1, name
