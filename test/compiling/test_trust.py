"""Machine code is run, so it is only loaded from where nobody else can have put it."""

from __future__ import annotations

import hashlib
import logging
import os
import pickle
from collections.abc import Iterator
from pathlib import Path

import pytest
from numba import float64

from dlo_sim.compiling import directory
from dlo_sim.compiling.kernels import kernel

ANOTHER = 12345  # a user and a group without a name
as_root = pytest.mark.skipif(os.geteuid() != 0, reason="only root gives files to other users")


def add_one(x: float) -> float:
    return x + 1.0


@pytest.fixture
def home(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """A directory of this user's own that is named as the place of machine code."""
    monkeypatch.setenv("DLO_SIM_CACHE", str(tmp_path / "home"))
    monkeypatch.setattr(directory, "_said", set())
    (tmp_path / "home").mkdir(mode=0o755)
    return tmp_path / "home"


@pytest.fixture
def kept(home: Path) -> Path:
    """The file with the machine code of `add_one`, as it was left there."""
    assert kernel(float64, float64)(add_one)(1.0) == 2.0
    path = home / "dlo_sim" / directory.digest() / f"{__name__}.add_one"
    assert is_loaded()
    return path


def is_loaded() -> bool:
    """Whether a new process would take the machine code from disk."""
    function = kernel(float64, float64)(add_one)
    assert function(1.0) == 2.0
    return sum(function.code().stats.cache_hits.values()) == 1


class Trap:
    """Leaves a file behind when it is unpickled."""

    def __init__(self, mark: Path) -> None:
        self.mark = mark

    def __reduce__(self) -> tuple[object, ...]:
        return Path.touch, (self.mark,)


def open_directory(path: Path) -> Path:
    path.parents[1].chmod(0o777)
    return path.parents[1]


def open_for_new_files_only(path: Path) -> Path:
    path.parent.chmod(0o1777)
    return path.parent


def another_group(path: Path) -> Path:
    os.chown(path.parents[1], -1, ANOTHER)
    path.parents[1].chmod(0o775)
    return path.parents[1]


def another_users_directory(path: Path) -> Path:
    os.chown(path.parents[1], ANOTHER, ANOTHER)
    return path.parents[1]


def another_users_file(path: Path) -> Path:
    os.chown(path, ANOTHER, ANOTHER)
    return path


def open_file(path: Path) -> Path:
    path.chmod(0o666)
    return path


def linked_file(path: Path) -> Path:
    path.rename(path.with_suffix(".elsewhere"))
    path.symlink_to(path.with_suffix(".elsewhere"))
    return path


@pytest.mark.parametrize(
    "expose",
    [
        open_directory,
        open_for_new_files_only,
        open_file,
        linked_file,
        *(
            pytest.param(change, marks=as_root)
            for change in (another_group, another_users_directory, another_users_file)
        ),
    ],
)
def test_what_another_user_can_have_planted_is_not_run(
    kept: Path, tmp_path: Path, caplog: pytest.LogCaptureFixture, expose: object
) -> None:
    content = pickle.dumps(Trap(tmp_path / "sprung"))
    planted = hashlib.sha256(content).digest() + content
    kept.write_bytes(planted)
    place = expose(kept)  # type: ignore[operator]
    caplog.set_level(logging.INFO, directory.LOGGER)
    caplog.clear()
    directory._said.clear()
    for _ in range(2):
        assert kernel(float64, float64)(add_one)(1.0) == 2.0
    assert not (tmp_path / "sprung").exists()
    (line,) = caplog.messages
    if place == kept:  # the directory is good: the file is replaced
        assert "kept in" in line and is_loaded()
    else:
        assert str(place) in line and "DLO_SIM_CACHE" in line
        assert kept.read_bytes() == planted, "nothing is left there either"
        assert [path.name for path in kept.parent.iterdir()] == [kept.name]


def test_a_link_to_another_place_is_judged_by_that_place(
    kept: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    (tmp_path / "link").symlink_to(kept.parents[2])
    monkeypatch.setenv("DLO_SIM_CACHE", str(tmp_path / "link"))
    assert is_loaded()
    kept.parents[1].chmod(0o777)
    assert not is_loaded()


@pytest.fixture
def without_umask() -> Iterator[None]:
    before = os.umask(0)
    yield
    os.umask(before)


def test_what_is_made_is_good_whatever_the_process_lets_others_do(
    without_umask: None, kept: Path
) -> None:
    assert {path.stat().st_mode & 0o777 for path in kept.parents[1].rglob("*.add_one")} == {0o644}
