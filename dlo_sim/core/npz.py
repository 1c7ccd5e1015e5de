"""Arrays from an npz file whose source may not be trusted, read within limits.

`numpy.load` allocates what the header of an array names, however short the file is, and unpacks
whatever a compressed member expands to. Here each header is checked against the size of its member,
and their sum against a limit, before anything is allocated.
"""

from __future__ import annotations

import math
import os
import stat
import zipfile
from collections.abc import Container
from io import BytesIO
from pathlib import Path
from typing import IO, Any

import numpy as np
from numpy.typing import NDArray

MOST_BYTES = 2**30  # of all arrays together
# What a value may become: 8 bytes as a double. A file of single bytes would grow by that factor.
_MOST_VALUES = MOST_BYTES // 8
_LONGEST_HEADER = 1 << 16  # numpy itself writes up to 10,000 characters
_KINDS = "biufcU"  # numbers, and the text of a saved state; who reads them refuses others by name
_COMPRESSIONS = zipfile.ZIP_STORED, zipfile.ZIP_DEFLATED  # what numpy writes
_MOST_RATIO = 1040  # of what is unpacked to the file; deflate reaches 1032
_ENCRYPTED = 1  # bit of a member's flags
_SUFFIX = ".npy"


class NpzRefused(Exception):
    """A file that is not used: one line that says why, without the file's name and the cure."""


class NpzUnreadable(NpzRefused):
    """The operating system does not let it be read; `missing`: there is no such file."""

    def __init__(self, error: OSError) -> None:
        super().__init__(f"cannot be read ({error.strerror or error})")
        self.missing = isinstance(error, FileNotFoundError)


def read_npz(path: Path, names: Container[str] | None = None) -> dict[str, NDArray[Any]]:
    """Arrays of numbers, or of text, in an npz file, by name; `names`: only these, None = all.

    Raises:
        NpzUnreadable: there is no such file, or it may not be read.
        NpzRefused: the file is not an npz, damaged, encrypted, larger than `MOST_BYTES` or not of
            numbers.
    """
    try:
        return _in_file(path, names)
    except OSError as error:
        raise NpzUnreadable(error) from None


def _in_file(path: Path, names: Container[str] | None) -> dict[str, NDArray[Any]]:
    # Non-blocking, and asked once it is open: opening a pipe would wait for its other end.
    with open(os.open(path, os.O_RDONLY | os.O_NONBLOCK), "rb") as file:
        status = os.fstat(file.fileno())
        if not stat.S_ISREG(status.st_mode):
            raise NpzRefused("is not a regular file")
        try:
            with zipfile.ZipFile(file) as archive:
                return _arrays(archive, names, min(MOST_BYTES, _MOST_RATIO * status.st_size))
        except NpzRefused:
            raise
        except Exception as error:  # zipfile, zlib and numpy raise almost anything
            what = " ".join(str(error).split())[:200] or type(error).__name__
            raise NpzRefused(f"cannot be read ({what})") from None


def _arrays(
    archive: zipfile.ZipFile, names: Container[str] | None, room: int
) -> dict[str, NDArray[Any]]:
    """The arrays of these names, of so many bytes together."""
    members = {}
    for member in archive.infolist():
        name = member.filename.removesuffix(_SUFFIX)
        if names is None or name in names:
            if name in members:
                raise NpzRefused(f"holds {_shown(name)} twice")
            members[name] = member
    left = room
    for name, member in members.items():
        left -= member.file_size
        if left < 0:
            raise NpzRefused(f"claims arrays of more than {room} bytes")
        if member.flag_bits & _ENCRYPTED:
            raise NpzRefused(f"{_shown(name)} is encrypted")
        if member.compress_type not in _COMPRESSIONS:
            raise NpzRefused(f"{_shown(name)} is compressed in a way that numpy does not write")
        with archive.open(member) as stream:
            _check_header(_shown(name), stream, member.file_size)
    arrays = {}
    for name, member in members.items():
        with archive.open(member) as stream:
            arrays[name] = np.lib.format.read_array(stream, allow_pickle=False)
    if sum(array.size for array in arrays.values()) > _MOST_VALUES:
        raise NpzRefused(f"holds more than {_MOST_VALUES} values")
    return arrays


def _check_header(name: str, stream: IO[bytes], size: int) -> None:
    """Refuse an array whose header does not agree with the size of its member [bytes]."""
    head = BytesIO(stream.read(_LONGEST_HEADER))
    version = np.lib.format.read_magic(head)
    if version == (1, 0):
        shape, _, kind = np.lib.format.read_array_header_1_0(head)
    elif version == (2, 0):
        shape, _, kind = np.lib.format.read_array_header_2_0(head)
    else:
        raise NpzRefused(f"{name} is of an npy version that does not hold plain numbers")
    if kind.kind not in _KINDS or kind.subdtype is not None or not kind.itemsize:
        raise NpzRefused(f"{name} holds {' '.join(str(kind).split())[:60]}, not numbers")
    if not all(type(extent) is int and extent >= 0 for extent in shape):
        raise NpzRefused(f"{name} has an impossible shape")
    if head.tell() + math.prod(shape) * kind.itemsize != size:
        raise NpzRefused(f"{name} does not hold what its header says")
    if 0 in shape and max(shape) > _MOST_VALUES:
        raise NpzRefused(f"{name} has an impossible shape")


def _shown(name: str) -> str:
    return "".join(c if c.isprintable() else "?" for c in name[:60])
