"""Bags on disk: the only place that knows the bag library. Raw CDR in, raw CDR out.

Reads rosbag2 directories and single `.mcap` or `.db3` files. A bag that was cut off (a full disk, a
killed recorder) is read as far as it goes; `Bag.damage` says what is missing. Written bags hold
neither the wall time nor the path they were written to, so the same messages give the same bytes
wherever they go.
"""

from __future__ import annotations

import os
import shutil
import tempfile
from collections.abc import Collection, Iterator, Mapping
from pathlib import Path
from types import TracebackType
from typing import Literal, NamedTuple

from rosbags.interfaces import Connection
from rosbags.rosbag2 import Reader, StoragePlugin, Writer
from rosbags.typesys import Stores, get_typestore

from dlo_sim.replay import salvage

Storage = Literal["mcap", "sqlite3"]

_PLUGINS = {"mcap": StoragePlugin.MCAP, "sqlite3": StoragePlugin.SQLITE3}
_SUFFIXES = {".mcap": "mcap", ".db3": "sqlite3"}
# The data file's name is part of the bytes (it is in the metadata), so it must not depend on the
# output path.
_FILE_NAME = "dlo_sim_0"


class BagError(Exception):
    """A bag that cannot be read or written; one line says which and why."""


class BagMessage(NamedTuple):
    """Topic, type, time of recording [ns], serialised message."""

    topic: str
    type: str
    time_ns: int
    data: bytes


class Bag:
    """A bag opened for reading; use as a context manager.

    Args:
        path: a rosbag2 directory, or one `.mcap` or `.db3` file.

    Attributes:
        storage: `mcap` or `sqlite3`.
        topics: topic -> ROS types found on it (more than one is possible).
        damage: what is wrong with the bag, one line; "" = nothing so far (reading may find more).
        promised: number of messages that the metadata promises, None if unknown.

    Raises:
        BagError: there is no bag, or nothing of it can be read.
    """

    def __init__(self, path: str | os.PathLike[str]) -> None:
        self.path = Path(path)
        self.damage = ""
        self.promised: int | None = None
        self._reader: Reader | None = None
        self._salvaged: list[salvage.Record] = []
        if not self.path.exists():
            raise BagError(f"bag {self.path} does not exist")
        self._files = _data_files(self.path)
        self.storage: Storage = _storage(self._files[0])
        try:
            self._open(self.path)
        except Exception as error:  # the library raises whatever a broken file provokes
            self._rescue(f"{type(error).__name__}: {_one_line(error)}")

    def _open(self, path: Path) -> None:
        reader = Reader(path)
        reader.open()
        self._reader = reader
        self.promised = reader.message_count
        self.topics: dict[str, tuple[str, ...]] = {}
        for connection in reader.connections:
            types = self.topics.get(connection.topic, ())
            if connection.msgtype not in types:
                self.topics[connection.topic] = (*types, connection.msgtype)

    def _rescue(self, reason: str) -> None:
        """Read what there is without the library's indexes."""
        self._salvaged = []
        for file in self._files:
            self._salvaged += salvage.records(file)
        if not self._salvaged:
            raise BagError(f"bag {self.path} cannot be read: {reason}") from None
        self._salvaged.sort(key=lambda record: record.time_ns)
        self.promised = _promised(self.path)
        self.damage = reason
        self.topics = {}
        for record in self._salvaged:
            if record.type not in self.topics.get(record.topic, ()):
                self.topics[record.topic] = (*self.topics.get(record.topic, ()), record.type)

    def messages(self, wanted: Mapping[str, str]) -> Iterator[BagMessage]:
        """Messages of these topics (topic -> type) in the order of recording; sets `damage` if the
        bag breaks off.
        """
        if self._reader is None:
            for record in self._salvaged:
                if wanted.get(record.topic) == record.type:
                    yield BagMessage(*record)
            return
        connections = [c for c in self._reader.connections if wanted.get(c.topic) == c.msgtype]
        if not connections:
            return
        last = None
        try:
            for connection, time_ns, data in self._reader.messages(connections):
                last = time_ns
                yield BagMessage(connection.topic, connection.msgtype, time_ns, data)
        except GeneratorExit:
            raise
        except Exception as error:  # as above
            self._close()
            self._rescue(f"{type(error).__name__}: {_one_line(error)}")
            for record in self._salvaged:
                if wanted.get(record.topic) == record.type and (
                    last is None or record.time_ns > last
                ):
                    yield BagMessage(*record)

    @property
    def salvaged(self) -> int:
        """Number of messages that were read from a damaged bag, all topics; 0 if it is whole."""
        return len(self._salvaged)

    @property
    def span_ns(self) -> tuple[int, int]:
        """First and last time of recording [ns]."""
        if self._reader is not None:
            return self._reader.start_time, self._reader.end_time
        return self._salvaged[0].time_ns, self._salvaged[-1].time_ns

    def _close(self) -> None:
        reader, self._reader = self._reader, None
        if reader is not None:
            reader.close()

    def __enter__(self) -> Bag:
        return self

    def __exit__(
        self,
        kind: type[BaseException] | None,
        error: BaseException | None,
        trace: TracebackType | None,
    ) -> None:
        self._close()


class BagWriter:
    """Writes a bag under a temporary name beside its place; it appears there, whole, on `finish`.

    Args:
        path: directory that will be the bag; must not exist, its parent must.
        topics: topic -> ROS type, in the order of their numbers in the bag.
        storage: `mcap` or `sqlite3`.

    Raises:
        BagError: the place is taken or cannot be written.
    """

    def __init__(
        self, path: str | os.PathLike[str], topics: Mapping[str, str], storage: Storage
    ) -> None:
        self.path = Path(path)
        if self.path.exists() or self.path.is_symlink():
            raise BagError(f"output {self.path} exists; remove it or choose another name")
        try:
            parent = self.path.resolve().parent
            self._folder = Path(tempfile.mkdtemp(prefix=f".{self.path.name}.", dir=parent))
        except OSError as error:
            reason = error.strerror or str(error)
            raise BagError(f"output {self.path} cannot be written: {reason}") from None
        try:
            self._writer = Writer(
                self._folder / _FILE_NAME, version=9, storage_plugin=_PLUGINS[storage]
            )
            self._writer.open()
            typestore = get_typestore(Stores.ROS2_JAZZY)
            self._connections: dict[str, Connection] = {
                topic: self._writer.add_connection(topic, kind, typestore=typestore)
                for topic, kind in topics.items()
            }
        except BaseException:
            shutil.rmtree(self._folder, ignore_errors=True)
            raise

    def write(self, topic: str, time_ns: int, data: bytes) -> None:
        """Append one serialised message.

        Raises:
            BagError: the disk refuses.
        """
        try:
            self._writer.write(self._connections[topic], time_ns, data)
        except OSError as error:
            raise BagError(f"output {self.path} cannot be written: {error.strerror}") from None

    def finish(self) -> None:
        """Complete the bag and put it in its place.

        Raises:
            BagError: the disk refuses, or the place was taken meanwhile.
        """
        try:
            self._writer.close()
            (self._folder / _FILE_NAME).rename(self.path)
        except OSError as error:
            raise BagError(f"output {self.path} cannot be written: {error.strerror}") from None
        finally:
            shutil.rmtree(self._folder, ignore_errors=True)

    def discard(self) -> None:
        """Leave nothing behind."""
        self._writer.abort()
        shutil.rmtree(self._folder, ignore_errors=True)


def _data_files(path: Path) -> list[Path]:
    """The files of a bag that hold messages, in order."""
    if path.is_file():
        if path.suffix not in _SUFFIXES:
            raise BagError(f"{path} is no bag: needs a rosbag2 directory, a .mcap or a .db3 file")
        return [path]
    files = sorted(file for file in path.iterdir() if file.suffix in _SUFFIXES)
    if not files:
        raise BagError(f"{path} is no bag: no .mcap or .db3 file in it")
    return files


def _storage(file: Path) -> Storage:
    return "mcap" if file.suffix == ".mcap" else "sqlite3"


def _promised(path: Path) -> int | None:
    """Number of messages according to metadata.yaml, None if it does not say."""
    try:
        lines = (path / "metadata.yaml").read_text(encoding="utf-8").splitlines()
    except OSError:
        return None
    for line in lines:  # the total is the one that is indented least
        if line.startswith("  message_count:"):
            return int(line.split(":")[1])
    return None


def _one_line(error: BaseException) -> str:
    return " ".join(str(error).split()) or "no reason given"


def topic_list(topics: Mapping[str, Collection[str]]) -> str:
    """Topics and types for people: `/a (pkg/msg/A), /b (pkg/msg/B)`."""
    return ", ".join(f"{topic} ({', '.join(types)})" for topic, types in sorted(topics.items()))
