"""Warnings of a command: one line each on stderr, without the place in the source.

The Python API keeps Python's own format, so a command asks for lines when it starts; the processes
that it starts do as it does (`process.children`).
"""

import sys
import warnings


def use_lines(lines: bool = True) -> None:
    """Print warnings of this process as lines from now on; with False, change nothing."""
    if lines:
        warnings.formatwarning = as_line


def uses_lines() -> bool:
    """Whether warnings of this process are printed as lines."""
    return warnings.formatwarning is as_line


def as_line(
    message: Warning | str,
    category: type[Warning],
    filename: str,
    lineno: int,
    line: str | None = None,
) -> str:
    """A warning as one line; has the arguments of `warnings.formatwarning`.

    The category is named unless it is UserWarning, the one of this package: others come from
    libraries, and their wording alone may not say what they are.
    """
    wipe = "\r\033[K" if sys.stderr is not None and sys.stderr.isatty() else ""  # a progress bar
    kind = "" if category is UserWarning else f"{category.__name__}: "
    return f"{wipe}dlo_sim: warning: {kind}{' '.join(str(message).split())}\n"
