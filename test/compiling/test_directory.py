"""Machine code on disk: never of another version, made again if damaged, and said when missing."""

from __future__ import annotations

import logging
import os
import platform
import pwd
import random
import shutil
import tempfile
from collections.abc import Callable
from pathlib import Path

import llvmlite
import numba
import pytest
from numba import float64

from dlo_sim.compiling import directory
from dlo_sim.compiling.kernels import Kernel, kernel
from dlo_sim.doctor.findings import installation
from test.disks import mounted

NAME = f"{__name__}.add_one"


def add_one(x: float) -> float:
    return x + 1.0


def add_two(x: float) -> float:
    return x + 2.0


def fresh() -> Kernel:
    """`add_one` as a new process would have it."""
    return kernel(float64, float64)(add_one)


@pytest.fixture
def said(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, caplog: pytest.LogCaptureFixture
) -> Callable[[], list[str]]:
    """The lines said since the last call, as by a new process with an empty directory."""
    monkeypatch.setenv("DLO_SIM_CACHE", str(tmp_path))
    caplog.set_level(logging.INFO, directory.LOGGER)

    def lines() -> list[str]:
        found = list(caplog.messages)
        caplog.clear()
        directory._said.clear()
        return found

    lines()
    return lines


def test_kernels_that_share_the_directory_of_numba_are_kept_apart(said, tmp_path: Path) -> None:
    with directory.many_kept():
        for function in (add_one, add_two):
            assert kernel(float64, float64)(function)(1.0) == function(1.0)
    kept = tmp_path / "dlo_sim" / directory.digest()
    one, two = (directory._read(kept / f"{__name__}.{name}") for name in ("add_one", "add_two"))
    assert one and two and not one.keys() & two.keys()
    assert not directory._shared


def test_another_directory_for_other_sources_and_another_compiler(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    package = tmp_path / "dlo_sim"
    shutil.copytree(Path(directory.__file__).parents[1], package)
    digest = directory.digest.__wrapped__
    seen = {digest()}

    def is_new() -> bool:
        found = digest()
        assert found == digest()
        new = found not in seen
        seen.add(found)
        return new

    monkeypatch.setattr(directory, "__file__", str(package / "compiling" / "directory.py"))
    assert is_new(), "another installation"
    for room in directory.COMPILED_ROOMS:
        added = package / room / "added.py"
        added.write_text("")
        assert is_new(), "an added file, if only an empty one"
        added.write_text("\n")
        assert is_new(), "a changed one"
        added.rename(added.with_name("added_too.py"))
        assert is_new(), "another name"
    (package / "engine" / "frames.py").unlink()
    assert is_new(), "one file less"
    for module in (numba, llvmlite):
        monkeypatch.setattr(module, "__version__", "0.0.1")
        assert is_new(), module.__name__
    monkeypatch.setattr(platform, "python_version", lambda: "3.0.1")
    assert is_new(), "another Python"
    monkeypatch.setattr(platform, "machine", lambda: "abacus")
    assert is_new(), "another kind of machine"
    monkeypatch.setattr(directory, "get_host_cpu_name", lambda: "babbage")
    assert is_new(), "another processor"


def test_compiling_is_said_once_and_loading_is_not(
    tmp_path: Path, said: Callable[[], list[str]]
) -> None:
    before = numba.config.CACHE_DIR
    for _ in range(2):
        assert fresh()(1.0) == 2.0
    (line,) = said()
    assert line == f"compiling, once per installation, some 25 s, kept in {tmp_path}/dlo_sim"
    assert numba.config.CACHE_DIR == before, "the user's setting"
    loaded = fresh()
    assert loaded(1.0) == 2.0 and sum(loaded.code().stats.cache_hits.values()) == 1
    assert said() == []


def test_who_is_told_is_told_no_more_afterwards(
    tmp_path: Path, said: Callable[[], list[str]]
) -> None:
    told: list[str] = []
    level = logging.getLogger(directory.LOGGER).level
    with directory.compiling_told_to(told.append):
        fresh()(1.0)
    assert told == said()
    shutil.rmtree(tmp_path / "dlo_sim")
    fresh()(1.0)
    assert len(told) == 1
    assert logging.getLogger(directory.LOGGER).level == level


def test_a_directory_that_cannot_be_written(tmp_path: Path, said: Callable[[], list[str]]) -> None:
    (tmp_path / "dlo_sim").write_text("a file where the directory would be")
    assert fresh()(1.0) == fresh()(1.0) == 2.0
    (line,) = said()
    assert "at every start" in line and "DLO_SIM_CACHE" in line


def test_a_directory_that_can_only_be_read_is_read(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, said: Callable[[], list[str]]
) -> None:
    assert fresh()(1.0) == 2.0
    said()
    real = tempfile.TemporaryFile

    def refuse(*, dir: object) -> object:
        if str(dir).startswith(str(tmp_path)):
            raise PermissionError(13, "read-only")
        return real(dir=dir)

    monkeypatch.setattr(tempfile, "TemporaryFile", refuse)
    assert fresh()(1.0) == 2.0
    assert said() == []
    assert kernel(float64, float64)(add_two)(1.0) == 3.0, "what is missing is compiled"
    (line,) = said()
    assert "at every start" in line and "DLO_SIM_CACHE" in line


@pytest.mark.parametrize("everywhere", [False, True])
def test_a_disk_that_is_full(
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
    said: Callable[[], list[str]],
    everywhere: bool,
) -> None:
    real = os.replace

    def refuse(source: object, target: object) -> None:
        if everywhere or str(target).startswith(str(tmp_path)):
            raise OSError(28, "No space left on device")
        real(source, target)  # type: ignore[call-overload]

    monkeypatch.setattr(os, "replace", refuse)
    assert fresh()(1.0) == 2.0
    assert not [path for path in tmp_path.rglob("*") if path.is_file()], "nothing half written"
    line = said()[-1]
    assert line.startswith("compiling, at every start: ") and "No space left on device" in line
    assert "free space there, or set DLO_SIM_CACHE" in line


def test_temporary_files_without_room_are_not_needed(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, said: Callable[[], list[str]]
) -> None:
    full = tmp_path / "full"
    full.mkdir()
    with mounted(full, 16_384):
        monkeypatch.setattr(tempfile, "tempdir", str(full))
        assert fresh()(1.0) == 2.0
        (line,) = said()
        assert "once per installation" in line
        loaded = fresh()
        assert loaded(1.0) == 2.0 and sum(loaded.code().stats.cache_hits.values()) == 1
        assert said() == []
        kept = directory.base_directory() / directory.digest()
        assert [path.name for path in kept.iterdir()] == [NAME], "no private directory is left"
        with mounted(kept, 4096):
            kept.chmod(0o755)
            assert kernel(float64, float64)(add_two)(1.0) == 3.0
            assert any("at every start" in line and "No space left" in line for line in said())


@pytest.mark.parametrize("base", ["~nobody_of_that_name/cache", "~/cache", "loop/cache"])
def test_a_directory_that_cannot_be_is_said_in_one_line(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, said: Callable[[], list[str]], base: str
) -> None:
    """An unknown user, no home directory, symbolic links in a circle."""
    (tmp_path / "loop").symlink_to("loop")
    monkeypatch.delenv("HOME", raising=False)
    monkeypatch.setattr(pwd, "getpwuid", {}.__getitem__)
    monkeypatch.chdir(tmp_path)
    monkeypatch.setenv("DLO_SIM_CACHE", base)
    assert fresh()(1.0) == 2.0
    (line,) = said()
    assert line.startswith("compiling, at every start: ") and line.isprintable()
    assert base.split("/")[0] in line and "set DLO_SIM_CACHE to a directory of your own" in line
    findings = [finding.what for finding in installation()]
    assert sum("every start compiles" in text for text in findings) == 1


def test_a_damaged_file_is_not_loaded_and_is_replaced(said: Callable[[], list[str]]) -> None:
    assert fresh()(1.0) == 2.0
    path = directory.base_directory() / directory.digest() / NAME
    good = path.read_bytes()
    assert directory._read(path)
    chance = random.Random(1)
    damaged = [good[: chance.randrange(len(good))] for _ in range(20)]
    for _ in range(40):
        at = chance.randrange(len(good))
        damaged.append(good[:at] + bytes([good[at] ^ 1 << chance.randrange(8)]) + good[at + 1 :])
    damaged += [b"", good + b"\0", bytes(len(good)), chance.randbytes(len(good))]
    for content in damaged:
        path.write_bytes(content)
        assert directory._read(path) == {}
    said()
    assert fresh()(1.0) == 2.0
    assert len(said()) == 1 and directory._read(path)
