"""Nothing that the node has loaded is looked for or fetched again while it ticks."""

from __future__ import annotations

import ctypes
import gc
import sys

# Of <sys/mman.h>: what is mapped now and later, each page from its first use on.
_CURRENT, _FUTURE, _ON_FAULT = 1, 2, 4


def settle() -> bool:
    """Keep what start-up has allocated (modules, compiled code) out of the way of the ticks.

    The garbage collector does not scan it any more, which would hold up a tick. Its pages, and all
    that are used later, stay in memory; where the system does not allow that (`ulimit -l`) they are
    read again from disk when it has taken them away.

    Returns:
        Whether pages stay in memory.
    """
    gc.collect()
    gc.freeze()
    if sys.platform != "linux":
        return False
    mlockall = getattr(ctypes.CDLL(None), "mlockall", None)
    return mlockall is not None and mlockall(_CURRENT | _FUTURE | _ON_FAULT) == 0
