"""`metadata.yaml` of a bag: what it promises about the data files, checked first."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import Any, NamedTuple

from dlo_sim.replay.storage import DamagedFile
from dlo_sim.scene.plain_yaml import FileRefused, parse_yaml, read_text
from dlo_sim.scene.refusal import brief

_NAME = "metadata.yaml"
_NEWEST = 9
# What is packed: nothing, the data files as a whole, each message, or chunks of an MCAP file.
_MODES = ("none", "file", "message", "storage")
# A recording of hundreds of topics names the quality of service of each of their publishers.
_MOST_VALUES = 100_000
# Key -> type of what every version holds.
_KEYS: dict[str, type] = {
    "version": int,
    "storage_identifier": str,
    "relative_file_paths": list,
    "duration.nanoseconds": int,
    "starting_time.nanoseconds_since_epoch": int,
    "message_count": int,
    "topics_with_message_count": list,
}
_TYPES = {int: "a whole number", str: "a text", list: "a list"}


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
        document = parse_yaml(read_text(folder / _NAME), most_values=_MOST_VALUES)
    except FileRefused as error:
        raise DamagedFile(f"{_NAME} {error.problem}") from None
    found: Any = document.get("rosbag2_bagfile_information") if _is_map(document) else None
    if not _is_map(found):
        raise DamagedFile(f"{_NAME} holds no rosbag2_bagfile_information")
    values = {key: _value(found, key) for key in _KEYS}
    for key, value in values.items():
        if not isinstance(value, _KEYS[key]) or isinstance(value, bool):
            raise DamagedFile(f"{_NAME}: {key}: {brief(value)} is not {_TYPES[_KEYS[key]]}")
    if values["version"] > _NEWEST:
        raise DamagedFile(f"{_NAME}: version: {values['version']} is newer than {_NEWEST}")
    mode = str(found.get("compression_mode") or "none").lower()
    if mode not in _MODES:
        raise DamagedFile(f"{_NAME}: compression_mode: {brief(mode)} is not supported")
    packing = found.get("compression_format")
    if mode != "none" and packing != "zstd":
        raise DamagedFile(f"{_NAME}: compression_format: {brief(packing)} is not supported")
    files = tuple(Path(str(name)).name for name in values["relative_file_paths"])
    return Metadata(values["message_count"], files, mode == "message")


def _value(found: Any, key: str) -> Any:
    for part in key.split("."):
        found = found.get(part) if _is_map(found) else None
    return found


def _is_map(value: object) -> bool:
    return isinstance(value, Mapping)
