"""The same numbers from this process, from processes of this machine and from a Dask cluster."""

import contextlib
import multiprocessing
import os
import signal
import socket
import subprocess
import sys
import time
from functools import partial
from pathlib import Path

import numpy as np
import pytest
import solids
from batch_scenes import STEP, wire

from dlo_sim import Simulator
from dlo_sim.batch import forecast_batch, simulate_batch, workers
from dlo_sim.batch.workers import WorkerLost, WorkersError, open_workers
from dlo_sim.scene.loading import load_scene
from dlo_sim.simulation.forecast import Plan
from dlo_sim.simulation.meshes import keep_triangles

SOON = 60.0  # [s]
SCENES = [wire(k) for k in range(9)]
SCENES.append(wire(0, **{"integrator.method": "energy_momentum", "integrator.step": 2e-3}))


@pytest.fixture(scope="module")
def here():
    """The batch in this process."""
    return simulate_batch(SCENES, 100 * STEP, every=10 * STEP, processes=1)


def same(result, other):
    """Whether two results are equal to the last bit."""
    assert result.status == other.status and result.method == other.method
    assert len(result.control_points) == len(SCENES)
    for name in ("time", "control_points", "energy", "energy_error", "step", "simulated"):
        assert np.array_equal(getattr(result, name), getattr(other, name)), name
    return True


def test_processes_give_the_same_numbers(here):
    scene = load_scene("table", {"obstacles.names": ["body"]} | body_of(solids.box(2.0, 1.0, 0.04)))
    simulator = Simulator(scene)
    plan = Plan(np.array([0.0, 0.01]), {})
    with open_workers(processes=2) as crew:
        assert crew.count == 2
        assert same(simulate_batch(SCENES, 100 * STEP, every=10 * STEP, workers=crew), here)
        other = simulate_batch([scene, scene], 0.01, workers=crew)
        (shape,) = forecast_batch(simulator, [plan], 0.01, workers=crew)
    simulator.advance(0.01)
    np.testing.assert_array_equal(other.control_points[1, -1], simulator.control_points)
    np.testing.assert_array_equal(shape.control_points[-1], simulator.control_points)


def body_of(triangles):
    """Values of an obstacle below the cable whose triangles this process keeps."""
    mesh = {"shape": "mesh", "mesh": keep_triangles(triangles), "position": [0.4, 0.0, -0.02]}
    return {f"obstacles.body.{key}": value for key, value in mesh.items()}


@pytest.mark.parametrize("broken_off", [False, True])
def test_other_children_of_the_caller_live_on(broken_off):
    spawn = multiprocessing.get_context("spawn")
    others = [spawn.Process(target=time.sleep, args=(SOON,)) for _ in range(2)]
    others[0].start()
    try:
        with contextlib.suppress(KeyboardInterrupt), open_workers(processes=2) as crew:
            assert list(crew.map(abs, [-1, -2])) == [1, 2]
            own = {*multiprocessing.active_children()} - {*others}
            if broken_off:
                crew.map(time.sleep, [SOON] * 3)
                raise KeyboardInterrupt
            others[1].start()
        # The pool's own thread waits for them as well: for a moment only it knows that they ended.
        deadline = time.monotonic() + 0.5 * SOON
        while any(child.is_alive() for child in own):
            assert time.monotonic() < deadline
        assert len(own) == 2
        for child in others[: 1 if broken_off else 2]:
            child.join(0.0)
            assert child.exitcode is None
    finally:
        for child in {*others} & {*multiprocessing.active_children()}:
            child.kill()
            child.join()


def test_workers_and_later_children_do_not_see_the_signals_of_a_terminal():
    """Ctrl-C goes to all of them: the parent alone decides, and nobody else prints a traceback."""
    terminal = {signal.SIGINT, signal.SIGHUP}
    for own in (set(), terminal):
        before = signal.pthread_sigmask(signal.SIG_SETMASK, own)
        try:
            with open_workers(processes=2) as crew:
                for mask in crew.map(partial(signal.pthread_sigmask, signal.SIG_BLOCK), [(), ()]):
                    assert terminal <= mask
            assert signal.pthread_sigmask(signal.SIG_BLOCK, ()) == own, "of this thread"
        finally:
            signal.pthread_sigmask(signal.SIG_SETMASK, before)


HAS_WORKERS = """
import sys, time
from dlo_sim.batch.workers import open_workers
from dlo_sim.process.stopping import check, supervised

def work():
    with open_workers(processes=2) as crew:
        found = crew.map(time.sleep, [60.0] * 4)
        print("begun", flush=True)
        while True:
            check()

if __name__ == "__main__":
    sys.exit(supervised(work))
"""


def test_workers_end_with_a_parent_that_is_killed(tmp_path):
    """Busy ones and idle ones, which wait for a queue that nobody closes."""
    (tmp_path / "work.py").write_text(HAS_WORKERS.replace("[60.0] * 4", "[300.0, 0.0]"))
    process = subprocess.Popen([sys.executable, str(tmp_path / "work.py")], stdout=subprocess.PIPE)
    assert process.stdout.readline() == b"begun\n"
    threads = Path(f"/proc/{process.pid}/task").glob("*/children")
    workers = [pid for thread in threads for pid in thread.read_text().split()]
    process.kill()
    process.wait()
    assert len(workers) == 3, "with the tracker of multiprocessing"
    deadline = time.monotonic() + SOON
    while any(os.path.exists(f"/proc/{pid}") for pid in workers):
        assert time.monotonic() < deadline


def test_interrupt_of_a_whole_group_is_one_line(tmp_path):
    (tmp_path / "work.py").write_text(HAS_WORKERS)
    process = subprocess.Popen(
        [sys.executable, str(tmp_path / "work.py")],
        stdout=subprocess.PIPE,
        stderr=subprocess.PIPE,
        start_new_session=True,
    )
    assert process.stdout.readline() == b"begun\n"
    os.killpg(process.pid, signal.SIGINT)  # the workers are still starting
    _, err = process.communicate(timeout=SOON)
    assert (process.returncode, err) == (130, b"dlo_sim: interrupted\n")


def test_a_cluster_gives_the_same_numbers(here):
    distributed = pytest.importorskip("distributed", reason="Dask (extra 'dask') is not installed")
    with distributed.LocalCluster(
        n_workers=1, threads_per_worker=1, processes=True, dashboard_address=None
    ) as cluster:
        address = cluster.scheduler_address
        result = simulate_batch(SCENES, 100 * STEP, every=10 * STEP, scheduler=address)
    assert same(result, here)


def test_a_worker_that_is_killed_is_one_line():
    """As results are taken, and when further work is handed out."""
    with open_workers(processes=2) as crew:
        for _ in range(2):
            with pytest.raises(WorkerLost, match="^a worker process was killed .*; free memory"):
                list(crew.map(_end, range(4)))


def _end(number):
    os.kill(os.getpid(), signal.SIGKILL)


def test_nobody_at_the_address_is_one_line(monkeypatch):
    pytest.importorskip("distributed", reason="Dask (extra 'dask') is not installed")
    monkeypatch.setattr(workers, "CONNECT_TIMEOUT", 0.5)
    with socket.socket() as unused:
        unused.bind(("127.0.0.1", 0))  # bound and not listening: nobody can answer there
        address = f"tcp://127.0.0.1:{unused.getsockname()[1]}"
        with pytest.raises(WorkersError, match=f"no Dask scheduler at {address} ") as refusal:
            simulate_batch(SCENES, 1.0, scheduler=address)
    assert "\n" not in str(refusal.value) and "dask scheduler" in str(refusal.value)


def test_without_dask_the_cure_is_named(monkeypatch):
    monkeypatch.setattr(workers.importlib.util, "find_spec", lambda name: None)
    with pytest.raises(WorkersError, match="install dlo_sim with the extra 'dask'"):
        simulate_batch(SCENES, 1.0, scheduler="tcp://somewhere:8786")
