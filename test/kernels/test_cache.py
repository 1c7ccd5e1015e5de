"""Machine code on disk: never another's, never of another version, and said when it is missing."""

from __future__ import annotations

import itertools
import logging
import platform
import shutil
import threading
from collections.abc import Callable
from pathlib import Path
from typing import Any

import llvmlite
import numba
import pytest

from dlo_sim.kernels import cache
from dlo_sim.kernels.code_files import CodeFiles
from dlo_sim.kernels.jit import bound, entry

KEY, OTHER = ("float64",), ("int64",)


class Saver(threading.Thread):
    """Saves, and stops before everything that can be seen from outside until it may go on."""

    def __init__(self, files: CodeFiles, key: object, data: object) -> None:
        super().__init__(daemon=True)
        self._go, self._stopped = threading.Semaphore(0), threading.Semaphore(0)
        self._files, self._key, self._data = files, key, data
        self._done = False
        for name in ("_dump", "_open_for_write"):
            setattr(files, name, self._stopping(getattr(files, name)))
        self.start()

    def _stopping(self, function: Callable[..., Any]) -> Callable[..., Any]:
        def stopping(*arguments: object) -> Any:
            self._stopped.release()
            assert self._go.acquire(timeout=120.0)
            return function(*arguments)

        return stopping

    def run(self) -> None:
        assert self._go.acquire(timeout=120.0)
        self._files.save(self._key, self._data)
        self._done = True
        self._stopped.release()

    def step(self) -> None:
        """Go on to the next stop; nothing if it has ended."""
        if not self._done:
            self._go.release()
            assert self._stopped.acquire(timeout=120.0)


def test_two_processes_that_save_at_once_each_leave_their_own(tmp_path: Path) -> None:
    """In whatever order they come to the stops on their way."""
    wanted = {KEY: "code for a number", OTHER: "code for an integer"}
    for order in itertools.product((0, 1), repeat=6):
        folder = tmp_path / "".join(map(str, order))
        folder.mkdir()
        savers = [Saver(CodeFiles(folder, "f", "v1"), key, code) for key, code in wanted.items()]
        for turn in order:
            savers[turn].step()
        for saver in savers * 5:
            saver.step()
        assert {key: CodeFiles(folder, "f", "v1").load(key) for key in wanted} == wanted, order


def test_a_file_is_read_only_as_what_it_was_saved_for(tmp_path: Path) -> None:
    files = CodeFiles(tmp_path, "f", "v1")
    assert files.load(KEY) is None
    files.save(KEY, "old")
    files.save(KEY, "new")
    assert files.load(KEY) == "new"
    assert CodeFiles(tmp_path, "f", "v2").load(KEY) is None, "its source has changed"
    assert CodeFiles(tmp_path, "g", "v1").load(KEY) is None
    (path,) = tmp_path.iterdir()
    shutil.copy(path, files._path(OTHER))
    assert files.load(OTHER) is None, "two keys with one name"
    path.write_bytes(path.read_bytes()[:-4])
    assert files.load(KEY) is None, "cut short"
    path.write_bytes(b"")
    assert files.load(KEY) is None
    files.flush()
    assert not list(tmp_path.iterdir())


def add_one(x: float) -> float:
    return x + 1.0


def test_another_directory_for_other_kernels_and_another_compiler(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    folder = tmp_path / "kernels"
    shutil.copytree(Path(cache.__file__).parent, folder)
    monkeypatch.setattr(cache, "__file__", str(folder / "cache.py"))
    first = cache.cache_directory()
    assert cache.cache_directory() == first
    seen = {first}

    def is_new() -> bool:
        found = cache.cache_directory()
        new = found not in seen and found.parent == first.parent
        seen.add(found)
        return new

    forces = folder / "forces.py"
    forces.write_text(forces.read_text() + "\n")
    assert is_new(), "a changed kernel"
    added = folder / "added.py"
    added.write_text("")
    assert is_new(), "an added one, if only an empty one"
    added.rename(folder / "added_too.py")
    assert is_new(), "another name"
    (folder / "frames.py").unlink()
    assert is_new(), "one kernel less"
    for module in (numba, llvmlite):
        monkeypatch.setattr(module, "__version__", "0.0.1")
        assert is_new(), module.__name__
    monkeypatch.setattr(platform, "python_version", lambda: "3.0.1")
    assert is_new(), "another Python"
    monkeypatch.setattr(platform, "machine", lambda: "abacus")
    assert is_new(), "another kind of processor"


@pytest.fixture
def said(monkeypatch: pytest.MonkeyPatch, caplog: pytest.LogCaptureFixture) -> Callable[[], list]:
    """The lines said since the last call, as by a new process."""
    caplog.set_level(logging.INFO, cache.LOGGER)

    def lines() -> list[str]:
        found = list(caplog.messages)
        caplog.clear()
        cache._said.clear()
        return found

    lines()
    return lines


def test_compiling_is_said_once_and_loading_is_not(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, said: Callable[[], list[str]]
) -> None:
    monkeypatch.setenv("DLO_SIM_CACHE", str(tmp_path))
    first = entry(add_one)
    assert first(1.0) == 2.0 and first(1) == 2.0
    (line,) = said()
    assert line == f"compiling the step of this scene, some 10 to 30 s, kept in {tmp_path}/dlo_sim"
    again = entry(add_one)
    with cache.only_loading():
        assert again(1.0) == 2.0 and again(1) == 2.0
        assert bound(entry(add_one), 1.0)(2.0) == 3.0
    assert said() == []


def test_what_another_process_could_compile_is_left_to_it(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, said: Callable[[], list[str]]
) -> None:
    monkeypatch.setenv("DLO_SIM_CACHE", str(tmp_path))
    function = entry(add_one)
    for call in (function, lambda x: bound(function, x)):
        with pytest.raises(cache.NotCompiledError, match="add_one"), cache.only_loading():
            call(1.0)
    assert said() == [] and not list(tmp_path.rglob("*.nbc"))
    with cache.only_loading():
        other = threading.Thread(target=function, args=(1.0,))
        other.start()
        other.join()
    assert len(said()) == 1, "another thread is free to compile"
    assert function(1) == 2.0, "and so is this one afterwards"


def test_a_directory_that_cannot_be_written(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, said: Callable[[], list[str]]
) -> None:
    (tmp_path / "dlo_sim").write_text("a file where the directory would be")
    monkeypatch.setenv("DLO_SIM_CACHE", str(tmp_path))
    function = entry(add_one)
    with cache.only_loading():
        assert function(1.0) == 2.0, "nobody else can do it"
    (line,) = said()
    assert "at every start" in line and "DLO_SIM_CACHE" in line


def test_a_directory_that_can_only_be_read_is_read(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, said: Callable[[], list[str]]
) -> None:
    monkeypatch.setenv("DLO_SIM_CACHE", str(tmp_path))
    assert entry(add_one)(1.0) == 2.0
    said()

    def refuse(*arguments: object, **options: object) -> None:
        raise PermissionError("read-only")

    monkeypatch.setattr("tempfile.TemporaryFile", refuse)
    with cache.only_loading():
        function = entry(add_one)
        assert function(1.0) == 2.0
        assert said() == []
        assert function(1) == 2.0, "nobody else can compile what is missing"
    (line,) = said()
    assert "at every start" in line and "DLO_SIM_CACHE" in line


def test_a_disk_that_is_full_afterwards(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("DLO_SIM_CACHE", str(tmp_path))
    function = entry(add_one)
    shutil.rmtree(tmp_path / "dlo_sim")
    (tmp_path / "dlo_sim").write_text("")
    assert function(1.0) == 2.0
