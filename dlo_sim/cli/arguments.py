"""Arguments that several subcommands share, and how wrong ones are refused."""

import argparse
from argparse import ArgumentTypeError
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from typing import NoReturn

from dlo_sim.scene.description import Scene
from dlo_sim.scene.loading import SceneError, load_scene, parse_assignment

_LONGEST = 1e9  # [s], thirty years; beyond, steps could no longer be counted in whole numbers


class CommandError(Exception):
    """Input that a subcommand refuses: one line that names it and the cure."""


class Parser(argparse.ArgumentParser):
    """An argument parser whose errors are one line on stderr, exit status 2."""

    def error(self, message: str) -> NoReturn:
        """Refuse the command line.

        Raises:
            CommandError: always; `main` prints it.
        """
        raise CommandError(f"{message}; see '{self.prog} --help'")


def number(unit: str, fits: Callable[[float], bool], otherwise: str) -> Callable[[str], float]:
    """What reads a number from an option.

    Args:
        unit: what to give. fits: whether a number will do. otherwise: what it is not, and the cure.
    """

    def read(text: str) -> float:
        try:
            value = float(text)
        except ValueError:
            raise ArgumentTypeError(f"{text!r} is not a number; give {unit}") from None
        if not fits(value):
            raise ArgumentTypeError(f"{text} is not {otherwise}")
        return value

    return read


positive_seconds = number(
    "seconds",
    lambda value: 0.0 < value <= _LONGEST,
    f"a time span; give seconds above zero, {_LONGEST:g} at most",
)


@contextmanager
def needing_plots(refusal: str) -> Iterator[None]:
    """Refuse what is asked for where a package of the extra `plots` is missing."""
    try:
        yield
    except ModuleNotFoundError as missing:
        if (missing.name or "").partition(".")[0] != "matplotlib":
            raise
        raise CommandError(refusal) from None


def add_scene_options(parser: argparse.ArgumentParser) -> None:
    """Add `--set key=value`."""
    parser.add_argument(
        "--set",
        metavar="KEY=VALUE",
        action="append",
        default=[],
        dest="assignments",
        help="override a key of the scene, such as discretization.control_points=13; repeatable",
    )


def add_scheduler_option(parser: argparse.ArgumentParser) -> None:
    """Add `--scheduler ADDRESS`."""
    parser.add_argument(
        "--scheduler",
        metavar="ADDRESS",
        help="Dask scheduler for the work that is not timed (default: the cores of this machine)",
    )


def read_scene(text: str, assignments: Sequence[str]) -> Scene:
    """The scene that a user means, with `--set` applied.

    Raises:
        SceneError: if the file or a value is refused.
    """
    overrides: dict[str, object] = {}
    for assignment in assignments:
        key, value = parse_assignment(assignment)
        if key in overrides:
            raise SceneError(f"--set {key} is given twice; keep one of them")
        overrides[key] = value
    return load_scene(text, overrides)
