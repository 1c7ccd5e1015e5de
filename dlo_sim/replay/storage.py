"""The files of bags, MCAP and sqlite3, packed or not: metadata, and messages in the order of
writing.

Neither an index nor a whole file is needed: a recording that was cut off or damaged is read as far
as it goes. Unpacking stops when the result is far larger than a recording can be.
"""

from __future__ import annotations

import io
import mmap
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

from mcap.data_stream import ReadDataStream
from mcap.exceptions import McapError
from mcap.opcode import Opcode
from mcap.records import Channel, Chunk, Schema

from dlo_sim.scene.plain_yaml import FileRefused, parse_yaml, read_text
from dlo_sim.scene.refusal import brief

# Heads of records. The mcap library reads all records but messages: its 7 us for each would be a
# tenth of the time of a replay.
_HEAD, _MESSAGE = struct.Struct("<BQ"), struct.Struct("<HIQQ")
_MAGIC = b"\x89MCAP0\r\n"
_ZSTD = "compression.zstd" if sys.version_info >= (3, 14) else "backports.zstd"
_UNPACKERS = {"zstd": _ZSTD, "lz4": "lz4.frame"}  # both come with the bag library
_PIECE = 1 << 16  # bytes unpacked at once
# Limits of an unpacked file: bytes, and ratio to its own size, which black pictures do not reach.
# Chunks and messages have to fit into memory; writers make chunks of a few megabytes.
_LEAST_UNPACKED, _MOST_RATIO = 1 << 28, 1000
_LARGEST_CHUNK = 1 << 28

SUFFIXES = (".mcap", ".db3")
_PACKED = ".zstd"  # behind one of them: the whole file is packed
_PACKED_MESSAGE = b"\x28\xb5\x2f\xfd"  # begins a packed message; no serialised one does

_METADATA = "metadata.yaml"
_NEWEST = 9
_MODES = ("none", "file", "message", "storage")  # what is packed; storage: chunks of an MCAP file
_MOST_VALUES = 100_000  # of the metadata, which hold the QoS of each publisher


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
    """Every complete message that can be read of a data file, in the order of writing.

    Args:
        wanted: topics and types; None = all, with empty data.
        note: called with each problem, one line.
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
            yield from _mcap_records(path, wanted, note)
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


def is_packed(data: bytes) -> bool:
    """Whether a message is packed; a bag without metadata does not say so."""
    return data.startswith(_PACKED_MESSAGE)


def unpacked_message(data: bytes) -> bytes:
    """A message without its packing; raises DamagedFile."""
    return b"".join(_pieces("zstd", io.BytesIO(data), _LARGEST_CHUNK))


def _pieces(compression: str, packed: BinaryIO, most: int) -> Iterator[bytes]:
    """The unpacked bytes, piece by piece; DamagedFile if they are damaged or more than `most`."""
    if compression not in _UNPACKERS:
        raise DamagedFile(f"uses unsupported compression {compression[:20]!r}")
    file = import_module(_UNPACKERS[compression]).open(packed)
    while True:
        try:
            piece = file.read(_PIECE)
        except Exception as error:  # each decompressor has its own errors
            raise DamagedFile(f"cannot be unpacked to its end: {error}") from None
        if not piece:
            return
        most -= len(piece)
        if most < 0:
            raise DamagedFile("unpacks to far more than a recording of its size can hold")
        yield piece


def _unpack(path: Path, whole: Path) -> None:
    """Unpack a whole file as far as it goes; DamagedFile as `_pieces`, or if there is no room."""
    most = _LEAST_UNPACKED + _MOST_RATIO * path.stat().st_size
    with path.open("rb") as file, whole.open("wb") as out:
        for piece in _pieces("zstd", file, most):
            try:
                out.write(piece)
            except OSError as error:
                raise DamagedFile(
                    f"cannot be unpacked in {whole.parent.parent} ({error.strerror}); free space "
                    "or set TMPDIR"
                ) from None


def _mcap_records(path: Path, wanted: Wanted, note: Note) -> Iterator[Record]:
    with path.open("rb") as file:
        if file.read(len(_MAGIC)) != _MAGIC:
            raise DamagedFile("is not an MCAP file")
        with mmap.mmap(file.fileno(), 0, access=mmap.ACCESS_READ) as data:
            yield from _Mcap(wanted, note).records(data, len(_MAGIC))


class _Mcap:
    """What is known of an MCAP file: its schemas and channels so far."""

    def __init__(self, wanted: Wanted, note: Note) -> None:
        self._wanted, self._note = wanted, note
        self._schemas: dict[int, str] = {}
        self._channels: dict[int, tuple[str, str]] = {}

    def records(
        self, data: bytes | mmap.mmap, at: int = 0, in_chunk: bool = False
    ) -> Iterator[Record]:
        """Messages of a file behind its magic bytes, or of a chunk."""
        while at < len(data) or not in_chunk:
            if at + _HEAD.size > len(data):
                raise DamagedFile("is cut off or damaged: it does not end with its footer")
            kind, size = _HEAD.unpack_from(data, at)
            begin, at = at + _HEAD.size, at + _HEAD.size + size
            if kind == 0 or (at > len(data) and (kind != Opcode.CHUNK or in_chunk)):
                raise DamagedFile(f"is cut off or damaged at byte {begin}")
            if kind == Opcode.MESSAGE and size >= _MESSAGE.size:
                channel, _, time_ns, _ = _MESSAGE.unpack_from(data, begin)
                known = self._channels.get(channel)
                if known is None:
                    self._note(f"skipped messages of undeclared channel {channel}")
                elif self._wanted is None:
                    yield Record(*known, time_ns, b"")
                elif known in self._wanted:
                    yield Record(*known, time_ns, data[begin + _MESSAGE.size : at])
            elif kind == Opcode.CHUNK and not in_chunk:
                try:  # the next one may be whole
                    yield from self._chunk(data[begin:at])
                except DamagedFile as damage:
                    self._note(f"chunk before byte {at} {damage}")
            elif kind in (Opcode.SCHEMA, Opcode.CHANNEL, Opcode.CHUNK):
                self._declare(kind, data[begin:at])
            elif kind == Opcode.FOOTER and not in_chunk:
                return

    def _declare(self, kind: int, record: bytes) -> None:
        """Note a schema or a channel."""
        entry: Any = _read(Schema if kind == Opcode.SCHEMA else Channel, record)
        if kind == Opcode.SCHEMA:
            self._schemas[entry.id] = entry.name
        elif kind == Opcode.CHANNEL:
            self._channels[entry.id] = (entry.topic, self._schemas.get(entry.schema_id, ""))

    def _chunk(self, record: bytes) -> Iterator[Record]:
        """Messages in a chunk, as far as it goes."""
        chunk = _read(Chunk, record)
        data, damage = chunk.data, None
        if chunk.compression:
            pieces = []
            try:
                for piece in _pieces(chunk.compression, io.BytesIO(data), _LARGEST_CHUNK):
                    pieces.append(piece)
            except DamagedFile as trouble:
                damage = trouble
            data = b"".join(pieces)
        yield from self.records(data, in_chunk=True)
        if damage is not None:
            raise damage
        if chunk.uncompressed_crc not in (0, zlib.crc32(data)):
            raise DamagedFile("does not have its checksum: it is not as recorded, or cut off")


def _read(kind: Any, record: bytes) -> Any:
    """A record by the mcap library, which reads what was cut off as if it were shorter."""
    try:
        return kind.read(ReadDataStream(io.BytesIO(record)))
    except (McapError, struct.error, ValueError) as error:  # bytes that end, or are no text
        raise DamagedFile(f"is damaged: {type(error).__name__} in a {kind.__name__}") from None


def _sqlite3_records(path: Path, wanted: Wanted, note: Note) -> Iterator[Record]:
    """Rows of a database without its last page, if that page is not complete.

    The database would be read as if zeros followed, which gives false messages, not missing ones.
    """
    size = path.stat().st_size
    with path.open("rb") as file:
        head = file.read(32)
    page = int.from_bytes(head[16:18], "big")
    page = 65536 if page == 1 else page
    if not head.startswith(b"SQLite format 3\x00") or len(head) < 32 or not page or size < page:
        raise DamagedFile("is not an sqlite3 file")
    if size % page == 0:
        yield from _rows(path, wanted, note)
    else:
        with tempfile.TemporaryDirectory(prefix="dlo_sim_") as folder:
            whole = Path(shutil.copy(path, folder))
            os.truncate(whole, size - size % page)
            yield from _rows(whole, wanted, note)
    if size < page * int.from_bytes(head[28:32], "big"):
        raise DamagedFile("is cut off")


def _rows(path: Path, wanted: Wanted, note: Note) -> Iterator[Record]:
    connection = sqlite3.connect(f"{path.resolve().as_uri()}?mode=ro&immutable=1", uri=True)
    try:
        connection.text_factory = lambda text: text.decode("utf-8", "replace")
        # Otherwise sqlite refuses a file shorter than its header says, as the bag library does.
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
        data = "X''" if wanted is None else "data"
        rows = f"SELECT topic_id, timestamp, typeof(data), {data} FROM messages NOT INDEXED"
        for number, time_ns, kind, data in connection.execute(rows):
            if number not in topics or kind != "blob":
                note("messages without a topic or with data of another type are left out")
            elif wanted is None or topics[number] in wanted:
                yield Record(*topics[number], time_ns, data)
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
    """The metadata of a bag; raises DamagedFile if they are missing or invalid."""
    try:
        document = parse_yaml(read_text(folder / _METADATA), most_values=_MOST_VALUES)
        information: Any = cast(Mapping[str, Any], document)["rosbag2_bagfile_information"]
        version, count = int(information["version"]), int(information["message_count"])
        files = tuple(Path(str(name)).name for name in information["relative_file_paths"])
        mode = str(information.get("compression_mode") or "none").lower()
        packing = information.get("compression_format") if mode != "none" else "zstd"
    except FileRefused as error:
        raise DamagedFile(f"{_METADATA} {error.problem}") from None
    except (KeyError, TypeError, ValueError, AttributeError) as error:
        raise DamagedFile(f"{_METADATA} is damaged: {type(error).__name__} {error}") from None
    if version > _NEWEST:
        raise DamagedFile(f"{_METADATA}: version: {version} is newer than {_NEWEST}")
    for key, value, known in (("mode", mode, _MODES), ("format", packing, ("zstd",))):
        if value not in known:
            raise DamagedFile(f"{_METADATA}: compression_{key}: {brief(value)} is not supported")
    return Metadata(count, files, mode == "message")
