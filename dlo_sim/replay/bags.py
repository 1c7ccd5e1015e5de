"""Bags on disk: the only place that knows the bag library, which writes. Raw CDR in and out.

Reads rosbag2 directories and single `.mcap` or `.db3` files, also packed (`.mcap.zstd`). A bag that
was cut off or damaged is read as far as it goes; `Bag.damage` says what is wrong. Written bags hold
neither wall time nor path, so the same messages give the same bytes.
"""

from __future__ import annotations

import heapq
import os
import sqlite3
from collections.abc import Callable, Collection, Iterator, Mapping
from contextlib import ExitStack, suppress
from pathlib import Path
from shlex import quote
from typing import Literal

from rosbags.interfaces import Connection
from rosbags.rosbag2 import CompressionMode, StoragePlugin, Writer
from rosbags.rosbag2.storage_mcap import McapWriter
from rosbags.rosbag2.storage_sqlite3 import Sqlite3Writer
from rosbags.typesys import Stores, get_typestore

from dlo_sim.process.atomic_output import AtomicOutput
from dlo_sim.replay import storage
from dlo_sim.replay.storage import DamagedFile, Record
from dlo_sim.scene.refusal import one_line
from dlo_sim.session import cdr

Storage = Literal["mcap", "sqlite3"]

_PLUGINS = {"mcap": StoragePlugin.MCAP, "sqlite3": StoragePlugin.SQLITE3}
_ROS_1 = ".bag"
# Later times of recording than this, in 2038, are invalid: seconds have 32 bits in ROS.
_END_OF_TIME = (2**31 - 86_400) * 1_000_000_000
_LONGEST_LINE = 300
_MOST_TOPICS = 20  # in a message
_PER_COMMIT = 200  # messages
_DISK_ERRORS = (OSError, sqlite3.Error)
# [ns] within which messages are sorted by their recording: recorders have several threads.
_MOST_LATE = 10_000_000_000
_PROGRESS_MESSAGES = 1000
# If a recording begins before this, zero may be its first time; if later, zero is no time.
_LEAST_TIME = 1_000_000_000


class BagError(Exception):
    """A bag that cannot be read or written; one line says which and why."""


class Bag:
    """A bag for reading.

    Opening reads the whole bag once, without the contents of its messages, so that damage is known
    before anything is computed.

    Args:
        path: a rosbag2 directory, or one data file, `.mcap`, `.db3`, `.mcap.zstd` or `.db3.zstd`.
        progress: called with the fraction read, if the metadata promise a number.

    Attributes:
        storage: `mcap` or `sqlite3`.
        topics: topic -> ROS types on it (more than one is possible).
        damage: what is wrong with the bag, one line; "" = nothing so far (reading may find more).
        count, promised: number of readable messages, and that of the metadata, None if unknown.
        undated: number of messages that were recorded at zero: before /clock began, a recorder that
            follows it knows no time. They count as recorded with the message written before them,
            the first ones with the first that has a time, or are left out if they have no stamp
            either. If none has a time, they count as recorded at their stamps.
        span_ns: first and last time of recording [ns]; zeros if there is no message.

    Raises:
        BagError: there is no bag, or nothing of it can be read.
    """

    def __init__(
        self, path: str | os.PathLike[str], progress: Callable[[float], None] | None = None
    ) -> None:
        self.path = Path(path)
        self.damage = ""
        self.promised: int | None = None
        self._packed_messages = False
        if not self.path.exists():
            raise BagError(f"bag {self.path} does not exist")
        self._files = _data_files(self.path)
        self.storage: Storage = "mcap" if storage.is_mcap(self._files[0]) else "sqlite3"
        if self.path.is_dir():
            self._read_metadata()
        self._survey(progress)
        if self.damage and not self.count:
            raise BagError(f"bag {self.path} cannot be read: {self.damage}")

    def _read_metadata(self) -> None:
        try:
            metadata = storage.read_metadata(self.path)
        except DamagedFile as error:
            self._note(str(error))
        else:
            self.promised = metadata.message_count
            self._packed_messages = metadata.packed_messages
            # A file may have been packed or unpacked since.
            listed = {Path(name.removesuffix(".zstd")).name for name in metadata.files}
            missing = listed - {file.name.removesuffix(".zstd") for file in self._files}
            if missing:
                self._note(f"{sorted(missing)[0]} is missing")
            present = [f for f in self._files if f.name.removesuffix(".zstd") in listed]
            self._files = present or self._files

    def _survey(self, progress: Callable[[float], None] | None) -> None:
        """Fill in what the messages say, without keeping them."""
        self.topics: dict[str, tuple[str, ...]] = {}
        self.count = self.undated = late = 0
        first = latest = self._first_written = 0
        for record in self._records(None):
            self.count += 1
            if record.time_ns == 0:
                self.undated += 1
            elif not latest:
                first = latest = self._first_written = record.time_ns
            else:
                first = min(first, record.time_ns)
                latest = max(latest, record.time_ns)
                late = max(late, latest - record.time_ns)
            if progress and self.promised and self.count % _PROGRESS_MESSAGES == 0:
                progress(min(1.0, self.count / max(1, self.promised)))
            types = self.topics.get(record.topic, ())
            if record.type not in types:
                self.topics[record.topic] = (*types, record.type)
        if self.undated and 0 < first < _LEAST_TIME:  # it is simulated time that began at zero
            first, self._first_written, self.undated = 0, 0, 0
        self.span_ns = (first, latest)
        self._late = min(late, _MOST_LATE)
        if late > _MOST_LATE:
            self._note(
                f"messages are up to {late * 1e-9:.1f} s out of order, "
                f"{_MOST_LATE * 1e-9:.0f} s can be sorted"
            )
        if self.promised is not None and self.promised != self.count:
            self._note(f"metadata.yaml promises {self.promised} messages, {self.count} were found")

    def messages(self, wanted: Mapping[str, str]) -> Iterator[Record]:
        """Messages of these topics (topic -> type) in the order of recording, then of writing.

        A message is kept back while one behind it may be older, 10 s at most; one that is written
        later than that comes out of order (`damage` says so).
        """
        waiting: list[tuple[int, int, Record]] = []
        latest, dated = self._first_written, False
        for number, record in enumerate(self._records(wanted.items())):
            if self.undated and record.time_ns == 0:
                stamp_ns = _stamp(record)
                if stamp_ns == 0 and not dated:
                    continue
                all_undated = self.undated == self.count
                time_ns = max(latest, stamp_ns or 0) if all_undated else latest
                record = record._replace(time_ns=time_ns)
            else:
                dated = True
            latest = max(latest, record.time_ns)
            heapq.heappush(waiting, (record.time_ns, number, record))
            while waiting and waiting[0][0] <= latest - self._late:
                yield heapq.heappop(waiting)[2]
        while waiting:
            yield heapq.heappop(waiting)[2]

    def _records(self, wanted: Collection[tuple[str, str]] | None) -> Iterator[Record]:
        named: set[object] = set()
        for file in self._files:
            for record in storage.records(file, wanted, self._note):
                topic, kind, time_ns, _ = record
                if (topic, kind) not in named and not (_is_name(topic) and _is_name(kind)):
                    self._note(f"a topic of {file.name} is called {topic!r}, of type {kind!r}")
                    continue
                named.add((topic, kind))
                if not (isinstance(time_ns, int) and 0 <= time_ns < _END_OF_TIME):
                    self._note(f"a message of {file.name} is recorded at {time_ns!r} ns")
                    continue
                packed = self._packed_messages or storage.is_packed(record.data)
                if wanted is None or not packed:
                    yield record
                    continue
                try:
                    yield record._replace(data=storage.unpacked_message(record.data))
                except DamagedFile as error:
                    self._note(f"a message on {topic} {error}")

    def _note(self, problem: str) -> None:
        """Keep the first thing that is wrong."""
        self.damage = self.damage or one_line(problem)[:_LONGEST_LINE]


class _CommittingWriter(Sqlite3Writer):
    """Commits now and then: a transaction that ends on a full disk is lost as a whole.

    It relies on undocumented attributes of the library, `conn` and `STORAGE_PLUGINS`: writing
    schema, definitions and metadata ourselves would take a hundred lines.
    """

    def __init__(self, path: Path, compression: CompressionMode) -> None:
        super().__init__(path, compression)
        self.conn.execute("PRAGMA synchronous=OFF")  # the bag is nothing before it is whole
        self._count = 0

    def write(self, connection: Connection, timestamp: int, data: bytes | memoryview) -> None:
        super().write(connection, timestamp, data)
        self._count += 1
        if self._count % _PER_COMMIT == 0:
            self.conn.commit()


class _Writer(Writer):
    STORAGE_PLUGINS = {StoragePlugin.MCAP: McapWriter, StoragePlugin.SQLITE3: _CommittingWriter}


class BagWriter:
    """Writes a bag under a temporary name beside its place; it appears there on `finish`.

    Args:
        path: directory that will be the bag; must not exist, its parent must.
        topics: topic -> ROS type, in the order of their numbers in the bag.
        storage: `mcap` or `sqlite3`.

    Attributes:
        failure: why the bag is incomplete (the disk is full), one line; or "".

    Raises:
        BagError: the place is taken or cannot be written.
    """

    def __init__(
        self, path: str | os.PathLike[str], topics: Mapping[str, str], storage: Storage
    ) -> None:
        self.path = Path(path)
        self.failure = ""
        if self.path.exists() or self.path.is_symlink():
            raise BagError(f"output {self.path} exists; remove it or choose another name")
        folder = self.path.resolve().parent
        if not folder.is_dir():
            missing = f"the folder {folder} does not exist; create it first"
            raise BagError(f"output {self.path}: {missing}")
        typestore = get_typestore(Stores.ROS2_JAZZY)
        with ExitStack() as undo:
            try:
                self._place = AtomicOutput(self.path)
                undo.callback(self._place.discard)
                place = self._place.path
                self._writer = _Writer(place, version=9, storage_plugin=_PLUGINS[storage])
                self._writer.open()
                self._connections: dict[str, Connection] = {
                    topic: self._writer.add_connection(topic, kind, typestore=typestore)
                    for topic, kind in topics.items()
                }
            except _DISK_ERRORS as error:
                raise self._cannot_write(error) from None
            undo.pop_all()

    def write(self, topic: str, time_ns: int, data: bytes) -> None:
        """Append one serialised message; BagError if the disk is full (`finish` keeps earlier
        ones).
        """
        try:
            self._writer.write(self._connections[topic], time_ns, data)
        except _DISK_ERRORS as error:
            self._fail(error)
            raise BagError(self.failure) from None

    def finish(self) -> None:
        """Complete the bag, also after a `failure`, and move it into place; BagError if that is
        taken.
        """
        try:
            if not self.failure:
                self._writer.close()
        except _DISK_ERRORS as error:
            self._fail(error)
        try:
            self._place.commit()
        except OSError as error:
            raise self._cannot_write(error) from None
        finally:
            self._place.discard()

    def discard(self) -> None:
        """Leave nothing behind."""
        self._abort()
        self._place.discard()

    def _fail(self, error: Exception) -> None:
        self.failure = (
            f"output {self.path} is incomplete ({_reason(error)}); free space and run again. The "
            "messages written so far are kept without metadata ('ros2 bag reindex')"
        )
        self._abort()

    def _abort(self) -> None:
        with suppress(*_DISK_ERRORS):  # what waits to be written goes nowhere
            self._writer.abort()

    def _cannot_write(self, error: Exception) -> BagError:
        return BagError(
            f"output {self.path} cannot be written ({_reason(error)}); choose another folder"
        )


def _stamp(record: Record) -> int | None:
    """Stamp of a message [ns], of the first one in a list of them; None = it has none."""
    stamp_ns = cdr.stamp_of(record.type, record.data)
    return stamp_ns if stamp_ns is None or 0 <= stamp_ns < _END_OF_TIME else 0


def _reason(error: Exception) -> str:
    return getattr(error, "strerror", None) or str(error)


def _is_name(value: object) -> bool:
    return isinstance(value, str) and value.isprintable()


def is_bag(path: Path) -> bool:
    """Whether a path is meant as a bag."""
    return path.is_dir() or storage.is_data_file(path) or path.suffix == _ROS_1


def _data_files(path: Path) -> list[Path]:
    """The files of a bag that hold messages, in the order of their numbers; unpacked ones first."""
    if path.is_file() and storage.is_data_file(path):
        return [path]
    inside = sorted(path.iterdir()) if path.is_dir() else [path]
    files = [file for file in inside if storage.is_data_file(file) and file.is_file()]
    old = [file for file in inside if file.suffix == _ROS_1]
    if not files and old:
        places = f"--src {quote(str(old[0]))} --dst {quote(str(old[0].with_suffix('')))}"
        raise BagError(
            f"{old[0]} is a bag of ROS 1; convert it: "
            f"rosbags-convert {places} --dst-typestore ros2_jazzy"
        )
    if not path.is_dir():
        raise BagError(f"{path} is not a bag: needs a rosbag2 directory, a .mcap or a .db3 file")
    if not files:
        raise BagError(f"{path} is not a bag: no .mcap or .db3 file in it")
    names = {file.name for file in files}
    files = [f for f in files if f.name.removesuffix(".zstd") not in names - {f.name}]
    return sorted(files, key=lambda file: (len(file.name), file.name))


def topic_list(topics: Mapping[str, Collection[str]]) -> str:
    """Topics and types for people: `/a (pkg/msg/A), /b (pkg/msg/B)`."""
    texts = [f"{topic} ({', '.join(types)})" for topic, types in sorted(topics.items())]
    more = [f"{len(texts) - _MOST_TOPICS} more"] if len(texts) > _MOST_TOPICS else []
    return ", ".join(texts[:_MOST_TOPICS] + more)
