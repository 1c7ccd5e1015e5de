"""What subcommands write: files that are whole or absent, strictly valid JSON, a progress bar."""

import dataclasses
import json
import math
import os
import sys
import tempfile
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from pathlib import Path
from threading import Event, Thread
from typing import Any

from dlo_sim.cli.arguments import CommandError
from dlo_sim.process import stopping
from dlo_sim.process.atomic_output import write_atomically
from dlo_sim.scene.description import Scene

_PREPARING = "{desc}: preparing, {elapsed}"
_BAR = "{desc} {percentage:3.0f} % |{bar:40}| {elapsed}, {remaining} left"
_REFRESH = 0.5  # [s]


def check_output_file(path: Path, *inputs: str | Path) -> None:
    """Refuse, before any work, a file that could not be written afterwards, or that is read.

    Raises:
        CommandError: naming the path, what is wrong and the cure.
    """
    if path.exists() and not path.is_file():
        raise CommandError(f"--output {path} is not a regular file; give the name of a file")
    if path.exists() and any(os.path.exists(one) and path.samefile(one) for one in inputs):
        raise CommandError(f"--output {path} would replace what is read; give another name")
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


def write_whole(path: Path, write: Callable[[Path], object]) -> None:
    """Let `write` make a file under another name and put it there; never half a file.

    Raises:
        CommandError: if the disk refuses; the file that was there before is kept.
    """
    try:
        write_atomically(path.resolve(), write)
    except OSError as error:
        raise CommandError(
            f"--output {path} could not be written ({error.strerror}); free space or choose "
            "another folder"
        ) from None


def write_scene(path: Path, scene: Scene, made: str, lines: Sequence[str]) -> None:
    """Write a scene file that begins with how it was made and lines about it.

    Raises:
        CommandError: as `write_whole`.
    """
    from dlo_sim.tuning.scene_file import scene_text

    head = f"{made}. Only values that differ from the defaults are listed."
    text = scene_text(scene, [head, "", *lines, ""])
    write_whole(path, lambda partial: partial.write_text(text, encoding="utf-8"))


def write_arrays(path: Path, arrays: Mapping[str, object]) -> None:
    """Write those that are not None as a compressed npz under exactly this name.

    Raises:
        CommandError: as `write_whole`.
    """
    import numpy as np

    given: dict[str, Any] = {name: one for name, one in arrays.items() if one is not None}

    def write(partial: Path) -> None:
        with partial.open("wb") as stream:  # a name without .npz would get one
            np.savez_compressed(stream, **given)

    write_whole(path, write)


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
def progress_bar(label: str, keeps: bool = False) -> Iterator[Callable[[float], None]]:
    """A bar with the time left on stderr, where that is a terminal, while work goes on.

    Where machine code is missing, one line on stderr says so in either case.

    Args:
        keeps: the work keeps what it has when it is interrupted, so it ends itself once it moves.

    Yields:
        A function to call with the fraction done, 0 to 1, between two pieces of work. It raises
        KeyboardInterrupt if the process was asked to end.
    """
    from tqdm import tqdm

    bar = tqdm(
        total=1.0,
        desc=label,
        bar_format=_PREPARING,
        mininterval=_REFRESH,
        leave=False,
        disable=None,
    )
    moved, ended = Event(), Event()

    def show_time() -> None:
        while not ended.wait(_REFRESH):
            bar.refresh()

    def advance(fraction: float) -> None:
        if keeps:
            stopping.disable_forced_exit()
        stopping.check()
        if not moved.is_set():  # what loading and compiling took says nothing about the rest
            moved.set()
            bar.bar_format, bar.n = _BAR, fraction
            bar.initial = bar.last_print_n = fraction
            bar.unpause()
        bar.update(min(max(fraction, bar.n), 1.0) - bar.n)

    clock = Thread(target=show_time, daemon=True)
    if not bar.disable:
        clock.start()

    from dlo_sim.compiling.directory import compiling_told_to  # may take a while

    try:
        with compiling_told_to(tell):
            yield advance
    finally:
        ended.set()
        if not bar.disable:
            clock.join()
        bar.close()


def tell(line: str) -> None:
    """One line on stderr, above the bar if there is one."""
    from tqdm import tqdm

    tqdm.write(f"dlo_sim: {line}", file=sys.stderr)


def run_time(figures: Any) -> str:
    """What a run says of its times: `wall_s`, `real_time_factor`, `compile_s`."""
    speed = f"{figures.wall_s:.3g} s ({figures.real_time_factor:.3g} x real time)"
    return f"{speed}, after {figures.compile_s:.2g} s to start"


def error_rows(estimate: Mapping[str, float | None] | None, advice: str) -> dict[str, str]:
    """Rows for people about estimated position errors [m] (`DiscretizationError.numbers`); none if
    errors were not estimated.
    """
    if estimate is None:
        return {}
    known = {name: "unknown" if x is None else f"{x:.2g} m" for name, x in estimate.items()}
    line = ", ".join(f"{name} {text}" for name, text in known.items())
    return {"position error": f"{line} (estimated)" + f"\n{advice}" * bool(advice)}
