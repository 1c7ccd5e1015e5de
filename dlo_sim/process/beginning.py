"""What a process needs before it opens a file or imports numpy."""

import os
import sys
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
