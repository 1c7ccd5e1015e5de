"""Arguments that several subcommands share, and how wrong ones are refused."""

import argparse
import shlex
from argparse import ArgumentTypeError
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from typing import Any, NoReturn

from dlo_sim.scene.description import Scene
from dlo_sim.scene.loading import SceneError, load_scene, parse_assignment
from dlo_sim.scene.refusal import Refusal

_LONGEST = 1e9  # [s], thirty years; beyond, steps could no longer be counted in whole numbers


class CommandError(Refusal):
    """Input that a subcommand refuses: one line that names it and the cure."""


class Parser(argparse.ArgumentParser):
    """An argument parser whose errors are one line on stderr, exit status 2."""

    def error(self, message: str) -> NoReturn:
        """Refuse the command line.

        Raises:
            CommandError: always; `main` prints it.
        """
        raise CommandError(f"{message}; see '{self.prog} --help'")

    def option(self, words: str, text: str, **more: Any) -> None:
        """Add an argument: its name and what stands for its value, as in `--every S`; its help."""
        name, _, metavar = words.partition(" ")
        self.add_argument(name, help=text, metavar=metavar or None, **more)


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


def add_scene(
    parser: Parser,
    name: str = "scene",
    what: str = "scene file, or a shipped scene's name",
    **more: Any,
) -> None:
    """Add a scene under this name, and `--set KEY=VALUE`, for `read_scene`."""
    if name.startswith("-"):
        more["dest"] = "scene"
    parser.option(f"{name} SCENE", what, **more)
    parser.set_defaults(scene_words=f"{name} SCENE".removeprefix("scene "))
    text = "override a key of the scene, such as discretization.control_points=13; repeatable"
    parser.option("--set KEY=VALUE", text, action="append", default=[], dest="assignments")


def add_scheduler_option(parser: Parser) -> None:
    """Add `--scheduler ADDRESS`."""
    text = "Dask scheduler for the work that is not timed (default: the cores of this machine)"
    parser.option("--scheduler ADDRESS", text)


def pairs(
    option: str, texts: Sequence[str], form: str, cure: str, names: Sequence[str] = ()
) -> dict[str, str]:
    """The values of a repeatable option of the form NAME=VALUE, of any names unless some are given.

    Raises:
        CommandError: one of another form, or a name that is given twice.
    """
    found: dict[str, str] = {}
    for text in texts:
        name, _, value = text.partition("=")
        if not (name and value) or (names and name not in names):
            raise CommandError(f"{option} {text!r} is not {form}; give {cure}")
        if name in found:
            raise CommandError(f"{option} {name} is given twice; keep one of them")
        found[name] = value
    return found


def as_typed(words: Sequence[str], assignments: Sequence[str]) -> str:
    """A command line with its `--set`, each in one line."""
    changed = (("--set", " ".join(text.split())) for text in assignments)
    return shlex.join([*words, *(word for pair in changed for word in pair)])


def read_scene(options: argparse.Namespace) -> Scene:
    """The scene that a user means, with `--set` applied.

    Raises:
        SceneError: if the file or a value is refused.
    """
    overrides: dict[str, object] = {}
    for assignment in options.assignments:
        key, value = parse_assignment(assignment)
        if key in overrides:
            raise SceneError(f"--set {key} is given twice; keep one of them")
        overrides[key] = value
    return load_scene(options.scene, overrides)
