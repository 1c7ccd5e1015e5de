"""The files of bags: what `metadata.yaml` promises, and the data files, MCAP and sqlite3, packed or
not, one message after the other, without any index.

A file may be cut off, damaged or made to do harm, so nothing that it says is believed unseen: it is
unpacked piece by piece, nothing is kept that is longer than a message or a name can be, and the
work is bounded by the size of the file. Nothing is guessed: what is not whole is left out.
"""

from __future__ import annotations

import io
import os
import shutil
import sqlite3
import struct
import sys
import tempfile
import zlib
from collections.abc import Callable, Collection, Iterator, Mapping
from importlib import import_module
from pathlib import Path
from typing import Any, BinaryIO, NamedTuple, cast

from dlo_sim.scene.plain_yaml import FileRefused, parse_yaml, read_text
from dlo_sim.scene.refusal import brief

LONGEST = 1 << 20  # bytes; of a longer message the first so many
_LONGEST_NAME = 1000

_MAGIC = b"\x89MCAP0\r\n"
_FOOTER, _SCHEMA, _CHANNEL, _MESSAGE, _CHUNK, _DATA_END = 0x02, 0x03, 0x04, 0x05, 0x06, 0x0F
_HEAD = struct.Struct("<BQ")
# Both come with the bag library.
_ZSTD = "compression.zstd" if sys.version_info >= (3, 14) else "backports.zstd"
_UNPACKERS = {"zstd": _ZSTD, "lz4": "lz4.frame"}
_PIECE = 1 << 16  # bytes read at once of what is skipped
_LARGEST_CHUNK = 1 << 30  # bytes, packed; writers make chunks of a few megabytes

# What reading a file may cost: its records with so many bytes for each, unpacked, against the
# size of the file. Black pictures stay below the ratio, and so does the shortest of messages.
_PER_RECORD = 4096
_LEAST_WORK, _MOST_RATIO = 1 << 28, 1000

SUFFIXES = (".mcap", ".db3")
_PACKED = ".zstd"  # behind one of them: the whole file is packed
_PACKED_MESSAGE = b"\x28\xb5\x2f\xfd"  # begins a packed message; no serialised one does

_SQLITE_STEPS = 1_000_000  # of its machine, and one more per byte of the file; a row needs 10 to 20


_METADATA = "metadata.yaml"
_NEWEST = 9
# What is packed: nothing, the data files as a whole, each message, or chunks of an MCAP file.
_MODES = ("none", "file", "message", "storage")
# A recording of hundreds of topics names the quality of service of each of their publishers.
_MOST_VALUES = 100_000
# Key -> type of what every version holds.
_METADATA_KEYS: dict[str, type] = {
    "version": int,
    "storage_identifier": str,
    "relative_file_paths": list,
    "duration.nanoseconds": int,
    "starting_time.nanoseconds_since_epoch": int,
    "message_count": int,
    "topics_with_message_count": list,
}
_TYPES = {int: "a whole number", str: "a text", list: "a list"}


class DamagedFile(Exception):
    """A file cannot be read any further; one line says why."""


class Record(NamedTuple):
    """Topic, type, time of recording [ns], serialised message."""

    topic: str
    type: str
    time_ns: int
    data: bytes


Note = Callable[[str], None]
Wanted = Collection[tuple[str, str]] | None


def records(path: Path, wanted: Wanted, note: Note) -> Iterator[Record]:
    """Every whole message that can be read of a data file, in the order of writing.

    Args:
        path: the file.
        wanted: topics and types; None = all, with empty data.
        note: called with what is wrong, one line, as often as something is.
    """
    try:
        if path.suffix == _PACKED:
            with tempfile.TemporaryDirectory(prefix="dlo_sim_") as folder:
                whole = Path(folder, path.stem)
                try:
                    _unpack(path, whole)
                except DamagedFile as damage:  # what comes before may be whole
                    note(f"{path.name} {damage}")
                yield from records(whole, wanted, note)
        elif path.suffix == ".db3":
            yield from _sqlite3_records(path, wanted, note)
        else:
            with path.open("rb") as file:
                yield from _Mcap(file, wanted, note).records()
    except DamagedFile as damage:
        note(f"{path.name} {damage}")
    except OSError as error:
        note(f"{path.name} cannot be read: {error.strerror}")


def is_data_file(path: Path) -> bool:
    """Whether a path has the name of a file with messages, such as `x.mcap` or `x.db3.zstd`."""
    name = path.with_suffix("") if path.suffix == _PACKED else path
    return name.suffix in SUFFIXES


def is_mcap(path: Path) -> bool:
    """Whether a data file is an MCAP file, packed or not."""
    return ".mcap" in path.suffixes[-2:]


def _unpack(path: Path, whole: Path) -> None:
    """Unpack a whole file as far as it goes.

    Raises:
        DamagedFile: it is damaged, unpacks to too much, or there is no room for it.
    """
    left = _LEAST_WORK + _MOST_RATIO * path.stat().st_size
    with path.open("rb") as file, whole.open("wb") as out:
        source = unpacked("zstd", file)
        while True:
            try:
                data = source.read(_PIECE)
            except Exception as error:  # the decompressor's own errors
                raise DamagedFile(f"cannot be unpacked to its end: {error}") from None
            left -= len(data)
            if left < 0:
                raise DamagedFile("unpacks to far more than a recording of its size can hold")
            try:
                out.write(data)
            except OSError as error:
                raise DamagedFile(
                    f"cannot be unpacked in {whole.parent.parent} ({error.strerror}); free space "
                    "or set TMPDIR"
                ) from None
            if not data:
                return


def is_packed(data: bytes) -> bool:
    """Whether a message is packed; a bag without metadata does not say so."""
    return data.startswith(_PACKED_MESSAGE)


def unpacked_message(data: bytes) -> bytes:
    """A packed message as it was.

    Raises:
        DamagedFile: it cannot be unpacked.
    """
    try:
        return unpacked("zstd", io.BytesIO(data)).read(LONGEST)
    except Exception as error:  # the decompressor's own errors
        raise DamagedFile(f"cannot be unpacked: {error}") from None


def unpacked(compression: str, file: BinaryIO) -> BinaryIO:
    """A packed file as it was, unpacked as it is read.

    Raises:
        DamagedFile: nothing here unpacks this.
    """
    if compression not in _UNPACKERS:
        raise DamagedFile(f"uses unsupported compression {compression[:20]!r}")
    return cast(BinaryIO, import_module(_UNPACKERS[compression]).open(file))


class _Bytes:
    """So many bytes of a file, taken in order.

    Args:
        checked: read also what is skipped, for the checksum and to see whether it is there.
    """

    def __init__(self, file: BinaryIO, size: int, checked: bool) -> None:
        self.left, self.checksum = size, 0
        self._file, self._checked = file, checked

    def take(self, size: int) -> bytes:
        """The next bytes, all of them."""
        self._leave(size)
        try:
            data = self._file.read(size)
        except Exception as error:  # each decompressor has its own errors
            raise DamagedFile(f"cannot be unpacked: {error}") from None
        if len(data) != size:
            raise DamagedFile("is cut off")
        if self._checked:
            self.checksum = zlib.crc32(data, self.checksum)
        return data

    def skip(self, size: int) -> None:
        """Leave the next bytes out."""
        if self._checked:
            for at in range(0, size, _PIECE):
                self.take(min(_PIECE, size - at))
        else:
            self._leave(size)
            self._file.seek(size, io.SEEK_CUR)

    def text(self) -> str:
        """The next bytes as a text with its length in front."""
        (size,) = struct.unpack("<I", self.take(4))
        data = self.take(min(size, _LONGEST_NAME + 1))
        if size > _LONGEST_NAME or not data.isascii():
            raise DamagedFile("is damaged: invalid string")
        return data.decode()

    def _leave(self, size: int) -> None:
        if size > self.left:
            raise DamagedFile("is cut off or damaged: a record is longer than what is left")
        self.left -= size


class _Mcap:
    """An MCAP file being scanned: its schemas and channels so far."""

    def __init__(self, file: BinaryIO, wanted: Wanted, note: Note) -> None:
        self._file, self._wanted, self._note = file, wanted, note
        self._size = os.fstat(file.fileno()).st_size
        self._work = _LEAST_WORK + _MOST_RATIO * self._size
        self._schemas: dict[int, str] = {}
        self._channels: dict[int, tuple[str, str]] = {}

    def records(self) -> Iterator[Record]:
        """Messages of the data section; the summary behind it is only passed over."""
        if self._file.read(len(_MAGIC)) != _MAGIC:
            raise DamagedFile("is not an MCAP file")
        at, in_data = len(_MAGIC), True
        while True:
            self._file.seek(at)
            data = _Bytes(self._file, self._size - at, checked=False)
            kind, size = self._head(data)
            at += _HEAD.size + size
            in_data = in_data and kind != _DATA_END
            if kind == _CHUNK and in_data:
                try:
                    yield from self._chunk(data)
                except DamagedFile as damage:  # the next one may be whole
                    self._note(f"chunk before byte {at} {damage}")
            elif in_data and (record := self._record(kind, size, data)):
                yield record
            if kind == _FOOTER and at + len(_MAGIC) == self._size:
                return
            if at > self._size or kind == _FOOTER:
                raise DamagedFile("is cut off or damaged: it does not end with its footer")

    def _head(self, data: _Bytes) -> tuple[int, int]:
        kind, size = _HEAD.unpack(data.take(_HEAD.size))
        if kind == 0:
            raise DamagedFile("is damaged: record with opcode 0")
        self._work -= _PER_RECORD + min(size, data.left)
        if self._work < 0:
            raise DamagedFile("unpacks to far more than a recording of its size can hold")
        return kind, size

    def _chunk(self, data: _Bytes) -> Iterator[Record]:
        """Messages in a chunk, as far as it goes."""
        _, _, size, checksum = struct.unpack("<QQQI", data.take(28))
        compression = data.text()
        (packed,) = struct.unpack("<Q", data.take(8))
        if compression == "":
            inside = _Bytes(self._file, min(size, data.left), checked=checksum != 0)
        else:
            part = io.BytesIO(self._file.read(min(packed, data.left, _LARGEST_CHUNK)))
            inside = _Bytes(unpacked(compression, part), size, checked=True)
        while inside.left:
            record = self._record(*self._head(inside), inside)
            if record:
                yield record
        if checksum and inside.checksum != checksum:
            raise DamagedFile("does not have its checksum: some message in it is not as recorded")

    def _record(self, kind: int, size: int, data: _Bytes) -> Record | None:
        """Read one record of so many bytes; returns it if it is a message."""
        before, message = data.left, None
        if kind == _MESSAGE:
            channel, _, time_ns, _ = struct.unpack("<HIQQ", data.take(22))
            known = self._channels.get(channel)
            if known is None:
                self._note(f"skipped messages of undeclared channel {channel}")
            elif self._wanted is None:
                message = Record(*known, time_ns, b"")
            elif known in self._wanted:
                message = Record(*known, time_ns, data.take(min(max(size - 22, 0), LONGEST)))
        elif kind == _SCHEMA:
            (number,) = struct.unpack("<H", data.take(2))
            self._schemas[number] = data.text()
        elif kind == _CHANNEL:
            number, schema = struct.unpack("<HH", data.take(4))
            self._channels[number] = (data.text(), self._schemas.get(schema, ""))
        elif kind == _CHUNK:
            self._note("a chunk within a chunk is left out")
        rest = size - (before - data.left)
        if rest < 0:
            raise DamagedFile("is damaged: a record is shorter than what it holds")
        data.skip(rest)
        return message


def _sqlite3_records(path: Path, wanted: Wanted, note: Note) -> Iterator[Record]:
    """Rows of a database without its last page, if that page is not whole.

    The database would be read as if zeros followed, which makes false messages, not missing ones.
    """
    size = path.stat().st_size
    with path.open("rb") as file:
        head = file.read(32)
    page = int.from_bytes(head[16:18], "big")
    page = 65536 if page == 1 else page
    if not head.startswith(b"SQLite format 3\x00") or len(head) < 32 or not page or size < page:
        raise DamagedFile("is not an sqlite3 file")
    if size % page == 0:
        yield from _rows(path, size, wanted, note)
    else:
        with tempfile.TemporaryDirectory(prefix="dlo_sim_") as folder:
            whole = Path(shutil.copy(path, folder))
            os.truncate(whole, size - size % page)
            yield from _rows(whole, size, wanted, note)
    if size < page * int.from_bytes(head[28:32], "big"):
        raise DamagedFile("is cut off")


def _rows(path: Path, size: int, wanted: Wanted, note: Note) -> Iterator[Record]:
    connection = sqlite3.connect(f"{path.resolve().as_uri()}?mode=ro&immutable=1", uri=True)
    steps = iter(range((_SQLITE_STEPS + size) // 1000))
    try:
        connection.set_progress_handler(lambda: next(steps, None) is None, 1000)
        connection.setlimit(sqlite3.SQLITE_LIMIT_LENGTH, 64 * LONGEST)
        connection.text_factory = lambda text: text.decode("utf-8", "replace")
        # A file shorter than its header says is refused as a whole, unless the schema may be
        # repaired.
        connection.execute("PRAGMA writable_schema=ON")
        connection.execute("PRAGMA trusted_schema=OFF")
        tables = "SELECT name FROM sqlite_master WHERE type = 'table'"
        if not {("topics",), ("messages",)} <= set(connection.execute(tables)):
            raise DamagedFile("has no table of topics and messages")
        topics = {
            number: (name, kind)
            for number, name, kind in connection.execute("SELECT id, name, type FROM topics")
        }
        # Without contents, the pages of long messages are not read.
        data = "X''" if wanted is None else f"substr(data, 1, {LONGEST})"
        rows = f"SELECT topic_id, timestamp, typeof(data), {data} FROM messages NOT INDEXED"
        for number, time_ns, kind, data in connection.execute(rows):
            if number not in topics or kind != "blob":
                note("messages without a topic or with data of another type are left out")
            elif wanted is None or topics[number] in wanted:
                yield Record(*topics[number], time_ns, data or b"")  # no bytes come as None
    except sqlite3.Error as error:
        raise DamagedFile(f"is damaged: {error}") from None
    finally:
        connection.close()


class Metadata(NamedTuple):
    """Number of messages, names of the data files, whether each message is packed (zstd)."""

    message_count: int
    files: tuple[str, ...]
    packed_messages: bool


def read_metadata(folder: Path) -> Metadata:
    """The metadata of a bag.

    Raises:
        DamagedFile: they are missing or not what they should be; names the key and the value.
    """
    try:
        document = parse_yaml(read_text(folder / _METADATA), most_values=_MOST_VALUES)
    except FileRefused as error:
        raise DamagedFile(f"{_METADATA} {error.problem}") from None
    found = _value(document, "rosbag2_bagfile_information")
    if not isinstance(found, Mapping):
        raise DamagedFile(f"{_METADATA} holds no rosbag2_bagfile_information")
    values = {key: _value(found, key) for key in _METADATA_KEYS}
    for key, value in values.items():
        kind = _METADATA_KEYS[key]
        if not isinstance(value, kind) or isinstance(value, bool):
            raise DamagedFile(f"{_METADATA}: {key}: {brief(value)} is not {_TYPES[kind]}")
    if values["version"] > _NEWEST:
        raise DamagedFile(f"{_METADATA}: version: {values['version']} is newer than {_NEWEST}")
    mode = str(found.get("compression_mode") or "none").lower()
    packing = found.get("compression_format") if mode != "none" else "zstd"
    for key, value, known in (("mode", mode, _MODES), ("format", packing, ("zstd",))):
        if value not in known:
            raise DamagedFile(f"{_METADATA}: compression_{key}: {brief(value)} is not supported")
    files = tuple(Path(str(name)).name for name in values["relative_file_paths"])
    return Metadata(values["message_count"], files, mode == "message")


def _value(found: Any, keys: str) -> Any:
    """The value at keys with dots between them; None if there is none."""
    for key in keys.split("."):
        found = found.get(key) if isinstance(found, Mapping) else None
    return found
