"""What a process needs before it opens a file or imports numpy, and warnings as one line each on
stderr, without the place in the source.

The Python API keeps Python's own format of warnings, so a command asks for lines when it starts;
the processes that it starts do as it does (`process.children`).
"""

import os
import sys
import warnings
from typing import TextIO

# The Kalman filter of 41 control points is just large enough for several threads, which wait for
# each other: with one of two cores busy an update takes 45 to 70 ms, in one thread 0.4 to 0.6 ms
# (medians of 150). Other cores are better used by other processes.
_THREADS = ("OPENBLAS_NUM_THREADS", "MKL_NUM_THREADS", "BLIS_NUM_THREADS")


def begin() -> None:
    """Have standard streams that can be written to, and linear algebra in one thread."""
    for variable in _THREADS:
        os.environ.setdefault(variable, "1")
    # The next file that is opened would get the number of a closed stream, and its output.
    for number in (0, 1, 2):
        try:
            os.fstat(number)
        except OSError:
            os.open(os.devnull, os.O_RDWR)  # the lowest number that is free: this one
            os.set_inheritable(number, True)
    sys.stdout = sys.stdout or _writing_to(1)
    sys.stderr = sys.stderr or _writing_to(2)
    for stream in (sys.stdout, sys.stderr):
        if hasattr(stream, "reconfigure"):  # names of files need not be UTF-8
            stream.reconfigure(errors="backslashreplace")


def _writing_to(number: int) -> TextIO:
    return open(number, "w", encoding="utf-8", closefd=False)


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
