"""What can still be read of a bag file that was cut off: messages one after the other, without any
index.

MCAP: the records from the start of the file; in a chunk that is cut, as far as it goes. sqlite3:
the rows in the order of writing, until a page is missing. Nothing is guessed: a message that is not
whole is left out.
"""

from __future__ import annotations

import os
import shutil
import sqlite3
import struct
import sys
import tempfile
from collections.abc import Iterator
from importlib import import_module
from pathlib import Path
from typing import NamedTuple

_MAGIC = b"\x89MCAP0\r\n"
_SCHEMA, _CHANNEL, _MESSAGE, _CHUNK, _DATA_END = 0x03, 0x04, 0x05, 0x06, 0x0F
# Both decompressors come with the bag library.
_STANDARD_ZSTD = sys.version_info >= (3, 14)
_RECORD = struct.Struct("<BQ")


class Record(NamedTuple):
    """Topic, type, time of recording [ns], serialised message."""

    topic: str
    type: str
    time_ns: int
    data: bytes


def records(path: Path) -> list[Record]:
    """Every whole message that can still be read of a `.mcap` or `.db3` file, in the order of
    writing.
    """
    try:
        return list(_sqlite3_records(path) if path.suffix == ".db3" else _mcap_records(path))
    except OSError:
        return []


def _mcap_records(path: Path) -> Iterator[Record]:
    data = path.read_bytes()
    if not data.startswith(_MAGIC):
        return
    yield from _Mcap().scan(data[len(_MAGIC) :])


class _Mcap:
    """Schemas and channels met so far while scanning the records of an MCAP file."""

    def __init__(self) -> None:
        self._schemas: dict[int, str] = {}
        self._channels: dict[int, tuple[str, str]] = {}

    def scan(self, data: bytes) -> Iterator[Record]:
        """Messages of whole records; stops at the first that is cut, at nonsense or at the end of
        the data section.
        """
        at = 0
        while at + _RECORD.size <= len(data):
            kind, size = _RECORD.unpack_from(data, at)
            body = data[at + _RECORD.size : at + _RECORD.size + size]
            whole = len(body) == size
            at += _RECORD.size + size
            if kind == _DATA_END:
                return
            try:
                if kind == _CHUNK:
                    yield from self.scan(_chunk(body))
                elif not whole:
                    return
                elif kind == _MESSAGE:
                    channel, _, time_ns, _ = struct.unpack_from("<HIQQ", body)
                    if channel in self._channels:
                        yield Record(*self._channels[channel], time_ns, body[22:])
                elif kind == _SCHEMA:
                    self._schemas[int.from_bytes(body[:2], "little")] = _string(body, 2)[0]
                elif kind == _CHANNEL:
                    channel, schema = struct.unpack_from("<HH", body)
                    self._channels[channel] = (_string(body, 4)[0], self._schemas.get(schema, ""))
            except (struct.error, UnicodeDecodeError):
                return


def _string(body: bytes, at: int) -> tuple[str, int]:
    (length,) = struct.unpack_from("<I", body, at)
    return body[at + 4 : at + 4 + length].decode(), at + 4 + length


def _chunk(body: bytes) -> bytes:
    """The records in a chunk, as far as they can be unpacked."""
    compression, at = _string(body, 28)
    return _decompressed(compression, body[at + 8 :])


def _decompressed(compression: str, data: bytes) -> bytes:
    """Unpack what is there of a possibly cut stream."""
    if compression == "":
        return data
    try:
        if compression == "zstd":
            zstd = import_module("compression.zstd" if _STANDARD_ZSTD else "backports.zstd")
            return bytes(zstd.ZstdDecompressor().decompress(data))
        if compression == "lz4":
            lz4 = import_module("lz4.frame")
            return bytes(lz4.LZ4FrameDecompressor().decompress(data))
    except Exception:  # each library has its own errors for damaged data
        return b""
    return b""


def _sqlite3_records(path: Path) -> Iterator[Record]:
    """Rows of a database without its last page, if that page is not whole.

    The database would be read as if zeros followed, which makes false messages, not missing ones.
    """
    size = path.stat().st_size
    page = _page_size(path)
    if not page or size < page:
        return
    if size % page == 0:
        yield from _sqlite3_rows(path)
        return
    with tempfile.TemporaryDirectory(prefix="dlo_sim_") as folder:
        whole = Path(shutil.copy(path, folder))
        os.truncate(whole, size - size % page)
        yield from _sqlite3_rows(whole)


def _page_size(path: Path) -> int:
    """Bytes per page according to the header; 0 = this is no database."""
    with path.open("rb") as file:
        head = file.read(18)
    if not head.startswith(b"SQLite format 3\x00") or len(head) < 18:
        return 0
    size = int.from_bytes(head[16:18], "big")
    return 65536 if size == 1 else size


def _sqlite3_rows(path: Path) -> Iterator[Record]:
    connection = sqlite3.connect(f"{path.resolve().as_uri()}?mode=ro&immutable=1", uri=True)
    try:
        # A file shorter than its header says is refused as a whole, unless the schema may be
        # repaired.
        connection.execute("PRAGMA writable_schema=ON")
        topics = {
            number: (name, kind)
            for number, name, kind in connection.execute("SELECT id, name, type FROM topics")
        }
        rows = connection.execute(
            "SELECT topic_id, timestamp, data FROM messages NOT INDEXED ORDER BY id"
        )
        for number, time_ns, data in rows:
            if number in topics and isinstance(data, bytes):
                yield Record(*topics[number], time_ns, data)
    except sqlite3.Error:
        return
    finally:
        connection.close()
