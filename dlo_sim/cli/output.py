"""What subcommands write: files that are whole or absent, strictly valid JSON, a progress bar."""

import dataclasses
import json
import math
import os
import sys
import tempfile
from collections.abc import Callable, Iterator, Mapping
from contextlib import contextmanager
from pathlib import Path
from typing import Any

from dlo_sim.cli.arguments import CommandError

_BAR_WIDTH = 40
_WIPE = "\033[K"  # from the cursor to the end of the line


def check_output_file(path: Path) -> None:
    """Refuse, before any work, a file that could not be written afterwards.

    Raises:
        CommandError: naming the path, what is wrong and the cure.
    """
    if path.exists() and not path.is_file():
        raise CommandError(f"--output {path} is not a regular file; give the name of a file")
    folder = path.resolve().parent
    if not folder.is_dir():
        raise CommandError(f"--output {path}: the folder {folder} does not exist; create it first")
    check_writable(path, folder)


def check_writable(path: Path, folder: Path) -> None:
    """Refuse a folder that takes no file, for the output `path` in it.

    Raises:
        CommandError: naming the path, what is wrong and the cure.
    """
    try:
        with tempfile.TemporaryFile(dir=folder):
            pass
    except OSError as error:
        raise CommandError(
            f"--output {path} cannot be written ({error.strerror}); choose another folder"
        ) from None


def write_npz(path: Path, arrays: Mapping[str, Any]) -> None:
    """Write arrays as a compressed npz under exactly this name; never half a file.

    Raises:
        CommandError: if the disk refuses; the file that was there before is kept.
    """
    import numpy as np

    target = path.resolve()
    partial = target.with_name(f".{target.name}.{os.getpid()}.partial")
    try:
        with partial.open("wb") as stream:
            np.savez_compressed(stream, **arrays)
        os.replace(partial, target)
    except OSError as error:
        partial.unlink(missing_ok=True)
        raise CommandError(
            f"--output {path} could not be written ({error.strerror}); free space or choose "
            "another folder"
        ) from None


def print_json(values: Mapping[str, Any]) -> None:
    """Print one JSON object on one line; numbers that are not finite become null."""
    print(json.dumps(_plain(values), allow_nan=False), flush=True)


def _plain(value: Any) -> Any:
    if dataclasses.is_dataclass(value) and not isinstance(value, type):
        return _plain(dataclasses.asdict(value))
    if isinstance(value, Mapping):
        return {str(key): _plain(item) for key, item in value.items()}
    if hasattr(value, "tolist"):
        return _plain(value.tolist())
    if isinstance(value, float):
        return value if math.isfinite(value) else None
    if isinstance(value, list | tuple):
        return [_plain(item) for item in value]
    return value if isinstance(value, bool | int | str | None) else str(value)


def print_rows(rows: Mapping[str, str]) -> None:
    """Print `label  value` lines with the values in one column; further lines are indented."""
    width = max(map(len, rows), default=0)
    for label, text in rows.items():
        first, *rest = text.splitlines() or [""]
        print(f"  {label:<{width}}  {first}")
        for line in rest:
            print(f"  {'':<{width}}  {line}")


def readable(value: Any) -> str:
    """A value of a summary for people: four digits, one line per entry of a mapping."""
    if dataclasses.is_dataclass(value) and not isinstance(value, type):
        value = dataclasses.asdict(value)
    if isinstance(value, Mapping):
        return "\n".join(f"{key}: {readable(item)}" for key, item in value.items()) or "-"
    if isinstance(value, list | tuple):
        lines = [", ".join(readable(item).splitlines()) for item in value]
        plain = all(isinstance(item, str | int | float) for item in value)
        return (", " if plain else "\n").join(lines) or "-"
    if isinstance(value, float) and not isinstance(value, bool):
        return f"{value:.4g}"
    return "-" if value is None or value == "" else str(value)


@contextmanager
def progress_bar(label: str) -> Iterator[Callable[[float], None] | None]:
    """A bar on stderr while work goes on, or None when stderr is not a terminal.

    Where machine code is missing, one line on stderr says so in either case.

    Yields:
        A function to call with the fraction done, 0 to 1.
    """
    if sys.stderr.isatty():
        _draw(f"{label}: preparing ...")  # loading the compiler may take a while

    from dlo_sim.simulation.machine_code import compiling_told_to

    if not sys.stderr.isatty():
        with compiling_told_to(lambda line: print(f"dlo_sim: {line}", file=sys.stderr, flush=True)):
            yield None
        return
    drawn = -1

    def draw(fraction: float) -> None:
        nonlocal drawn
        percent = int(100.0 * min(max(fraction, 0.0), 1.0))
        if percent != drawn:
            drawn = percent
            bar = "#" * (percent * _BAR_WIDTH // 100)
            _draw(f"\r{label} [{bar:<{_BAR_WIDTH}}] {percent:3d} %")

    try:
        with compiling_told_to(lambda line: _draw(f"\r{_WIPE}dlo_sim: {line}\n{label} ...")):
            yield draw
    finally:
        _draw(f"\r{_WIPE}")


def _draw(text: str) -> None:
    sys.stderr.write(text)
    sys.stderr.flush()
