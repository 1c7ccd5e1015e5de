"""YAML of parameter files: one document of plain values, read within limits.

The source of a file may not be trusted. It must be a regular file of limited size, with limited
nesting and a limited number of values, and without aliases: a page of them can expand to more
values than fit into memory, and ROS refuses them as well.
"""

import os
import re
import stat
from collections.abc import Iterator
from pathlib import Path
from typing import Any, Literal

from ruamel.yaml import YAML
from ruamel.yaml.constructor import DuplicateKeyError
from ruamel.yaml.error import MarkedYAMLError
from ruamel.yaml.events import (
    AliasEvent,
    CollectionEndEvent,
    CollectionStartEvent,
    NodeEvent,
    ScalarEvent,
)

from dlo_sim.scene.refusal import SceneError

_LARGEST_FILE = 1_000_000  # bytes; a scene is a page, so a larger file is something else
MOST_VALUES = 20_000  # keys count too; about 2 s to read
_DEEPEST = 32


class FileRefused(SceneError):
    """A file that cannot be used; `problem` is the message without the cure."""

    def __init__(self, problem: str, cure: str) -> None:
        super().__init__(f"{problem}; {cure}")
        self.problem = problem


def read_text(source: Path) -> str:
    """The text of a file; FileRefused if missing, no regular file (pipes block), big, not UTF-8."""
    try:
        mode = source.stat().st_mode
        if stat.S_ISDIR(mode):
            raise FileRefused("is a folder", "give a scene file")
        if not stat.S_ISREG(mode):
            raise FileRefused("is not a regular file", "give a scene file")
        # Non-blocking, in case it has become a pipe since the check.
        with open(os.open(source, os.O_RDONLY | os.O_NONBLOCK), "rb") as file:
            data = file.read(_LARGEST_FILE + 1)
        if len(data) > _LARGEST_FILE:
            raise FileRefused(f"holds more than {_LARGEST_FILE} bytes", "give a scene file")
        return data.decode("utf-8")
    except FileNotFoundError:
        raise FileRefused("does not exist", "give a scene file or a shipped scene's name") from None
    except UnicodeDecodeError:
        raise FileRefused("is not a text file", "give a scene file in YAML") from None
    except OSError as error:
        raise FileRefused(f"cannot be read ({error.strerror})", "check the path") from None


def parse_yaml(
    text: str, kind: Literal["safe", "rt"] = "safe", most_values: int = MOST_VALUES
) -> Any:
    """The document in a text, as YAML 1.2.

    Args:
        kind: `safe`: built-in types; `rt`: with comments and formatting, for a round trip.
        most_values: largest number of keys and values.

    Raises:
        FileRefused: what is wrong, and where.
    """
    yaml = YAML(typ=kind, pure=True)
    yaml.composer.warn_double_anchors = False  # anchors have no effect without aliases
    try:
        _check_bounds(YAML(typ="safe", pure=True).parse(text), most_values)
        return yaml.load(text)
    except DuplicateKeyError as error:
        where = f"line {error.problem_mark.line + 1}" if error.problem_mark else "the file"
        duplicate = re.search(r'duplicate key "?(.*?)"? with', str(error.problem))
        key = f" {duplicate.group(1)}" if duplicate else ""
        raise FileRefused(f"{where}: key{key} is there twice", "keep one of them") from None
    except MarkedYAMLError as error:
        where = f", line {error.problem_mark.line + 1}" if error.problem_mark else ""
        problem = f"is not valid YAML{where}: {error.problem}"
        raise FileRefused(problem, "correct the line") from None
    except Exception as error:  # malformed text raises many types in the library
        raise FileRefused(f"is not valid YAML: {error}", "correct it") from None


def _check_bounds(events: Iterator[Any], most_values: int) -> None:
    """Refuse aliases, deep nesting and too many values before any object is constructed."""
    level = values = 0
    for event in events:
        level -= isinstance(event, CollectionEndEvent)
        if not isinstance(event, NodeEvent):
            continue
        values += 1
        problem = ""
        if isinstance(event, AliasEvent):
            problem = f"alias '*{event.anchor}' is not supported, write the value out"
        elif isinstance(event, ScalarEvent) and event.value == "<<" and event.implicit[0]:
            problem = "merge keys ('<<') are not supported, write the values out"
        elif level == _DEEPEST:
            problem = f"nests deeper than {_DEEPEST} levels"
        elif values > most_values:
            problem = f"holds more than {most_values} keys and values"
        if problem:
            raise MarkedYAMLError(None, None, problem, event.start_mark)
        level += isinstance(event, CollectionStartEvent)
