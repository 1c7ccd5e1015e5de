"""Arrays from files that are not what they seem."""

from __future__ import annotations

import io
import os
import struct
import tracemalloc
import zipfile
from pathlib import Path

import numpy as np
import pytest

from dlo_sim.core import npz
from dlo_sim.core.npz import NpzRefused, read_npz
from dlo_sim.identification.measurement import MeasurementError
from dlo_sim.identification.readers import read_recordings
from dlo_sim.replay.planned import PlanError, read_plan
from dlo_sim.scene.loading import scene_from_values
from dlo_sim.scene.refusal import SceneError
from dlo_sim.session.saved_state import load_state
from dlo_sim.view.run import RunError, read_run

SCENE = scene_from_values({"cable.length": 0.4})
MEMORY = 40_000_000  # bytes; of what is read below, nothing is larger than a megabyte


def member(shape: str, kind: str = "'<f8'", data: bytes = b"", order: str = "False") -> bytes:
    """An array as numpy writes it, with any header in front of any data."""
    head = f"{{'descr': {kind}, 'fortran_order': {order}, 'shape': {shape}, }}\n".encode()
    return b"\x93NUMPY\x01\x00" + struct.pack("<H", len(head)) + head + data


def zipped(content: bytes, compression: int = zipfile.ZIP_DEFLATED, name: str = "times") -> bytes:
    """An npz that holds one array under a name."""
    file = io.BytesIO()
    with zipfile.ZipFile(file, "w", compression) as archive:
        archive.writestr(f"{name}.npy", content)
    return file.getvalue()


def encrypted() -> bytes:
    """Both flags of the only member say that it is."""
    data = bytearray(zipped(member("(1,)", data=bytes(8)), zipfile.ZIP_STORED))
    for mark, offset in ((b"PK\x03\x04", 6), (b"PK\x01\x02", 8)):
        data[data.index(mark) + offset] |= 1
    return bytes(data)


def declared(size: int) -> bytes:
    """The directory says that the only member has so many bytes."""
    data = bytearray(zipped(member(f"({size // 8},)"), zipfile.ZIP_STORED))
    head = len(member(f"({size // 8},)"))
    at = data.index(b"PK\x01\x02") + 24
    data[at : at + 4] = struct.pack("<I", size + head)
    return bytes(data)


def twice() -> bytes:
    file = io.BytesIO()
    with zipfile.ZipFile(file, "w") as archive:
        archive.writestr("times.npy", member("(1,)", data=bytes(8)))
        archive.writestr("times", member("(1,)", data=bytes(8)))
    return file.getvalue()


CRAFTED = {
    "a header that names memory": zipped(member("(1000000000000,)"), zipfile.ZIP_STORED),
    "a directory that names memory": declared(800_000_000),
    "a directory that names more": declared(4_000_000_000),
    "no values in an endless shape": zipped(member("(0, 1000000000000)")),
    "values without size": zipped(member("(1000000000000,)", "'<U0'")),
    "bool shape": zipped(member("(True,)", data=bytes(8))),
    "negative shape": zipped(member("(-1,)", data=bytes(8))),
    "negative shapes": zipped(member("(-1, -1)", data=bytes(8))),
    "text for a shape": zipped(member("'3'", data=bytes(8))),
    "more data than the shape": zipped(member("(1,)", data=bytes(16))),
    "objects": zipped(member("(1,)", "'|O'", data=b"\x80\x04N.")),
    "times of days": zipped(member("(1,)", "'<M8[D]'", data=bytes(8))),
    "records": zipped(member("(1,)", "[('a', '<f8')]", data=bytes(8))),
    "arrays of arrays": zipped(member("(1,)", "('<f8', (1,))", data=bytes(8))),
    "a kind that is none": zipped(member("(1,)", "'<q9'", data=bytes(8))),
    "deep nesting": zipped(member("(" * 3000 + ")" * 3000)),
    "a header of 60 MB": zipped(
        b"\x93NUMPY\x02\x00" + struct.pack("<I", 60_000_000) + b" " * 60_000_000
    ),
    "another version": zipped(b"\x93NUMPY\x07\x00" + bytes(20)),
    "no magic": zipped(b"hello"),
    "an empty member": zipped(b""),
    "encrypted": encrypted(),
    "bzip2": zipped(member("(1,)", data=bytes(8)), zipfile.ZIP_BZIP2),
    "lzma": zipped(member("(1,)", data=bytes(8)), zipfile.ZIP_LZMA),
    "one name twice": twice(),
    "no zip": b"PK\x03\x04 and so on",
    "nothing": b"",
    "npy": member("(1,)", data=bytes(8)),
    "cut off": zipped(member("(1,)", data=bytes(8)))[:-9],
    "wrong sum": zipped(member("(1,)", data=bytes(8)), zipfile.ZIP_STORED).replace(
        b"}\n" + bytes(8), b"}\n" + bytes(7) + b"\1"
    ),
}


@pytest.fixture(params=CRAFTED)
def crafted(request, tmp_path):
    path = tmp_path / "made.npz"
    path.write_bytes(CRAFTED[request.param])
    return path


def test_crafted_file_is_refused_in_one_line_and_in_little_memory(crafted):
    tracemalloc.start()
    try:
        with pytest.raises(NpzRefused) as refused:
            read_npz(crafted)
        peak = tracemalloc.get_traced_memory()[1]
    finally:
        tracemalloc.stop()
    assert str(refused.value).isprintable() and len(str(refused.value)) < 300
    assert peak < MEMORY


@pytest.mark.parametrize(
    ("read", "refusal", "name"),
    [
        (lambda path: read_run(path), RunError, "time"),
        (lambda path: read_plan(path, SCENE), PlanError, "times"),
        (lambda path: read_recordings(path), MeasurementError, "pos_um"),
        (lambda path: load_state(path, SCENE), SceneError, "head"),
    ],
)
@pytest.mark.parametrize("content", CRAFTED)
def test_every_reader_refuses_it_with_its_name_and_a_cure(tmp_path, read, refusal, name, content):
    path = tmp_path / "made.npz"
    path.write_bytes(CRAFTED[content].replace(b"times", name.encode().ljust(5, b"_")[:5]))
    with pytest.raises(refusal) as refused:
        read(path)
    line = str(refused.value)
    assert str(path) in line and "; " in line and line.isprintable()


def test_bomb_is_refused_before_it_is_unpacked(tmp_path, monkeypatch):
    monkeypatch.setattr(npz, "MOST_BYTES", 10_000_000)
    path = tmp_path / "bomb.npz"
    path.write_bytes(zipped(member("(2500000,)", data=bytes(20_000_000))))
    assert path.stat().st_size < 30_000
    tracemalloc.start()
    with pytest.raises(NpzRefused, match="claims arrays of more than 10000000 bytes"):
        read_npz(path)
    assert tracemalloc.get_traced_memory()[1] < 1_000_000
    tracemalloc.stop()


def test_small_values_count_as_what_they_become(tmp_path, monkeypatch):
    monkeypatch.setattr(npz, "_MOST_VALUES", 1000)
    path = tmp_path / "bytes.npz"
    np.savez_compressed(path, times=np.zeros(1001, dtype=bool))
    with pytest.raises(NpzRefused, match="holds more than 1000 values"):
        read_npz(path)


def test_pipe_does_not_block(tmp_path):
    os.mkfifo(tmp_path / "pipe.npz")
    with pytest.raises(NpzRefused, match="is not a regular file"):
        read_npz(tmp_path / "pipe.npz")


@pytest.mark.parametrize("save", [np.savez, np.savez_compressed])
def test_what_numpy_writes_is_read(tmp_path, save):
    arrays = {
        "a": np.arange(12.0).reshape(3, 4),
        "fortran": np.asfortranarray(np.arange(6, dtype=">i4").reshape(2, 3)),
        "scalar": np.array(3),
        "text": np.array("{}"),
        "none": np.zeros((0, 3)),
        "flags": np.array([True, False]),
    }
    path = tmp_path / "fine.npz"
    save(path, **arrays)
    found = read_npz(Path(path))
    assert found.keys() == arrays.keys()
    for name, array in arrays.items():
        np.testing.assert_array_equal(found[name], array)
        assert found[name].dtype == array.dtype
    assert read_npz(path, ["a", "z"]).keys() == {"a"}


@pytest.mark.filterwarnings("error")
def test_long_doubles_beyond_all_doubles_are_refused_without_a_warning(tmp_path):
    path = tmp_path / "long.npz"
    np.savez(path, times=np.arange(3) * np.longdouble("1e4000"), start=np.zeros((3, 7)))
    with pytest.raises(PlanError, match="times: needs a list of finite numbers"):
        read_plan(path, SCENE)
