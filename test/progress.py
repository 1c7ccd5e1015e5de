"""What a command shows of its progress, without a terminal."""

from collections.abc import Callable, Iterator
from contextlib import contextmanager

import pytest


def shown_progress(patch: pytest.MonkeyPatch, command: str) -> list[float]:
    """The list to which `dlo_sim <command>` will add the fractions that its bar would show."""
    shown: list[float] = []

    @contextmanager
    def bar(label: str, keeps: bool = False) -> Iterator[Callable[[float], None]]:
        yield shown.append

    patch.setattr(f"dlo_sim.cli.{command}.progress_bar", bar)
    return shown


def rises(shown: list[float]) -> bool:
    """Whether a user sees it go on: at least five different fractions that rise to 1."""
    return shown == sorted(shown) and len(set(shown)) >= 5 and shown[-1] == pytest.approx(1.0)
